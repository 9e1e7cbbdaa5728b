"""Paper 004's two models: what the printed covariance is and does, the steady state, and the lag in a bend."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.estimators.guidance_bench import Bench, fix, make_setup
from twin.estimators.guidance_kinematic import GuidanceKinematic, GuidanceKinematicConfig
from twin.estimators.guidance_kinematic_models import (
    ProcessNoise,
    circle_response,
    on_axes,
    steady_gain,
    transition,
)
from twin.signals import FloatArray

VARIANCE = 0.5
"""sigma_v^2 and sigma_a^2 of the paper."""
DT = np.array([0.2])


def noise(form: str) -> ProcessNoise:
    return ProcessNoise(velocity=VARIANCE, acceleration=VARIANCE, form=form)  # type: ignore[arg-type]


def make(*, runs: int = 1, rate_hz: float = 5.0, **options) -> GuidanceKinematic:
    options = {"kind": "guidance_kinematic", "sensors": ("gps",), "start_s": 0.0} | options
    return GuidanceKinematic(GuidanceKinematicConfig.model_validate(options), make_setup(runs=runs, rate_hz=rate_hz))


def reference(
    z: FloatArray, times_s: FloatArray, x: FloatArray, P: FloatArray, form: str, *, r: float = 1.0
) -> list[tuple[FloatArray, FloatArray]]:
    """Eqs 1 and 2 for one axis, as they are printed: (x, P) after each fix."""
    out, orders, last = [], len(x), 0.0
    for measured, t_s in zip(z, times_s, strict=True):
        dt = np.array([t_s - last])
        F = transition(dt, orders=orders)[0]
        Q = noise(form).of_curve(dt)[0] if orders == 3 else noise(form).of_straight(dt)[0, :2, :2]
        x, P, last = F @ x, F @ P @ F.T + Q, t_s
        G = P[:, 0] / (P[0, 0] + r)
        x, P = x + G * (measured - x[0]), (np.eye(orders) - np.outer(G, np.eye(orders)[0])) @ P
        out.append((x, P))
    return out


# --- what is printed -------------------------------------------------------------------------------------------------


def test_printed_covariance_has_a_negative_eigenvalue() -> None:
    values = np.linalg.eigvalsh(noise("printed").of_straight(DT)[0, :2, :2]) / VARIANCE
    # the roots of l^2 - dT^2 l - dT^2
    assert values == pytest.approx([0.02 - np.sqrt(0.0404), 0.02 + np.sqrt(0.0404)])
    assert values[0] == pytest.approx(-0.181, abs=5e-4)


@pytest.mark.parametrize("form", ["step", "continuous"])
@pytest.mark.parametrize("dt", [0.05, 0.2, 1.0])
def test_corrected_covariances_are_covariances(form: str, dt: float) -> None:
    for Q in (noise(form).of_straight(np.array([dt])), noise(form).of_curve(np.array([dt]))):
        assert np.linalg.eigvalsh(Q[0]).min() > -1e-15


def test_continuous_noise_does_not_depend_on_how_time_is_cut() -> None:
    for of, orders in ((noise("continuous").of_straight, 2), (noise("continuous").of_curve, 3)):
        F, once = transition(DT, orders=orders)[0], of(DT)[0, :orders, :orders]
        assert F @ once @ F.T + once == pytest.approx(of(2.0 * DT)[0, :orders, :orders])


def test_printed_filter_is_the_one_without_noise_whose_first_speed_was_uncertain() -> None:
    # F L F^T + (printed C_ww) = L + ..., so P_printed = P_noiseless - L at every step, however long
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.05, 1.5, 200))
    z = rng.standard_normal(200)
    start = np.diag([0.1, 0.0])
    phantom = np.diag([0.0, VARIANCE])
    printed = reference(z, times, np.zeros(2), start, "printed")
    free, last = (np.zeros(2), start + phantom), 0.0
    for measured, t_s, (x, P) in zip(z, times, printed, strict=True):
        F = transition(np.array(t_s - last), orders=2)
        predicted, C, last = F @ free[0], F @ free[1] @ F.T, t_s
        G = C[:, 0] / (C[0, 0] + 1.0)
        free = predicted + G * (measured - predicted[0]), C - np.outer(G, C[0])
        assert x == pytest.approx(free[0], abs=1e-10)
        assert np.abs(P - free[1] + phantom).max() < 1e-10


def test_printed_covariance_of_the_state_is_indefinite_from_the_first_fix_on() -> None:
    steps = reference(np.zeros(400), 0.2 * np.arange(1, 401), np.zeros(2), np.diag([1e-3, 0.0]), "printed")
    assert all(np.linalg.eigvalsh(P)[0] < 0.0 for _, P in steps)
    assert all(P[0, 0] > 0.0 and P[1, 1] < 0.0 for _, P in steps)
    assert steps[-1][1][1, 1] == pytest.approx(-VARIANCE, abs=1e-4)


def test_printed_gains_die_as_those_of_a_line_fitted_to_all_fixes() -> None:
    # of N equally spaced fixes a fitted line's end has the variance 4 / N and its slope 12 / (N^3 dT^2)
    fixes = 2000
    steps = reference(np.zeros(fixes), 0.2 * np.arange(1, fixes + 1), np.zeros(2), np.diag([1.0, 0.0]), "printed")
    P = steps[-1][1]
    assert P[0, 0] * fixes == pytest.approx(4.0, rel=0.01)
    assert (P[1, 1] + VARIANCE) * fixes**3 * 0.2**2 == pytest.approx(12.0, rel=0.01)
    assert P[0, 1] * fixes**2 * 0.2 == pytest.approx(6.0, rel=0.01)


def test_published_filter_goes_straight_on_in_a_bend_and_says_no_sigma_of_its_speed() -> None:
    # 60 s straight at 5 m/s, then round a circle of 30 m: a fit to 60 s of line hardly bends within 5 s, in which the
    # vehicle turns by 0.83 rad and comes 30 (1 - cos 0.83) = 9.8 m off the line
    estimator = make(model="constant_velocity", variant="published", velocity_variance=VARIANCE)
    for k in range(325):
        t_s = 0.2 * k
        bent = max(t_s - 60.0, 0.0) * 5.0 / 30.0
        east = min(t_s, 60.0) * 5.0 + 30.0 * np.sin(bent)
        estimator.process(fix(t_s, [east, 30.0 * (1.0 - np.cos(bent)), 0.0]))
        estimate = estimator.estimate(round(t_s * 1e9))
        assert np.isfinite(estimate.values[0, :5]).all()
    off = 30.0 * (1.0 - np.cos(5.0 * 0.9600 / 30.0 * 5.0))
    assert estimate.values[0, 1] < 0.5 * off
    sigma = dict(zip(estimator.columns, estimate.sigmas[0], strict=True))
    assert np.isnan(sigma["speed_m_s"])
    assert np.isnan(sigma["heading_rad"])
    assert 0.0 < sigma["position_n_m"] < 0.2


# --- the estimator is these equations --------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["filterpy", "ensemble"])
@pytest.mark.parametrize(
    ("model", "variant", "process", "form"),
    [
        ("constant_velocity", "published", "step", "printed"),
        ("constant_velocity", "corrected", "step", "step"),
        ("constant_velocity", "corrected", "continuous", "continuous"),
        ("constant_acceleration", "published", "step", "printed"),
        ("constant_acceleration", "corrected", "continuous", "continuous"),
    ],
)
def test_estimator_follows_the_equations(model: str, variant: str, process: str, form: str, engine: str) -> None:
    rng = np.random.default_rng(3)
    times = np.round(np.cumsum(rng.uniform(0.1, 1.0, 60)), 3)
    z = np.cumsum(rng.standard_normal((60, 3)), axis=0)
    orders = 3 if model == "constant_acceleration" else 2
    power = 1.0 if variant == "published" else 2.0
    for axis, r in enumerate([1.3**power, 1.3**power, 4.0 * 2.1**power]):
        # only the position is uncertain at the start (eq 8); corrected, the acceleration is, too
        start = np.diag([r, 0.0, 0.0 if variant == "published" else 4.0][:orders])
        expected = reference(z[:, axis], times, np.zeros(orders), start, form, r=r)
        estimator = make(model=model, variant=variant, noise=process, engine=engine, start_s=1e-9)
        estimator.process(fix(0.0, [0.0, 0.0, 0.0], hdop=1.3, vdop=2.1))  # it stands then
        for t_s, position, (x, P) in zip(times, z, expected, strict=True):
            estimator.process(fix(t_s, position, hdop=1.3, vdop=2.1))
            estimate = estimator.estimate(round(t_s * 1e9))
            assert estimate.values[0, axis] == pytest.approx(x[0], abs=1e-8)
            assert estimate.sigmas[0, axis] ** 2 == pytest.approx(P[0, 0], abs=1e-8)
            assert estimate.covariance is not None
            assert estimate.covariance[0, axis, axis] == pytest.approx(P[0, 0], abs=1e-8)


def test_steady_gain_is_the_riccati_solution() -> None:
    F, Q = transition(DT)[0], noise("step").of_curve(DT)[0]
    P = solve_discrete_are(F.T, np.eye(3)[:, :1], Q, np.array([[1.0]]))
    assert steady_gain(F, Q, 1.0) == pytest.approx(P[:, 0] / (P[0, 0] + 1.0), rel=1e-8)


# --- the lag (figures 4 and 5) ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize("radius", [25.0, 60.0])
@pytest.mark.parametrize("model", ["constant_velocity", "constant_acceleration"])
def test_lag_in_a_circle_is_that_of_the_steady_gain(model: str, radius: float, rate_hz: float) -> None:
    speed = np.sqrt(2.5 * radius)
    dt = np.array([1.0 / rate_hz])
    F, Q = transition(dt)[0], noise("step").of_curve(dt)[0]
    if model == "constant_velocity":
        F, Q = transition(dt, orders=2)[0], noise("step").of_straight(dt)[0, :2, :2]
    turned = speed / radius / rate_hz
    gain = steady_gain(F, Q, 1.0)
    shown = circle_response(F, gain, turned)
    estimator = make(model=model, rate_hz=rate_hz)
    for k in range(300):
        now = np.exp(1j * turned * k)
        estimator.process(fix(k / rate_hz, [radius * now.real, radius * now.imag, 0.0]))
    values = estimator.estimate(round(299 / rate_hz * 1e9)).values[0]
    assert complex(values[0], values[1]) / (radius * now) == pytest.approx(shown, abs=1e-6)
    assert abs(shown) > 1.0  # the track shown lies outside the bend, as in figures 1 and 5
    if model == "constant_velocity":
        # the lag behind a constant acceleration; that it turns is a matter of (lag time x rate of turn)^2
        assert radius * abs(shown - 1.0) == pytest.approx((1.0 - gain[0]) / (rate_hz * gain[1]) * 2.5, rel=0.03)


def test_lag_of_constant_acceleration_is_a_fraction_of_that_of_constant_velocity() -> None:
    for rate_hz, radius in ((1.0, 25.0), (1.0, 60.0), (5.0, 25.0), (5.0, 60.0)):
        dt = np.array([1.0 / rate_hz])
        turned = np.sqrt(2.5 / radius) / rate_hz
        lags = []
        for orders, Q in ((2, noise("step").of_straight(dt)), (3, noise("step").of_curve(dt))):
            F = transition(dt, orders=orders)[0]
            lags.append(abs(circle_response(F, steady_gain(F, Q[0, :orders, :orders], 1.0), turned) - 1.0))
        assert lags[1] < lags[0] / 3.0


def test_state_with_an_acceleration_held_at_zero_is_the_one_without() -> None:
    F3, F2 = on_axes(transition(DT)[0]), on_axes(transition(DT, orders=2)[0])
    assert (F3[:6, :6] == F2).all()
    assert (noise("step").of_straight(DT)[0, 2] == 0.0).all()
    assert (noise("step").of_straight(DT)[0, :, 2] == 0.0).all()


def test_innovations_of_a_matched_filter_are_as_it_says() -> None:
    # a vehicle that moves by the model itself and a receiver of just these errors: NIS is chi-square(2)
    runs, fixes = 20, 300
    rng = np.random.default_rng(11)
    dt = 0.2
    v, p = np.zeros((runs, 3)), np.zeros((runs, 3))
    estimator = make(model="constant_velocity", runs=runs)
    nis = []
    for k in range(fixes):
        step = np.sqrt(VARIANCE) * rng.standard_normal((runs, 3))
        p, v = p + v * dt + step * dt, v + step
        estimator.process(fix(k * dt, p + rng.standard_normal((runs, 3)) * [1.0, 1.0, 2.0 * 1.7]))
        values = estimator.estimate(round(k * dt * 1e9)).values
        nis.append(values[:, estimator.columns.index("nis_position")])
    told = np.array(nis[30:])
    # mean of n independent chi-square(2): 2 +- 2 / sqrt(n)
    assert told.mean() == pytest.approx(2.0, abs=4.0 * 2.0 / np.sqrt(told.size))


def test_published_filter_never_breaks_on_a_long_drive_with_losses() -> None:
    bench = Bench(seeds=range(1, 6), rate_hz=1.0)
    rng = np.random.default_rng(5)
    for model in ("constant_velocity", "constant_acceleration", "double"):
        estimator = make(model=model, variant="published", runs=5, rate_hz=1.0, start_s=None)
        for sample in bench.fixes():
            sample.valid[:] = rng.random(5) > 0.3
            estimator.process(sample)
            estimate = estimator.estimate(sample.t_ns)
        assert np.isfinite(estimate.values[:, :5]).all()
        assert (estimate.sigmas[:, :3] > 0.0).all()
