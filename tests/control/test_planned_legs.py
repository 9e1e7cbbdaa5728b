"""Where the segments of a driver's path lie in the field."""

import math

import numpy as np
import pytest

from twin.control.path_following import PathDriver, PathDriverConfig, planned_path
from twin.control.planned_legs import PlannedLeg, parallel_passes, planned_legs

START = (3.0, -2.0, 0.7)
PATH = [
    {"stop_s": 2.0, "label": "stand"},
    {"straight_m": 30.0},
    {"speed_m_s": 1.0},
    {"turn_deg": -120.0, "radius_m": 6.0, "raised": True},
    {"spin_deg": 40.0},
    {"straight_m": 20.0, "speed_m_s": 2.0},
    {"turn_deg": 200.0, "radius_m": 4.0},
]


def _config(path: list[dict[str, object]]) -> PathDriverConfig:
    return PathDriverConfig.model_validate({"path": path})


def _legs(path: list[dict[str, object]]) -> list[PlannedLeg]:
    return planned_legs(_config(path), START)


def test_legs_are_numbered_and_named_as_the_driver_does() -> None:
    config = _config(PATH)
    driver = PathDriver(config, start_e_n_heading=START, wheelbase_m=2.0, seed=1)
    legs = planned_legs(config, START)
    assert [leg.name for leg in legs] == list(driver.segment_names[:-1])
    assert [leg.index for leg in legs] == list(range(len(legs)))
    assert [leg.is_straight for leg in legs] == [False, True, False, False, True, False]
    assert [leg.is_arc for leg in legs] == [False, False, True, False, False, True]
    assert [leg.spins for leg in legs] == [False, False, False, True, False, False]
    assert [leg.raised for leg in legs] == [False, False, True, False, False, False]


def test_legs_lie_on_the_planned_path() -> None:
    path = planned_path(_config(PATH), START)
    station = 0.0
    for leg in _legs(PATH):
        for share in (0.1, 0.9):
            pose = path.pose(station + share * leg.length_m)
            beside = 0.8
            point = np.array(
                [
                    pose.east_m - beside * math.sin(pose.heading_rad),
                    pose.north_m + beside * math.cos(pose.heading_rad),
                ]
            )
            if leg.length_m:
                along, left = leg.project(point)
                assert along == pytest.approx(share * leg.length_m, abs=1e-9)
                assert left == pytest.approx(beside, abs=1e-9)
        station += leg.length_m
    assert station == pytest.approx(path.length_m)


def test_beyond_its_ends_a_straight_goes_on_and_an_arc_goes_round() -> None:
    straight, arc = _legs([{"straight_m": 10.0}, {"turn_deg": 90.0, "radius_m": 5.0}])
    ahead = straight.direction
    begin = np.array(START[:2])
    along, left = straight.project(np.stack([begin - 2.0 * ahead, begin + 14.0 * ahead]))
    assert along == pytest.approx([-2.0, 14.0])
    assert left == pytest.approx([0.0, 0.0])
    # just before the arc's beginning, on its circle
    along, left = arc.project(begin + 10.0 * ahead - 0.1 * ahead)
    assert float(along) == pytest.approx(-0.1, abs=1e-3)
    assert float(left) == pytest.approx(5.0 - math.hypot(5.0, 0.1))


def test_passes_are_the_longest_set_of_parallel_straights_with_the_implement_down() -> None:
    row, over = {"straight_m": 40.0}, {"straight_m": 4.0}
    corner = {"turn_deg": 90.0, "radius_m": 2.0, "raised": True}
    back = {"turn_deg": -90.0, "radius_m": 2.0, "raised": True}
    path = [row, corner, over, corner, row, back, over, back, row, {"turn_deg": 90.0, "radius_m": 3.0}]
    path += [{**row, "raised": True}]
    assert [leg.length_m for leg in parallel_passes(_legs(path))] == [40.0, 40.0, 40.0]
    assert parallel_passes(_legs([row, corner, over])) == []


@pytest.mark.parametrize(("turn_deg", "count"), [(180.8, 2), (181.2, 0), (179.2, 2)])
def test_passes_are_parallel_within_a_degree(turn_deg: float, count: int) -> None:
    path = [{"straight_m": 40.0}, {"turn_deg": turn_deg, "radius_m": 2.0}, {"straight_m": 40.0}]
    assert len(parallel_passes(_legs(path))) == count


def test_a_headland_turn_is_one_leg_of_several_pieces() -> None:
    config = _config([{"passes": 3, "length_m": 30.0, "width_m": 2.0, "turn_radius_m": 2.0, "run_in_m": 1.0}])
    driver = PathDriver(config, start_e_n_heading=START, wheelbase_m=2.0, seed=1)
    legs, path = planned_legs(config, START), planned_path(config, START)
    assert [leg.name for leg in legs] == list(driver.segment_names[:-1])
    assert [len(leg.pieces) for leg in legs] == [1, 5, 1, 5, 1]
    assert [leg.raised for leg in legs] == [False, True, False, True, False]
    assert sum(leg.length_m for leg in legs) == pytest.approx(path.length_m)
    station = 0.0
    for leg in legs:
        for share in (0.05, 0.3, 0.6, 0.95):
            pose = path.pose(station + share * leg.length_m)
            normal = np.array([-math.sin(pose.heading_rad), math.cos(pose.heading_rad)])
            along, left = leg.project(np.array([pose.east_m, pose.north_m]) + 0.2 * normal)
            assert along == pytest.approx(share * leg.length_m, abs=1e-6)
            assert left == pytest.approx(0.2, abs=1e-6)
        station += leg.length_m
    assert [leg.length_m for leg in parallel_passes(legs)] == [30.0, 30.0, 30.0]
