"""What all drivers share that keep a machine in a lane on their own: the axis, the way made, the sign, the end.

A lane is a straight axis that begins where the machine stands and points where it points, or as far beside it and at
such an angle to it as ``start_offset_m`` and ``start_heading_deg`` say. Such a driver stands for a
while (filters calibrate), drives by its own law (:meth:`LaneDriver.steer`), and ends in one of two ways: its camera has
seen the stop sign in several pictures running, or the lane's length is behind it, sign or no sign, so that a sign it
missed does not end the drive in the hedge. The way made is that of an odometer (an estimator of position), or, without
one, what was commanded.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Annotated, ClassVar

from pydantic import Field

from twin.config import NonNegative, Positive
from twin.control.hearing import TRUTH, ControllerConfig
from twin.geometry import Path
from twin.signals import (
    HEADING,
    LANE_HEADING,
    LANE_OFFSET,
    NS_PER_S,
    POSITION,
    SIGN_RANGE,
    SIGN_SEEN,
    Command,
    Knowledge,
    Listening,
    Said,
)

STANDING = "standing"
STOPPED_AT_SIGN = "stopped at the sign"
STOPPED_AT_END = "stopped at the end of the lane"


class LaneDriverConfig(ControllerConfig):
    """What every driver of a lane has."""

    follows: str = TRUTH
    """Estimator that the driver steers by, or "truth"."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=5.0)] = 0.5
    """Wanted speed (paper 001, chapter 2: 0.5 m/s)."""
    acceleration_m_s2: Annotated[float, Field(gt=0.0, le=5.0)] = 1.0
    """How fast the speed is changed, both ways."""
    lane_m: Annotated[float, Field(gt=0.0, le=10_000.0)]
    """Length of the lane from the start: where the machine stops at the latest."""
    start_offset_m: float = 0.0
    """Of the machine from the lane's axis at the start, positive to the left."""
    start_heading_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 0.0
    """Of the machine against the lane's axis at the start, positive to the left."""
    stand_s: NonNegative = 0.0
    """Time at the beginning in which the machine stands and its filters calibrate."""
    camera: str | None = None
    """Sensor that looks for the sign; without one nobody does."""
    sightings: Annotated[int, Field(ge=1, le=20)] = 2
    """Pictures running in which the sign has to be seen."""
    sign_at_m: Positive | None = None
    """Stop with the camera this far from the sign; without it at once when the sign is seen, as the paper's robot."""
    odometer: str | None = None
    """Estimator of position that tells the way made; without one the commanded speed does."""

    states: ClassVar[tuple[str, ...]]
    """Names of the driver's states, in the order of the truth's column ``segment``."""
    steers_by: ClassVar[tuple[str, ...]]
    """Columns that it needs of the estimator it follows."""

    @property
    def listens(self) -> Listening:
        """Whom the driver listens to."""
        followed = () if self.follows == TRUTH else (self.follows,)
        odometer = () if self.odometer is None else (self.odometer,)
        return Listening(
            estimators=tuple(dict.fromkeys((*followed, *odometer))),
            sensors=() if self.camera is None else (self.camera,),
            truth=not followed,
        )

    @property
    def needed_columns(self) -> dict[str, tuple[str, ...]]:
        """Columns that are needed of each of them."""
        asked: dict[str | None, tuple[str, ...]] = {self.odometer: POSITION[:2], self.camera: (SIGN_SEEN, SIGN_RANGE)}
        if self.follows != TRUTH:
            asked[self.follows] = (*asked.get(self.follows, ()), *self.steers_by)
        return {name: columns for name, columns in asked.items() if name is not None}


class LaneDriver(ABC):
    """Implements :class:`twin.control.Driver` for a lane; subclasses steer."""

    def __init__(self, config: LaneDriverConfig, *, start_e_n_heading: tuple[float, float, float]) -> None:
        east, north, heading = start_e_n_heading
        heading -= math.radians(config.start_heading_deg)
        east += config.start_offset_m * math.sin(heading)
        north -= config.start_offset_m * math.cos(heading)
        self.path = Path(east_m=east, north_m=north, heading_rad=heading, pieces=[(config.lane_m, 0.0)])
        self.segment = config.states.index(STANDING)
        """Index of the state among ``segment_names``."""
        self.segment_names = config.states
        self.speed_m_s = 0.0
        """Commanded now."""
        self.way_m = 0.0
        """Made along the lane so far, as far as the driver knows."""
        self._lane = config
        self._start = east, north, heading
        self._watch = _SignWatch(config)

    @property
    def state(self) -> str:
        """Name of the state the driver is in."""
        return self.segment_names[self.segment]

    @abstractmethod
    def steer(self, knowledge: Knowledge, interval_s: float) -> tuple[str, float, float]:
        """Return the state to be in, the speed wanted (m/s) and the yaw rate (rad/s)."""

    def command(self, knowledge: Knowledge, interval_s: float) -> Command:
        """Return what the driver asks of the machine now; called every ``interval_s``."""
        self._make_way(knowledge, interval_s)
        if self.state.startswith("stopped"):
            return self._halt(interval_s)
        if knowledge.t_ns < self._lane.stand_s * NS_PER_S:
            return Command(brake=True)
        if self._watch.stops(knowledge, self.speed_m_s, self._lane.acceleration_m_s2):
            return self._stop(STOPPED_AT_SIGN, interval_s)
        braking_m = self.speed_m_s**2 / (2.0 * self._lane.acceleration_m_s2)
        if self.way_m >= self._lane.lane_m - braking_m:
            return self._stop(STOPPED_AT_END, interval_s)
        state, speed, rate = self.steer(knowledge, interval_s)
        if state.startswith("stopped"):
            return self._stop(state, interval_s)
        self.segment = self.segment_names.index(state)
        self._change_speed(speed, interval_s)
        standing = state == STANDING
        return Command(speed_m_s=self.speed_m_s, yaw_rate_rad_s=rate, brake=standing and self.speed_m_s == 0.0)

    def followed(self, knowledge: Knowledge) -> Said | None:
        """What is said of the machine by whom the driver follows; None before the first word."""
        whom = self._lane.follows
        return self.in_lane(knowledge) if whom == TRUTH else knowledge.said.get(whom)

    def heading_error(self, said: Said | None) -> float:
        """Heading against the lane's axis, rad, by an estimate of it or of the heading; NaN without one."""
        if said is None:
            return math.nan
        if LANE_HEADING in said.values:
            return said.values[LANE_HEADING]
        error = said.values.get(HEADING, math.nan) - self._start[2]
        return math.remainder(error, 2.0 * math.pi)

    def in_lane(self, knowledge: Knowledge) -> Said:
        """Offset and heading in the lane as seen from the seat, for drivers that follow the truth."""
        vehicle = knowledge.seen_from_the_seat
        east, north = vehicle.east_m - self._start[0], vehicle.north_m - self._start[1]
        offset = north * math.cos(self._start[2]) - east * math.sin(self._start[2])
        heading = math.remainder(vehicle.heading_rad - self._start[2], 2.0 * math.pi)
        return Said(t_ns=knowledge.t_ns, values={LANE_OFFSET: offset, LANE_HEADING: heading})

    def _stop(self, state: str, interval_s: float) -> Command:
        self.segment = self.segment_names.index(state)
        return self._halt(interval_s)

    def _halt(self, interval_s: float) -> Command:
        self._change_speed(0.0, interval_s)
        return Command(speed_m_s=self.speed_m_s, brake=self.speed_m_s == 0.0)

    def _change_speed(self, wanted_m_s: float, interval_s: float) -> None:
        limit = self._lane.acceleration_m_s2 * interval_s
        self.speed_m_s += min(max(wanted_m_s - self.speed_m_s, -limit), limit)

    def _make_way(self, knowledge: Knowledge, interval_s: float) -> None:
        if self._lane.odometer is None:
            self.way_m += self.speed_m_s * interval_s
            return
        said = knowledge.said.get(self._lane.odometer)
        if said is not None:
            east = said.values[POSITION[0]] - self._start[0]
            north = said.values[POSITION[1]] - self._start[1]
            self.way_m = east * math.cos(self._start[2]) + north * math.sin(self._start[2])


class _SignWatch:
    """Counts pictures with a sign, and works out when to brake for it."""

    def __init__(self, config: LaneDriverConfig) -> None:
        self._camera = config.camera
        self._wanted = config.sightings
        self._at_m = config.sign_at_m
        self._seen = 0
        self._last_ns = -1
        self._ahead_m = math.inf

    def stops(self, knowledge: Knowledge, speed_m_s: float, deceleration_m_s2: float) -> bool:
        """Tell whether to brake now."""
        sample = knowledge.measured.get(self._camera) if self._camera is not None else None
        if sample is None:
            return False
        if sample.t_ns != self._last_ns:
            self._last_ns = sample.t_ns
            self._seen = self._seen + 1 if sample.values[SIGN_SEEN] > 0.0 else 0
            self._ahead_m = sample.values[SIGN_RANGE]
        if self._seen < self._wanted:
            return False
        if self._at_m is None:
            return True
        since_m = speed_m_s * (knowledge.t_ns - sample.t_ns) / NS_PER_S
        return self._ahead_m - since_m - speed_m_s**2 / (2.0 * deceleration_m_s2) <= self._at_m
