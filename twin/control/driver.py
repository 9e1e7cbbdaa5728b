"""A driver who steers the machine's rear axle along a planned path and keeps a speed.

Steering is feed-forward of the path's curvature, looked at a moment ahead (a driver turns the wheel before the bend),
plus feedback on lateral offset e and heading error psi. In distance s along the path the closed loop is
e'' + 2 w e' + w^2 e = 0 with w = ``steering_bandwidth_1_m``: critically damped, settling within a few 1/w metres
whatever the speed. Speed changes at ``acceleration_m_s2`` and the driver brakes in time for a stop.
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
from twin.signals import Command, VehicleState

CONTROL_HZ = 50.0
_STANDING_M_S = 0.05
_ARRIVED_M = 0.3
_LONGEST_PATH_M = 100_000.0


class Segment(Config):
    """One piece of what the driver does: a straight, a turn, a stop, or only a new speed."""

    straight_m: Positive | None = None
    """Drive straight on for this distance."""
    turn_deg: Annotated[float, Field(ge=-3600.0, le=3600.0)] | None = None
    """Turn by this angle, positive to the left."""
    radius_m: Annotated[float, Field(ge=1.0)] | None = None
    """Radius of the turn, for the middle of the rear axle."""
    stop_s: Positive | None = None
    """Stop and stand for this long with the brake on."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=15.0)] | None = None
    """Speed from here on."""
    label: str = ""
    """Name of the segment in plots and events."""

    @model_validator(mode="after")
    def _one_thing(self) -> Self:
        given = [name for name in ("straight_m", "turn_deg", "stop_s") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"a segment is one of straight_m, turn_deg, stop_s; given were {' and '.join(given)}")
        if not given and self.speed_m_s is None:
            raise ValueError("a segment needs straight_m, turn_deg, stop_s or speed_m_s")
        if (self.turn_deg is None) != (self.radius_m is None):
            raise ValueError("turn_deg and radius_m go together")
        if self.turn_deg == 0.0:
            raise ValueError("turn_deg = 0 is no turn")
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
        if self.stop_s is not None:
            return f"stand {self.stop_s:g} s"
        return f"speed {self.speed_m_s:g} m/s"


class DriverConfig(Config):
    """Who steers, along what."""

    follows: Literal["truth"] = "truth"
    """What the driver goes by."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=15.0)] = 2.5
    """Speed until a segment says otherwise."""
    acceleration_m_s2: Annotated[float, Field(gt=0.0, le=3.0)] = 0.5
    """How fast the driver changes speed, both ways."""
    steering_bandwidth_1_m: Annotated[float, Field(gt=0.0, le=2.0)] = 0.25
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


@dataclass(frozen=True, slots=True)
class _Leg:
    """A segment laid on the path: where it begins and ends, how fast, how long to stand at its end."""

    name: str
    from_m: float
    to_m: float
    speed_m_s: float
    stop_s: float


def _lay_out(segments: Iterable[Segment], speed_m_s: float) -> tuple[list[tuple[float, float]], list[_Leg]]:
    pieces: list[tuple[float, float]] = []
    legs: list[_Leg] = []
    station = 0.0
    for segment in segments:
        speed_m_s = segment.speed_m_s if segment.speed_m_s is not None else speed_m_s
        length = 0.0
        if segment.straight_m is not None:
            length = segment.straight_m
            pieces.append((length, 0.0))
        elif segment.turn_deg is not None and segment.radius_m is not None:
            length = abs(math.radians(segment.turn_deg)) * segment.radius_m
            pieces.append((length, math.copysign(1.0 / segment.radius_m, segment.turn_deg)))
        if length or segment.stop_s is not None:
            legs.append(_Leg(segment.name, station, station + length, speed_m_s, segment.stop_s or 0.0))
        station += length
    return pieces, legs


def planned_path(config: DriverConfig, start_e_n_heading: tuple[float, float, float]) -> Path:
    """Lay the driver's segments out from the start pose of the rear axle (east m, north m, heading rad)."""
    pieces, _ = _lay_out(config.path, config.speed_m_s)
    east, north, heading = start_e_n_heading
    return Path(east_m=east, north_m=north, heading_rad=heading, pieces=pieces)


class Driver:
    """Follows the planned path from what it is told of the vehicle, at :data:`CONTROL_HZ`."""

    def __init__(
        self, config: DriverConfig, *, start_e_n_heading: tuple[float, float, float], wheelbase_m: float, seed: int
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
        self._wander = world_generator(seed, "driver")
        self._offset_m = config.wander_m * float(self._wander.standard_normal())

    @property
    def segment_names(self) -> tuple[str, ...]:
        """Names of the legs, in order; the state after the last one is ``finished``."""
        return (*(leg.name for leg in self._legs), "finished")

    def command(self, vehicle: VehicleState, interval_s: float) -> Command:
        """Return what the driver asks of the machine now; called every ``interval_s``."""
        self._station_m, offset_m = self.path.project(vehicle.east_m, vehicle.north_m, near_m=self._station_m)
        standing = self._advance(vehicle.speed_m_s, interval_s)
        if standing:
            self._speed_m_s = 0.0
            return Command(speed_m_s=0.0, steering_rad=self._steering(vehicle, offset_m), brake=True)
        limit = self._config.acceleration_m_s2 * interval_s
        step = min(max(self._wanted_speed() - self._speed_m_s, -limit), limit)
        self._speed_m_s += step
        self._walk_offset(interval_s)
        return Command(speed_m_s=self._speed_m_s, steering_rad=self._steering(vehicle, offset_m))

    def _advance(self, speed_m_s: float, interval_s: float) -> bool:
        """Move on to the leg the machine is in; tell whether the machine has to stand now."""
        while self.segment < len(self._legs):
            leg = self._legs[self.segment]
            if leg.stop_s == 0.0:
                if self._station_m < leg.to_m - 1e-6 and not self._stops_short(leg, speed_m_s):
                    return False
            else:
                arrived = self._station_m >= leg.to_m - _ARRIVED_M and abs(speed_m_s) < _STANDING_M_S
                if not arrived and self._stood_s == 0.0:
                    return False
                if self._stood_s < leg.stop_s - interval_s / 2.0:
                    self._stood_s += interval_s
                    return True
            self.segment += 1
            self._stood_s = 0.0
        return abs(speed_m_s) < _STANDING_M_S

    def _stops_short(self, leg: _Leg, speed_m_s: float) -> bool:
        """Tell whether the machine has come to rest within reach of a stop at the end of this leg."""
        stop_next = self.segment + 1 == len(self._legs) or self._legs[self.segment + 1].stop_s > 0.0
        near = self._station_m >= leg.to_m - _ARRIVED_M
        return stop_next and near and abs(speed_m_s) < _STANDING_M_S

    def _wanted_speed(self) -> float:
        """Leg's speed, limited so that the next lower speed or stop is reached at its station."""
        if self.segment >= len(self._legs):
            return 0.0
        wanted = self._legs[self.segment].speed_m_s if self._legs[self.segment].stop_s == 0.0 else math.inf
        deceleration = 0.9 * self._config.acceleration_m_s2
        for leg in self._legs[self.segment :]:
            target, at_m = (0.0, leg.to_m) if leg.stop_s > 0.0 else (leg.speed_m_s, leg.from_m)
            ahead = max(0.0, at_m - self._station_m)
            wanted = min(wanted, math.sqrt(target**2 + 2.0 * deceleration * ahead))
        end = max(0.0, self._legs[-1].to_m - self._station_m)
        return min(wanted, math.sqrt(2.0 * deceleration * end))

    def _walk_offset(self, interval_s: float) -> None:
        if self._config.wander_m > 0.0:
            keep = math.exp(-interval_s / 8.0)
            shock = self._config.wander_m * math.sqrt(1.0 - keep * keep)
            self._offset_m = keep * self._offset_m + shock * float(self._wander.standard_normal())

    def _steering(self, vehicle: VehicleState, offset_m: float) -> float:
        w = self._config.steering_bandwidth_1_m
        ahead_m = max(0.2, vehicle.speed_m_s * self._config.preview_s)
        forward = self.path.curvature_ahead(self._station_m, ahead_m)
        heading_error = wrap_angle_scalar(vehicle.heading_rad - self.path.pose(self._station_m).heading_rad)
        error_m = float(np.clip(offset_m - self._offset_m, -3.0, 3.0))
        curvature = forward - w * w * error_m - 2.0 * w * math.sin(heading_error)
        return math.atan(self._wheelbase_m * curvature)
