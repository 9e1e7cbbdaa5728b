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
from twin.signals import NS_PER_S, POSITION, FloatArray, Measurement, Mount, SensorInfo

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
HEAD_EPOCHS = 50
"""So many epochs from a log's first position on tell its rate and quality."""
_BLOCK = 256
_LATITUDES, _HEIGHTS, _GEOID = (-89.0, 89.0), (-1_000.0, 9_000.0), (-110.0, 90.0)
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
    compass_deg: float = math.nan
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


def origin_of(head: Sequence[Fix]) -> Origin:
    """The local frame that begins at the first position of a log's head, at the first height in it.

    One of the fixes has to be ``placed``.
    """
    first = next(fix for fix in head if fix.placed)
    return Origin(
        latitude_deg=first.latitude_deg,
        longitude_deg=first.longitude_deg,
        height_m=_first([fix.height_m for fix in head], _HEIGHTS),
        geoid_height_m=_first([fix.geoid_m for fix in head], _GEOID),
    )


def _first(values: Sequence[float], limits: tuple[float, float]) -> float:
    known = next((value for value in values if not math.isnan(value)), 0.0)
    return min(max(known, limits[0]), limits[1])


_REPORTED_M = {4: (0.01, 0.02), 5: (0.2, 0.4), 2: (0.5, 0.95), 1: (1.5, 2.9)}
"""Horizontal and vertical noise of a neutral receiver by the best quality it has: an F9P's own word for RTK fixed, the
measured error of its float solution (whose own word is a hundredth of it), a choice for differential, and a NEO-M8U's
own word for single point."""
_HORIZONTAL = {
    4: ("", 0.0046, 245.0),
    5: ("float_", 0.16, 100.0),
    2: ("differential_", 0.4, 100.0),
    1: ("single_", 0.8, 160.0),
}
"""Name, what wanders (m), how long it lasts (s): an F9P standing 2490 s, its float solution, a choice as in the
receivers' presets, a NEO-M8U on a standing tractor. What is new in every fix nobody can tell of a receiver that nobody
knows; it shows in the log, and is for estimators to find."""
_VELOCITY = {"speed_noise_m_s": 0.05, "speed_noise_ratio": 0.03, "velocity_lag_s": 0.0, "latency_s": 0.0}
"""A choice: Doppler speed of any receiver, digits included, and direction within 1.6 degrees."""


def neutral_sheet(best: int) -> dict[str, float]:
    """Data sheet of a receiver nobody knows, by the best quality it has, with the names of simulated receivers'."""
    horizontal, vertical = _REPORTED_M[best]
    sheet = {"position_noise_m": horizontal, "height_noise_m": vertical, **_VELOCITY}
    for quality, (name, correlated, correlation) in _HORIZONTAL.items():
        for prefix in {name, ""} if quality == best else {name} - {""}:
            sheet |= {
                f"{prefix}position_correlated_sigma_m": correlated,
                f"{prefix}position_correlation_s": correlation,
            }
    return sheet


def receiver_info(head: Sequence[Fix]) -> SensorInfo:
    """What can be told of a receiver from the beginning of its log: its rate, and a neutral data sheet.

    Which of the neutral receivers is taken goes by the best quality in ``head``. Nobody knows its latency and its
    antenna's place: both are zero.
    """
    qualities = {fix.quality for fix in head}
    best = next((quality for quality in _REPORTED_M if quality in qualities), 1)
    return SensorInfo(
        name=GNSS,
        kind=GNSS,
        columns=COLUMNS,
        mount=UNKNOWN_MOUNT,
        rate_hz=rate_hz([fix.t_ns for fix in head]),
        datasheet=neutral_sheet(best),
    )


def rate_hz(times_ns: Sequence[int]) -> float:
    """Rate of a sensor by the median of the steps that go ahead; one a second where there are none."""
    steps = np.diff(np.array(times_ns, dtype=np.int64))
    ahead = steps[steps > 0]
    return NS_PER_S / float(np.median(ahead)) if len(ahead) else 1.0
