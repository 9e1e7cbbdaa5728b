"""Sentences of NMEA 0183: checksum, fields, numbers, times and angles, as receivers write them.

A sentence is ``$``, a body of fields between commas, ``*`` and the exclusive or of the body's bytes in hexadecimal. The
body begins with the talker (GP, GN, GL, ...) and the type (GGA, ...), or with P and a maker's own name.

Source: NMEA 0183 as u-blox's F9 interface description and gpsd's notes tell it.
"""

from __future__ import annotations

import functools
import math
import operator

from twin.formats.bad_lines import (
    CHECKSUM,
    MISSING,
    NO_CHECKSUM,
    NOT_A_NUMBER,
    OUT_OF_RANGE,
    BadLineError,
    number,
)
from twin.signals import NS_PER_S

KNOT_M_S = 1852.0 / 3600.0
KMH_M_S = 1.0 / 3.6
NAN = math.nan

MODES = {b"A": 1, b"D": 2, b"P": 3, b"R": 4, b"F": 5, b"E": 6, b"M": 7, b"S": 8, b"N": 0}
"""Quality as GGA has it, by the mode letter of RMC, VTG and GNS."""


def checksum(body: bytes) -> int:
    """Exclusive or of all bytes."""
    return functools.reduce(operator.xor, body, 0)


def framed(body: str) -> str:
    """The whole sentence of a body, with its line's end."""
    return f"${body}*{checksum(body.encode('ascii')):02X}\r\n"


def fields_of(text: bytes) -> list[bytes]:
    """Fields of what follows a ``$``, if its checksum is right.

    Raises:
        BadLineError: the checksum is missing or wrong.
    """
    body, star, told = text.partition(b"*")
    told = told.rstrip()
    if not star or len(told) != 2:
        raise BadLineError(NO_CHECKSUM)
    if b"%02X" % checksum(body) != told.upper():
        raise BadLineError(CHECKSUM)
    return body.split(b",")


def told(field: bytes, low: float, high: float) -> float:
    """A number within limits; NaN where the field is empty.

    Raises:
        BadLineError: it is none, or beyond the limits.
    """
    return number(field, low, high) if field else NAN


def needed(field: bytes, low: float, high: float) -> float:
    """A number within limits that has to be there.

    Raises:
        BadLineError: it is missing, none, or beyond the limits.
    """
    if not field:
        raise BadLineError(MISSING)
    return number(field, low, high)


@functools.lru_cache(maxsize=8)
def time_of_day_ns(field: bytes) -> int:
    """``hhmmss.ss`` as nanoseconds since midnight, all digits kept.

    Raises:
        BadLineError: it is missing or no time.
    """
    if not field:
        raise BadLineError(MISSING)
    whole, _, fraction = field.partition(b".")
    if len(whole) != 6 or not whole.isdigit() or (fraction and not fraction.isdigit()):
        raise BadLineError(NOT_A_NUMBER)
    hours, minutes, seconds = int(whole[:2]), int(whole[2:4]), int(whole[4:])
    if hours > 23 or minutes > 59 or seconds > 60:
        raise BadLineError(OUT_OF_RANGE)
    return (hours * 3600 + minutes * 60 + seconds) * NS_PER_S + int(fraction.ljust(9, b"0")[:9])


def degrees(field: bytes, side: bytes, sides: bytes, most: float) -> float:
    """``dddmm.mmm`` with its side (``N``, ``S``, ``E``, ``W``) as degrees; ``sides`` are the positive and negative one.

    Raises:
        BadLineError: one of them is missing, or no such angle.
    """
    if not field or not side:
        raise BadLineError(MISSING)
    point = field.find(b".")
    tens = (len(field) if point < 0 else point) - 2
    minutes = needed(field[tens:] if tens > 0 else field, 0.0, 60.0)
    whole = field[:tens] if tens > 0 else b"0"
    if not whole.isdigit() or len(whole) > 3 or minutes >= 60.0 or side not in sides or len(side) != 1:
        raise BadLineError(OUT_OF_RANGE)
    angle = int(whole) + minutes / 60.0
    if angle > most:
        raise BadLineError(OUT_OF_RANGE)
    return angle if side == sides[:1] else -angle
