"""``$PANDA`` and ``$PAOGI``, the sentences that AgOpenGPS's boards send instead of a receiver's own.

Both have the fields time, latitude, longitude, quality, satellites, HDOP, height above the sea, age, speed in **knots**
(the boards hand on VTG's fifth field, and AgOpenGPS multiplies by 1.852), heading, roll, pitch and yaw rate, with these
traps:

- ``$PANDA`` (one antenna and an IMU) has the last four as whole **tenths** of degrees and of degrees per second, and
  heading 65535 with zeros where there is no IMU: read as a heading it would be 6553.5 degrees. Heading runs from 0 to
  3599; 359.96 degrees are 0, not 3600.
- ``$PAOGI`` (two antennas) has the same in degrees, with a decimal point.

Heading is the compass's, clockwise from north; roll is positive right side down, which is the twin's; pitch is positive
nose up, which is minus the twin's; the yaw rate is positive clockwise, minus the twin's.

Source: the sentences' description and scaling in AgOpenGPS's AgIO and in the firmware of its boards (Ace, All-in-one).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from twin.formats.bad_lines import MISSING, NOT_A_NUMBER, BadLineError
from twin.formats.geodetic import heading_rad
from twin.formats.nmea import KNOT_M_S, told
from twin.formats.nmea_epoch import Epoch, fix_of, take_height

PANDA, PAOGI = b"PANDA", b"PAOGI"
AGOPENGPS = frozenset({PANDA, PAOGI})
NO_IMU = 65535
_FIELDS = 16
_TENTHS = 0.1


def read_panda(epoch: Epoch, fields: Sequence[bytes]) -> None:
    """Read either sentence into an epoch; its height is above the sea, whose own nobody tells.

    Raises:
        BadLineError: a field is missing, no number, or out of range.
    """
    if len(fields) < _FIELDS:
        raise BadLineError(MISSING)
    height, age = told(fields[9], -10_000.0, 100_000.0), told(fields[10], 0.0, 1e6)
    speed = told(fields[11], -2_000.0, 2_000.0) * KNOT_M_S
    attitude = _tenths(fields) if fields[0] == PANDA else _plain(fields)
    if fix_of(epoch, fields) and epoch.quality:
        take_height(epoch, height, math.nan)
        epoch.age_s = age
        if not epoch.speed_by:
            epoch.speed_by, epoch.speed_m_s = 1, speed
    epoch.attitude = attitude


def _tenths(fields: Sequence[bytes]) -> tuple[float, float, float, float] | None:
    for field in fields[12:16]:
        if field and not field.removeprefix(b"-").isdigit():
            raise BadLineError(NOT_A_NUMBER)
    if not fields[12] or told(fields[12], 0.0, NO_IMU) == NO_IMU:
        return None
    heading = _TENTHS * told(fields[12], 0.0, 3_600.0)
    return _attitude(heading, *(_TENTHS * told(field, -32_768.0, 32_767.0) for field in fields[13:16]))


def _plain(fields: Sequence[bytes]) -> tuple[float, float, float, float] | None:
    if not fields[12]:
        return None
    roll, pitch, yaw_rate = (told(field, -3_600.0, 3_600.0) for field in fields[13:16])
    return _attitude(told(fields[12], 0.0, 360.0), roll, pitch, yaw_rate)


def _attitude(heading: float, roll: float, pitch: float, yaw_rate: float) -> tuple[float, float, float, float]:
    return math.radians(roll), -math.radians(pitch), heading_rad(heading), -math.radians(yaw_rate)
