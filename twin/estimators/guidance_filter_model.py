"""Model of the guidance filter: a machine that rolls where it points, and a receiver whose error is slow.

States, with u the told speed and r the told rate of turn:

    E, N       middle of the rear axle, m                    P' = (u (1 + k) + v) (cos psi, sin psi)
    PSI        heading, counter-clockwise from east, rad     psi' = r (1 + g) - b
    B          offset of r, a slow random walk; without a gyro r = 0 and -b is the rate of turn, which wanders
               (and counts in proportion while it moves at less than a crawl: who stands does not turn)
    V          speed that the wheels do not tell (m/s): slip of the moment; without them it is the speed itself
    K          scale error of the told speed                 (where there is one)
    G          scale error of the told rate                  (where there is a gyro)
    S          offset of the told steering angle, rad        (where there is one)
    C, J       slow error of the receiver's position, east and north, and the part of it that steps (where it has one):
               Gauss-Markov processes
    D          what its fixes drift per second that their corrections age, in units of its standard deviation (where
               they do, and the age is told): a Gauss-Markov process of variance one
    O          slow error of the kind of solution that was there before the one of now: it goes on unseen
    A          what C + J + (age x rate) D was at some moment: see :mod:`twin.estimators.guidance_filter_core`

A receiver sees P + lever arm + C + J + (age x rate) D + white. While the wheels stand, nothing of the machine moves and
r is b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.estimators.guidance_filter_inputs import Span
from twin.estimators.guidance_filter_kernels import (
    DRIFT_S,
    JUMP_M,
    JUMP_S,
    OTHER_M,
    OTHER_S,
    SLOW_M,
    SLOW_S,
    seen_antenna,
    seen_velocity,
    span_noise,
    span_transition,
)
from twin.signals import BoolArray, FloatArray, IntArray

E, N, PSI, B, V = range(5)


class Layout:
    """Places of the states that not every filter has; None for those that are missing."""

    def __init__(self, *, speed: bool, rate: bool, steering: bool, jumps: bool, drifts: bool, anchor: bool) -> None:
        self.size = V + 1
        self.scale = self._next(1) if speed else None
        self.gyro_scale = self._next(1) if rate else None
        self.steering = self._next(1) if steering else None
        self.slow = self._next(2)
        """East; north is the next."""
        self.other = self._next(2)
        self.jump = self._next(2) if jumps else None
        self.drift = self._next(2) if drifts else None
        self.anchor = self._next(2) if anchor else None
        self.has_rate, self.has_speed = rate, speed
        self.errors = np.arange(self.slow, self.size)
        """Places of all that is the receiver's."""
        machine = (self.scale, self.gyro_scale, self.steering)
        every = (*machine, self.slow, self.other, self.jump, self.drift, self.anchor)
        self.places: IntArray = np.array([-1 if place is None else place for place in every], dtype=np.int64)
        """All of them, -1 for those that are missing, as the compiled functions want them."""

    def _next(self, count: int) -> int:
        place, self.size = self.size, self.size + count
        return place


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionNoise:
    """How the states of the machine wander."""

    heading_rad_rts: float
    """Angle random walk of the gyro."""
    bias_rad_s_rts: float
    """Of its offset."""
    turn_rad_s: float
    turn_s: float
    """Rate of turn where none is told, 1 sigma, and how long it lasts."""
    acceleration_m_s2_rthz: float
    """Speed walks by so much in a second where none is told."""
    slip_ratio: float
    slip_s: float
    """Slip of the moment against the speed, 1 sigma, and how long it lasts."""
    scale_rts: float
    """Walk of the scale of the told speed per root of a second of driving."""
    walk_m_rtm: float
    """Walk of the position per root of a metre driven: wheels that do not roll where they point."""

    def row(self) -> FloatArray:
        """All of them (9,), in the order of the compiled functions."""
        return np.array(
            [
                *(self.heading_rad_rts, self.bias_rad_s_rts, self.turn_rad_s, self.turn_s),
                *(self.acceleration_m_s2_rthz, self.slip_ratio, self.slip_s, self.scale_rts, self.walk_m_rtm),
            ]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverNoise:
    """Sigma (m) and correlation time (s) of the receiver's errors C, O and J, and of D; (R,) but for the last two."""

    slow_m: FloatArray
    slow_s: FloatArray
    other_m: FloatArray
    other_s: FloatArray
    jump_m: FloatArray
    jump_s: float
    drift_s: float


class SpanMotion:
    """Motion over one span of inputs (:class:`~twin.estimators.engines.Motion`)."""

    def __init__(
        self,
        layout: Layout,
        noise: MotionNoise,
        span: Span,
        *,
        receiver: ReceiverNoise,
        turning: FloatArray,
    ) -> None:
        """``turning``: (R,) share of the rate of turn that counts, 1 but for a machine without a gyro that stands."""
        self._layout, self._dt_s = layout, span.dt_s
        self._means, self._known = moves_of(span, turning)
        self._noise = noise.row()
        self._receiver = np.empty((7, len(span.rate)))
        self._receiver[SLOW_M], self._receiver[SLOW_S] = receiver.slow_m, receiver.slow_s
        self._receiver[OTHER_M], self._receiver[OTHER_S] = receiver.other_m, receiver.other_s
        self._receiver[JUMP_M], self._receiver[JUMP_S] = receiver.jump_m, receiver.jump_s
        self._receiver[DRIFT_S] = receiver.drift_s

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """State after the span and its Jacobian; what moves the machine is the span's, not ``u``."""
        moved, F = span_transition(np.ascontiguousarray(x), *self._model)
        return moved.T, F.transpose(2, 0, 1)

    def Q(self, dt_s: float) -> FloatArray:  # noqa: ARG002, N802
        """Process noise of the span, (R, n, n)."""
        return span_noise(self._layout.size, *self._model).transpose(2, 0, 1)

    @property
    def _model(self) -> tuple[IntArray, FloatArray, FloatArray, float, bool, FloatArray, BoolArray]:
        layout = self._layout
        return layout.places, self._noise, self._receiver, self._dt_s, layout.has_rate, self._means, self._known


def moves_of(span: Span, turning: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Told rate, told speed and the share of the rate that counts, (3, R); and whether the first two are known and the
    machine stands, (3, R).
    """
    means, known = np.empty((3, len(turning))), np.empty((3, len(turning)), dtype=np.bool_)
    means[0], means[1], means[2] = span.rate, span.speed, turning
    known[0], known[1], known[2] = span.rate_known, span.speed_known, span.standing
    means[2, span.standing] = 0.0
    return means, known


class AntennaSeen:
    """Position of an antenna ``forward_m`` before and ``left_m`` to the left of the rear axle, with its errors.

    ``drift_m`` (R,) is what a unit of D makes of the sample.
    """

    R: FloatArray = np.ones(2)

    def __init__(self, layout: Layout, *, forward_m: float, left_m: float, drift_m: FloatArray) -> None:
        self._layout, self._forward_m, self._left_m, self._drift_m = layout, forward_m, left_m, drift_m

    def h(self, x: FloatArray) -> FloatArray:
        """Expected east and north, shape (R, 2)."""
        return self._seen(x)[0].T

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian, shape (R, 2, n)."""
        return self._seen(x)[1].transpose(2, 0, 1)

    def _seen(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return seen_antenna(np.ascontiguousarray(x), self._layout.places, self._forward_m, self._left_m, self._drift_m)


class VelocitySeen:
    """Velocity of that antenna, east and north, behind a receiver's first-order filter of time constant ``lag_s``.

    In a steady turn the filter shows where the antenna went ``lag_s`` before.
    """

    R: FloatArray = np.ones(2)

    def __init__(
        self, layout: Layout, span: Span, *, turning: FloatArray, forward_m: float, left_m: float, lag_s: float
    ) -> None:
        self._layout, self._standing = layout, span.standing
        self._means, _ = moves_of(span, turning)
        self._forward_m, self._left_m, self._lag_s = forward_m, left_m, lag_s

    def h(self, x: FloatArray) -> FloatArray:
        """Expected velocity, shape (R, 2)."""
        return self._seen(x)[0].T

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian, shape (R, 2, n)."""
        return self._seen(x)[1].transpose(2, 0, 1)

    def _seen(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        arm = (self._forward_m, self._left_m, self._lag_s)
        return seen_velocity(np.ascontiguousarray(x), self._layout.places, self._means, self._standing, *arm)


class SteeredRate:
    """The rate of turn that the steering angle makes: z = r (told), h = b - g r + tan(delta - s) speed / wheelbase."""

    R: FloatArray = np.ones(1)

    def __init__(self, layout: Layout, span: Span, *, wheelbase_m: float) -> None:
        self._layout, self._span, self._per_m = layout, span, 1.0 / wheelbase_m

    def _parts(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tangent of the steering angle and speed."""
        layout, span = self._layout, self._span
        s = 0.0 if layout.steering is None else x[:, layout.steering]
        k = 0.0 if layout.scale is None else x[:, layout.scale]
        return np.tan(np.clip(span.steering - s, -1.2, 1.2)), span.speed * (1.0 + k) + x[:, V]

    def h(self, x: FloatArray) -> FloatArray:
        """Expected rate, shape (R, 1)."""
        tangent, speed = self._parts(x)
        g = 0.0 if self._layout.gyro_scale is None else x[:, self._layout.gyro_scale]
        expected: FloatArray = x[:, B] - g * self._span.rate + tangent * speed * self._per_m
        return expected[:, np.newaxis]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian, shape (R, 1, n)."""
        layout, span = self._layout, self._span
        tangent, speed = self._parts(x)
        jacobian = np.zeros((len(x), 1, layout.size))
        jacobian[:, 0, B] = 1.0
        jacobian[:, 0, V] = tangent * self._per_m
        if layout.scale is not None:
            jacobian[:, 0, layout.scale] = tangent * span.speed * self._per_m
        if layout.gyro_scale is not None:
            jacobian[:, 0, layout.gyro_scale] = -span.rate
        if layout.steering is not None:
            jacobian[:, 0, layout.steering] = -(1.0 + np.square(tangent)) * speed * self._per_m
        return jacobian


class StandingRate:
    """What a gyro tells while the wheels stand: its offset."""

    R: FloatArray = np.ones(1)

    def __init__(self, layout: Layout) -> None:
        self._H = np.zeros((1, layout.size))
        self._H[0, B] = 1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Expected rate, shape (R, 1)."""
        return x[:, B : B + 1]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian, shape (1, n)."""
        return self._H
