"""Runs of the orchard robot: needs other than motion go all the way from the world to the record."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from twin.errors import BadInputError
from twin.execution import Journey, execute, execute_each, open_members, open_world
from twin.geometry import wrap_angle
from twin.members import Tape
from twin.recording import Recording
from twin.scenario import LoadedScenario, load
from twin.world.orchard_robot import SMALL

TABLE: dict[str, Any] = {
    "title": "A lane, a turn on the spot, a magnet",
    "duration_s": 9.0,
    "terrain": {"kind": "rough", "iso8608_class": "A", "cell_m": 0.05},
    "soil": {"preset": "firm"},
    "machine": {"kind": "orchard_robot", "start": {"heading_deg": 90.0}},
    "magnetics": {
        "magnets": [
            {"east_m": 0.1, "north_m": 1.0, "moment_a_m2": [0.3, 0.0, 0.5], "from_s": 5.5, "to_s": 8.0, "ramp_s": 0.5}
        ]
    },
    "driver": {
        "speed_m_s": 0.5,
        "steering_bandwidth_1_m": 3.0,
        "preview_s": 0.2,
        "path": [{"stop_s": 1.0}, {"straight_m": 1.0}, {"spin_deg": 50.0}, {"stop_s": 4.0}],
    },
    "sensors": {
        "imu": {"preset": "imu_mpu6050", "mount": "imu"},
        "compass": {"preset": "mag_qmc5883l", "mount": "magnetometer"},
        "encoders": {
            "preset": "wheel_encoders_lm393",
            "mount": "encoders",
            "missed_slot_probability": 0.02,
            "latency_s": 0.01,
        },
    },
}
PERFECT = [("sensors.compass", {"kind": "magnetometer", "mount": "magnetometer", "rate_hz": 50.0})]


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(tomli_w.dumps(TABLE), encoding="utf-8")
    return path


def _measured_equal(one: Recording, other: Recording, member: int = 0) -> None:
    for sensor in TABLE["sensors"]:
        for kind in ("measurements", "hidden"):
            a, b = one.streams[f"{kind}/{sensor}"], other.streams[f"{kind}/{sensor}"]
            np.testing.assert_array_equal(a.t_ns, b.t_ns)
            np.testing.assert_array_equal(a.values[:, 0], b.values[:, member], err_msg=f"{kind}/{sensor}")


def test_twice_is_the_same_to_the_last_bit(scenario_file: Path) -> None:
    one, other = execute(load(scenario_file)), execute(load(scenario_file))
    np.testing.assert_array_equal(one.truth.values, other.truth.values)
    _measured_equal(one, other)


def test_members_are_the_single_runs(scenario_file: Path) -> None:
    loaded = load(scenario_file)
    ensemble = execute(loaded, runs=(0, 1, 2))
    side_by_side = execute_each(loaded, runs=(0, 1, 2))
    for index in range(3):
        single = execute(loaded, runs=(index,))
        _measured_equal(single, ensemble, index)
        _measured_equal(single, side_by_side[index])
    assert np.ptp(ensemble.measurements("encoders").values[-1, :, 0]) > 0.0


def test_a_tape_shows_what_the_world_showed(scenario_file: Path) -> None:
    loaded = load(scenario_file)
    single = execute(loaded, runs=(5,))
    tape = Tape(loaded.scenario)
    with open_world(loaded) as world:
        assert Journey(loaded.scenario, world, tape).go() == "duration"
    members = open_members(loaded, runs=(4, 5))
    for _ in tape.play(members, pause_ns=700_000_000):
        pass
    streams = members.streams()
    for sensor in TABLE["sensors"]:
        alone, played = single.measurements(sensor), streams[f"measurements/{sensor}"]
        np.testing.assert_array_equal(alone.values[:, 0], played.values[:, 1])


def test_counts_tell_how_far_the_robot_went(scenario_file: Path) -> None:
    loaded = load(scenario_file, settings=[("sensors.encoders.missed_slot_probability", 0.0)])
    recording = execute(loaded)
    encoders, truth = recording.measurements("encoders"), recording.truth
    at = int(np.flatnonzero(truth.column("segment")[:, 0] == 2)[0])
    north = truth.column("position_n_m")[at, 0] - truth.column("position_n_m")[0, 0]
    sample = np.searchsorted(encoders.t_ns, truth.t_ns[at])
    way = encoders.values[sample, 0].mean() * 2.0 * math.pi * SMALL.wheel_radius_m / 20.0
    # A slot is 1.04 cm; slip and the waves of the ground are less than one in a metre.
    assert way == pytest.approx(north, abs=0.0104 + 0.01)
    # 50 degrees on the spot: 0.873 x 10.5 cm or 8.8 slots between the wheels, each count rounded twice.
    turned = encoders.values[-1, 0] - encoders.values[sample, 0]
    assert turned[1] - turned[0] == pytest.approx(8.8, abs=2.5)


def test_an_undisturbed_compass_tells_the_true_heading_and_the_magnet_is_felt_when_it_is_there(
    scenario_file: Path,
) -> None:
    loaded = load(scenario_file, settings=PERFECT)
    recording = execute(loaded)
    compass, truth = recording.measurements("compass"), recording.truth
    shared, at_compass, at_truth = np.intersect1d(compass.t_ns, truth.t_ns, return_indices=True)
    x, y, _ = compass.values[at_compass, 0].T
    declination = loaded.scenario.magnetics.earth_field.declination_rad
    error = np.degrees(
        wrap_angle(math.pi / 2.0 - declination - np.arctan2(y, x) - truth.column("heading_rad")[at_truth, 0])
    )
    t_s = shared / 1e9
    # The machine leans by up to a degree on this ground, and each degree across the field turns it by tan 56 = 1.5.
    tilt = np.degrees(np.hypot(truth.column("roll_rad"), truth.column("pitch_rad"))[at_truth, 0])
    away, there = (t_s < 5.5) | (t_s >= 8.0), (t_s > 6.2) & (t_s < 7.3)
    assert np.all(np.abs(error[away]) < 0.05 + 1.6 * tilt[away])
    assert np.abs(error[there]).min() > 5.0


def _refused(scenario_file: Path, key: str, value: Any, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        load(scenario_file, settings=[(key, value)])


def test_what_the_machine_has_not_is_refused(scenario_file: Path) -> None:
    _refused(scenario_file, "sensors.encoders.left_joint", "wheel_lefft", "did you mean 'wheel_left'")
    _refused(scenario_file, "machine", {"kind": "planter_f8"}, "sensors.imu.mount: unknown mount")
    _refused(scenario_file, "seeding", {"spacing_m": 0.1}, "seeding: machine orchard_robot has no rows")
    planter = [("machine", {"kind": "planter_f8"}), ("sensors", {})]
    with pytest.raises(BadInputError, match="spin_deg: a planter_f8 cannot turn on the spot"):
        load(scenario_file, settings=planter)
    tight = [*planter, ("driver.path", [{"turn_deg": 90.0, "radius_m": 0.5}])]
    with pytest.raises(BadInputError, match=r"radius_m = 0\.5: a planter_f8 turns on 1 m or more"):
        load(scenario_file, settings=tight)


def test_a_magnet_off_the_ground_is_named_with_its_file(scenario_file: Path) -> None:
    loaded: LoadedScenario = load(scenario_file, settings=[("magnetics.magnets.0.east_m", 500.0)])
    with pytest.raises(BadInputError, match=r"robot\.toml: magnetics\.magnets\.0: .*off the terrain"):
        execute(loaded)
