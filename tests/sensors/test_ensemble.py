"""Members of an ensemble are ordinary runs, and sensors do not touch one another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import Log, circle, drive, preset, sensor

PRESETS = ["imu_row_unit", "imu_mpu6050", "imu_mti300", "radar_99ppm", "rtk_f9p_dual", "rtk_survey", "single_point"]
PRESETS += ["rtk_chcnav_i70", "ahrs_mti300", "laser_lr4009", "lmt_millay", "lift_stroke"]
PRESETS += ["lea_5s", "trurover", "gyro_gx1", "potentiometer_n35"]
RECEIVER_FAULTS = [
    {"kind": "corrections_old", "growth": 0.5, "from_s": 0.5, "to_s": 2.0},
    {"kind": "corrections_lost", "from_s": 2.0, "to_s": 3.0},
    {"kind": "satellites_masked", "satellites": 3, "inside": {"east_m": [4.0, 6.5]}},
    {"kind": "satellites_masked", "satellites": 6, "near": {"line": [[8.0, 0.0], [8.0, 20.0]], "within_m": 1.0}},
    {"kind": "flapping_quality", "qualities": [1, 0], "changes_hz": 0.8, "from_s": 4.5, "to_s": 6.0},
    {"kind": "zero_covariance", "from_s": 5.0, "to_s": 6.0},
]
"""All but a wrong fix, which takes a receiver that can fix."""
FIRST = {
    "imu": "gyro_z_rad_s",
    "radar": "speed_m_s",
    "gnss": "course_rad",
    "ahrs": "free_accel_u_m_s2",
    "laser_receiver": "height_level_m",
    "displacement_transducer": "displacement_m",
    "yaw_gyro": "yaw_rate_rad_s",
    "angle_transducer": "steering_angle_rad",
}


def faulty(name: str) -> dict[str, Any]:
    """A preset with jitter and every kind of fault."""
    values = preset(name)
    columns = [FIRST[values["kind"]]]
    inner: list[dict[str, Any]] = []
    if values["kind"] == "gnss":
        inner = list(RECEIVER_FAULTS)
        if "fix" in values["states"]:
            inner.append({"kind": "wrong_fix", "from_s": 6.5, "to_s": 7.0})
            inner.append({"kind": "bad_reacquisition", "for_s": 0.3, "to_s": 7.5})
            values["states"]["fix"] |= {"until_age_s": 1.6, "acquire_s": 0.4}
            values["states"]["float"] |= {"until_age_s": 2.5, "acquire_s": 0.2}
            values |= {"corrections_loss_probability": 0.3}
    return values | {
        "latency_s": 0.05,
        "latency_jitter_s": 0.05,
        "time_jitter_s": 0.004,
        "dropout_probability": 0.1,
        "faults": [
            {"kind": "stuck", "columns": columns, "from_s": 1.0, "to_s": 2.0},
            {"kind": "spike", "columns": columns, "size": 0.5, "probability": 0.3, "from_s": 1.5},
            {"kind": "jump", "columns": columns, "size": 0.5, "from_s": 2.0, "to_s": 3.0},
            {"kind": "drift", "columns": columns, "rate_per_s": 0.1, "from_s": 2.5},
            {"kind": "noise_factor", "factor": 3.0, "from_s": 1.0, "to_s": 4.0},
            {"kind": "dropouts", "probability": 0.5, "from_s": 3.0, "to_s": 5.0},
            {"kind": "duplicate", "delay_s": 0.01, "from_s": 3.0},
            {"kind": "latency_step", "latency_s": 0.2, "from_s": 3.5},
            {"kind": "clock_offset", "offset_s": 0.1, "from_s": 4.0},
            {"kind": "outage", "from_s": 5.0, "to_s": 5.5},
            *inner,
        ],
    }


def by_arrival(log: Log, member: int) -> list[tuple[int, int, bytes]]:
    """What one member got: stamp, arrival and the very bits of the values."""
    return [
        (m.t_ns, m.t_available_ns, m.values[member].tobytes())
        for sample in log.samples
        for m in sample.measurements
        if m.valid[member]
    ]


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("config", [preset, faulty])
def test_member_is_the_ordinary_run_bit_for_bit(name: str, config: Any) -> None:
    motion = circle(2.0, 10.0)
    together = drive(sensor(config(name), runs=range(40)), motion, 8.0)
    for run in (0, 17, 39):
        alone = drive(sensor(config(name), runs=[run]), motion, 8.0)
        assert alone.taken_ns == together.taken_ns
        assert by_arrival(alone, 0) == by_arrival(together, run)
        for single, many in zip(alone.samples, together.samples, strict=True):
            assert single.hidden[0].tobytes() == many.hidden[run].tobytes()


def test_members_of_a_faulty_ensemble_are_in_different_fix_states() -> None:
    # Otherwise the test above shows little: sets of corrections are lost, and states acquired, in each run by itself.
    log = drive(sensor(faulty("rtk_f9p_dual"), runs=range(40)), circle(2.0, 10.0), 8.0)
    quality = np.stack([m.column("quality") for m in log.measurements])
    different = [len(set(row[np.isfinite(row)])) > 1 for row in quality]
    assert np.mean(different) > 0.3
    assert {0.0, 1.0, 2.0, 4.0, 5.0} <= set(quality[np.isfinite(quality)])


@pytest.mark.parametrize("name", PRESETS)
def test_runs_differ_in_values_and_share_the_schedule_and_worlds_differ_in_both(name: str) -> None:
    config = preset(name) | {"time_jitter_s": 0.004, "latency_jitter_s": 0.02}
    motion = circle(2.0, 10.0)
    first, other_run, other_seed = (
        drive(sensor(config, seed=seed, runs=[run]), motion, 3.0) for seed, run in ((1, 0), (1, 1), (2, 0))
    )
    arrivals = [[m.t_available_ns for m in log.measurements] for log in (first, other_run, other_seed)]
    assert first.taken_ns == other_run.taken_ns
    assert arrivals[0] == arrivals[1]
    assert arrivals[0] != arrivals[2]
    column = FIRST[config["kind"]]
    assert not np.array_equal(first.values(column), other_run.values(column))


def test_a_sensor_does_not_depend_on_other_sensors_or_on_how_often_they_are_built() -> None:
    motion = circle(2.0, 10.0)
    alone = drive(sensor(preset("imu_row_unit"), name="imu_1"), motion, 2.0)
    first, _, gnss = (
        sensor(preset("imu_row_unit"), name="imu_1"),
        sensor(preset("imu_row_unit"), name="imu_4"),
        sensor(preset("rtk_f9p"), name="gnss"),
    )
    drive(gnss, motion, 2.0)
    assert by_arrival(drive(first, motion, 2.0), 0) == by_arrival(alone, 0)


def test_sensors_of_another_name_err_differently() -> None:
    motion = circle(2.0, 10.0)
    one, other = (drive(sensor(preset("imu_row_unit"), name=name), motion, 2.0) for name in ("imu_1", "imu_4"))
    assert not np.array_equal(one.values("gyro_z_rad_s"), other.values("gyro_z_rad_s"))


def test_measurements_are_not_overwritten_by_later_samples() -> None:
    for name in PRESETS:
        device = sensor(faulty(name), runs=range(3))
        log = drive(device, circle(2.0, 10.0), 1.0)
        kept = [m.values.copy() for m in log.measurements]
        hidden = [sample.hidden.copy() for sample in log.samples]
        again = drive(device, lambda t0, t1: circle(2.0, 10.0)(t0 + 1e-9, t1), 0.0)
        assert not again.samples
        fresh = drive(sensor(faulty(name), runs=range(3)), circle(2.0, 10.0), 3.0)
        for before, now in zip(kept, fresh.measurements, strict=False):
            np.testing.assert_array_equal(before, now.values)
        for row, sample in zip(hidden, fresh.samples, strict=False):
            np.testing.assert_array_equal(row, sample.hidden)
