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
    O          slow error of the kind of solution that was there before the one of now: it goes on unseen
    A          what C + J was at some moment: see :mod:`twin.estimators.guidance_filter_core`

A receiver sees P + lever arm + C + J + white. While the wheels stand, nothing of the machine moves and r is b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.estimators.guidance_filter_inputs import Span
from twin.signals import FloatArray

E, N, PSI, B, V = range(5)


class Layout:
    """Places of the states that not every filter has; None for those that are missing."""

    def __init__(self, *, speed: bool, rate: bool, steering: bool, jumps: bool, anchor: bool) -> None:
        self.size = V + 1
        self.scale = self._next(1) if speed else None
        self.gyro_scale = self._next(1) if rate else None
        self.steering = self._next(1) if steering else None
        self.slow = self._next(2)
        """East; north is the next."""
        self.other = self._next(2)
        self.jump = self._next(2) if jumps else None
        self.anchor = self._next(2) if anchor else None
        self.has_rate, self.has_speed = rate, speed
        self.errors = np.arange(self.slow, self.size)
        """Places of all that is the receiver's."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverNoise:
    """Sigma (m) and correlation time (s) of the receiver's errors C, O and J; (R,) but for the last."""

    slow_m: FloatArray
    slow_s: FloatArray
    other_m: FloatArray
    other_s: FloatArray
    jump_m: FloatArray
    jump_s: float


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
        self._layout, self._noise, self._span, self._receiver = layout, noise, span, receiver
        self._turning = np.where(span.standing, 0.0, turning)
        dt_s = span.dt_s
        self._keep_slow = np.exp(-dt_s / receiver.slow_s)
        self._keep_other = np.exp(-dt_s / receiver.other_s)
        self._keep_jump = np.exp(-dt_s / receiver.jump_s)
        self._keep_rate = np.where(span.rate_known, 1.0, 1.0 if layout.has_rate else np.exp(-dt_s / noise.turn_s))
        self._keep_slip = np.where(span.speed_known, np.exp(-dt_s / noise.slip_s), 1.0)

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """State after the span and its Jacobian; what moves the machine is the span's, not ``u``."""
        layout, span = self._layout, self._span
        moving = ~span.standing
        k = 0.0 if layout.scale is None else x[:, layout.scale]
        g = 0.0 if layout.gyro_scale is None else x[:, layout.gyro_scale]
        turned = self._turning * dt_s * (span.rate * (1.0 + g) - x[:, B])
        way = np.where(moving, dt_s * (span.speed * (1.0 + k) + x[:, V]), 0.0)
        half = 0.5 * turned
        chord = way * np.sinc(half / np.pi)
        cosine, sine = np.cos(x[:, PSI] + half), np.sin(x[:, PSI] + half)
        moved = x.copy()
        moved[:, E] += chord * cosine
        moved[:, N] += chord * sine
        moved[:, PSI] += turned
        F = np.repeat(np.eye(layout.size)[np.newaxis], len(x), axis=0)
        F[:, E, PSI], F[:, N, PSI] = -chord * sine, chord * cosine
        step = np.where(moving, dt_s, 0.0)
        self._with_speed(F, V, step * cosine, step * sine)
        self._with_rate(F, B, -dt_s * self._turning)
        if layout.scale is not None:
            self._with_speed(F, layout.scale, step * span.speed * cosine, step * span.speed * sine)
        if layout.gyro_scale is not None:
            self._with_rate(F, layout.gyro_scale, dt_s * self._turning * span.rate)
        for place, keep in self._decays():
            moved[:, place] *= keep
            F[:, place, place] = keep
        return moved, F

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise of the span, (R, n, n)."""
        layout, noise, span = self._layout, self._noise, self._span
        runs = len(span.rate)
        Q = np.zeros((runs, layout.size, layout.size))
        moving = ~span.standing
        speed = np.abs(span.speed)
        walked = np.where(moving, noise.walk_m_rtm**2 * dt_s * np.maximum(speed, 0.1), 0.0)
        Q[:, E, E] = Q[:, N, N] = walked
        silent = (0.0 if not layout.has_rate else 1.0) * noise.turn_rad_s**2 * 2.0 * noise.turn_s
        Q[:, PSI, PSI] = np.where(moving, np.where(span.rate_known, noise.heading_rad_rts**2, silent) * dt_s, 0.0)
        if layout.has_rate:
            Q[:, B, B] = noise.bias_rad_s_rts**2 * dt_s
        else:
            Q[:, B, B] = noise.turn_rad_s**2 * (1.0 - np.square(self._keep_rate))
        slip = np.square(noise.slip_ratio * speed) * (1.0 - np.square(self._keep_slip))
        Q[:, V, V] = np.where(span.speed_known, slip, noise.acceleration_m_s2_rthz**2 * dt_s)
        if layout.scale is not None:
            Q[:, layout.scale, layout.scale] = np.where(moving, noise.scale_rts**2 * dt_s, 0.0)
        receiver = self._receiver
        slow = np.square(receiver.slow_m) * (1.0 - np.square(self._keep_slow))
        other = np.square(receiver.other_m) * (1.0 - np.square(self._keep_other))
        jump = np.square(receiver.jump_m) * (1.0 - self._keep_jump**2)
        for axis in range(2):
            Q[:, layout.slow + axis, layout.slow + axis] = slow
            Q[:, layout.other + axis, layout.other + axis] = other
            if layout.jump is not None:
                Q[:, layout.jump + axis, layout.jump + axis] = jump
        return Q

    def _decays(self) -> list[tuple[int, FloatArray | float]]:
        layout = self._layout
        decays: list[tuple[int, FloatArray | float]] = [(B, self._keep_rate), (V, self._keep_slip)]
        for axis in range(2):
            decays += [(layout.slow + axis, self._keep_slow), (layout.other + axis, self._keep_other)]
            if layout.jump is not None:
                decays.append((layout.jump + axis, self._keep_jump))
        return decays

    def _with_speed(self, F: FloatArray, place: int, east: FloatArray, north: FloatArray) -> None:
        F[:, E, place], F[:, N, place] = east, north

    def _with_rate(self, F: FloatArray, place: int, turned: FloatArray) -> None:
        """What a change of the rate does: the heading turns by ``turned`` (R,), the chord by half of it."""
        F[:, PSI, place] = turned
        F[:, E, place] = 0.5 * F[:, E, PSI] * turned
        F[:, N, place] = 0.5 * F[:, N, PSI] * turned


class AntennaSeen:
    """Position of an antenna ``forward_m`` before and ``left_m`` to the left of the rear axle, with its errors."""

    R: FloatArray = np.ones(2)

    def __init__(self, layout: Layout, *, forward_m: float, left_m: float) -> None:
        self._layout, self._forward_m, self._left_m = layout, forward_m, left_m

    def _arm(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        cosine, sine = np.cos(x[:, PSI]), np.sin(x[:, PSI])
        return cosine * self._forward_m - sine * self._left_m, sine * self._forward_m + cosine * self._left_m

    def h(self, x: FloatArray) -> FloatArray:
        """Expected east and north, shape (R, 2)."""
        slow, jump = self._layout.slow, self._layout.jump
        seen = x[:, [E, N]] + np.stack(self._arm(x), axis=-1) + x[:, slow : slow + 2]
        return seen if jump is None else seen + x[:, jump : jump + 2]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian, shape (R, 2, n)."""
        layout = self._layout
        east, north = self._arm(x)
        jacobian = np.zeros((len(x), 2, layout.size))
        for axis, place in enumerate((E, N)):
            jacobian[:, axis, place] = jacobian[:, axis, layout.slow + axis] = 1.0
            if layout.jump is not None:
                jacobian[:, axis, layout.jump + axis] = 1.0
        jacobian[:, 0, PSI], jacobian[:, 1, PSI] = -north, east
        return jacobian


class VelocitySeen:
    """Velocity of that antenna, east and north, behind a receiver's first-order filter of time constant ``lag_s``.

    In a steady turn the filter shows where the antenna went ``lag_s`` before.
    """

    R: FloatArray = np.ones(2)

    def __init__(
        self, layout: Layout, span: Span, *, turning: FloatArray, forward_m: float, left_m: float, lag_s: float
    ) -> None:
        self._layout, self._span = layout, span
        self._turning = np.where(span.standing, 0.0, turning)
        self._forward_m, self._left_m, self._lag_s = forward_m, left_m, lag_s

    def _parts(self, x: FloatArray) -> tuple[FloatArray, ...]:
        layout, span = self._layout, self._span
        k = 0.0 if layout.scale is None else x[:, layout.scale]
        g = 0.0 if layout.gyro_scale is None else x[:, layout.gyro_scale]
        moving = ~span.standing
        rate = self._turning * (span.rate * (1.0 + g) - x[:, B])
        along = np.where(moving, span.speed * (1.0 + k) + x[:, V], 0.0) - self._left_m * rate
        aside = self._forward_m * rate
        direction = x[:, PSI] - self._lag_s * rate
        cosine, sine = np.cos(direction), np.sin(direction)
        return along * cosine - aside * sine, along * sine + aside * cosine, cosine, sine

    def h(self, x: FloatArray) -> FloatArray:
        """Expected velocity, shape (R, 2)."""
        return np.stack(self._parts(x)[:2], axis=-1)

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian, shape (R, 2, n)."""
        layout, span = self._layout, self._span
        east, north, cosine, sine = self._parts(x)
        moving = np.where(span.standing, 0.0, 1.0)
        jacobian = np.zeros((len(x), 2, layout.size))
        jacobian[:, 0, PSI], jacobian[:, 1, PSI] = -north, east
        jacobian[:, 0, V], jacobian[:, 1, V] = moving * cosine, moving * sine
        if layout.scale is not None:
            jacobian[:, :, layout.scale] = jacobian[:, :, V] * span.speed[:, np.newaxis]
        with_rate = self._turning[:, np.newaxis] * np.stack(
            [
                -self._left_m * cosine - self._forward_m * sine + self._lag_s * north,
                -self._left_m * sine + self._forward_m * cosine - self._lag_s * east,
            ],
            axis=-1,
        )
        jacobian[:, :, B] = -with_rate
        if layout.gyro_scale is not None:
            jacobian[:, :, layout.gyro_scale] = with_rate * span.rate[:, np.newaxis]
        return jacobian


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
