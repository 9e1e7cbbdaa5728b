"""How far the positions of a receiver trail that smooths them by a filter for constant velocity.

A Kalman filter for constant velocity in its steady state is, in continuous time, a filter of second order with the
damping 1 / sqrt(2): x'' = omega^2 (p - x) + sqrt(2) omega (p' - x'). What it trails by, d = p - x, obeys

    d'' + sqrt(2) omega d' + omega^2 d = a,       so that d = a / omega^2 in a steady bend

whatever the way was before: with an acceleration that is known, d is known. 1 / omega^2 is the ``filter_lag_s2`` of
data sheets (:mod:`twin.sensors.gnss_internal_filter`), and 1 / omega the time that it takes.
"""

from __future__ import annotations

import math

import numpy as np

from twin.signals import FloatArray


class Trail:
    """What R receivers trail by, east and north; nothing with a lag of zero."""

    def __init__(self, lag_s2: float, runs: int) -> None:
        self._lag_s2 = lag_s2
        self.offset_m: FloatArray = np.zeros((runs, 2))
        """(R, 2) from the receiver's position to the antenna."""
        self._rate = np.zeros((runs, 2))

    def step(self, acceleration: FloatArray, dt_s: FloatArray) -> None:
        """An acceleration (R, 2) has lasted for a time (R,)."""
        if self._lag_s2 <= 0.0:
            return
        c = math.sqrt(0.5 / self._lag_s2)
        steady = self._lag_s2 * acceleration
        gone, angle = np.exp(-c * dt_s)[:, np.newaxis], (c * dt_s)[:, np.newaxis]
        cosine, sine = gone * np.cos(angle), gone * np.sin(angle)
        left, rate = self.offset_m - steady, self._rate
        self.offset_m = steady + left * cosine + (left + rate / c) * sine
        self._rate = rate * cosine - (2.0 * c * left + rate) * sine
