"""What each sensor is to a planar filter of one rigid body: an input, a yaw rate, a speed, a position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.errors import BadInputError
from twin.geometry import rotation_from_rpy
from twin.signals import BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

IMU, RADAR, ACCOSAT, GNSS = "imu", "radar", "accosat", "gnss"

INERTIAL_COLUMNS = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2", "gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
SPEED_COLUMN = "speed_m_s"
POSITION_COLUMNS = ("position_e_m", "position_n_m")

Places = slice | list[int]
"""Columns to take of an array's last axis; a slice where they are neighbours, which copies nothing."""


def pick_sensors(setup: EstimatorSetup, kinds: Sequence[str], *, estimator: str) -> dict[str, list[SensorInfo]]:
    """The sensors of the estimator by kind, in the order listed.

    Raises:
        BadInputError: a sensor is of a kind this estimator cannot use.
    """
    picked: dict[str, list[SensorInfo]] = {kind: [] for kind in kinds}
    for info in setup.sensors.values():
        if info.kind not in picked:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors: {info.name!r} is of kind {info.kind!r}; "
                f"{estimator} can use {', '.join(kinds)}"
            )
        picked[info.kind].append(info)
    return picked


def column_places(info: SensorInfo, columns: Sequence[str], *, setup: EstimatorSetup) -> Places:
    """Places of ``columns`` in a sensor's values.

    Raises:
        BadInputError: the sensor does not give one of them.
    """
    missing = [name for name in columns if name not in info.columns]
    if missing:
        raise BadInputError(
            f"[estimators.{setup.name}] sensors: {info.name!r} gives no {', '.join(missing)}; "
            f"it gives {', '.join(info.columns)}"
        )
    places = [info.columns.index(name) for name in columns]
    consecutive = places == list(range(places[0], places[0] + len(places)))
    return slice(places[0], places[0] + len(places)) if consecutive else places


def mount_arm(info: SensorInfo, setup: EstimatorSetup) -> tuple[float, float, float]:
    """Where a sensor sits in the reference frame: metres forward, to the left and up.

    Raises:
        BadInputError: the sensor sits on another body of the machine, so that there is no fixed lever arm.
    """
    if info.mount.body != setup.reference.body:
        raise BadInputError(
            f"[estimators.{setup.name}] sensors: {info.name!r} sits on {info.mount.body!r}, but this estimator knows "
            f"one rigid body, {setup.reference.body!r}"
        )
    offset = np.subtract(info.mount.xyz_m, setup.reference.xyz_m)
    forward, left, up = rotation_from_rpy(*setup.reference.rpy_rad).T @ offset
    return float(forward), float(left), float(up)


def lever_arm(info: SensorInfo, setup: EstimatorSetup) -> tuple[float, float]:
    """The horizontal part of :func:`mount_arm`: metres forward and to the left.

    Raises:
        BadInputError: the sensor sits on another body of the machine.
    """
    return mount_arm(info, setup)[:2]


def common_rate(units: list[SensorInfo], setup: EstimatorSetup, *, estimator: str) -> float:
    """Rate of the inertial units, Hz.

    Raises:
        BadInputError: there is none, or their rates differ.
    """
    where = f"[estimators.{setup.name}] sensors"
    if not units:
        raise BadInputError(f"{where}: {estimator} needs at least one sensor of kind {IMU!r}")
    rates = {info.rate_hz for info in units}
    if len(rates) > 1:
        listed = ", ".join(f"{info.name} {info.rate_hz:g} Hz" for info in units)
        raise BadInputError(f"{where}: the inertial units must share one rate, but they have {listed}")
    return rates.pop()


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialUnit:
    """An inertial unit as a filter reads it."""

    name: str
    forward_m: float
    left_m: float
    _places: Places
    _to_body: FloatArray | None

    @classmethod
    def of(cls, info: SensorInfo, setup: EstimatorSetup) -> InertialUnit:
        """Read the sensor's mount and columns.

        Raises:
            BadInputError: it sits on another body or lacks a column.
        """
        forward, left = lever_arm(info, setup)
        rotation = np.matmul(rotation_from_rpy(*setup.reference.rpy_rad).T, rotation_from_rpy(*info.mount.rpy_rad))
        return cls(
            name=info.name,
            forward_m=forward,
            left_m=left,
            _places=column_places(info, INERTIAL_COLUMNS, setup=setup),
            _to_body=None if np.array_equal(rotation, np.eye(3)) else _twice(rotation),
        )

    def read(self, measurement: Measurement) -> FloatArray:
        """Specific force (m/s^2) and angular rate (rad/s) in axes of the reference frame, shape (R, 6)."""
        readings = measurement.values[:, self._places]
        return readings if self._to_body is None else np.einsum("ij,rj->ri", self._to_body, readings)


def _twice(rotation: FloatArray) -> FloatArray:
    """Rotation (6, 6) of accelerometer and gyroscope alike."""
    return np.asarray(np.kron(np.eye(2), rotation), dtype=np.float64)


def usable(measurement: Measurement, values: FloatArray) -> BoolArray:
    """Members that got the sample and in which all of ``values`` (R, n) are numbers, shape (R,)."""
    finite: BoolArray = np.logical_and.reduce(np.isfinite(values), axis=-1)
    return np.logical_and(finite, measurement.valid)
