"""What a driver along a path means to do: segments, laid out as a path and as legs on it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import Discriminator, Field, Tag, model_validator

from twin.config import Config, Positive
from twin.control.parallel_passes import ParallelPasses, Piece


class Segment(Config):
    """One piece of what the driver does: a straight, a turn, a stop, or only a new speed."""

    straight_m: Positive | None = None
    """Drive straight on for this distance."""
    turn_deg: Annotated[float, Field(ge=-3600.0, le=3600.0)] | None = None
    """Turn by this angle, positive to the left."""
    radius_m: Annotated[float, Field(ge=0.1)] | None = None
    """Radius of the turn, for the middle of the rear axle."""
    spin_deg: Annotated[float, Field(ge=-3600.0, le=3600.0)] | None = None
    """Turn on the spot by this angle, positive to the left (only machines that can)."""
    stop_s: Positive | None = None
    """Stop and stand for this long with the brake on."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=15.0)] | None = None
    """Speed from here on."""
    raised: bool = False
    """Keep the implement out of the ground meanwhile."""
    label: str = ""
    """Name of the segment in plots and events."""

    @model_validator(mode="after")
    def _one_thing(self) -> Self:
        given = [name for name in ("straight_m", "turn_deg", "spin_deg", "stop_s") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(
                f"a segment is one of straight_m, turn_deg, spin_deg, stop_s; given were {' and '.join(given)}"
            )
        if not given and self.speed_m_s is None:
            raise ValueError("a segment needs straight_m, turn_deg, spin_deg, stop_s or speed_m_s")
        if (self.turn_deg is None) != (self.radius_m is None):
            raise ValueError("turn_deg and radius_m go together")
        if self.turn_deg == 0.0:
            raise ValueError("turn_deg = 0 is no turn")
        if self.spin_deg == 0.0:
            raise ValueError("spin_deg = 0 is no turn")
        return self

    @property
    def name(self) -> str:
        """Label, or what the segment does in words."""
        if self.label:
            return self.label
        if self.straight_m is not None:
            return f"straight {self.straight_m:g} m"
        if self.turn_deg is not None:
            side = "left" if self.turn_deg > 0 else "right"
            return f"turn {abs(self.turn_deg):g}° {side}, radius {self.radius_m:g} m"
        if self.spin_deg is not None:
            return f"spin {abs(self.spin_deg):g}° {'left' if self.spin_deg > 0 else 'right'}"
        if self.stop_s is not None:
            return f"stand {self.stop_s:g} s"
        return f"speed {self.speed_m_s:g} m/s"


def _which(value: Any) -> str:
    """Tell a field of passes by its key, as it is written or as it has been read."""
    is_passes = "passes" in value if isinstance(value, dict) else isinstance(value, ParallelPasses)
    return "passes" if is_passes else "segment"


Entry = Annotated[Annotated[Segment, Tag("segment")] | Annotated[ParallelPasses, Tag("passes")], Discriminator(_which)]
"""What a path may be made of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A segment laid on the path: where it begins and ends, how fast, how long to stand or how far to spin there."""

    name: str
    from_m: float
    to_m: float
    speed_m_s: float
    stop_s: float = 0.0
    spin_rad: float = 0.0
    raised: bool = False

    @property
    def halts(self) -> bool:
        """Whether the machine has to stand still for it."""
        return self.stop_s > 0.0 or self.spin_rad != 0.0


def length_m(entry: Entry) -> float:
    """How far an entry leads."""
    if isinstance(entry, ParallelPasses):
        return entry.length_in_all_m
    return entry.straight_m or abs(math.radians(entry.turn_deg or 0.0)) * (entry.radius_m or 0.0)


def tightest_m(entry: Entry) -> float | None:
    """Radius of an entry's turns; None where it has none."""
    if isinstance(entry, ParallelPasses):
        return entry.turn_radius_m if entry.passes > 1 else None
    return entry.radius_m


def lay_out(entries: Iterable[Entry], speed_m_s: float) -> tuple[list[Piece], list[Leg]]:
    """Lay entries one after the other.

    Returns:
        Pieces of the path, a spin being one of no length whose second number is its angle, and the legs on it.
    """
    pieces: list[Piece] = []
    legs: list[Leg] = []
    station = 0.0
    for entry in entries:
        speed_m_s = entry.speed_m_s if entry.speed_m_s is not None else speed_m_s
        added, new = (
            _passes(entry, station, speed_m_s) if isinstance(entry, ParallelPasses) else _one(entry, station, speed_m_s)
        )
        pieces += added
        legs += new
        station = legs[-1].to_m if legs else 0.0
    return pieces, legs


def _one(segment: Segment, station: float, speed_m_s: float) -> tuple[list[Piece], list[Leg]]:
    pieces: list[Piece] = []
    length, spin = 0.0, math.radians(segment.spin_deg or 0.0)
    if segment.straight_m is not None:
        length = segment.straight_m
        pieces.append((length, 0.0))
    elif segment.turn_deg is not None and segment.radius_m is not None:
        length = abs(math.radians(segment.turn_deg)) * segment.radius_m
        pieces.append((length, math.copysign(1.0 / segment.radius_m, segment.turn_deg)))
    elif spin:
        pieces.append((0.0, spin))
    if not length and not spin and segment.stop_s is None:
        return pieces, []
    leg = Leg(
        name=segment.name,
        from_m=station,
        to_m=station + length,
        speed_m_s=speed_m_s,
        stop_s=segment.stop_s or 0.0,
        spin_rad=spin,
        raised=segment.raised,
    )
    return pieces, [leg]


def _passes(field: ParallelPasses, station: float, speed_m_s: float) -> tuple[list[Piece], list[Leg]]:
    pieces: list[Piece] = []
    legs: list[Leg] = []
    in_turns = field.turn_speed_m_s if field.turn_speed_m_s is not None else speed_m_s
    for stretch in field.stretches():
        end = station + sum(length for length, _ in stretch.pieces)
        speed = in_turns if stretch.headland else speed_m_s
        legs.append(Leg(name=stretch.name, from_m=station, to_m=end, speed_m_s=speed, raised=stretch.headland))
        pieces += stretch.pieces
        station = end
    return pieces, legs
