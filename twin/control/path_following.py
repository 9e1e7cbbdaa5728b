"""A driver who keeps the machine's rear axle on a planned path and keeps a speed.

Steering is feed-forward of the path's curvature, looked at a moment ahead (a driver turns the wheel before the bend),
plus feedback on lateral offset e and heading error psi. In distance s along the path the closed loop is
e'' + 2 w e' + w^2 e = 0 with w = ``steering_bandwidth_1_m``: critically damped, settling within a few 1/w metres
whatever the speed. Speed changes at ``acceleration_m_s2`` and the driver brakes in time for a stop.

The driver asks for the curvature twice over: as the steering angle of a single front wheel and as the yaw rate at the
commanded speed; a machine takes what it has. One that can turn on the spot may be asked to (``spin_deg``): it stops and
turns at ``spin_rate_deg_s``, slowing down before the end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, Strict, model_validator

from twin.config import Config, NonNegative, Positive
from twin.geometry import Path, wrap_angle_scalar
from twin.randomness import world_generator
from twin.signals import Command, Knowledge, Listening, VehicleState

_STANDING_M_S = 0.05
_ARRIVED_M, _ARRIVED_LENGTHS = 0.3, 0.075
"""A stop is reached within this distance, or this share of the feedback's length 1/w where that is less."""
_LOOK_M, _LOOK_LENGTHS = 0.2, 0.05
"""Least distance over which curvature ahead is averaged, likewise."""
_LONGEST_PATH_M = 100_000.0
_BEHIND_CORNER_M = 1e-6
_SPIN_GAIN_1_S = 3.0
_SLOWEST_SPIN_RAD_S = 0.3
_SPUN_RAD = math.radians(1.0)


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


class PathDriverConfig(Config):
    """A driver in the seat, who follows a planned path."""

    kind: Literal["path"] = "path"
    follows: Literal["truth"] = "truth"
    """What the driver goes by."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=15.0)] = 2.5
    """Speed until a segment says otherwise."""
    acceleration_m_s2: Annotated[float, Field(gt=0.0, le=3.0)] = 0.5
    """How fast the driver changes speed, both ways."""
    spin_rate_deg_s: Annotated[float, Field(gt=0.0, le=360.0)] = 60.0
    """Rate of turns on the spot."""
    steering_bandwidth_1_m: Annotated[float, Field(gt=0.0, le=20.0)] = 0.25
    """Bandwidth w of the steering feedback, per metre driven."""
    preview_s: NonNegative = 0.6
    """How far ahead the driver looks at the curvature of the path."""
    wander_m: NonNegative = 0.0
    """Standard deviation of the lateral offset an inattentive driver keeps (first-order Gauss-Markov, 8 s)."""
    path: Annotated[tuple[Segment, ...], Strict(strict=False), Field(min_length=1, max_length=1000)]
    """What the driver does, one segment after the other."""

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        length = sum(
            segment.straight_m or abs(math.radians(segment.turn_deg or 0.0)) * (segment.radius_m or 0.0)
            for segment in self.path
        )
        if length > _LONGEST_PATH_M:
            raise ValueError(f"path: {length:.3g} m long; at most {_LONGEST_PATH_M:g} m are allowed")
        return self

    @property
    def listens(self) -> Listening:
        """Whoever sees the truth asks nobody."""
        return Listening()

    @property
    def needed_columns(self) -> dict[str, tuple[str, ...]]:
        """Nothing is needed of anybody."""
        return {}


@dataclass(frozen=True, slots=True)
class _Leg:
    """A segment laid on the path: where it begins and ends, how fast, how long to stand or how far to spin there."""

    name: str
    from_m: float
    to_m: float
    speed_m_s: float
    stop_s: float
    spin_rad: float
    raised: bool

    @property
    def halts(self) -> bool:
        """Whether the machine has to stand still for it."""
        return self.stop_s > 0.0 or self.spin_rad != 0.0


def _lay_out(segments: Iterable[Segment], speed_m_s: float) -> tuple[list[tuple[float, float]], list[_Leg]]:
    """Pieces of the path, a spin being one of no length whose second number is its angle, and the legs on it."""
    pieces: list[tuple[float, float]] = []
    legs: list[_Leg] = []
    station = 0.0
    for segment in segments:
        speed_m_s = segment.speed_m_s if segment.speed_m_s is not None else speed_m_s
        length, spin = 0.0, math.radians(segment.spin_deg or 0.0)
        if segment.straight_m is not None:
            length = segment.straight_m
            pieces.append((length, 0.0))
        elif segment.turn_deg is not None and segment.radius_m is not None:
            length = abs(math.radians(segment.turn_deg)) * segment.radius_m
            pieces.append((length, math.copysign(1.0 / segment.radius_m, segment.turn_deg)))
        elif spin:
            pieces.append((0.0, spin))
        if length or spin or segment.stop_s is not None:
            legs.append(
                _Leg(segment.name, station, station + length, speed_m_s, segment.stop_s or 0.0, spin, segment.raised)
            )
        station += length
    return pieces, legs


def planned_path(config: PathDriverConfig, start_e_n_heading: tuple[float, float, float]) -> Path:
    """Lay the driver's segments out from the start pose of the rear axle (east m, north m, heading rad)."""
    pieces, _ = _lay_out(config.path, config.speed_m_s)
    east, north, heading = start_e_n_heading
    return Path(east_m=east, north_m=north, heading_rad=heading, pieces=pieces)


class PathDriver:
    """Follows the planned path by what is seen from the seat."""

    def __init__(
        self, config: PathDriverConfig, *, start_e_n_heading: tuple[float, float, float], wheelbase_m: float, seed: int
    ) -> None:
        self.path = planned_path(config, start_e_n_heading)
        self.segment = 0
        """Index of the current leg; equal to the number of legs once all is done."""
        self._legs = _lay_out(config.path, config.speed_m_s)[1]
        self._config = config
        self._wheelbase_m = wheelbase_m
        self._station_m = 0.0
        self._speed_m_s = 0.0
        self._stood_s = 0.0
        self._spin_to_rad: float | None = None
        self._corner_m = 0.0
        self._arrived_m = min(_ARRIVED_M, _ARRIVED_LENGTHS / config.steering_bandwidth_1_m)
        self._look_m = min(_LOOK_M, _LOOK_LENGTHS / config.steering_bandwidth_1_m)
        self._wander = world_generator(seed, "driver")
        self._offset_m = config.wander_m * float(self._wander.standard_normal())

    @property
    def segment_names(self) -> tuple[str, ...]:
        """Names of the legs, in order; the state after the last one is ``finished``."""
        return (*(leg.name for leg in self._legs), "finished")

    def command(self, knowledge: Knowledge, interval_s: float) -> Command:
        """Return what the driver asks of the machine now; called every ``interval_s``."""
        vehicle = knowledge.seen_from_the_seat
        self._station_m, offset_m = self.path.project(
            vehicle.east_m, vehicle.north_m, near_m=self._station_m, from_m=self._corner_m
        )
        standing = self._advance(vehicle, interval_s)
        curvature = self._curvature(vehicle, offset_m)
        steering = math.atan(self._wheelbase_m * curvature)
        if standing:
            self._speed_m_s = 0.0
            rate = self._spin_rate()
            return Command(
                speed_m_s=0.0, steering_rad=steering, yaw_rate_rad_s=rate, brake=rate == 0.0, raised=self._raised
            )
        limit = self._config.acceleration_m_s2 * interval_s
        step = min(max(self._wanted_speed() - self._speed_m_s, -limit), limit)
        self._speed_m_s += step
        self._walk_offset(interval_s)
        rate = self._speed_m_s * curvature
        return Command(speed_m_s=self._speed_m_s, steering_rad=steering, yaw_rate_rad_s=rate, raised=self._raised)

    @property
    def _raised(self) -> bool:
        """Whether the implement has to be out of the ground on this leg, or after the last."""
        return self._legs[min(self.segment, len(self._legs) - 1)].raised

    def _advance(self, vehicle: VehicleState, interval_s: float) -> bool:
        """Move on to the leg the machine is in; tell whether the machine has to stand now."""
        speed_m_s = vehicle.speed_m_s
        while self.segment < len(self._legs):
            leg = self._legs[self.segment]
            if not leg.halts:
                if self._station_m < leg.to_m - 1e-6 and not self._stops_short(leg, speed_m_s):
                    return False
            else:
                arrived = self._station_m >= leg.to_m - self._arrived_m and abs(speed_m_s) < _STANDING_M_S
                if not arrived and self._stood_s == 0.0 and self._spin_to_rad is None:
                    return False
                if leg.spin_rad and self._spinning(leg, vehicle.heading_rad):
                    return True
                if self._stood_s < leg.stop_s - interval_s / 2.0:
                    self._stood_s += interval_s
                    return True
            self.segment += 1
            self._stood_s = 0.0
            if self._spin_to_rad is not None:
                self._spin_to_rad = None
                self._corner_m = self._station_m = leg.to_m
        return abs(speed_m_s) < _STANDING_M_S

    def _spinning(self, leg: _Leg, heading_rad: float) -> bool:
        """Begin a spin, or look how far it is: tell whether there is anything left of it."""
        if self._spin_to_rad is None:
            self._spin_to_rad = leg.spin_rad
            self._spun_from_rad = heading_rad
        self._spin_to_rad -= wrap_angle_scalar(heading_rad - self._spun_from_rad)
        self._spun_from_rad = heading_rad
        return math.copysign(1.0, leg.spin_rad) * self._spin_to_rad > _SPUN_RAD

    def _spin_rate(self) -> float:
        """Rate of the spin under way; zero without one."""
        if self._spin_to_rad is None or self.segment >= len(self._legs):
            return 0.0
        largest = math.radians(self._config.spin_rate_deg_s)
        slowest = min(_SLOWEST_SPIN_RAD_S, largest)
        rate = min(max(_SPIN_GAIN_1_S * abs(self._spin_to_rad), slowest), largest)
        return math.copysign(rate, self._spin_to_rad)

    def _stops_short(self, leg: _Leg, speed_m_s: float) -> bool:
        """Tell whether the machine has come to rest within reach of a stop at the end of this leg."""
        stop_next = self.segment + 1 == len(self._legs) or self._legs[self.segment + 1].halts
        near = self._station_m >= leg.to_m - self._arrived_m
        return stop_next and near and abs(speed_m_s) < _STANDING_M_S

    def _wanted_speed(self) -> float:
        """Leg's speed, limited so that the next lower speed or stop is reached at its station."""
        if self.segment >= len(self._legs):
            return 0.0
        wanted = self._legs[self.segment].speed_m_s if not self._legs[self.segment].halts else math.inf
        deceleration = 0.9 * self._config.acceleration_m_s2
        for leg in self._legs[self.segment :]:
            target, at_m = (0.0, leg.to_m) if leg.halts else (leg.speed_m_s, leg.from_m)
            ahead = max(0.0, at_m - self._station_m)
            wanted = min(wanted, math.sqrt(target**2 + 2.0 * deceleration * ahead))
        end = max(0.0, self._legs[-1].to_m - self._station_m)
        return min(wanted, math.sqrt(2.0 * deceleration * end))

    def _walk_offset(self, interval_s: float) -> None:
        if self._config.wander_m > 0.0:
            keep = math.exp(-interval_s / 8.0)
            shock = self._config.wander_m * math.sqrt(1.0 - keep * keep)
            self._offset_m = keep * self._offset_m + shock * float(self._wander.standard_normal())

    def _curvature(self, vehicle: VehicleState, offset_m: float) -> float:
        """Curvature to be driven, 1/m."""
        w = self._config.steering_bandwidth_1_m
        ahead_m = max(self._look_m, vehicle.speed_m_s * self._config.preview_s)
        forward = self.path.curvature_ahead(self._station_m, ahead_m)
        on_leg_m = max(self._station_m, self._corner_m + _BEHIND_CORNER_M)
        heading_error = wrap_angle_scalar(vehicle.heading_rad - self.path.pose(on_leg_m).heading_rad)
        error_m = float(np.clip(offset_m - self._offset_m, -3.0, 3.0))
        return forward - w * w * error_m - 2.0 * w * math.sin(heading_error)
