"""The linear algebra of the height filter against integration in small steps, numeric derivatives and updates."""

from __future__ import annotations

import numpy as np
import pytest

from twin.estimators.engines import EnsembleEngine
from twin.estimators.height_filter_kernels import (
    BY_OFFSET,
    GAIN_H,
    GAIN_V,
    LEAN,
    OFFSET,
    OFFSET_SIGMA,
    Q_HH,
    Q_HV,
    Q_VV,
    REST,
    TILT,
    compose,
    lagged,
)
from twin.estimators.height_filter_model import B0, B1, C, Layout, SlowError, SpanMotion, SumOfStates

RUNS = 3


def history(count: int = 8, step_ns: int = 20_000_000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(3)
    begin = np.arange(count, dtype=np.int64) * step_ns
    rows = generator.normal(size=(6, count, RUNS))
    rows[1] = np.square(rows[1]) + 0.1
    angle = generator.uniform(-3.0, 3.0, (count, RUNS))
    rows[4], rows[5] = np.cos(angle), np.sin(angle)
    return begin, begin + step_ns, rows


def test_sums_are_those_of_fine_steps() -> None:
    begin, end, rows = history()
    from_ns, to_ns = 13_000_000, 131_000_000
    sums = compose(begin, end, rows, from_ns, to_ns)
    fine_ns = 100_000
    d = fine_ns * 1e-9
    height, velocity, variance = np.zeros(RUNS), np.zeros(RUNS), np.zeros((2, 2, RUNS))
    for t_ns in range(from_ns, to_ns, fine_ns):
        k = int(np.searchsorted(end, t_ns, side="right"))
        a, q = rows[0, k], rows[1, k]
        height, velocity = height + velocity * d + 0.5 * a * d * d, velocity + a * d
        F = np.array([[1.0, d], [0.0, 1.0]])
        grown = np.array([[d**3 / 3.0, d**2 / 2.0], [d**2 / 2.0, d]])
        variance = np.einsum("ij,jkr,lk->ilr", F, variance, F) + grown[:, :, np.newaxis] * q
    np.testing.assert_allclose(sums[GAIN_V], velocity, rtol=1e-9)
    np.testing.assert_allclose(sums[GAIN_H], height, rtol=1e-9)
    np.testing.assert_allclose(sums[[Q_HH, Q_HV, Q_VV]], variance[[0, 0, 1], [0, 1, 1]], rtol=1e-6)


def test_a_lag_is_that_of_a_first_order_filter() -> None:
    begin, end, rows = history(count=60)
    lag_s, at_ns, d = 0.1, 1_150_000_000, 1e-5
    slow = np.zeros(RUNS)
    for t_ns in range(0, at_ns, 10_000):
        slow += d / lag_s * (rows[0, int(np.searchsorted(end, t_ns, side="right"))] - slow)
    np.testing.assert_allclose(lagged(begin, end, rows[:1], at_ns, lag_s)[0], slow, rtol=2e-3, atol=1e-4)


def model(*, tilt: bool) -> SpanMotion:
    layout = Layout.of(drift=True, coarse=True, speed=True, leak=not tilt, tilt=tilt)
    places = [B1, C, layout.drift, layout.speed, *([layout.leak] if layout.leak else [])]
    if layout.tilt is not None:
        places += [layout.tilt, layout.tilt + 1]
    errors = {place: SlowError(sigma=0.5 + place, correlation_s=20.0 + place) for place in places if place is not None}
    motion = SpanMotion(layout, errors, offset_sigma=0.02, offset_walk=1e-3, runs=RUNS)
    motion.sums = compose(*history(), 0, 100_000_000)
    lean = np.zeros((LEAN, RUNS))
    lean[TILT : TILT + 2], lean[OFFSET : OFFSET + 2] = [[0.004], [-0.006]], [[0.01], [-0.02]]
    lean[OFFSET_SIGMA : OFFSET_SIGMA + 2], lean[BY_OFFSET : BY_OFFSET + 2] = 0.013, 0.1
    lean[REST : REST + 2] = 1e-5
    motion.lean = lean
    return motion


@pytest.mark.parametrize("tilt", [True, False])
def test_jacobian_is_the_derivative(*, tilt: bool) -> None:
    motion = model(tilt=tilt)
    n = motion.layout.size
    x = np.random.default_rng(5).normal(size=(RUNS, n))
    after, F = (np.array(each) for each in motion.linearise(x, x, 0.1))
    for place in range(n):
        if motion.layout.tilt is not None and place in {motion.layout.tilt, motion.layout.tilt + 1}:
            continue  # these act through their covariance alone: their mean is in what is known of the tilt
        moved = x.copy()
        moved[:, place] += 1e-3
        slope = (motion.linearise(moved, x, 0.1)[0] - after) / 1e-3
        np.testing.assert_allclose(slope, F[:, :, place], atol=1e-9)


def test_offsets_that_are_left_act_like_an_error_of_what_is_known() -> None:
    """A level accelerometer's offset off by one sigma, and the tilt with it, move the height as the Jacobian says."""
    motion = model(tilt=True)
    x = np.zeros((motion.layout.size, RUNS))
    mean, rows, _ = motion.ahead(x, 0.1)
    place = motion.layout.tilt
    assert place is not None
    for side in range(2):
        known = motion.lean.copy()
        step = 1e-3 * known[OFFSET_SIGMA + side]
        motion.lean = known.copy()
        motion.lean[OFFSET + side] += step
        motion.lean[TILT + side] += known[BY_OFFSET + side] * step
        slope = (motion.ahead(x, 0.1)[0] - mean) / 1e-3
        motion.lean = known
        np.testing.assert_allclose(slope, rows[:, place + side], rtol=1e-3, atol=1e-12)


def test_one_span_is_as_good_as_its_parts() -> None:
    """Slow errors act within a span as if they stood still: exact for all else, and nearly so for them."""
    begin, end, rows = history()
    rows[1] = 1e-7
    layout = Layout.of(drift=False, coarse=False, speed=False, leak=False, tilt=False)
    errors = {B1: SlowError(sigma=2e-4, correlation_s=100.0), C: SlowError(sigma=1.0, correlation_s=100.0)}
    whole, parts = (SpanMotion(layout, errors, offset_sigma=0.01, offset_walk=0.0, runs=RUNS) for _ in range(2))
    one, other = EnsembleEngine(*whole.start()), EnsembleEngine(*whole.start())
    whole.sums = compose(begin, end, rows, 0, 100_000_000)
    one.predict(whole, whole.sums, 0.1)
    for k in range(5):
        parts.sums = compose(begin, end, rows, k * 20_000_000, (k + 1) * 20_000_000)
        other.predict(parts, parts.sums, 0.02)
    np.testing.assert_allclose(one.x, other.x, atol=1e-12)
    # 0.1 s are a thousandth of the correlation times
    np.testing.assert_allclose(one.P, other.P, rtol=1e-3, atol=1e-12)


def test_gates_look_at_the_innovation_of_the_update() -> None:
    generator = np.random.default_rng(7)
    root = generator.normal(size=(RUNS, 5, 5))
    engine = EnsembleEngine(generator.normal(size=(RUNS, 5)), root @ root.transpose(0, 2, 1))
    observation = SumOfStates({0: 1.0, 4: generator.uniform(0.5, 2.0, RUNS), B0: -0.3}, np.full(RUNS, 0.2), size=5)
    z = generator.normal(size=RUNS)
    y, S = observation.innovation(engine.x, engine.P, z)
    nis = engine.update(observation, z[:, np.newaxis], np.ones(RUNS, dtype=bool), observation.R)
    np.testing.assert_allclose(np.square(y) / S, nis, rtol=1e-12)
