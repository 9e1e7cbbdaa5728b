"""The AccoSat: what fusing an accelerometer with DGPS gives, and what it leaves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, Log, circle, constant, drive, preset, ramp, sensor, straight
from tests.sensors.test_ensemble import by_arrival
from twin.geometry import STANDARD_GRAVITY_M_S2 as G

QUIET = {
    "receiver_white_m_s": 0.0,
    "receiver_correlated_m_s": 0.0,
    "accel_noise_density_m_s2_rthz": 0.0,
    "accel_bias_m_s2": 0.0,
    "accel_bias_instability_m_s2": 0.0,
    "accel_scale_error_ratio": 0.0,
    "mounting_tilt_rad": 0.0,
}
TAU_S, RECEIVER_S = 2.0, 0.23


def quiet(**changes: Any) -> dict[str, Any]:
    return preset("accosat") | QUIET | changes


def fused(log: Log) -> np.ndarray:
    return log.hidden("fused_speed_m_s")


def test_columns_rate_and_kind_are_those_of_a_radar_at_25_hz() -> None:
    device = sensor(preset("accosat"), runs=range(2))
    log = drive(device, constant(2.0), 2.0)
    assert device.info.kind == "accosat"
    assert device.columns == ("speed_m_s", "pulses")
    assert len(log.samples) == 50


@pytest.mark.parametrize("speed", [0.2, 2.0, 6.0])
def test_pulses_count_the_distance_and_their_period_is_the_speed(speed: float) -> None:
    log = drive(sensor(quiet(), runs=range(20)), constant(speed), 10.0)
    # 99 per metre; the start phase decides over one pulse.
    assert np.abs(log.values("pulses").sum(axis=0) - 990.0 * speed).max() <= 1.0
    # The shortest span is one interval less one period, or one period; the timer's 1e-5 s spoils it by less than that.
    span = max(0.04 - 1.0 / (99.0 * speed), 1.0 / (99.0 * speed))
    error = log.values("speed_m_s")[log.t_s > 1.0] - speed
    assert np.abs(error).max() <= speed * 1e-5 / (span - 1e-5)


def test_it_stays_at_zero_at_standstill_and_falls_to_zero_after_stopping() -> None:
    standing = drive(sensor(preset("accosat"), runs=range(20)), constant(0.0), 20.0)
    assert not standing.values("speed_m_s").any()
    # 2 m/s to 0 in 2 s: an error of at most a T_receiver = 0.23 m/s, gone like (1 + t / tau) exp(-t / tau) or faster;
    # below the minimum of 0.13 m/s within 2 tau. Then one slowest pulse period, 78 ms, and one sample.
    log = drive(sensor(quiet()), ramp(2.0, -1.0, from_s=2.0, to_s=4.0), 10.0)
    assert not log.values("speed_m_s")[log.t_s > 4.0 + 2.0 * TAU_S + 0.12].any()


def noise(white: float, correlated: float, correlation_s: float) -> float:
    """Standard deviation of the fused speed after a fix, from the filter's own discrete equations.

    With e the speed's error, b the offset's times T_g = 0.2 s and c the receiver's correlated error, all at a fix:
    e- = e - b, y = c + n - e-, e+ = e- + K1 y, b+ = b - K2 y.
    """
    q, r = math.exp(-0.2 / TAU_S), math.exp(-0.2 / correlation_s)
    K1, K2 = 1.0 - q * q, (1.0 - q) ** 2
    F = np.array([[1.0 - K1, K1 - 1.0, K1 * r], [K2, 1.0 - K2, -K2 * r], [0.0, 0.0, r]])
    B = np.array([[K1, K1], [-K2, -K2], [0.0, 1.0]])
    drive = B @ np.diag([white**2, correlated**2 * (1.0 - r * r)]) @ B.T
    P = np.linalg.solve(np.eye(9) - np.kron(F, F), drive.ravel()).reshape(3, 3)
    return math.sqrt(P[0, 0])


@pytest.mark.parametrize(("white", "correlated"), [(0.03, 0.0), (0.0, 0.02)])
def test_receiver_noise_passes_as_the_filters_equations_demand(white: float, correlated: float) -> None:
    # 400 runs, one look each every 20 s (ten tau, two correlation times): 1200 looks, sigma to 2 %.
    config = quiet(receiver_white_m_s=white, receiver_correlated_m_s=correlated)
    log = drive(sensor(config, runs=range(400)), constant(2.0), 61.0)
    # A fix is taken at sample 0, 5, 10, ... and handed on 3 later.
    after_fix = [index for index in range(len(log.samples)) if index % 5 == 3 and index * 0.04 > 20.0][::100]
    looks = fused(log)[after_fix] - 2.0
    assert looks.shape[0] >= 3
    assert np.std(looks) == pytest.approx(noise(white, correlated, 10.0), rel=0.09)


def test_the_datasheets_noise_is_that_of_the_whole() -> None:
    # The sheet takes the correlated part to pass as it is, which is 1.4 % low for it. The accelerometer's white noise,
    # 0.0138 m/s^2 a sample, comes through (1 - t / tau) exp(-t / tau), whose square integrates to tau / 4:
    # 0.0138 * 0.04 * sqrt(25 * 2 / 4) = 2 mm/s, in quadrature to 22.5 mm/s nothing to see. 1200 looks: sigma to 2 %.
    device = sensor(preset("accosat"), runs=range(400))
    log = drive(device, constant(2.0), 61.0)
    looks = log.values("speed_m_s")[[500, 1000, 1500]] - 2.0
    sheet = device.info.datasheet["speed_noise_m_s"]
    assert sheet == pytest.approx(noise(0.03, 0.02, 10.0), rel=0.02)
    assert np.std(looks) == pytest.approx(sheet, rel=0.1)


def lag_error(t: float) -> float:
    """Error after t seconds of a ramp of 1 m/s^2 whose fixes are late by RECEIVER_S, for t well above that.

    e' = -b + k1 y, b' = -k2 y, y = -RECEIVER_S - e: the step response of -(k1 s + k2) / (s + 1/tau)^2 to the lag,
    e = -RECEIVER_S (1 - (1 - t / tau) exp(-t / tau)).
    """
    return -RECEIVER_S * (1.0 - (1.0 - t / TAU_S) * math.exp(-t / TAU_S))


@pytest.mark.parametrize("acceleration", [1.0, -1.0])
def test_a_ramp_is_followed_at_first_and_late_by_the_receivers_lag_in_the_end(acceleration: float) -> None:
    start = 1.0 if acceleration > 0 else 9.0
    log = drive(sensor(quiet()), ramp(start, acceleration, from_s=4.0, to_s=12.0), 12.0)
    truth = start + acceleration * np.clip(log.t_s - 4.0, 0.0, None)
    # The sample's speed is the mean over its interval, the fused one its end: half an interval, 0.02 s, besides.
    error = (fused(log)[:, 0] - truth) / acceleration
    at = {t: float(error[np.argmin(np.abs(log.t_s - 4.0 - t))]) for t in (0.12, 1.0, 2.0, 7.6)}
    assert abs(at[0.12]) < 0.01  # no fix has spoken yet: the accelerometer alone
    # A fix comes every 0.2 s (its effect 0.1 s late on average, slope 2 / tau * RECEIVER_S: 0.023).
    for t in (1.0, 2.0, 7.6):
        assert at[t] == pytest.approx(lag_error(t), abs=0.03)
    # Braking for a second, as a planter does, it is less late than the radar (0.7 s) by far.
    assert abs(at[1.0]) < 0.7 / 4


@pytest.mark.parametrize("pitch_deg", [-20.0, 10.0])
def test_steady_speed_does_not_depend_on_the_mounting_angle(pitch_deg: float) -> None:
    # The radar would be off by tan(35 deg) per radian: 12 % at 10 degrees. Here nothing: the offset starts at g sin.
    log = drive(sensor(quiet()), constant(4.0, pitch_rad=math.radians(pitch_deg)), 3.0)
    assert log.values("speed_m_s")[log.t_s > 1.0] == pytest.approx(4.0, rel=1e-3)
    # On a ramp its accelerometer sees cos(pitch) of the acceleration; the fixes supply the rest.
    device = sensor(quiet(mounting_tilt_rad=0.2), runs=range(50))
    braking = drive(device, ramp(4.0, -1.0, from_s=2.0, to_s=4.0), 4.0)
    level = drive(sensor(quiet()), ramp(4.0, -1.0, from_s=2.0, to_s=4.0), 4.0)
    # Three angles of 0.2 rad (1 sigma), drawn to 3 sigma: 1 - cos(0.6)^2 = 0.32 of 1 m/s^2 for 2 s with a memory of
    # half a tau: below 0.32; typically 1 - cos(0.2)^2 = 0.04.
    spread = fused(braking) - fused(level)
    assert np.abs(spread).max() < 0.32
    assert np.median(np.abs(spread[-1])) < 0.04 * 2.0


def test_a_slope_entered_leaks_in_and_is_pulled_out() -> None:
    """Gravity's new share b = g sin(3 deg) = 0.513 m/s^2 is a step on the accelerometer: e' = b - k1 e - d, d' = k2 e,
    so e = b t exp(-t / tau), largest at tau: 0.513 * 2 / e = 0.378 m/s."""
    b = G * math.sin(math.radians(3.0))

    def entering(t0: float, t1: float) -> Any:
        # Nose up is a negative pitch.
        return constant(2.0, pitch_rad=-math.radians(3.0) if t0 > 3.99 else 0.0)(t0, t1)

    log = drive(sensor(quiet()), entering, 30.0)
    error = fused(log)[:, 0] - 2.0
    t = np.clip(log.t_s - 4.0, 0.0, None)
    # Samples of 0.04 s and fixes of 0.2 s against the continuous filter: 0.1 s of a slope of b.
    np.testing.assert_allclose(error, b * t * np.exp(-t / TAU_S), atol=0.06)
    assert error.max() == pytest.approx(b * TAU_S / math.e, rel=0.1)
    assert abs(error[-1]) < 1e-3  # 26 s are 13 tau: 26 * 0.513 * exp(-13) = 3e-5


def test_a_bias_of_the_accelerometer_is_gone_in_the_steady_state() -> None:
    log = drive(sensor(quiet(accel_bias_m_s2=0.5), runs=range(20)), constant(2.0), 5.0)
    np.testing.assert_allclose(fused(log), 2.0, atol=1e-9)


def test_scale_error_shows_only_while_the_speed_changes() -> None:
    # 10 % (1 sigma) of 1 m/s^2 for 2 s, pulled out afterwards: after 8 tau 10 % * (2 + 16) * exp(-8) = 6e-4.
    log = drive(sensor(quiet(accel_scale_error_ratio=0.1), runs=range(400)), ramp(1, 1, from_s=2, to_s=4), 20.0)
    level = drive(sensor(quiet()), ramp(1, 1, from_s=2, to_s=4), 20.0)
    spread = np.std(fused(log) - fused(level), axis=1)
    # At the end of the ramp: 0.1 times the integral of (1 - t / tau) exp(-t / tau) over 2 s, 2 exp(-1): 0.0736. Of 400
    # runs the sigma is known to 3.5 %; fixes of 0.2 s against the continuous filter: 5 %.
    assert spread[np.argmin(np.abs(log.t_s - 4.0))] == pytest.approx(0.0736, rel=4 * 0.035 + 0.05)
    assert spread[-1] < 6e-4


@pytest.mark.parametrize("changes", [{}, {"accel_noise_density_m_s2_rthz": 0.0}])
def test_member_is_the_ordinary_run_bit_for_bit(changes: dict[str, Any]) -> None:
    faulty = {
        "latency_s": 0.05,
        "latency_jitter_s": 0.05,
        "time_jitter_s": 0.004,
        "dropout_probability": 0.1,
        "faults": [
            {"kind": "stuck", "columns": ["speed_m_s"], "from_s": 1.0, "to_s": 2.0},
            {"kind": "noise_factor", "factor": 3.0, "from_s": 1.0, "to_s": 4.0},
            {"kind": "dropouts", "probability": 0.5, "from_s": 3.0, "to_s": 5.0},
        ],
    }
    for config in (preset("accosat") | changes, preset("accosat") | changes | faulty):
        together = drive(sensor(config, runs=range(40)), circle(2.0, 10.0), 8.0)
        for run in (0, 17, 39):
            alone = drive(sensor(config, runs=[run]), circle(2.0, 10.0), 8.0)
            assert alone.taken_ns == together.taken_ns
            assert by_arrival(alone, 0) == by_arrival(together, run)
            for single, many in zip(alone.samples, together.samples, strict=True):
                assert single.hidden[0].tobytes() == many.hidden[run].tobytes()


def test_members_and_worlds_differ() -> None:
    first, other_run, other_seed = (
        drive(sensor(preset("accosat"), seed=seed, runs=[run]), constant(2.0), 3.0).values("speed_m_s")
        for seed, run in ((1, 0), (1, 1), (2, 0))
    )
    assert not np.array_equal(first, other_run)
    assert not np.array_equal(first, other_seed)


def test_samples_are_not_overwritten_by_later_ones() -> None:
    log = drive(sensor(preset("accosat")), straight(lambda t: t, lambda t: 0.5 * t * t), 4.0)
    assert len({row.tobytes() for row in log.hidden("fused_speed_m_s")}) == len(log.samples)


def test_a_receiver_rate_that_does_not_divide_is_refused() -> None:
    with pytest.raises(ValidationError, match="receiver_rate_hz = 4 does not divide rate_hz = 25"):
        CONFIGS.validate_python({"mount": "here", **preset("accosat"), "receiver_rate_hz": 4.0})
