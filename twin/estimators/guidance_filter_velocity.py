"""What the guidance filter makes of a receiver's velocity: heading and speed, and where no gyro tells of it, a turn.

It is compared ahead and aside of the heading, as the told speed is rounded to slots ahead, and aside it is not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from twin.estimators.engines import AboutState, Engine, Observation, innovation
from twin.estimators.guidance_filter_inputs import Span
from twin.estimators.guidance_filter_model import PSI, B, E, Layout, N, V, VelocitySeen
from twin.estimators.guidance_filter_noise import NoiseConfig
from twin.estimators.guidance_readers import Fix
from twin.geometry import turned
from twin.signals import BoolArray, FloatArray

_LONGEST_S = 2.0
"""A turn that began longer ago is over, or shows in the heading anyway."""
_OTHER_RATE_NIS = 9.2
"""What the normalised square of a velocity's innovation exceeds in a hundredth of all cases."""


class VelocityAid:
    """Velocity of the antenna.

    Args:
        layout: of the state.
        sheet: data sheet of the receiver.
        noise: for what it does not say.
        arm: the antenna's place ahead and to the left of the rear axle, m.
        course_from_m_s: slower a course is none, and a machine without a gyro does not turn.
        gate_sigmas: what is farther off weighs less.
        told_variances: of the told speed and rate of turn of the moment, (m/s)^2 and (rad/s)^2.
    """

    def __init__(
        self,
        layout: Layout,
        sheet: Mapping[str, float],
        noise: NoiseConfig,
        *,
        arm: tuple[float, float],
        course_from_m_s: float,
        gate_sigmas: float,
        told_variances: tuple[float, float],
    ) -> None:
        self.sigma_m_s = sheet.get("speed_noise_m_s", 0.0) or noise.velocity_m_s
        """Of each axis, at rest."""
        self._ratio = sheet.get("speed_noise_ratio", 0.0)
        self._lag_s = sheet.get("velocity_lag_s", 0.0)
        self._layout, self._arm, self._course_from_m_s = layout, arm, course_from_m_s
        self._gate_sigmas, self._turn_change_rad_s = gate_sigmas, noise.turn_change_rad_s
        speed, rate = told_variances
        self._ahead, self._aside = speed + arm[1] ** 2 * rate, arm[0] ** 2 * rate

    def turning(self, x: FloatArray, span: Span) -> FloatArray:
        """Share (R,) of the rate of turn that counts."""
        if self._layout.has_rate:
            return np.ones(len(x))
        return np.minimum(np.abs(span.speed + x[:, V]) / self._course_from_m_s, 1.0)

    def _seen(
        self, engine: Engine, fix: Fix, dilution: FloatArray, span: Span, mask: BoolArray
    ) -> tuple[Observation, FloatArray, FloatArray, BoolArray]:
        """What is expected, the velocity (R, 2), its variances (R, 2), and who has one (R,)."""
        mask = mask & np.isfinite(fix.speed) & np.isfinite(fix.course)
        speed, course = np.where(mask, fix.speed, 0.0), np.where(mask, fix.course, 0.0)
        heading = engine.x[:, PSI]
        z = np.stack(turned(speed, 0.0, course - heading), axis=-1)
        variance = np.square(dilution) * (self.sigma_m_s**2 + np.square(self._ratio * speed))
        told = np.where(span.standing[:, np.newaxis], 0.0, [self._ahead, self._aside])
        variances = variance[:, np.newaxis] + told
        forward, left = self._arm
        turning = self.turning(engine.x, span)
        seen = VelocitySeen(self._layout, span, turning=turning, forward_m=forward, left_m=left, lag_s=self._lag_s)
        return AboutState(_Ahead(seen, heading), engine.x), z, variances, mask

    def hear(
        self, engine: Engine, fix: Fix, dilution: FloatArray, span: Span, *, mask: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """Update where ``mask`` (R,); return the normalised innovations squared (R,), and whose they are (R,).

        ``dilution`` (R,) is by how much the receiver's noise is larger than at best.
        """
        seen, z, variances, mask = self._seen(engine, fix, dilution, span, mask)
        return update_robustly(engine, seen, z, mask, variances, gate_sigmas=self._gate_sigmas), mask

    def may_have_turned(
        self, engine: Engine, fix: Fix, dilution: FloatArray, span: Span, *, dt_s: float, mask: BoolArray
    ) -> None:
        """Where the velocity is not that of a machine that goes on as before, it may have begun to turn, or ceased to,
        since the last fix ``dt_s`` ago: in the middle of that time on average.
        """
        seen, z, variances, mask = self._seen(engine, fix, dilution, span, mask)
        x = engine.x
        surprise = innovation(engine, seen, z, variances)
        mask = mask & (surprise.nis > _OTHER_RATE_NIS)
        if not mask.any():
            return
        speed, rate = span.speed + x[:, V], self._turn_change_rad_s
        dt_s = min(dt_s, _LONGEST_S)
        since_s = dt_s / math.sqrt(3.0)
        change, unknown = np.zeros((2, *x.shape))
        change[:, PSI], change[:, B] = since_s * rate, -rate
        change[:, E], change[:, N] = turned(0.0, 0.5 * since_s**2 * rate * speed, x[:, PSI])
        # for the same change of heading the machine has moved aside the farther, the earlier it began to turn; and for
        # the same rate it has turned the farther
        seen_rad = np.linalg.norm(surprise.y, axis=1) / np.maximum(np.abs(speed), self._course_from_m_s)
        unknown[:, E], unknown[:, N] = turned(0.0, 0.25 * dt_s * seen_rad * speed, x[:, PSI])
        P = engine.P.copy()
        P[:, PSI, PSI] += np.where(mask, np.square(rate * dt_s) / 12.0, 0.0)
        for vector in (change, unknown):
            P += np.where(mask[:, np.newaxis, np.newaxis], vector[:, :, np.newaxis] * vector[:, np.newaxis], 0.0)
        engine.restore(x, P)


class _Ahead:
    """A level vector that is seen east and north, ahead and aside of a heading (R,)."""

    R: FloatArray = np.ones(2)

    def __init__(self, seen: Observation, heading: FloatArray) -> None:
        self._seen, self._heading = seen, heading

    def h(self, x: FloatArray) -> FloatArray:
        """Expected, shape (R, 2)."""
        east, north = self._seen.h(x).T
        return np.stack(turned(east, north, -self._heading), axis=-1)

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian, shape (R, 2, n)."""
        seen = self._seen.H(x)
        return np.stack(turned(seen[:, 0], seen[:, 1], -self._heading[:, np.newaxis]), axis=1)


def update_robustly(
    engine: Engine, seen: Observation, z: FloatArray, mask: BoolArray, R: FloatArray, *, gate_sigmas: float
) -> FloatArray:
    """Update; what is beyond the gate weighs no more than if it were at it. Return the normalised innovation."""
    nis = innovation(engine, seen, z, R).nis
    engine.update(seen, z, mask, R * np.maximum(nis / gate_sigmas**2, 1.0)[:, np.newaxis] ** 2)
    return nis
