"""Our heading filter for a small robot with a cheap inertial unit (kind ``heading_filter``).

One Kalman filter of the attitude's error (:mod:`twin.estimators.heading_model`), fed by what there is: an inertial unit
alone, with a magnetometer, with wheel encoders, or with both. What it does that the filters of paper 001 do not:

* the gyroscope's **bias is a state** of all three axes, learnt whenever the machine rests
  (:mod:`twin.estimators.heading_rest`), with nothing like a dead band: a slow turn is not lost;
* **gravity** is what the accelerometer shows over the time in which a machine cannot have gained speed: accelerations
  cancel, a tilt does not. At rest it counts at once;
* the **magnetometer** is levelled by the whole attitude, and recognised as disturbed by strength, dip and its rate
  against the gyroscope (:mod:`twin.estimators.magnetic_disturbance`). What is left of the local field's deviation is
  two states, one constant and one that comes and goes. That is what keeps a magnet that is not recognised from
  dragging the heading along: the filter holds a deviation that changes within seconds to be far likelier than a
  gyroscope that is off by degrees a second;
* the **wheels** count as a heading reference that drifts with the way and the turn; what they say against the gyroscope
  beyond that is slip, and their reference begins anew. At a slot of 5.66 deg they cannot show a small turn, but they
  tell that the machine stands;
* its **sigma is honest**: it holds what every part could be off by, and NEES is tested on it.

While the machine rests its heading is held, not integrated: the same noise does not count as rotation and as bias.
Noise is taken from the sensors' data sheets; where one says nothing, from ``noise``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import NonNegative, Positive
from twin.errors import BadInputError
from twin.estimators.engines import EngineName, make_engine
from twin.estimators.field_heading import FieldHeading
from twin.estimators.heading_base import HeadingConfig, tilt_of_force
from twin.estimators.heading_inputs import MAGNETOMETER, WHEEL_ENCODERS, HeadingInputs, HeadingSample
from twin.estimators.heading_model import (
    D0,
    SIZE,
    B,
    BiasSeen,
    D,
    HeadingMotion,
    S,
    T,
    V,
    VelocitySeen,
    rotate,
)
from twin.estimators.heading_noise import HeadingNoiseConfig, Sheet
from twin.estimators.heading_preparation import Preparation, PreparationConfig
from twin.estimators.heading_rest import RestConfig, RestDetector
from twin.estimators.held_attitude import HeldAttitude
from twin.estimators.magnetic_disturbance import DisturbanceConfig
from twin.estimators.roles import IMU
from twin.estimators.wheel_heading import WheelHeading, WheelHeadingConfig
from twin.geometry import STANDARD_GRAVITY_M_S2, wrap_angle
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
)

KIND = "heading_filter"
_RESTING_RAD_RTS = float(np.deg2rad(0.005))
"""Growth of the attitude's uncertainty at rest: sway of the ground, not of the gyroscope."""
_TURN_RAD = float(np.pi)
"""A half turn makes of a cross-axis error, taken for white, the right angle error; less of a turn, more than that.
A scale error that fades over half of this comes to the same over long turns, and cancels over short ones to and fro."""
_RESTING_M_S = 0.01
"""How well a resting machine rests."""
_GAP_RATE_RAD_S, _GAP_ACCEL_M_S2 = 0.5, 1.0
"""How fast the machine may turn and accelerate while the inertial unit is silent, 1 sigma; a choice."""


class HeadingFilterConfig(HeadingConfig):
    """Options of :class:`HeadingFilter`."""

    kind: Literal["heading_filter"]
    heading_reference: Literal["start", "magnetic_north"] = "start"
    """Whether the heading at the start is known (as set out by the owner), or only the magnetometer knows it."""
    start_heading_sigma_rad: Positive = 0.02
    declination_sigma_rad: NonNegative = 0.05
    """Constant part of the deviation from ``magnetic_north_rad``: declination not looked up, magnetometer askew."""
    deviation_sigma_rad: Positive = 0.03
    """The part that comes and goes."""
    deviation_s: Positive = 60.0
    """How long it lasts."""
    deviation_turn_rad: Positive = 1.0
    """Over what turn it lasts: the machine's own iron pushes the field another way after a turn of a radian or so."""
    engine: Literal["auto", "filterpy", "ensemble"] = "auto"
    """Kalman engine; auto: filterpy for a single run."""
    preparation: PreparationConfig = PreparationConfig(standstill_s=0.0, accelerometer_offset=False, filtered=False)
    """Calibration before the filter starts; it needs none, but hard iron known or turned out helps."""
    noise: HeadingNoiseConfig = HeadingNoiseConfig()
    rest: RestConfig = RestConfig()
    disturbance: DisturbanceConfig = DisturbanceConfig()
    wheels: WheelHeadingConfig = WheelHeadingConfig()


class HeadingFilter:
    """Estimator of :class:`HeadingFilterConfig`.

    Columns: heading, roll, pitch, yaw rate, gyroscope bias about z, the states of rest, magnetometer
    (:mod:`twin.estimators.magnetic_disturbance`) and wheels, and with encoders the position counted by the wheels.

    Raises:
        BadInputError: no inertial unit, two sensors of a kind or one of another, or the filterpy engine with more than
            one run.
    """

    state_columns: tuple[str, ...] = (HEADING,)

    def __init__(self, config: HeadingFilterConfig, setup: EstimatorSetup) -> None:
        if config.engine == "filterpy" and setup.runs > 1:
            raise BadInputError(
                f"[estimators.{setup.name}] engine = 'filterpy': steps one run, not {setup.runs};"
                " allowed: auto, ensemble"
            )
        self._inputs = HeadingInputs(
            setup,
            kind=KIND,
            needs=(IMU,),
            may_use=(IMU, MAGNETOMETER, WHEEL_ENCODERS),
            max_age_s=config.max_age_s,
        )
        infos, runs = self._inputs.infos, setup.runs
        self._config, self._runs = config, runs
        self._step_s = self._inputs.step_ns / NS_PER_S
        self._sheet = Sheet.of(infos[IMU], infos.get(MAGNETOMETER), config.noise)
        self._preparation = Preparation(config.preparation, step_s=self._step_s, runs=runs)
        self._motion = HeadingMotion(bias_walk_rad_s_rts=self._sheet.bias_walk, runs=runs)
        self._motion.noise.scale_variance[:] = self._sheet.scale**2
        self._velocity = VelocitySeen()
        self._resting_bias = BiasSeen(self._sheet.gyro**2)
        self._rest = RestDetector(
            config.rest,
            accel_noise_m_s2=self._sheet.accel,
            gyro_noise_rad_s=self._sheet.gyro,
            gyro_bias_rad_s=self._sheet.bias,
            runs=runs,
        )
        self._hidden_tilt_rad = self._sheet.accel_bias / STANDARD_GRAVITY_M_S2
        if config.preparation.standstill_s > 0.0 and config.preparation.accelerometer_offset:
            self._hidden_tilt_rad = config.noise.level_rad
        self._field = FieldHeading(
            config.disturbance,
            north_rad=config.magnetic_north_rad,
            noise_ut=self._sheet.field,
            deviation_rad=config.deviation_sigma_rad,
            hidden_tilt_rad=self._hidden_tilt_rad,
            runs=runs,
        )
        name: EngineName = "filterpy" if runs == 1 else "ensemble"
        if config.engine != "auto":
            name = config.engine
        self.engine = make_engine(name, np.zeros((runs, SIZE)), self._start_covariance())
        self._wheels = None
        if WHEEL_ENCODERS in infos:
            self._wheels = WheelHeading(config.wheels, infos[WHEEL_ENCODERS], setup)
        start = float(setup.start_e_n_heading[2])
        self.attitude = HeldAttitude(start, runs=runs)
        """What is held above the engine, which keeps its error."""
        self._started: BoolArray = np.zeros(runs, dtype=np.bool_)
        self._resting: BoolArray = np.zeros(runs, dtype=np.bool_)
        self._rate: FloatArray = np.zeros((runs, 3))
        self._now: int | None = None
        diagnostics = ("gyro_bias_z_rad_s", "resting", "magnetic_state", "slipping")
        positions = POSITION[:2] if self._wheels is not None else ()
        self.columns: tuple[str, ...] = (HEADING, "roll_rad", "pitch_rad", YAW_RATE, *diagnostics, *positions)

    def _start_covariance(self) -> FloatArray:
        config, sigma = self._config, np.zeros(SIZE)
        sigma[T : T + 2] = 0.1
        sigma[T + 2] = config.start_heading_sigma_rad if config.heading_reference == "start" else np.pi
        standing = config.preparation.standstill_s > 0.0 and config.preparation.gyro_offset
        sigma[B : B + 3] = self._sheet.gyro if standing else self._sheet.bias
        sigma[V : V + 2] = config.noise.speed_m_s
        sigma[D0], sigma[D] = config.declination_sigma_rad, config.deviation_sigma_rad
        sigma[S : S + 3] = self._sheet.scale
        return np.tile(np.diag(sigma**2), (self._runs, 1, 1))

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        sample = self._inputs.add(measurement)
        if sample is not None:
            self._take(sample)

    def _take(self, sample: HeadingSample) -> None:
        prepared = self._preparation.take(sample)
        if prepared is None:
            return
        self._begin(prepared)
        before = self.attitude.heading
        if self._wheels is not None:
            self._wheels.count(prepared.slots, prepared.counted, prepared.dt_s)
        if prepared.dt_s > 0.0:
            self._predict(prepared)
            self._hear_velocity(prepared)
        if prepared.magnetic.any():
            self._hear_field(prepared)
        if self._wheels is not None:
            self._wheels.hear(self.engine, prepared.counted, self.attitude.heading)
        self._settle()
        if self._wheels is not None:
            self._wheels.travel(0.5 * (before + self.attitude.heading))
        self._now = prepared.index

    def _begin(self, sample: HeadingSample) -> None:
        """Level the members that hear the inertial unit for the first time; count in what was turned before."""
        first = sample.inertial & ~self._started
        if not first.any():
            return
        roll, pitch = tilt_of_force(sample.force)
        turned = self.attitude.heading + self._preparation.turned
        self.attitude.level(first, roll=roll, pitch=pitch, heading=turned)
        self._started = self._started | first
        told = first & ~np.isnan(self._preparation.scale_sigma)
        if told.any():
            variance = self._motion.noise.scale_variance
            variance[told, 2] = self._preparation.scale_sigma[told] ** 2
            P = self.engine.P.copy()
            P[told, S + 2, S + 2] = variance[told, 2]
            self.engine.restore(self.engine.x, P)

    def _predict(self, sample: HeadingSample) -> None:
        """Find out who rests, follow the gyroscope, and gather what it may be off by."""
        dt_s = sample.dt_s
        self._resting = self._find_rest(sample)
        x = self.engine.x
        turning = ~self._resting & self._started
        rate = (1.0 - x[:, S : S + 3]) * (sample.rate - x[:, B : B + 3])
        self._rate = np.where(turning[:, np.newaxis], rate, 0.0)
        self._motion.attitude, self._motion.rate = self.attitude.turn(self._rate, dt_s), self._rate
        self._noise_of(sample, turning)
        force = rotate(self._motion.attitude, sample.force)
        force = np.where(self._started[:, np.newaxis], force, np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2]))
        self.engine.predict(self._motion, force, dt_s)
        resting = self._resting & sample.inertial
        if resting.any():
            self.engine.update(self._resting_bias, sample.rate, resting)

    def _find_rest(self, sample: HeadingSample) -> BoolArray:
        """Who rests, (R,). Where the bias has changed unseen, what is known of it and of the heading is opened."""
        x, P = self.engine.x, self.engine.P
        across = np.maximum(np.hypot(sample.field[:, 0], sample.field[:, 1]), 1e-9)
        found = self._rest.step(
            np.concatenate([sample.force, sample.rate], axis=1),
            sample.inertial,
            bias=x[:, B : B + 3],
            bias_sigma=np.sqrt(np.diagonal(P, axis1=1, axis2=2)[:, B : B + 3]),
            rolled=self._wheels.rolled if self._wheels is not None else np.zeros(self._runs, dtype=np.bool_),
            dt_s=sample.dt_s,
            direction=(np.arctan2(sample.field[:, 1], sample.field[:, 0]), sample.magnetic, self._sheet.field / across),
        )
        surprise = found.surprise_rad_s
        if surprise.any():
            # A bias off by so much for so long has turned the heading along: one cause, one direction of the state.
            cause = np.zeros((self._runs, SIZE))
            cause[:, B + 2] = surprise
            cause[:, T : T + 3] = -self.attitude.matrix[:, :, 2] * (surprise * found.quiet_s)[:, np.newaxis]
            self.engine.restore(x, P + cause[:, :, np.newaxis] * cause[:, np.newaxis, :])
        return found.resting

    def _noise_of(self, sample: HeadingSample, turning: BoolArray) -> None:
        """What this step adds: noise and cross-axis errors of the sensors, and what was not heard."""
        config, sheet, noise, dt_s = self._config, self._sheet, self._motion.noise, sample.dt_s
        silent_s = np.where(sample.inertial, dt_s - self._step_s, dt_s)
        turned = np.sqrt(np.einsum("ri,ri->r", self._rate, self._rate)) * dt_s
        white = (sheet.gyro * self._step_s) ** 2 + (_GAP_RATE_RAD_S * silent_s) ** 2
        turning_variance = white[:, np.newaxis] + self._leaked(dt_s)
        noise.turn_variance = np.where(turning[:, np.newaxis], turning_variance, _RESTING_RAD_RTS**2 * dt_s)
        noise.speed_variance = (sheet.accel * self._step_s) ** 2 + (_GAP_ACCEL_M_S2 * silent_s) ** 2
        noise.deviation_variance = self._field.deviation_variance
        noise.scale_kept = np.exp(-turned / (0.5 * _TURN_RAD))
        noise.deviation_kept = np.exp(-dt_s / config.deviation_s - turned / config.deviation_turn_rad)
        if self._wheels is not None:
            noise.slip_variance = self._wheels.take_slip_variance()

    def _leaked(self, dt_s: float) -> FloatArray:
        """Variance (R, 3), world axes, of what each gyroscope axis reads of the rates about the two others."""
        square = self._rate**2
        across = np.sqrt(square.sum(axis=1, keepdims=True) - square)
        config = self._config.noise
        lasting = np.maximum(across - config.sway_rad_s, 0.0) * dt_s * _TURN_RAD
        return rotate(self._motion.attitude**2, config.gyro_cross_axis_ratio**2 * lasting)

    def _hear_velocity(self, sample: HeadingSample) -> None:
        """The machine stays about where it is; at rest, just where it is."""
        noise = self._config.noise
        lasting = max(1.0, 2.0 * noise.speed_s / sample.dt_s)
        variance = np.where(self._resting, _RESTING_M_S**2, noise.speed_m_s**2 * lasting)
        self.engine.update(
            self._velocity, np.zeros((self._runs, 2)), self._started, np.repeat(variance[:, np.newaxis], 2, axis=1)
        )

    def _hear_field(self, sample: HeadingSample) -> None:
        self._field.hear(
            self.engine,
            sample.field,
            self.attitude.matrix,
            known=self._started & sample.magnetic,
            turning_rad_s=np.sqrt(np.einsum("ri,ri->r", self._rate, self._rate)),
            dt_s=max(sample.dt_s, self._step_s),
        )

    def _settle(self) -> None:
        """Put what the updates found of the attitude into what is held."""
        x = self.engine.x
        self.attitude.correct(x[:, T : T + 3])
        rest = x.copy()
        rest[:, T : T + 3] = 0.0
        self.engine.restore(rest, self.engine.P)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return the estimate at ``t_ns``; between ticks the heading goes on at the last rate."""
        sample = self._inputs.close()
        if sample is not None:
            self._take(sample)
        P = self.engine.P
        roll, pitch = self.attitude.tilt()
        yaw_rate = rotate(self.attitude.matrix, self._rate)[:, 2]
        ahead_s = 0.0 if self._now is None else max(0.0, t_ns / NS_PER_S - self._now * self._step_s)
        heading = wrap_angle(self.attitude.heading + ahead_s * yaw_rate)
        parts = [heading, roll, pitch, yaw_rate, self.engine.x[:, B + 2], self._resting, self._field.state]
        slipping = np.zeros(self._runs) if self._wheels is None else self._wheels.slipping
        positions = [] if self._wheels is None else [self._wheels.east_m, self._wheels.north_m]
        values = np.column_stack([*parts, slipping, *positions]).astype(np.float64)
        sigmas = np.full(values.shape, np.nan)
        variance = P[:, T + 2, T + 2] + ahead_s**2 * P[:, B + 2, B + 2]
        sigmas[:, 0] = np.minimum(np.sqrt(variance), np.pi)
        sigmas[:, 1:3] = np.sqrt(self._tilt_variances(P))
        sigmas[:, 4] = np.sqrt(P[:, B + 2, B + 2])
        return Estimate(t_ns=t_ns, values=values, sigmas=sigmas, covariance=variance[:, np.newaxis, np.newaxis])

    def _tilt_variances(self, P: FloatArray) -> FloatArray:
        """Variances (R, 2) of roll and pitch: theta seen along and across the heading, and what the accelerometer's own
        offset, which no one tells, may hide."""
        sine, cosine = np.sin(self.attitude.heading), np.cos(self.attitude.heading)
        first, second, both = P[:, T, T], P[:, T + 1, T + 1], P[:, T, T + 1]
        roll = cosine**2 * first + sine**2 * second + 2.0 * sine * cosine * both
        pitch = sine**2 * first + cosine**2 * second - 2.0 * sine * cosine * both
        return np.stack([roll, pitch], axis=-1) + self._hidden_tilt_rad**2
