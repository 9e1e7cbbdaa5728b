"""Modes, measurements and options of :mod:`twin.estimators.guidance_imm`, whose docstring has the reasons."""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import NonNegative, Positive
from twin.estimators.engines import EngineOption
from twin.estimators.guidance_base import GuidanceConfig
from twin.estimators.guidance_imm_kernels import modes_motion, rates_of_turn, turning_transition
from twin.estimators.guidance_kinematic_receiver import Fix, Receiver
from twin.estimators.imm_engine import ModeMotion, Modes
from twin.signals import FloatArray

STRAIGHT, CURVE = 0, 1
"""Modes."""
STATES = 6
P_, V_, A_ = slice(0, 2), slice(2, 4), slice(4, 6)
"""Places in the state."""
PAIR: FloatArray = np.eye(2)
_FASTEST_TURN_RAD_S = 1.0
_SLOW_M_S = 0.5
"""Slower than this, a velocity turns no faster than one of that size: it is noise that turns."""
_USUAL_LAG_S = 0.2
_UNTOLD = 1e8
"""Variance of a velocity that is not told."""


class GuidanceImmConfig(GuidanceConfig):
    """Options of :class:`GuidanceImm`, whose only sensor is the receiver; reasons in the module's docstring."""

    kind: Literal["guidance_imm"]
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
    engine: EngineOption = "auto"
    """Kalman engine; auto: ensemble, whose compiled loops are quicker for a single run, too."""


def rate_of_turn(x: FloatArray) -> FloatArray:
    """Rate (R,) at which velocity and acceleration of states (R, 6) turn, v x a / |v|^2, rad/s."""
    return rates_of_turn(x, _SLOW_M_S, _FASTEST_TURN_RAD_S)


def turning(dt_s: FloatArray, rate: FloatArray) -> FloatArray:
    """Transition (R, 6, 6) of a vehicle whose acceleration turns at ``rate`` (R,): once and twice the integral of a
    rotation. With a rate of zero, eq 13 of paper 004.
    """
    return turning_transition(dt_s, rate)


class StraightOrCurve:
    """The two modes over any interval."""

    def __init__(self, config: GuidanceImmConfig) -> None:
        self._densities = config.straight_m2_s3, config.curve_m2_s5
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
        rate = rate_of_turn(np.ascontiguousarray(modes.x[:, CURVE]))
        options = (*self._densities, self.turning, self._common_s, self._leave)
        return ModeMotion(*modes_motion(dt_s, rate, common, *options))


class Sees:
    """What a fix is to either mode: position, and the velocity of ``velocity_lag_s`` ago, v - lag a."""

    def __init__(self, config: GuidanceImmConfig, receiver: Receiver) -> None:
        sheet = receiver.info.datasheet
        self._velocity = config.velocity == "receiver" and receiver.tells_velocity
        self._noise = max(config.least_m_s, sheet.get("speed_noise_m_s", 0.0))
        self._ratio = sheet.get("speed_noise_ratio", 0.0)
        rows = 4 if self._velocity else 2
        self.H: FloatArray = np.stack([np.eye(rows, STATES)] * 2)
        """(2, m, 6)."""
        if self._velocity:
            lag_s, self._lag_error_s = sheet.get("velocity_lag_s"), config.lag_error_s
            if config.velocity_lag_s is not None:
                lag_s = config.velocity_lag_s
            if lag_s is None:
                lag_s, self._lag_error_s = _USUAL_LAG_S, 1.5 * config.lag_error_s
            self.H[CURVE, 2:, A_] = -lag_s * PAIR

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
