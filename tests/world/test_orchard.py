"""Trees stand where they are said to, and beams of light find them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.world.conftest import WorldMaker, slope
from twin.errors import BadInputError
from twin.geometry import rotation_from_rpy
from twin.signals import Command, FloatArray, Mount, RayNeed, RayScan
from twin.world.beams import cast, swept_beams
from twin.world.light import LightConfig
from twin.world.orchard import EAST, NORTH, RADIUS, LaneConfig, OrchardConfig, planted
from twin.world.simulation import World, build_world
from twin.world.soil import SoilConfig
from twin.world.terrain import FlatTerrain, RoughTerrain, Terrain, build_terrain

FLAT = build_terrain(FlatTerrain(kind="flat", cell_m=0.5), seed=1, extent=(-10.0, -10.0, 10.0, 10.0))
LEVEL = FlatTerrain(kind="flat", cell_m=0.5)


def lane(**keys: Any) -> dict[str, Any]:
    return {"length_m": 12.0, "width_m": 3.0, "spacing_m": 2.0, **keys}


def trunks(seed: int = 1, **keys: Any) -> FloatArray:
    return OrchardConfig.model_validate(keys).trunks(seed)


def beam(origin: Any, direction: Any, standing: FloatArray, terrain: Terrain = FLAT, reach_m: float = 5.0) -> float:
    out = np.empty(1)
    unit = np.array(direction) / np.linalg.norm(direction)
    grid = terrain.west_m, terrain.south_m, terrain.cell_m
    highest = float(terrain.heights.max())
    start = np.array([origin], dtype=np.float64)
    cast(start, unit[np.newaxis, :], reach_m, standing, terrain.heights, *grid, highest, out)
    return float(out[0])


# --- trees -----------------------------------------------------------------------------------------------------------


def test_a_straight_lane_stands_on_its_grid() -> None:
    rows = trunks(lanes=[lane(east_m=1.0, north_m=2.0, heading_deg=90.0)])
    # Heading north: left row to the west. Seven trees a side, from the beginning to the end.
    assert len(rows) == 14
    np.testing.assert_allclose(rows[:7, EAST], 1.0 - 1.5, atol=1e-12)
    np.testing.assert_allclose(rows[7:, EAST], 1.0 + 1.5, atol=1e-12)
    np.testing.assert_allclose(rows[:7, NORTH], 2.0 + 2.0 * np.arange(7), atol=1e-12)


def test_crookedness_and_missing_trees_have_their_statistics() -> None:
    crooked = lane(length_m=4000.0, crooked_m=0.2, radius_m=0.1, radius_spread_m=0.02, missing_probability=0.1)
    found = trunks(lanes=[crooked])
    # 4002 trees: the share to 0.5 %, sigmas to 1.1 %; four of them.
    assert len(found) / 4002 == pytest.approx(0.9, abs=0.019)
    left = found[found[:, NORTH] > 0.0]
    assert np.std(left[:, NORTH]) == pytest.approx(0.2, rel=0.07)
    assert np.std(found[:, RADIUS]) == pytest.approx(0.02, rel=0.05)


def test_lanes_follow_from_the_seed_and_a_missing_tree_moves_no_other() -> None:
    keys = {"crooked_m": 0.2}
    one = trunks(lanes=[lane(**keys)])
    np.testing.assert_array_equal(one, trunks(lanes=[lane(**keys)]))
    assert not np.array_equal(one, trunks(2, lanes=[lane(**keys)]))
    thinned = trunks(lanes=[lane(missing_probability=0.4, **keys)])
    assert 0 < len(thinned) < len(one)
    assert {tuple(row) for row in thinned} <= {tuple(row) for row in one}
    np.testing.assert_array_equal(trunks(lanes=[lane(**keys), lane(east_m=50.0)])[: len(one)], one)


def test_a_tree_off_the_terrain_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"orchard: a tree at .*off the terrain"):
        planted(trunks(trees=[{"east_m": 30.0, "north_m": 0.0}]), FLAT)


def test_the_ground_is_made_large_enough_for_all_trees() -> None:
    orchard = OrchardConfig(lanes=(LaneConfig(length_m=40.0, width_m=3.0, spacing_m=4.0),))
    with _world(orchard) as world:
        assert len(world.trunks) == 22
        assert world.terrain.extent[2] > 40.0


# --- beams -----------------------------------------------------------------------------------------------------------


def test_a_beam_ends_on_the_bark() -> None:
    standing = planted(trunks(trees=[{"east_m": 2.0, "north_m": 0.0, "radius_m": 0.1, "height_m": 1.0}]), FLAT)
    assert beam((0, 0, 0.5), (1, 0, 0), standing) == pytest.approx(1.9)
    # 0.06 beside the middle: chord sqrt(0.1^2 - 0.06^2) = 0.08.
    assert beam((0, 0.06, 0.5), (1, 0, 0), standing) == pytest.approx(1.92)
    assert beam((0, 0.11, 0.5), (1, 0, 0), standing) == math.inf
    assert beam((0, 0, 0.5), (-1, 0, 0), standing) == math.inf
    assert beam((0, 0, 0.5), (1, 0, 0), standing, reach_m=1.85) == math.inf
    # Rising by one in two: 0.95 m higher at the bark, over the top of 1.0 m.
    assert beam((0, 0, 0.5), (2, 0, 1), standing) == math.inf
    assert beam((0, 0, 0.5), (8, 0, 1), standing) == pytest.approx(1.9 * math.hypot(1.0, 1.0 / 8.0))


def test_of_two_trees_the_nearer_is_seen() -> None:
    pair = trunks(trees=[{"east_m": east, "north_m": 0.0, "radius_m": 0.1} for east in (3.0, 1.0)])
    assert beam((0, 0, 0.5), (1, 0, 0), planted(pair, FLAT)) == pytest.approx(0.9)


def test_a_beam_that_dips_meets_the_ground() -> None:
    nothing = trunks()
    # From 0.2 m at one in ten: 2 m ahead.
    assert beam((0, 0, 0.2), (10, 0, -1), nothing) == pytest.approx(2.0 * math.hypot(1.0, 0.1), rel=1e-9)
    hill = build_terrain(slope(10.0).model_copy(update={"size_m": None}), seed=1, extent=(-10.0, -10.0, 10.0, 10.0))
    # Level, on ground that rises by one in ten: the same.
    assert beam((0, 0, 0.2), (1, 0, 0), nothing, hill) == pytest.approx(2.0, rel=1e-9)
    assert beam((0, 0, 0.2), (-1, 0, 0), nothing, hill) == math.inf
    tree = planted(trunks(trees=[{"east_m": 1.0, "north_m": 0.0, "radius_m": 0.1}]), FLAT)
    assert beam((0, 0, 0.2), (10, 0, -1), tree) == pytest.approx(0.9 * math.hypot(1.0, 0.1))


def test_beams_of_a_turning_head_are_sent_on_the_way() -> None:
    # Half a metre ahead and a quarter turn to the left between the poses; four beams over the last half of that time.
    before = np.zeros(3), np.eye(3)
    now = np.array([0.5, 0.0, 0.0]), rotation_from_rpy(0.0, 0.0, math.pi / 2.0)
    origins, directions = swept_beams(before, now, np.zeros(4), 0.5)
    when = np.array([0.625, 0.75, 0.875, 1.0])
    np.testing.assert_allclose(origins[:, 0], 0.5 * when)
    np.testing.assert_allclose(np.arctan2(directions[:, 1], directions[:, 0]), when * math.pi / 2.0)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    origins, directions = swept_beams(before, now, np.array([0.0, 1.0]), 0.0)
    np.testing.assert_allclose(origins, [[0.5, 0.0, 0.0]] * 2)
    np.testing.assert_allclose(np.arctan2(directions[:, 1], directions[:, 0]), math.pi / 2.0 + np.array([0.0, 1.0]))


# --- the world -------------------------------------------------------------------------------------------------------

TEST_FIELD = OrchardConfig.model_validate(
    {"trees": [{"east_m": e, "north_m": n, "radius_m": 0.03} for e in (0.0, 1.0) for n in (-0.4, 0.4)]}
)
"""The small test field of paper 001, chapter 5: four trees, some 40 cm to the side."""
MOUNT = Mount(body="chassis", xyz_m=(0.0, 0.0, 0.1))
SCAN = RayNeed(
    mount=MOUNT,
    bearings_rad=tuple(np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False).tolist()),
    reach_m=3.5,
    sweep_s=0.2,
)


def _world(orchard: OrchardConfig, light: LightConfig | None = None, ground: Any = LEVEL) -> World:
    from twin.world.orchard_robot import OrchardRobotConfig  # noqa: PLC0415

    robot = OrchardRobotConfig(kind="orchard_robot")
    return build_world(ground, SoilConfig(preset="firm"), robot, seed=1, orchard=orchard, light=light)


def test_a_standing_robot_sees_the_papers_four_trees() -> None:
    light = LightConfig.model_validate({"lux": 800.0, "changes": [{"from_s": 0.1, "to_s": 0.3, "lux": 9e4}]})
    with _world(TEST_FIELD, light) as world:
        world.watch("lidar", SCAN)
        world.advance(100)
        scan = world.capture("lidar")
    assert isinstance(scan, RayScan)
    assert scan.illuminance_lux == 9e4
    seen = scan.distance_m
    # Beside it at 90 and 270 degrees, and ahead at atan(0.4 / 1.0) = 21.8 degrees, 1.077 m to the middle.
    for bearing, distance in ((90, 0.37), (270, 0.37)):
        assert seen[bearing] == pytest.approx(distance, abs=1e-3)
    assert seen[22] == pytest.approx(1.077 - 0.03, abs=2e-3)
    assert seen[338] == pytest.approx(1.077 - 0.03, abs=2e-3)
    # 2 asin(0.03 / 0.4) = 8.6 degrees wide beside it, 2 asin(0.03 / 1.077) = 3.2 degrees ahead: 9 or 8, 3 or 4 beams.
    assert 2 * (8 + 3) <= np.isfinite(seen).sum() <= 2 * (9 + 4)
    assert np.isinf(seen[[0, 45, 180]]).all()


def test_a_scan_of_a_moving_robot_is_not_a_picture_of_one_instant() -> None:
    with _world(TEST_FIELD) as world:
        world.watch("lidar", SCAN)
        world.command(Command(yaw_rate_rad_s=1.0))
        world.advance(1000)
        world.capture("lidar")
        world.advance(1100)
        heading = world.vehicle().heading_rad
        scan = world.capture("lidar")
    assert isinstance(scan, RayScan)
    # The beam of bearing b is sent (1 - b / 360 degrees) x 0.2 s before the end, at 0.2 rad less all in all.
    at = np.flatnonzero(scan.distance_m < 0.45)
    bearing = np.radians(at) + heading - 0.2 * (1.0 - at / 360.0)
    sides = np.degrees(np.arcsin(np.abs(np.sin(bearing))))
    assert np.all(sides > 90.0 - 4.3 - 1.5)


def test_rough_ground_gives_a_low_beam_something_to_meet() -> None:
    rough = RoughTerrain(kind="rough", iso8608_class="E", cell_m=0.05)
    with _world(OrchardConfig(), ground=rough) as world:
        world.watch("lidar", SCAN)
        seen = world.capture("lidar")
        assert isinstance(seen, RayScan)
        # Each hit lies on the ground.
        hit = np.flatnonzero(np.isfinite(seen.distance_m))
        assert len(hit) > 0
        body = world.truth()
        rotation = rotation_from_rpy(
            *(body[world.truth_columns.index(name)] for name in ("roll_rad", "pitch_rad", "heading_rad"))
        )
        for k in hit[::10]:
            angle = math.radians(k)
            point = seen.position_enu_m + seen.distance_m[k] * rotation @ [math.cos(angle), math.sin(angle), 0.0]
            assert point[2] == pytest.approx(world.terrain.height(point[0], point[1]), abs=1e-3)


def test_brightness_of_two_changes_at_once_is_the_laters() -> None:
    light = LightConfig.model_validate(
        {"lux": 1.0, "changes": [{"from_s": 1.0, "to_s": 5.0, "lux": 2.0}, {"from_s": 3.0, "to_s": 4.0, "lux": 3.0}]}
    )
    assert [light.at(t) for t in (0.0, 1.0, 3.0, 4.0, 5.0)] == [1.0, 2.0, 3.0, 2.0, 1.0]


def test_a_world_without_trees_is_as_before(make_world: WorldMaker) -> None:
    assert make_world(kind="orchard_robot").trunks.shape == (0, 5)
