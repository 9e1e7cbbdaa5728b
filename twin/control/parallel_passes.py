"""A field of parallel passes, as a driver plans it: straights there and back, and the headland turns between them.

The next line lies ``width_m`` to one side, and the machine comes back along it. With turning circles of radius R:

- width >= 2 R: two quarter circles with a straight of width - 2 R between them (a half circle where that is nothing);
- width < 2 R: a half circle would end beyond the line. So the machine first turns away from it, by alpha, then round
  by pi + 2 alpha, then back by alpha, all on circles of radius R (a bulb). Centres of circles that touch are 2 R
  apart. That of the first lies R beside the old line, away from the new one, that of the second midway between both
  lines: width / 2 + R = 2 R cos(alpha).

Both kinds begin and end at the same distance along the lines, and are mirror images of themselves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from twin.config import Config, NonNegative, Positive

Piece = tuple[float, float]
"""Length, m, and curvature, 1/m, positive to the left."""

MOST_PASSES = 500
HEADLAND = "headland"
_NOTHING = 1e-9
"""Share of a radius that is no way to drive: a piece of no length would be a corner."""


class ParallelPasses(Config):
    """A piece of what the driver does: ``passes`` parallel lines, one after the other."""

    passes: Annotated[int, Field(ge=1, le=MOST_PASSES)]
    """How many lines; it ends at the end of the last."""
    length_m: Positive
    """Of each line."""
    width_m: Positive
    """From each line to the next."""
    turn_radius_m: Annotated[float, Field(ge=0.1)]
    """Of all arcs of the headland turns, for the middle of the rear axle."""
    first_turn: Literal["left", "right"] = "left"
    """Side of the second line from the first; the others follow on that side."""
    run_in_m: NonNegative = 0.0
    """Straight way beyond the lines' ends, before and after each turn, on which the machine gets back to its line."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=15.0)] | None = None
    """Speed from here on."""
    turn_speed_m_s: Annotated[float, Field(gt=0.0, le=15.0)] | None = None
    """Speed in headlands; without it that of the lines."""

    @property
    def length_in_all_m(self) -> float:
        """Of all lines and headlands."""
        return sum(length for stretch in self.stretches() for length, _ in stretch.pieces)

    def stretches(self) -> Iterator[Stretch]:
        """Lines and headlands, in order."""
        side = 1.0 if self.first_turn == "left" else -1.0
        straight = ((self.run_in_m, 0.0),) if self.run_in_m > 0.0 else ()
        for number in range(1, self.passes + 1):
            yield Stretch(name=f"pass {number}", pieces=((self.length_m, 0.0),), headland=False)
            if number < self.passes:
                turn = headland_turn(self.width_m, self.turn_radius_m, side)
                yield Stretch(name=HEADLAND, pieces=(*straight, *turn, *straight), headland=True)
            side = -side


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """A line, or the way from its end to the next."""

    name: str
    pieces: tuple[Piece, ...]
    headland: bool


def headland_turn(width_m: float, radius_m: float, side: float) -> tuple[Piece, ...]:
    """Pieces that lead from the end of a line to the begin of the one beside it, in the other direction.

    Args:
        width_m: between the lines.
        radius_m: of the arcs.
        side: 1 for a line to the left, -1 for one to the right.
    """
    curvature = side / radius_m
    between = width_m - 2.0 * radius_m
    if abs(between) <= _NOTHING * radius_m:
        return ((math.pi * radius_m, curvature),)
    if between > 0.0:
        quarter = (0.5 * math.pi * radius_m, curvature)
        return quarter, (between, 0.0), quarter
    alpha = math.acos((0.5 * width_m + radius_m) / (2.0 * radius_m))
    away = (alpha * radius_m, -curvature)
    return away, ((math.pi + 2.0 * alpha) * radius_m, curvature), away
