"""The scraper is what its module says, and its blade leaves the ground as it should, for the machine to drive on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.world.conftest import WorldMaker, column, record
from twin.control import LevellingControlConfig, build_implement
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.signals import HEIGHT, Command, Knowledge
from twin.world import dynamics
from twin.world.scraper import BLADE_X_M, LIFT, WHEELS, ScraperConfig
from twin.world.simulation import World
from twin.world.soil import SoilConfig
from twin.world.statics import static_loads
from twin.world.terrain import FlatTerrain, RoughTerrain, Terrain, build_terrain
from twin.world.transplanter_carrier import DRIVE, MASS_KG, TRACK_M, WHEELBASE_M
from twin.world.urdf import read_urdf

FIELD = FlatTerrain(kind="flat", size_m=(30.0, 10.0))


def machine_on(terrain: Terrain, **machine: object) -> World:
    """A scraper at the western end of ground that may have been worked already."""
    config = ScraperConfig.model_validate({"kind": "scraper", "start": {"east_m": -10.0}, **machine})
    return World(terrain=terrain, soil=SoilConfig(preset="tilled").soil(), machine=config.model(1), seed=1)


def drive_level(world: World, seconds: float, *, speed_m_s: float = 1.0, level_m: float = 0.0) -> None:
    """Keep the edge on a level by the truth, 50 times a second."""
    for _ in range(round(50 * seconds)):
        error = level_m - column(world, HEIGHT) - 0.2 * column(world, "velocity_u_m_s")
        world.command(Command(speed_m_s=speed_m_s, lift_m_s=2.5 * error))
        world.advance(world.tick + 10)


def work_level(world: World, seconds: float) -> None:
    """Have the blade held by the controller that scenarios have, which follows the truth."""
    controller = build_implement(LevellingControlConfig(kind="levelling"))
    for _ in range(round(50 * seconds)):
        knowledge = Knowledge(t_ns=0, implement=world.implement(), load_share=world.load_share)
        world.command(controller.amend(Command(speed_m_s=1.0), knowledge))
        world.advance(world.tick + 10)


def test_the_drawing_is_the_machine() -> None:
    urdf = read_urdf(ScraperConfig.asset)
    assert urdf.mass_kg == pytest.approx(MASS_KG)
    for side, y in (("left", 0.5 * TRACK_M), ("right", -0.5 * TRACK_M)):
        front, _ = urdf.zero_pose(f"front_wheel_{side}_hub")
        rear, _ = urdf.zero_pose(f"rear_wheel_{side}_hub")
        assert front[:2] == pytest.approx((WHEELBASE_M, y))
        assert rear == pytest.approx((0.0, y, 0.0))
        # Both stand on the same ground, which is where the edge is with its lift at zero.
        assert front[2] - DRIVE.front_radius_m == pytest.approx(-DRIVE.rolling_radius_m, abs=1e-3)
    assert urdf.zero_pose("scraper")[0] == pytest.approx((BLADE_X_M, 0.0, -DRIVE.rolling_radius_m))
    loads = static_loads(urdf, [wheel.joint for wheel in WHEELS], ["lift"])
    assert loads.sum() == pytest.approx(MASS_KG * G)
    assert loads[:2].sum() == pytest.approx(0.4 * MASS_KG * G, rel=0.01)
    for wheel, load, radius in zip(
        WHEELS, loads, 2 * [DRIVE.front_radius_m] + 2 * [DRIVE.rolling_radius_m], strict=True
    ):
        assert wheel.radius_m - load / wheel.stiffness_n_m == pytest.approx(radius, abs=1e-3)


def test_it_stands_with_its_edge_on_the_ground_and_lifts_it(make_world: WorldMaker) -> None:
    world = make_world(FIELD, kind="scraper")
    assert column(world, HEIGHT) == pytest.approx(0.0, abs=2e-3)
    world.command(Command(brake=True, lift_m_s=0.2))
    world.advance(500)
    # 1 s less dead time and lag.
    assert column(world, "joint.lift_m") == pytest.approx(0.2 * (1.0 - LIFT.dead_time_s - LIFT.lag_s), rel=0.02)
    assert column(world, HEIGHT) == pytest.approx(column(world, "joint.lift_m"), abs=3e-3)
    world.command(Command(brake=True))
    world.advance(1000)
    resting = column(world, "joint.lift_m")
    world.advance(6000)
    assert column(world, "joint.lift_m") == pytest.approx(resting, abs=1e-5)
    world.command(Command(brake=True, lift_m_s=1.0))
    world.advance(7500)
    assert column(world, "joint.lift_m") == pytest.approx(LIFT.highest_m, abs=1e-3)


@pytest.mark.parametrize("steering", [0.3, -0.3])
def test_it_turns_about_the_centre_of_its_steering(make_world: WorldMaker, steering: float) -> None:
    world = make_world(FIELD, kind="scraper", soil="firm", start={"east_m": 0.0})
    world.command(Command(speed_m_s=0.5, steering_rad=steering, lift_m_s=0.2))
    world.advance(3000)
    rates = record(world, 500, 10, ("yaw_rate_rad_s", "vehicle_speed_m_s")).mean(axis=0)
    assert rates[0] == pytest.approx(rates[1] * math.tan(steering) / WHEELBASE_M, rel=0.1)


def test_both_axles_pull(make_world: WorldMaker) -> None:
    world = make_world(FIELD, kind="scraper", start={"east_m": -10.0})
    drive_level(world, 6.0, level_m=-0.02)
    names = tuple(f"{wheel.joint}.pull_n" for wheel in WHEELS)
    pulls = record(world, 500, 5, (*names, "blade_draught_n")).mean(axis=0)
    assert pulls[:2].sum() > 0.2 * pulls[4]
    # Nothing else resists on level ground: rolling resistance is a moment on the wheels.
    assert pulls[:4].sum() == pytest.approx(pulls[4], rel=0.15)
    assert pulls[4] > 500.0


def test_draught_is_of_cutting_and_of_the_load_and_costs_slip(make_world: WorldMaker) -> None:
    slips = []
    names = ("rear_wheel_left.slip", "blade_draught_n", "blade_load_m3", "soil_cut_m3", "vehicle_e_m")
    for resistance_pa in (5e3, 20e3):
        world = make_world(FIELD, kind="scraper", start={"east_m": -10.0}, cutting_resistance_kpa=1e-3 * resistance_pa)
        drive_level(world, 5.0, level_m=-0.03)
        rows = record(world, 1000, 5, names)
        slip, draught, load = rows[:, :3].mean(axis=0)
        cut, way = np.ptp(rows[:, 3:], axis=0)
        expected = 150.0 + resistance_pa * cut / way + 0.5 * 1700.0 * G * load
        # The draught remembers 0.2 m of the 1.5 m driven.
        assert draught == pytest.approx(expected, rel=0.1)
        slips.append(slip)
    assert slips[1] > slips[0] + 0.01


@pytest.mark.parametrize("soil", ["soft", "firm"])
def test_the_wheels_keep_their_speed_when_a_load_comes_and_goes(make_world: WorldMaker, soil: str) -> None:
    """2 kN / (705 kg x 40 1/s) = 0.071 m/s is what the governor gives way to."""
    world = make_world(FIELD, kind="scraper", soil=soil, start={"east_m": -12.0})
    row = world._parts.blade_tool
    joints = [joint.name for joint in world._body.urdf.joints]
    spins = [dynamics.JOINTS + len(joints) + joints.index(name) for name in DRIVE.rear_wheels]

    def rolled(seconds: float, draught_n: float) -> np.ndarray:
        """Speeds at which the rear wheels roll, on average, with the blade in the air."""
        speeds = []
        world.command(Command(speed_m_s=1.0, lift_m_s=0.2))
        for _ in range(round(100 * seconds)):
            for _ in range(5):
                world.advance(world.tick + 1)
                world._parts.tools[row, dynamics.TOOL_FORCE] = draught_n
            speeds.append(DRIVE.rolling_radius_m * world._state[spins].mean())
        return np.array(speeds)

    assert rolled(5.0, 0.0)[-50:] == pytest.approx(1.0, abs=0.01)
    for draught_n in (2000.0, 0.0):
        speeds = rolled(4.0, draught_n)
        assert 0.04 < np.abs(speeds - 1.0).max() < 0.10
        assert speeds[-50:] == pytest.approx(1.0, abs=0.01)


def test_dropping_its_load_does_not_make_it_bolt(make_world: WorldMaker) -> None:
    world = make_world(FIELD, kind="scraper", start={"east_m": -12.0})
    drive_level(world, 8.0, level_m=-0.02)
    assert column(world, "blade_draught_n") > 2000.0
    world.command(Command(speed_m_s=1.0, lift_m_s=0.22))
    speeds = record(world, 2000, 5, ("vehicle_speed_m_s", "blade_load_m3"))
    assert speeds[-1, 1] < 0.2 * speeds[0, 1]
    assert speeds[:, 0].max() < 1.1


def test_the_next_pass_drives_on_the_ground_that_the_blade_has_left() -> None:
    terrain = build_terrain(FIELD, seed=1, extent=(0.0, 0.0, 1.0, 1.0))
    before = float(terrain.heights.sum()) * terrain.cell_m**2
    first = machine_on(terrain)
    height = column(first, "base_u_m")
    drive_level(first, 16.0, level_m=-0.04)
    total = float(terrain.heights.sum()) * terrain.cell_m**2 + column(first, "blade_load_m3")
    assert total == pytest.approx(before, abs=1e-9 * column(first, "soil_cut_m3"))
    first.close()
    middle = terrain.heights[40:61, 120:160]
    assert middle.mean() == pytest.approx(-0.04, abs=5e-3)
    second = machine_on(terrain)
    drive_level(second, 8.0, level_m=0.3)
    # With wheels in the swath, the root is lower by what was cut.
    assert column(second, "vehicle_e_m") + WHEELBASE_M < 5.0
    assert column(second, "base_u_m") - height == pytest.approx(-0.04, abs=8e-3)
    second.close()


def test_passes_in_one_track_flatten_a_paddy_field() -> None:
    """The loop from the blade's mark over the wheels to the blade damps on this ground.

    Not on any: there are fields on which a machine that drives five times in the same ruts makes them rougher.
    """
    rough = RoughTerrain(kind="rough", psd_m3=645e-6, psd_slope=1.24, size_m=(30.0, 10.0))
    terrain = build_terrain(rough, seed=3, extent=(0.0, 0.0, 1.0, 1.0))
    track = terrain.heights[45:56, 80:200]
    deviations = [float(np.std(track))]
    for _ in range(3):
        world = machine_on(terrain)
        work_level(world, 19.0)
        world.close()
        deviations.append(float(np.std(track)))
    assert deviations[1] < 0.8 * deviations[0]
    assert deviations[3] < 1.05 * deviations[1]
