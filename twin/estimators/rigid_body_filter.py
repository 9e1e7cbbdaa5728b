"""One coordinated-turn filter on a bar of inertial units: the core of both architectures of paper 000.

The filter's origin is a point of the row line, ``origin_left_m`` to the left of the reference frame: the machine's
reference itself for the central filter, a row unit for a distributed one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.estimators.aiding import Aid
from twin.estimators.calibration import AXES, StandstillCalibration, mean_of_units, specific_force_norm
from twin.estimators.coordinated_turn import OMEGA, CoordinatedTurn, ForwardSpeed, S, YawRate
from twin.estimators.engines import Engine
from twin.estimators.roles import InertialUnit
from twin.estimators.standstill import StandstillConfig, StandstillDetector
from twin.estimators.ticks import Tick
from twin.signals import NS_PER_S, BoolArray, FloatArray

GYRO = "gyro"
"""What the innovations of the gyroscopes are called."""

_ACCEL_X, _GYRO_Z = 0, 5
_SPEED_MEMORY_S = 1.0
"""How long the standstill guard remembers a speed sensor's reading."""


@dataclass(frozen=True, slots=True)
class _Inertial:
    """What k samples of inertial units say in one tick."""

    places: list[int]
    """(k,) places of the units."""
    readings: FloatArray
    """(k, R, 6)."""
    present: BoolArray | None
    """(k, R) where the whole sample can be used; None where all can, in every member."""
    fresh: list[bool]
    """(k,) whether it belongs to this very tick."""


class RigidBodyFilter:
    """Prediction by the units' mean acceleration, updates by gyroscopes and aids, standstill (R runs).

    The gyroscopes of one tick all see omega, with one variance and independent errors: their updates, one after
    the other, come to one update by their mean with the variance of a mean, and that is what is done.
    """

    def __init__(
        self,
        *,
        engine: Engine,
        motion: CoordinatedTurn,
        origin_left_m: float,
        units: Sequence[InertialUnit],
        aids: Mapping[str, Sequence[Aid]],
        gyro_variance: float,
        accelerometer_variance: float,
        standstill: StandstillConfig,
        step_ns: int,
    ) -> None:
        self.engine = engine
        self.motion = motion
        self.origin_left_m = origin_left_m
        runs = len(engine.x)
        self._units = {unit.name: (place, unit) for place, unit in enumerate(units)}
        self._forward = np.array([[unit.forward_m] for unit in units])
        self._aids = aids
        self._yaw_rate = YawRate(gyro_variance)
        self._everyone = np.ones(runs, dtype=np.bool_)
        self.innovations = (GYRO, *(aid.name for each in aids.values() for aid in each))
        """What is updated with, in the order of :meth:`take_nis`."""
        self._nis_places = {name: place for place, name in enumerate(self.innovations)}
        self._nis = np.full((len(self.innovations), runs), np.nan)
        self._accelerometer_variance = accelerometer_variance
        self._standstill = standstill
        self._step_s = step_ns / NS_PER_S
        self._calibrating = StandstillCalibration(units=len(units), runs=runs)
        self._all_places = list(range(len(units)))
        self._bias: FloatArray = np.zeros((len(units), runs, AXES))
        self._detector: StandstillDetector | None = None
        self._zero_speed = ForwardSpeed(0.0)
        self._zero = np.zeros((runs, 1))
        self._sensed_speed: dict[str, tuple[int, FloatArray]] = {}
        self.standing: BoolArray = np.ones(runs, dtype=bool)
        """(R,) members in which the machine was taken to stand at the last tick."""

    def calibrate(self, tick: Tick) -> None:
        """Learn from a tick at standstill; the state stays as it is."""
        inertial = self._inertial(tick)
        if inertial is not None:
            self._calibrating.add(inertial.places, inertial.readings, inertial.present)

    def finish_calibration(self) -> None:
        """Take over what was learnt: once, before the first :meth:`step`."""
        result = self._calibrating.finish(accelerometer_variance=self._accelerometer_variance)
        self._bias = result.mean
        if self._standstill.enabled:
            self._detector = StandstillDetector(self._standstill, result, step_s=self._step_s)
        self.standing = np.zeros_like(self.standing)

    def step(self, tick: Tick) -> None:
        """Predict to the tick, update with its gyroscopes, then its aids in order of arrival, then see if it stands."""
        inertial = self._inertial(tick)
        if tick.steps:
            self.engine.predict(self.motion, self._acceleration(inertial), tick.steps * self._step_s)
        if inertial is not None:
            self._update_yaw_rate(inertial)
        for measurement, _ in tick.samples:
            for aid in self._aids.get(measurement.sensor, ()):
                reading = aid.read(measurement)
                nis = self.engine.update(aid.observation, reading.values, reading.mask, reading.variances)
                self._note(aid.name, nis, reading.mask)
                if aid.is_speed and self._standstill.guard_by_sensors:
                    self._remember_speed(aid.name, measurement.t_available_ns, reading.values[:, 0], reading.mask)
        if tick.steps and self._detector is not None:
            self._see_if_standing(tick, self._detector, inertial)

    def take_nis(self) -> FloatArray:
        """Normalised innovation squared of the last update of each kind since the last call, (k, R); NaN for none."""
        nis, self._nis = self._nis, np.full(self._nis.shape, np.nan)
        return nis

    def _note(self, name: str, nis: FloatArray, mask: BoolArray) -> None:
        np.copyto(self._nis[self._nis_places[name]], nis, where=mask)

    def _inertial(self, tick: Tick) -> _Inertial | None:
        """What the units say in this tick, or None where none answered."""
        places: list[int] = []
        readings: list[FloatArray] = []
        valid: list[BoolArray] = []
        fresh: list[bool] = []
        for measurement, is_fresh in tick.samples:
            entry = self._units.get(measurement.sensor)
            if entry is not None:
                places.append(entry[0])
                readings.append(entry[1].read(measurement))
                valid.append(measurement.valid)
                fresh.append(is_fresh)
        if not places:
            return None
        stacked, present = np.array(readings), np.array(valid)
        finite = np.isfinite(stacked)
        if not finite.all():
            present &= np.logical_and.reduce(finite, axis=-1)
        return _Inertial(places, stacked, None if present.all() else present, fresh)

    def _of(self, per_unit: FloatArray, places: list[int]) -> FloatArray:
        """Rows of ``per_unit`` (u, ...) that belong to ``places``: in the ordinary case all of them, in order."""
        return per_unit if places == self._all_places else per_unit[places]

    def _acceleration(self, inertial: _Inertial | None) -> FloatArray:
        """Mean longitudinal acceleration of the units at the origin, less their calibrated means, shape (R,).

        By eq 2.8 a unit ``forward_m`` before the origin reads omega^2 forward_m less than the origin. Only samples of
        this very tick count; where there is none the acceleration is taken as 0 (eq 2.15).
        """
        if inertial is None:
            return self._zero[:, 0]
        places, present = inertial.places, inertial.present
        omega = self.engine.x[:, OMEGA]
        forward = self._of(self._forward, places) * (omega * omega)
        at_origin = inertial.readings[..., _ACCEL_X] - self._of(self._bias, places)[..., _ACCEL_X] + forward
        if not all(inertial.fresh):
            fresh = np.array(inertial.fresh)[:, np.newaxis]
            present = np.broadcast_to(fresh, at_origin.shape) if present is None else present & fresh
        return mean_of_units(at_origin, present)[0]

    def _update_yaw_rate(self, inertial: _Inertial) -> None:
        rates = inertial.readings[..., _GYRO_Z] - self._of(self._bias, inertial.places)[..., _GYRO_Z]
        mean, count = mean_of_units(rates, inertial.present)
        mask, variance = self._everyone, self._yaw_rate.R / len(rates)
        if inertial.present is not None:
            mask = count > 0.0
            variance = self._yaw_rate.R / np.maximum(count, 1.0)[:, np.newaxis]
        nis = self.engine.update(self._yaw_rate, mean[:, np.newaxis], mask, variance)
        self._note(GYRO, nis, mask)

    def _see_if_standing(self, tick: Tick, detector: StandstillDetector, inertial: _Inertial | None) -> None:
        if inertial is not None:
            detector.update(inertial.places, specific_force_norm(inertial.readings), inertial.present)
        self.standing = detector.standing() & self._slow(tick)
        if self.standing.any():
            self.engine.update(self._zero_speed, self._zero, self.standing)

    def _remember_speed(self, name: str, arrived_ns: int, speed: FloatArray, mask: BoolArray) -> None:
        known = self._sensed_speed.get(name)
        before = np.zeros_like(speed) if known is None else known[1]
        self._sensed_speed[name] = (arrived_ns, np.where(mask, np.abs(speed), before))

    def _slow(self, tick: Tick) -> BoolArray:
        """Where the guard of section 2.7 lets the standstill detector speak, shape (R,)."""
        guard = self._standstill.guard_m_s
        slow: BoolArray = np.abs(self.engine.x[:, S]) <= guard
        if self._standstill.guard_by_sensors:
            oldest_ns = round((tick.index * self._step_s - _SPEED_MEMORY_S) * NS_PER_S)
            for t_ns, speed in self._sensed_speed.values():
                if t_ns >= oldest_ns:
                    slow = slow & (speed <= guard)
        return slow
