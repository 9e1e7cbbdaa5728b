"""Both engines of the IMM against each other and against the textbook, and fixes far from every mode."""

from __future__ import annotations

import numpy as np
import pytest

from twin.estimators.imm_engine import EnsembleImm, ModeMotion, Modes, make_imm, mixed, weighed

H = np.array([[[1.0, 0.0]], [[1.0, 0.3]]])


def random_modes(rng: np.random.Generator, runs: int) -> Modes:
    root = rng.standard_normal((runs, 2, 2, 2))
    return Modes(
        rng.standard_normal((runs, 2, 2)), root @ root.swapaxes(-1, -2) + 0.1 * np.eye(2), rng.dirichlet([1, 1], runs)
    )


def random_motion(rng: np.random.Generator, runs: int) -> ModeMotion:
    root = rng.standard_normal((2, runs, 2, 2))
    F = np.eye(2) + 0.2 * rng.standard_normal((2, runs, 2, 2))
    return ModeMotion(F, 0.1 * root @ root.swapaxes(-1, -2), rng.dirichlet([2, 1], (runs, 2)))


def test_engines_agree() -> None:
    rng = np.random.default_rng(1)
    start = random_modes(rng, 1)
    own, theirs = make_imm("ensemble", H, start), make_imm("filterpy", H, start)
    for k in range(300):
        motion, z, R = random_motion(rng, 1), 3.0 * rng.standard_normal((1, 1)), rng.uniform(0.1, 2.0, (1, 1))
        mask = np.array([k % 7 != 0])
        for engine in (own, theirs):
            engine.predict(motion)
            engine.update(z, R, mask)
        for one, other in zip((own.modes.x, own.modes.P, own.modes.mu), _of(theirs.modes), strict=True):
            assert one == pytest.approx(other, abs=1e-9, rel=1e-9)


def _of(modes: Modes):
    return modes.x, modes.P, modes.mu


def test_members_are_alone() -> None:
    rng = np.random.default_rng(2)
    start, motion = random_modes(rng, 5), random_motion(rng, 5)
    z, R, mask = rng.standard_normal((5, 1)), np.ones((5, 1)), np.array([True, False, True, True, False])
    together = EnsembleImm(H, start)
    together.predict(motion)
    together.update(z, R, mask)
    for i in range(5):
        part = slice(i, i + 1)
        alone = EnsembleImm(H, Modes(*(each[part] for each in _of(start))))
        alone.predict(ModeMotion(motion.F[:, part], motion.Q[:, part], motion.M[part]))
        alone.update(z[part], R[part], mask[part])
        for one, other in zip(_of(alone.modes), _of(together.modes), strict=True):
            assert one[0] == pytest.approx(other[i], abs=1e-12)


def test_nothing_moves_over_no_time() -> None:
    rng = np.random.default_rng(3)
    start = random_modes(rng, 4)
    still = ModeMotion(np.tile(np.eye(2), (2, 4, 1, 1)), np.zeros((2, 4, 2, 2)), np.tile(np.eye(2), (4, 1, 1)))
    engine = EnsembleImm(H, start)
    engine.predict(still)
    for one, other in zip(_of(engine.modes), _of(start), strict=True):
        assert one == pytest.approx(other, abs=1e-14)


def test_mixing_by_hand() -> None:
    # mu = (0.8, 0.2), M = [[0.9, 0.1], [0.3, 0.7]]: c = (0.78, 0.22), w_.2 = (0.08, 0.14) / 0.22
    modes = Modes(
        np.array([[[0.0, 0.0], [1.0, 0.0]]]), np.tile(np.diag([1.0, 2.0]), (1, 2, 1, 1)), np.array([[0.8, 0.2]])
    )
    out = mixed(modes, np.array([[[0.9, 0.1], [0.3, 0.7]]]))
    share = 0.14 / 0.22
    assert out.mu[0] == pytest.approx([0.78, 0.22])
    assert out.x[0, 1] == pytest.approx([share, 0.0])
    assert out.P[0, 1] == pytest.approx(np.diag([1.0 + share * (1.0 - share), 2.0]))


def test_mean_and_spread_of_the_mixture_are_those_of_samples() -> None:
    rng = np.random.default_rng(4)
    modes = random_modes(rng, 1)
    which = rng.random(400_000) < modes.mu[0, 1]
    drawn = [rng.multivariate_normal(modes.x[0, j], modes.P[0, j], len(which)) for j in range(2)]
    samples = np.where(which[:, np.newaxis], drawn[1], drawn[0])
    x, P = modes.mean()
    assert x[0] == pytest.approx(samples.mean(axis=0), abs=0.02)
    assert P[0] == pytest.approx(np.cov(samples.T), rel=0.02, abs=0.02)


def test_fix_far_from_both_modes_still_compares_them() -> None:
    mu = weighed(np.array([[0.5, 0.5]]), np.array([[-1e6, -1e6 + 3.0]]))
    assert mu[0, 1] == pytest.approx(1.0 / (1.0 + np.exp(-3.0)))
    lost = weighed(np.array([[0.5, 0.5]]), np.array([[-1e6, 0.0]]))
    assert 0.0 < lost[0, 0] < 1e-9


@pytest.mark.parametrize("name", ["filterpy", "ensemble"])
def test_far_fix_breaks_no_engine(name: str) -> None:
    modes = Modes(np.zeros((1, 2, 2)), np.tile(np.diag([1.0, 1.0]), (1, 2, 1, 1)), np.array([[0.5, 0.5]]))
    engine = make_imm(name, H, modes)  # type: ignore[arg-type]
    motion = ModeMotion(np.tile(np.eye(2), (2, 1, 1, 1)), np.zeros((2, 1, 2, 2)), np.full((1, 2, 2), 0.5))
    engine.predict(motion)
    engine.update(np.array([[1e5]]), np.ones((1, 1)), np.array([True]))
    # the second mode expects more spread (S = 2.09 against 2): it explains the fix better
    assert engine.modes.mu[0, 1] == pytest.approx(1.0)
    assert np.isfinite(engine.modes.x).all()


def test_filterpy_steps_one_run() -> None:
    with pytest.raises(ValueError, match="steps one run, not 2"):
        make_imm("filterpy", H, random_modes(np.random.default_rng(0), 2))
