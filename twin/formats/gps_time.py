"""GPS time and UTC: GPS time counts from 1980 and knows no leap seconds."""

from __future__ import annotations

import bisect
import datetime as dt

UNIX_OF_GPS_S = 315_964_800
"""6 January 1980."""
_LEAP_DAYS = (
    "1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01",
    "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01",
    "2015-07-01", "2017-01-01",
)  # fmt: skip
"""Days before which a leap second was put in (IERS Bulletin C)."""
_LEAPS_S = [int(dt.datetime.fromisoformat(f"{day}T00:00:00+00:00").timestamp()) for day in _LEAP_DAYS]


def leap_seconds(gps_unix_s: float) -> int:
    """By how many seconds GPS time is ahead of UTC, at a time counted in GPS time since 1970."""
    leaps = [leap + index + 1 for index, leap in enumerate(_LEAPS_S)]
    return bisect.bisect_right(leaps, gps_unix_s)
