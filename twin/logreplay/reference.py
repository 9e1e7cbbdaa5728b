"""The positions of another log of the same drive, read along as they are needed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from twin.errors import BadInputError
from twin.estimators.roles import GNSS
from twin.fix_quality import RTK_FIXED
from twin.formats.geodetic import Origin
from twin.formats.log import Log
from twin.recording import Stream
from twin.signals import POSITION, BoolArray, FloatArray, IntArray, Measurement, nanoseconds

_COLUMNS = (*POSITION, "sigma_e_m", "sigma_n_m", "sigma_u_m", "quality")
_UP, _SIGMAS, _QUALITY = 2, slice(3, 6), 6
_READ_AT_ONCE = 512
_MARGIN_NS = nanoseconds(10.0)
_FARTHEST_NS = nanoseconds(365.25 * 86_400.0)
"""Logs that begin a year apart are not about one drive, whatever their receivers took for the date."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferencePoints:
    """What the reference says at some times (T,); NaN where it says nothing."""

    east_m: FloatArray
    north_m: FloatArray
    up_m: FloatArray
    var_e_m2: FloatArray
    var_n_m2: FloatArray
    var_u_m2: FloatArray
    fixed: BoolArray
    """Whether it had a fix of RTK there."""


class ReferenceTrack:
    """Positions of a log on the clock and in the local frame of another.

    Between two positions no farther apart than ``longest_gap_s`` a line is drawn: an acceleration a makes that
    a T^2 / 8 wrong in the middle (0.1 m with 1 m/s^2 and 1 Hz), and nothing where both logs have the same epochs.
    Clocks are matched by UTC.

    Raises:
        BadInputError: the reference has no positions, one of the two logs does not know its date, or more than a year
            lies between them.
    """

    def __init__(self, log: Log, *, origin: Origin, start_utc_ns: int | None, longest_gap_s: float) -> None:
        receivers = [info for info in log.sensors.values() if info.kind == GNSS]
        if not receivers:
            raise BadInputError(f"{log.path}: --reference: has no positions")
        if start_utc_ns is None or log.start_utc_ns is None:
            blamed = "the reference" if log.start_utc_ns is None else "the replayed log"
            raise BadInputError(f"{log.path}: --reference: {blamed} tells no date, so times cannot be matched")
        self._receiver = receivers[0]
        self._places = [
            self._receiver.columns.index(name) if name in self._receiver.columns else -1 for name in _COLUMNS
        ]
        if min(self._places[:2]) < 0:
            raise BadInputError(f"{log.path}: --reference: {self._receiver.name} has no positions")
        self._log, self._origin = log, origin
        self._shift_ns = log.start_utc_ns - start_utc_ns
        if abs(self._shift_ns) > _FARTHEST_NS:
            years = abs(self._shift_ns) / _FARTHEST_NS
            raise BadInputError(
                f"{log.path}: --reference: begins {years:.1f} years away from the replayed log: not the same drive"
            )
        self._gap_ns = nanoseconds(longest_gap_s)
        self._source: Iterator[Measurement] | None = log.measurements()
        self._t_ns: IntArray = np.empty(0, dtype=np.int64)
        self._values: FloatArray = np.empty((0, len(_COLUMNS)))

    def advance(self, begin_ns: int, end_ns: int) -> Stream | None:
        """Read on until times from ``begin_ns`` to ``end_ns`` can be asked for; return what is new, if anything.

        What is much older is forgotten.
        """
        old = int(np.searchsorted(self._t_ns, begin_ns - _MARGIN_NS))
        self._t_ns, self._values = self._t_ns[old:], self._values[old:]
        read: list[tuple[IntArray, FloatArray]] = []
        last = int(self._t_ns[-1]) if len(self._t_ns) else None
        while self._source is not None and (last is None or last < end_ns + self._gap_ns):
            t_ns, values = self._read(last)
            if len(t_ns):
                last = int(t_ns[-1])
                wanted = t_ns >= begin_ns - _MARGIN_NS
                read.append((t_ns[wanted], values[wanted]))
        if not read:
            return None
        t_ns, values = (np.concatenate(parts) for parts in zip(*read, strict=True))
        self._t_ns, self._values = np.concatenate([self._t_ns, t_ns]), np.concatenate([self._values, values])
        return Stream(columns=_COLUMNS, t_ns=t_ns, values=values[:, np.newaxis]) if len(t_ns) else None

    def _read(self, last: int | None) -> tuple[IntArray, FloatArray]:
        """The next positions, later than ``last`` and in order."""
        assert self._source is not None
        heard = list(islice(self._source, _READ_AT_ONCE))
        if not heard:
            self._source = None
        rows = [each for each in heard if each.sensor == self._receiver.name and each.valid[0]]
        t_ns = np.array([each.t_ns + self._shift_ns for each in rows], dtype=np.int64)
        values = np.full((len(rows), len(_COLUMNS)), math.nan)
        told = np.array([each.values[0] for each in rows]).reshape(len(rows), len(self._receiver.columns))
        for column, place in enumerate(self._places):
            if place >= 0:
                values[:, column] = told[:, place]
        good = np.isfinite(values[:, :2]).all(axis=1)
        t_ns, values = t_ns[good], values[good]
        if len(t_ns):
            before = np.concatenate([[t_ns[0] - 1 if last is None else last], t_ns[:-1]])
            later = t_ns > np.maximum.accumulate(before)
            t_ns, values = t_ns[later], values[later]
        if len(t_ns) and self._log.origin != self._origin:
            flat = np.isnan(values[:, _UP])
            up = np.nan_to_num(values[:, _UP : _UP + 1])
            globe = self._log.origin.geodetic(np.concatenate([values[:, :_UP], up], axis=1))
            values[:, : _UP + 1] = self._origin.enu(globe)
            values[flat, _UP] = math.nan
        return t_ns, values

    def at(self, t_ns: IntArray) -> ReferencePoints:
        """What it says at times (T,) within the last :meth:`advance`."""
        count = len(self._t_ns)
        if not count:
            lost = np.full(len(t_ns), math.nan)
            nowhere = np.zeros(len(t_ns), dtype=np.bool_)
            return ReferencePoints(
                east_m=lost, north_m=lost, up_m=lost, var_e_m2=lost, var_n_m2=lost, var_u_m2=lost, fixed=nowhere
            )
        after = np.clip(np.searchsorted(self._t_ns, t_ns), 0, count - 1)
        before = np.where(self._t_ns[after] == t_ns, after, np.maximum(after - 1, 0))
        gap = self._t_ns[after] - self._t_ns[before]
        inside = (self._t_ns[before] <= t_ns) & (t_ns <= self._t_ns[after]) & (gap <= self._gap_ns)
        share = np.where(gap > 0, (t_ns - self._t_ns[before]) / np.maximum(gap, 1), 0.0)[:, np.newaxis]
        values = (1.0 - share) * self._values[before] + share * self._values[after]
        values[~inside] = math.nan
        # Of what claims no sigma the variance is taken for zero: the difference is then the estimate's alone.
        variances = np.nan_to_num(values[:, _SIGMAS]) ** 2
        fixed = inside & (self._values[before, _QUALITY] == RTK_FIXED) & (self._values[after, _QUALITY] == RTK_FIXED)
        return ReferencePoints(
            east_m=values[:, 0],
            north_m=values[:, 1],
            up_m=values[:, _UP],
            var_e_m2=variances[:, 0],
            var_n_m2=variances[:, 1],
            var_u_m2=variances[:, 2],
            fixed=fixed,
        )
