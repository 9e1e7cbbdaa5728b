"""Puts the epochs of a log in time: over midnight, with and without dates, and past clocks that jump.

A receiver says the time of day in every epoch and the date only in some. The day is the one that brings an epoch
nearest to the latest; a date counts where that is not near, and it dates the log (:mod:`twin.formats.log_date`).

An epoch within ``NEAR_NS`` of the latest is in order, or late, and keeps its time. One farther off waits for what comes
next. If the log goes on as if nothing had been, it is passed over. If the next one goes on from it, there was a gap
(up to ``LONGEST_GAP_NS`` ahead), which stays. Beyond that, and back, three have to agree: then the receiver's clock has
been set, or two logs have been joined, and the log's time goes on one second after the latest.

Clocks that count from one zero for a whole log, as those of several tables beside one another, are never set anew
(:class:`SharedClock`): gaps of any length stay, and what goes back is passed over.

A log claims no more than ``LONGEST_LOG_DAYS``: what it has after them is passed over.
"""

from __future__ import annotations

from collections import Counter
from typing import Generic, NamedTuple, TypeVar

from twin.formats.log_date import LogDate
from twin.signals import NS_PER_S

DAY_NS = 86_400 * NS_PER_S
NEAR_NS = 10 * NS_PER_S
LONGEST_GAP_NS = 7_200 * NS_PER_S
LONGEST_LOG_DAYS = 30
LONGEST_LOG_NS = LONGEST_LOG_DAYS * DAY_NS
JUMP = "time jumps"
BEYOND = f"more than {LONGEST_LOG_DAYS} days after the beginning"
RESTART = "clock set anew"
_AGREE_ON_A_GAP, _AGREE_ON_A_JUMP = 2, 3

Item = TypeVar("Item")


class Placed(NamedTuple, Generic[Item]):
    """Something of a log, put in time."""

    item: Item
    t_ns: int
    """Since the log's first epoch."""
    t_available_ns: int
    """When it arrived: with the latest until then."""


def follows(step_ns: int, longest_ns: int = LONGEST_GAP_NS) -> bool:
    """Whether something may come so long after something else."""
    return -NEAR_NS <= step_ns <= longest_ns


def _nearest(time_of_day_ns: int, to_ns: int) -> int:
    """The time with this time of day that is nearest to another."""
    return to_ns + (time_of_day_ns - to_ns + DAY_NS // 2) % DAY_NS - DAY_NS // 2


class _Clock(Generic[Item]):
    """What both clocks have: what waits for a word from what follows, and what is in time."""

    def __init__(self, problems: Counter[str], begin_ns: int | None) -> None:
        self._problems = problems
        self._latest = begin_ns
        self._zero = begin_ns or 0
        """Time zero on the log's own clock."""
        self._waiting: list[tuple[Item, int]] = []

    def _go_on(self) -> list[Placed[Item]]:
        waiting, self._waiting = self._waiting, []
        return self._place(*waiting)

    def _pass_over(self) -> None:
        if self._waiting:
            self._problems[JUMP] += len(self._waiting)
            self._waiting = []

    def _place(self, *told: tuple[Item, int]) -> list[Placed[Item]]:
        placed = []
        for item, clock_ns in told:
            self._latest = clock_ns if self._latest is None else max(self._latest, clock_ns)
            if clock_ns - self._zero > LONGEST_LOG_NS:
                self._problems[BEYOND] += 1
            else:
                arrived_ns = min(self._latest - self._zero, LONGEST_LOG_NS)
                placed.append(Placed(item, clock_ns - self._zero, arrived_ns))
        return placed


class SharedClock(_Clock[Item]):
    """The clock of one table of several that count from one zero.

    A row within ``NEAR_NS`` of the latest is in order, or late. One that goes farther back is passed over. One farther
    ahead waits for the next: unless that is ahead too, it was one row far off and is passed over.

    Args:
        problems: where rows that are passed over are counted.
        begin_ns: time zero on the log's own clock.
    """

    def __init__(self, problems: Counter[str], *, begin_ns: int) -> None:
        super().__init__(problems, begin_ns)

    def put(self, item: Item, clock_ns: int) -> list[Placed[Item]]:
        """Take a row; return what is known now to be in time, in order of arrival."""
        assert self._latest is not None
        if clock_ns < self._latest - NEAR_NS:
            self._problems[JUMP] += 1
            return []
        if clock_ns <= self._latest + NEAR_NS:
            self._pass_over()
            return self._place((item, clock_ns))
        if self._waiting and clock_ns < self._waiting[-1][1] - NEAR_NS:
            self._pass_over()
        self._waiting.append((item, clock_ns))
        return self._go_on() if len(self._waiting) >= _AGREE_ON_A_GAP else []

    def finish(self) -> list[Placed[Item]]:
        """The table has ended: return what lies behind a last gap."""
        return self._go_on()


class LogClock(_Clock[Item]):
    """The clock of one log, whose zero moves where a receiver's clock is set anew.

    Args:
        problems: where epochs that are passed over are counted, and wrong dates.
    """

    def __init__(self, problems: Counter[str]) -> None:
        super().__init__(problems, None)
        self._date = LogDate(problems)

    @property
    def start_utc_ns(self) -> int | None:
        """Time zero, ns since 1970; None while no date is known. A clock that is set anew moves it, and so does a date
        that is: what a receiver says before it has found the time dates nothing."""
        return None if self._date.shift_ns is None else self._zero + self._date.shift_ns

    def put(self, item: Item, time_of_day_ns: int, day: int | None) -> list[Placed[Item]]:
        """Take an epoch; return what is known now to be in time, in order of arrival.

        Args:
            item: what to put in time.
            time_of_day_ns: since midnight, UTC.
            day: its date, days since 1970, where it is told.
        """
        if self._latest is None:
            if day is not None:
                self._date.take(0)
            return self._put(item, (day or 0) * DAY_NS + time_of_day_ns)
        near = _nearest(time_of_day_ns, self._latest)
        if self._waiting and abs(near - self._latest) > NEAR_NS:
            near = _nearest(time_of_day_ns, self._waiting[-1][1])
        if day is None:
            return self._put(item, near)
        utc_ns = day * DAY_NS + time_of_day_ns
        shift_ns = self._date.shift_ns
        if shift_ns is not None and abs(near - self._latest) > NEAR_NS:
            return self._put(item, utc_ns - shift_ns)
        self._date.take(utc_ns - near)
        return self._put(item, near)

    def put_absolute(self, item: Item, utc_ns: int) -> list[Placed[Item]]:
        """The same with a clock that tells days and time at once, ns since 1970 (UTC)."""
        self._date.take(0)
        return self._put(item, utc_ns)

    def _put(self, item: Item, clock_ns: int) -> list[Placed[Item]]:
        if self._latest is None:
            self._latest = self._zero = clock_ns
        if abs(clock_ns - self._latest) <= NEAR_NS:
            self._pass_over()
            return self._place((item, clock_ns))
        if self._waiting and not follows(clock_ns - self._waiting[-1][1]):
            self._pass_over()
        self._waiting.append((item, clock_ns))
        if self._is_gap():
            return self._go_on() if len(self._waiting) >= _AGREE_ON_A_GAP else []
        if len(self._waiting) < _AGREE_ON_A_JUMP:
            return []
        self._problems[RESTART] += 1
        self._date.set_anew()
        first = self._waiting[0][1]
        self._zero += first - self._latest - NS_PER_S
        self._latest = first
        return self._go_on()

    def finish(self) -> list[Placed[Item]]:
        """The log has ended: return what lies behind a last gap."""
        self._date.finish()
        if self._waiting and self._is_gap():
            return self._go_on()
        self._pass_over()
        return []

    def _is_gap(self) -> bool:
        assert self._latest is not None
        return NEAR_NS < self._waiting[0][1] - self._latest <= LONGEST_GAP_NS
