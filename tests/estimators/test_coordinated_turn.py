from __future__ import annotations

import numpy as np
import pytest

from twin.estimators.coordinated_turn import (
    OMEGA,
    AntennaPosition,
    CoordinatedTurn,
    ForwardSpeed,
    YawRate,
    sinc_and_derivative,
    transport,
)

Q = (1e-5, 1e-5, 1e-4, 1e-8, 1e-8)
MODEL = CoordinatedTurn(process_variances=Q, step_s=0.02)
RATES = [0.0, 1e-12, -1e-6, 0.3, -0.3, 0.999, 1.001, 40.0]  # both sides of the series limit: |omega| = 1 at 50 Hz


def states() -> np.ndarray:
    x = np.random.default_rng(1).normal(size=(len(RATES), 5)) * [50.0, 50.0, 3.0, 2.0, 0.0]
    x[:, OMEGA] = RATES
    return x


def finite_differences(function, x: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Central differences: error of the order of step^2 times the third derivative plus 1e-16 |f| / step = 1e-8."""
    columns = []
    for place in range(x.shape[1]):
        offset = np.zeros(x.shape[1])
        offset[place] = step
        columns.append((function(x + offset) - function(x - offset)) / (2.0 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("dt_s", [0.02, 1.0])
def test_motion_jacobian_equals_finite_differences(dt_s: float) -> None:
    x, u = states(), np.full(len(RATES), 0.7)
    expected = finite_differences(lambda at: MODEL.linearise(at, u, dt_s)[0], x)
    np.testing.assert_allclose(MODEL.linearise(x, u, dt_s)[1], expected, atol=2e-7)


@pytest.mark.parametrize(
    "seen", [YawRate(1.0), ForwardSpeed(1.0, left_m=1.3), AntennaPosition(1.0, forward_m=0.4, left_m=-1.1)]
)
def test_observation_jacobians_equal_finite_differences(seen) -> None:
    x = states()
    expected = finite_differences(seen.h, x)
    np.testing.assert_allclose(np.broadcast_to(seen.H(x), expected.shape), expected, atol=2e-7)


def test_transport_covariance_follows_its_own_jacobian() -> None:
    x = states()
    A = np.random.default_rng(2).normal(size=(len(x), 5, 5))
    P = A @ A.swapaxes(1, 2)
    J = finite_differences(lambda at: transport(at, P, 2.6)[0], x)
    np.testing.assert_allclose(transport(x, P, 2.6)[1], J @ P @ J.swapaxes(1, 2), rtol=1e-6, atol=1e-6)


def test_motion_is_the_printed_one_where_that_is_defined() -> None:
    """Eqs 2.18 and 2.19 as printed, for omega away from 0."""
    x = states()[3:]
    dt, s, phi, omega = 0.02, x[:, 2], x[:, 3], x[:, 4]
    chord = 2.0 * s / omega * np.sin(omega * dt / 2.0)
    moved = MODEL.linearise(x, np.zeros(len(x)), dt)[0]
    np.testing.assert_allclose(moved[:, 0], x[:, 0] + chord * np.cos(phi + omega * dt / 2.0), rtol=1e-13)
    np.testing.assert_allclose(moved[:, 1], x[:, 1] + chord * np.sin(phi + omega * dt / 2.0), rtol=1e-13)


def test_a_full_circle_ends_where_it_began() -> None:
    """The discrete model is exact for constant speed and yaw rate, whatever the step."""
    x = np.array([[3.0, -4.0, 2.5, 0.4, 0.25]])
    for _ in range(100):
        x = MODEL.linearise(x, np.zeros(1), 2.0 * np.pi / 0.25 / 100)[0]
    np.testing.assert_allclose(x[0, :2], [3.0, -4.0], atol=1e-12)


def test_sinc_and_its_derivative_join_at_the_series_limit() -> None:
    """The terms the series leave out are g^6/5040 = 2e-16 and g^5/840 = 1.2e-13; the closed derivative cancels to
    eps/g = 2e-14."""
    g = np.array([0.0, 0.01 - 1e-9, 0.01 + 1e-9])
    value, derivative = sinc_and_derivative(g)
    assert (value[0], derivative[0]) == (1.0, 0.0)
    series = lambda a: -a / 3.0 + a**3 / 30.0 - a**5 / 840.0  # noqa: E731
    np.testing.assert_allclose(derivative, series(g), atol=3e-13)
    np.testing.assert_allclose(value, np.sinc(g / np.pi), atol=1e-15)


def test_both_printed_lever_arm_signs_are_the_rigid_body() -> None:
    """2.29 with r to the left and 2.26 with r to the right both say v = s - omega y: left is inside a left turn."""
    x = np.array([[0.0, 0.0, 2.5, 0.0, 0.25]])
    left_m = 2.625
    seen = ForwardSpeed(0.1, left_m=left_m).h(x)[0, 0]
    assert seen == pytest.approx(2.5 - 0.25 * left_m)
    assert seen == pytest.approx(2.5 + 0.25 * (-left_m))
    assert transport(x, np.zeros((1, 5, 5)), left_m)[0][0, 2] == pytest.approx(seen)


def test_antenna_lever_arm_turns_with_the_machine() -> None:
    north = np.array([[10.0, 20.0, 0.0, np.pi / 2, 0.0]])
    seen = AntennaPosition(0.1, forward_m=1.0, left_m=0.5).h(north)
    np.testing.assert_allclose(seen, [[9.5, 21.0]], atol=1e-12)


def test_process_noise_counts_steps() -> None:
    np.testing.assert_allclose(MODEL.Q(0.06), 3.0 * np.diag(Q))
