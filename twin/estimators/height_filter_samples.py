"""What an attitude sensor (AHRS) tells of vertical motion: a history of accelerations.

They are freed from outliers (:mod:`twin.estimators.height_filter_outliers`), which takes the sample that follows: all
but the newest sample are *settled*. Where a sample is lost the acceleration goes on as it was, off by as much as it
usually changes; in longer gaps it is that of a machine at work (:data:`_WORK_M_S2`).
"""

from __future__ import annotations

import math

import numpy as np

from twin.estimators.height_filter_kernels import compose, lagged
from twin.estimators.height_filter_levers import Lever
from twin.estimators.height_filter_outliers import OutlierJudge, OutlierSheet
from twin.estimators.roles import column_places, usable
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

COLUMNS = ("free_accel_u_m_s2", "free_accel_e_m_s2", "free_accel_n_m_s2", "roll_rad", "pitch_rad", "heading_rad")

_ACCEL, _DENSITY, _LEVEL, _ARM, _ROWS = 0, 1, slice(2, 4), slice(6, 9), 9
"""Rows of the history: what :func:`compose` wants, and the antenna's place (east, north, up) seen from the AHRS."""
_DENSITY_M_S2_RTHZ = 6e-4
"""Noise where the data sheet is silent: that of a good unit."""
_WORK_M_S2, _WORK_S = 0.5, 0.3
"""Acceleration of a machine at work while nobody hears it, 1 sigma, and how long it lasts; a choice."""


class AccelerationHistory:
    """Accelerations of R members since a moment ago, by interval, settled but for the newest.

    Raises:
        BadInputError: the AHRS lacks a column.
    """

    def __init__(
        self, info: SensorInfo, setup: EstimatorSetup, *, antenna: Lever, kept_s: float, leak_sigma_rad: float
    ) -> None:
        runs = setup.runs
        places = column_places(info, COLUMNS, setup=setup)
        density = info.datasheet.get("free_accel_noise_density_m_s2_rthz", _DENSITY_M_S2_RTHZ)  # one-sided
        self._noise = info.datasheet.get("free_accel_noise_m_s2", density * math.sqrt(0.5 * info.rate_hz))
        self._places = places
        self._antenna = antenna
        self._leak_sigma = leak_sigma_rad
        self.step_s = 1.0 / info.rate_hz
        self.attitude_correlation_s = info.datasheet.get("attitude_correlation_s", 60.0)
        self._step_ns = round(NS_PER_S / info.rate_hz)
        self._judge = OutlierJudge(OutlierSheet.of(info.datasheet), noise=self._noise, runs=runs, step_s=self.step_s)
        self._kept_ns = round(kept_s * NS_PER_S)
        self._size = 4 * (math.ceil(kept_s * info.rate_hz) + 16)
        self._begin, self._end = np.zeros((2, self._size), dtype=np.int64)
        self._rows: FloatArray = np.zeros((_ROWS, self._size, runs))
        self._first = self._count = 0
        self._pending: tuple[int, FloatArray, BoolArray] | None = None
        self._newest: tuple[FloatArray, FloatArray] = (np.zeros(runs), np.zeros(runs))
        self._change = np.full(runs, self._noise**2)
        self.attitude: FloatArray = np.zeros((3, runs))
        """(3, R) roll, pitch, heading heard last."""
        self.settled_ns: int | None = None
        """Until when all is settled."""

    @property
    def heard_ns(self) -> int | None:
        """When the newest sample was true."""
        return self.settled_ns if self._pending is None else self._pending[0]

    def hear(self, measurement: Measurement) -> bool:
        """Take a sample; False if it is older than one that was taken."""
        t_ns, heard = min(measurement.t_ns, measurement.t_available_ns), self.heard_ns
        if heard is not None and t_ns <= heard:
            return False
        values = measurement.values[:, self._places]
        known = usable(measurement, values)
        values = np.where(known[:, np.newaxis], values, 0.0).T
        self.attitude = np.where(known, values[3:], self.attitude)
        sample = self._row(values)
        if self._pending is None:
            self.settled_ns = t_ns - self._step_ns if self.settled_ns is None else self.settled_ns
        else:
            self._settle(sample[0], known)
        assert self.settled_ns is not None
        if t_ns - self.settled_ns > 1.5 * self._step_ns:
            self._silence(t_ns - self._step_ns)
        self._pending = (t_ns, sample, known)
        self._newest = self._judge_newest(sample[0], known)
        return True

    def be_silent(self, until_ns: int) -> None:
        """Nothing is heard until then: settle what is pending and go on without."""
        if self._pending is not None:
            self._settle(self._pending[1][0], np.zeros_like(self._pending[2]))
        if self.settled_ns is None:
            self.settled_ns = until_ns
        elif until_ns > self.settled_ns:
            self._silence(until_ns)

    def sums(self, from_ns: int, to_ns: int) -> FloatArray:
        """Integrals (13, R) over a span, see :func:`compose`; beyond what was heard the acceleration goes on."""
        last = self._count
        if self.settled_ns is not None and to_ns > self.settled_ns:
            last = self._provide(to_ns)
        part = slice(self._first, last)
        return compose(self._begin[part], self._end[part], self._rows[:, part], from_ns, to_ns)

    def lagged(self, at_ns: int, lag_s: float) -> FloatArray:
        """(3, R) how far a velocity (east, north, up) that lags behind by ``lag_s`` is behind at a settled time.

        A lag L keeps of v what its acceleration a has not changed lately: v - L(v) = lag L(a).
        """
        part = slice(self._first, self._count)
        level = lagged(self._begin[part], self._end[part], self._rows[_LEVEL, part], at_ns, lag_s)
        up = lagged(self._begin[part], self._end[part], self._rows[:1, part], at_ns, lag_s)
        return lag_s * np.concatenate([level, up])

    def antenna(self, at_ns: int) -> FloatArray:
        """(3, R) where the antenna is, seen from the AHRS, at a settled time."""
        if self._antenna.is_nothing or self._count == self._first:
            return np.zeros((3, self._rows.shape[2]))
        at = int(np.searchsorted(self._end[self._first : self._count], at_ns)) + self._first
        return self._rows[_ARM, min(at, self._count - 1)].copy()

    def antenna_velocity(self, at_ns: int, lag_s: float) -> FloatArray:
        """(3, R) velocity of the antenna against the AHRS, lagged by ``lag_s``: L(a') = (a - L(a)) / lag."""
        if self._antenna.is_nothing or lag_s <= 0.0 or self._count == self._first:
            return np.zeros((3, self._rows.shape[2]))
        part = slice(self._first, self._count)
        begin, end = self._begin[part], self._end[part]
        told = 1.0 - math.exp((begin[0] - at_ns) / NS_PER_S / lag_s)
        slow = lagged(begin, end, self._rows[_ARM, part], at_ns, lag_s) / max(told, 1e-9)
        return (self.antenna(at_ns) - slow) / lag_s

    # --- within ------------------------------------------------------------------------------------------------------

    def _row(self, values: FloatArray) -> FloatArray:
        """(9, R) a column of the history."""
        row = np.empty((_ROWS, values.shape[1]))
        row[_ACCEL], row[_LEVEL] = values[0], values[1:3]
        row[4], row[5] = np.cos(self.attitude[2]), np.sin(self.attitude[2])
        row[_ARM] = self._antenna.place(self.attitude)
        return row

    def _last(self) -> FloatArray:
        """(R,) acceleration upwards of the last settled interval."""
        return self._rows[_ACCEL, self._count - 1] if self._count > self._first else np.zeros(self._rows.shape[2])

    def _settle(self, after: FloatArray, after_known: BoolArray) -> None:
        """Take the pending sample into the history, judged by its neighbours."""
        assert self._pending is not None
        t_ns, sample, known = self._pending
        before, now = self._last(), sample[0]
        if not known.all():
            now = np.where(known, now, np.where(after_known, 0.5 * (before + after), before))
        outlier, left = self._judge.settle(now, after, known & after_known)
        variance = self._noise**2 + left + np.where(known, 0.0, self._change)
        now = now - outlier
        # how much accelerations change from one sample to the next, over the last second
        self._change = np.where(
            known, self._change + self.step_s * (np.square(now - before) - self._change), self._change
        )
        sample[_ACCEL], sample[_DENSITY] = now, variance * (self._step_ns / NS_PER_S) + self._leak(sample)
        self._push(t_ns, sample)
        self._pending = None

    def _judge_newest(self, now: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
        now = np.where(known, now, self._last())
        outlier, left = self._judge.newest(now, known)
        return now - outlier, self._noise**2 + left + np.where(known, 0.0, self._change)

    def _silence(self, until_ns: int) -> None:
        assert self.settled_ns is not None
        runs = self._rows.shape[2]
        short = until_ns - self.settled_ns <= 3 * self._step_ns
        held = self._last() if short else np.zeros(runs)
        row = self._rows[:, max(self._count - 1, 0)].copy()
        row[_ACCEL], row[_DENSITY], row[_LEVEL] = held, 2.0 * _WORK_M_S2**2 * _WORK_S, 0.0
        self._push(until_ns, row)

    def _push(self, end_ns: int, row: FloatArray) -> None:
        begin_ns = end_ns - self._step_ns if self.settled_ns is None else self.settled_ns
        if self._count + 3 > self._size:
            self._make_room()
        self._begin[self._count], self._end[self._count] = begin_ns, end_ns
        self._rows[:, self._count] = row
        self._count += 1
        self.settled_ns = end_ns
        while self._end[self._first] < end_ns - self._kept_ns:
            self._first += 1

    def _make_room(self) -> None:
        kept = slice(self._first, self._count)
        count = self._count - self._first
        self._begin[:count], self._end[:count] = self._begin[kept].copy(), self._end[kept].copy()
        self._rows[:, :count] = self._rows[:, kept].copy()
        self._first, self._count = 0, count

    def _provide(self, to_ns: int) -> int:
        """Put the newest sample, and how it may go on, behind what is settled; how many intervals that makes."""
        if self._count + 2 > self._size:
            self._make_room()
        at, end_ns = self._count, self.settled_ns
        assert end_ns is not None
        row = self._rows[:, max(at - 1, 0)].copy()
        if self._pending is not None:
            t_ns, sample, _ = self._pending
            row = sample.copy()
            row[_ACCEL], row[_DENSITY] = self._newest[0], self._newest[1] * self.step_s + self._leak(sample)
            self._begin[at], self._end[at], self._rows[:, at] = end_ns, t_ns, row
            at, end_ns = at + 1, t_ns
        if to_ns > end_ns:
            ahead = to_ns - end_ns
            row[_DENSITY] = (self._change + self._noise**2) * (ahead / NS_PER_S)
            if ahead > 3 * self._step_ns:
                row[_ACCEL], row[_DENSITY], row[_LEVEL] = 0.0, 2.0 * _WORK_M_S2**2 * _WORK_S, 0.0
            self._begin[at], self._end[at], self._rows[:, at] = end_ns, to_ns, row
            at += 1
        return at

    def _leak(self, row: FloatArray) -> FloatArray | float:
        """Density of what level acceleration leaks into Up where nobody follows the attitude error."""
        if self._leak_sigma == 0.0:
            return 0.0
        leaked: FloatArray = 2.0 * _WORK_S * self._leak_sigma**2 * np.square(row[_LEVEL]).sum(axis=0)
        return leaked
