"""The car of the prototype is what its module says, and moves on its springs as mechanics demands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.world.conftest import WorldMaker, column
from twin.control.path_following import planned_path
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.paths import SCENARIOS
from twin.scenario import load
from twin.signals import Command
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
    assert {"radar", "accosat", "antenna"} <= set(config.mounts)
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
