"""Where a log begins: its first position, and the course of the first way that is made."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain

import numpy as np

from twin.geometry import turned
from twin.signals import POSITION, SPEED, Measurement, SensorInfo

MOST_LOOKED_AT = 5_000
"""Measurements that are looked at, and kept until then, for a start that is good for anything."""
MOVING_M_S = 0.5
"""Slower than this, a course is noise (VTG's at standstill is garbage)."""
FAR_M = 10.0
"""So far from the first position, the direction from it is a course even with errors of metres."""
_COURSE = "course_rad"

Pose = tuple[float, float, float]


def look_ahead(measurements: Iterator[Measurement], receiver: SensorInfo | None) -> tuple[Pose, Iterator[Measurement]]:
    """East and north of the antenna and heading to start from, and all measurements again.

    As an owner sets a machine out before a run: where it stands, and whereto it looks. Zero where nothing is told.
    """
    seen: list[Measurement] = []
    place: tuple[float, float] | None = None
    heading = math.nan
    while receiver is not None and math.isnan(heading) and len(seen) < MOST_LOOKED_AT:
        measurement = next(measurements, None)
        if measurement is None:
            break
        seen.append(measurement)
        if measurement.sensor != receiver.name or not measurement.valid[0]:
            continue
        told = dict(zip(measurement.columns, measurement.values[0].tolist(), strict=True))
        here = told.get(POSITION[0], math.nan), told.get(POSITION[1], math.nan)
        if not np.isfinite(here).all():
            continue
        place = place or here
        heading = _course(told, place, here)
    east, north = place or (0.0, 0.0)
    return (east, north, 0.0 if math.isnan(heading) else heading), chain(seen, measurements)


def reference_pose(antenna: Pose, antenna_m: tuple[float, float]) -> Pose:
    """Pose of the reference frame from that of an antenna which sits so far ahead and to the left of it, m."""
    east, north, heading = antenna
    by_east, by_north = turned(*antenna_m, heading)
    return east - float(by_east), north - float(by_north), heading


def _course(told: dict[str, float], start: tuple[float, float], here: tuple[float, float]) -> float:
    """Course of the antenna, or NaN where it is not known yet."""
    course = told.get(_COURSE, math.nan)
    if told.get(SPEED, math.nan) > MOVING_M_S and math.isfinite(course):
        return course
    way = here[0] - start[0], here[1] - start[1]
    return math.atan2(way[1], way[0]) if math.hypot(*way) > FAR_M else math.nan
