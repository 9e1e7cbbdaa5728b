"""The transplanter is what its module says: figures, antennas, wheels in turns, speeds of paper 003."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.world.conftest import WorldMaker, column, record
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.signals import Command, JointNeed
from twin.world.simulation import World
from twin.world.statics import static_loads
from twin.world.transplanter import ANTENNA_HEIGHT_M, ANTENNAS_APART_M, REAR_DRIVE, TransplanterConfig
from twin.world.transplanter_carrier import FRONT, MASS_KG, REAR, REAR_RADIUS_M, TRACK_M, WHEELBASE_M, wheels
from twin.world.urdf import read_urdf

PER_S = 500


def on_road(make_world: WorldMaker, **changes: object) -> World:
    return make_world(**{"kind": "transplanter", "soil": "asphalt", **changes})


def test_the_drawing_is_the_machine() -> None:
    urdf = read_urdf(TransplanterConfig.asset)
    assert urdf.mass_kg == pytest.approx(MASS_KG)
    loads = static_loads(urdf, [wheel.joint for wheel in wheels(0.0)])
    assert loads.sum() == pytest.approx(MASS_KG * G)
    assert loads[:2].sum() == pytest.approx(0.4 * MASS_KG * G, rel=0.01)
    for side, y in (("left", 0.5 * TRACK_M), ("right", -0.5 * TRACK_M)):
        assert urdf.zero_pose(f"front_wheel_{side}_hub")[0][:2] == pytest.approx((WHEELBASE_M, y))
        assert urdf.zero_pose(f"rear_wheel_{side}_hub")[0] == pytest.approx((0.0, y, 0.0))


def test_it_stands_as_its_module_says(make_world: WorldMaker) -> None:
    world = on_road(make_world)
    assert column(world, "base_u_m") == pytest.approx(REAR_RADIUS_M, abs=1e-3)
    assert column(world, "position_u_m") == pytest.approx(0.0, abs=1e-3)
    assert abs(column(world, "pitch_rad")) < 1e-3
    assert TransplanterConfig(kind="transplanter").reference_x_m == 0.0


def test_the_antennas_are_on_the_frame_in_front(make_world: WorldMaker) -> None:
    world = on_road(make_world)
    mounts = world.machine.mounts
    assert set(mounts) == {"gps", "rtk", "gyro", "axle", "steering"}
    places = {}
    for name in ("gps", "rtk"):
        world.watch(name, JointNeed(mount=mounts[name], joints=("rear_wheel_left",)))
        places[name] = np.array(world.capture(name).position_enu_m)
        assert places[name][2] == pytest.approx(ANTENNA_HEIGHT_M, abs=5e-3)
        assert places[name][0] > WHEELBASE_M
    assert np.linalg.norm(places["gps"] - places["rtk"]) == pytest.approx(ANTENNAS_APART_M)


@pytest.mark.parametrize("soil", ["asphalt", "firm"])
@pytest.mark.parametrize("steering_deg", [10.0, -28.8])
def test_the_turning_circle_is_that_of_its_wheelbase(make_world: WorldMaker, steering_deg: float, soil: str) -> None:
    steering = math.radians(steering_deg)
    world = on_road(make_world, soil=soil)
    world.command(Command(speed_m_s=0.73, steering_rad=steering))
    world.advance(8 * PER_S)
    names = ("vehicle_speed_m_s", "yaw_rate_rad_s", "steering_rad", "vehicle_e_m", "vehicle_n_m")
    rows = record(world, 20 * PER_S, 10, names)
    speed, rate, angle = rows[:, :3].mean(axis=0)
    assert angle == pytest.approx(steering, abs=1e-4)
    assert speed / rate == pytest.approx(WHEELBASE_M / math.tan(steering), rel=0.03)
    # And the track itself is that circle: points by least squares.
    east, north = rows[:, 3], rows[:, 4]
    a = np.column_stack([east, north, np.ones(len(east))])
    (c1, c2, c3), *_ = np.linalg.lstsq(a, east**2 + north**2, rcond=None)
    assert math.sqrt(c3 + 0.25 * (c1**2 + c2**2)) == pytest.approx(abs(speed / rate), rel=0.01)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_wheels_on_the_inside_of_a_turn_are_slower(make_world: WorldMaker, side: float) -> None:
    """Each rear wheel rolls on its own radius; with an open differential both push alike and slip alike."""
    world = on_road(make_world)
    world.command(Command(speed_m_s=0.73, steering_rad=side * math.atan(WHEELBASE_M / 3.0)))
    world.advance(6 * PER_S)
    names = tuple(f"joint.{joint}_rad" for joint in REAR)
    rows = record(world, 5 * PER_S, 5, (*names, "vehicle_speed_m_s", "yaw_rate_rad_s"))
    left, right = np.diff(np.unwrap(rows[:, :2], axis=0), axis=0).mean(axis=0) / (5 / PER_S)
    speed, rate = rows[:, 2:].mean(axis=0)
    for spin, y in ((left, 0.5 * TRACK_M), (right, -0.5 * TRACK_M)):
        assert spin * REAR_RADIUS_M == pytest.approx(speed - rate * y, rel=0.01)
    assert (right - left) * side > 0.0


@pytest.mark.parametrize("speed_m_s", [0.25, 0.73, 1.1])
def test_the_speeds_of_the_paper_are_kept(make_world: WorldMaker, speed_m_s: float) -> None:
    """The governor holds the wheels' speed; slip is rolling resistance over slip stiffness, 0.013 / 22, or less."""
    world = on_road(make_world)
    world.command(Command(speed_m_s=speed_m_s))
    world.advance(5 * PER_S)
    speeds = record(world, 10 * PER_S, 5, ("vehicle_speed_m_s",))
    assert speeds.mean() == pytest.approx(speed_m_s, rel=0.005)
    assert np.abs(speeds - speed_m_s).max() < 0.02 * speed_m_s


def test_only_the_rear_wheels_pull(make_world: WorldMaker) -> None:
    assert REAR_DRIVE.front_wheels is None
    world = on_road(make_world, soil="tilled")
    world.command(Command(speed_m_s=0.73))
    world.advance(5 * PER_S)
    names = tuple(f"{joint}.pull_n" for joint in (*FRONT, *REAR))
    pulls = record(world, 2 * PER_S, 5, names).mean(axis=0)
    # The front wheels are pushed against their rolling resistance, (1/40 + 0.04) of 1.38 kN each.
    assert pulls[:2] == pytest.approx([-0.065 * 0.2 * MASS_KG * G] * 2, rel=0.1)
    assert pulls[2:].sum() == pytest.approx(-pulls[:2].sum(), rel=0.05)


def test_it_sinks_only_where_it_is_told_to(make_world: WorldMaker) -> None:
    assert {wheel.sunk_m for wheel in on_road(make_world).machine.wheels} == {0.0}
    assert {wheel.sunk_m for wheel in on_road(make_world, sunk_m=0.06).machine.wheels} == {0.06}
