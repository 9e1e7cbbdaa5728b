"""The filter inside a receiver: its gains, how far it trails, what it leaves of noise, when it starts anew."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.sensors.motions import Log, circle, constant, drive, preset, ramp, sensor
from tests.sensors.test_gnss import PERFECT
from twin.sensors.gnss_internal_filter import InternalFilter

TRUROVER = InternalFilter(position_sigma_m=1.5, acceleration_sigma_m_s2=1.0)
T = 0.2
FILTERED: dict[str, Any] = PERFECT | {
    "rate_hz": 1.0 / T,
    "internal_filter": {"position_sigma_m": 1.5, "acceleration_sigma_m_s2": 1.0},
}


def lost(log: Log) -> np.ndarray:
    """(T, 2) error of the first run, east and north."""
    return np.stack([log.hidden(f"position_{axis}_m.error")[:, 0] for axis in "en"], axis=-1)


@pytest.mark.parametrize(("sigma_z", "sigma_a", "period_s"), [(1.5, 1.0, 0.2), (0.1, 3.0, 1.0), (5.0, 0.05, 0.1)])
def test_gains_are_steady_kalman_gains_of_constant_velocity(sigma_z: float, sigma_a: float, period_s: float) -> None:
    move = np.array([[1.0, period_s], [0.0, 1.0]])
    push = np.array([[0.5 * period_s**2], [period_s]]) * sigma_a
    look = np.array([[1.0, 0.0]])
    before = solve_discrete_are(move.T, look.T, push @ push.T, np.array([[sigma_z**2]]))
    gain = before @ look.T / (before[0, 0] + sigma_z**2)
    alpha, beta = InternalFilter(position_sigma_m=sigma_z, acceleration_sigma_m_s2=sigma_a).gains(period_s)
    assert alpha == pytest.approx(gain[0, 0], rel=1e-6)
    assert beta == pytest.approx(gain[1, 0] * period_s, rel=1e-6)


def test_steady_travel_comes_out_as_it_is() -> None:
    log = drive(sensor(FILTERED), constant(3.0, heading_rad=0.7), 20.0)
    np.testing.assert_allclose(lost(log), 0.0, atol=1e-9)


def test_it_trails_by_a_t_squared_one_minus_alpha_over_beta_under_constant_acceleration() -> None:
    alpha, beta = TRUROVER.gains(T)
    log = drive(sensor(FILTERED), ramp(1.0, 0.5, from_s=2.0, to_s=100.0), 60.0)
    # The slowest mode decays by sqrt(1 - alpha) a sample: over 50 s nothing is left of the begin.
    expected = -0.5 * T**2 * (1.0 - alpha) / beta
    np.testing.assert_allclose(lost(log)[-20:, 0], expected, rtol=1e-6)
    assert log.sensor.info.datasheet["filter_lag_s2"] == pytest.approx(-expected / 0.5, rel=1e-12)
    # What the preset says of it: 1.34 m per m/s^2.
    assert sensor(preset("trurover")).info.datasheet["filter_lag_s2"] == pytest.approx(1.34, abs=0.005)


@pytest.mark.parametrize(("speed_m_s", "radius_m"), [(30.0 / 3.6, 20.0), (20.0 / 3.6, 15.0), (1.1, 3.0)])
def test_a_curve_comes_out_wider_by_the_filters_response(speed_m_s: float, radius_m: float) -> None:
    log = drive(sensor(FILTERED), circle(speed_m_s, radius_m), 60.0)
    east, north = log.values("position_e_m")[-50:, 0], log.values("position_n_m")[-50:, 0] - radius_m
    # Filtered position over raw one: ((alpha z + beta - alpha) z) / (z^2 - (2 - alpha - beta) z + 1 - alpha).
    alpha, beta = TRUROVER.gains(T)
    z = np.exp(1j * speed_m_s / radius_m * T)
    response = (alpha * z + beta - alpha) * z / (z * z - (2.0 - alpha - beta) * z + 1.0 - alpha)
    np.testing.assert_allclose(np.hypot(east, north), abs(response) * radius_m, rtol=1e-6)
    assert abs(response) > 1.0


def test_a_wide_curve_comes_out_wider_by_the_lag_of_its_acceleration() -> None:
    log = drive(sensor(FILTERED), circle(5.0, 200.0), 120.0)
    outward = np.hypot(log.values("position_e_m")[-50:, 0], log.values("position_n_m")[-50:, 0] - 200.0) - 200.0
    # The next term is of the order of the curve's frequency over the filter's (0.025 / 0.77), squared: 0.1 %, but of
    # the radius, not of the lag: 1 % of it.
    np.testing.assert_allclose(outward, 5.0**2 / 200.0 * TRUROVER.lag_s2(T), rtol=0.02)


def test_it_leaves_of_white_noise_what_an_alpha_beta_filter_does() -> None:
    states = {"ideal": PERFECT["states"]["ideal"] | {"white_sigma_m": [1.0, 1.0, 1.0]}}
    log = drive(sensor(FILTERED | {"states": states}, runs=range(500)), constant(0.0), 40.0)
    alpha, beta = TRUROVER.gains(T)
    expected = (2.0 * alpha**2 + beta * (2.0 - 3.0 * alpha)) / (alpha * (4.0 - 2.0 * alpha - beta))
    # 500 runs on three axes: variance to sqrt(2/1500) = 3.7 %.
    last = np.stack([log.hidden(f"position_{axis}_m.error")[-1] for axis in "enu"])
    assert np.mean(last**2) == pytest.approx(expected, rel=4 * 0.037)
    # The first two positions are told as they are.
    first = np.stack([log.hidden(f"position_{axis}_m.error")[:2] for axis in "enu"])
    assert np.mean(first**2) == pytest.approx(1.0, rel=4 * math.sqrt(2.0 / 3000.0))


def test_it_starts_anew_after_a_loss_of_the_position() -> None:
    gone = {"kind": "satellites_masked", "satellites": 3, "from_s": 20.0, "to_s": 25.0}
    config = FILTERED | {"faults": [gone]}
    del config["state"]
    log = drive(sensor(config), circle(5.0, 20.0), 40.0)
    error, t_s = np.hypot(*lost(log).T), log.t_s
    assert np.isnan(error[(t_s >= 20.0) & (t_s < 25.0)]).all()
    back = np.flatnonzero(t_s >= 25.0)
    np.testing.assert_allclose(error[back[:2]], 0.0, atol=1e-9)
    assert error[back[20]] > 0.5


def test_speed_and_course_are_its_own_only_where_it_is_said_so() -> None:
    told = FILTERED["internal_filter"] | {"velocity": True}
    doppler, own = (
        drive(sensor(FILTERED | {"internal_filter": table}), ramp(1.0, 0.5, from_s=2.0, to_s=100.0), 40.0)
        for table in (FILTERED["internal_filter"], told)
    )
    np.testing.assert_allclose(doppler.hidden("speed_m_s.error"), 0.0, atol=1e-9)
    # A ramp of positions z = a t^2 / 2: the velocity trails by the time (alpha / beta - 1/2) T at the updated instant.
    alpha, beta = TRUROVER.gains(T)
    late_s = (alpha / beta - 0.5) * T
    np.testing.assert_allclose(own.hidden("speed_m_s.error")[-5:, 0], -0.5 * late_s, rtol=1e-5)
