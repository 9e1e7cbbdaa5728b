"""What single sentences say: each reader writes what a sentence tells into the epoch it belongs to.

GGA, RMC, VTG, GST and GSA are split here, because a log consists of them: pynmeagps takes 51 us for a sentence, which
is 7 s for an hour at 10 Hz (144 000 of them); this takes 9 us with all that is made of it. GNS, GLL and ZDA come
seldom (:mod:`twin.formats.nmea_parsed`). ``$PANDA`` and ``$PAOGI`` are AgOpenGPS's (:mod:`twin.formats.panda`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from twin.formats.bad_lines import MISSING, NOT_A_NUMBER, BadLineError
from twin.formats.dates import day_of
from twin.formats.nmea import KMH_M_S, KNOT_M_S, MODES, NAN, told
from twin.formats.nmea_epoch import (
    BY_RMC,
    HIGHEST_M,
    LOWEST_M,
    Epoch,
    angles_of,
    fix_of,
    take_height,
    take_place,
    take_speed,
)
from twin.formats.nmea_parsed import read_gll, read_gns, read_zda

_FASTEST_KNOTS = 2_000.0
_GSA, _VTG, _GST = 18, 9, 9
"""Fields they have at least."""

Reader = Callable[[Epoch, Sequence[bytes]], None]


def _gga(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < 15:
        raise BadLineError(MISSING)
    height, geoid = told(fields[9], LOWEST_M, HIGHEST_M), told(fields[11], -200.0, 200.0)
    age = told(fields[13], 0.0, 1e6)
    if fix_of(epoch, fields) and epoch.quality:
        take_height(epoch, height, geoid)
        epoch.age_s = age


def _rmc(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < 10:
        raise BadLineError(MISSING)
    mode = fields[12] if len(fields) > 12 else b""
    quality = MODES.get(mode, 1) if fields[2] == b"A" else 0
    latitude, longitude = angles_of(fields, 3) if quality else (NAN, NAN)
    speed, compass = told(fields[7], 0.0, _FASTEST_KNOTS) * KNOT_M_S, told(fields[8], 0.0, 360.0)
    day = _day(fields[9])
    take_place(epoch, BY_RMC, latitude, longitude, quality)
    if quality:
        take_speed(epoch, 2, speed, compass)
        if day is not None:
            epoch.day = day


def _day(field: bytes) -> int | None:
    """``ddmmyy`` as days since 1970; from 80 on the years are the last century's."""
    if not field:
        return None
    if len(field) != 6 or not field.isdigit():
        raise BadLineError(NOT_A_NUMBER)
    year = int(field[4:])
    return day_of(year + (1900 if year >= 80 else 2000), int(field[2:4]), int(field[:2]))


def _vtg(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < _VTG:
        raise BadLineError(MISSING)
    compass = told(fields[1], 0.0, 360.0)
    speed = told(fields[7], 0.0, _FASTEST_KNOTS * 1.852) * KMH_M_S
    if math.isnan(speed):
        speed = told(fields[5], 0.0, _FASTEST_KNOTS) * KNOT_M_S
    if len(fields) <= _VTG or fields[9] != b"N":
        take_speed(epoch, 1, speed, compass)


def _gst(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < _GST:
        raise BadLineError(MISSING)
    north, east, up = (told(field, 0.0, 1e7) for field in fields[6:9])
    epoch.sigma_n_m, epoch.sigma_e_m, epoch.sigma_u_m = north, east, up


def _gsa(epoch: Epoch, fields: Sequence[bytes]) -> None:
    if len(fields) < _GSA:
        raise BadLineError(MISSING)
    hdop, vdop = told(fields[16], 0.0, 9_999.0), told(fields[17], 0.0, 9_999.0)
    if fields[2] == b"1":  # no fix
        return
    if math.isnan(epoch.vdop):
        epoch.vdop = vdop
    if math.isnan(epoch.hdop):
        epoch.hdop = hdop


TIMED: dict[bytes, tuple[int, Reader]] = {
    b"GGA": (1, _gga),
    b"RMC": (1, _rmc),
    b"GST": (1, _gst),
    b"GNS": (1, read_gns),
    b"GLL": (5, read_gll),
    b"ZDA": (1, read_zda),
}
"""Sentences with a time: in which field, and how they are read."""
UNTIMED: dict[bytes, Reader] = {b"VTG": _vtg, b"GSA": _gsa}
"""Sentences without one."""
