"""What the world promises to those who use it."""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys

import numpy as np
import pytest

from tests.world.conftest import MACHINES, WorldMaker, column, every_machine, record, slope
from twin.errors import BadInputError, WorldEndedError
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.signals import Command, MotionNeed, Mount
from twin.world.planter_f8 import PlanterF8Config
from twin.world.simulation import build_world
from twin.world.soil import SoilConfig
from twin.world.terrain import FlatTerrain, RoughTerrain

PER_S = 500

_RUN = """
import hashlib, sys
from twin.signals import Command, MotionNeed
from pydantic import TypeAdapter
from twin.world import MachineConfig
from twin.world.simulation import build_world
from twin.world.soil import SoilConfig
from twin.world.terrain import RoughTerrain
machine = TypeAdapter(MachineConfig).validate_python({"kind": sys.argv[1]})
digest = hashlib.sha256()
ground = RoughTerrain(kind="rough", iso8608_class="D", size_m=(60.0, 60.0))
with build_world(ground, SoilConfig(), machine, seed=3) as world:
    world.watch("imu", MotionNeed(mount=world.machine.mounts["row_1"]))
    for steering in (0.0, 0.3, -0.2):
        world.command(Command(speed_m_s=2.0, steering_rad=steering))
        world.advance(world.tick + 500)
        digest.update(world.truth().tobytes())
        digest.update(world.capture("imu").mean_specific_force_m_s2.tobytes())
print(digest.hexdigest())
"""


@every_machine
def test_two_processes_agree_to_the_last_bit(kind: str) -> None:
    command = [sys.executable, "-c", _RUN, kind]
    digests = [subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()[-1] for _ in range(2)]
    assert len(digests[0]) == len(hashlib.sha256().hexdigest())
    assert digests[0] == digests[1]


def test_configuration_does_not_import_the_physics() -> None:
    code = "import sys, twin.world; sys.exit(bool({'pybullet', 'numba', 'scipy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@every_machine
def test_at_rest_a_level_mount_feels_gravity_and_nothing_turns(make_world: WorldMaker, kind: str) -> None:
    world = make_world(slope(10.0, 90.0), kind=kind)
    mount = world.machine.mounts["row_1"]
    world.watch("imu", MotionNeed(mount=mount))
    first = world.capture("imu")
    assert first.interval_s == 0.0
    world.advance(PER_S)
    still = world.capture("imu")
    for motion in (first, still):
        # Nothing accelerates: what is felt is g along the world's up axis, seen from the mount as it truly stands.
        assert motion.mean_specific_force_m_s2 == pytest.approx(motion.rotation.T @ [0.0, 0.0, G], abs=1e-3)
        # Across the slope (uphill to the left): the left axis feels g sin, up to the give of tyres and springs.
        assert motion.mean_specific_force_m_s2[1] == pytest.approx(G * math.sin(math.atan(0.1)), rel=0.15)
        assert np.abs(motion.mean_rate_rad_s).max() < 1e-4
    assert still.interval_s == 1.0


@every_machine
def test_capture_on_a_steady_circle(make_world: WorldMaker, kind: str) -> None:
    # Body axes, level ground, steady turn with yaw rate w and forward and left speed (u, v) of the mount:
    # specific force = (-w v, w u, g), rate = (0, 0, w).
    world = make_world(kind=kind, soil="firm")
    world.command(Command(speed_m_s=2.0, steering_rad=0.25))
    world.advance(60 * PER_S)
    ends = ("row_1", f"row_{len(world.machine.rows_y_m)}")
    for name in ends:
        world.watch(name, MotionNeed(mount=world.machine.mounts[name]))
    world.advance(world.tick + 50)
    rate = column(world, "yaw_rate_rad_s")
    assert rate > 0.1
    for name in ends:
        world.capture(name)
    world.advance(world.tick + 50)
    for name in ends:
        motion = world.capture(name)
        u, v, _ = motion.rotation.T @ motion.velocity_enu_m_s
        assert motion.interval_s == pytest.approx(0.1)
        assert motion.mean_rate_rad_s == pytest.approx([0.0, 0.0, rate], abs=2e-3)
        # pitch and roll of a few mrad put up to 5 mrad x g on the level axes; take them out with the rotation
        level = motion.mean_specific_force_m_s2 - motion.rotation.T @ [0.0, 0.0, G]
        assert level == pytest.approx([-rate * v, rate * u, 0.0], abs=0.01)


def test_captures_are_exact_means(make_world: WorldMaker) -> None:
    # Whatever the motion: displacement is the integral of velocity, so mean velocity times time is the change of
    # position; the turns add up to the change of attitude; rotated specific forces plus gravity add up to the change
    # of velocity. Rough ground, so that something happens.
    world = make_world(RoughTerrain(kind="rough", iso8608_class="D", size_m=(80.0, 80.0)))
    mount = Mount(body="planter", xyz_m=(-3.5, 2.6, 0.3), rpy_rad=(0.1, -0.2, 2.0))
    world.watch("one", MotionNeed(mount=mount))
    world.watch("ten", MotionNeed(mount=mount))
    world.command(Command(speed_m_s=2.5, steering_rad=0.15))
    world.advance(3 * PER_S)
    begin = world.capture("ten")
    world.capture("one")
    rotation, velocity = begin.rotation, begin.velocity_enu_m_s
    sums = np.zeros(6)
    for _ in range(PER_S):
        world.advance(world.tick + 1)
        step = world.capture("one")
        sums += np.concatenate([step.mean_specific_force_m_s2, step.mean_rate_rad_s])
        rotation = rotation @ _rotation_vector(step.mean_rate_rad_s / PER_S)
        middle = 0.5 * (step.rotation + rotation)
        velocity = velocity + (middle @ step.mean_specific_force_m_s2 - [0.0, 0.0, G]) / PER_S
    end = world.capture("ten")
    assert end.interval_s == 1.0
    assert end.mean_velocity_enu_m_s == pytest.approx(end.position_enu_m - begin.position_enu_m, abs=1e-12)
    assert np.concatenate([end.mean_specific_force_m_s2, end.mean_rate_rad_s]) == pytest.approx(sums / PER_S, rel=1e-9)
    # Integrating what an ideal gyroscope and accelerometer give leads to the true attitude and velocity: 500 steps of
    # at most (0.5 rad/s x 2 ms)^2 / 2 = 5e-7 rad each, and that angle times g for one second.
    assert np.abs(rotation - end.rotation).max() < 2.5e-4
    assert velocity == pytest.approx(end.velocity_enu_m_s, abs=2.5e-3)


def _rotation_vector(vector: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(vector)
    x, y, z = vector
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle == 0.0:
        return np.eye(3)
    return np.eye(3) + np.sin(angle) / angle * skew + (1.0 - np.cos(angle)) / angle**2 * skew @ skew


@every_machine
def test_row_speeds_are_rigid_body_transport(make_world: WorldMaker, kind: str) -> None:
    world = make_world(kind=kind)
    world.command(Command(speed_m_s=2.0, steering_rad=-0.25))
    world.advance(20 * PER_S)
    speed, rate = column(world, "speed_m_s"), column(world, "yaw_rate_rad_s")
    for row, y in enumerate(world.machine.rows_y_m, start=1):
        assert column(world, f"row_speed_{row}_m_s") == pytest.approx(speed - rate * y, abs=2e-3)


@every_machine
def test_motion_truth_matches_finite_differences(make_world: WorldMaker, kind: str) -> None:
    world = make_world(RoughTerrain(kind="rough", iso8608_class="C", size_m=(80.0, 80.0)), kind=kind)
    world.command(Command(speed_m_s=2.0, steering_rad=0.2))
    world.advance(5 * PER_S)
    names = ("position_e_m", "position_n_m", "position_u_m", "velocity_e_m_s", "velocity_n_m_s", "velocity_u_m_s",
             "heading_rad", "yaw_rate_rad_s")  # fmt: skip
    rows = record(world, PER_S, 1, names)
    assert np.diff(rows[:, :3], axis=0) * PER_S == pytest.approx(rows[1:, 3:6], abs=2e-3)
    assert np.diff(rows[:, 6]) * PER_S == pytest.approx(rows[1:, 7], abs=2e-3)


def test_leaving_the_terrain_ends_the_world(make_world: WorldMaker) -> None:
    world = make_world(FlatTerrain(kind="flat", size_m=(30.0, 30.0)))
    world.command(Command(speed_m_s=3.0))
    with pytest.raises(WorldEndedError, match="left the terrain"):
        world.advance(60 * PER_S)
    assert np.isfinite(world.truth()).all()


def test_tipping_over_ends_the_world(make_world: WorldMaker) -> None:
    # A rigid tractor goes over at half the track over the height of its centre of mass: 0.92 m / 1.0 m = 0.92 g
    # sideways, and earlier on an axle that swings. Across a slope of 50 %, turning uphill at 5 m/s on 4.1 m asks for
    # 0.5 + 25 / (4.1 g) = 1.1 g, and the soil grips: it must go over.
    world = make_world(slope(50.0, 90.0), soil_keys={"friction": 2.0, "lateral_stiffness": 20.0}, draught_n=0.0)
    world.command(Command(speed_m_s=5.0))
    world.advance(10 * PER_S)
    world.command(Command(speed_m_s=5.0, steering_rad=0.6))
    with pytest.raises(WorldEndedError, match="tipped over"):
        world.advance(30 * PER_S)


def test_bad_places_are_bad_input() -> None:
    machine = PlanterF8Config(kind="planter_f8", start={"east_m": 100.0})
    small = FlatTerrain(kind="flat", size_m=(30.0, 30.0))
    with pytest.raises(BadInputError, match="leaves the terrain"):
        build_world(small, SoilConfig(), machine, seed=1)
    steep = slope(120.0, 90.0)
    with pytest.raises(BadInputError, match="tipped over at its start"):
        build_world(steep, SoilConfig(friction=2.0), PlanterF8Config(kind="planter_f8"), seed=1)
    long_path = np.array([[0.0, 0.0], [1e6, 0.0]])
    with pytest.raises(BadInputError, match="cell_m"):
        build_world(FlatTerrain(kind="flat"), SoilConfig(), machine, seed=1, path=long_path)


@every_machine
def test_the_machine_starts_where_it_is_told_and_at_rest(make_world: WorldMaker, kind: str) -> None:
    world = make_world(
        RoughTerrain(kind="rough", iso8608_class="D", size_m=(60.0, 60.0)),
        kind=kind,
        start={"east_m": 3.0, "north_m": -4.0, "heading_deg": 120.0},
    )
    vehicle = world.vehicle()
    assert (vehicle.east_m, vehicle.north_m) == pytest.approx((3.0, -4.0), abs=0.05)
    assert vehicle.heading_rad == pytest.approx(math.radians(120.0), abs=0.02)
    assert np.abs(world.truth()[3:6]).max() < 1e-3
    config = MACHINES[kind](kind=kind, start={"east_m": 3.0, "north_m": -4.0, "heading_deg": 120.0})
    east, north, _ = config.reference_start
    assert world.truth()[:2] == pytest.approx((east, north), abs=0.10)


def test_mounts_and_bar_can_be_overridden() -> None:
    config = PlanterF8Config(
        kind="planter_f8",
        mounts={"roof_left": {"body": "tractor", "xyz_m": [0.3, 0.6, 2.1], "rpy_deg": [0.0, 0.0, 90.0]}},
        bar={"body": "tractor", "xyz_m": [0.3, 0.0, 2.1], "rows_y_m": [1.5, 0.5, -0.5, -1.5]},
    )
    assert config.resolved_mounts["roof_left"].rpy_rad[2] == pytest.approx(math.pi / 2)
    assert "row_8" in config.mounts
    assert config.rows_y_m == (1.5, 0.5, -0.5, -1.5)
    assert config.reference_start == pytest.approx((0.3, 0.0, 0.0))
    with build_world(FlatTerrain(kind="flat"), SoilConfig(), config, seed=1) as world:
        assert column(world, "position_u_m") == pytest.approx(0.78 + 2.1, abs=0.02)
        assert "row_speed_4_m_s" in world.truth_columns
        assert "row_speed_5_m_s" not in world.truth_columns
    with pytest.raises(ValueError, match="unknown body"):
        PlanterF8Config(kind="planter_f8", mounts={"x": {"body": "trailer", "xyz_m": [0.0, 0.0, 0.0]}})


def test_drawing_state_is_the_root_links_frame(make_world: WorldMaker) -> None:
    world = make_world(start={"heading_deg": 90.0})
    # The root's origin is the middle of the rear axle: as high as the loaded rear wheels' hubs.
    assert column(world, "base_u_m") == pytest.approx(
        0.847 - column(world, "rear_wheel_left.normal_n") / 350e3, abs=2e-3
    )
    assert column(world, "base_qz") == pytest.approx(math.sin(math.pi / 4), abs=1e-3)
