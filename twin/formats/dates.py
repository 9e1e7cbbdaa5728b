"""The dates that a log may have: from the beginning of GPS time on, as far as two digits of a year reach."""

from __future__ import annotations

import datetime as dt

from twin.formats.bad_lines import OUT_OF_RANGE, BadLineError
from twin.signals import NS_PER_S

FIRST_YEAR, LAST_YEAR = 1980, 2079
_DAY_NS = 86_400 * NS_PER_S
_EPOCH = dt.date(1970, 1, 1).toordinal()
_BEGIN_NS = (dt.date(FIRST_YEAR, 1, 1).toordinal() - _EPOCH) * _DAY_NS
_END_NS = (dt.date(LAST_YEAR + 1, 1, 1).toordinal() - _EPOCH) * _DAY_NS


def day_of(year: int, month: int, day: int) -> int:
    """Days since 1970 of a date.

    Raises:
        BadLineError: there is no such date, or it lies outside of the years.
    """
    if not FIRST_YEAR <= year <= LAST_YEAR:
        raise BadLineError(OUT_OF_RANGE)
    try:
        return dt.date(year, month, day).toordinal() - _EPOCH
    except ValueError:
        raise BadLineError(OUT_OF_RANGE) from None


def require_dated(utc_ns: int) -> None:
    """See that a time, ns since 1970, lies within the years.

    Raises:
        BadLineError: it does not.
    """
    if not _BEGIN_NS <= utc_ns < _END_NS:
        raise BadLineError(OUT_OF_RANGE)
