"""Heading and position by counting the slots of two wheel encoders (kind ``wheel_odometry``): paper 001, eqs 1 to 7.

A wheel of radius r with an encoder of n slots rolls 2 pi r / n per slot (eq 1); the difference of the two wheels over
the track L is the heading turned (eq 2), their mean the way made (eq 3). The paper's robot, r = 0.033 m, n = 20 and
L = 0.105 m, turns by 2 pi 0.033 / 20 / 0.105 = 0.0987 rad = 5.66 deg per slot: that is its resolution.

**Eqs 4 to 7 as published** turn the way of a step by V_th dT, with V_th = V_r - V_l: a length taken for an angle; the
rate is V_th / L, and the chord of an arc points along half the angle turned. ``variant = "published"`` keeps the slip
(at 0.5 m/s and 50 Hz it is worth little: a turn of 1 rad/s moves V_th dT by 0.0021 rad where half the angle turned is
0.01 rad); ``"corrected"`` takes the chord of the arc. The paper's x and y are to the left of and along the heading at
the start.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import Positive
from twin.estimators.coordinated_turn import sinc_and_derivative
from twin.estimators.heading_base import HeadingConfig
from twin.estimators.heading_inputs import WHEEL_ENCODERS, HeadingInputs, HeadingSample
from twin.geometry import turned, wrap_angle
from twin.signals import (
    HEADING,
    NS_PER_S,
    POSITION,
    YAW_RATE,
    BoolArray,
    Estimate,
    EstimatorSetup,
    FloatArray,
    Measurement,
    SensorInfo,
)

KIND = "wheel_odometry"
WHEEL_RADIUS_M, TRACK_M, SLOTS_PER_TURN = 0.033, 0.105, 20.0
"""Of the robot of paper 001."""


class Odometer:
    """Counts slots into heading turned and way made (eqs 1 to 3), for R runs."""

    def __init__(self, info: SensorInfo, *, wheel_radius_m: float, track_m: float, runs: int) -> None:
        slots = info.datasheet.get("slots_per_turn", SLOTS_PER_TURN)
        self.slot_m = 2.0 * np.pi * wheel_radius_m / slots
        """Way of a wheel per slot."""
        self.slot_rad = self.slot_m / track_m
        """Heading per slot of one wheel."""
        self._last = np.zeros((runs, 2))
        self._seen: BoolArray = np.zeros(runs, dtype=np.bool_)
        self.since: FloatArray = np.zeros((runs, 2))
        """(R, 2) slots that passed in the last step."""
        self.yaw: FloatArray = np.zeros(runs)
        """(R,) heading turned since the first count, not wrapped, rad."""

    def step(self, slots: FloatArray, counted: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Take counts (R, 2), new where ``counted`` (R,); return heading turned (R,), rad, and way made (R,), m."""
        since = np.where((counted & self._seen)[:, np.newaxis], slots - self._last, 0.0)
        self.since = since
        self._last = np.where(counted[:, np.newaxis], slots, self._last)
        self._seen = self._seen | counted
        turned = self.slot_rad * (since[:, 1] - since[:, 0])
        self.yaw = self.yaw + turned
        return turned, 0.5 * self.slot_m * (since[:, 0] + since[:, 1])


class WheelOdometryConfig(HeadingConfig):
    """Options of :class:`WheelOdometry`."""

    kind: Literal["wheel_odometry"]
    wheel_radius_m: Positive = WHEEL_RADIUS_M
    track_m: Positive = TRACK_M
    variant: Literal["published", "corrected"] = "published"
    """Eqs 4 and 5 as printed, or the chord of the arc."""


class WheelOdometry:
    """Estimator of :class:`WheelOdometryConfig`; columns: heading, yaw rate, position east and north.

    Raises:
        BadInputError: not exactly one sensor of kind ``wheel_encoders``.
    """

    columns: tuple[str, ...] = (HEADING, YAW_RATE, *POSITION[:2])
    state_columns: tuple[str, ...] = ()

    def __init__(self, config: WheelOdometryConfig, setup: EstimatorSetup) -> None:
        self._inputs = HeadingInputs(
            setup, kind=KIND, needs=(WHEEL_ENCODERS,), may_use=(WHEEL_ENCODERS,), max_age_s=config.max_age_s
        )
        info = self._inputs.infos[WHEEL_ENCODERS]
        self._odometer = Odometer(info, wheel_radius_m=config.wheel_radius_m, track_m=config.track_m, runs=setup.runs)
        self._track_m = config.track_m
        self._published = config.variant == "published"
        self._start = setup.start_e_n_heading
        self._rate = np.zeros(setup.runs)
        self._along = np.zeros(setup.runs)
        self._left = np.zeros(setup.runs)

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        sample = self._inputs.add(measurement)
        if sample is not None:
            self._take(sample)

    def estimate(self, t_ns: int) -> Estimate:
        """Return heading and position at the last count."""
        sample = self._inputs.close()
        if sample is not None:
            self._take(sample)
        east, north, heading = self._start
        moved_east, moved_north = turned(self._along, self._left, heading)
        values = np.stack(
            [
                wrap_angle(heading + self._odometer.yaw),
                self._rate,
                east + moved_east,
                north + moved_north,
            ],
            axis=-1,
        )
        return Estimate(t_ns=t_ns, values=values, sigmas=np.full(values.shape, np.nan))

    def _take(self, sample: HeadingSample) -> None:
        before = self._odometer.yaw
        turn, way = self._odometer.step(sample.slots, sample.counted)
        dt_s = max(sample.dt_s, self._inputs.step_ns / NS_PER_S)
        self._rate = np.where(sample.counted, turn / dt_s, self._rate)
        if self._published:
            direction = before + self._track_m * turn  # eqs 4 and 5: V_th dT
        else:
            direction = before + 0.5 * turn
            way = way * sinc_and_derivative(0.5 * turn)[0]
        self._along = self._along + np.cos(direction) * way
        self._left = self._left + np.sin(direction) * way
