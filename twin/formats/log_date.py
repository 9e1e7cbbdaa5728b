"""Which date a log has, by what its receiver says of the day from epoch to epoch.

The first date that is told dates the log. A receiver may know the time of day before the week, and count days from the
beginning of GPS time, or from a wrong span of 1024 weeks, until then: where ``AGREE`` later dates in a row say another
day, they are right and those before were wrong. Dates that are found wrong either way are counted.
"""

from __future__ import annotations

from collections import Counter

AGREE = 3
WRONG_DATE = "wrong date"


class LogDate:
    """From a log's clock to the time since 1970.

    Args:
        problems: where wrong dates are counted.
    """

    def __init__(self, problems: Counter[str]) -> None:
        self._problems = problems
        self.shift_ns: int | None = None
        """From the clock to the time since 1970, ns; None without a date."""
        self._told = 0
        """Dates that say so, since the clock was set last."""
        self._other_ns = 0
        """What the latest dates say instead."""
        self._others = 0

    def take(self, shift_ns: int) -> None:
        """Take what an epoch's date makes of the shift."""
        if self.shift_ns is None:
            self.shift_ns = shift_ns
        if shift_ns == self.shift_ns:
            self._told += 1
            self._pass_over_others()
            return
        if shift_ns != self._other_ns:
            self._pass_over_others()
        self._other_ns = shift_ns
        self._others += 1
        if self._others == AGREE:
            self._count(self._told)
            self.shift_ns, self._told, self._others = shift_ns, AGREE, 0

    def set_anew(self) -> None:
        """The receiver's clock was set: what was said of the one before was not wrong."""
        self._told = 0

    def finish(self) -> None:
        """The log has ended."""
        self._pass_over_others()

    def _pass_over_others(self) -> None:
        self._count(self._others)
        self._others = 0

    def _count(self, wrong: int) -> None:
        if wrong:
            self._problems[WRONG_DATE] += wrong
