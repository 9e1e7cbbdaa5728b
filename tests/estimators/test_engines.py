"""Two engines, one model: equal to rounding, and both a correct Kalman filter."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.stats import chi2

from twin.estimators.coordinated_turn import AntennaPosition, CoordinatedTurn, ForwardSpeed, YawRate
from twin.estimators.engines import EnsembleEngine, innovation, make_engine

Q = np.array([1e-5, 1e-5, 1e-4, 1e-8, 1e-8])
MODEL = CoordinatedTurn(process_variances=tuple(Q), step_s=0.02)
GYRO, RADAR = YawRate(1e-6), ForwardSpeed(0.1, left_m=0.3)
ANTENNA = AntennaPosition(0.1, forward_m=0.4, left_m=0.3)
P0 = np.diag([0.01, 0.01, 1e-4, 4e-4, 1e-6])


def start(runs: int) -> tuple[np.ndarray, np.ndarray]:
    x = np.tile([[5.0, -3.0, 2.0, 3.1, 0.1]], (runs, 1))
    return x, np.tile(P0, (runs, 1, 1))


def drive(engine, choose, steps: int, seed: int = 0) -> tuple[list, list]:
    """A long random sequence with masks, NaN and a gate; ``choose`` takes the engine's members of seven."""
    rng = np.random.default_rng(seed)
    history, decisions = [], []
    for step in range(steps):
        u, noise = rng.normal(size=7), rng.normal(size=(7, 4))
        masks = rng.random((3, 7)) > 0.2
        engine.predict(MODEL, choose(u), 0.02 if step % 50 else 0.1)
        z = choose(0.1 + 1e-3 * noise[:, :1])
        engine.update(GYRO, z, choose(masks[0]))
        radar = 2.0 + 0.3 * noise[:, 1:2]
        radar[~masks[1]] = np.nan
        radar[step % 7] += 3.0 * (step % 11 == 0)
        z = choose(radar)
        gate = choose(masks[1]) & (innovation(engine, RADAR, z).nis <= 4.0)
        decisions.append(gate)
        nis = engine.update(RADAR, z, gate)
        if step % 5 == 0:
            reported = choose(np.exp(noise[:, :2]))  # variances (R, 2) that differ from member to member
            z = choose(np.array([5.0, -3.0]) + noise[:, 2:])
            nis = engine.update(ANTENNA, z, choose(masks[2]), reported)
        history.append((engine.x.copy(), engine.P.copy(), nis))
    return history, decisions


def assert_equal_enough(a: np.ndarray, b: np.ndarray) -> None:
    assert np.all(np.abs(a - b) <= 1e-9 * (1.0 + np.abs(a)))


@pytest.mark.parametrize("member", [0, 3])
def test_filterpy_equals_a_member_of_the_ensemble(member: int) -> None:
    many, chosen = drive(EnsembleEngine(*start(7)), lambda a: a, 2000)
    one, alone = drive(make_engine("filterpy", *start(1)), lambda a: a[member : member + 1], 2000)
    rejected = 0
    for (x, P, nis), (x1, P1, nis1), gate, gate1 in zip(many, one, chosen, alone, strict=True):
        assert_equal_enough(x1[0], x[member])
        assert_equal_enough(P1[0], P[member])
        np.testing.assert_allclose(nis1[0], nis[member], rtol=1e-9, atol=1e-9)
        assert gate[member] == gate1[0]
        rejected += not gate1[0]
    assert rejected > 400  # about 20 % lost and 5 % gated of 2000: the gate and the masks were at work


def test_one_run_ensemble_equals_a_member() -> None:
    many, _ = drive(EnsembleEngine(*start(7)), lambda a: a, 500)
    one, _ = drive(EnsembleEngine(*start(1)), lambda a: a[5:6], 500)
    for (x, P, _), (x1, P1, _) in zip(many, one, strict=True):
        assert_equal_enough(x1[0], x[5])
        assert_equal_enough(P1[0], P[5])


def test_filterpy_engine_equals_filterpys_own_extended_filter() -> None:
    engine = make_engine("filterpy", *start(1))
    oracle = ExtendedKalmanFilter(5, 1)
    oracle.x, oracle.P = start(1)[0][0], P0.copy()
    rng = np.random.default_rng(3)
    for _ in range(300):
        u = rng.normal(size=1)
        engine.predict(MODEL, u, 0.02)
        x = oracle.x[np.newaxis]
        moved, F = MODEL.linearise(x, u, 0.02)
        oracle.F, oracle.Q = F[0], MODEL.Q(0.02)
        oracle.P = oracle.F @ oracle.P @ oracle.F.T + oracle.Q
        oracle.x = moved[0]
        for seen, z in ((GYRO, rng.normal(size=1)), (ANTENNA, rng.normal(size=2))):
            engine.update(seen, z[np.newaxis], np.array([True]))
            oracle.update(
                z,
                lambda at, seen=seen: seen.H(at[np.newaxis]).reshape(-1, 5),
                lambda at, seen=seen: seen.h(at[np.newaxis])[0],
                R=np.diag(seen.R),
            )
        assert_equal_enough(oracle.x, engine.x[0])
        assert_equal_enough(oracle.P, engine.P[0])


@pytest.mark.parametrize("name", ["filterpy", "ensemble"])
def test_a_masked_update_changes_no_bit(name) -> None:
    engine = make_engine(name, *start(1))
    engine.predict(MODEL, np.zeros(1), 0.02)
    x, P = engine.x.copy(), engine.P.copy()
    engine.update(RADAR, np.array([[np.nan]]), np.array([False]))
    engine.update(ANTENNA, np.array([[np.inf, np.nan]]), np.array([False]))
    assert np.array_equal(engine.x, x)
    assert np.array_equal(engine.P, P)


@pytest.mark.parametrize(("name", "runs"), [("filterpy", 1), ("ensemble", 7)])
def test_covariance_stays_symmetric_and_positive(name, runs: int) -> None:
    history, _ = drive(make_engine(name, *start(runs)), lambda a: a[:runs], 1500, seed=5)
    for _, P, _ in history[::25]:
        scale = np.sqrt(np.einsum("rii->ri", P))
        correlation = P / scale[:, :, np.newaxis] / scale[:, np.newaxis, :]
        assert np.abs(correlation - correlation.swapaxes(1, 2)).max() < 1e-10
        assert np.linalg.eigvalsh(correlation).min() > -1e-12


@pytest.mark.parametrize("name", ["filterpy", "ensemble"])
@pytest.mark.parametrize("R", [None, np.array([0.3, 0.7]), np.array([[0.3, 0.7]])])
def test_an_update_tells_the_innovation_that_gates_look_at(name, R) -> None:
    engine = make_engine(name, *start(1))
    engine.predict(MODEL, np.zeros(1), 0.02)
    z = np.array([[5.7, -2.1]])
    expected = innovation(engine, ANTENNA, z, R).nis
    np.testing.assert_allclose(engine.update(ANTENNA, z, np.array([True]), R), expected, rtol=1e-12)
    assert np.isnan(engine.update(ANTENNA, z, np.array([False]), R)).all()


@pytest.mark.parametrize("name", ["filterpy", "ensemble"])
def test_updates_of_equal_gyros_come_to_one_by_their_mean(name) -> None:
    """Same H, independent errors: information adds up, so k updates are one with the mean and R / k."""
    apart, at_once = make_engine(name, *start(1)), make_engine(name, *start(1))
    rates, everyone = np.array([0.11, 0.102, 0.097, 0.12]), np.array([True])
    for _ in range(50):
        for engine in (apart, at_once):
            engine.predict(MODEL, np.zeros(1), 0.02)
        for rate in rates:
            apart.update(GYRO, np.array([[rate]]), everyone)
        at_once.update(GYRO, np.array([[rates.mean()]]), everyone, GYRO.R / 4)
    assert_equal_enough(apart.x, at_once.x)
    assert_equal_enough(apart.P, at_once.P)
    assert np.abs(apart.P[0, 4, 4] / at_once.P[0, 4, 4] - 1.0) < 1e-9


def test_filterpy_engine_refuses_an_ensemble() -> None:
    with pytest.raises(ValueError, match="one run, not 7"):
        make_engine("filterpy", *start(7))


def test_consistent_with_data_of_its_own_model() -> None:
    """NEES and NIS over 200 independent worlds drawn from the model (its Q, its R, its P0).

    The sum over the worlds is chi-square with 200 n degrees of freedom. Four statistics are tested at a two-sided
    error of 1e-3 each. The model is nearly linear over the 4 s driven.
    """
    worlds, steps = 200, 200
    rng = np.random.default_rng(11)
    x, P = start(worlds)
    truth = x + rng.multivariate_normal(np.zeros(5), P0, size=worlds)
    engine = EnsembleEngine(x, P)
    everyone = np.ones(worlds, dtype=bool)
    low, high = 5e-4, 1.0 - 5e-4
    nis = {}
    for _ in range(steps):
        u = rng.normal(size=worlds)
        truth = MODEL.linearise(truth, u, 0.02)[0] + rng.normal(size=(worlds, 5)) * np.sqrt(Q)
        engine.predict(MODEL, u, 0.02)
        for name, seen in (("gyro", GYRO), ("radar", RADAR), ("antenna", ANTENNA)):
            z = seen.h(truth) + rng.normal(size=(worlds, len(seen.R))) * np.sqrt(seen.R)
            nis.setdefault(name, []).append(engine.update(seen, z, everyone))
    error = truth - engine.x
    nees = np.einsum("ri,rij,rj->r", error, np.linalg.inv(engine.P), error).sum()
    assert chi2.ppf(low, 5 * worlds) < nees < chi2.ppf(high, 5 * worlds)
    for name, m in (("gyro", 1), ("radar", 1), ("antenna", 2)):
        total = np.sum(nis[name])  # innovations of a consistent filter are white: all steps count
        dof = m * worlds * steps
        assert chi2.ppf(low, dof) < total < chi2.ppf(high, dof), name
