"""The complementary filter of paper 001, section 4.2 and appendix G (kind ``heading_complementary``).

Each of roll, pitch and yaw is alpha times the gyroscope's continuation and 1 - alpha times what accelerometer or
magnetometer say (eqs 21, 22 and 24). With alpha = 0.9 at 50 Hz its time constant is tau = alpha dT / (1 - alpha) =
0.18 s: a residual gyroscope bias b costs b tau (0.18 deg for 1 deg/s), and a magnet held near is followed to
1 - 0.9^n of its deflection in n steps: the whole of it within a second. At another rate the same time constant is kept,
alpha = tau / (tau + dT).

**Known of it, as published.** Eq 19 is arcsin(cos(pitch) sin(roll)), the roll only while the pitch is small, and cannot
exceed 90 deg; the gyroscope's rates about the body's axes are taken for the rates of roll, pitch and yaw; the field is
not levelled before eq 23, so that a tilt of t about the axis across costs up to tan(dip) t of heading (2.4 t in central
Europe); and angles are averaged without wrapping: between -179 and 179 deg lies 0. ``variant = "corrected"`` mends
these four; alpha stays.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from twin.estimators.heading_base import PaperHeadingConfig, PaperHeadingFilter, level, tilt_of_force
from twin.estimators.heading_inputs import MAGNETOMETER, HeadingSample
from twin.estimators.roles import IMU
from twin.geometry import wrap_angle
from twin.signals import EstimatorSetup, FloatArray

KIND = "heading_complementary"
_PAPER_STEP_S = 0.02


class HeadingComplementaryConfig(PaperHeadingConfig):
    """Options of :class:`HeadingComplementary`."""

    kind: Literal["heading_complementary"]
    alpha: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.9
    """Weight of the gyroscope at 50 Hz."""
    variant: Literal["published", "corrected"] = "published"
    """As appendix G has it, or with the four corrections of the module's text."""


class HeadingComplementary(PaperHeadingFilter):
    """Estimator of :class:`HeadingComplementaryConfig`; columns: heading, yaw rate, roll, pitch. It claims no sigma.

    Raises:
        BadInputError: not exactly one inertial unit and one magnetometer.
    """

    extra_columns = ("roll_rad", "pitch_rad")

    def __init__(self, config: HeadingComplementaryConfig, setup: EstimatorSetup) -> None:
        super().__init__(config, setup, kind=KIND, needs=(IMU, MAGNETOMETER))
        self._tau_s = config.alpha * _PAPER_STEP_S / (1.0 - config.alpha)
        self._published = config.variant == "published"
        self._roll: FloatArray = np.zeros(setup.runs)
        self._pitch: FloatArray = np.zeros(setup.runs)
        self._yaw: FloatArray = np.zeros(setup.runs)

    def begin_at(self, yaw: FloatArray) -> None:
        """Start from this yaw (R,)."""
        self._yaw = yaw

    def step(self, sample: HeadingSample) -> None:
        """Take a prepared sample: eqs 21, 22 and 24."""
        dt_s = sample.dt_s
        if dt_s == 0.0:
            return
        alpha = self._tau_s / (self._tau_s + dt_s)
        force, field, rates = sample.force, sample.field, sample.rate
        if self._published:
            roll_seen = np.arctan2(force[:, 1], np.sqrt(force[:, 0] ** 2 + force[:, 2] ** 2))
            pitch_seen = tilt_of_force(force)[1]
        else:
            roll_seen, pitch_seen = tilt_of_force(force)
            rates = euler_rates(rates, self._roll, self._pitch)
        here = sample.inertial
        self._roll = self._blend(self._roll + rates[:, 0] * dt_s, roll_seen, np.where(here, alpha, 1.0))
        self._pitch = self._blend(self._pitch + rates[:, 1] * dt_s, pitch_seen, np.where(here, alpha, 1.0))
        if not self._published:
            field = level(field, self._roll, self._pitch)
        yaw_seen = self.magnetic_yaw(field, sample.magnetic)
        self._yaw = self._blend(self._yaw + rates[:, 2] * dt_s, yaw_seen, np.where(sample.magnetic, alpha, 1.0))

    def _blend(self, carried: FloatArray, seen: FloatArray, alpha: FloatArray) -> FloatArray:
        """Appendix G, ``complementary_filter_update``; (R,) each."""
        if self._published:
            return alpha * carried + (1.0 - alpha) * seen
        return carried + (1.0 - alpha) * wrap_angle(seen - carried)

    def yaw(self) -> FloatArray:
        """Yaw (R,), rad."""
        return self._yaw

    def extra(self) -> FloatArray:
        """Roll and pitch (R, 2), rad."""
        return wrap_angle(np.stack([self._roll, self._pitch], axis=-1))


def euler_rates(rates: FloatArray, roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """Rates of roll, pitch and yaw (R, 3) of body rates (R, 3); near pitch +-90 deg they are held at 1000 times."""
    sine, cosine = np.sin(roll), np.cos(roll)
    flat = np.cos(pitch)
    flat = np.where(np.abs(flat) < 1e-3, np.copysign(1e-3, flat), flat)
    turning = (rates[:, 1] * sine + rates[:, 2] * cosine) / flat
    return np.stack(
        [rates[:, 0] + turning * np.sin(pitch), rates[:, 1] * cosine - rates[:, 2] * sine, turning], axis=-1
    )
