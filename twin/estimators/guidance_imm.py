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

What positions alone cannot do: where fixes err by 0.3 m five times a second, a second goes by before 2.5 m/s^2 show,
and until then the narrow straight mode is worse than a filter that was wide all along. On straights, in curves and at
their ends ``"none"`` keeps up with the better of paper 004's two models; at their beginnings it takes the velocity.
With it, the mixture is as good as the better of the two or better everywhere, and still so where hand, memory of the
common error or lag are half or twice what the options say.

* **a receiver that smooths its positions** by a filter of its own, whose lag its data sheet tells, shows curves too
  wide. What the modes say of position is then about what the receiver shows, and the track is set off by what a filter
  with that lag trails by under the acceleration of the curve mode (:mod:`twin.estimators.guidance_imm_trail`). The
  curve mode cannot have the lag in its measurement: nothing trails where a curve begins. A lag that nobody tells stays
  in the track. That the figure may be wrong is in sigma, a quarter of what is set off.

The filter follows its fixes, so its own covariance is about the way from their common error. Sigmas of the position
include that error.

Everything is horizontal. Fixes count for when they were valid, however irregular.
"""

from __future__ import annotations

import numpy as np

from twin.estimators.engines import compiled_unless_told
from twin.estimators.guidance_imm_models import (
    A_,
    CURVE,
    P_,
    PAIR,
    STATES,
    V_,
    GuidanceImmConfig,
    Sees,
    StraightOrCurve,
)
from twin.estimators.guidance_imm_trail import Trail
from twin.estimators.guidance_kinematic import INNOVATION, NIS, TURNING, UNKNOWN_SPEED_M_S
from twin.estimators.guidance_kinematic_kernels import velocity_sigmas
from twin.estimators.guidance_kinematic_output import AntennaPose
from twin.estimators.guidance_kinematic_receiver import NEVER, Fix, Receiver, ShortTermNoise, StandingStart
from twin.estimators.imm_engine import Modes, make_imm, predicted
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

__all__ = ["GuidanceImm", "GuidanceImmConfig"]

KIND = "guidance_imm"
_TRAIL_ERROR_RATIO = 0.25
"""So much of what a receiver is thought to trail by may be wrong, 1 sigma; a choice."""
_STANDING_M_S = 0.1
"""1 sigma of the velocity of a vehicle that is seen standing."""


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
        self._config = config
        self._receiver = receiver = Receiver(setup, estimator=KIND)
        self._start = StandingStart(
            runs=runs,
            moving_m_s=receiver.moving_m_s,
            start_s=config.start_s,
            longest_fixes=max(1.0, config.mean_s * receiver.info.rate_hz),
        )
        self._noise = ShortTermNoise(fallback_m=config.fallback_m, least_m=config.least_m, runs=runs)
        self._pose = AntennaPose(receiver.arm, setup.start_e_n_heading[2], runs, slow_m_s=config.course_from_m_s)
        self._models = StraightOrCurve(config)
        name = compiled_unless_told(config.engine, estimator=setup.name, runs=runs)
        mu = np.tile(self._models.shares, (runs, 1))
        self._sees = Sees(config, receiver)
        self._engine = make_imm(
            name, self._sees.H, Modes(np.zeros((runs, 2, STATES)), np.zeros((runs, 2, STATES, STATES)), mu)
        )
        self._t_ns: IntArray = np.full(runs, NEVER)
        self._common: FloatArray = np.full((runs, 2), config.common_m**2)
        """(R, 2) variances of the errors that fixes have in common."""
        self._news: FloatArray = np.full((runs, 3), np.nan)
        self._trail = Trail(receiver.info.datasheet.get("filter_lag_s2", 0.0), runs)

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
        dt_s = np.where(used, fix.t_ns - self._t_ns, 0) / NS_PER_S
        self._engine.predict(self._models.motion(dt_s, self._engine.modes, self._common))
        self._t_ns = np.where(used, fix.t_ns, self._t_ns)
        z, R = self._sees.read(fix, variance, self._engine.modes.mean()[0][:, A_])
        self._tell(fix, R, used)
        self._engine.update(z, R, used)
        modes = self._engine.modes
        self._trail.step(modes.mu[:, CURVE, np.newaxis] * modes.x[:, CURVE, A_], dt_s)
        x = modes.mean()[0]
        self._pose.hear(fix.of(SPEED), used)
        self._pose.keep(self._pose.turn(x[:, V_], x[:, A_], used)[0])

    def _believe(self, fix: Fix, variance: FloatArray) -> None:
        """Take what the receiver says of its error, less what is new in each fix."""
        told = np.stack([fix.of("sigma_e_m"), fix.of("sigma_n_m")], axis=-1) ** 2
        good: BoolArray = np.logical_and(fix.new[:, np.newaxis], np.isfinite(told))
        self._common = np.where(good, np.maximum(told - variance[:, np.newaxis], 0.0), self._common)

    def _begin(self, which: BoolArray) -> None:
        start, modes = self._start, self._engine.modes
        x, P = np.zeros_like(modes.x), np.zeros_like(modes.P)
        x[:, :, P_] = start.mean[:, np.newaxis, :2]
        speed = np.where(start.stood, _STANDING_M_S**2, UNKNOWN_SPEED_M_S**2)
        for axis in range(2):
            P[:, :, axis, axis] = start.covariance[:, axis, np.newaxis]
            P[:, :, V_.start + axis, V_.start + axis] = speed[:, np.newaxis]
            P[:, :, A_.start + axis, A_.start + axis] = self._models.turning
        here = which[:, np.newaxis, np.newaxis]
        self._engine.restore(Modes(np.where(here, x, modes.x), np.where(here[..., np.newaxis], P, modes.P), modes.mu))
        self._t_ns = np.where(which, start.t_ns, self._t_ns)

    def _tell(self, fix: Fix, R: FloatArray, used: BoolArray) -> None:
        """Keep what is not expected of a fix, before it is used."""
        x, P = self._engine.modes.mean()
        y = fix.position[:, :2] - x[:, P_]
        S = P[:, P_, P_] + R[:, :2, np.newaxis] * PAIR
        S = np.where(used[:, np.newaxis, np.newaxis], S, PAIR)
        nis = np.einsum("rm,rmk,rk->r", y, np.linalg.inv(S), y)
        self._news = np.where(used[:, np.newaxis], np.column_stack([nis, y]), self._news)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return where the machine is at ``t_ns``; before it moves, the mean of its newest fixes."""
        started = self._start.started
        dt_s = np.where(started, np.maximum(t_ns - self._t_ns, 0), 0) / NS_PER_S
        modes = predicted(self._engine.modes, self._models.motion(dt_s, self._engine.modes, self._common))
        x, P = modes.mean()
        heading, speed = self._pose.turn(x[:, V_], x[:, A_], started)
        antenna = np.zeros((len(x), 3))
        antenna[:, :2] = np.where(started[:, np.newaxis], x[:, P_] + self._trail.offset_m, self._start.position[:, :2])
        place = self._pose.place(antenna, heading)[:, :2]
        own = np.where(
            started[:, np.newaxis, np.newaxis], P[:, P_, P_], self._start.covariance[:, :2, np.newaxis] * PAIR
        )
        trail = np.square(_TRAIL_ERROR_RATIO * self._trail.offset_m)
        covariance = own + (self._common + trail)[:, :, np.newaxis] * PAIR
        covariance = np.where(np.isfinite(place)[:, :, np.newaxis], covariance, np.nan)
        values = np.column_stack(
            [place, heading, np.where(started, speed, 0.0), self._news, np.where(started, modes.mu[:, CURVE], 0.0)]
        )
        sigmas = np.full(values.shape, np.nan)
        sigmas[:, :2] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        turned = velocity_sigmas(x[:, V_].copy(), P[:, V_, V_].copy(), speed)
        sigmas[:, 2:4] = np.where(started[:, np.newaxis], turned, np.nan)
        self._news = np.full_like(self._news, np.nan)
        return Estimate(t_ns=t_ns, values=values, sigmas=sigmas, covariance=covariance)
