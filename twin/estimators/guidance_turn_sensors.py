"""Curvature of the way from the sensors that see a turn without a satellite, the best of those there are.

Steering angle delta: tan(delta) / wheelbase (the middle of the rear axle, no side slip). Its zero is the median of the
last readings while driving: on a wheelbase of 1 m one degree off makes the curvature of a 60 m bend, and most of a
field is straight. A yaw rate: over the speed.
Wheel encoders: the difference of the two wheels' ways over their mean and the track.
"""

from __future__ import annotations

import numpy as np

from twin.errors import BadInputError
from twin.estimators.guidance_readers import (
    ANGLE_TRANSDUCER,
    ODOMETRY,
    RATE_KINDS,
    SPEED_KINDS,
    STEERING_ANGLE,
    YAW_GYRO,
)
from twin.estimators.heading_inputs import SLOT_COLUMNS, WHEEL_ENCODERS
from twin.estimators.roles import IMU, SPEED_COLUMN, column_places, usable
from twin.estimators.wheel_odometry import Odometer
from twin.signals import YAW_RATE, EstimatorSetup, FloatArray, Measurement, SensorInfo

TURN_SENSORS = (ANGLE_TRANSDUCER, *RATE_KINDS, WHEEL_ENCODERS)
"""Kinds that tell a curvature, from the best to the worst."""
_COLUMN = {ANGLE_TRANSDUCER: STEERING_ANGLE, ODOMETRY: YAW_RATE, YAW_GYRO: YAW_RATE, IMU: "gyro_z_rad_s"}
_LEAST_WAY_M = 0.1
_ZERO_READINGS, _FEWEST_READINGS = 500, 10


class CurvatureSensors:
    """Keeps the newest curvature for R members.

    Raises:
        BadInputError: no sensor tells one, or a steering angle goes with no wheelbase, or encoders with no wheels.
    """

    def __init__(self, setup: EstimatorSetup, *, wheel_radius_m: float, track_m: float, slow_m_s: float) -> None:
        self._slow_m_s = slow_m_s
        found = {info.kind: info for info in reversed(list(setup.sensors.values())) if info.kind in TURN_SENSORS}
        best = next((kind for kind in TURN_SENSORS if kind in found), None)
        if best is None:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors = {list(setup.sensors)}: none of them sees a turn; "
                f"odometer_and_steering needs one of kind {', '.join(TURN_SENSORS)}"
            )
        if best == ANGLE_TRANSDUCER and setup.wheelbase_m <= 0.0:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors: {found[best].name!r} gives a steering angle, but this machine has "
                "no wheelbase"
            )
        if best == WHEEL_ENCODERS and min(wheel_radius_m, track_m) <= 0.0:
            raise BadInputError(
                f"[estimators.{setup.name}.switch] wheel_radius_m, track_m: {found[best].name!r} counts turns of "
                "wheels, and nothing here tells how large they are and how far apart; give both, m"
            )
        self._kind, self._info, self._wheelbase_m, self._track_m = best, found[best], setup.wheelbase_m, track_m
        columns = SLOT_COLUMNS if best == WHEEL_ENCODERS else (_COLUMN[best],)
        self._places = column_places(self._info, columns, setup=setup)
        self._odometer: Odometer | None = None
        if best == WHEEL_ENCODERS:
            self._odometer = Odometer(self._info, wheel_radius_m=wheel_radius_m, track_m=track_m, runs=setup.runs)
        self._since = np.zeros((setup.runs, 2))
        self._readings: FloatArray = np.full((_ZERO_READINGS, setup.runs), np.nan)
        self._count = 0
        self._reading: FloatArray = np.full(setup.runs, np.nan)
        self._speedometer = _speedometer(setup)
        self._speed: FloatArray = np.full(setup.runs, np.nan)

    def hear(self, measurement: Measurement) -> None:
        """Take a sample of any sensor."""
        if measurement.sensor == self._info.name:
            values = measurement.values[:, self._places]
            good = usable(measurement, values)
            if self._odometer is not None:
                turned, way = self._odometer.step(values, good)
                self._since = self._since + np.column_stack([turned, way])
            else:
                self._reading = np.where(good, values[:, 0], self._reading)
        if self._speedometer is not None and measurement.sensor == self._speedometer.name:
            speed = measurement.column(SPEED_COLUMN)
            self._speed = np.where(measurement.valid & np.isfinite(speed), speed, self._speed)

    def curvature(self, speed: FloatArray) -> FloatArray:
        """Curvature (R,), 1/m, left positive, NaN where unknown; ``speed`` (R,) counts where no odometer tells one."""
        if self._kind == ANGLE_TRANSDUCER:
            self._readings[self._count % _ZERO_READINGS] = np.where(speed >= self._slow_m_s, self._reading, np.nan)
            self._count += 1
            return np.tan(self._reading - self._zero()) / self._wheelbase_m
        if self._odometer is not None:
            turned, way = self._since.T
            enough = np.abs(way) >= _LEAST_WAY_M
            self._since = np.where(enough[:, np.newaxis], 0.0, self._since)
            return np.where(enough, turned / np.where(enough, way, 1.0), np.nan)
        speed = np.where(np.isfinite(self._speed), self._speed, speed)
        fast = np.abs(speed) >= self._slow_m_s
        return np.where(fast, self._reading / np.where(fast, speed, 1.0), np.nan)

    def _zero(self) -> FloatArray:
        """Median of the last readings (R,), 0 while there are too few."""
        ordered = np.sort(self._readings, axis=0)  # NaN last
        told = np.isfinite(ordered).sum(axis=0)
        middle = np.maximum((told - 1) // 2, 0)
        return np.where(told >= _FEWEST_READINGS, ordered[middle, np.arange(len(told))], 0.0)


def _speedometer(setup: EstimatorSetup) -> SensorInfo | None:
    """What tells a speed by a column of its own, the best there is."""
    able = (info for info in setup.sensors.values() if info.kind in SPEED_KINDS and SPEED_COLUMN in info.columns)
    return min(able, key=lambda info: SPEED_KINDS.index(info.kind), default=None)
