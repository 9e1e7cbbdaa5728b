"""What a filter that works at the receiver's pace knows at each fix (paper 003: "the GPS signal triggered all ECUs").

Sensors that the receiver triggers sample when its sentence arrives, so that their samples come with the fix or just
after it: an epoch is complete when every sensor has told something not older than the arrival of the fix, or has let
0.15 s pass. Sensors that sample at a pace of their own serve as well: of a speed the mean since the epoch before is
taken, of a steering angle the last; a rate of turn is summed up to a heading.

The gyro's offset is what it shows while the wheels stand still; the mean over the last standstill of a second or more
is taken off. The paper does not say how it found its gyro's zero; without one, 0.3 deg/s of offset would be 30 degrees
after 100 s. Gyro and encoders may come in either order, so a turn counts until the encoders have said of the time
before and after it that they stand: then it was none, and is taken off again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.estimators.guidance_base import SteeredConfig
from twin.estimators.guidance_gps import Motion
from twin.estimators.guidance_readers import (
    ANGLE_TRANSDUCER,
    RATE_KINDS,
    SPEED_KINDS,
    STEERING_ANGLE,
    ColumnReader,
    Fix,
    FixReader,
    SpeedReader,
    rate_reader,
    speed_reader,
)
from twin.estimators.roles import GNSS
from twin.geometry import wrap_angle
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

_PATIENCE_NS = 150_000_000
_LONGEST_S = 2.0
"""What a sensor told longer ago than this is over."""
_STANDING_M_S = 0.01
_ZEROING_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Epoch:
    """A fix and what the other sensors told by then; (R,) each, zero where it is not known."""

    fix: Fix
    heading: FloatArray
    """Summed from the rate of turn, or the receiver's course; counter-clockwise from east, rad."""
    heading_known: BoolArray
    speed: FloatArray
    """Of the wheels, or the receiver's; m/s."""
    speed_known: BoolArray
    rate: FloatArray
    """Rate of turn, to the left; rad/s."""
    steering: FloatArray
    """Steering angle, to the left; rad."""
    steering_known: BoolArray


class _Zero:
    """The gyro's offset: its mean over the last standstill that was long enough, zero before the first."""

    def __init__(self, runs: int) -> None:
        self.offset: FloatArray = np.zeros(runs)
        """(R,) rad/s."""
        self._sum, self._time_s = np.zeros(runs), np.zeros(runs)
        self._open, self._open_s, self._turned = np.zeros(runs), np.zeros(runs), np.zeros(runs)
        self._stood: BoolArray = np.ones(runs, dtype=np.bool_)

    def hear(self, rate: FloatArray, dt_s: FloatArray) -> FloatArray:
        """Take a rate (R,) that lasted ``dt_s`` (R,), and may yet turn out to be none; return the turn (R,)."""
        turn = (rate - self.offset) * dt_s
        self._open, self._open_s = self._open + rate * dt_s, self._open_s + dt_s
        self._turned = self._turned + turn
        return turn

    def judge(self, standing: BoolArray, told: BoolArray) -> FloatArray:
        """Take from the encoders, where ``told`` (R,), whether they stand; return the turns (R,) that were none."""
        none = told & standing & self._stood
        self._sum = np.where(told & ~standing, 0.0, self._sum + np.where(none, self._open, 0.0))
        self._time_s = np.where(told & ~standing, 0.0, self._time_s + np.where(none, self._open_s, 0.0))
        enough = self._time_s >= _ZEROING_S
        self.offset = np.where(enough, self._sum / np.where(enough, self._time_s, 1.0), self.offset)
        feigned = np.where(none, self._turned, 0.0)
        self._open, self._open_s = np.where(told, 0.0, self._open), np.where(told, 0.0, self._open_s)
        self._turned = np.where(told, 0.0, self._turned)
        self._stood = np.where(told, standing, self._stood)
        return feigned

    def keep(self, mask: BoolArray) -> None:
        """The turns until now are not to be taken off where ``mask`` (R,)."""
        self._turned = np.where(mask, 0.0, self._turned)


class Epochs:
    """Gathers epochs from measurements in order of arrival.

    Raises:
        BadInputError: a sensor lacks a column, or the antenna sits on another body than the reference frame.
    """

    def __init__(self, infos: Mapping[str, SensorInfo], setup: EstimatorSetup, config: SteeredConfig) -> None:
        runs = self._runs = setup.runs
        self.receiver = FixReader(infos[GNSS], setup)
        self._rate: ColumnReader | None = next((rate_reader(infos[k], setup) for k in RATE_KINDS if k in infos), None)
        radius_m = config.wheel_radius_of(setup)
        self._speed: SpeedReader | None = next(
            (speed_reader(infos[k], setup, wheel_radius_m=radius_m) for k in SPEED_KINDS if k in infos), None
        )
        self._steering: ColumnReader | None = None
        if ANGLE_TRANSDUCER in infos:
            self._steering = ColumnReader(infos[ANGLE_TRANSDUCER], setup, STEERING_ANGLE)
        readers = (self._rate, self._speed, self._steering)
        self._others = frozenset(reader.name for reader in readers if reader is not None)
        self._course_from_m_s = config.course_from_m_s
        self._motion = Motion(runs)
        self._pending: Fix | None = None
        self._awaited: set[str] = set()
        start = setup.start_e_n_heading[2]
        self.heading: FloatArray = np.full(runs, start)
        """(R,) summed from the rate of turn since the start, not wrapped; NaN before it is known."""
        self._rate_now, self._rate_ns = np.zeros(runs), np.full(runs, -NS_PER_S * 10**6)
        self._steering_now, self._steering_ns = np.zeros(runs), self._rate_ns.copy()
        self._way, self._time_s, self._pace = np.zeros(runs), np.zeros(runs), np.full(runs, np.nan)
        self._zero = _Zero(runs)

    @property
    def sums_rates(self) -> bool:
        """Whether there is a sensor of the rate of turn."""
        return self._rate is not None

    def add(self, measurement: Measurement) -> list[Epoch]:
        """Take a measurement; return the epochs that it completes, at most two."""
        done: list[Epoch] = []
        name = measurement.sensor
        if self._is_over(measurement.t_available_ns) or (self._pending is not None and name == self.receiver.name):
            done += self._complete()
        if name == self.receiver.name:
            self._pending = self.receiver.read(measurement)
            self._awaited = set(self._others)
        elif name in self._others:
            self._hear(measurement)
            if self._pending is not None and measurement.t_ns >= self._pending.t_available_ns:
                self._awaited.discard(name)
        if self._pending is not None and not self._awaited:
            done += self._complete()
        return done

    def close(self, t_ns: int) -> list[Epoch]:
        """Return the epoch that waits, if at ``t_ns`` it has waited long enough."""
        return self._complete() if self._is_over(t_ns) else []

    def set_heading(self, heading: FloatArray, mask: BoolArray) -> None:
        """Count the heading from here where ``mask`` (R,)."""
        self.heading = np.where(mask, heading, self.heading)
        self._zero.keep(mask)

    def _is_over(self, t_ns: int) -> bool:
        return self._pending is not None and t_ns > self._pending.t_available_ns + _PATIENCE_NS

    def _hear(self, measurement: Measurement) -> None:
        name = measurement.sensor
        if self._rate is not None and name == self._rate.name:
            told = self._rate.read(measurement)
            gone_on = told.there & (told.dt_s > 0.0) & (told.dt_s <= _LONGEST_S)
            self.heading = self.heading + self._zero.hear(told.value, np.where(gone_on, told.dt_s, 0.0))
            broken = told.there & (told.dt_s > _LONGEST_S)
            self.heading = np.where(broken, np.nan, self.heading)  # whatever was turned meanwhile is not known
            self._rate_now = np.where(told.there, told.value - self._zero.offset, self._rate_now)
            self._rate_ns = np.where(told.there, told.t_ns, self._rate_ns)
        if self._speed is not None and name == self._speed.name:
            told = self._speed.read(measurement)
            span_s = np.where(told.there & (told.dt_s <= _LONGEST_S), told.dt_s, 0.0)
            self._way, self._time_s = self._way + told.value * span_s, self._time_s + span_s
            self._pace = np.where(told.there, told.value, self._pace)
            self.heading = self.heading - self._zero.judge(np.abs(told.value) < _STANDING_M_S, told.there)
        if self._steering is not None and name == self._steering.name:
            told = self._steering.read(measurement)
            self._steering_now = np.where(told.there, told.value, self._steering_now)
            self._steering_ns = np.where(told.there, told.t_ns, self._steering_ns)

    def _complete(self) -> list[Epoch]:
        fix, self._pending = self._pending, None
        if fix is None:
            return []
        now_ns, since = fix.t_available_ns, round(_LONGEST_S * NS_PER_S)
        own_speed, course = self._motion.of(fix)
        course = np.where(own_speed >= self._course_from_m_s, course, np.nan)
        self.set_heading(course, np.isnan(self.heading))
        heading = course if self._rate is None else self._unwrapped(course, now_ns - self._rate_ns > since)
        speed = own_speed if self._speed is None else self._mean_speed(own_speed)
        steered = now_ns - self._steering_ns <= since
        rate = np.where(now_ns - self._rate_ns <= since, self._rate_now, 0.0)
        return [
            Epoch(
                fix=fix,
                heading=np.where(np.isnan(heading), 0.0, heading),
                heading_known=~np.isnan(heading),
                speed=np.where(np.isnan(speed), 0.0, speed),
                speed_known=~np.isnan(speed),
                rate=rate,
                steering=np.where(steered, self._steering_now, 0.0),
                steering_known=steered,
            )
        ]

    def _mean_speed(self, own: FloatArray) -> FloatArray:
        """Mean speed (R,) of the wheels since the last epoch, or the receiver's ``own`` (R,); begin a new mean."""
        driven = self._time_s > 0.0
        pace = np.where(driven, self._way / np.where(driven, self._time_s, 1.0), self._pace)
        self._way, self._time_s = np.zeros(self._runs), np.zeros(self._runs)
        self._pace = np.full(self._runs, np.nan)
        return np.where(np.isnan(pace), own, pace)

    def _unwrapped(self, course: FloatArray, silent: BoolArray) -> FloatArray:
        """The summed heading; where its sensor is silent, the course, as that turn nearest to it."""
        nearest = self.heading + wrap_angle(course - self.heading)
        return np.where(silent, nearest, self.heading)
