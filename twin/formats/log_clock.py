"""Puts the epochs of a log in time: over midnight, with and without dates, and past clocks that jump.

A receiver says the time of day in every epoch and the date only in some. The day is the one that brings an epoch
nearest to the latest; a date counts where that is not near, and it dates the log. An epoch up to ``LATEST_NS`` before
the latest is a late one and keeps its time. Gaps up to ``LONGEST_GAP_NS`` stay. Whatever jumps farther, back or ahead,
is passed over, unless the epochs that follow agree with it: then the receiver's clock has been set, or two logs have
been joined, and the log's time goes on one second after the latest.
"""

from __future__ import annotations

from collections import Counter

from twin.signals import NS_PER_S

DAY_NS = 86_400 * NS_PER_S
LATEST_NS = 10 * NS_PER_S
LONGEST_GAP_NS = 7_200 * NS_PER_S
JUMP = "time jumps"
RESTART = "clock set anew"
_AGREEING = 3
"""So many epochs have to agree on a new time."""


def follows(step_ns: int) -> bool:
    """Whether an epoch may come so long after the latest."""
    return -LATEST_NS <= step_ns <= LONGEST_GAP_NS


class LogClock:
    """The clock of one log; problems are counted in ``problems``."""

    def __init__(self, problems: Counter[str]) -> None:
        self._problems = problems
        self._latest: int | None = None
        self._first = 0
        """Of the first epoch, on the receiver's clock; moves where that is set anew."""
        self._jumped: int | None = None
        self._agreeing = 0
        self._shift: int | None = None
        """From the days counted before the first date to those since 1970, ns; None without a date."""
        self.latest_ns = 0
        """The latest epoch, ns since the first."""
        self.start_utc_ns: int | None = None
        """Time zero, ns since 1970; None while no date is known. A clock that is set anew moves it: what a receiver
        says before it has found the time dates nothing."""

    def place(self, time_of_day_ns: int, day: int | None) -> int | None:
        """Time of an epoch, ns since the first; None if it is passed over.

        Args:
            time_of_day_ns: since midnight, UTC.
            day: its date, days since 1970, where it is told.
        """
        if self._latest is None:
            return self.place_absolute((day or 0) * DAY_NS + time_of_day_ns, dated=day is not None)
        near = self._nearest(time_of_day_ns)
        if day is None:
            return self.place_absolute(near, dated=False)
        if self._shift is None:
            self._shift = day * DAY_NS + time_of_day_ns - near
            self.start_utc_ns = self._first + self._shift
        if abs(near - self._latest) <= LATEST_NS:
            return self.place_absolute(near, dated=False)
        return self.place_absolute(day * DAY_NS + time_of_day_ns - self._shift, dated=False)

    def _nearest(self, time_of_day_ns: int) -> int:
        assert self._latest is not None
        return self._latest + (time_of_day_ns - self._latest + DAY_NS // 2) % DAY_NS - DAY_NS // 2

    def place_absolute(self, clock_ns: int, *, dated: bool = True) -> int | None:
        """The same for a clock that tells days and time at once; ``dated`` if it counts from 1970 (UTC)."""
        if self._latest is None:
            self._latest = self._first = clock_ns
            if dated:
                self._shift = 0
                self.start_utc_ns = clock_ns
            return 0
        if not follows(clock_ns - self._latest) and not self._set_anew(clock_ns):
            return None
        self._jumped = None
        self._latest = max(self._latest, clock_ns)
        self.latest_ns = self._latest - self._first
        return clock_ns - self._first

    def _set_anew(self, clock_ns: int) -> bool:
        """Whether so many epochs have jumped to the same time that the log goes on there."""
        agrees = self._jumped is not None and follows(clock_ns - self._jumped)
        self._agreeing = self._agreeing + 1 if agrees else 1
        self._jumped = clock_ns
        if self._agreeing < _AGREEING:
            self._problems[JUMP] += 1
            return False
        self._problems[RESTART] += 1
        self._first = clock_ns - self.latest_ns - NS_PER_S
        self._latest = clock_ns
        if self._shift is not None:
            self.start_utc_ns = self._first + self._shift
        return True
