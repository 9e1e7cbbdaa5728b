"""The bound of causal filters: against an independent solver, and by hand where that can be done."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.small_scenario import IMUS, small_scenario
from twin.scenario import Scenario, resolve
from twin.scoring.causal_bound import causal_bound_m_s

STEP_S = 0.02
ACCEL = 0.0447214**2 * 25.0 / 4.0  # four units: density squared times half the rate, by four
GYRO = 2.0e-4**2 * 25.0 / 4.0


def scenario(**sensors: dict[str, Any]) -> Scenario:
    return resolve(small_scenario(sensors=sensors), where="test")


def sigma(of: Scenario, *names: str, speed: float = 2.5, rows_y_m: tuple[float, ...] = (0.0,)) -> float:
    """Standard deviation of the speed, from the mean absolute error."""
    bound = causal_bound_m_s(of, [*IMUS, *names], speed_m_s=speed, rows_y_m=rows_y_m)
    return bound / math.sqrt(2.0 / math.pi)


@pytest.mark.parametrize("lag_s", [0.2, 0.05])
def test_with_a_radar_alone_it_solves_the_algebraic_riccati_equation(lag_s: float) -> None:
    """States v and L; L sees the mean speed of the step, v T n_a, so that L gets half of the step's noise too."""
    gain = 1.0 - math.exp(-STEP_S / lag_s)
    F = np.array([[1.0, 0.0], [gain, 1.0 - gain]])
    drive = STEP_S * np.array([1.0, 0.5 * gain])
    Q = ACCEL * np.outer(drive, drive) + np.diag([0.0, (gain * 0.05) ** 2])
    H, R = np.array([[0.0, 1.0]]), np.array([[0.0005**2]])
    before = solve_discrete_are(F.T, H.T, Q, R)
    after = before - before @ H.T @ np.linalg.solve(H @ before @ H.T + R, H @ before)
    found = sigma(scenario(radar={"lag_speeding_up_s": lag_s}), "radar")
    assert found == pytest.approx(math.sqrt(after[0, 0]), rel=1e-6)


def direct(speed_noise: float, **changes: Any) -> Scenario:
    """A receiver without lag and delay that gives 50 speeds a second, and positions that say nothing."""
    fix = {
        "quality": 4,
        "correlated_sigma_m": [0.0, 0.0, 0.0],
        "correlation_s": [100.0, 100.0, 100.0],
        "white_sigma_m": [1e6, 1e6, 1e6],
        "reported_sigma_m": [1.0, 1.0, 1.0],
        "velocity_noise_m_s": speed_noise,
        "satellites": 20,
        "hdop": 0.8,
        "vdop": 1.2,
    }
    keys = {"latency_s": 0.0, "latency_jitter_s": 0.0, "velocity_lag_s": 0.0, "rate_hz": 50.0}
    receiver = {"kind": "gnss", "mount": "antenna", "states": {"only": {**fix, **changes.pop("fix", {})}}, **keys}
    return scenario(direct={**receiver, **changes})


@pytest.mark.parametrize("speed_noise", [0.005, 0.05])
def test_a_speed_seen_directly_at_every_step_is_the_scalar_riccati_equation(speed_noise: float) -> None:
    """p = q + p r / (p + r) before the update: p^2 - q p - q r = 0; after it p - q."""
    q, r = ACCEL * STEP_S**2, speed_noise**2
    before = 0.5 * q + math.sqrt(0.25 * q * q + q * r)
    assert sigma(direct(speed_noise), "direct") == pytest.approx(math.sqrt(before - q), rel=1e-6)


def test_a_delay_of_k_steps_costs_k_steps_of_the_accelerometers_noise() -> None:
    q, r = ACCEL * STEP_S**2, 0.02**2
    before = 0.5 * q + math.sqrt(0.25 * q * q + q * r)
    late = direct(0.02, latency_s=0.08)
    assert sigma(late, "direct") == pytest.approx(math.sqrt(before - q + 4.0 * q), rel=1e-6)


def test_speed_noise_that_grows_with_speed_counts_at_the_speed() -> None:
    q, r = ACCEL * STEP_S**2, 0.01**2 + (0.01 * 3.0) ** 2
    before = 0.5 * q + math.sqrt(0.25 * q * q + q * r)
    found = sigma(direct(0.01, fix={"velocity_noise_ratio": 0.01}), "direct", speed=3.0)
    assert found == pytest.approx(math.sqrt(before - q), rel=1e-6)


def test_positions_tell_the_speed() -> None:
    """Speeds of no use, positions white by r at every step: the double integrator driven by q, (p, v)."""
    r = 0.001**2
    F = np.array([[1.0, 0.0], [STEP_S, 1.0]])
    drive = STEP_S * np.array([1.0, 0.5 * STEP_S])
    Q, H = ACCEL * np.outer(drive, drive), np.array([[0.0, 1.0]])
    before = solve_discrete_are(F.T, H.T, Q, np.array([[r]]))
    after = before - before @ H.T @ H @ before / (before[1, 1] + r)
    white = direct(1e6, fix={"white_sigma_m": [0.001, 0.001, 0.002]})
    assert sigma(white, "direct") == pytest.approx(math.sqrt(after[0, 0]), rel=1e-4)
    # An error that is correlated over minutes hardly changes that.
    slow = {"correlated_sigma_m": [0.003, 0.003, 0.005], "correlation_s": [200.0, 200.0, 200.0]}
    correlated = direct(1e6, fix={"white_sigma_m": [0.001, 0.001, 0.002], **slow})
    assert 1.0 < sigma(correlated, "direct") / sigma(white, "direct") < 1.02


def test_the_more_is_known_the_lower_it_is() -> None:
    of = scenario()
    radar, gnss, both = sigma(of, "radar"), sigma(of, "gnss"), sigma(of, "radar", "gnss")
    assert both < min(radar, gnss)
    # As many units as there are: one has twice the noise of four.
    alone = causal_bound_m_s(of, ["imu_1", "radar"], speed_m_s=2.5, rows_y_m=(0.0,)) / math.sqrt(2.0 / math.pi)
    assert radar < alone < 2.0 * radar
    slower = scenario(radar={"rate_hz": 10.0})
    assert radar < sigma(slower, "radar")


def test_rows_off_the_middle_add_the_gyroscopes_noise() -> None:
    of = scenario()
    middle = sigma(of, "radar")
    expected = np.mean([math.hypot(middle, y * math.sqrt(GYRO)) for y in (2.625, 0.375)])
    assert sigma(of, "radar", rows_y_m=(2.625, -0.375)) == pytest.approx(expected, rel=1e-9)


def test_without_a_speed_or_a_unit_there_is_none() -> None:
    of = scenario()
    assert math.isnan(causal_bound_m_s(of, list(IMUS), speed_m_s=2.5, rows_y_m=(0.0,)))
    assert math.isnan(causal_bound_m_s(of, ["radar", "gnss"], speed_m_s=2.5, rows_y_m=(0.0,)))
