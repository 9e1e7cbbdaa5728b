"""The car of the prototype is what its module says, and moves on its springs as mechanics demands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.world.conftest import WorldMaker, column
from twin.control import build_driver
from twin.control.path_following import PathDriverConfig, planned_path
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.paths import SCENARIOS
from twin.scenario import load
from twin.signals import Command, Knowledge
from twin.world.prototype_car import (
    ARM_M,
    AXLE_HEIGHT_M,
    ROWS_Y_M,
    SPRINGS,
    TRACK_M,
    WHEEL_RATE_N_M,
    WHEELBASE_M,
    WHEELS,
    PrototypeCarConfig,
)
from twin.world.soil import SoilConfig
from twin.world.statics import spring_preloads, static_loads
from twin.world.urdf import read_urdf

PER_S = 500
TYRE_N_M = 190e3
BODY_KG, BODY_HEIGHT_M = 1340.0, 0.58
"""The sprung mass and the height of its centre above ground."""
HINGE_HEIGHT_M = 0.12
HEIGHT_M = 0.55
"""Of the whole car's centre of mass."""
_JOINTS = [wheel.joint for wheel in WHEELS]
_SPRUNG = [spring.joint for spring in SPRINGS]


def test_masses_and_axle_loads_are_the_stated_ones() -> None:
    urdf = read_urdf(PrototypeCarConfig.asset)
    assert urdf.mass_kg == pytest.approx(1500.0)
    loads = dict(zip(_JOINTS, static_loads(urdf, _JOINTS, _SPRUNG) / G, strict=True))
    for side in ("left", "right"):
        assert loads[f"wheel_front_{side}"] == pytest.approx(0.52 * 1500.0 / 2.0, rel=1e-4)
        assert loads[f"wheel_rear_{side}"] == pytest.approx(0.48 * 1500.0 / 2.0, rel=1e-4)
    centre = sum(
        link.mass_kg * (urdf.zero_pose(link.name)[0][2] + link.com_m[2] + AXLE_HEIGHT_M) for link in urdf.links
    )
    assert centre / 1500.0 == pytest.approx(HEIGHT_M, abs=0.005)


def test_springs_carry_what_stands_on_the_wheels_less_the_wheels_themselves() -> None:
    # Moments about a hinge: (load - weight of wheel, carrier and knuckle) x 1.5 m.
    urdf = read_urdf(PrototypeCarConfig.asset)
    loads = static_loads(urdf, _JOINTS, _SPRUNG)
    preloads = dict(zip(_SPRUNG, spring_preloads(urdf, _JOINTS, _SPRUNG, loads), strict=True))
    front = (0.52 * 1500.0 / 2.0 - 45.0) * G * ARM_M
    rear = (0.48 * 1500.0 / 2.0 - 35.0) * G * ARM_M
    for side in ("left", "right"):
        # Turning about +y lowers what lies ahead: the front wheels hang before their hinges, the rear ones behind.
        assert preloads[f"suspension_front_{side}"] == pytest.approx(front, rel=1e-4)
        assert preloads[f"suspension_rear_{side}"] == pytest.approx(-rear, rel=1e-4)


def test_rows_and_mounts_are_those_of_the_bar() -> None:
    config = PrototypeCarConfig(kind="prototype_car")
    assert config.rows_y_m == ROWS_Y_M == (1.2, 0.4, -0.4, -1.2)
    for row, y in enumerate(config.rows_y_m, start=1):
        assert config.resolved_mounts[f"row_{row}"].xyz_m == (0.0, y, config.reference.xyz_m[2])
    # The RTK antenna stands at the fourth unit (paper 000, section 4.2.4).
    assert config.resolved_mounts["rtk_antenna"].xyz_m[:2] == config.resolved_mounts["row_4"].xyz_m[:2]
    assert {"radar", "accosat", "antenna", "antenna_reference"} <= set(config.mounts)
    # Both antennas of paper 004, 0.5 m apart at one height.
    apart = np.subtract(*(config.resolved_mounts[name].xyz_m for name in ("antenna_reference", "antenna")))
    assert apart == pytest.approx((0.0, 0.5, 0.0))
    # The bar stands over the rear axle, so that it starts where the car does.
    assert config.reference_start == pytest.approx((0.0, 0.0, 0.0))
    assert np.array(config.footprint_m) == pytest.approx(np.array([[0.0, -1.2], [WHEELBASE_M, 1.2]]))


def test_the_car_settles_level_at_its_axle_height(make_world: WorldMaker) -> None:
    world = make_world(kind="prototype_car", soil="asphalt")
    assert column(world, "base_u_m") == pytest.approx(AXLE_HEIGHT_M, abs=1e-3)
    assert abs(column(world, "pitch_rad")) < 1e-3
    assert abs(column(world, "roll_rad")) < 1e-6
    for spring in SPRINGS:
        assert abs(column(world, f"joint.{spring.joint}_rad")) < 1e-3


def test_it_drives_straight(make_world: WorldMaker) -> None:
    world = make_world(kind="prototype_car", soil="asphalt")
    world.command(Command(speed_m_s=4.0))
    world.advance(30 * PER_S)
    # 120 m less the way lost in speeding up; nothing steers.
    assert column(world, "position_e_m") > 110.0
    assert abs(column(world, "position_n_m")) < 1e-3
    assert abs(column(world, "heading_rad")) < 1e-6


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_body_leans_out_of_a_turn_as_its_springs_allow(make_world: WorldMaker, side: float) -> None:
    # Moments about the ground below the middle, where wheels that only move up and down put the roll axis:
    # m_s h_s (a + g phi) = phi K, K = 4 k (track / 2)^2 with the wheel's spring and its tyre in series.
    world = make_world(kind="prototype_car", soil="asphalt")
    world.command(Command(speed_m_s=4.0, steering_rad=side * 0.286))
    world.advance(20 * PER_S)
    speed, rate = column(world, "speed_m_s"), column(world, "yaw_rate_rad_s")
    rate_n_m = 1.0 / (1.0 / WHEEL_RATE_N_M + 1.0 / TYRE_N_M)
    stiffness = 4.0 * rate_n_m * (TRACK_M / 2.0) ** 2 - BODY_KG * G * BODY_HEIGHT_M
    expected = BODY_KG * BODY_HEIGHT_M * speed * rate / stiffness
    assert abs(expected) > math.radians(1.0)
    assert column(world, "roll_rad") == pytest.approx(expected, rel=0.05)


def test_speeding_up_pitches_the_body_as_springs_and_hinges_allow(make_world: WorldMaker) -> None:
    # No rolling resistance; e is the reaction of all wheels' spin, I a / r. The axles exchange W = (m a h + e) / L,
    # which the tyres feel. Each spring is spared the moment about its hinge of the push at the ground, 0.12 m below
    # it, of the inertia of what hangs on it, 0.177 m above it, and of the wheels' spin, over the arm of 1.5 m: at the
    # rear that is two fifths of W, in front little. The nose goes up: a negative pitch.
    world = make_world(kind="prototype_car", soil="asphalt", soil_keys={"rolling_resistance": 0.0})
    level = column(world, "pitch_rad")
    rows = []
    for step in range(250):
        world.command(Command(speed_m_s=step / 50.0))
        world.advance(world.tick + PER_S // 50)
        rows.append((column(world, "speed_m_s"), column(world, "pitch_rad")))
    speed, pitch = np.array(rows)[125:].T
    a = (speed[-1] - speed[0]) / (len(speed) - 1) * 50.0
    assert a == pytest.approx(1.0, rel=0.05)
    spin_front, spin_rear = (2.0 * inertia * a / AXLE_HEIGHT_M for inertia in (1.2, 5.2))
    shift = (1500.0 * a * HEIGHT_M + spin_front + spin_rear) / WHEELBASE_M
    push_front = -spin_front / AXLE_HEIGHT_M
    push_rear = 1500.0 * a - push_front
    above = AXLE_HEIGHT_M - HINGE_HEIGHT_M
    rear = shift - (push_rear * HINGE_HEIGHT_M + 70.0 * a * above + spin_rear) / ARM_M
    front = shift - (push_front * HINGE_HEIGHT_M + 90.0 * a * above + spin_front) / ARM_M
    expected = ((front + rear) / WHEEL_RATE_N_M + 2.0 * shift / TYRE_N_M) / 2.0 / WHEELBASE_M
    assert np.mean(pitch) - level == pytest.approx(-expected, rel=0.05)


def test_braking_and_stopping_leave_the_car_at_rest(make_world: WorldMaker) -> None:
    world = make_world(kind="prototype_car", soil="asphalt")
    world.command(Command(speed_m_s=4.0))
    world.advance(5 * PER_S)
    world.command(Command(brake=True))
    world.advance(world.tick + 5 * PER_S)
    place = world.truth()[:3]
    world.advance(world.tick + 10 * PER_S)
    assert np.linalg.norm(world.truth()[:3] - place) < 0.1e-3


def test_asphalt_is_firmer_and_rolls_more_easily_than_any_soil() -> None:
    asphalt, firm = SoilConfig(preset="asphalt").soil(), SoilConfig(preset="firm").soil()
    assert asphalt.friction > firm.friction
    assert asphalt.longitudinal_stiffness > firm.longitudinal_stiffness
    assert asphalt.rolling_resistance == 0.013 < firm.rolling_resistance
    assert SoilConfig(preset="asphalt", friction=0.5).soil().friction == 0.5


def test_the_base_scenarios_route_is_the_papers() -> None:
    # Three turns to the left and one to the right; a stop about 95 s after driving off (the paper's error plots), with
    # 1 / a of the speed more for speeding up and as much for braking, at 0.9 of the driver's acceleration.
    scenario = load(SCENARIOS / "planter" / "_prototype.toml").scenario
    driver = scenario.driver
    turns = [segment.turn_deg for segment in driver.path if segment.turn_deg is not None]
    assert sorted(turns) == [-90.0, 90.0, 90.0, 90.0]
    length = planned_path(driver, scenario.machine.vehicle_start).length_m
    v, a = driver.speed_m_s, driver.acceleration_m_s2
    assert length / v + 0.5 * v / a + 0.5 * v / (0.9 * a) == pytest.approx(95.0, abs=1.0)
    assert scenario.machine.kind == "prototype_car"
    assert {"imu_1", "imu_2", "imu_3", "imu_4", "radar", "accosat", "gps", "rtk"} == set(scenario.sensors)


@pytest.mark.parametrize(
    ("speed_m_s", "radius_m"), [(20.0 / 3.6, 25.0), (40.0 / 3.6, 25.0), (40.0 / 3.6, 40.0), (15.0, 40.0)]
)
def test_a_driver_takes_it_round_the_bends_of_a_driven_pass(
    make_world: WorldMaker, speed_m_s: float, radius_m: float
) -> None:
    """Paper 004 drives at 20 to 40 km/h.

    At a lateral acceleration a the rear tyres slip by beta = a / (g c), c = 21.9 per load and radian, so the nose
    points into the bend by beta, which the feedback (w^2 e + 2 w beta = 0) takes for an error: the car runs 2 beta / w
    outside.
    """
    bend = {"turn_deg": 180.0, "radius_m": radius_m}
    config = PathDriverConfig.model_validate(
        {"path": [{"straight_m": 100.0}, bend, {"straight_m": 100.0}], "speed_m_s": speed_m_s, "acceleration_m_s2": 2.0}
    )
    driver = build_driver(config, start_e_n_heading=(0.0, 0.0, 0.0), wheelbase_m=WHEELBASE_M, seed=1)
    world = make_world(kind="prototype_car", soil="asphalt")
    station, log = 0.0, []
    while driver.segment < 3 and world.tick < 90 * PER_S:
        vehicle = world.vehicle()
        world.command(driver.command(Knowledge(t_ns=0, vehicle=vehicle), 0.02))
        station, offset = driver.path.project(vehicle.east_m, vehicle.north_m, near_m=station)
        log.append((driver.segment, offset, vehicle.speed_m_s))
        world.advance(world.tick + 10)
    assert driver.segment == 3
    bandwidth = min(0.25, 1.0 / (0.5 * speed_m_s))
    outside = 2.0 * speed_m_s**2 / radius_m / (G * 21.9) / bandwidth
    in_bend = np.array([offset for leg, offset, _ in log if leg == 1])
    assert -in_bend[-25:].mean() == pytest.approx(outside, rel=0.1)
    assert np.abs(in_bend).max() < 1.5 * outside + 0.05
    assert max(speed for *_, speed in log) == pytest.approx(speed_m_s, rel=0.03)
    assert abs(log[-1][1]) < 0.05
