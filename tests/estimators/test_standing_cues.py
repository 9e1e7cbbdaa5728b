"""Standstill by several cues: how soon, how surely, and what speaks against it."""

import numpy as np
import pytest

from twin.estimators.inertial_array import Fused
from twin.estimators.standing_cues import StandingCues
from twin.signals import FloatArray

STEP_S = 0.02
ACCEL, GYRO = 0.11, 5e-4
"""Noise of four row units' mean."""


def fused(u: FloatArray) -> Fused:
    runs = len(u)
    return Fused(u=u, accel_variance=np.full(runs, ACCEL**2), gyro_variance=np.full(runs, GYRO**2))


def noise(rng: np.random.Generator, runs: int) -> FloatArray:
    return rng.normal(size=(runs, 6)) * np.repeat([ACCEL, GYRO], 3) + [0.3, 0.0, 9.8, 0.01, 0.0, -0.02]


def told(cues: StandingCues, index: int, sample: Fused, *, slow: bool = True) -> FloatArray:
    cues.inertial(sample)
    return cues.standing(index, sample, np.full(len(sample.u), slow))


def test_standing_is_seen_within_a_second_and_hardly_ever_missed() -> None:
    """Gyroscopes: the mean square of three axes over 0.5 s is a chi-square of some 150 degrees; 4 sigma above it is
    passed with a probability of about 3e-4. Accelerometers: three axes at 4 sigma, 2e-4. Together less than 1e-3 of
    the time."""
    rng, cues = np.random.default_rng(1), StandingCues(step_s=STEP_S, runs=200)
    said = np.array([told(cues, index, fused(noise(rng, 200))) for index in range(1500)])
    assert not said[:20].any()  # nothing is said before there is something to say
    assert said[50:].mean() > 0.999
    assert said[49].mean() > 0.99


def test_a_smooth_start_is_seen_within_a_quarter_of_a_second() -> None:
    """0.5 m/s^2 without any shaking, every speed still below what sensors show: the push is 0.5 (1 - e^{-t/0.15}),
    after 0.25 s 0.41 less 0.06 of the mean, against a limit of 4 sqrt(0.0714 + 0.005) 0.11 = 0.12 m/s^2 and 0.03 of
    noise: seven sigma."""
    runs, rng = 500, np.random.default_rng(2)
    cues = StandingCues(step_s=STEP_S, runs=runs)
    cues.speed("radar", 0, 1e9, slow=np.ones(runs, dtype=bool), known=np.ones(runs, dtype=bool))
    for index in range(300):
        told(cues, index, fused(noise(rng, runs)))
    push = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    said = [told(cues, 300 + step, fused(noise(rng, runs) + push)) for step in range(13)]
    assert not said[-1].any()


def test_shaking_and_turning_speak_against_standing() -> None:
    rng = np.random.default_rng(3)
    for swing in (np.array([0, 0, 0, 1.0, 1.0, 0]) * 1.5e-3, np.array([0, 0, 0, 0, 0, 0.05])):
        cues = StandingCues(step_s=STEP_S, runs=50)
        for index in range(200):
            told(cues, index, fused(noise(rng, 50)))
        said = np.zeros(50)
        for step in range(50):
            rocking = swing * (np.sqrt(2.0) * np.sin(0.4 * step) if swing[5] == 0 else 1.0)
            said = told(cues, 200 + step, fused(noise(rng, 50) + rocking))
        assert not said.any()


def speed(
    cues: StandingCues, sensor: str, index: int, slow: object, *, known: object = True, patience: float = 5.0
) -> None:
    cues.speed(sensor, index, patience, slow=np.atleast_1d(slow), known=np.atleast_1d(known))


def calm(rng: np.random.Generator, runs: int) -> StandingCues:
    cues = StandingCues(step_s=STEP_S, runs=runs)
    for index in range(100):
        told(cues, index, fused(noise(rng, runs)))
    return cues


def test_one_speed_that_is_not_slow_is_enough_and_holds_for_its_patience() -> None:
    """A dead radar says slow for ever; a GNSS speed speaks against it, as long as it may be believed."""
    cues, sample = calm(np.random.default_rng(4), 1), fused(noise(np.random.default_rng(5), 1))
    nobody = np.zeros(1, dtype=bool)
    assert not cues.standing(100, sample, nobody)[0]  # neither a sensor nor the filter says slow
    speed(cues, "radar", 100, True)
    assert cues.standing(100, sample, nobody)[0]
    speed(cues, "gnss", 100, False, patience=25.0)
    speed(cues, "radar", 125, True)
    assert not cues.standing(125, sample, nobody)[0]
    assert cues.standing(126, sample, nobody)[0]  # the GNSS is silent for too long
    assert not cues.standing(131, sample, nobody)[0]  # the radar too
    assert cues.standing(131, sample, ~nobody)[0]  # then the filter's own word counts


def test_a_member_that_misses_a_sample_goes_on_with_what_it_heard_before() -> None:
    """As the same run alone does, in which nothing arrives at all."""
    rng = np.random.default_rng(6)
    cues, sample, nobody = calm(rng, 2), fused(noise(rng, 2)), np.zeros(2, dtype=bool)
    speed(cues, "radar", 100, [True, False])
    speed(cues, "radar", 101, [False, False], known=[False, False])
    np.testing.assert_array_equal(cues.standing(101, sample, nobody), [True, False])
    speed(cues, "radar", 104, [False, True], known=[False, True])
    np.testing.assert_array_equal(cues.standing(105, sample, nobody), [True, True])
    np.testing.assert_array_equal(cues.standing(106, sample, nobody), [False, True])


@pytest.mark.parametrize("rate_hz", [0.5, 1.0, 5.0, 10.0, 100.0])
def test_any_rate_of_the_units_will_do(rate_hz: float) -> None:
    rng, cues = np.random.default_rng(7), StandingCues(step_s=1.0 / rate_hz, runs=100)
    said = np.array([told(cues, index, fused(noise(rng, 100))) for index in range(200)])
    assert said[max(3, round(rate_hz)) :].mean() > 0.9
