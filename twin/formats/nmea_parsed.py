"""Sentences that come seldom: GNS, GLL and ZDA, read by pynmeagps but for latitude and longitude.

Those are read from the fields, as everywhere: pynmeagps takes minutes beyond 60, signs within angles and missing
hemispheres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from pynmeagps import NMEAMessageError, NMEAParseError, NMEAReader, NMEATypeError

from twin.formats.bad_lines import MISSING, NOT_A_NUMBER, OUT_OF_RANGE, BadLineError
from twin.formats.dates import day_of
from twin.formats.nmea import MODES, NAN
from twin.formats.nmea_epoch import BY_GLL, BY_GNS, HIGHEST_M, LOWEST_M, Epoch, angles_of, take_height, take_place


def _parsed(fields: Sequence[bytes]) -> Any:
    """A sentence read by pynmeagps."""
    try:
        message = NMEAReader.parse(b"$" + b",".join(fields) + b"*00\r\n", validate=0)
    except (NMEAParseError, NMEAMessageError, NMEATypeError, ValueError, TypeError, LookupError, OverflowError):
        raise BadLineError(NOT_A_NUMBER) from None
    if message is None:
        raise BadLineError(MISSING)
    return message


def _told(message: Any, name: str, low: float, high: float) -> float:
    value = getattr(message, name, "")
    if value == "":  # pynmeagps's word for an empty field
        return NAN
    if not isinstance(value, int | float):
        raise BadLineError(NOT_A_NUMBER)
    if not low <= value <= high:
        raise BadLineError(OUT_OF_RANGE)
    return float(value)


def read_gns(epoch: Epoch, fields: Sequence[bytes]) -> None:
    """Position by several constellations, as GGA otherwise."""
    if len(fields) < 13:
        raise BadLineError(MISSING)
    message = _parsed(fields)
    quality = best_mode(fields[6])
    latitude, longitude = angles_of(fields, 2) if quality else (NAN, NAN)
    height, geoid = _told(message, "alt", LOWEST_M, HIGHEST_M), _told(message, "sep", -200.0, 200.0)
    satellites, hdop = _told(message, "numSV", 0, 999), _told(message, "HDOP", 0.0, 9_999.0)
    age = _told(message, "diffAge", 0.0, 1e6)
    if not take_place(epoch, BY_GNS, latitude, longitude, quality):
        return
    epoch.satellites = satellites
    if quality:
        epoch.hdop, epoch.age_s = hdop, age
        take_height(epoch, height, geoid)


def best_mode(letters: bytes) -> int:
    """Quality of the best of several constellations' modes, RTK fixed before float before what is lesser."""
    modes = {letters[index : index + 1] for index in range(len(letters))}
    return next((MODES[mode] for mode in (b"R", b"F", b"P", b"D", b"A", b"E", b"M", b"S") if mode in modes), 0)


def read_gll(epoch: Epoch, fields: Sequence[bytes]) -> None:
    """Position alone."""
    if len(fields) < 7:
        raise BadLineError(MISSING)
    mode = fields[7] if len(fields) > 7 else b""
    quality = MODES.get(mode, 1) if fields[6] == b"A" else 0
    latitude, longitude = angles_of(fields, 1) if quality else (NAN, NAN)
    take_place(epoch, BY_GLL, latitude, longitude, quality)


def read_zda(epoch: Epoch, fields: Sequence[bytes]) -> None:
    """The date."""
    if len(fields) < 5:
        raise BadLineError(MISSING)
    message = _parsed(fields)
    year, month, day = (_told(message, name, 0, 9_999) for name in ("year", "month", "day"))
    if math.isnan(year + month + day):
        return
    epoch.day = day_of(int(year), int(month), int(day))
