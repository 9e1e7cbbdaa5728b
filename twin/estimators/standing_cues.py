"""Whether a machine stands, from several cues at once.

A standing machine does not turn or shake (gyroscopes), is not being accelerated (accelerometers), and every speed
sensor that speaks says so: no pulses, a GNSS speed within its noise. One cue against it is enough: a false standstill
costs the whole speed, a missed one nothing.

Gyroscopes: the low-passed square of the deviation from their own low-passed mean, averaged over the three axes, stays
below what noise leaves, 1 + z sqrt(2 alpha / (2 - alpha) / 3) of the data sheet's variance. On class A ground at
0.5 m/s a planter pitches with some 1 mrad/s, beyond the 0.5 mrad/s of noise of four units. Accelerometers: their mean
over 0.15 s stays within z standard deviations of the mean over the last seconds, which a start of 0.5 m/s^2 leaves
after three samples.
"""

from __future__ import annotations

import math

import numpy as np

from twin.estimators.inertial_array import ACCEL, GYRO, Fused
from twin.signals import BoolArray, FloatArray

_SHAKING_S = 0.5
_MEAN_S = 2.0
_PUSH_S = 0.15
_SIGMAS = 4.0


class StandingCues:
    """The cues of R members."""

    def __init__(self, *, step_s: float, runs: int) -> None:
        self._alpha = min(1.0, step_s / _SHAKING_S)
        self._mean_gain = min(1.0, step_s / _MEAN_S)
        self._push_gain = min(1.0, step_s / _PUSH_S)
        self._count = 0
        self._mean = np.zeros((runs, 6))
        self._push = np.zeros((runs, 3))
        self._energy = np.zeros(runs)
        self._slow_speeds: dict[str, tuple[FloatArray, BoolArray]] = {}
        """By sensor: step (R,) until which what it said holds, and whether it said slow (R,)."""
        self._settling = math.ceil(_SHAKING_S / step_s)

    def inertial(self, fused: Fused) -> None:
        """Take the next inertial sample."""
        self._count += 1
        gain = max(self._mean_gain, 1.0 / self._count)
        self._mean = self._mean + gain * (fused.u - self._mean)
        swing = fused.u[:, GYRO] - self._mean[:, GYRO]
        first = max(self._alpha, 1.0 / self._count)
        self._energy = self._energy + first * (np.square(swing).mean(axis=1) - self._energy)
        push_gain = max(self._push_gain, 1.0 / self._count)
        self._push = self._push + push_gain * (fused.u[:, ACCEL] - self._push)

    def speed(self, sensor: str, index: int, patience: float, *, slow: BoolArray, known: BoolArray) -> None:
        """A speed sensor says at step ``index`` whether it is slow (R,); good for ``patience`` steps.

        Where it says nothing, ``known`` (R,) False, what it said before goes on to hold.
        """
        none = (np.full(len(known), -np.inf), np.zeros(len(known), dtype=np.bool_))
        until, before = self._slow_speeds.get(sensor, none)
        self._slow_speeds[sensor] = (np.where(known, index + patience, until), np.where(known, slow, before))

    def standing(self, index: int, fused: Fused, own_slow: BoolArray) -> BoolArray:
        """Members that stand at step ``index``; ``own_slow`` (R,) is the filter's word where none speaks."""
        if self._count < self._settling:
            return np.zeros(len(own_slow), dtype=np.bool_)
        spread = math.sqrt(2.0 * self._alpha / (2.0 - self._alpha) / 3.0)
        calm = self._energy <= (1.0 + _SIGMAS * spread) * fused.gyro_variance
        noise = self._push_gain / (2.0 - self._push_gain) + self._mean_gain / (2.0 - self._mean_gain)
        limit = _SIGMAS * np.sqrt(noise * fused.accel_variance)
        pushed = np.abs(self._push - self._mean[:, ACCEL]).max(axis=1)
        still: BoolArray = calm & (pushed <= limit)
        heard = np.zeros(len(own_slow), dtype=np.bool_)
        for until, slow in self._slow_speeds.values():
            holds = index <= until
            still = still & (slow | ~holds)
            heard = heard | holds
        return still & (heard | own_slow)
