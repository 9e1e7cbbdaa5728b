"""The smoother, against filterpy's own and against what it is for."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from twin.estimators.rts_smoother import RtsRecorder
from twin.signals import FloatArray

F = np.array([[1.0, 0.1, 0.005], [0.0, 1.0, 0.1], [0.0, 0.0, 0.95]])
Q = np.diag([1e-6, 1e-4, 1e-2])
H = np.array([[1.0, 0.0, 0.0]])
R = np.array([[0.04]])


def simulate(seed: int, steps: int = 80) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    x, truth, z = np.zeros(3), [], []
    for _ in range(steps):
        x = F @ x + np.sqrt(np.diag(Q)) * rng.normal(size=3)
        truth.append(x)
        z.append(x[0] + 0.2 * rng.normal())
    return np.array(truth), np.array(z)


def filtered(z: FloatArray, *, every: int = 1) -> tuple[KalmanFilter, RtsRecorder, list[tuple[FloatArray, FloatArray]]]:
    one = KalmanFilter(dim_x=3, dim_z=1)
    one.x, one.P, one.F, one.Q, one.H, one.R = np.zeros(3), np.eye(3), F, Q, H, R
    recorder = RtsRecorder(one.x[np.newaxis], one.P[np.newaxis])
    after = []
    for step, value in enumerate(z):
        recorder.begin(step)
        one.predict()
        recorder.predicted(F[np.newaxis], one.x[np.newaxis], one.P[np.newaxis])
        if step % every == 0:
            one.update(value)
            recorder.corrected(one.x[np.newaxis], one.P[np.newaxis])
        after.append((one.x.copy(), one.P.copy()))
    return one, recorder, after


@pytest.mark.parametrize("every", [1, 4])
def test_it_is_that_of_filterpy_on_a_linear_model(every: int) -> None:
    """To the square root of the diagonal term of 1e-12 that keeps singular matrices at bay, and better."""
    one, recorder, after = filtered(simulate(1)[1], every=every)
    xs, Ps = np.array([x for x, _ in after]), np.array([P for _, P in after])
    expected_x, expected_P, _, _ = one.rts_smoother(xs, Ps)
    smoothed = recorder.smooth()
    assert sorted(smoothed) == list(range(80))
    for step, (x, P) in smoothed.items():
        np.testing.assert_allclose(x[0], expected_x[step], rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(P[0], expected_P[step], rtol=1e-7, atol=1e-8)


def test_hindsight_errs_less_than_the_filter_by_what_both_claim() -> None:
    """Mean square of the middle state, which is not measured, away from both ends: 40 seeds of 50 correlated steps are
    some 200 independent values, whose ratio of mean squares is known to sqrt(2 x 2 / 200) = 14 %; twice that."""
    errors, claims = [], []
    for seed in range(40):
        truth, z = simulate(seed)
        _, recorder, after = filtered(z)
        smoothed = recorder.smooth()
        pairs = [(after[step], tuple(part[0] for part in smoothed[step])) for step in range(10, 60)]
        errors.append([[x - truth[10 + step] for x, _ in pair] for step, pair in enumerate(pairs)])
        claims.append([[P[1, 1] for _, P in pair] for pair in pairs])
    found, claimed = np.square(errors).mean(axis=(0, 1)), np.mean(claims, axis=(0, 1))
    assert (found[1] < found[0]).all()
    assert claimed[1] < 0.5 * claimed[0]
    assert found[1, 1] / found[0, 1] == pytest.approx(claimed[1] / claimed[0], rel=0.28)


def test_what_is_done_again_replaces_what_was_done() -> None:
    """Going back to an epoch forgets it and all that came later."""
    _, straight, after = filtered(simulate(2)[1])
    _, back, _ = filtered(simulate(2)[1])
    one = KalmanFilter(dim_x=3, dim_z=1)
    one.F, one.Q, one.H, one.R = F, Q, H, R
    one.x, one.P = after[59]
    for step in range(60, 80):
        back.begin(step)
        one.predict()
        back.predicted(F[np.newaxis], one.x[np.newaxis], one.P[np.newaxis])
        one.update(simulate(2)[1][step])
        back.corrected(one.x[np.newaxis], one.P[np.newaxis])
    expected = straight.smooth()
    for step, (x, _) in back.smooth().items():
        np.testing.assert_allclose(x, expected[step][0], rtol=1e-9, atol=1e-12)


def test_an_epoch_of_several_steps_ends_with_its_last() -> None:
    """A receiver's error drawn anew between two updates is a step of its own, of which the last is the epoch's."""
    recorder = RtsRecorder(np.zeros((1, 1)), np.eye(1)[np.newaxis])
    one = np.ones((1, 1, 1))
    recorder.begin(0)
    recorder.predicted(one, np.zeros((1, 1)), one)
    recorder.corrected(np.full((1, 1), 0.5), 0.1 * one)
    recorder.predicted(0.0 * one, np.zeros((1, 1)), 4.0 * one)  # drawn anew, variance 4
    recorder.corrected(np.full((1, 1), 3.0), 0.2 * one)
    smoothed = recorder.smooth()
    np.testing.assert_allclose(smoothed[0][0], 3.0)
    assert RtsRecorder(np.zeros((1, 1)), one).smooth() == {}
