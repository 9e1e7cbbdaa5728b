"""What single sentences say: each reader writes what a sentence tells into the epoch it belongs to.

GGA, RMC, VTG, GST and GSA are split here, because a log consists of them: pynmeagps takes 51 us for a sentence, which
is 7 s for an hour at 10 Hz (144 000 of them); this takes 9 us with all that is made of it. GNS, GLL and ZDA are left to
pynmeagps. ``$PANDA`` and ``$PAOGI`` are AgOpenGPS's (:mod:`twin.formats.panda`).
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Callable, Sequence
from typing import Any

from pynmeagps import (
    NMEAMessageError,
    NMEAParseError,
    NMEAReader,
    NMEATypeError,
)

from twin.formats.nmea import (
    KMH_M_S,
    KNOT_M_S,
    MISSING,
    MODES,
    NAN,
    NOT_A_NUMBER,
    OUT_OF_RANGE,
    BadSentenceError,
    degrees,
    needed,
    number,
)

_EPOCH = dt.date(1970, 1, 1).toordinal()
_LOWEST_M, _HIGHEST_M = -10_000.0, 100_000.0
_FASTEST_KNOTS = 2_000.0
_GSA, _VTG, _GST = 18, 9, 9
_BY_GLL, _BY_RMC, _BY_GNS, _BY_GGA = 1, 2, 3, 4
"""Whose position counts."""


class Epoch:
    """What the sentences of one epoch said; NaN for what none of them did."""

    __slots__ = (
        "age_s",
        "attitude",
        "compass_deg",
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
        "sigma_e_m",
        "sigma_n_m",
        "sigma_u_m",
        "speed_by",
        "speed_m_s",
        "time_of_day_ns",
        "vdop",
    )

    def __init__(self, time_of_day_ns: int) -> None:
        self.time_of_day_ns = time_of_day_ns
        self.day: int | None = None
        """Its date, days since 1970."""
        self.seen: set[bytes] = set()
        """Types of the sentences it has."""
        self.place_by = 0
        """Whose position it has: the higher, the better."""
        self.speed_by = 0
        self.latitude_deg = self.longitude_deg = self.height_m = self.geoid_m = NAN
        self.quality = self.satellites = self.hdop = self.vdop = self.age_s = NAN
        self.speed_m_s = self.compass_deg = NAN
        self.sigma_e_m = self.sigma_n_m = self.sigma_u_m = NAN
        self.attitude: tuple[float, float, float, float] | None = None
        """Roll, pitch, heading and yaw rate of an IMU, in the twin's convention (rad, rad/s)."""


Reader = Callable[[Epoch, Sequence[bytes]], None]


def _place(epoch: Epoch, by: int, latitude: float, longitude: float, quality: float) -> bool:
    """Take a position, unless the epoch has a better one; without a quality there is no position."""
    if by <= epoch.place_by:
        return False
    epoch.place_by = by
    epoch.latitude_deg, epoch.longitude_deg = (latitude, longitude) if quality else (NAN, NAN)
    epoch.quality = quality
    epoch.height_m = NAN
    return True


def _speed(epoch: Epoch, by: int, speed_m_s: float, compass_deg: float) -> None:
    if by > epoch.speed_by and not math.isnan(speed_m_s):
        epoch.speed_by = by
        epoch.speed_m_s, epoch.compass_deg = speed_m_s, compass_deg


def _angles(fields: Sequence[bytes], first: int) -> tuple[float, float]:
    return (
        degrees(fields[first], fields[first + 1], b"NS", 90.0),
        degrees(fields[first + 2], fields[first + 3], b"EW", 180.0),
    )


def height_above_ellipsoid(epoch: Epoch, above_sea_m: float, geoid_m: float) -> None:
    """Take a height above the sea; where the sea's is not told, it counts as the ellipsoid's."""
    epoch.geoid_m = geoid_m
    epoch.height_m = above_sea_m + (0.0 if math.isnan(geoid_m) else geoid_m)


def fix_of(epoch: Epoch, fields: Sequence[bytes]) -> bool:
    """Fields 2 to 8 as GGA has them: position, quality, satellites, HDOP; whether the epoch wanted the position."""
    quality = needed(fields[6], 0, 9)
    if quality != int(quality):
        raise BadSentenceError(NOT_A_NUMBER)
    latitude, longitude = _angles(fields, 2) if quality else (NAN, NAN)
    satellites, hdop = number(fields[7], 0, 999), number(fields[8], 0.0, 9_999.0)
    if not _place(epoch, _BY_GGA, latitude, longitude, quality):
        return False
    epoch.satellites = satellites
    if quality:
        epoch.hdop = hdop
    return True


def _gga(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < 15:
        raise BadSentenceError(MISSING)
    height, geoid = number(fields[9], _LOWEST_M, _HIGHEST_M), number(fields[11], -200.0, 200.0)
    age = number(fields[13], 0.0, 1e6)
    if fix_of(epoch, fields) and epoch.quality:
        height_above_ellipsoid(epoch, height, geoid)
        epoch.age_s = age


def _rmc(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < 10:
        raise BadSentenceError(MISSING)
    mode = fields[12] if len(fields) > 12 else b""
    quality = MODES.get(mode, 1) if fields[2] == b"A" else 0
    latitude, longitude = _angles(fields, 3) if quality else (NAN, NAN)
    speed, compass = number(fields[7], 0.0, _FASTEST_KNOTS) * KNOT_M_S, number(fields[8], 0.0, 360.0)
    day = _day(fields[9])
    if day is not None:
        epoch.day = day
    _place(epoch, _BY_RMC, latitude, longitude, quality)
    if quality:
        _speed(epoch, 2, speed, compass)


def _day(field: bytes) -> int | None:
    """``ddmmyy`` as days since 1970; from 80 on the years are the last century's."""
    if not field:
        return None
    if len(field) != 6 or not field.isdigit():
        raise BadSentenceError(NOT_A_NUMBER)
    year = int(field[4:])
    try:
        date = dt.date(year + (1900 if year >= 80 else 2000), int(field[2:4]), int(field[:2]))
    except ValueError:
        raise BadSentenceError(OUT_OF_RANGE) from None
    return date.toordinal() - _EPOCH


def _vtg(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < _VTG:
        raise BadSentenceError(MISSING)
    compass = number(fields[1], 0.0, 360.0)
    speed = number(fields[7], 0.0, _FASTEST_KNOTS * 1.852) * KMH_M_S
    if math.isnan(speed):
        speed = number(fields[5], 0.0, _FASTEST_KNOTS) * KNOT_M_S
    if len(fields) <= _VTG or fields[9] != b"N":
        _speed(epoch, 1, speed, compass)


def _gst(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < _GST:
        raise BadSentenceError(MISSING)
    north, east, up = (number(field, 0.0, 1e7) for field in fields[6:9])
    epoch.sigma_n_m, epoch.sigma_e_m, epoch.sigma_u_m = north, east, up


def _gsa(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < _GSA:
        raise BadSentenceError(MISSING)
    hdop, vdop = number(fields[16], 0.0, 9_999.0), number(fields[17], 0.0, 9_999.0)
    if fields[2] == b"1":  # no fix
        return
    if math.isnan(epoch.vdop):
        epoch.vdop = vdop
    if math.isnan(epoch.hdop):
        epoch.hdop = hdop


def _parsed(fields: Sequence[bytes]) -> Any:
    """A sentence read by pynmeagps."""
    try:
        message = NMEAReader.parse(b"$" + b",".join(fields) + b"*00\r\n", validate=0)
    except (NMEAParseError, NMEAMessageError, NMEATypeError, ValueError, TypeError, LookupError, OverflowError):
        raise BadSentenceError(NOT_A_NUMBER) from None
    if message is None:
        raise BadSentenceError(MISSING)
    return message


def _told(message: Any, name: str, low: float, high: float) -> float:
    value = getattr(message, name, "")
    if value == "":  # pynmeagps's word for an empty field
        return NAN
    if not isinstance(value, int | float):
        raise BadSentenceError(NOT_A_NUMBER)
    if not low <= value <= high:
        raise BadSentenceError(OUT_OF_RANGE)
    return float(value)


def _gns(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < 13:
        raise BadSentenceError(MISSING)
    message = _parsed(fields)
    quality = best_mode(fields[6])
    latitude, longitude = _told(message, "lat", -90.0, 90.0), _told(message, "lon", -180.0, 180.0)
    height, geoid = _told(message, "alt", _LOWEST_M, _HIGHEST_M), _told(message, "sep", -200.0, 200.0)
    satellites, hdop = _told(message, "numSV", 0, 999), _told(message, "HDOP", 0.0, 9_999.0)
    age = _told(message, "diffAge", 0.0, 1e6)
    if not _place(epoch, _BY_GNS, latitude, longitude, quality):
        return
    epoch.satellites = satellites
    if quality:
        epoch.hdop, epoch.age_s = hdop, age
        height_above_ellipsoid(epoch, height, geoid)


def best_mode(letters: bytes) -> int:
    """Quality of the best of several constellations' modes, RTK fixed before float before what is lesser."""
    modes = {letters[index : index + 1] for index in range(len(letters))}
    return next((MODES[mode] for mode in (b"R", b"F", b"P", b"D", b"A", b"E", b"M", b"S") if mode in modes), 0)


def _gll(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < 7:
        raise BadSentenceError(MISSING)
    message = _parsed(fields)
    mode = fields[7] if len(fields) > 7 else b""
    quality = MODES.get(mode, 1) if fields[6] == b"A" else 0
    latitude, longitude = _told(message, "lat", -90.0, 90.0), _told(message, "lon", -180.0, 180.0)
    _place(epoch, _BY_GLL, latitude, longitude, quality)


def _zda(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < 5:
        raise BadSentenceError(MISSING)
    message = _parsed(fields)
    year, month, day = (_told(message, name, 0, 9_999) for name in ("year", "month", "day"))
    if math.isnan(year + month + day):
        return
    try:
        epoch.day = dt.date(int(year), int(month), int(day)).toordinal() - _EPOCH
    except ValueError:
        raise BadSentenceError(OUT_OF_RANGE) from None


TIMED: dict[bytes, tuple[int, Reader]] = {
    b"GGA": (1, _gga),
    b"RMC": (1, _rmc),
    b"GST": (1, _gst),
    b"GNS": (1, _gns),
    b"GLL": (5, _gll),
    b"ZDA": (1, _zda),
}
"""Sentences with a time: in which field, and how they are read."""
UNTIMED: dict[bytes, Reader] = {b"VTG": _vtg, b"GSA": _gsa}
"""Sentences without one."""
