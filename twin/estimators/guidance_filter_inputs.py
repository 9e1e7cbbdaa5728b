"""What a guidance filter moves by: sums over time of a rate of turn, a speed and a steering angle.

A sample is the mean since the one before, so that sums are piecewise straight lines through the sample times, and the
mean over any span is the difference of two sums over its length, whatever the sensors' rates. A member that lost a
sample goes on as before until its next one; wheel encoders then make up for all that was missed.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass

import numpy as np

from twin.estimators.guidance_readers import Told
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray

_HOLD_NS = 1_500_000_000
"""After so long without a sample nothing is known any more."""


class Sum:
    """Sum over time of one quantity, for R runs."""

    def __init__(self, runs: int) -> None:
        self._t_ns: list[int] = []
        self._sums: list[FloatArray] = []
        self._known: list[BoolArray] = []
        """Of the span that ends with the sample."""
        self._value = np.zeros(runs)
        self._at_sample = np.zeros(runs)
        self._last_ns: IntArray = np.zeros(runs, dtype=np.int64)
        self._heard: BoolArray = np.zeros(runs, dtype=np.bool_)

    def __len__(self) -> int:
        """Samples that are kept."""
        return len(self._t_ns)

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest sample."""
        return self._t_ns[-1] if self._t_ns else None

    def add(self, told: Told) -> None:
        """Take a sample; one that is not later than the newest is of no use."""
        if self._t_ns and told.t_ns <= self._t_ns[-1]:
            return
        there = told.there
        since_s = (told.t_ns - self._t_ns[-1]) / NS_PER_S if self._t_ns else 0.0
        before = self._sums[-1] if self._t_ns else np.zeros(len(there))
        total = np.where(there, self._at_sample + told.value * told.dt_s, before + self._value * since_s)
        # one that was never heard before begins with what it says now
        total = np.where(there & (told.dt_s <= 0.0), before, total)
        self._known.append(there & (told.dt_s > 0.0) & (told.dt_s <= _HOLD_NS / NS_PER_S))
        self._t_ns.append(told.t_ns)
        self._sums.append(total)
        self._value = np.where(there, told.value, self._value)
        self._at_sample = np.where(there, total, self._at_sample)
        self._last_ns = np.where(there, told.t_ns, self._last_ns)
        self._heard = self._heard | there

    def mean(self, begin_ns: int, end_ns: int) -> FloatArray:
        """Mean (R,) over a span; zero before the first sample, the last value after the newest."""
        mean: FloatArray = (self._at(end_ns) - self._at(begin_ns)) / ((end_ns - begin_ns) / NS_PER_S)
        return mean

    def known(self, end_ns: int) -> BoolArray:
        """Whether (R,) the samples cover the end of a span."""
        place = bisect_left(self._t_ns, end_ns)
        if place < len(self._t_ns):
            return self._known[place]
        return self._heard & (end_ns - self._last_ns <= _HOLD_NS)

    def begins_ns(self) -> int | None:
        """Time of the oldest sample that is kept."""
        return self._t_ns[0] if self._t_ns else None

    def forget(self, before_ns: int) -> None:
        """Drop what is older, but for the one sample that is needed to go on from there."""
        old = bisect_right(self._t_ns, before_ns) - 1
        if old > 0:
            del self._t_ns[:old], self._sums[:old], self._known[:old]

    def _at(self, t_ns: int) -> FloatArray:
        if not self._t_ns:
            return np.zeros(len(self._value))
        place = bisect_left(self._t_ns, t_ns)
        if place == len(self._t_ns):
            return self._sums[-1] + self._value * ((t_ns - self._t_ns[-1]) / NS_PER_S)
        if place == 0:
            return self._sums[0]
        share = (t_ns - self._t_ns[place - 1]) / (self._t_ns[place] - self._t_ns[place - 1])
        return self._sums[place - 1] + share * (self._sums[place] - self._sums[place - 1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """Means over a short time, (R,) each."""

    dt_s: float
    rate: FloatArray
    """Told rate of turn, rad/s; zero where it is not known."""
    rate_known: BoolArray
    speed: FloatArray
    """Told forward speed, m/s; zero where there is no sensor."""
    speed_known: BoolArray
    standing: BoolArray
    """The wheels have not moved for a second."""
    steering: FloatArray
    """Told steering angle, rad."""
    steering_known: BoolArray


_STILL_NS, _STILL_M = NS_PER_S, 1e-6


class Inputs:
    """The three sums; ``counts`` tells whether the speed is that of wheels, which stand when they show nothing."""

    def __init__(self, runs: int, *, rate: bool, speed: bool, steering: bool, counts: bool) -> None:
        self.rate = Sum(runs) if rate else None
        self.speed = Sum(runs) if speed else None
        self.steering = Sum(runs) if steering else None
        self._counts = counts
        self._nothing, self._never = np.zeros(runs), np.zeros(runs, dtype=np.bool_)

    @property
    def settled_ns(self) -> int | None:
        """Time up to which all is known that there is to be known; None if nothing moves the filter."""
        newest = [each.newest_ns for each in (self.rate, self.speed) if each is not None]
        known = [each for each in newest if each is not None]
        return min(known) if known and len(known) == len(newest) else None

    def span(self, begin_ns: int, end_ns: int) -> Span:
        """What there is to be known of a span."""
        rate, rate_known = self._mean(self.rate, begin_ns, end_ns)
        speed, speed_known = self._mean(self.speed, begin_ns, end_ns)
        steering, steering_known = self._mean(self.steering, begin_ns, end_ns)
        return Span(
            dt_s=(end_ns - begin_ns) / NS_PER_S,
            rate=np.where(rate_known, rate, 0.0),
            rate_known=rate_known,
            speed=speed,
            speed_known=speed_known,
            standing=self._standing(end_ns) & speed_known,
            steering=steering,
            steering_known=steering_known,
        )

    def forget(self, before_ns: int) -> None:
        """Drop what is older than a second before."""
        for each in (self.rate, self.speed, self.steering):
            if each is not None:
                each.forget(before_ns - 2 * _STILL_NS)

    def _mean(self, of: Sum | None, begin_ns: int, end_ns: int) -> tuple[FloatArray, BoolArray]:
        if of is None:
            return self._nothing, self._never
        return of.mean(begin_ns, end_ns), of.known(end_ns)

    def _standing(self, end_ns: int) -> BoolArray:
        begins = None if self.speed is None or not self._counts else self.speed.begins_ns()
        if self.speed is None or begins is None or begins > end_ns - _STILL_NS:
            return self._never
        way: FloatArray = self.speed.mean(end_ns - _STILL_NS, end_ns)
        return np.abs(way) < _STILL_M
