"""What an attitude sensor (AHRS) tells of vertical motion: a history of accelerations, freed from outliers.

**Outliers.** An outlier stands alone: it sticks out from both its neighbours to the same side, while what is true goes
on. So a sample is judged when the next one has come. By how far genuine samples stick out, a running mean square tells,
with the peaks of the last moments; data sheet and Bayes' rule tell the rest: how likely the sample is an outlier, how
large that is expected to be, and how uncertain that leaves the acceleration. No sample is thrown away outright, and
with no outliers on the data sheet nothing is done. The newest sample is judged against the straight line through the
two before it, until its neighbour has come.

**Silence.** Where a sample is lost the acceleration goes on as it was, off by as much as it usually changes; in longer
gaps it is that of a machine at work (:data:`_WORK_M_S2`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.estimators.height_filter_kernels import compose, judge, lagged, peak_of_three
from twin.estimators.height_filter_levers import Lever
from twin.estimators.roles import column_places, usable
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

COLUMNS = ("free_accel_u_m_s2", "free_accel_e_m_s2", "free_accel_n_m_s2", "roll_rad", "pitch_rad", "heading_rad")

_ACCEL, _DENSITY, _LEVEL, _ARM, _ROWS = 0, 1, slice(2, 4), slice(6, 9), 9
"""Rows of the history: what :func:`compose` wants, and the antenna's place (east, north, up) seen from the AHRS."""
_WORK_M_S2, _WORK_S = 0.5, 0.3
"""Acceleration of a machine at work while nobody hears it, 1 sigma, and how long it lasts; a choice."""
_USUAL_S = 2.0
"""Over which time it is learnt how far samples stick out."""
_RECENT_S = 0.2
"""For how long a peak is remembered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AccelerationSheet:
    """What the data sheet of an AHRS says of its free acceleration."""

    noise: float
    """Of one sample, m/s^2."""
    outlier_probability: float
    outlier_sigma: float

    @classmethod
    def of(cls, info: SensorInfo) -> AccelerationSheet:
        """Read a data sheet; a noise density is one-sided."""
        sheet = info.datasheet
        density = sheet.get("free_accel_noise_density_m_s2_rthz", 6e-4)
        return cls(
            noise=sheet.get("free_accel_noise_m_s2", density * math.sqrt(0.5 * info.rate_hz)),
            outlier_probability=sheet.get("outlier_probability", 0.0),
            outlier_sigma=sheet.get("outlier_sigma_m_s2", 0.0),
        )


class _Usual:
    """How far genuine samples stick out: a running mean square (R,), and a memory of recent peaks."""

    def __init__(self, least: float, *, runs: int, step_s: float) -> None:
        self._least = least
        self._mean = np.full(runs, least + 0.01)
        self._peak = np.zeros(runs)
        self._gain = step_s / _USUAL_S
        self._kept = math.exp(-step_s / _RECENT_S)

    def square(self) -> FloatArray:
        """(R,) mean square of what is usual now."""
        usual: FloatArray = np.maximum(np.maximum(self._mean, self._peak), self._least)
        return usual

    def learn(self, square: FloatArray) -> None:
        """Take one more, (R,); what is far above the usual counts as not much above it."""
        usual = self.square()
        self._mean = self._mean + self._gain * (np.minimum(square, 9.0 * usual) - self._mean)
        self._peak = np.maximum(np.minimum(square, 9.0 * usual), self._peak * self._kept)


class OutlierJudge:
    """Expected outlier and remaining variance of samples, by Bayes' rule."""

    def __init__(self, sheet: AccelerationSheet, *, runs: int, step_s: float) -> None:
        least = 1.5 * sheet.noise**2  # of a sample minus the mean of its neighbours
        self._sheet = sheet
        self._alone = _Usual(least, runs=runs, step_s=step_s)
        self._newest = _Usual(4.0 * least, runs=runs, step_s=step_s)
        self.idle = sheet.outlier_probability == 0.0 or sheet.outlier_sigma == 0.0

    def settled(self, before: FloatArray, now: FloatArray, after: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The outlier in a sample between its neighbours, (R,), and the variance that it leaves, (R,)."""
        stands_out = peak_of_three(before, now, after)
        found = self._judge(stands_out, now - 0.5 * (before + after), self._alone.square())
        self._alone.learn(np.square(np.where(found[2] < 0.5, stands_out, 0.0)))
        return found[0], found[1]

    def newest(self, line: FloatArray, now: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same of the newest sample, whose neighbours give a ``line`` (R,)."""
        off = now - line
        found = self._judge(off, off, self._newest.square())
        self._newest.learn(np.square(np.where(found[2] < 0.5, off, 0.0)))
        return found[0], found[1]

    def _judge(self, evidence: FloatArray, off: FloatArray, usual: FloatArray) -> FloatArray:
        return judge(evidence, off, usual, self._sheet.outlier_probability, self._sheet.outlier_sigma**2)


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
        self.sheet = AccelerationSheet.of(info)
        self._places = places
        self._antenna = antenna
        self._leak_sigma = leak_sigma_rad
        self.step_s = 1.0 / info.rate_hz
        self.attitude_correlation_s = info.datasheet.get("attitude_correlation_s", 60.0)
        self._step_ns = round(NS_PER_S / info.rate_hz)
        self._judge = OutlierJudge(self.sheet, runs=runs, step_s=1.0 / info.rate_hz)
        self._kept_ns = round(kept_s * NS_PER_S)
        self._size = 4 * (math.ceil(kept_s * info.rate_hz) + 16)
        self._begin, self._end = np.zeros((2, self._size), dtype=np.int64)
        self._rows: FloatArray = np.zeros((_ROWS, self._size, runs))
        self._first = self._count = 0
        self._pending: tuple[int, FloatArray, BoolArray] | None = None
        self._line: FloatArray = np.zeros(runs)
        self._newest: tuple[FloatArray, FloatArray] = (np.zeros(runs), np.zeros(runs))
        self._change = np.full(runs, self.sheet.noise**2)
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
        variance = np.full(len(now), self.sheet.noise**2)
        change = np.square(now - before)
        if not self._judge.idle and self._count > self._first:
            outlier, left = self._judge.settled(before, now, np.where(after_known, after, before))
            now, variance = now - outlier, variance + left
        if not known.all():
            held = np.where(after_known, 0.5 * (before + after), before)
            now = np.where(known, now, held)
            variance = np.where(known, variance, variance + self._change)
        self._change = np.where(known, self._change + 0.02 * (change - self._change), self._change)
        self._line = np.where(known, 2.0 * now - before, now)
        sample[_ACCEL], sample[_DENSITY] = now, variance * (self._step_ns / NS_PER_S) + self._leak(sample)
        self._push(t_ns, sample)
        self._pending = None

    def _judge_newest(self, now: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
        variance = np.full(len(now), self.sheet.noise**2)
        if not self._judge.idle:
            outlier, left = self._judge.newest(self._line, np.where(known, now, self._line))
            now, variance = now - outlier, variance + left
        if known.all():
            return now, variance
        return np.where(known, now, self._last()), np.where(known, variance, variance + self._change)

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
            row[_DENSITY] = (self._change + self.sheet.noise**2) * (ahead / NS_PER_S)
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
