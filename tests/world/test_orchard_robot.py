"""The orchard robot is what its module says, and goes as its wheels turn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.world.conftest import MACHINES, WorldMaker, column, slope
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.geometry import wrap_angle_scalar
from twin.signals import Command, JointMotion, JointNeed, MagneticField, MagneticNeed
from twin.world.orchard_robot import CASTER_SHARE, DRIVEN, LARGE, SMALL, RobotSize
from twin.world.simulation import World
from twin.world.statics import static_loads
from twin.world.urdf import read_urdf

PER_S = 500
SIZES = {"orchard_robot": SMALL, "orchard_robot_large": LARGE}

both_sizes = pytest.mark.parametrize("kind", list(SIZES))


def drive(world: World, seconds: float, speed: float = 0.0, yaw_rate: float = 0.0) -> None:
    world.command(Command(speed_m_s=speed, yaw_rate_rad_s=yaw_rate))
    world.advance(world.tick + round(seconds * PER_S))


def wheel_rate(world: World, side: str, over_s: float = 0.2) -> float:
    """Mean rate of a driven wheel over some time from now on, rad/s."""
    name = f"joint.wheel_{side}_rad"
    before = column(world, name)
    world.advance(world.tick + round(over_s * PER_S))
    return (column(world, name) - before) / over_s


def test_the_small_robots_figures_are_the_papers() -> None:
    assert SMALL.wheel_radius_m == 0.033
    assert SMALL.track_m == 0.105
    assert (LARGE.wheel_radius_m, LARGE.track_m) == (0.15, 0.6)
    # Fast enough for the paper's 0.5 m/s.
    assert 0.7 * SMALL.free_rate_rad_s * SMALL.wheel_radius_m > 0.5


@both_sizes
def test_masses_loads_and_geometry_are_the_stated_ones(kind: str) -> None:
    size, config = SIZES[kind], MACHINES[kind](kind=kind)
    urdf = read_urdf(config.asset)
    assert urdf.mass_kg == pytest.approx(size.mass_kg, rel=1e-6)
    left, right, ball = static_loads(urdf, [wheel.joint for wheel in size.wheels]) / G
    assert ball == pytest.approx(CASTER_SHARE * size.mass_kg, rel=1e-4)
    for load in (left, right):
        assert load == pytest.approx(0.5 * (1.0 - CASTER_SHARE) * size.mass_kg, rel=1e-4)
    places = {name: urdf.zero_pose(f"hub_{name}")[0] for name in ("left", "right")}
    assert places["left"][1] - places["right"][1] == pytest.approx(size.track_m)
    assert config.rows_y_m == ()
    assert config.turns_on_the_spot
    assert {"imu", "magnetometer", "encoders", "lidar", "camera"} <= set(config.mounts)


@both_sizes
def test_it_stands_level_on_its_rolling_radius(make_world: WorldMaker, kind: str) -> None:
    world = make_world(kind=kind, soil="firm")
    assert column(world, "base_u_m") == pytest.approx(SIZES[kind].wheel_radius_m, abs=1e-5)
    assert abs(column(world, "pitch_rad")) < 1e-4
    assert not [name for name in world.truth_columns if name.startswith("row")]


@both_sizes
@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.3, 0.5), (0.4, -0.3), (0.2, 0.8)])
def test_turning_is_the_difference_of_the_wheels_over_the_track(
    make_world: WorldMaker, kind: str, speed: float, yaw_rate: float
) -> None:
    # Ground on which tyres hardly slip. At 0.4 m/s and 0.3 rad/s the ball's drag (0.134 N at 0.11 m: slip 2.7e-4 of
    # each wheel) still costs 0.7 % of the yaw rate, and the outer wheel, pressed in by 7 um more, 0.5 %.
    world, size = make_world(kind=kind, soil="asphalt", soil_keys={"longitudinal_stiffness": 100.0}), SIZES[kind]
    drive(world, 3.0, speed, yaw_rate)
    left, right = wheel_rate(world, "left"), wheel_rate(world, "right")
    rate = size.wheel_radius_m * (right - left) / size.track_m
    assert column(world, "yaw_rate_rad_s") == pytest.approx(rate, rel=0.02)
    assert column(world, "speed_m_s") == pytest.approx(0.5 * size.wheel_radius_m * (right + left), rel=0.01)
    # And the wheels do what was asked; the radius of the turn is v / w.
    assert column(world, "yaw_rate_rad_s") == pytest.approx(yaw_rate, rel=0.02)
    assert column(world, "speed_m_s") / column(world, "yaw_rate_rad_s") == pytest.approx(speed / yaw_rate, rel=0.02)


def test_fifty_degrees_asked_of_it_on_the_spot_are_a_little_less(make_world: WorldMaker) -> None:
    world = make_world(kind="orchard_robot", soil="firm")
    drive(world, 1.0)
    before, place = column(world, "heading_rad"), world.truth()[:2]
    drive(world, math.radians(50.0), yaw_rate=1.0)
    drive(world, 1.0)
    assert 48.5 < math.degrees(column(world, "heading_rad") - before) < 50.0
    assert np.linalg.norm(world.truth()[:2] - place) < 0.002


@both_sizes
def test_slip_is_the_drag_of_the_ball_over_the_wheels_stiffness(make_world: WorldMaker, kind: str) -> None:
    # Turning on the spot drags the ball sideways with grip x friction x load at its arm; the wheels' pull makes up for
    # it at theirs. Slip = pull / (stiffness x load). Firm soil: stiffness 4.643, friction 0.9164 (Brixius, Bn = 55).
    # The centre of mass lies ahead of the axle, so one wheel pulls more than the other: their mean is free of it.
    world, size = make_world(kind=kind, soil="firm"), SIZES[kind]
    drive(world, 4.0, yaw_rate=1.2)
    loads = [column(world, f"{wheel.joint}.normal_n") for wheel in size.wheels]
    drag = 0.05 * 0.9164 * loads[2] * size.caster_x_m
    expected = drag / size.track_m / (4.643 * loads[1])
    slip = 0.5 * (column(world, "wheel_right.slip") - column(world, "wheel_left.slip"))
    assert slip == pytest.approx(expected, rel=0.05)


def test_a_wheels_speed_follows_with_the_stated_lag(make_world: WorldMaker) -> None:
    # The set-point is first order with 0.1 s, the loop behind it some 1/60 s: at 0.117 s about 63 %. A small step keeps
    # the motor below its full voltage.
    world = make_world(kind="orchard_robot", soil="asphalt")
    world.command(Command(speed_m_s=0.1))
    speeds = []
    for _ in range(100):
        world.advance(world.tick + 5)
        speeds.append(column(world, "speed_m_s"))
    reached = 0.01 * (1 + next(index for index, speed in enumerate(speeds) if speed >= (1.0 - math.exp(-1.0)) * 0.1))
    assert reached == pytest.approx(SMALL.lag_s + 1.0 / 60.0, abs=0.03)
    assert speeds[-1] == pytest.approx(0.1, rel=0.01)
    assert max(speeds) < 0.11


@both_sizes
def test_what_is_slower_than_the_dead_band_is_not_driven(make_world: WorldMaker, kind: str) -> None:
    world, size = make_world(kind=kind, soil="firm"), SIZES[kind]
    slowest = size.dead_band_rad_s * size.wheel_radius_m
    place = world.truth()[:2]
    drive(world, 3.0, 0.99 * slowest)
    assert np.linalg.norm(world.truth()[:2] - place) < 1e-6
    assert column(world, "motor_current_a") == 0.0
    drive(world, 3.0, 1.5 * slowest)
    assert column(world, "speed_m_s") == pytest.approx(1.5 * slowest, rel=0.05)


def test_a_wheel_asked_for_more_than_its_motor_turns_keeps_the_curvature(make_world: WorldMaker) -> None:
    world = make_world(kind="orchard_robot", soil="asphalt", soil_keys={"longitudinal_stiffness": 100.0})
    drive(world, 4.0, speed=2.0, yaw_rate=4.0)
    assert column(world, "speed_m_s") < SMALL.free_rate_rad_s * SMALL.wheel_radius_m
    assert column(world, "yaw_rate_rad_s") / column(world, "speed_m_s") == pytest.approx(2.0, rel=0.03)


def test_the_current_is_the_torques_share_of_the_stall(make_world: WorldMaker) -> None:
    # Steady, each motor turns its gears (0.006 N m) and its share of the rolling resistance, 1/55 + 0.04 of the load
    # (the ball's as a pull on its rim, by way of the chassis).
    world = make_world(kind="orchard_robot", soil="firm")
    drive(world, 4.0, speed=0.3)
    rolling = (1.0 / 55.0 + 0.04) * SMALL.mass_kg * G * SMALL.wheel_radius_m
    torque = 0.5 * rolling + SMALL.gear_friction_n_m
    assert column(world, "motor_torque_left_n_m") == pytest.approx(torque, rel=0.03)
    expected = 2.0 * torque / SMALL.stall_torque_n_m * SMALL.stall_current_a
    assert column(world, "motor_current_a") == pytest.approx(expected, rel=0.03)
    need = MagneticNeed(mount=world.machine.mounts["magnetometer"])
    world.watch("compass", need)
    seen = world.capture("compass")
    assert isinstance(seen, MagneticField)
    assert seen.motor_current_a == column(world, "motor_current_a")


@both_sizes
def test_it_stands_still_on_a_slope_without_current(make_world: WorldMaker, kind: str) -> None:
    world = make_world(slope(8.0, 30.0), kind=kind, soil="firm")
    world.command(Command())
    world.advance(2 * PER_S)
    place = world.truth()[:3]
    world.advance(20 * PER_S)
    assert np.linalg.norm(world.truth()[:3] - place) < 0.2e-3
    assert column(world, "motor_current_a") == 0.0


@both_sizes
def test_two_worlds_are_the_same_to_the_last_bit(make_world: WorldMaker, kind: str) -> None:
    def journey() -> np.ndarray:
        world = make_world(kind=kind, soil="firm")
        for speed, rate in ((0.4, 0.3), (0.0, -1.0), (0.3, 0.0)):
            drive(world, 2.0, speed, rate)
        return world.truth()

    np.testing.assert_array_equal(journey(), journey())


def test_wheel_angles_are_counted_beyond_a_turn(make_world: WorldMaker) -> None:
    world = make_world(kind="orchard_robot", soil="asphalt")
    world.watch("encoders", JointNeed(mount=world.machine.mounts["encoders"], joints=DRIVEN[::-1]))
    before = world.capture("encoders")
    east = column(world, "position_e_m")
    drive(world, 5.0, speed=0.4)
    after = world.capture("encoders")
    assert isinstance(before, JointMotion)
    assert isinstance(after, JointMotion)
    turned = after.position - before.position
    assert turned.min() > 2.0 * math.pi * 5.0
    way = column(world, "position_e_m") - east
    np.testing.assert_allclose(turned * SMALL.wheel_radius_m, way, rtol=0.01)
    np.testing.assert_array_equal(after.position_enu_m[:2], [column(world, "base_e_m"), column(world, "base_n_m")])


def test_a_robot_of_other_figures_goes_by_them() -> None:
    odd = RobotSize(**{**{name: getattr(SMALL, name) for name in RobotSize.__slots__}, "track_m": 0.2, "mass_kg": 2.0})
    assert odd.drive.track_m == 0.2
    assert odd.chassis_mass_kg == pytest.approx(1.85)
    pressed = 0.4 * 2.0 * G / 10e3
    assert odd.wheels[0].radius_m == pytest.approx(0.033 + pressed)


def test_headings_wrap_in_a_long_spin(make_world: WorldMaker) -> None:
    world = make_world(kind="orchard_robot", soil="asphalt")
    drive(world, 8.0, yaw_rate=1.0)
    turned = (
        SMALL.wheel_radius_m
        / SMALL.track_m
        * (column(world, "joint.wheel_right_rad") - column(world, "joint.wheel_left_rad"))
    )
    assert turned > 2.0 * math.pi
    assert abs(wrap_angle_scalar(column(world, "heading_rad") - turned)) < 0.01 * turned
