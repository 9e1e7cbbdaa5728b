"""The bound on pass-to-pass error: its limits, which are known without it, and a filter that meets it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from twin.scoring.guidance_bound import GuidanceErrors, PassPlan, guidance_bound

PLAN = PassPlan(length_m=50.0, spacing_m=4.0, speed_m_s=1.1)
ERRORS = GuidanceErrors(
    slow_m=2.12,
    slow_s=1200.0,
    velocity_m_s=0.1,
    gyro_rad_rts=6e-4,
    gyro_bias_rad_s=0.005,
    gyro_bias_walk_rad_s_rts=2.4e-5,
    gyro_scale_ratio=0.003,
    speed_scale_ratio=0.02,
    walk_m_rtm=0.001,
    forward_m=1.5,
)


def test_times_of_the_passes() -> None:
    """A pass of 50 m takes 45.45 s, the half circle of 2 m radius 5.71 s; the far end is passed again at once."""
    np.testing.assert_allclose(PLAN.time_s(0, np.array([0.0, 50.0])), [5.0, 5.0 + 50.0 / 1.1])
    np.testing.assert_allclose(np.diff(PLAN.time_s(1, np.array([50.0, 0.0]))), 50.0 / 1.1)
    assert PLAN.begin_s(1) - PLAN.time_s(0, np.array([50.0]))[0] == pytest.approx(2.0 * math.pi / 1.1)
    middle = PLAN.begin_s(1) - 0.5 * PLAN.turn_s
    assert PLAN.motion(middle)[1] == pytest.approx(math.pi / 2)
    assert PLAN.motion(PLAN.begin_s(1) + 1.0) == (1.1, math.pi, 0.0)


def test_the_receiver_alone() -> None:
    """2 sigma^2 (1 - exp(-t / tau)), for short lags the random walk 2 sigma^2 t / tau."""
    bound = guidance_bound(replace(ERRORS, white_m=1e-6), PLAN)
    walk = np.sqrt(2.0 * 2.12**2 * bound.lag_s / 1200.0)
    np.testing.assert_allclose(bound.receiver_m, walk, rtol=0.02)


def test_perfect_wheels_and_gyro_leave_nothing() -> None:
    """Where the machine went is known exactly, and so is the place of one pass beside the other."""
    exact = GuidanceErrors(slow_m=2.12, slow_s=1200.0, gyro_rad_rts=1e-9, start_heading_rad=1e-9)
    assert guidance_bound(exact, PLAN).rms_m < 1e-6


def test_useless_wheels_leave_the_receiver() -> None:
    """If the machine may be anywhere a second later, only two fixes tell, each with its own error."""
    blind = replace(ERRORS, walk_m_rtm=100.0, velocity_m_s=None, forward_m=0.0)
    bound = guidance_bound(blind, PLAN)
    np.testing.assert_allclose(bound.sigma_m, bound.receiver_m, rtol=0.02)


def test_a_constant_error_is_none() -> None:
    bound = guidance_bound(replace(ERRORS, slow_s=1e9), PLAN)
    assert bound.rms_m < 0.1
    assert bound.receiver_rms_m == pytest.approx(0.05 * math.sqrt(2.0), rel=0.05)


def test_less_is_known_without_each_sensor() -> None:
    """Each sensor that is taken away makes it worse, and never worse than the receiver alone."""
    whole = guidance_bound(ERRORS, PLAN)
    without = [
        guidance_bound(replace(ERRORS, velocity_m_s=None), PLAN),
        guidance_bound(replace(ERRORS, gyro_rad_rts=None), PLAN),
    ]
    neither = guidance_bound(replace(ERRORS, velocity_m_s=None, gyro_rad_rts=None), PLAN)
    for each in without:
        assert whole.rms_m < each.rms_m < neither.rms_m
    assert neither.rms_m < neither.receiver_rms_m


def test_simulated_filters_are_as_good_as_it_says() -> None:
    """A straight line and back in one dimension, solved at once.

    Gyro and wheels are exact but for white noise of the way across, the receiver has a slow error: all is one linear
    Gaussian problem, whose posterior covariance needs no recursion.
    """
    plan = PassPlan(length_m=20.0, spacing_m=2.0, speed_m_s=1.0, stand_s=0.0)
    errors = GuidanceErrors(
        slow_m=2.0, slow_s=300.0, white_m=0.1, gyro_rad_rts=1e-9, start_heading_rad=1e-9, walk_m_rtm=0.2
    )
    stations = np.linspace(0.2, 0.95, 4) * 20.0
    early = np.round(plan.time_s(0, stations)).astype(int)
    late = np.round(plan.time_s(1, stations)).astype(int)
    expected = []
    for begin, end in zip(early, late, strict=True):
        t = np.arange(1, end + 1)
        speed = 1.0
        places = 1e6 + 0.2**2 * speed * np.minimum.outer(t, t)
        slow = 4.0 * np.exp(-np.abs(np.subtract.outer(t, t)) / 300.0)
        seen = places + slow + 0.01 * np.eye(end)
        pick = np.zeros(end)
        pick[end - 1], pick[begin - 1] = 1.0, -1.0
        prior = pick @ places @ pick
        gain = places @ pick
        expected.append(math.sqrt(prior - gain @ np.linalg.solve(seen, gain)))
    np.testing.assert_allclose(guidance_bound(errors, plan, stations=4).sigma_m, expected, rtol=1e-3)


def test_pairs_in_order() -> None:
    with pytest.raises(ValueError, match="later one last"):
        guidance_bound(ERRORS, replace(PLAN, pair=(1, 1)))
