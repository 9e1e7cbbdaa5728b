"""Madgwick's gradient-descent filter, paper 001 section 4.3 (kind ``heading_madgwick``).

The quaternion q = [q1, q2, q3, q4] = [w, x, y, z] turns body axes into earth axes whose x points to magnetic north and
whose z points up; every step it follows the gyroscope and moves by beta against the gradient of what accelerometer and
magnetometer disagree with (Madgwick, Harrison and Vaidyanathan 2011).

**As published it is not that filter.** ``variant = "published"`` keeps eqs 33 to 43 as printed:

* eqs 34 and 39, second rows: q1 q2 - q3 q4 should be q1 q2 + q3 q4;
* eq 35: the last row's first entry should be 2 (q2 q4 + q1 q3); and the matrix takes earth to body, so that eq 36 needs
  its transpose;
* eq 38: the first row's last entry repeats the one before; it should be -2 bx q4 + bz q2;
* eq 43: the quaternion moves by beta (not beta dT) against the gradient, and the gyroscope of eqs 25 to 27 is left out:
  it should be q + (dq/dt - beta gradient / |gradient|) dT.

``variant = "corrected"``, the default, equals the PyPI package ``ahrs`` 0.4 (which the paper cites) to rounding, but
for one thing: that package leaves the attitude alone where the gyroscope reads exactly zero in all axes, as it does
behind the paper's dead band whenever the robot stands. Here such a sample corrects like any other.

**Gain.** Eq 44 is beta = sqrt(3/4) times the mean gyroscope error; the paper gives none. With its pre-filter's
0.267 deg/s beta is 0.0040, with which the filter hardly follows a magnet; its table 5 needs more. The default is 0.041,
Madgwick's and the package's with magnetometer. A quaternion rate of beta turns at most 2 beta: 4.7 deg/s.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import NonNegative
from twin.estimators.heading_base import PaperHeadingConfig, PaperHeadingFilter
from twin.estimators.heading_inputs import MAGNETOMETER, HeadingSample
from twin.estimators.roles import IMU
from twin.signals import EstimatorSetup, FloatArray

KIND = "heading_madgwick"


class HeadingMadgwickConfig(PaperHeadingConfig):
    """Options of :class:`HeadingMadgwick`."""

    kind: Literal["heading_madgwick"]
    variant: Literal["published", "corrected"] = "corrected"
    beta: NonNegative = 0.041
    """Filter gain, rad/s; see :func:`gain_of`."""


def gain_of(gyro_error_rad_s: float) -> float:
    """Eq 44: beta of the mean error of a gyroscope axis, rad/s."""
    return float(np.sqrt(0.75)) * gyro_error_rad_s


class HeadingMadgwick(PaperHeadingFilter):
    """Estimator of :class:`HeadingMadgwickConfig`; columns: heading, yaw rate, roll, pitch. It claims no sigma.

    Raises:
        BadInputError: not exactly one inertial unit and one magnetometer.
    """

    extra_columns = ("roll_rad", "pitch_rad")

    def __init__(self, config: HeadingMadgwickConfig, setup: EstimatorSetup) -> None:
        super().__init__(config, setup, kind=KIND, needs=(IMU, MAGNETOMETER))
        self._config = config
        self._q: FloatArray = np.tile([1.0, 0.0, 0.0, 0.0], (setup.runs, 1))

    def begin_at(self, yaw: FloatArray) -> None:
        """Start level, at this yaw (R,)."""
        self._q = _at_yaw(yaw - self._field_zero)

    def step(self, sample: HeadingSample) -> None:
        """Take a prepared sample."""
        if sample.dt_s == 0.0:
            return
        before = self._has_field_zero
        yaw = self.yaw()
        self.magnetic_yaw(sample.field, sample.magnetic)  # settles where yaw is counted from
        first = self._has_field_zero & ~before
        self._q = np.where(first[:, np.newaxis], _at_yaw(yaw - self._field_zero), self._q)
        beta, dt_s, force, field = self._config.beta, sample.dt_s, _unit(sample.force), _unit(sample.field)
        if self._config.variant == "published":
            moved = published_step(self._q, force, field, beta=beta)
        else:
            moved = madgwick_step(self._q, sample.rate, force, field, beta=beta, dt_s=dt_s)
        if not sample.magnetic.all():
            blind = madgwick_step(self._q, sample.rate, force, None, beta=beta, dt_s=dt_s)
            moved = np.where(sample.magnetic[:, np.newaxis], moved, blind)
        self._q = moved

    def yaw(self) -> FloatArray:
        """Yaw (R,), rad: that of eq 47 is counted from magnetic north."""
        q1, q2, q3, q4 = self._q.T
        by_field = np.arctan2(2.0 * (q2 * q3 + q1 * q4), q1 * q1 + q2 * q2 - q3 * q3 - q4 * q4)
        return np.asarray(by_field + self._field_zero)

    def extra(self) -> FloatArray:
        """Roll and pitch (R, 2), eqs 45 and 46, rad."""
        q1, q2, q3, q4 = self._q.T
        roll = np.arctan2(2.0 * (q1 * q2 + q3 * q4), q1 * q1 + q4 * q4 - q2 * q2 - q3 * q3)
        return np.stack([roll, -np.arcsin(np.clip(2.0 * (q2 * q4 - q1 * q3), -1.0, 1.0))], axis=-1)


def madgwick_step(
    q: FloatArray, rate: FloatArray, force: FloatArray, field: FloatArray | None, *, beta: float, dt_s: float
) -> FloatArray:
    """One step of Madgwick's filter: q (R, 4), rate (R, 3) in rad/s, directions (R, 3); without ``field``, by IMU."""
    q1, q2, q3, q4 = q.T
    gx, gy, gz = rate.T
    dq = 0.5 * np.stack(
        [
            -q2 * gx - q3 * gy - q4 * gz,
            q1 * gx + q3 * gz - q4 * gy,
            q1 * gy - q2 * gz + q4 * gx,
            q1 * gz + q2 * gy - q3 * gx,
        ],
        axis=-1,
    )
    gradient = _gravity_gradient(q, force)
    if field is not None:
        gradient = gradient + _field_gradient(q, field)
    return _unit(q + (dq - beta * _unit(gradient)) * dt_s)


def published_step(q: FloatArray, force: FloatArray, field: FloatArray, *, beta: float) -> FloatArray:
    """Eqs 33 to 43 as printed: q (R, 4), directions (R, 3). There is no gyroscope and no time in it."""
    q1, q2, q3, q4 = q.T
    ax, ay, az = force.T
    mx, my, mz = field.T
    # eq 34, and J_g^T f_g by eq 33
    g1, g2, g3 = 2 * (q2 * q4 - q1 * q3) - ax, 2 * (q1 * q2 - q3 * q4) - ay, 2 * (0.5 - q2 * q2 - q3 * q3) - az
    by_gravity = [-2 * q3 * g1 + 2 * q2 * g2, 2 * q4 * g1 + 2 * q1 * g2 - 4 * q2 * g3]
    by_gravity += [-2 * q1 * g1 + 2 * q4 * g2 - 4 * q3 * g3, 2 * q2 * g1 + 2 * q3 * g2]
    # eqs 35 to 37
    hx = (2 * q1 * q1 - 1 + 2 * q2 * q2) * mx + 2 * (q2 * q3 + q1 * q4) * my + 2 * (q2 * q4 - q1 * q3) * mz
    hy = 2 * (q2 * q3 - q1 * q4) * mx + (2 * q1 * q1 - 1 + 2 * q3 * q3) * my + 2 * (q3 * q4 + q1 * q2) * mz
    bz = 2 * (q2 * q4 - q1 * q3) * mx + 2 * (q3 * q4 - q1 * q2) * my + (2 * q1 * q1 - 1 + 2 * q4 * q4) * mz
    bx = np.sqrt(hx * hx + hy * hy)
    # eq 39, and J_b^T f_b by eq 38
    f1 = 2 * bx * (0.5 - q3 * q3 - q4 * q4) + 2 * bz * (q2 * q4 - q1 * q3) - mx
    f2 = 2 * bx * (q2 * q3 - q1 * q4) + 2 * bz * (q1 * q2 - q3 * q4) - my
    f3 = 2 * bx * (q1 * q3 + q2 * q4) + 2 * bz * (0.5 - q2 * q2 - q3 * q3) - mz
    repeated = -2 * bx * q3 - bz * q1
    by_field = [
        2 * (-bz * q3 * f1 + (-bx * q4 + bz * q2) * f2 + bx * q3 * f3),
        2 * (bz * q4 * f1 + (bx * q3 + bz * q1) * f2 + (bx * q4 - 2 * bz * q2) * f3),
        2 * (repeated * f1 + (bx * q2 + bz * q4) * f2 + (bx * q1 - 2 * bz * q3) * f3),
        2 * (repeated * f1 + (-bx * q1 + bz * q3) * f2 + bx * q2 * f3),
    ]
    gradient = np.stack(by_gravity, axis=-1) + np.stack(by_field, axis=-1)
    return _unit(q - beta * _unit(gradient))


def _gravity_gradient(q: FloatArray, force: FloatArray) -> FloatArray:
    """J^T f of the accelerometer, (R, 4)."""
    q1, q2, q3, q4 = q.T
    ax, ay, az = force.T
    f1, f2, f3 = 2 * (q2 * q4 - q1 * q3) - ax, 2 * (q1 * q2 + q3 * q4) - ay, 2 * (0.5 - q2 * q2 - q3 * q3) - az
    return np.stack(
        [
            2 * (-q3 * f1 + q2 * f2),
            2 * (q4 * f1 + q1 * f2) - 4 * q2 * f3,
            2 * (-q1 * f1 + q4 * f2) - 4 * q3 * f3,
            2 * (q2 * f1 + q3 * f2),
        ],
        axis=-1,
    )


def _field_gradient(q: FloatArray, field: FloatArray) -> FloatArray:
    """J^T f of the magnetometer, (R, 4), the earth's field taken as [bx, 0, bz] at the attitude now."""
    q1, q2, q3, q4 = q.T
    mx, my, mz = field.T
    hx = (1 - 2 * (q3 * q3 + q4 * q4)) * mx + 2 * (q2 * q3 - q1 * q4) * my + 2 * (q2 * q4 + q1 * q3) * mz
    hy = 2 * (q2 * q3 + q1 * q4) * mx + (1 - 2 * (q2 * q2 + q4 * q4)) * my + 2 * (q3 * q4 - q1 * q2) * mz
    bz = 2 * (q2 * q4 - q1 * q3) * mx + 2 * (q3 * q4 + q1 * q2) * my + (1 - 2 * (q2 * q2 + q3 * q3)) * mz
    bx = np.sqrt(hx * hx + hy * hy)
    f1 = 2 * bx * (0.5 - q3 * q3 - q4 * q4) + 2 * bz * (q2 * q4 - q1 * q3) - mx
    f2 = 2 * bx * (q2 * q3 - q1 * q4) + 2 * bz * (q1 * q2 + q3 * q4) - my
    f3 = 2 * bx * (q1 * q3 + q2 * q4) + 2 * bz * (0.5 - q2 * q2 - q3 * q3) - mz
    return 2.0 * np.stack(
        [
            -bz * q3 * f1 + (-bx * q4 + bz * q2) * f2 + bx * q3 * f3,
            bz * q4 * f1 + (bx * q3 + bz * q1) * f2 + (bx * q4 - 2 * bz * q2) * f3,
            (-2 * bx * q3 - bz * q1) * f1 + (bx * q2 + bz * q4) * f2 + (bx * q1 - 2 * bz * q3) * f3,
            (-2 * bx * q4 + bz * q2) * f1 + (-bx * q1 + bz * q3) * f2 + bx * q2 * f3,
        ],
        axis=-1,
    )


def _unit(vectors: FloatArray) -> FloatArray:
    """Vectors (R, n) of length 1; zero stays zero."""
    length = np.sqrt(np.add.reduce(vectors * vectors, axis=-1, keepdims=True))
    unit: FloatArray = vectors / np.where(length > 0.0, length, 1.0)
    return unit


def _at_yaw(yaw: FloatArray) -> FloatArray:
    """Quaternions (R, 4) of level bodies at these yaws (R,)."""
    none = np.zeros_like(yaw)
    return np.stack([np.cos(0.5 * yaw), none, none, np.sin(0.5 * yaw)], axis=-1)
