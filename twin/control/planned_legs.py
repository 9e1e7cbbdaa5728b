"""The segments of a path driver as they lie in the field, numbered as the truth's column ``segment`` numbers them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.control.path_following import PathDriverConfig, Segment
from twin.geometry import Path
from twin.signals import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedLeg:
    """A straight, an arc, or a place where the machine stands or spins (without length)."""

    index: int
    """Value of the truth's ``segment`` while the driver is at it."""
    name: str
    east_m: float
    north_m: float
    """Where it begins."""
    heading_rad: float
    """At its beginning."""
    length_m: float
    curvature_1_m: float
    """Positive to the left; zero of a straight."""
    raised: bool
    """The implement is out of the ground."""
    spins: bool = False
    """The machine turns on the spot."""

    @property
    def is_straight(self) -> bool:
        """Whether it is driven along a straight line."""
        return self.length_m > 0.0 and self.curvature_1_m == 0.0

    @property
    def is_arc(self) -> bool:
        """Whether it is driven along an arc."""
        return self.length_m > 0.0 and self.curvature_1_m != 0.0

    @property
    def direction(self) -> FloatArray:
        """Unit vector (2,), east and north, along its beginning."""
        return np.array([math.cos(self.heading_rad), math.sin(self.heading_rad)])

    def project(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance along the leg and offset to its left of points (..., 2), each of shape (...), m.

        Exact on the line or circle of which the leg is a part; the distance is negative before the beginning and may
        exceed the length. That of an arc is of the point of the circle nearest to its middle, half a turn either way.
        """
        away = points_m - np.array([self.east_m, self.north_m])
        ahead = self.direction
        forward = away @ ahead
        left = away @ np.array([-ahead[1], ahead[0]])
        if self.curvature_1_m == 0.0:
            return forward, left
        side, radius = math.copysign(1.0, self.curvature_1_m), 1.0 / abs(self.curvature_1_m)
        turned = np.arctan2(forward, radius - side * left)
        middle = 0.5 * self.length_m / radius
        along = radius * (middle + (turned - middle + math.pi) % (2.0 * math.pi) - math.pi)
        return along, side * (radius - np.hypot(forward, radius - side * left))


def planned_legs(config: PathDriverConfig, start_e_n_heading: tuple[float, float, float]) -> list[PlannedLeg]:
    """Lay the driver's segments out from the start pose of the rear axle (east m, north m, heading rad)."""
    legs: list[PlannedLeg] = []
    east, north, heading = start_e_n_heading
    for segment in config.path:
        length, curvature = _shape(segment)
        spin = math.radians(segment.spin_deg or 0.0)
        if length or spin or segment.stop_s is not None:
            legs.append(
                PlannedLeg(
                    index=len(legs), name=segment.name, east_m=east, north_m=north, heading_rad=heading,
                    length_m=length, curvature_1_m=curvature, raised=segment.raised, spins=bool(spin),
                )
            )  # fmt: skip
        if length:
            end = Path(east_m=east, north_m=north, heading_rad=heading, pieces=[(length, curvature)]).pose(length)
            east, north, heading = end.east_m, end.north_m, end.heading_rad
        heading += spin
    return legs


def _shape(segment: Segment) -> tuple[float, float]:
    """Length (m) and curvature (1/m)."""
    if segment.straight_m is not None:
        return segment.straight_m, 0.0
    if segment.turn_deg is not None and segment.radius_m is not None:
        length = abs(math.radians(segment.turn_deg)) * segment.radius_m
        return length, math.copysign(1.0 / segment.radius_m, segment.turn_deg)
    return 0.0, 0.0


PARALLEL_RAD = math.radians(1.0)


def parallel_passes(legs: Sequence[PlannedLeg]) -> list[PlannedLeg]:
    """The passes over a field: straight legs with the implement down that are parallel within 1 degree, either way.

    Of several directions that with the most metres, and of equal ones the first driven; fewer than two legs are none.
    """
    straights = [leg for leg in legs if leg.is_straight and not leg.raised]
    best: list[PlannedLeg] = []
    most_m = 0.0
    for first in straights:
        group = [leg for leg in straights if _apart(leg.heading_rad, first.heading_rad) <= PARALLEL_RAD]
        metres = sum(leg.length_m for leg in group)
        if metres > most_m + 1e-9:
            best, most_m = group, metres
    return best if len(best) > 1 else []


def _apart(one_rad: float, other_rad: float) -> float:
    """Angle between two lines, in [0, pi/2]."""
    return abs(math.remainder(one_rad - other_rad, math.pi))
