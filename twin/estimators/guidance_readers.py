"""What guidance filters hear: fixes, a rate of turn, ways and speeds, a steering angle; for R runs at once.

A reader turns the samples of one sensor into what a filter reckons with. A member that lost a sample, or got it as NaN,
is marked; its next sample then stands for the whole time since the last one it got.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import BadInputError
from twin.estimators.guidance_fix_kernels import AGE as AGE_ROW
from twin.estimators.guidance_fix_kernels import COURSE as COURSE_ROW
from twin.estimators.guidance_fix_kernels import HDOP, QUALITY, SIGMA_E, SIGMA_N, read_fix
from twin.estimators.guidance_fix_kernels import SPEED as SPEED_ROW
from twin.estimators.heading_inputs import SLOT_COLUMNS, WHEEL_ENCODERS
from twin.estimators.roles import (
    IMU,
    POSITION_COLUMNS,
    RADAR,
    SPEED_COLUMN,
    column_places,
    lever_arm,
    usable,
)
from twin.geometry import rotation_from_rpy, turned
from twin.signals import NS_PER_S, YAW_RATE, BoolArray, EstimatorSetup, FloatArray, IntArray, Measurement, SensorInfo

ODOMETRY, YAW_GYRO, ANGLE_TRANSDUCER = "odometry", "yaw_gyro", "angle_transducer"
COURSE, STEERING_ANGLE, AGE = "course_rad", "steering_angle_rad", "age_s"
RATE_KINDS = (YAW_GYRO, IMU, ODOMETRY)
"""What tells a rate of turn, in the order in which they are preferred."""
SPEED_KINDS = (WHEEL_ENCODERS, ODOMETRY, RADAR)
"""What tells a speed, in the order in which they are preferred."""

_SIGMAS = ("sigma_e_m", "sigma_n_m")
_GYRO = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
_FIX_COLUMNS = (*POSITION_COLUMNS, SPEED_COLUMN, COURSE, *_SIGMAS, "quality", "hdop", AGE)
"""In the order of the compiled functions."""
_NEVER = np.iinfo(np.int64).min


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix:
    """One sample of a receiver; NaN where it told nothing."""

    t_ns: int
    """When it was true; a clock that runs ahead is held at the time of arrival."""
    t_available_ns: int
    position: FloatArray
    """(R, 2) of the antenna, east and north, m."""
    there: BoolArray
    """(R,) whether it has a position."""
    speed: FloatArray
    """(R,) over ground, m/s."""
    course: FloatArray
    """(R,) direction of travel, counter-clockwise from east, rad."""
    sigma: FloatArray
    """(R, 2) reported of the position, m; NaN where it is not known (a receiver that reports zero does not know)."""
    quality: FloatArray
    """(R,) NMEA quality (GGA field 6); NaN where not told."""
    hdop: FloatArray
    """(R,) horizontal dilution of precision; NaN where not told."""
    age_s: FloatArray
    """(R,) of corrections; NaN where not told."""


class FixReader:
    """Reads a receiver.

    A sample without a position or of quality 0 (invalid) has ``there`` False. Position columns are needed, all others
    may be missing, as in logs of bare GGA sentences.

    Raises:
        BadInputError: the receiver gives no position, or its antenna sits on another body than the reference frame.
    """

    def __init__(self, info: SensorInfo, setup: EstimatorSetup) -> None:
        self.name = info.name
        self.info = info
        self.forward_m, self.left_m = lever_arm(info, setup)
        column_places(info, POSITION_COLUMNS, setup=setup)  # it has to have them
        places = {name: info.columns.index(name) for name in info.columns}
        if not set(_SIGMAS) <= set(places):
            places = {name: place for name, place in places.items() if name not in _SIGMAS}
        self._places: IntArray = np.array([places.get(name, -1) for name in _FIX_COLUMNS], dtype=np.int64)

    def read(self, measurement: Measurement) -> Fix:
        """Take a sample."""
        columns, position, there = read_fix(
            np.ascontiguousarray(measurement.values), np.ascontiguousarray(measurement.valid), self._places
        )
        return Fix(
            t_ns=min(measurement.t_ns, measurement.t_available_ns),
            t_available_ns=measurement.t_available_ns,
            position=position,
            there=there,
            speed=columns[SPEED_ROW],
            course=columns[COURSE_ROW],
            sigma=columns[SIGMA_E : SIGMA_N + 1].T,
            quality=columns[QUALITY],
            hdop=columns[HDOP],
            age_s=columns[AGE_ROW],
        )

    def reference(self, antenna: FloatArray, heading: FloatArray) -> FloatArray:
        """Where the reference frame is (R, 2) if the antenna is there and the machine, level, has that heading (R,)."""
        moved: FloatArray = antenna - np.stack(turned(self.forward_m, self.left_m, heading), axis=-1)
        return moved


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """One number per member."""

    t_ns: int
    value: FloatArray
    """(R,) what is not there is zero."""
    there: BoolArray
    """(R,)."""
    dt_s: FloatArray
    """(R,) since the member's last sample, s; zero at its first, and for one that is not later than its last."""


class _Since:
    """Time since every member's last sample."""

    def __init__(self, runs: int) -> None:
        self._last_ns: IntArray = np.full(runs, _NEVER, dtype=np.int64)

    def step(self, t_ns: int, there: BoolArray) -> FloatArray:
        """Seconds (R,) since the last sample of each member; its first, and one out of order, has none."""
        later = there & (self._last_ns != _NEVER) & (t_ns > self._last_ns)
        dt_s = np.where(later, t_ns - np.where(later, self._last_ns, 0), 0) / NS_PER_S
        self._last_ns = np.where(there, np.maximum(self._last_ns, t_ns), self._last_ns)
        return dt_s


class ColumnReader:
    """Reads one column of a sensor: a speed, a steering angle, a yaw rate.

    Raises:
        BadInputError: the sensor does not give it.
    """

    def __init__(self, info: SensorInfo, setup: EstimatorSetup, column: str) -> None:
        self.name = info.name
        self.info = info
        self._places = column_places(info, (column,), setup=setup)
        self._since = _Since(setup.runs)

    def read(self, measurement: Measurement) -> Told:
        """Take a sample."""
        values = self._values(measurement)
        there = usable(measurement, values[:, np.newaxis])
        t_ns = min(measurement.t_ns, measurement.t_available_ns)
        return Told(t_ns=t_ns, value=np.where(there, values, 0.0), there=there, dt_s=self._since.step(t_ns, there))

    def _values(self, measurement: Measurement) -> FloatArray:
        values: FloatArray = measurement.values[:, self._places][:, 0]
        return values


class ImuRateReader(ColumnReader):
    """Reads the rate of turn about the reference frame's upward axis from an inertial unit, however it is mounted."""

    def __init__(self, info: SensorInfo, setup: EstimatorSetup) -> None:
        super().__init__(info, setup, _GYRO[2])
        turn = rotation_from_rpy(*setup.reference.rpy_rad).T @ rotation_from_rpy(*info.mount.rpy_rad)
        self._up: FloatArray | None = None if np.array_equal(turn[2], (0.0, 0.0, 1.0)) else turn[2]
        if self._up is not None:
            self._gyro = column_places(info, _GYRO, setup=setup)

    def _values(self, measurement: Measurement) -> FloatArray:
        if self._up is None:
            return super()._values(measurement)
        values: FloatArray = measurement.values[:, self._gyro] @ self._up
        return values


def rate_reader(info: SensorInfo, setup: EstimatorSetup) -> ColumnReader:
    """Reader of the yaw rate (rad/s) of an inertial unit, a yaw gyro or a log's odometry."""
    return ImuRateReader(info, setup) if info.kind == IMU else ColumnReader(info, setup, YAW_RATE)


class EncoderReader:
    """Reads the way that the middle of the axle made from the counts of its two wheels.

    Raises:
        BadInputError: the encoders do not give both counts, or their data sheet no slots per turn, or nobody told how
            large the wheels are.
    """

    def __init__(self, info: SensorInfo, setup: EstimatorSetup, *, wheel_radius_m: float) -> None:
        self.name = info.name
        self.info = info
        slots = info.datasheet.get("slots_per_turn")
        if slots is None:
            raise BadInputError(f"[estimators.{setup.name}] sensors: {info.name!r} does not say its slots_per_turn")
        if wheel_radius_m <= 0.0:
            raise BadInputError(
                f"[estimators.{setup.name}] wheel_radius_m: {info.name!r} counts turns of wheels, and nothing here "
                "tells how large they are; give their rolling radius, m"
            )
        self.slot_m = 2.0 * np.pi * wheel_radius_m / slots
        """Way of a wheel per slot, m."""
        self._places = column_places(info, SLOT_COLUMNS, setup=setup)
        self._since = _Since(setup.runs)
        self._last = np.zeros((setup.runs, 2))

    def read(self, measurement: Measurement) -> Told:
        """Take a sample; the value is the mean speed since the member's last one, m/s, there if it has one."""
        slots = measurement.values[:, self._places]
        counted = usable(measurement, slots)
        t_ns = min(measurement.t_ns, measurement.t_available_ns)
        dt_s = self._since.step(t_ns, counted)
        there = counted & (dt_s > 0.0)
        ways = self.slot_m * (np.where(there[:, np.newaxis], slots, self._last) - self._last)
        self._last = np.where(counted[:, np.newaxis], slots, self._last)
        speed = 0.5 * (ways[:, 0] + ways[:, 1]) / np.where(there, dt_s, 1.0)
        return Told(t_ns=t_ns, value=speed, there=there, dt_s=dt_s)


SpeedReader = ColumnReader | EncoderReader


def speed_reader(info: SensorInfo, setup: EstimatorSetup, *, wheel_radius_m: float) -> SpeedReader:
    """Reader of the forward speed (m/s) of wheel encoders, a radar or a log's odometry."""
    if info.kind == WHEEL_ENCODERS:
        return EncoderReader(info, setup, wheel_radius_m=wheel_radius_m)
    return ColumnReader(info, setup, SPEED_COLUMN)
