"""Standstill calibration: what the inertial units read while the machine stands.

Source: paper 000, sections 1.5, 2.7 and 3.2, and appendix A (60 s). The means are taken as static biases. For the
accelerometers that is bias plus gravity's share at the attitude of the calibration: subtracting the longitudinal mean
removes both, until the slope changes.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import BoolArray, FloatArray

AXES = 6
"""Accelerometer x, y, z in m/s^2, then gyroscope x, y, z in rad/s, in body axes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What was learnt at standstill about ``u`` inertial units, for R runs."""

    mean: FloatArray
    """(u, R, 6) mean reading; zero where a unit gave nothing."""
    norm: FloatArray
    """(u, R) mean norm of the accelerometer, m/s^2; standard gravity where a unit gave nothing."""
    norm_variance: FloatArray
    """(R,) variance of one tick's mean norm over the units, (m/s^2)^2."""


def specific_force_norm(readings: FloatArray) -> FloatArray:
    """Norm of the accelerometer (eq 2.33) of readings of shape (..., 6), shape (...)."""
    x, y, z = readings[..., 0], readings[..., 1], readings[..., 2]
    return np.sqrt(x * x + y * y + z * z)


def add_up(per_unit: FloatArray) -> FloatArray:
    """Sum of (u, R) over the units, one after the other: the same bits for one run as for many."""
    total: FloatArray = functools.reduce(np.add, per_unit)
    return total


class StandstillCalibration:
    """Gathers the sums; memory does not grow with time."""

    def __init__(self, *, units: int, runs: int) -> None:
        self._count = np.zeros((units, runs))
        self._sum = np.zeros((units, runs, AXES))
        self._norm_sum = np.zeros((units, runs))
        # Of ticks in which every unit answered: only there is the mean over the units free of which units answered.
        self._full_count = np.zeros(runs)
        self._full_sum = np.zeros(runs)
        self._full_square_sum = np.zeros(runs)

    def add(self, units: list[int], readings: FloatArray, present: BoolArray) -> None:
        """Take one tick: ``readings`` (k, R, 6) of the ``units`` that answered, ``present`` (k, R) where usable."""
        # Norms are counted from standard gravity, so that the sums of squares keep their digits.
        norms = np.where(present, specific_force_norm(readings) - STANDARD_GRAVITY_M_S2, 0.0)
        usable = np.where(present[..., np.newaxis], readings, 0.0)
        for place, unit in enumerate(units):
            self._count[unit] += present[place]
            self._sum[unit] += usable[place]
            self._norm_sum[unit] += norms[place]
        if sorted(units) == list(range(len(self._count))):
            full = present.all(axis=0)
            mean = add_up(norms) / len(units)
            self._full_count += full
            self._full_sum += np.where(full, mean, 0.0)
            self._full_square_sum += np.where(full, mean * mean, 0.0)

    def finish(self, *, accelerometer_variance: float) -> Calibration:
        """Return the means.

        A member with fewer than two complete ticks (no calibration, or a dead unit) takes the variance of the norm
        from ``accelerometer_variance`` (table 4.1, (m/s^2)^2 per axis and sample) instead.
        """
        count = np.maximum(self._count, 1.0)
        full = np.maximum(self._full_count, 2.0)
        variance = (self._full_square_sum - self._full_sum**2 / full) / (full - 1.0)
        return Calibration(
            mean=self._sum / count[..., np.newaxis],
            norm=STANDARD_GRAVITY_M_S2 + self._norm_sum / count,
            norm_variance=np.where(self._full_count < 2.0, accelerometer_variance / len(count), variance),
        )
