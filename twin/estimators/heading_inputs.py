"""What the heading filters listen to, tick by tick: an inertial unit, a magnetometer, wheel encoders.

The filters step with the inertial unit, whatever its rate (:class:`~twin.estimators.ticks.TickClock`); a filter without
one steps with its wheel encoders. What a member of the ensemble did not get, or got as NaN, keeps its last value and is
marked; nothing assumes 50 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.errors import BadInputError
from twin.estimators.roles import IMU, INERTIAL_COLUMNS, Places, column_places, pick_sensors, usable
from twin.estimators.ticks import Tick, TickClock
from twin.geometry import STANDARD_GRAVITY_M_S2, rotation_from_rpy
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

MAGNETOMETER, WHEEL_ENCODERS = "magnetometer", "wheel_encoders"

FIELD_COLUMNS = ("mag_x_ut", "mag_y_ut", "mag_z_ut")
"""Magnetic flux density in mount axes (FLU), microtesla."""
SLOT_COLUMNS = ("left_slots", "right_slots")
"""Slots that have passed since the start, backwards ones negative."""


@dataclass(slots=True)
class HeadingSample:
    """What is known at one tick, in the axes of the reference frame (FLU)."""

    index: int
    dt_s: float
    """Time since the last sample, s; 0 for what came late, to a tick that is over."""
    force: FloatArray
    """(R, 3) specific force, m/s^2."""
    rate: FloatArray
    """(R, 3) angular rate, rad/s."""
    inertial: BoolArray
    """(R,) whether force and rate are new."""
    field: FloatArray
    """(R, 3) magnetic flux density, microtesla."""
    magnetic: BoolArray
    """(R,) whether the field is new."""
    slots: FloatArray
    """(R, 2) slots counted, left and right."""
    counted: BoolArray
    """(R,) whether the slots are new."""


@dataclass(frozen=True, slots=True)
class _Reader:
    places: Places
    to_reference: FloatArray | None


class HeadingInputs:
    """Groups the arrivals of at most one sensor of each kind into :class:`HeadingSample`.

    Raises:
        BadInputError: a sensor of a kind in ``needs`` is missing, there are two of a kind, one is of a kind that is not
            in ``may_use``, or lacks a column.
    """

    def __init__(
        self, setup: EstimatorSetup, *, kind: str, needs: Sequence[str], may_use: Sequence[str], max_age_s: float
    ) -> None:
        picked = pick_sensors(setup, may_use, estimator=kind)
        for sensor_kind, infos in picked.items():
            if len(infos) > 1 or (sensor_kind in needs and not infos):
                allowed = "one" if sensor_kind in needs else "at most one"
                raise BadInputError(
                    f"[estimators.{setup.name}] sensors: {kind} takes {allowed} of kind {sensor_kind!r},"
                    f" not {len(infos)}"
                )
        found = {sensor_kind: infos[0] for sensor_kind, infos in picked.items() if infos}
        self.infos: dict[str, SensorInfo] = found
        """The sensors by kind."""
        self._kinds = {info.name: sensor_kind for sensor_kind, info in found.items()}
        self._readers = {info.name: _reader(info, setup) for info in found.values()}
        leader = found.get(IMU) or found.get(WHEEL_ENCODERS) or next(iter(found.values()))
        self._clock = TickClock(rate_hz=leader.rate_hz, max_age_s=max_age_s, inertial=[leader.name])
        self.step_ns = self._clock.step_ns
        runs = setup.runs
        self._runs = runs
        still = np.concatenate([np.full((runs, 1), STANDARD_GRAVITY_M_S2), np.zeros((runs, 3))], axis=1)
        self._held: dict[str, FloatArray] = {
            IMU: np.concatenate([np.zeros((runs, 2)), still], axis=1),
            MAGNETOMETER: np.zeros((runs, 3)),
            WHEEL_ENCODERS: np.zeros((runs, 2)),
        }

    def add(self, measurement: Measurement) -> HeadingSample | None:
        """Take a measurement; return the sample of the tick that it ends, if it does."""
        tick = self._clock.add(measurement)
        return None if tick is None else self._gather(tick)

    def close(self) -> HeadingSample | None:
        """Return the sample of the tick that is open, if there is one."""
        tick = self._clock.close()
        return None if tick is None else self._gather(tick)

    def _gather(self, tick: Tick) -> HeadingSample:
        new = {kind: np.zeros(self._runs, dtype=np.bool_) for kind in self._held}
        for measurement, fresh in tick.samples:
            kind, reader = self._kinds[measurement.sensor], self._readers[measurement.sensor]
            if kind == IMU and not fresh:
                continue  # a rate that is past cannot be integrated again
            values = _read(measurement, reader)
            there = usable(measurement, values)
            self._held[kind] = np.where(there[:, np.newaxis], values, self._held[kind])
            new[kind] |= there
        inertial = self._held[IMU]
        return HeadingSample(
            index=tick.index,
            dt_s=tick.steps * self.step_ns / NS_PER_S,
            force=inertial[:, :3],
            rate=inertial[:, 3:],
            inertial=new[IMU],
            field=self._held[MAGNETOMETER],
            magnetic=new[MAGNETOMETER],
            slots=self._held[WHEEL_ENCODERS],
            counted=new[WHEEL_ENCODERS],
        )


def _reader(info: SensorInfo, setup: EstimatorSetup) -> _Reader:
    columns = {IMU: INERTIAL_COLUMNS, MAGNETOMETER: FIELD_COLUMNS, WHEEL_ENCODERS: SLOT_COLUMNS}[info.kind]
    places = column_places(info, columns, setup=setup)
    if info.kind == WHEEL_ENCODERS:
        return _Reader(places, None)
    turn = rotation_from_rpy(*setup.reference.rpy_rad).T @ rotation_from_rpy(*info.mount.rpy_rad)
    if np.array_equal(turn, np.eye(3)):
        return _Reader(places, None)
    both: FloatArray = np.asarray(np.kron(np.eye(2), turn), dtype=np.float64)
    return _Reader(places, both if info.kind == IMU else turn)


def _read(measurement: Measurement, reader: _Reader) -> FloatArray:
    values = measurement.values[:, reader.places]
    return values if reader.to_reference is None else np.einsum("ij,rj->ri", reader.to_reference, values)
