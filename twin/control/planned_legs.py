"""The segments of a path driver as they lie in the field, numbered as the truth's column ``segment`` numbers them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.control.path_following import PathDriverConfig
from twin.control.path_plan import lay_out
from twin.geometry import Path
from twin.signals import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedPiece:
    """A straight or an arc of a segment."""

    east_m: float
    north_m: float
    """Where it begins."""
    heading_rad: float
    """At its beginning."""
    length_m: float
    curvature_1_m: float
    """Positive to the left; zero of a straight."""

    @property
    def direction(self) -> FloatArray:
        """Unit vector (2,), east and north, along its beginning."""
        return np.array([math.cos(self.heading_rad), math.sin(self.heading_rad)])

    def project(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance along the piece and offset to its left of points (..., 2), each of shape (...), m.

        Exact on the line or circle of which the piece is a part; the distance is negative before the beginning and may
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedLeg:
    """A straight, an arc, a headland turn of several of them, or a place where the machine stands or spins."""

    index: int
    """Value of the truth's ``segment`` while the driver is at it."""
    name: str
    east_m: float
    north_m: float
    """Where it begins."""
    heading_rad: float
    """At its beginning."""
    pieces: tuple[PlannedPiece, ...]
    """One after the other; none where the machine stands or spins."""
    raised: bool
    """The implement is out of the ground."""
    spins: bool = False
    """The machine turns on the spot."""

    @property
    def length_m(self) -> float:
        """Of all pieces."""
        return sum(piece.length_m for piece in self.pieces)

    @property
    def is_straight(self) -> bool:
        """Whether it is driven along one straight line."""
        return bool(self.pieces) and not self.is_arc

    @property
    def is_arc(self) -> bool:
        """Whether there is an arc in it."""
        return any(piece.curvature_1_m for piece in self.pieces)

    @property
    def direction(self) -> FloatArray:
        """Unit vector (2,), east and north, along its beginning."""
        return np.array([math.cos(self.heading_rad), math.sin(self.heading_rad)])

    def project(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance along the leg and offset to its left of points (..., 2), each of shape (...), m.

        Of several pieces the nearest counts beside which a point is; a point that is beside none gets NaN. Along a leg
        of one piece that goes on beyond its ends.
        """
        if len(self.pieces) == 1:
            return self.pieces[0].project(points_m)
        along = np.full(points_m.shape[:-1], math.nan)
        left, nearest = along.copy(), np.full(points_m.shape[:-1], math.inf)
        station = 0.0
        for piece in self.pieces:
            on_it, beside = piece.project(points_m)
            here = (on_it >= 0.0) & (on_it <= piece.length_m) & (np.abs(beside) < nearest)
            nearest = np.where(here, np.abs(beside), nearest)
            along, left = np.where(here, station + on_it, along), np.where(here, beside, left)
            station += piece.length_m
        return along, left


def planned_legs(config: PathDriverConfig, start_e_n_heading: tuple[float, float, float]) -> list[PlannedLeg]:
    """Lay the driver's segments out from the start pose of the rear axle (east m, north m, heading rad)."""
    laid, legs = lay_out(config.path, config.speed_m_s)
    # a spin is a piece without length
    waiting = [(length, curvature) for length, curvature in laid if length > 0.0]
    found: list[PlannedLeg] = []
    pose = start_e_n_heading
    for index, leg in enumerate(legs):
        begin, pieces = pose, list[PlannedPiece]()
        missing = leg.to_m - leg.from_m
        while missing > _NOTHING_M:
            length, curvature = waiting.pop(0)
            east, north, heading = pose
            pieces.append(
                PlannedPiece(east_m=east, north_m=north, heading_rad=heading, length_m=length, curvature_1_m=curvature)
            )
            end = Path(east_m=east, north_m=north, heading_rad=heading, pieces=[(length, curvature)]).pose(length)
            pose = end.east_m, end.north_m, end.heading_rad
            missing -= length
        found.append(
            PlannedLeg(
                index=index, name=leg.name, east_m=begin[0], north_m=begin[1], heading_rad=begin[2],
                pieces=tuple(pieces), raised=leg.raised, spins=leg.spin_rad != 0.0,
            )
        )  # fmt: skip
        pose = pose[0], pose[1], pose[2] + leg.spin_rad
    return found


_NOTHING_M = 1e-9
"""Of a leg that is left when its pieces are taken: rounding."""
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
