"""A field of parallel passes: lines just as far apart as asked, there and back, joined by turns that can be driven."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.control.bicycle import drive
from tests.small_scenario import small_scenario
from twin.control.parallel_passes import ParallelPasses, headland_turn
from twin.control.path_following import PathDriver, PathDriverConfig, planned_path
from twin.control.path_plan import lay_out
from twin.errors import BadInputError
from twin.geometry import Path
from twin.scenario import resolve

START = 3.0, -2.0, 0.7
"""East m, north m, heading rad."""


def field(**changes: Any) -> dict[str, Any]:
    return {"passes": 4, "length_m": 30.0, "width_m": 2.2, "turn_radius_m": 2.0} | changes


def ahead_and_left(east_m: float, north_m: float) -> tuple[float, float]:
    """Of the start."""
    de, dn, heading = east_m - START[0], north_m - START[1], START[2]
    return de * math.cos(heading) + dn * math.sin(heading), dn * math.cos(heading) - de * math.sin(heading)


@pytest.mark.parametrize("first_turn", ["left", "right"])
@pytest.mark.parametrize("run_in_m", [0.0, 3.0])
@pytest.mark.parametrize(
    ("width_m", "radius_m"), [(2.2, 2.0), (4.0, 2.0), (4.0 - 1e-12, 2.0), (9.0, 2.5), (0.5, 3.0), (4.0, 3.999)]
)
def test_lines_are_a_width_apart_and_run_there_and_back(
    width_m: float, radius_m: float, run_in_m: float, first_turn: str
) -> None:
    entry = field(width_m=width_m, turn_radius_m=radius_m, run_in_m=run_in_m, first_turn=first_turn)
    config = PathDriverConfig.model_validate({"path": [entry]})
    path, legs = planned_path(config, START), lay_out(config.path, 1.0)[1]
    assert [leg.name for leg in legs] == ["pass 1", "headland", "pass 2", "headland", "pass 3", "headland", "pass 4"]
    assert [leg.raised for leg in legs] == [False, True, False, True, False, True, False]
    assert all(after.from_m == before.to_m for before, after in itertools.pairwise(legs))
    side = 1.0 if first_turn == "left" else -1.0
    for number, leg in enumerate(legs[::2]):
        assert leg.to_m - leg.from_m == pytest.approx(30.0)
        there = number % 2 == 0
        for station, along in ((leg.from_m + 1e-9, 0.0 if there else 30.0), (leg.to_m - 1e-9, 30.0 if there else 0.0)):
            pose = path.pose(station)
            assert ahead_and_left(pose.east_m, pose.north_m) == pytest.approx(
                (along, side * number * width_m), abs=1e-6
            )
            turned = math.remainder(pose.heading_rad - START[2] - (0.0 if there else math.pi), 2.0 * math.pi)
            assert turned == pytest.approx(0.0, abs=1e-6)
    assert legs[-1].to_m == pytest.approx(path.length_m)
    assert path.length_m == pytest.approx(config.path[0].length_in_all_m)


@pytest.mark.parametrize("width_m", [0.5, 2.2, 3.9, 4.0, 7.0])
def test_a_turn_keeps_to_its_radius_and_needs_no_more_room_than_it_has_to(width_m: float) -> None:
    radius_m = 2.0
    turn = headland_turn(width_m, radius_m, 1.0)
    assert {abs(curvature) for _, curvature in turn} <= {0.0, 0.5}
    # No point of it is behind the lines' ends; the bulb reaches as far as its middle circle, which touches that of the
    # first arc, (0, -R), 2 R away from it at half the width.
    points = Path(east_m=0.0, north_m=0.0, heading_rad=0.0, pieces=turn).polyline(0.005)
    centre_m = math.sqrt((2.0 * radius_m) ** 2 - (radius_m + 0.5 * width_m) ** 2) if width_m < 2.0 * radius_m else 0.0
    assert points[:, 0].max() == pytest.approx(centre_m + radius_m, abs=1e-4)
    assert points[:, 0].min() > -1e-9
    # It is its own mirror image.
    mirrored = points[::-1] * (1.0, -1.0) + (0.0, width_m)
    np.testing.assert_allclose(mirrored[[0, -1]], points[[0, -1]], atol=1e-9)


def test_passes_have_their_own_speed_and_one_for_headlands_and_stand_among_other_segments() -> None:
    path = [
        {"straight_m": 5.0},
        field(speed_m_s=1.1, turn_speed_m_s=0.5, passes=2),
        {"straight_m": 5.0, "label": "out"},
    ]
    legs = lay_out(PathDriverConfig.model_validate({"path": path}).path, 0.7)[1]
    assert [(leg.name, leg.speed_m_s) for leg in legs] == [
        ("straight 5 m", 0.7), ("pass 1", 1.1), ("headland", 0.5), ("pass 2", 1.1), ("out", 1.1)
    ]  # fmt: skip


def test_a_single_pass_needs_no_turn() -> None:
    (leg,) = lay_out(PathDriverConfig.model_validate({"path": [field(passes=1)]}).path, 1.0)[1]
    assert (leg.name, leg.to_m) == ("pass 1", 30.0)


def test_a_field_is_driven_line_by_line() -> None:
    """On a bicycle with the machine's steering: after a run-in of 6 m, an offset d is d (1 + w s) exp(-w s) = 0.2 d."""
    config = PathDriverConfig.model_validate(
        {"path": [field(run_in_m=6.0)], "speed_m_s": 0.73, "steering_bandwidth_1_m": 0.5}
    )
    driver = PathDriver(config, start_e_n_heading=(0.0, 0.0, 0.0), wheelbase_m=1.1, seed=1)
    log = drive(driver, 330.0)
    assert driver.segment_names[driver.segment] == "finished"
    assert max(abs(moment.offset_m) for moment in log) < 0.35
    for number in range(4):
        on_line = [moment for moment in log if moment.leg == 2 * number]
        assert max(abs(moment.offset_m) for moment in on_line) < 0.07
        assert all(not moment.command.raised for moment in on_line)
        assert on_line[-1].state.north_m == pytest.approx(2.2 * number, abs=0.02)


@pytest.mark.parametrize(
    "changes",
    [
        {"passes": 0},
        {"passes": 501},
        {"passes": 2.5},
        {"width_m": 0.0},
        {"length_m": -1.0},
        {"turn_radius_m": 0.01},
        {"first_turn": "up"},
        {"run_in_m": -1.0},
        {"straight_m": 3.0},
        {"length_m": 30_000.0},
    ],
)
def test_passes_that_mean_nothing_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        PathDriverConfig.model_validate({"path": [field(**changes)]})


def test_there_may_not_be_too_many() -> None:
    short = field(passes=500, length_m=1.0, width_m=4.0)
    with pytest.raises(ValidationError, match="at most 1000 passes in all"):
        PathDriverConfig.model_validate({"path": [short, short, short]})


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (field(turn_radius_m=0.9), r"driver\.path: turn_radius_m = 0\.9: a planter_f8 turns on 1 m or more"),
        (field(widht_m=1.0), r"driver\.path\.0\.widht_m: unknown key; did you mean 'width_m'"),
        (field(passes=-1), r"driver\.path\.0\.passes: given -1"),
        ({"straight": 1.0}, r"driver\.path\.0\.straight: unknown key; did you mean 'straight_m'"),
        ({"spin_deg": 10.0}, r"spin_deg: a planter_f8 cannot turn on the spot"),
    ],
)
def test_a_scenario_says_which_key_is_wrong(entry: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        resolve(small_scenario(driver={"path": [entry]}), where="here")


def test_a_plan_can_be_read_from_the_configuration() -> None:
    stretches = list(ParallelPasses.model_validate(field(passes=2)).stretches())
    assert [stretch.headland for stretch in stretches] == [False, True, False]
