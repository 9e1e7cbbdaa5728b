"""How a receiver writes its sentences: which, with how many digits, and under whose name."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Collection
from typing import Annotated, Literal

from pydantic import Field, Strict, field_validator

from twin.config import Config
from twin.formats.nmea import KNOT_M_S

SentenceType = Literal["GGA", "RMC", "VTG", "GSA", "GST"]
_MINUTE_M = KNOT_M_S * 3600.0
"""Of latitude."""

Digits = Annotated[int, Field(ge=0, le=6)]


class NmeaStyle(Config):
    """What a simulated receiver's sentences look like. The defaults are those of an RTK receiver in its mode of high
    precision, which breaks the 82 characters that NMEA 0183 allows, as such receivers do."""

    talker: Annotated[str, Field(pattern=r"^[A-Z]{2}$")] = "GN"
    """GP for GPS alone, GN for several constellations, GL, GA, GB, ... ."""
    sentences: Annotated[tuple[SentenceType, ...], Strict(strict=False), Field(min_length=1)] = (
        "RMC",
        "VTG",
        "GGA",
        "GSA",
        "GST",
    )
    """In the order in which they are sent. Only GSA tells VDOP; the satellites' numbers in it stay empty."""
    minute_decimals: Annotated[int, Field(ge=2, le=8)] = 7
    """Of the minutes of latitude and longitude: five are 18.5 mm, seven 0.2 mm."""
    time_decimals: Annotated[int, Field(ge=0, le=3)] = 2
    height_decimals: Digits = 3
    """Of the height above the sea and the geoid's, m."""
    speed_decimals: Digits = 3
    """Of knots and of km/h."""
    course_decimals: Digits = 2
    dop_decimals: Digits = 2
    age_decimals: Digits = 1
    sigma_decimals: Digits = 3
    most_satellites: Annotated[int, Field(ge=4, le=99)] = 99
    """More are told as this many: older versions of NMEA know twelve."""
    station: Annotated[int, Field(ge=0, le=4095)] = 0
    """Identifier of the reference station, told where there are corrections."""
    rtk_modes: bool = True
    """Tell RTK fixed and float by the modes R and F of RMC and VTG. Without, both are D, as receivers of NMEA 2.3 to
    4.x write that know neither; the field of the mode, which came with version 2.3, is there in any case."""
    start_utc: str = "2026-04-01T08:00:00Z"
    """Date and time of the run's time zero."""
    imu: str | None = None
    """Attitude reference whose roll and heading ``$PANDA`` and ``$PAOGI`` tell; by default the first there is."""

    @field_validator("start_utc")
    @classmethod
    def _a_time(cls, value: str) -> str:
        when = dt.datetime.fromisoformat(value)
        if when.tzinfo is None or when.utcoffset() != dt.timedelta(0):
            raise ValueError("expected a time in UTC, as 2026-04-01T08:00:00Z")
        if not 1980 <= when.year < 2080:
            raise ValueError("the two digits of RMC's year stand for 1980 to 2079")
        return value

    @property
    def start_utc_ns(self) -> int:
        """Time zero, ns since 1970."""
        since = dt.datetime.fromisoformat(self.start_utc) - dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
        return (since // dt.timedelta(microseconds=1)) * 1000


def usual_style(*, resolution_m: float, qualities: Collection[int]) -> NmeaStyle:
    """The style of a receiver that nobody described.

    Args:
        resolution_m: step of its position; zero for all digits. A receiver prints the fewest decimals that show it.
        qualities: those that it can have; one that knows neither RTK fixed nor float is a simple one, and tells
            heights and standard deviations to 0.1 m.
    """
    # a hundredth less: the 1852 m of a minute are rounded, and so is a resolution that means five decimals
    decimals = 7 if resolution_m <= 0.0 else math.ceil(math.log10(_MINUTE_M / resolution_m) - 0.01)
    digits = min(max(decimals, 2), 8)
    if {4, 5}.intersection(qualities):
        return NmeaStyle(minute_decimals=digits)
    return NmeaStyle(talker="GP", minute_decimals=digits, height_decimals=1, sigma_decimals=1)
