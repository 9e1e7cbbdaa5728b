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


def mean_of_units(per_unit: FloatArray, present: BoolArray | None) -> tuple[FloatArray, FloatArray]:
    """Mean (R,) of (k, R) over the units that are ``present`` (k, R), 0 without any, and their number, (R,) or (1,).

    ``present`` None says that all are, in every member: the same bits, sooner.
    """
    if present is None:
        return add_up(per_unit) / len(per_unit), np.array([float(len(per_unit))])
    count = add_up(present.astype(np.float64))
    return add_up(np.where(present, per_unit, 0.0)) / np.maximum(count, 1.0), count


class StandstillCalibration:
    """Gathers the sums; memory does not grow with time."""

    def __init__(self, *, units: int, runs: int) -> None:
        self._all_units = list(range(units))
        self._count = np.zeros((units, runs))
        self._sum = np.zeros((units, runs, AXES))
        self._norm_sum = np.zeros((units, runs))
        # Of ticks in which every unit answered: only there is the mean over the units free of which units answered.
        self._full_count = np.zeros(runs)
        self._full_sum = np.zeros(runs)
        self._full_square_sum = np.zeros(runs)

    def add(self, units: list[int], readings: FloatArray, present: BoolArray | None) -> None:
        """Take one tick: ``readings`` (k, R, 6) of the ``units`` that answered, ``present`` (k, R) where usable.

        ``present`` None says that all are usable, in every member.
        """
        # Norms are counted from standard gravity, so that the sums of squares keep their digits.
        norms = specific_force_norm(readings) - STANDARD_GRAVITY_M_S2
        usable, full = np.ones((len(units), 1)), np.ones(1)
        if present is not None:
            usable, full = present.astype(np.float64), np.logical_and.reduce(present, axis=0).astype(np.float64)
            norms = np.where(present, norms, 0.0)
            readings = np.where(present[..., np.newaxis], readings, 0.0)
        if units == self._all_units:
            self._count += usable
            self._sum += readings
            self._norm_sum += norms
        else:  # a unit may have answered twice
            for place, unit in enumerate(units):
                self._count[unit] += usable[place]
                self._sum[unit] += readings[place]
                self._norm_sum[unit] += norms[place]
        if sorted(units) == self._all_units:
            mean = full * (add_up(norms) / len(units))
            self._full_count += full
            self._full_sum += mean
            self._full_square_sum += mean * mean

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
