"""From what a receiver's log says, epoch by epoch, to measurements with the columns of a simulated receiver."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from twin.formats.geodetic import Origin
from twin.formats.log_clock import Placed
from twin.geometry import wrap_angle
from twin.signals import POSITION, FloatArray, Measurement, Mount

GNSS = "gnss"
"""Name and kind of a log's receiver."""
COLUMNS = (
    *POSITION,
    "speed_m_s",
    "course_rad",
    "sigma_e_m",
    "sigma_n_m",
    "sigma_u_m",
    "quality",
    "satellites",
    "hdop",
    "vdop",
    "age_s",
)
"""Those of :class:`twin.sensors.gnss.Gnss`."""
UNKNOWN_MOUNT = Mount(body="log", xyz_m=(0.0, 0.0, 0.0))
"""A log does not say where its sensors sit."""
_BLOCK = 256
_LATITUDES = (-89.0, 89.0)
"""What :class:`Origin` allows."""


class Fix(NamedTuple):
    """One epoch of a receiver; NaN for what it did not say."""

    t_ns: int
    t_available_ns: int
    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    height_m: float = math.nan
    """Above the ellipsoid."""
    speed_m_s: float = math.nan
    course_deg: float = math.nan
    """Course, clockwise from north."""
    sigma_e_m: float = math.nan
    sigma_n_m: float = math.nan
    sigma_u_m: float = math.nan
    quality: float = math.nan
    """As in NMEA's GGA."""
    satellites: float = math.nan
    hdop: float = math.nan
    vdop: float = math.nan
    age_s: float = math.nan
    geoid_m: float = math.nan
    """Mean sea level above the ellipsoid; for the origin."""

    @property
    def placed(self) -> bool:
        """Whether it has a position that may lie near an origin."""
        return _LATITUDES[0] <= self.latitude_deg <= _LATITUDES[1] and not math.isnan(self.longitude_deg)


def at(placed: Placed[Fix]) -> Fix:
    """A fix, put in time."""
    return placed.item._replace(t_ns=placed.t_ns, t_available_ns=placed.t_available_ns)


_PLACE = Fix._fields.index("latitude_deg")
_REST = Fix._fields.index("speed_m_s")
_END = Fix._fields.index("geoid_m")


def measurements(items: Iterable[Fix | Measurement], origin: Origin) -> Iterator[Measurement]:
    """Fixes as measurements of the local frame, with other sensors' measurements kept in their places.

    Worked out in blocks; the height of a point of which none is known does not matter to where it lies in the plane.
    """
    stream = iter(items)
    while block := list(itertools.islice(stream, _BLOCK)):
        fixes = [item for item in block if isinstance(item, Fix)]
        rows = iter(_values(fixes, origin)[:, np.newaxis, :] if fixes else ())
        for item in block:
            if isinstance(item, Fix):
                yield Measurement(
                    sensor=GNSS,
                    t_ns=item.t_ns,
                    t_available_ns=item.t_available_ns,
                    columns=COLUMNS,
                    values=next(rows),
                    valid=np.ones(1, dtype=np.bool_),
                )
            else:
                yield item


def _values(fixes: Sequence[Fix], origin: Origin) -> FloatArray:
    """(N, n) columns of N fixes."""
    place = np.array([fix[_PLACE:_REST] for fix in fixes], dtype=np.float64)
    rest = np.array([fix[_REST:_END] for fix in fixes], dtype=np.float64)
    flat = np.isnan(place[:, 2])
    place[flat, 2] = origin.height_m
    position = origin.enu(place)
    position[flat, 2] = np.nan
    course = rest[:, 1]
    course[:] = wrap_angle(0.5 * math.pi - np.radians(course))
    return np.concatenate([position, rest], axis=1)
