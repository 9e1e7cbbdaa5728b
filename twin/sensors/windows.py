"""When, and where, a fault acts.

    { kind = "outage", from_s = 40, to_s = 60 }                                     # by time
    { kind = "outage", inside = { east_m = [10, 30], north_m = [-5, 5] } }          # in a shed
    { kind = "outage", near = { line = [[0, 20], [80, 20]], within_m = 8 } }        # along a line of trees

A window is open while everything that is given holds: ``from_s <= t < to_s``, the sensor's mount is ``inside`` the
box, and it is ``near`` the point or line. Time is compared in integer nanoseconds at the instant at which the sample is
really taken, place by the true position of the mount; both are the same for all members of an ensemble. Windows are
looked at once per sample: one by place opens at the first sample there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Protocol, Self

from pydantic import Field, Strict, model_validator

from twin.config import Config, NonNegative, Positive
from twin.signals import FloatArray, nanoseconds

Pair = Annotated[tuple[float, float], Strict(strict=False)]
"""Two numbers; a TOML array."""
Points = Annotated[tuple[Pair, ...], Strict(strict=False), Field(min_length=1)]


class Place(Protocol):
    """A part of the field."""

    def holds(self, east_m: float, north_m: float) -> bool:
        """Tell whether the point is in it; its edge is."""


class Box(Config):
    """A rectangle along the axes; without one of the two, a strip."""

    east_m: Pair | None = None
    """From and to."""
    north_m: Pair | None = None
    """From and to."""

    @model_validator(mode="after")
    def _check_sides(self) -> Self:
        if self.east_m is None and self.north_m is None:
            raise ValueError("needs east_m = [from, to], north_m = [from, to] or both")
        for name, side in (("east_m", self.east_m), ("north_m", self.north_m)):
            if side is not None and side[0] >= side[1]:
                raise ValueError(f"{name} = [{side[0]:g}, {side[1]:g}]: the first number must be the smaller one")
        return self

    def holds(self, east_m: float, north_m: float) -> bool:
        """Tell whether the point is in the box."""
        return _within(self.east_m, east_m) and _within(self.north_m, north_m)


class Near(Config):
    """All that is within a distance of a point or of a line through points."""

    line: Points
    """East and north of one point or more."""
    within_m: Positive

    def holds(self, east_m: float, north_m: float) -> bool:
        """Tell whether the point is near enough."""
        return distance_m(self.line, east_m, north_m) <= self.within_m


def _within(side: Sequence[float] | None, value: float) -> bool:
    return side is None or side[0] <= value <= side[1]


def distance_m(line: Sequence[Sequence[float]], east_m: float, north_m: float) -> float:
    """Distance of a point from a line through points (or from the only point)."""
    if len(line) == 1:
        return math.hypot(east_m - line[0][0], north_m - line[0][1])
    return min(_from_segment(begin, end, east_m, north_m) for begin, end in pairwise(line))


def _from_segment(begin: Sequence[float], end: Sequence[float], east_m: float, north_m: float) -> float:
    along_e, along_n = end[0] - begin[0], end[1] - begin[1]
    from_e, from_n = east_m - begin[0], north_m - begin[1]
    square = along_e * along_e + along_n * along_n
    part = 0.0 if square == 0.0 else min(1.0, max(0.0, (from_e * along_e + from_n * along_n) / square))
    return math.hypot(from_e - part * along_e, from_n - part * along_n)


class Window:
    """A window at work."""

    def __init__(self, *, from_ns: int, to_ns: int | None, places: Sequence[Place] = ()) -> None:
        self._from_ns = from_ns
        self._to_ns = to_ns
        self._places = tuple(places)
        self._opened_ns: int | None = None

    def since(self, t_ns: int, position_enu_m: FloatArray) -> int | None:
        """Time since the window opened, ns; None while it is closed. To be called once per sample, in order of time."""
        if t_ns < self._from_ns or (self._to_ns is not None and t_ns >= self._to_ns):
            self._opened_ns = None
        elif not self._places:
            self._opened_ns = self._from_ns
        elif not self._there(position_enu_m):
            self._opened_ns = None
        elif self._opened_ns is None:
            self._opened_ns = t_ns
        return None if self._opened_ns is None else t_ns - self._opened_ns

    def _there(self, position_enu_m: FloatArray) -> bool:
        east, north = float(position_enu_m[0]), float(position_enu_m[1])
        return all(place.holds(east, north) for place in self._places)


class WindowConfig(Config):
    """The window of a fault; without any of its keys it is always open."""

    from_s: NonNegative = 0.0
    """The fault begins here."""
    to_s: Positive | None = None
    """The fault has ended here; without it, it lasts until the end."""
    inside: Box | None = None
    """It acts only in this rectangle of the field."""
    near: Near | None = None
    """It acts only near this point or line of the field."""

    @model_validator(mode="after")
    def _check_window(self) -> Self:
        if self.to_s is not None and nanoseconds(self.to_s) <= nanoseconds(self.from_s):
            raise ValueError(f"to_s = {self.to_s:g} must be later than from_s = {self.from_s:g}")
        return self

    def window(self) -> Window:
        """When and where the fault acts."""
        return Window(
            from_ns=nanoseconds(self.from_s),
            to_ns=None if self.to_s is None else nanoseconds(self.to_s),
            places=[place for place in (self.inside, self.near) if place is not None],
        )
