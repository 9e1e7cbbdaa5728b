"""Paper 002's filter against a textbook loop, its steady state, its engines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.estimators.bench import STEP_NS, STEP_S, WHITE_M_S2, ahrs, gnss, make_setup
from twin.errors import BadInputError
from twin.estimators import EstimatorConfigUnion, build_estimator
from twin.estimators.height_vpkf import HeightVpkf, HeightVpkfConfig
from twin.signals import Estimate, FloatArray, Measurement

Q1, Q2, R = 4e-7, 4e-13, 1.88e-2
A = np.array([[1.0, STEP_S], [0.0, 1.0]])
B = np.array([0.5 * STEP_S**2, STEP_S])
H = np.array([[1.0, 0.0]])
RAW = {"outliers": "none", "offset": "none"}


def make(*, runs: int = 1, **options: Any) -> HeightVpkf:
    options = {"kind": "height_vpkf", "sensors": ("gnss", "ahrs"), "preparation": RAW, **options}
    return HeightVpkf(HeightVpkfConfig.model_validate(options), make_setup("gnss", "ahrs", runs=runs))


def troubled(runs: int, steps: int = 500, seed: int = 0) -> list[list[Measurement]]:
    """What arrives for each step: random heights and accelerations, RTK that ages, drops and comes back, lost samples.

    GNSS arrives 4.5 steps late, so that the order of arrival is not that of validity.
    """
    rng = np.random.default_rng(seed)
    ticks: list[list[Measurement]] = [[] for _ in range(steps + 10)]
    for k in range(1, steps):
        there = rng.random(runs) > 0.1
        accel = np.where(there, 0.5 * rng.standard_normal(runs), np.nan)
        ticks[k].append(ahrs(k * STEP_NS, accel, valid=there))
        if k % 5 == 0:
            there = rng.random(runs) > 0.1
            t_s = k * STEP_S
            age = 1.0 if t_s < 3.0 or t_s > 8.0 else t_s - 2.0
            quality = np.where(age < 5.5, 4.0, rng.choice([0.0, 1.0, 2.0, 5.0], runs))
            height = np.where(there & (quality > 0.0), 0.1 * rng.standard_normal(runs), np.nan)
            late = gnss(k * STEP_NS, height, quality=quality, age=age, latency_ns=90_000_000, valid=there)
            ticks[k + 5].insert(0, late)
    return [[], *ticks[1:steps]]


def run(estimator: HeightVpkf, ticks: list[list[Measurement]]) -> list[Estimate]:
    estimates = []
    for k, arrived in enumerate(ticks):
        for measurement in arrived:
            estimator.process(measurement)
        if k:
            estimates.append(estimator.estimate(k * STEP_NS))
    return estimates


def member(ticks: list[list[Measurement]], index: int) -> list[list[Measurement]]:
    """The ticks as an ordinary run gets them: samples that are lost never come."""

    def of(m: Measurement) -> Measurement:
        return Measurement(
            sensor=m.sensor,
            t_ns=m.t_ns,
            t_available_ns=m.t_available_ns,
            columns=m.columns,
            values=m.values[index : index + 1],
            valid=m.valid[index : index + 1],
        )

    return [[of(m) for m in tick if m.valid[index]] for tick in ticks]


def textbook(ticks: list[list[Measurement]], *, switch: str, coast: str, late: bool = True) -> list[tuple]:
    """Eqs 9 to 13 in plain matrices for one run, P as printed; state, P and mode after each step."""
    x, P, out = None, np.diag([R, Q1]), []
    z, quality, age, newest, previous = np.nan, 0.0, np.nan, 0.0, 0.0
    for arrived in ticks[1:]:
        for m in arrived:
            if m.sensor == "ahrs":
                newest = m.column("free_accel_u_m_s2")[0]
                continue
            up = m.column("position_u_m")[0] - 1.7 - 0.45
            z = up if np.isfinite(up) else z
            quality, age = m.column("quality")[0], m.column("age_s")[0]
        fixed, fresh = quality == 4.0, quality == 4.0 and age <= 4.0
        q = Q1 if {"never": True, "age": fresh, "quality": fixed}[switch] else Q2
        used = bool(np.isfinite(z)) and {"never": True, "age": fresh, "quality": fixed}[coast]
        if x is None:
            x = np.array([z, 0.0]) if np.isfinite(z) else None
        else:
            x = A @ x + B * (previous if late else newest)
            P = A @ P @ A.T + q * np.eye(2)
            if used:
                K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
                x = x + (K @ (z - H @ x)).ravel()
                P = (np.eye(2) - K @ H) @ P
        previous = newest
        out.append((x, P, (2.0 if q == Q1 else 1.0) if used else 0.0))
    return out


@pytest.mark.parametrize("switch", ["age", "quality", "never"])
@pytest.mark.parametrize("coast", ["never", "quality", "age"])
def test_it_is_the_papers_recursion(switch: str, coast: str) -> None:
    ticks = member(troubled(3), 1)
    estimates = run(make(switch=switch, coast=coast, engine="ensemble"), ticks)
    expected = textbook(ticks, switch=switch, coast=coast)
    modes = {mode for _, _, mode in expected}
    assert modes >= {2.0, 0.0}
    assert (1.0 in modes) == ((switch, coast) in {("age", "never"), ("quality", "never"), ("age", "quality")})
    for estimate, (x, P, mode) in zip(estimates, expected, strict=True):
        assert estimate.values[0, 2] == mode
        if x is None:
            assert np.isnan(estimate.values[0, :2]).all()
            continue
        np.testing.assert_allclose(estimate.values[0, :2], x, rtol=1e-9, atol=1e-12)
        assert estimate.covariance is not None
        np.testing.assert_allclose(estimate.covariance[0], P, rtol=1e-7, atol=1e-15)
        np.testing.assert_allclose(estimate.sigmas[0, :2], np.sqrt(np.diag(P)), rtol=1e-7)


def test_the_newest_acceleration_may_be_used() -> None:
    ticks = member(troubled(1), 0)
    estimates = run(make(input="current", engine="ensemble"), ticks)
    expected = textbook(ticks, switch="age", coast="never", late=False)
    np.testing.assert_allclose(estimates[-1].values[0, :2], expected[-1][0], rtol=1e-9)


@pytest.mark.parametrize("options", [{}, {"coast": "quality", "preparation": {"outliers": "robust"}}])
def test_engines_agree_and_a_member_is_the_ordinary_run(options: dict[str, Any]) -> None:
    if options:
        options = {**options, "preparation": {**options["preparation"], "calibration_s": 1.0}}
    ticks = troubled(6)
    together = run(make(runs=6, **options), ticks)
    for index in (0, 4):
        alone = run(make(engine="filterpy", **options), member(ticks, index))
        same = run(make(engine="ensemble", **options), member(ticks, index))
        for a, b, c in zip(together, alone, same, strict=True):
            np.testing.assert_allclose(b.values[0], a.values[index], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(b.covariance[0], a.covariance[index], rtol=1e-9, atol=1e-12)
            np.testing.assert_array_equal(c.values[0], a.values[index])
            np.testing.assert_array_equal(c.sigmas[0], a.sigmas[index])


# --- steady state ----------------------------------------------------------------------------------------------------


def settled_gain(*, q_good: float, age: float, steps: int) -> FloatArray:
    """Gain (2,) after so many steps, from the covariance: K = P+ H^T / R."""
    estimator = make(engine="ensemble", q_good=q_good)
    for k in range(1, steps, 5):
        estimator.process(gnss(k * STEP_NS, 0.0, age=age, latency_ns=0))
    covariance = estimator.estimate(steps * STEP_NS).covariance
    assert covariance is not None
    return covariance[0, :, 0] / R


@pytest.mark.parametrize(
    ("q_good", "age", "q", "time_constant_s", "steps"),
    [(Q1, 1.0, Q1, 2.79, 3000), (4.2e-4, 1.0, 4.2e-4, 0.99, 1000), (Q1, 9.0, Q2, 93.1, 15_000)],
)
def test_steady_gains(q_good: float, age: float, q: float, time_constant_s: float, steps: int) -> None:
    """Against the Riccati equation; the slowest pole of the error of continuous time, s^2 + k1 s + w^2 = 0 with
    w^4 = q / (R T^2) and k1^2 = 2 w^2 + q / (R T^2), has the time constant of the filter."""
    P = solve_discrete_are(A.T, H.T, q * np.eye(2), np.array([[R]]))
    expected = P[:, 0] / (P[0, 0] + R)
    gain = settled_gain(q_good=q_good, age=age, steps=steps)
    np.testing.assert_allclose(gain, expected, rtol=5e-3)
    poles = np.linalg.eigvals(A - np.outer(gain, H @ A))
    slowest = -STEP_S / np.log(np.abs(poles).max())
    assert slowest == pytest.approx(time_constant_s, rel=0.01)
    ratio = q / (R * STEP_S**2)
    continuous = np.roots([1.0, np.sqrt(2.0 * np.sqrt(ratio) + ratio), np.sqrt(ratio)])
    assert slowest == pytest.approx(-1.0 / continuous.real.max(), rel=0.03)


def test_right_after_the_loss_the_gain_is_not_that_of_q2() -> None:
    """P is carried over: a second after Q2 is in force the gain is still near that of Q1, 33 times that of Q2."""
    estimator = make(engine="ensemble")
    for k in range(1, 3000, 5):
        estimator.process(gnss(k * STEP_NS, 0.0, latency_ns=0))
    for k in range(3001, 3050, 5):
        estimator.process(gnss(k * STEP_NS, 0.0, age=5.0, latency_ns=0))
    covariance = estimator.estimate(3050 * STEP_NS).covariance
    assert covariance is not None
    steady = settled_gain(q_good=Q1, age=9.0, steps=15_000)
    assert covariance[0, 0, 0] / R > 20.0 * steady[0]


def test_only_the_ratio_of_q_and_r_counts() -> None:
    """So metres and millimetres are the same filter, as long as Q and R are of one unit."""
    ticks = member(troubled(1), 0)
    metres = run(make(), ticks)
    millimetres = run(make(q_good=Q1 * 1e6, q_lost=Q2 * 1e6, r=R * 1e6), ticks)
    np.testing.assert_allclose(metres[-1].values, millimetres[-1].values, rtol=1e-9)


def test_the_printed_unit_vector_makes_the_filter_repeat_gnss() -> None:
    """I = [1 1]^T as a program with implicit expansion takes it: the gain goes to one, P has no bound."""
    P = np.diag([R, Q1])
    trace = []
    for _ in range(2000):
        P = A @ P @ A.T + Q1 * np.eye(2)
        K = P @ H.T / (P[0, 0] + R)
        P = (np.array([[1.0], [1.0]]) - K @ H) @ P
        trace.append(P[0, 0])
    assert K[0, 0] == pytest.approx(1.0, abs=1e-6)
    assert trace[1999] > 1e3 * trace[999] > 1e6 * trace[0]
    assert K[0, 0] > 50.0 * settled_gain(q_good=Q1, age=1.0, steps=3000)[0]


# --- configuration ---------------------------------------------------------------------------------------------------


def test_the_papers_preparation_is_the_default() -> None:
    """It stands, with an offset of -13.80 mm/s^2 and white noise, then goes up for a second at 0.1 m/s^2."""
    estimator = make(preparation={"calibration_s": 20.0})
    rng = np.random.default_rng(0)
    height = 0.0
    for k in range(1, 1051):
        accel = 0.1 if k > 1000 else 0.0
        height = 0.05 * ((k - 1000) * STEP_S) ** 2 if k > 1000 else 0.0
        estimator.process(ahrs(k * STEP_NS, accel - 0.0138 + WHITE_M_S2 * rng.standard_normal()))
        if k % 5 == 0:
            estimator.process(gnss(k * STEP_NS, height, latency_ns=0))
        estimate = estimator.estimate(k * STEP_NS)
    # A sample late, 0.1 m/s^2 x 20 ms; white noise of one second of samples; GNSS held 0.1 s pulls back by 2 % at most.
    assert estimate.values[0, 1] == pytest.approx(0.1, abs=0.006)
    assert estimate.values[0, 0] == pytest.approx(height, abs=0.004)


def test_kinds_are_registered() -> None:
    from pydantic import TypeAdapter  # noqa: PLC0415

    adapter: TypeAdapter[Any] = TypeAdapter(EstimatorConfigUnion)
    for kind, sensors in (("height_vpkf", ["gnss", "ahrs"]), ("height_hold", ["gnss"])):
        config = adapter.validate_python({"kind": kind, "sensors": sensors})
        estimator = build_estimator(config, make_setup(*sensors))
        assert estimator.columns[0] == "height_m"


def test_bad_input() -> None:
    with pytest.raises(BadInputError, match="exactly one sensor of kind 'ahrs'"):
        HeightVpkf(HeightVpkfConfig(kind="height_vpkf", sensors=("gnss",)), make_setup("gnss"))
    with pytest.raises(BadInputError, match="steps one run, not 2"):
        make(runs=2, engine="filterpy")
