"""Tells whether a small machine rests, by its inertial unit and, where it has them, its wheel encoders.

At rest all axes only show their noise about a constant, the gyroscopes' constant is a bias that the filter holds
possible, and the wheels do not turn. Without encoders an even turn slower than the bias may be looks like rest: how
slow, the filter's own knowledge of its bias decides.
"""

from __future__ import annotations

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.signals import BoolArray, FloatArray


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


class RestDetector:
    """Mean and spread of six axes for R members."""

    def __init__(self, config: RestConfig, *, accel_noise_m_s2: float, gyro_noise_rad_s: float, runs: int) -> None:
        self._config = config
        self._limit = (config.noise_ratio * np.repeat([accel_noise_m_s2, gyro_noise_rad_s], 3)) ** 2
        self._mean: FloatArray | None = None
        self._square: FloatArray = np.zeros((runs, 6))
        self._quiet_s = np.zeros(runs)

    def step(
        self,
        readings: FloatArray,
        fresh: BoolArray,
        *,
        bias: FloatArray,
        bias_sigma: FloatArray,
        rolled: BoolArray,
        dt_s: float,
    ) -> BoolArray:
        """Take specific force and rate (R, 6), bias and its sigma (R, 3), members whose wheels turned (R,).

        Return who rests (R,).
        """
        config = self._config
        if self._mean is None:
            self._mean = readings.copy()
        weight = dt_s / (config.window_s + dt_s)
        off = readings - self._mean
        here = fresh[:, np.newaxis]
        self._mean = np.where(here, self._mean + weight * off, self._mean)
        # Exponentially weighted variance about the moving mean (Finch 2009).
        self._square = np.where(here, (1.0 - weight) * (self._square + weight * off * off), self._square)
        calm = np.logical_and.reduce(self._square <= self._limit, axis=1)
        unexplained = np.abs(self._mean[:, 3:] - bias)
        still = np.logical_and.reduce(unexplained <= config.bias_sigmas * bias_sigma + config.slack_rad_s, axis=1)
        quiet = calm & still & ~rolled
        self._quiet_s = np.where(fresh, np.where(quiet, self._quiet_s + dt_s, 0.0), self._quiet_s)
        return np.asarray((self._quiet_s > config.hold_s) & config.enabled)
