"""The filter inside a GNSS receiver that smooths its positions before it tells them.

Low-cost receivers run a Kalman filter of their own, and what its model does not hold comes out wrong. Paper 004 finds
the curves of such a receiver (TruRover, 5 Hz) wider than they were driven and suspects a filter that expects straight
travel at constant velocity. This is that filter in its steady state, for each axis by itself (alpha-beta filter):

    predicted  x- = x + T v                     r = z - x-
    updated    x  = x- + alpha r                v = v + (beta / T) r

The gains are the Kalman gains of a model with white position noise sigma_z and an acceleration that is constant over
each interval T and new in the next, of standard deviation sigma_a. With the tracking index
``lambda = sigma_a T^2 / sigma_z`` (Kalata 1984, IEEE Trans. AES 20(2), 174-182):

    alpha = 1 - rho^2,   beta = 2 (2 - alpha) - 4 sqrt(1 - alpha),   rho = (4 + lambda - sqrt(8 lambda + lambda^2)) / 4

Under a constant acceleration a it trails by

    z - x = a T^2 (1 - alpha) / beta

once it has settled. In a curve of radius R, a = v^2 / R points to the middle, so the track comes out wider by that; for
a curve that is short beside the filter's settling it is less, and for a tight one ``|H| - 1`` times R, where H is the
filter's response at the frequency v / R. It starts from the first two positions, and again after every loss of the
position.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from twin.config import Config
from twin.signals import BoolArray, FloatArray

Figure = Annotated[float, Field(ge=1e-3, le=1e3)]
"""A standard deviation that a receiver's maker may have set."""


class InternalFilter(Config):
    """A receiver's own filter for constant velocity."""

    position_sigma_m: Figure
    """Noise of a position that the filter expects; its ratio to the other figure says how far it trails."""
    acceleration_sigma_m_s2: Figure
    """Acceleration that it expects."""
    velocity: bool = False
    """Speed and course come from the filter too; otherwise they are those of the Doppler shifts."""

    def gains(self, period_s: float) -> tuple[float, float]:
        """Alpha and beta for positions every ``period_s``."""
        index = self.acceleration_sigma_m_s2 * period_s**2 / self.position_sigma_m
        rho = (4.0 + index - math.sqrt(8.0 * index + index * index)) / 4.0
        alpha = 1.0 - rho * rho
        # beta = 2 (2 - alpha) - 4 sqrt(1 - alpha), without the difference of nearly equal numbers
        return alpha, 2.0 * (1.0 - rho) ** 2

    def lag_s2(self, period_s: float) -> float:
        """How far positions trail, in m per m/s^2 of a constant acceleration."""
        alpha, beta = self.gains(period_s)
        return period_s**2 * (1.0 - alpha) / beta


class ConstantVelocityFilter:
    """The filters of R receivers."""

    def __init__(self, config: InternalFilter, *, period_s: float, runs: int) -> None:
        self._alpha, beta = config.gains(period_s)
        self._velocity_gain = beta / period_s
        self._period_s = period_s
        self._seen = np.zeros((runs, 1), dtype=np.int64)
        self._position = np.zeros((runs, 3))
        self.velocity_m_s: FloatArray = np.zeros((runs, 3))
        """(R, 3) east, north, up."""

    def step(self, position_m: FloatArray, *, lost: BoolArray) -> FloatArray:
        """Take the next positions (R, 3), of which those of the receivers ``lost`` (R,) are none; return the filter's.

        Those of lost receivers mean nothing.
        """
        self._seen[lost] = 0
        predicted = self._position + self._period_s * self.velocity_m_s
        residual = position_m - predicted
        updated = predicted + self._alpha * residual
        velocity = self.velocity_m_s + self._velocity_gain * residual
        between = (position_m - self._position) / self._period_s
        self.velocity_m_s = np.where(self._seen == 0, 0.0, np.where(self._seen == 1, between, velocity))
        self._position = np.where(self._seen < 2, position_m, updated)
        self._seen[~lost] += 1
        return self._position.copy()
