"""What the sentences of one epoch said, and which of them is believed."""

from __future__ import annotations

import math
from collections.abc import Sequence

from twin.formats.bad_lines import NOT_A_NUMBER, BadLineError
from twin.formats.nmea import NAN, degrees, needed, told

BY_GLL, BY_RMC, BY_GNS, BY_GGA = 1, 2, 3, 4
"""Whose position counts: the higher, the better."""
LOWEST_M, HIGHEST_M = -10_000.0, 100_000.0
"""Heights that a receiver may tell."""


class Epoch:
    """What the sentences of one epoch said; NaN for what none of them did."""

    __slots__ = (
        "age_s",
        "attitude",
        "course_deg",
        "day",
        "geoid_m",
        "hdop",
        "height_m",
        "latitude_deg",
        "longitude_deg",
        "place_by",
        "quality",
        "satellites",
        "seen",
        "separation_m",
        "sigma_e_m",
        "sigma_n_m",
        "sigma_u_m",
        "speed_by",
        "speed_m_s",
        "time_of_day_ns",
        "vdop",
    )

    def __init__(self, time_of_day_ns: int, separation_m: float) -> None:
        self.time_of_day_ns = time_of_day_ns
        self.separation_m = separation_m
        """Mean sea level above the ellipsoid, as the receiver told it last."""
        self.day: int | None = None
        """Its date, days since 1970."""
        self.seen: set[bytes] = set()
        """Types of the sentences it has."""
        self.place_by = 0
        """Whose position it has: the higher, the better."""
        self.speed_by = 0
        self.latitude_deg = self.longitude_deg = self.height_m = self.geoid_m = NAN
        """``geoid_m`` is what this epoch itself says of the separation."""
        self.quality = self.satellites = self.hdop = self.vdop = self.age_s = NAN
        self.speed_m_s = self.course_deg = NAN
        self.sigma_e_m = self.sigma_n_m = self.sigma_u_m = NAN
        self.attitude: tuple[float, float, float, float] | None = None
        """Roll, pitch, heading and yaw rate of an IMU, in the twin's convention (rad, rad/s)."""


def take_place(epoch: Epoch, by: int, latitude: float, longitude: float, quality: float) -> bool:
    """Take a position, unless the epoch has a better one; without a quality there is no position."""
    if by <= epoch.place_by:
        return False
    epoch.place_by = by
    epoch.latitude_deg, epoch.longitude_deg = (latitude, longitude) if quality else (NAN, NAN)
    epoch.quality = quality
    epoch.height_m = NAN
    return True


def take_speed(epoch: Epoch, by: int, speed_m_s: float, course_deg: float) -> None:
    """Take a speed and a course, unless the epoch has better ones; unknown ones are none."""
    if by > epoch.speed_by and not math.isnan(speed_m_s):
        epoch.speed_by = by
        epoch.speed_m_s, epoch.course_deg = speed_m_s, course_deg


def angles_of(fields: Sequence[bytes], first: int) -> tuple[float, float]:
    """Latitude and longitude of four fields.

    Raises:
        BadLineError: one is missing, or no such angle.
    """
    return (
        degrees(fields[first], fields[first + 1], b"NS", 90.0),
        degrees(fields[first + 2], fields[first + 3], b"EW", 180.0),
    )


def take_height(epoch: Epoch, above_sea_m: float, geoid_m: float) -> None:
    """Take a height above the sea, and the sea's above the ellipsoid; where that is not told, the last one stays."""
    if not math.isnan(geoid_m):
        epoch.geoid_m = epoch.separation_m = geoid_m
    epoch.height_m = above_sea_m + epoch.separation_m


def fix_of(epoch: Epoch, fields: Sequence[bytes]) -> bool:
    """Fields 2 to 8 as GGA has them: position, quality, satellites, HDOP; whether the epoch wanted the position.

    Raises:
        BadLineError: a field is missing, no number, or out of range.
    """
    quality = needed(fields[6], 0, 9)
    if quality != int(quality):
        raise BadLineError(NOT_A_NUMBER)
    latitude, longitude = angles_of(fields, 2) if quality else (NAN, NAN)
    satellites, hdop = told(fields[7], 0, 999), told(fields[8], 0.0, 9_999.0)
    if not take_place(epoch, BY_GGA, latitude, longitude, quality):
        return False
    epoch.satellites = satellites
    if quality:
        epoch.hdop = hdop
    return True
