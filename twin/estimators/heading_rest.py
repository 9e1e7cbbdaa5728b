"""Tells whether a small machine rests, by its inertial unit and, where it has them, magnetometer and wheel encoders.

At rest all axes only show their noise about a constant, the gyroscopes' constant is a bias that the filter holds
possible, and the wheels do not turn. Without encoders an even turn slower than the bias may be looks like rest: how
slow, the filter's own knowledge of its bias decides.

A reading that alone makes the spread too large is motion, and what was gathered before it says nothing of the rest that
may follow: mean and spread begin anew with it. (Left to fade, a turn of 90 deg/s would be seen in them for 8 s.)

**A bias that has changed.** A gyroscope that reads an even rate beyond its bias may turn, or its bias has changed (it
warms up, it was knocked). The magnetometer tells: its field turns along with the one and stands with the other. So a
line is laid through the last seconds of the field's direction, and one through the angle that the gyroscope claims. If
its claim is steep enough to be seen and the field shows less than half of it, the machine rests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.geometry import wrap_angle
from twin.signals import BoolArray, FloatArray

_MEMORY_S = 4.0
"""Over which the lines are laid (exponentially); a choice: a compass of 1 deg tells 0.07 deg/s then."""
_SILENT_S = 0.5
"""Without a field for so long nothing is compared."""
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
    """Lines through the angle that the gyroscope claims and the one that the field shows, by weighted least squares.

    Time counts back from now, so that the moments of the samples' times and angles are moved on with every step; old
    samples fade. Each is of shape (R,) or, of both angles, (2, R).
    """

    def __init__(self, runs: int) -> None:
        self._angles: FloatArray = np.zeros((2, runs))
        self._last: FloatArray = np.full(runs, np.nan)
        self._silent_s: FloatArray = np.zeros(runs)
        self._moments: FloatArray = np.zeros((3, runs))
        """Sums of 1, t and t^2."""
        self._products: FloatArray = np.zeros((2, 2, runs))
        """Sums of y and t y."""

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
        self._silent_s = np.where(new, 0.0, self._silent_s + dt_s)
        going = calm & (self._silent_s < _SILENT_S)
        # A body that turns to the left sees the field turn to the right.
        shown = -np.where(new & ~np.isnan(self._last), wrap_angle(direction - self._last), 0.0)
        self._last = np.where(new, direction, self._last)
        self._angles = np.where(going, self._angles + np.stack([rate * dt_s, shown]), 0.0)
        self._fade(dt_s)
        self._moments[0] += new
        self._products[0] += np.where(new, self._angles, 0.0)
        self._moments = np.where(going, self._moments, 0.0)
        self._products = np.where(going, self._products, 0.0)
        (count, first, second), (sums, crossed) = self._moments, self._products
        spread = count * second - first * first
        seen = spread > 1e-9
        spread = np.where(seen, spread, 1.0)
        claim, show = np.abs((count * crossed - first * sums) / spread)
        return np.asarray(
            seen & going & (claim >= _SEEN_SIGMAS * sigma * np.sqrt(count / spread)) & (show <= 0.5 * claim)
        )

    def _fade(self, dt_s: float) -> None:
        """Move the samples' times back by a step, and let them fade."""
        count, first, second = self._moments
        kept = np.exp(-dt_s / _MEMORY_S)
        self._moments = kept * np.stack([count, first - dt_s * count, second - 2.0 * dt_s * first + dt_s**2 * count])
        sums, crossed = self._products
        self._products = kept * np.stack([sums, crossed - dt_s * sums])
