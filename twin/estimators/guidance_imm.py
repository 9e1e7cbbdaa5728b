"""Straight or curve, weighed by what the fixes say (kind ``guidance_imm``): an IMM in place of paper 004's switch.

State of either mode: position, velocity and acceleration of the antenna, east and north. Every number of it is a
quantity of the field:

* **straight**: constant velocity, moved by white acceleration of density ``straight_m2_s3``. A driver who holds a line
  corrects by 0.1 m/s^2 for about a second: 2 0.1^2 1 = 0.02 m^2/s^3.
* **curve**: constant acceleration that turns with the velocity, at the rate (v x a) / |v|^2, so that a steady bend has
  no jerk left (in fixed axes it has a^2 / v, 0.8 m/s^3 where 2.5 m/s^2 are driven at 8 m/s). White jerk of density
  ``curve_m2_s5`` is what a hand does that steers by 0.1 m/s^2 for a second, 2 0.1^2 / 1 = 0.02 m^2/s^5, and as much
  again for a bend that is no circle.
* **from the one to the other**: straights last ``straight_s``, curves ``curve_s`` on the average; over dt the
  transition matrix is that of the continuous chain. Who enters a curve has an acceleration of zero, uncertain by
  ``turning_m_s2``, v^2 / r: the straight mode carries it along, without an effect on its own position and velocity.
  So both modes have the same state, and mixing needs no special case.
* **fixes**: what tells a curve from a straight is not the error that fixes have in common for minutes but what is new
  in each, ``noise_m``. Without one it is measured while the vehicle stands: half the mean square of the fixes'
  differences; where it did not stand, ``fallback_m``. Below ``least_m`` it is not believed (an antenna 2.5 m up that
  leans by one degree moves 44 mm).

* **the error that fixes have in common** wanders within ``common_s``, and the track shown with it: the position moves
  by 2 sigma^2 / common_s per second beside what the velocity makes of it. Sigma is what the receiver reports, or
  ``common_m``. Without this a velocity that is believed would hold the track against its fixes.
* **velocity** (``velocity = "receiver"``): speed and course of the receiver, which sees a curve in how fast ranges
  change, and so much sooner than positions tell. It is late by the receiver's own filter: v - lag a in the curve mode.
  A lag that is wrong by a fifth of a second is wrong by half a metre per second in a bend, so its variance grows by
  (``lag_error_s`` a)^2. ``"none"``: positions alone, as paper 004 has it.

The filter follows its fixes, so its own covariance is about the way from their common error. Sigmas of the position
include that error.

Everything is horizontal. Fixes count for when they were valid, however irregular.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import Config, Names, NonNegative, Positive
from twin.errors import BadInputError
from twin.estimators.engines import EngineName
from twin.estimators.guidance_kinematic import INNOVATION, NIS, TURNING, UNKNOWN_SPEED_M_S
from twin.estimators.guidance_kinematic_models import ProcessNoise, on_axes, transition
from twin.estimators.guidance_kinematic_output import SLOW_M_S, AntennaPose
from twin.estimators.guidance_kinematic_receiver import NEVER, Fix, Receiver, ShortTermNoise, StandingStart
from twin.estimators.imm_engine import ModeMotion, Modes, make_imm, predicted
from twin.signals import (
    HEADING,
    NS_PER_S,
    POSITION,
    SPEED,
    BoolArray,
    Estimate,
    EstimatorSetup,
    FloatArray,
    IntArray,
    Measurement,
)

KIND = "guidance_imm"
STRAIGHT, CURVE = 0, 1
"""Modes."""
_STATES = 6
_P, _V, _A = slice(0, 2), slice(2, 4), slice(4, 6)
_PAIR: FloatArray = np.eye(2)
_FASTEST_TURN_RAD_S = 1.0
_USUAL_LAG_S = 0.2
_UNTOLD = 1e8
"""Variance of a velocity that is not told."""
_STANDING_M_S = 0.1
"""1 sigma of the velocity of a vehicle that is seen standing."""


class GuidanceImmConfig(Config):
    """Options of :class:`GuidanceImm`; reasons in the module's docstring."""

    kind: Literal["guidance_imm"]
    sensors: Names
    """The GNSS receiver."""
    rate_hz: Positive = 50.0
    """Output rate."""
    straight_m2_s3: Positive = 0.02
    """Density of the acceleration on straights."""
    curve_m2_s5: Positive = 0.05
    """Density of the jerk in curves."""
    turning_m_s2: Positive = 2.0
    """1 sigma of each component of the acceleration of a vehicle that enters a curve."""
    straight_s: Positive = 20.0
    """How long a straight lasts."""
    curve_s: Positive = 8.0
    """How long a curve lasts."""
    noise_m: Positive | None = None
    """1 sigma of a coordinate, from fix to fix; measured while standing if not given."""
    fallback_m: Positive = 0.3
    """The same of a receiver that was not seen standing: code ranges of centimetres to a metre."""
    least_m: Positive = 0.05
    """The least that is believed of a measured one."""
    velocity: Literal["receiver", "none"] = "receiver"
    """Whether the receiver's speed and course are used."""
    least_m_s: Positive = 0.2
    """The least that is believed of a component of its velocity, 1 sigma."""
    velocity_lag_s: NonNegative | None = None
    """How long ago that velocity was; what the data sheet says if not given, and without one a fifth of a second."""
    lag_error_s: NonNegative = 0.2
    """1 sigma of that; half as much again where nobody says it."""
    common_s: Positive = 150.0
    """1/e time of the error that fixes have in common."""
    common_m: Positive = 1.0
    """1 sigma of it, where the receiver reports none."""
    mean_s: Positive = 10.0
    """How long fixes are averaged for the start."""
    start_s: NonNegative | None = None
    """When the vehicle begins to move; without it, when the receiver's speed says so."""
    engine: Literal["auto", "filterpy", "ensemble"] = "auto"
    """auto: filterpy for a single run."""


def rate_of_turn(x: FloatArray) -> FloatArray:
    """Rate (R,) at which velocity and acceleration of states (R, 6) turn, v x a / |v|^2, rad/s."""
    square = x[:, 2] ** 2 + x[:, 3] ** 2
    rate = (x[:, 2] * x[:, 5] - x[:, 3] * x[:, 4]) / np.maximum(square, SLOW_M_S**2)
    bounded: FloatArray = np.clip(rate, -_FASTEST_TURN_RAD_S, _FASTEST_TURN_RAD_S)
    return bounded


def turning(dt_s: FloatArray, rate: FloatArray) -> FloatArray:
    """Transition (R, 6, 6) of a vehicle whose acceleration turns at ``rate`` (R,): once and twice the integral of a
    rotation. With a rate of zero, eq 13 of paper 004.
    """
    angle = rate * dt_s
    square, cosine, sine = angle**2, np.cos(angle), np.sin(angle)
    small = np.abs(angle) < 1e-2
    safe = np.where(small, 1.0, angle)
    sinc = np.where(small, 1.0 - square / 6.0 * (1.0 - square / 20.0), sine / safe)  # sin z / z
    half = np.where(small, 0.5 - square / 24.0 * (1.0 - square / 30.0), (1.0 - cosine) / safe**2)
    third = np.where(small, angle / 6.0 * (1.0 - square / 20.0), (angle - sine) / safe**2)
    F = np.zeros((len(dt_s), _STATES, _STATES))
    F[:] = np.eye(_STATES)
    F[:, _P, _V] = dt_s[:, np.newaxis, np.newaxis] * _PAIR
    for block, along, across in (
        (_P, dt_s**2 * half, dt_s**2 * third),
        (_V, dt_s * sinc, dt_s * angle * half),
        (_A, cosine, sine),
    ):
        first, second = block.start, block.start + 1
        F[:, first, 4] = F[:, second, 5] = along
        F[:, first, 5], F[:, second, 4] = -across, across
    return F


class StraightOrCurve:
    """The two modes over any interval."""

    def __init__(self, config: GuidanceImmConfig) -> None:
        self._noise = ProcessNoise(velocity=config.straight_m2_s3, acceleration=config.curve_m2_s5, form="continuous")
        self._common_s = config.common_s
        self.turning = config.turning_m_s2**2
        self._leave = np.array([1.0 / config.straight_s, 1.0 / config.curve_s])

    @property
    def shares(self) -> FloatArray:
        """(2,) of the time in either mode."""
        shares: FloatArray = self._leave[::-1] / self._leave.sum()
        return shares

    def motion(self, dt_s: FloatArray, modes: Modes, common: FloatArray) -> ModeMotion:
        """Transition over each member's interval (R,) from where its modes are; nothing changes over none."""
        moves = dt_s > 0.0
        straight = transition(dt_s)
        straight[moves, 2, 2] = 0.0
        straight[:, :2, 2] = 0.0
        F = np.stack([on_axes(straight, 2), turning(dt_s, rate_of_turn(modes.x[:, CURVE]))])
        noise = np.stack([self._noise.of_straight(dt_s), self._noise.of_curve(dt_s)])
        noise[STRAIGHT, moves, 2, 2] = self.turning
        Q = on_axes(noise, 2)
        wander = 2.0 * common * dt_s[:, np.newaxis] / self._common_s
        Q[:, :, range(2), range(2)] += wander
        rate = self._leave.sum()
        gone = -np.expm1(-rate * dt_s)[:, np.newaxis, np.newaxis]
        M = np.eye(2) + gone * (self.shares - np.eye(2))
        return ModeMotion(F, Q, M)


class Sees:
    """What a fix is to either mode: position, and the velocity of ``velocity_lag_s`` ago, v - lag a."""

    def __init__(self, config: GuidanceImmConfig, receiver: Receiver) -> None:
        sheet = receiver.info.datasheet
        self._velocity = config.velocity == "receiver" and receiver.tells_velocity
        self._noise = max(config.least_m_s, sheet.get("speed_noise_m_s", 0.0))
        self._ratio = sheet.get("speed_noise_ratio", 0.0)
        rows = 4 if self._velocity else 2
        self.H: FloatArray = np.stack([np.eye(rows, _STATES)] * 2)
        """(2, m, 6)."""
        if self._velocity:
            lag_s, self._lag_error_s = sheet.get("velocity_lag_s"), config.lag_error_s
            if config.velocity_lag_s is not None:
                lag_s = config.velocity_lag_s
            if lag_s is None:
                lag_s, self._lag_error_s = _USUAL_LAG_S, 1.5 * config.lag_error_s
            self.H[CURVE, 2:, _A] = -lag_s * _PAIR

    def read(self, fix: Fix, variance: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measurement (R, m) and its variances (R, m) at an acceleration (R, 2)."""
        R = np.repeat(variance[:, np.newaxis], self.H.shape[1], axis=1)
        if not self._velocity:
            return fix.position[:, :2], R
        speed, course = fix.of("speed_m_s"), fix.of("course_rad")
        velocity = np.stack([speed * np.cos(course), speed * np.sin(course)], axis=-1)
        told = np.isfinite(velocity.sum(axis=1))[:, np.newaxis]
        late = self._lag_error_s**2 * (acceleration**2).sum(axis=1)
        noise = self._noise**2 + (self._ratio * speed) ** 2 + late
        R[:, 2:] = np.where(told, noise[:, np.newaxis], _UNTOLD)
        return np.column_stack([fix.position[:, :2], np.where(told, velocity, 0.0)]), R


class GuidanceImm:
    """Estimator of :class:`GuidanceImmConfig`.

    Columns: position east and north of the reference frame, heading (held while slow) and speed with sigmas;
    ``nis_position`` (two degrees of freedom) and innovations of the mixture at the newest fix, NaN where there was none
    since the last output; ``mode_turning``, the probability of a curve.

    Raises:
        BadInputError: not exactly one receiver, or the filterpy engine with more than one run.
    """

    columns: tuple[str, ...] = (*POSITION[:2], HEADING, SPEED, NIS, *INNOVATION[:2], TURNING)
    state_columns: tuple[str, ...] = POSITION[:2]

    def __init__(self, config: GuidanceImmConfig, setup: EstimatorSetup) -> None:
        runs = setup.runs
        if config.engine == "filterpy" and runs > 1:
            raise BadInputError(
                f"[estimators.{setup.name}] engine = 'filterpy': steps one run, not {runs}; allowed: auto, ensemble"
            )
        self._config = config
        self._receiver = receiver = Receiver(setup, estimator=KIND)
        self._start = StandingStart(
            runs=runs,
            moving_m_s=receiver.moving_m_s,
            start_s=config.start_s,
            longest_fixes=max(1.0, config.mean_s * receiver.info.rate_hz),
        )
        self._noise = ShortTermNoise(fallback_m=config.fallback_m, least_m=config.least_m, runs=runs)
        self._pose = AntennaPose(receiver.arm, setup.start_e_n_heading[2], runs)
        self._models = StraightOrCurve(config)
        name: EngineName = "filterpy" if runs == 1 else "ensemble"
        if config.engine != "auto":
            name = config.engine
        mu = np.tile(self._models.shares, (runs, 1))
        self._sees = Sees(config, receiver)
        self._engine = make_imm(
            name, self._sees.H, Modes(np.zeros((runs, 2, _STATES)), np.zeros((runs, 2, _STATES, _STATES)), mu)
        )
        self._t_ns: IntArray = np.full(runs, NEVER)
        self._common: FloatArray = np.full((runs, 2), config.common_m**2)
        """(R, 2) variances of the errors that fixes have in common."""
        self._news: FloatArray = np.full((runs, 3), np.nan)

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        if measurement.sensor == self._receiver.name:
            self._fix(self._receiver.read(measurement))

    def _fix(self, fix: Fix) -> None:
        self._noise.take(fix, ~self._start.started)
        given = self._config.noise_m
        variance = self._noise.variance if given is None else np.full(len(fix.new), given**2)
        moving = self._start.take(fix, np.repeat(variance[:, np.newaxis], 3, axis=1))
        self._believe(fix, variance)
        if moving.any():
            self._begin(moving)
        used = fix.new & self._start.started & (fix.t_ns > self._t_ns)
        if not used.any():
            return
        self._engine.predict(
            self._models.motion(np.where(used, fix.t_ns - self._t_ns, 0) / NS_PER_S, self._engine.modes, self._common)
        )
        self._t_ns = np.where(used, fix.t_ns, self._t_ns)
        z, R = self._sees.read(fix, variance, self._engine.modes.mean()[0][:, _A])
        self._tell(fix, R, used)
        self._engine.update(z, R, used)
        x = self._engine.modes.mean()[0]
        self._pose.hear(fix.of(SPEED), used)
        self._pose.keep(self._pose.turn(x[:, _V], x[:, _A], used)[0])

    def _believe(self, fix: Fix, variance: FloatArray) -> None:
        """Take what the receiver says of its error, less what is new in each fix."""
        told = np.stack([fix.of("sigma_e_m"), fix.of("sigma_n_m")], axis=-1) ** 2
        good: BoolArray = np.logical_and(fix.new[:, np.newaxis], np.isfinite(told))
        self._common = np.where(good, np.maximum(told - variance[:, np.newaxis], 0.0), self._common)

    def _begin(self, which: BoolArray) -> None:
        start, modes = self._start, self._engine.modes
        x, P = np.zeros_like(modes.x), np.zeros_like(modes.P)
        x[:, :, _P] = start.mean[:, np.newaxis, :2]
        speed = np.where(start.stood, _STANDING_M_S**2, UNKNOWN_SPEED_M_S**2)
        for axis in range(2):
            P[:, :, axis, axis] = start.covariance[:, axis, np.newaxis]
            P[:, :, _V.start + axis, _V.start + axis] = speed[:, np.newaxis]
            P[:, :, _A.start + axis, _A.start + axis] = self._models.turning
        here = which[:, np.newaxis, np.newaxis]
        self._engine.restore(Modes(np.where(here, x, modes.x), np.where(here[..., np.newaxis], P, modes.P), modes.mu))
        self._t_ns = np.where(which, start.t_ns, self._t_ns)

    def _tell(self, fix: Fix, R: FloatArray, used: BoolArray) -> None:
        """Keep what is not expected of a fix, before it is used."""
        x, P = self._engine.modes.mean()
        y = fix.position[:, :2] - x[:, _P]
        S = P[:, _P, _P] + R[:, :2, np.newaxis] * _PAIR
        S = np.where(used[:, np.newaxis, np.newaxis], S, _PAIR)
        nis = np.einsum("rm,rmk,rk->r", y, np.linalg.inv(S), y)
        self._news = np.where(used[:, np.newaxis], np.column_stack([nis, y]), self._news)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return where the machine is at ``t_ns``; before it moves, the mean of its newest fixes."""
        started = self._start.started
        dt_s = np.where(started, np.maximum(t_ns - self._t_ns, 0), 0) / NS_PER_S
        modes = predicted(self._engine.modes, self._models.motion(dt_s, self._engine.modes, self._common))
        x, P = modes.mean()
        heading, speed = self._pose.turn(x[:, _V], x[:, _A], started)
        antenna = np.zeros((len(x), 3))
        antenna[:, :2] = np.where(started[:, np.newaxis], x[:, _P], self._start.position[:, :2])
        place = self._pose.place(antenna, heading)[:, :2]
        own = np.where(
            started[:, np.newaxis, np.newaxis], P[:, _P, _P], self._start.covariance[:, :2, np.newaxis] * _PAIR
        )
        covariance = own + self._common[:, :, np.newaxis] * _PAIR
        covariance = np.where(np.isfinite(place)[:, :, np.newaxis], covariance, np.nan)
        values = np.column_stack(
            [place, heading, np.where(started, speed, 0.0), self._news, np.where(started, modes.mu[:, CURVE], 0.0)]
        )
        sigmas = np.full(values.shape, np.nan)
        sigmas[:, :2] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        sigmas[:, 2:4] = np.where(started[:, np.newaxis], _turned(x, P, speed), np.nan)
        self._news = np.full_like(self._news, np.nan)
        return Estimate(t_ns=t_ns, values=values, sigmas=sigmas, covariance=covariance)


def _turned(x: FloatArray, P: FloatArray, speed: FloatArray) -> FloatArray:
    """Sigmas (R, 2) of heading and speed."""
    course = np.arctan2(x[:, 3], x[:, 2])
    along = np.stack([np.cos(course), np.sin(course)], axis=-1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    variances = [np.einsum("ri,rij,rj->r", by, P[:, _V, _V], by) for by in (across, along)]
    sigmas: FloatArray = np.sqrt(np.maximum(np.stack(variances, axis=-1), 0.0))
    sigmas[:, 0] = np.minimum(sigmas[:, 0] / np.maximum(np.abs(speed), 1e-3), np.pi)
    return sigmas
