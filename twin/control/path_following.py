"""A driver who keeps the machine's rear axle on a planned path and keeps a speed.

Steering is feed-forward of the path's curvature, looked at a moment ahead (a driver turns the wheel before the bend),
plus feedback on lateral offset e and heading error psi. In distance s along the path the closed loop is
e'' + 2 w e' + w^2 e = 0 with w = ``steering_bandwidth_1_m``: critically damped, settling within a few 1/w metres
whatever the speed. Speed changes at ``acceleration_m_s2`` and the driver brakes in time for a stop.

A loop that answers late by T is stable up to w v T = 0.65 (its phase margin without delay, 1.33 rad, at its crossover,
2.06 w). So w is at most 1 / (``steering_time_s`` v). For a driver in the seat, with what the steering and a fast car's
yaw take, 0.5 s will do (T up to 0.32 s). One that goes by an estimator (``follows``) sees the machine late and with
noise, at the rate and with the delay of a receiver, held samples counting as half an interval: with 2.5 s, delays up to
1.6 s do no harm at any speed. An offset beyond 1/w is not steered against any harder: at 1/w the line is approached at
30 degrees, whatever leap an estimate makes.

Where there is nothing to go by (see :mod:`twin.control.followed_estimate`), the driver holds the steering, slows down
to ``blind_speed_m_s`` (an estimator may need motion to find its heading), and stops after ``blind_s``, until there is
again. A driver that has to stand needs nobody to tell where.

The driver asks for the curvature twice over: as the steering angle of a single front wheel and as the yaw rate at the
commanded speed; a machine takes what it has. One that can turn on the spot may be asked to (``spin_deg``): it stops and
turns at ``spin_rate_deg_s``, slowing down before the end.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, Strict, model_validator

from twin.config import NonNegative
from twin.control.followed_estimate import GOES_BY, STANDING_M_S, FollowedEstimate
from twin.control.hearing import TRUTH, FollowerConfig
from twin.control.parallel_passes import ParallelPasses
from twin.control.path_plan import Entry, Leg, lay_out, length_m
from twin.geometry import Path, wrap_angle_scalar
from twin.randomness import world_generator
from twin.signals import Command, Knowledge, VehicleState

_ARRIVED_M, _ARRIVED_LENGTHS = 0.3, 0.075
"""A stop is reached within this distance, or this share of the feedback's length 1/w where that is less."""
_LOOK_M, _LOOK_LENGTHS = 0.2, 0.05
"""Least distance over which curvature ahead is averaged, likewise."""
_LONGEST_PATH_M = 100_000.0
_MOST_PASSES = 1000
_BEHIND_CORNER_M = 1e-6
_LARGEST_OFFSET_M = 3.0
"""Offsets beyond this are not steered against any harder."""
_SEAT_STEERING_TIME_S, _ESTIMATE_STEERING_TIME_S = 0.5, 2.5
_SEAT_WINDOW_M, _ESTIMATE_WINDOW_M = 10.0, 2.0
"""How far along the path the machine is looked for. An estimate that leaps sideways in a headland may be nearer to the
next line; a way that short never gets there."""
_SPIN_GAIN_1_S = 3.0
_SLOWEST_SPIN_RAD_S = 0.3
_SPUN_RAD = math.radians(1.0)


class PathDriverConfig(FollowerConfig):
    """A driver who follows a planned path, by what is seen from the seat or by an estimator."""

    kind: Literal["path"] = "path"
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
    steering_time_s: NonNegative | None = None
    """Steering feedback settles no faster than this in time, so that delays do no harm; by default 0.5 s for a driver
    in the seat and 2.5 s for one that goes by an estimator."""
    stale_after_s: Annotated[float, Field(gt=0.0, le=60.0)] = 2.0
    """Age up to which an estimate is believed, without the seat."""
    sets_a: bool = False
    """Whether lines are laid out from where the estimator has the machine at the start, as by a driver who sets point A
    where it stands and takes the direction of B as known; without it they were surveyed before."""
    blind_speed_m_s: NonNegative = 0.5
    """Largest speed with nothing to go by."""
    blind_s: NonNegative = 5.0
    """Stop after this time with nothing to go by."""
    path: Annotated[tuple[Entry, ...], Strict(strict=False), Field(min_length=1, max_length=1000)]
    """What the driver does, one segment or field of passes after the other."""

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        if sum(entry.passes for entry in self.path if isinstance(entry, ParallelPasses)) > _MOST_PASSES:
            raise ValueError(f"path: at most {_MOST_PASSES} passes in all are allowed")
        length = sum(length_m(entry) for entry in self.path)
        if length > _LONGEST_PATH_M:
            raise ValueError(f"path: {length:.3g} m long; at most {_LONGEST_PATH_M:g} m are allowed")
        return self

    @property
    def goes_by(self) -> tuple[str, ...]:
        """Columns that are needed of an estimator that it follows."""
        return GOES_BY

    @property
    def least_steering_time_s(self) -> float:
        """Time in which the feedback settles at the fastest."""
        if self.steering_time_s is not None:
            return self.steering_time_s
        return _SEAT_STEERING_TIME_S if self.follows == TRUTH else _ESTIMATE_STEERING_TIME_S


def planned_path(config: PathDriverConfig, start_e_n_heading: tuple[float, float, float]) -> Path:
    """Lay the driver's segments out from the start pose of the rear axle (east m, north m, heading rad)."""
    pieces, _ = lay_out(config.path, config.speed_m_s)
    east, north, heading = start_e_n_heading
    return Path(east_m=east, north_m=north, heading_rad=heading, pieces=pieces)


class PathDriver:
    """Follows the planned path by what is seen from the seat, or by an estimator."""

    def __init__(
        self,
        config: PathDriverConfig,
        *,
        start_e_n_heading: tuple[float, float, float],
        wheelbase_m: float,
        seed: int,
        reference_x_m: float = 0.0,
    ) -> None:
        self.path = planned_path(config, start_e_n_heading)
        self.segment = 0
        """Index of the current leg; equal to the number of legs once all is done."""
        self._legs = lay_out(config.path, config.speed_m_s)[1]
        self._config = config
        self._wheelbase_m = wheelbase_m
        self._station_m = 0.0
        self._speed_m_s = 0.0
        self._steering_rad = 0.0
        self._blind_for_s = 0.0
        self._standing = True
        self._followed: FollowedEstimate | None = None
        if config.follows != TRUTH:
            self._followed = FollowedEstimate(
                config.follows,
                ahead_m=reference_x_m,
                stale_after_s=config.stale_after_s,
                start_e_n_heading=start_e_n_heading,
                sets_a=config.sets_a,
            )
        self._window_m = _SEAT_WINDOW_M if self._followed is None else _ESTIMATE_WINDOW_M
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

    @property
    def blind(self) -> bool:
        """Whether it had nothing to go by when it was last asked, and drives on nevertheless or has stopped for it."""
        return self._blind_for_s > 0.0

    def command(self, knowledge: Knowledge, interval_s: float) -> Command:
        """Return what the driver asks of the machine now; called every ``interval_s``."""
        command = self._command(knowledge, interval_s)
        if self._followed is not None:
            self._followed.turn(command.yaw_rate_rad_s * interval_s)
        return command

    def _command(self, knowledge: Knowledge, interval_s: float) -> Command:
        vehicle = self._look(knowledge)
        if vehicle is None:
            return self._drive_blind(interval_s)
        self._blind_for_s = 0.0
        self._station_m, offset_m = self.path.project(
            vehicle.east_m, vehicle.north_m, near_m=self._station_m, window_m=self._window_m, from_m=self._corner_m
        )
        self._standing = self._advance(vehicle, interval_s)
        curvature = self._curvature(vehicle, offset_m)
        steering = self._steering_rad = math.atan(self._wheelbase_m * curvature)
        if self._standing:
            self._speed_m_s = 0.0
            rate = self._spin_rate()
            return Command(
                speed_m_s=0.0, steering_rad=steering, yaw_rate_rad_s=rate, brake=rate == 0.0, raised=self._raised
            )
        self._change_speed(self._wanted_speed(), interval_s)
        self._walk_offset(interval_s)
        rate = self._speed_m_s * curvature
        return Command(speed_m_s=self._speed_m_s, steering_rad=steering, yaw_rate_rad_s=rate, raised=self._raised)

    def _look(self, knowledge: Knowledge) -> VehicleState | None:
        """Where the machine is; None where there is nothing to go by and it ought to move."""
        if self._followed is None:
            return knowledge.seen_from_the_seat
        seen = self._followed.look(knowledge, self._speed_m_s)
        return self._followed.believed if seen is None and self._standing else seen

    def _drive_blind(self, interval_s: float) -> Command:
        """Hold the steering, slow down, and stop after a while."""
        self._blind_for_s += interval_s
        slow = self._config.blind_speed_m_s if self._blind_for_s <= self._config.blind_s else 0.0
        self._change_speed(min(self._wanted_speed(), slow), interval_s)
        rate = self._speed_m_s * math.tan(self._steering_rad) / self._wheelbase_m if self._wheelbase_m > 0.0 else 0.0
        return Command(
            speed_m_s=self._speed_m_s,
            steering_rad=self._steering_rad,
            yaw_rate_rad_s=rate,
            brake=self._speed_m_s == 0.0,
            raised=self._raised,
        )

    def _change_speed(self, wanted_m_s: float, interval_s: float) -> None:
        limit = self._config.acceleration_m_s2 * interval_s
        self._speed_m_s += min(max(wanted_m_s - self._speed_m_s, -limit), limit)

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
                arrived = self._station_m >= leg.to_m - self._arrived_m and abs(speed_m_s) < STANDING_M_S
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
        return abs(speed_m_s) < STANDING_M_S

    def _spinning(self, leg: Leg, heading_rad: float) -> bool:
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

    def _stops_short(self, leg: Leg, speed_m_s: float) -> bool:
        """Tell whether the machine has come to rest within reach of a stop at the end of this leg."""
        stop_next = self.segment + 1 == len(self._legs) or self._legs[self.segment + 1].halts
        near = self._station_m >= leg.to_m - self._arrived_m
        return stop_next and near and abs(speed_m_s) < STANDING_M_S

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
        w = self._bandwidth_1_m(vehicle.speed_m_s)
        ahead_m = max(self._look_m, vehicle.speed_m_s * self._config.preview_s)
        forward = self.path.curvature_ahead(self._station_m, ahead_m)
        on_leg_m = max(self._station_m, self._corner_m + _BEHIND_CORNER_M)
        heading_error = wrap_angle_scalar(vehicle.heading_rad - self.path.pose(on_leg_m).heading_rad)
        largest_m = min(_LARGEST_OFFSET_M, 1.0 / w)
        error_m = min(max(offset_m - self._offset_m, -largest_m), largest_m)
        return forward - w * w * error_m - 2.0 * w * math.sin(heading_error)

    def _bandwidth_1_m(self, speed_m_s: float) -> float:
        """Of the steering feedback at a speed."""
        settles_m = self._config.least_steering_time_s * abs(speed_m_s)
        w = self._config.steering_bandwidth_1_m
        return w if w * settles_m <= 1.0 else 1.0 / settles_m
