"""What a few sensors said of late: values of R members over common times, looked up at a time of each member's own."""

from __future__ import annotations

import numpy as np

from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray


class Track:
    """The last samples of J values of R members, in order of time.

    Args:
        rows: J.
        kept_ns: for how long.
        longest_gap_ns: nothing is known between samples that are farther apart, nor so long after the last.
    """

    def __init__(self, rows: int, *, runs: int, kept_ns: int, longest_gap_ns: int) -> None:
        self._times: IntArray = np.zeros(64, dtype=np.int64)
        self._values: FloatArray = np.zeros((64, rows, runs))
        self._first = self._count = 0
        self._kept_ns, self._gap_ns = kept_ns, longest_gap_ns
        self._members = np.arange(runs)

    def push(self, t_ns: int, values: FloatArray) -> None:
        """Take values (J, R), NaN where they are not known; those of no later time than the last are ignored."""
        if self._count > self._first and t_ns <= self._times[self._count - 1]:
            return
        if self._count == len(self._times):
            self._make_room()
        self._times[self._count], self._values[self._count] = t_ns, values
        self._count += 1
        while self._times[self._first] < t_ns - self._kept_ns:
            self._first += 1

    def forget_after(self, t_ns: int) -> None:
        """Drop what is later."""
        while self._count > self._first and self._times[self._count - 1] > t_ns:
            self._count -= 1

    def at(self, t_ns: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The samples before and after (J, R) the times (R,), and how long (s) after the first, and of how long, that
        is (R,). NaN where nothing is known."""
        count = self._count - self._first
        if count < 2:
            nothing = np.full((self._values.shape[1], len(t_ns)), np.nan)
            return nothing, nothing, nothing[0], nothing[0]
        times = self._times[self._first : self._count]
        after = np.clip(np.searchsorted(times, t_ns), 1, count - 1)
        begin, span = times[after - 1], times[after] - times[after - 1]
        span_s: FloatArray = span / NS_PER_S
        known: BoolArray = (t_ns >= begin) & (span <= self._gap_ns) & (t_ns - times[after] <= self._gap_ns)
        since_s: FloatArray = np.where(known, np.minimum(t_ns - begin, span) / NS_PER_S, np.nan)
        place = after + self._first
        one, other = self._values[place - 1, :, self._members].T, self._values[place, :, self._members].T
        return one, other, since_s, span_s

    def linear(self, t_ns: IntArray) -> FloatArray:
        """(J, R) values at the times (R,), straight between samples; NaN where nothing is known."""
        one, other, since_s, span_s = self.at(t_ns)
        value: FloatArray = one + (other - one) * (since_s / span_s)
        return value

    def _make_room(self) -> None:
        count = self._count - self._first
        if 2 * count > len(self._times):
            self._times = np.concatenate([self._times, np.zeros_like(self._times)])
            self._values = np.concatenate([self._values, np.zeros_like(self._values)])
        kept = slice(self._first, self._count)
        self._times[:count], self._values[:count] = self._times[kept].copy(), self._values[kept].copy()
        self._first, self._count = 0, count
