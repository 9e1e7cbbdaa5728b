"""What an implement's height filter gets from the receiver of paper 002: hold error, lag, true fixes, and trouble."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import STANDING, Log, Motion, drive, preset, sensor
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import NS_PER_S, FloatArray, MountMotion

I70 = "rtk_chcnav_i70"
WINDOW = {"from_s": 10.0, "to_s": 40.0}
UNTOUCHED = ("quality", "sigma_u_m", "age_s", "satellites", "vertical_speed_m_s", "speed_m_s")


def rising(height: Any, speed: Any, acceleration: Any) -> Motion:
    """Upright motion along up, from functions of time."""

    def motion(t0: float, t1: float) -> MountMotion:
        return MountMotion(
            t_ns=round(t1 * NS_PER_S),
            interval_s=t1 - t0,
            position_enu_m=np.array([0.0, 0.0, height(t1)]),
            rotation=np.eye(3),
            velocity_enu_m_s=np.array([0.0, 0.0, speed(t1)]),
            mean_velocity_enu_m_s=np.array([0.0, 0.0, (height(t1) - height(t0)) / (t1 - t0)]),
            mean_specific_force_m_s2=np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2 + acceleration(t1)]),
            mean_rate_rad_s=np.zeros(3),
        )

    return motion


def reciprocation(*, amplitude_m: float, rms_m_s: float) -> Motion:
    """Up and down as a sine."""
    rate = math.sqrt(2.0) * rms_m_s / amplitude_m
    return rising(
        lambda t: amplitude_m * math.sin(rate * t),
        lambda t: amplitude_m * rate * math.cos(rate * t),
        lambda t: -amplitude_m * rate * rate * math.sin(rate * t),
    )


def log_of(
    *faults: dict[str, Any], runs: int = 1, until_s: float = 60.0, motion: Motion = STANDING, **more: Any
) -> Log:
    return drive(sensor(preset(I70) | more | {"faults": list(faults)}, runs=range(runs)), motion, until_s)


def height_error(log: Log) -> FloatArray:
    return log.hidden("position_u_m.error")


def true_fix(log: Log) -> FloatArray:
    return log.hidden("true_fix")


def inside(log: Log, from_s: float = 10.0, to_s: float = 40.0) -> np.ndarray:
    return (log.t_s > from_s - 1e-6) & (log.t_s < to_s - 1e-6)


# --- good fixes ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rms_m_s", [0.13, 0.2])
def test_held_heights_on_the_rail_err_by_receiver_latency_and_hold(rms_m_s: float) -> None:
    motion = reciprocation(amplitude_m=0.15, rms_m_s=rms_m_s)
    log = log_of(runs=400, until_s=20.0, motion=motion)
    arrivals = np.array([m.t_available for m in log.measurements])
    times = np.arange(1.0, 20.0, 0.02)
    held = log.values("position_u_m")[np.searchsorted(arrivals, times + 1e-9, side="right") - 1]
    truth = np.array([motion(0.0, t).position_enu_m[2] for t in times])
    rmse_mm = 1e3 * math.sqrt(np.mean((held - truth[:, np.newaxis]) ** 2))
    # The receiver: 14 and 5.4 mm, and 1.4 mm/s of an age of 1.5 s. A height is 20 ms old as it arrives, plus 10 ms on
    # average (exponential) and 1 ms to the next tick, and is held for 0 to 100 ms more: 81 ms, with a spread of 31.
    receiver_mm = math.hypot(14.0, 5.4, 1.4 * 1.5)
    delay_s = math.hypot(0.081, 0.01, 0.1 / math.sqrt(12.0))
    # 400 runs of a correlated error: 3.5 % of its part. At 0.13 m/s it is the 18.85 mm of paper 002.
    assert rmse_mm == pytest.approx(math.hypot(receiver_mm, 1e3 * rms_m_s * delay_s), rel=0.05)
    assert log.values("quality").min() == 4.0
    assert true_fix(log).all()


def test_vertical_speed_lags_as_the_datasheet_says() -> None:
    log = log_of(runs=400, until_s=4.0, motion=rising(lambda t: 0.25 * t * t, lambda t: 0.5 * t, lambda _: 0.5))
    sheet = log.sensor.info.datasheet
    # 0.5 m/s^2 for 0.1 s: 50 mm/s too slow; 400 * 20 samples of 20 mm/s.
    error = log.hidden("vertical_speed_m_s.error")[20:]
    assert np.mean(error) == pytest.approx(-0.5 * sheet["velocity_lag_s"], abs=4 * math.hypot(0.02 / 89, 0.002 / 20))
    assert np.std(error - error.mean(axis=0)) == pytest.approx(sheet["vertical_speed_noise_m_s"], rel=0.05)


def test_the_owner_knows_the_heights_of_every_state() -> None:
    values = preset(I70)
    sheet = sensor(values).info.datasheet
    fix = values["states"]["fix"]
    assert sheet["height_correlated_sigma_m"] == fix["correlated_sigma_m"][2]
    assert sheet["height_correlation_s"] == fix["correlation_s"][2]
    assert sheet["height_white_sigma_m"] == fix["white_sigma_m"][2]
    assert sheet["height_age_drift_m_s"] == fix["age_drift_m_s"][2]
    assert sheet["age_drift_correlation_s"] == values["age_drift_correlation_s"]
    assert sheet["until_age_s"] == 10.0
    for name in ("float", "differential", "single"):
        state = values["states"][name]
        total = math.hypot(state["correlated_sigma_m"][2], state["white_sigma_m"][2])
        assert sheet[f"{name}_height_sigma_m"] == pytest.approx(total)
        assert sheet[f"{name}_height_white_sigma_m"] == state["white_sigma_m"][2]
        assert sheet[f"{name}_height_correlation_s"] == state["correlation_s"][2]
    vertical = values["vertical_speed"]
    assert sheet["vertical_speed_noise_m_s"] == vertical["white_sigma_m_s"]
    assert sheet["vertical_speed_correlated_m_s"] == vertical["correlated_sigma_m_s"]
    assert sheet["vertical_speed_correlation_s"] == vertical["correlation_s"]


def test_what_a_receiver_lacks_is_not_in_its_datasheet() -> None:
    sheet = sensor(preset("single_point")).info.datasheet
    assert "single_height_sigma_m" in sheet
    assert not {"float_height_sigma_m", "differential_height_sigma_m", "until_age_s"} & set(sheet)
    assert not any(key.startswith("vertical_speed") for key in sheet)


# --- true fixes ------------------------------------------------------------------------------------------------------


def test_a_true_fix_is_one_of_quality_4_with_fresh_corrections() -> None:
    log = log_of({"kind": "corrections_lost", **WINDOW}, runs=20)
    np.testing.assert_array_equal(true_fix(log), log.values("quality") == 4.0)
    assert 0.0 < np.mean(true_fix(log)) < 1.0
    # Pinned to its fixed state, it still says 4 when corrections are too old for one: those of 8 s
    # are the last until those of 39 s arrive just as the link is back.
    pinned = log_of({"kind": "corrections_lost", **WINDOW}, state="fix")
    assert np.all(pinned.values("quality") == 4.0)
    np.testing.assert_array_equal(true_fix(pinned)[:, 0], ~inside(pinned, 18.0, 40.0))
    assert not drive(sensor(preset("single_point")), STANDING, 2.0).hidden("true_fix").any()


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "outage"},
        {"kind": "wrong_fix", "offset_m": [0.0, 0.0, 0.2]},
        {"kind": "jump", "columns": ["position_u_m"], "size": 0.1},
        {"kind": "satellites_masked", "satellites": 3},
    ],
)
def test_there_is_no_true_fix_where_none_arrives_or_it_is_not_the_receivers(fault: dict[str, Any]) -> None:
    log = log_of(fault | {"from_s": 10.0, "to_s": 12.0}, runs=3, until_s=30.0)
    assert not true_fix(log)[inside(log, 10.0, 12.0)].any()
    assert true_fix(log)[log.t_s < 9.95].all()
    assert true_fix(log)[-1].all()


def test_a_lost_sample_is_no_true_fix_in_its_own_run() -> None:
    log = log_of({"kind": "dropouts", "probability": 0.3}, runs=20, until_s=20.0)
    np.testing.assert_array_equal(true_fix(log), log.valid)
    assert 0.6 < np.mean(log.valid) < 0.8


# --- trouble ---------------------------------------------------------------------------------------------------------


def test_float_for_minutes_wanders_by_far_more_than_it_says() -> None:
    runs = 1000
    log = log_of(
        {"kind": "satellites_masked", "satellites": 6, "from_s": 10.0, "to_s": 190.0}, runs=runs, until_s=230.0
    )
    masked = inside(log, 10.0, 190.0)
    assert np.all(log.values("quality")[masked] == 5.0)
    assert np.all(log.values("age_s")[masked] < 2.01)
    # Six of twenty satellites: sqrt(17 / 3) times everything. The error starts from 0.37 of its size and grows with
    # 100 s; 1000 runs: 2.2 %.
    factor = math.sqrt(17.0 / 3.0)
    for since_s in (60.0, 170.0):
        share = 1.0 - 0.63 * math.exp(-since_s / 100.0)
        row = np.flatnonzero(log.t_s > 10.0 + since_s - 1e-6)[0]
        assert np.std(height_error(log)[row]) == pytest.approx(factor * math.hypot(0.37 * share, 0.07), rel=4 * 0.022)
    np.testing.assert_allclose(log.values("sigma_u_m")[masked], factor * 0.011, rtol=1e-12)
    # It lasts: neighbours differ by the white part alone, nearly.
    steps = np.diff(height_error(log)[masked], axis=0)
    slow = 0.37 * math.sqrt(2.0 * 0.1 / 170.0)
    assert np.std(steps) == pytest.approx(factor * math.hypot(math.sqrt(2.0) * 0.07, slow), rel=0.05)
    assert not true_fix(log)[masked].any()
    assert true_fix(log)[-1].all()


def test_fewer_satellites_dilute_velocities_as_they_do_positions() -> None:
    masked = {"kind": "satellites_masked", "satellites": 6, **WINDOW}
    runs = 400
    climbing = rising(lambda t: 0.1 * t, lambda _: 0.1, lambda _: 0.0)
    # Pinned to a fix there is one nominal number of satellites: 24, and sqrt(21 / 3) = 2.65 for 6.
    log = log_of(masked, runs=runs, until_s=20.0, motion=climbing, state="fix")
    plain = log_of(runs=runs, until_s=20.0, motion=climbing, state="fix")
    factor = math.sqrt(7.0)
    held = inside(log)
    for column in ("vertical_speed_m_s", "speed_m_s", "course_rad"):
        np.testing.assert_array_equal(log.values(column)[~held], plain.values(column)[~held])
    # 20 mm/s white in each sample, 2 mm/s lasting for 60 s: 400 x 101 values (0.4 %) and 400 (3.5 %).
    error = log.hidden("vertical_speed_m_s.error")[held]
    np.testing.assert_allclose(error, factor * plain.hidden("vertical_speed_m_s.error")[held], rtol=1e-6)
    assert np.std(np.diff(error, axis=0)) / math.sqrt(2.0) == pytest.approx(factor * 0.020, rel=4 * 0.0044)
    assert np.std(error.mean(axis=0)) == pytest.approx(factor * math.hypot(0.002, 0.020 / 10.0), rel=4 * 0.036)
    # Standing in the level, the two velocities are noise: the speed's mean square is twice 3.5 mm/s squared.
    level = np.square(log.values("speed_m_s")[held]).mean()
    assert level == pytest.approx(2.0 * (factor * 0.0035) ** 2, rel=4 / math.sqrt(runs * 101))


def test_flapping_between_fix_float_and_differential_for_half_a_minute() -> None:
    log = log_of({"kind": "flapping_quality", "qualities": [4, 5, 2], "changes_hz": 4.0, **WINDOW}, runs=100)
    quality, error = log.values("quality")[inside(log)], height_error(log)[inside(log)]
    # 299 steps in 100 runs, each a change with 0.4: 0.28 %.
    assert np.mean(np.diff(quality, axis=0) != 0.0) == pytest.approx(0.4, abs=4 * 0.0028)
    for state in (4.0, 5.0, 2.0):
        assert np.mean(quality[20:] == state) == pytest.approx(1 / 3, abs=0.02)
    # Fixed: 15 mm. Differential: 0.77 m. 100 runs, hardly changing meanwhile: 7 %.
    assert np.std(error[quality == 4.0]) == pytest.approx(0.0152, rel=4 * 0.07)
    assert np.std(error[quality == 2.0]) == pytest.approx(math.hypot(0.76, 0.095), rel=4 * 0.07)
    np.testing.assert_array_equal(true_fix(log)[inside(log)], quality == 4.0)
    outside = ~inside(log)
    assert np.all(log.values("quality")[outside] == 4.0)


def test_a_wrong_fix_out_of_continuous_tracking_is_a_step_there_and_back_and_leaves_speeds_alone() -> None:
    wrong = {"kind": "wrong_fix", "offset_m": [0.0, 0.0, 0.2], "from_s": 10.0, "to_s": 25.0}
    motion = reciprocation(amplitude_m=0.15, rms_m_s=0.15)
    plain, log = log_of(runs=5, until_s=30.0, motion=motion), log_of(wrong, runs=5, until_s=30.0, motion=motion)
    off = height_error(log) - height_error(plain)
    for_15_s = inside(log, 10.0, 25.0)
    np.testing.assert_allclose(off[for_15_s], 0.2, atol=1e-12)
    np.testing.assert_array_equal(off[~for_15_s], 0.0)
    for column in UNTOUCHED:
        np.testing.assert_array_equal(log.values(column), plain.values(column))
    np.testing.assert_array_equal(true_fix(log), np.broadcast_to(~for_15_s[:, np.newaxis], off.shape))


def test_only_the_height_sticks() -> None:
    motion = reciprocation(amplitude_m=0.15, rms_m_s=0.15)
    stuck = {"kind": "stuck", "columns": ["position_u_m"], **WINDOW}
    plain, log = log_of(runs=3, motion=motion), log_of(stuck, runs=3, motion=motion)
    height, held = log.values("position_u_m"), inside(log)
    last = np.flatnonzero(held)[0] - 1
    np.testing.assert_array_equal(height[held], np.broadcast_to(height[last], height[held].shape))
    np.testing.assert_array_equal(height[~held], plain.values("position_u_m")[~held])
    for column in (*UNTOUCHED, "position_e_m", "position_n_m"):
        np.testing.assert_array_equal(log.values(column), plain.values(column))
    assert not true_fix(log)[held].any()


def test_half_a_second_more_latency_keeps_stamps_honest_and_is_overtaken_at_its_end() -> None:
    motion = reciprocation(amplitude_m=0.15, rms_m_s=0.15)
    log = log_of({"kind": "latency_step", "latency_s": 0.5, **WINDOW}, motion=motion)
    late = np.array([m.t_available - m.t for m in log.measurements])
    stamps = np.array([m.t for m in log.measurements])
    np.testing.assert_allclose(stamps, log.t_s, atol=1e-12)
    assert late[inside(log)].min() >= 0.52
    assert late[~inside(log)].max() < 0.2
    assert late[inside(log)].mean() - late[~inside(log)].mean() == pytest.approx(0.5, abs=0.005)
    # A height is still that of its stamp: within the receiver's own 15 mm (and the rail moves by 75 mm in 0.5 s).
    assert np.abs(height_error(log)).max() < 4 * 0.0155
    # Samples from 40.0 s on arrive before the last four or five of the window.
    order = np.argsort([m.t_available for m in log.measurements], kind="stable")
    overtaken = int(np.sum(np.diff(stamps[order]) < 0.0))
    assert 1 <= overtaken <= 6
    first_new = np.flatnonzero(log.t_s > 40.0 - 1e-6)[0]
    older_but_later = np.sum(late[:first_new] + stamps[:first_new] > stamps[first_new] + late[first_new])
    assert 3 <= older_but_later <= 6


def test_corrections_that_return_old_give_a_fix_that_says_so() -> None:
    lost = {"kind": "corrections_lost", "from_s": 10.0, "to_s": 38.0}
    old = {"kind": "corrections_old", "delay_s": 6.0, "growth": 0.0, "from_s": 38.0, "to_s": 70.0}
    log = log_of(lost, old, runs=300, until_s=80.0)
    age, quality = log.values("age_s"), log.values("quality")
    # Those of 8 s were the last: 10 s old at 18.0 s. Those of 37 s come at 44.0 s, 7 s old as they do.
    assert np.all(quality[inside(log, 18.0, 44.0)] == 2.0)
    back = inside(log, 44.0, 70.0)
    assert age[back].min() == pytest.approx(7.0)
    assert age[back].max() == pytest.approx(7.9)
    # Fixed again within 20 s but for ln(4) / 0.4 = 3.5 sigma, and always within 26 s: it is true, and says its age.
    assert np.mean(quality[inside(log, 64.0, 70.0)] == 4.0) > 0.99
    fixed = quality[back] == 4.0
    np.testing.assert_array_equal(true_fix(log)[back], fixed)
    claimed = log.values("sigma_u_m")[back][fixed]
    np.testing.assert_allclose(claimed, np.hypot(0.015, 0.0014 * age[back][fixed]), rtol=1e-9)
    # Fresh again at the end.
    assert age[-1].max() < 2.01


def test_corrections_that_return_too_old_give_no_fix() -> None:
    lost = {"kind": "corrections_lost", "from_s": 10.0, "to_s": 38.0}
    old = {"kind": "corrections_old", "delay_s": 9.0, "growth": 0.0, "from_s": 38.0, "to_s": 70.0}
    log = log_of(lost, old, runs=20, until_s=100.0)
    assert np.all(log.values("quality")[inside(log, 18.0, 70.0)] == 2.0)
    assert true_fix(log)[-1].all()
