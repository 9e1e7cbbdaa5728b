"""Each fault does what it says inside its window and nothing outside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, Log, constant, drive, preset, sensor
from tests.sensors.test_gnss import PERFECT
from twin.errors import BadInputError

WINDOW = {"from_s": 2.0, "to_s": 4.0}
SPEED = 1.5


def log_with(*faults: dict[str, Any], runs: int = 1, **changes: Any) -> Log:
    return drive(sensor(PERFECT | changes | {"faults": list(faults)}, runs=range(runs)), constant(SPEED), 6.0)


def inside(log: Log) -> np.ndarray:
    return (log.t_s >= 2.0) & (log.t_s < 4.0)


def east_error(log: Log) -> np.ndarray:
    return log.values("position_e_m") - SPEED * log.t_s[:, np.newaxis]


def test_window_includes_its_begin_and_excludes_its_end() -> None:
    log = log_with({"kind": "jump", "columns": ["position_e_m"], "size": 1.0, **WINDOW})
    hit = np.round(log.t_s[np.abs(east_error(log)[:, 0]) > 0.5], 9)
    assert hit.tolist() == [round(2.0 + k / 10, 9) for k in range(20)]


def test_window_without_an_end_lasts() -> None:
    log = log_with({"kind": "jump", "columns": ["position_e_m"], "size": 1.0, "from_s": 2.0})
    np.testing.assert_allclose(east_error(log)[log.t_s >= 2.0], 1.0, atol=1e-9)


def test_outage_gives_nothing_inside() -> None:
    log = log_with({"kind": "outage", **WINDOW}, runs=3)
    counts = np.array([len(sample.measurements) for sample in log.samples])
    np.testing.assert_array_equal(counts, np.where(inside(log), 0, 1))


def test_dropouts_lose_their_share_inside_only() -> None:
    log = log_with({"kind": "dropouts", "probability": 0.3, **WINDOW}, runs=200)
    assert log.valid[~inside(log)].all()
    # 200 * 20 draws: standard error sqrt(0.21/4000) = 0.72 %.
    assert 1.0 - log.valid[inside(log)].mean() == pytest.approx(0.3, abs=4 * 0.0072)


def test_jump_and_drift_move_their_columns_only() -> None:
    log = log_with(
        {"kind": "jump", "columns": ["position_e_m"], "size": -0.7, **WINDOW},
        {"kind": "drift", "columns": ["position_u_m"], "rate_per_s": 0.2, **WINDOW},
    )
    np.testing.assert_allclose(east_error(log)[:, 0], np.where(inside(log), -0.7, 0.0), atol=1e-9)
    drifted = np.where(inside(log), 0.2 * (log.t_s - 2.0), 0.0)
    np.testing.assert_allclose(log.values("position_u_m")[:, 0], drifted, atol=1e-9)
    assert np.all(log.values("position_n_m") == 0.0)
    # The true error, kept for the record, contains the fault.
    np.testing.assert_allclose(log.hidden("position_u_m.error")[:, 0], drifted, atol=1e-9)


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.2])
def test_scale_multiplies_its_columns_only(factor: float) -> None:
    log = log_with({"kind": "scale", "columns": ["speed_m_s"], "factor": factor, **WINDOW}, runs=2)
    expected = np.where(inside(log), factor * SPEED, SPEED)[:, np.newaxis]
    np.testing.assert_allclose(log.values("speed_m_s"), np.broadcast_to(expected, (len(log.t_s), 2)), atol=1e-9)
    np.testing.assert_allclose(east_error(log), 0.0, atol=1e-9)


def test_a_radar_that_loses_every_other_pulse_reads_half_its_speed_and_half_its_count() -> None:
    fault = {"kind": "scale", "columns": ["speed_m_s", "pulses"], "factor": 0.5, **WINDOW}
    logs = [
        drive(sensor(preset("radar_99ppm") | {"faults": faults}, name="radar"), constant(SPEED), 6.0)
        for faults in ([], [fault])
    ]
    for name in ("speed_m_s", "pulses"):
        sound, halved = (log.values(name)[:, 0] for log in logs)
        np.testing.assert_allclose(halved, np.where(inside(logs[0]), 0.5, 1.0) * sound)


def test_a_shifted_course_stays_wrapped() -> None:
    log = log_with({"kind": "jump", "columns": ["course_rad"], "size": 4.0})
    np.testing.assert_allclose(log.values("course_rad"), 4.0 - 2 * np.pi, atol=1e-12)


def test_stuck_repeats_the_last_good_value() -> None:
    log = log_with({"kind": "stuck", "columns": ["position_e_m"], **WINDOW})
    east = log.values("position_e_m")[:, 0]
    np.testing.assert_allclose(east[inside(log)], SPEED * 1.9, atol=1e-9)
    np.testing.assert_allclose(east[~inside(log)], SPEED * log.t_s[~inside(log)], atol=1e-9)
    assert [m.t_ns for m in log.measurements] == log.taken_ns
    everything = log_with({"kind": "stuck"})
    assert np.ptp(everything.values("position_e_m")) == 0.0


def test_a_stuck_value_may_have_last_digits_that_move() -> None:
    stuck = {"kind": "stuck", "columns": ["position_e_m"], **WINDOW}
    held = log_with(stuck, runs=100)
    log = log_with(stuck | {"noise": 1e-4}, runs=100)
    moved = (log.values("position_e_m") - held.values("position_e_m"))[inside(log)]
    # 100 runs of 20 samples: 1.6 %.
    assert np.std(moved) == pytest.approx(1e-4, rel=4 * 0.016)
    assert np.all(np.diff(moved, axis=0) != 0.0)
    assert len(np.unique(moved[0])) == 100
    for column in log.sensor.columns:
        if column != "position_e_m":
            np.testing.assert_array_equal(log.values(column), held.values(column))
    np.testing.assert_array_equal(log.values("position_e_m")[~inside(log)], held.values("position_e_m")[~inside(log)])


def test_spikes_come_at_their_rate_to_both_sides_and_on_all_columns_at_once() -> None:
    columns = ["position_e_m", "position_n_m"]
    log = log_with({"kind": "spike", "columns": columns, "size": 5.0, "probability": 0.2, **WINDOW}, runs=200)
    error = np.round(east_error(log), 6)
    assert np.all(error[~inside(log)] == 0.0)
    hits = error[inside(log)]
    assert set(np.unique(hits)) == {-5.0, 0.0, 5.0}
    # 4000 draws: 0.63 %; of about 800 hits half are positive: 1.8 %.
    assert np.mean(hits != 0.0) == pytest.approx(0.2, abs=4 * 0.0063)
    assert np.mean(hits[hits != 0.0] > 0.0) == pytest.approx(0.5, abs=4 * 0.018)
    np.testing.assert_allclose(log.values("position_n_m"), error, atol=1e-6)


def test_noise_factor_multiplies_the_sensors_own_error() -> None:
    values = preset("rtk_f9p")["states"]
    fault = {"kind": "noise_factor", "factor": 10.0, "columns": ["position_e_m"], **WINDOW}
    log = log_with(fault, runs=400, states=values, state="fix")
    own = np.hypot(0.003, 0.0008)
    error = log.hidden("position_e_m.error")
    # 400 runs: sigma to 3.5 % where errors repeat from sample to sample; inside, mostly new ones, 8000 of them.
    assert np.std(error[inside(log)]) == pytest.approx(10 * own, rel=0.05)
    assert np.std(error[~inside(log)]) == pytest.approx(own, rel=0.15)
    assert np.std(log.hidden("position_n_m.error")) == pytest.approx(own, rel=0.15)


def test_noise_factor_on_an_imu_multiplies_its_noise() -> None:
    config = preset("imu_row_unit") | {"faults": [{"kind": "noise_factor", "factor": 10.0, "from_s": 1.0}]}
    log = drive(sensor(config, runs=range(20)), constant(1.0), 3.0)
    gyro = log.values("gyro_z_rad_s") - log.hidden("gyro_z_rad_s.bias")
    # 20 * 100 values: 1.6 %.
    assert np.std(gyro[log.t_s >= 1.0] - gyro[log.t_s >= 1.0].mean(axis=0)) == pytest.approx(0.01, rel=0.065)


def test_duplicate_delivers_every_sample_twice() -> None:
    log = log_with({"kind": "duplicate", "delay_s": 0.03, **WINDOW})
    for sample, twice in zip(log.samples, inside(log), strict=True):
        assert len(sample.measurements) == (2 if twice else 1)
        if twice:
            first, second = sample.measurements
            assert second.t_available_ns - first.t_available_ns == 30_000_000
            assert second.t_ns == first.t_ns
            np.testing.assert_array_equal(second.values, first.values)


def test_latency_step_delays_arrival_and_clock_offset_shifts_the_stamp() -> None:
    late = log_with({"kind": "latency_step", "latency_s": 0.5, **WINDOW})
    delays = [m.t_available_ns - taken for m, taken in zip(late.measurements, late.taken_ns, strict=True)]
    assert delays == np.where(inside(late), 500_000_000, 0).tolist()
    assert [m.t_ns for m in late.measurements] == late.taken_ns
    ahead = log_with({"kind": "clock_offset", "offset_s": -0.3, **WINDOW})
    offsets = [m.t_ns - taken for m, taken in zip(ahead.measurements, ahead.taken_ns, strict=True)]
    assert offsets == np.where(inside(ahead), -300_000_000, 0).tolist()
    assert [m.t_available_ns for m in ahead.measurements] == ahead.taken_ns
    np.testing.assert_allclose(ahead.hidden("clock_error_s")[:, 0], np.where(inside(ahead), -0.3, 0.0))


def test_faults_act_in_the_order_of_the_list() -> None:
    jump = {"kind": "jump", "columns": ["position_u_m"], "size": 1.0, **WINDOW}
    stuck = {"kind": "stuck", "columns": ["position_u_m"], **WINDOW}
    first = log_with(jump, stuck)
    assert np.all(first.values("position_u_m") == 0.0)
    second = log_with(stuck, jump)
    np.testing.assert_array_equal(second.values("position_u_m")[:, 0], np.where(inside(second), 1.0, 0.0))


def test_a_fault_changes_nothing_outside_its_window_to_the_last_bit() -> None:
    faults = [
        {"kind": "spike", "columns": ["position_e_m"], "size": 5.0, "probability": 0.5, **WINDOW},
        {"kind": "noise_factor", "factor": 3.0, **WINDOW},
        {"kind": "dropouts", "probability": 0.5, **WINDOW},
    ]
    noisy = {"states": preset("rtk_f9p")["states"], "state": "fix"}
    plain, faulty = log_with(runs=60, **noisy), log_with(*faults, runs=60, **noisy)
    outside = ~inside(plain)
    for column in ("position_e_m", "position_u_m", "speed_m_s", "course_rad"):
        np.testing.assert_array_equal(plain.values(column)[outside], faulty.values(column)[outside])
    assert not np.array_equal(plain.values("speed_m_s"), faulty.values("speed_m_s"))


def test_events_tell_begin_and_end_at_the_sample_where_they_happen() -> None:
    faults = [{"kind": "outage", **WINDOW}, {"kind": "jump", "columns": ["position_e_m"], "size": 1.0, "from_s": 3.0}]
    log = drive(sensor(PERFECT | {"faults": faults}, name="gnss"), constant(SPEED), 6.0)
    events = [event for sample in log.samples for event in sample.events]
    assert [(event.t_ns, event.source, event.level, event.text) for event in events] == [
        (2_000_000_000, "sensors.gnss", "warning", "fault outage begins"),
        (3_000_000_000, "sensors.gnss", "warning", "fault jump begins"),
        (4_000_000_000, "sensors.gnss", "warning", "fault outage ends"),
    ]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"kind": "outage", "from_s": 5.0, "to_s": 5.0}, "to_s = 5 must be later than from_s = 5"),
        ({"kind": "outage", "from_s": -1.0}, "greater than or equal to 0"),
        ({"kind": "jump", "size": 1.0}, "Field required"),
        ({"kind": "jump", "columns": [], "size": 1.0}, "at least 1 item"),
        ({"kind": "scale", "columns": ["speed_m_s"], "factor": -0.5}, "greater than or equal to 0"),
        ({"kind": "scale", "columns": ["speed_m_s"]}, "Field required"),
        ({"kind": "noise_factor", "factor": 0.5}, "greater than or equal to 1"),
        ({"kind": "dropouts", "probability": 1.5}, "less than or equal to 1"),
        ({"kind": "outtage"}, "'outage', 'dropouts', 'stuck'"),
        ({"kind": "drift", "columns": ["position_e_m"], "rate_per_s": float("nan")}, "finite number"),
    ],
)
def test_impossible_faults_are_refused(fault: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        CONFIGS.validate_python(PERFECT | {"mount": "m", "faults": [fault]})


def test_a_column_the_sensor_does_not_have_is_refused_with_a_suggestion() -> None:
    faults = [{"kind": "outage"}, {"kind": "jump", "columns": ["position_x_m"], "size": 1.0}]
    with pytest.raises(BadInputError, match=r"faults\[1\].columns: there is no column 'position_x_m'; did you mean"):
        sensor(PERFECT | {"faults": faults})
