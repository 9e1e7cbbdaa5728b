"""Tells whether a small machine rests, by its inertial unit and, where it has them, magnetometer and wheel encoders.

At rest all axes only show their noise about a constant, the gyroscopes' constant is a bias that the filter holds
possible, and the wheels do not turn. Without encoders an even turn slower than the bias may be looks like rest: how
slow, the filter's own knowledge of its bias decides.

A reading that alone makes the spread too large is motion, and what was gathered before it says nothing of the rest that
may follow: mean and spread begin anew with it. (Left to fade, a turn of 90 deg/s would be seen in them for 8 s.)

**A bias that has changed.** A gyroscope that reads an even rate beyond its bias may turn, or its bias has changed (it
warms up, it was knocked). The magnetometer tells: its field turns along with the one and stands with the other. So the
difference between a quick and a slow mean of the field's direction is compared with that of the angle the gyroscope
claims. If the claim is large enough to be seen and the field shows less than half of it, the machine rests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.geometry import wrap_angle
from twin.signals import BoolArray, FloatArray

_QUICK_S, _SLOW_S = 0.5, 4.0
"""The two means of what is claimed and shown; a choice: 0.2 deg/s makes 0.7 deg between them."""
_SEEN_SIGMAS = 4.0
"""A claim of so many standard deviations can be seen; half of it is then two of them off, for as long as rest takes."""
_POSSIBLE_SIGMAS = 3.0
"""A change of the bias is within so many of what the data sheet grants it."""


class RestConfig(Config):
    """When a machine counts as at rest."""

    enabled: bool = True
    window_s: Positive = 0.5
    """Over which mean and spread are taken (exponentially)."""
    hold_s: NonNegative = 1.0
    """How long all signs must agree."""
    noise_ratio: Positive = 2.0
    """Largest spread, as a multiple of the sensor's noise."""
    bias_sigmas: Positive = 4.0
    """Largest mean rate beyond the bias, in standard deviations of what is known of the bias."""
    slack_rad_s: NonNegative = float(np.deg2rad(0.05))
    """Rate always granted (the bias wanders, the machine sways)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Resting:
    """What was found, for R members."""

    resting: BoolArray
    """(R,)"""
    surprise_rad_s: FloatArray
    """(R,) mean rate about z beyond what the bias was held possible of, where the field says that it rests; else 0."""
    quiet_s: FloatArray
    """(R,) for how long a surprise may have turned the heading: axes calm and wheels standing, but not yet at rest."""


class RestDetector:
    """Mean and spread of six axes for R members, and what the field says of the rate about z."""

    def __init__(
        self,
        config: RestConfig,
        *,
        accel_noise_m_s2: float,
        gyro_noise_rad_s: float,
        gyro_bias_rad_s: float,
        runs: int,
    ) -> None:
        self._config = config
        self._limit = (config.noise_ratio * np.repeat([accel_noise_m_s2, gyro_noise_rad_s], 3)) ** 2
        self._largest_rad_s = _POSSIBLE_SIGMAS * gyro_bias_rad_s
        self._mean: FloatArray | None = None
        self._square: FloatArray = np.zeros((runs, 6))
        self._quiet_s = np.zeros(runs)
        self._calm_s = np.zeros(runs)
        self._resting: BoolArray = np.zeros(runs, dtype=np.bool_)
        self._claims = _Claims(runs)

    def step(
        self,
        readings: FloatArray,
        fresh: BoolArray,
        *,
        bias: FloatArray,
        bias_sigma: FloatArray,
        rolled: BoolArray,
        dt_s: float,
        direction: tuple[FloatArray, BoolArray, FloatArray] | None = None,
    ) -> Resting:
        """Take specific force and rate (R, 6), bias and its sigma (R, 3), members whose wheels turned (R,).

        ``direction`` is that of the field in the body, (R,), where it is new, (R,), and its standard deviation, (R,).
        """
        config = self._config
        if self._mean is None:
            self._mean = readings.copy()
        weight = dt_s / (config.window_s + dt_s)
        off = readings - self._mean
        jolted = fresh & (weight * off * off > self._limit).any(axis=1)
        here = fresh[:, np.newaxis]
        self._mean = np.where(here, self._mean + weight * off, self._mean)
        # Exponentially weighted variance about the moving mean (Finch 2009).
        self._square = np.where(here, (1.0 - weight) * (self._square + weight * off * off), self._square)
        self._mean = np.where(jolted[:, np.newaxis], readings, self._mean)
        self._square = np.where(jolted[:, np.newaxis], 0.0, self._square)
        calm = ~jolted & np.logical_and.reduce(self._square <= self._limit, axis=1) & ~rolled
        self._calm_s = np.where(fresh, np.where(calm & ~self._resting, self._calm_s + dt_s, 0.0), self._calm_s)
        unexplained = self._mean[:, 3:] - bias
        within = np.abs(unexplained) <= config.bias_sigmas * bias_sigma + config.slack_rad_s
        stands = np.zeros(len(readings), dtype=np.bool_)
        if direction is not None:
            stands = self._claims.step(readings[:, 5] - bias[:, 2], *direction, calm=calm, dt_s=dt_s)
            stands &= np.abs(unexplained[:, 2]) <= self._largest_rad_s
        surprised = stands & ~within[:, 2]
        still = within[:, 0] & within[:, 1] & (within[:, 2] | stands)
        self._quiet_s = np.where(fresh, np.where(calm & still, self._quiet_s + dt_s, 0.0), self._quiet_s)
        self._resting = np.asarray((self._quiet_s > config.hold_s) & config.enabled)
        return Resting(
            resting=self._resting,
            surprise_rad_s=np.where(self._resting & surprised, unexplained[:, 2], 0.0),
            quiet_s=self._calm_s,
        )


class _Claims:
    """A quick and a slow mean of the angle that the gyroscope claims, and of the field's direction."""

    def __init__(self, runs: int) -> None:
        self._claimed: FloatArray = np.zeros(runs)
        self._last: FloatArray = np.full(runs, np.nan)
        self._shown: FloatArray = np.zeros(runs)
        self._between: FloatArray = np.zeros((2, 2, runs))

    def step(
        self,
        rate: FloatArray,
        direction: FloatArray,
        new: BoolArray,
        sigma: FloatArray,
        *,
        calm: BoolArray,
        dt_s: float,
    ) -> BoolArray:
        """Whether the field shows that what the gyroscope claims is none, (R,)."""
        self._claimed = np.where(calm, self._claimed + rate * dt_s, 0.0)
        # A body that turns to the left sees the field turn to the right.
        moved = np.where(new & ~np.isnan(self._last), wrap_angle(direction - self._last), 0.0)
        self._shown = np.where(calm, self._shown - moved, 0.0)
        self._last = np.where(new, direction, self._last)
        angles = np.stack([self._claimed, self._shown])
        weights = np.array([dt_s / (_QUICK_S + dt_s), dt_s / (_SLOW_S + dt_s)])
        self._between = self._between + weights[:, np.newaxis, np.newaxis] * (angles - self._between)
        self._between = np.where(calm, self._between, 0.0)
        claim, shown = np.abs(self._between[0] - self._between[1])
        noise = sigma * np.sqrt(0.5 * weights[0])
        return np.asarray(calm & (claim >= _SEEN_SIGMAS * noise) & (shown <= 0.5 * claim))
