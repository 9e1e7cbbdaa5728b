"""Hampel filters: what they take for outliers, what they let pass, what they do to motion."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.bench import STEP_S, WHITE_M_S2, motions
from twin.estimators.hampel import OutlierFilter, PublishedHampel, RobustHampel
from twin.signals import BoolArray, FloatArray


def through(
    filter_: OutlierFilter, samples: FloatArray, fresh: BoolArray | None = None
) -> tuple[FloatArray, BoolArray]:
    """What comes out (T, R) and which samples were replaced (T, R)."""
    every = np.ones(samples.shape, dtype=bool) if fresh is None else fresh
    given, replaced = [], []
    for sample, there in zip(samples, every, strict=True):
        given.append(filter_.step(sample, there))
        replaced.append(filter_.replaced.copy())
    return np.array(given), np.array(replaced)


def white(count: int, runs: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((count, runs))


# --- as published ----------------------------------------------------------------------------------------------------


def test_published_is_eqs_1_to_3() -> None:
    samples = white(200, 3)
    expected = samples.copy()
    for k in range(3, 200):
        window = samples[k - 3 : k]
        beyond = np.abs(samples[k] - np.mean(window, axis=0)) > 3.0 * np.std(window, axis=0)  # numpy divides by n too
        expected[k] = np.where(beyond, np.mean(window, axis=0), samples[k])
    given, replaced = through(PublishedHampel(3), samples)
    np.testing.assert_allclose(given, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(replaced, given != samples)


def test_published_throws_away_a_sixth_of_good_white_samples() -> None:
    """Student's t with two degrees of freedom has the distribution function 1/2 + t / (2 sqrt(2 + t^2))."""
    at = 3.0 / np.sqrt(2.0)
    expected = 1.0 - at / np.sqrt(2.0 + at**2)
    assert expected == pytest.approx(0.168, abs=5e-4)
    # The same from scratch: four fresh normal numbers at a time, so that windows do not overlap.
    four = white(4, 400_000, seed=1)
    beyond = np.abs(four[3] - four[:3].mean(axis=0)) > 3.0 * four[:3].std(axis=0)
    assert beyond.mean() == pytest.approx(expected, abs=4.0 * np.sqrt(0.168 * 0.832 / 400_000))
    _, replaced = through(PublishedHampel(1000), white(403, 1000, seed=2))
    assert replaced[3:].mean() == pytest.approx(expected, abs=0.003)


# --- robust ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [0.0, 1.0])
def test_robust_passes_good_white_samples(known: float) -> None:
    """At most 0.5 %, whether the sensor's noise is known or not."""
    _, replaced = through(RobustHampel(noise=known, runs=500), white(1000, 500))
    assert replaced.mean() <= 0.005


def test_robust_catches_outliers_while_standing() -> None:
    """At twenty standard deviations of the noise: the limit is at 4.5 x 1.2 of them, give or take a quarter."""
    samples = white(2000, 100)
    rng = np.random.default_rng(5)
    wild = rng.random(samples.shape) < 0.01
    wild[:30] = False
    samples[wild] = 20.0 * rng.choice([-1.0, 1.0], wild.sum()) + samples[wild]
    given, replaced = through(RobustHampel(noise=1.0, runs=100), samples)
    # One that follows another on the same side passes for motion: one in 200 of them.
    assert replaced[wild].mean() > 0.985
    assert replaced[~wild].mean() < 0.005
    assert np.abs(given[replaced & wild]).max() < 5.0  # what stands for it is a good sample


def test_robust_catches_outliers_of_a_plate_in_motion() -> None:
    """At 50 Hz the acceleration of a hand's strokes changes by 0.2 m/s^2 between samples, at most."""
    _, speed = motions(30.0, stand_s=2.0, runs=40, seed=1)
    samples = np.diff(speed, axis=0) / STEP_S + WHITE_M_S2 * white(len(speed) - 1, 40)
    rng = np.random.default_rng(6)
    wild = rng.random(samples.shape) < 0.002
    wild[:100] = False
    spoilt = samples + np.where(wild, 5.0 * rng.choice([-1.0, 1.0], samples.shape), 0.0)
    given, replaced = through(RobustHampel(noise=WHITE_M_S2, runs=40), spoilt)
    assert replaced[wild].mean() > 0.95
    assert np.sqrt(((given - samples)[wild] ** 2).mean()) < 0.2 * 5.0


def test_robust_loses_no_velocity_at_a_start() -> None:
    """A step of the acceleration is withheld once and given back: its sum is whole after two samples."""
    samples = np.concatenate([np.zeros(50), np.full(10, 1.0)])[:, np.newaxis] + 1e-3 * white(60, 20)
    given, replaced = through(RobustHampel(noise=1e-3, runs=20), samples)
    assert replaced[50].all()
    assert not replaced[51:].any()
    np.testing.assert_allclose(given[50:].sum(axis=0), samples[50:].sum(axis=0), atol=1e-12)


def test_on_strokes_of_a_hand_robust_keeps_the_velocity_and_published_does_not() -> None:
    """Position of the plate from the acceleration twice integrated over 10 s, against that of the true one."""
    _, speed = motions(12.0, stand_s=2.0, runs=200, seed=3)
    samples = np.diff(speed, axis=0) / STEP_S + WHITE_M_S2 * white(len(speed) - 1, 200)

    def drift(filter_: OutlierFilter) -> float:
        error = through(filter_, samples)[0] - samples
        return float(np.sqrt((STEP_S * np.cumsum(error, axis=0)[-1] ** 2).mean()))

    published, robust = drift(PublishedHampel(200)), drift(RobustHampel(noise=WHITE_M_S2, runs=200))
    assert robust < 0.1 * published


@pytest.mark.parametrize("make", [PublishedHampel, lambda runs: RobustHampel(noise=0.5, runs=runs)])
def test_a_member_sees_only_its_own_samples(make) -> None:
    """Where samples are lost, what comes out of the others is what a stream without the lost ones gives."""
    samples = white(300, 4, seed=8)
    fresh = np.random.default_rng(9).random(samples.shape) > 0.2
    samples[~fresh] = np.nan
    given, replaced = through(make(4), samples, fresh)
    assert not replaced[~fresh].any()
    for run in range(4):
        mine = fresh[:, run]
        alone, alone_replaced = through(make(1), samples[mine, run : run + 1])
        np.testing.assert_array_equal(given[mine, run], alone[:, 0])
        np.testing.assert_array_equal(replaced[mine, run], alone_replaced[:, 0])
