"""The coordinated-turn model of a rigid planter: motion, what the sensors see of it, and moving it along the bar.

Source: paper 000, sections 2.4 to 2.6. State x = [x, y, s, phi, omega]: east and north position in m, forward speed in
m/s, heading in rad (counter-clockwise from east, not wrapped), yaw rate in rad/s, all of one point of the machine, the
*origin* of the filter. The longitudinal acceleration is an input.

**Motion** (eqs 2.18 to 2.22), with half the turned angle g = omega T / 2:

    x+     = x + s T sinc(g) cos(phi + g)        sinc(g) = sin(g) / g, 1 at g = 0
    y+     = y + s T sinc(g) sin(phi + g)
    s+     = s + T a
    phi+   = phi + T omega
    omega+ = omega

As printed, 2.18 and 2.19 divide by omega; (2 s / omega) sin(g) is s T sinc(g), which has no singularity. Eq 2.22 is
printed "omega(t + T) = w(t)". It is read as omega(t + T) = omega(t), the discrete form of 2.17: white noise of the
paper's variance of 1e-8 in place of the yaw rate would tie every estimate to zero. The noise v of 2.23 is added to all
five states.

**The two signs of the lever arm.** A rigid body with yaw rate omega moves forward at v_b = v_a - omega r_ab (2.10),
r_ab the distance from a to b, counted to the left (FLU). Eq 2.29, s_meas = s - omega r, is that with r counted to the
left from the origin to the sensor. Eq 2.26, s_meas = s + omega r, is the same with r counted from the sensor to the
origin, that is to the right. Eqs 2.11 and 2.12 mix the two: x_a = x_b + r sin(phi) has r to the right and
y_a = y_b + r cos(phi) has r to the left; one frame cannot have both. Here r is always to the left:

    v_b = v_a - omega r,   x_b = x_a - r sin(phi),   y_b = y_a + r cos(phi).

**The antenna's lever arm.** Eqs 2.27 and 2.28, x_meas = x - r_x, subtract body-frame components from world coordinates
(the paper notes the mix) and with the wrong sign for r from the origin to the antenna. Here r is turned by the heading.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.geometry import turned
from twin.signals import FloatArray

E, N, S, PHI, OMEGA = range(5)
"""Places in the state."""
STATES = 5

_SERIES_LIMIT = 1e-2
"""Below this |g| the series take over; their next terms, g^6 / 5040 and g^5 / 840, are below 3e-13 there."""


def sinc_and_derivative(g: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sin(g) / g and its derivative (cos(g) - sin(g) / g) / g, with their limits 1 and 0 at g = 0; any shape.

    The closed form of the derivative loses all digits near 0, so 1 - g^2/6 + g^4/120 and -g/3 + g^3/30 take over there.
    """
    square = g * g
    sinc, derivative = 1.0 - square * (1.0 / 6.0 - square / 120.0), g * (square / 30.0 - 1.0 / 3.0)
    if square.max() >= _SERIES_LIMIT * _SERIES_LIMIT:  # faster than 1 rad/s at 50 Hz, or a long gap
        large = square >= _SERIES_LIMIT * _SERIES_LIMIT
        safe = np.where(large, g, 1.0)
        closed = np.sin(safe) / safe
        sinc = np.where(large, closed, sinc)
        derivative = np.where(large, (np.cos(safe) - closed) / safe, derivative)
    return sinc, derivative


class CoordinatedTurn:
    """Motion of the state over a step, eqs 2.18 to 2.23.

    ``process_variances`` are the diagonal of Q (eq 4.1) for one step of ``step_s``. The paper adds Q once per update,
    whatever the rate; time in which no sample came (a gap of several steps) is worth that many Q.
    """

    def __init__(self, *, process_variances: Sequence[float], step_s: float) -> None:
        self._Q = np.diag(np.asarray(process_variances, dtype=np.float64))
        self._step_s = step_s

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """State after ``dt_s`` under the acceleration ``u`` (R,) in m/s^2, shape (R, 5), and its Jacobian (R, 5, 5)."""
        speed, omega = x[:, S], x[:, OMEGA]
        half_turn = (0.5 * dt_s) * omega
        sinc, derivative = sinc_and_derivative(half_turn)
        direction = x[:, PHI] + half_turn
        along = np.array([np.cos(direction), np.sin(direction)])  # east and north, (2, R), and so are the next two
        per_speed = (dt_s * sinc) * along
        chord = speed * per_speed
        stretch = (0.5 * dt_s * dt_s) * speed * derivative  # of the chord, with omega
        jacobian = np.empty((STATES, STATES, len(x)))  # members fastest, as the engines keep them
        jacobian[:] = _IDENTITY
        jacobian[:2, S] = per_speed
        jacobian[E, PHI] = -chord[1]
        jacobian[N, PHI] = chord[0]
        jacobian[:2, OMEGA] = stretch * along + (0.5 * dt_s) * jacobian[:2, PHI]
        jacobian[PHI, OMEGA] = dt_s
        moved = x.copy(order="K")
        moved[:, :2] += chord.T
        moved[:, S] += dt_s * u
        moved[:, PHI] += dt_s * omega
        return moved, jacobian.transpose(2, 0, 1)

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise of ``dt_s``, shape (5, 5)."""
        return self._Q if dt_s == self._step_s else self._Q * (dt_s / self._step_s)


_IDENTITY: FloatArray = np.eye(STATES)[:, :, np.newaxis]


class YawRate:
    """A gyroscope's up axis: z = omega (eq 2.25)."""

    def __init__(self, variance: float) -> None:
        self.R: FloatArray = np.array([variance])
        self._H: FloatArray = np.zeros((1, STATES))
        self._H[0, OMEGA] = 1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Expected yaw rate, shape (R, 1)."""
        return x[:, OMEGA : OMEGA + 1]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian, shape (1, 5)."""
        return self._H


class ForwardSpeed:
    """A speed sensor ``left_m`` to the left of the origin: z = s - omega left (eqs 2.26, 2.29).

    With ``variance`` 0 it states that the speed *is* z: the standstill of section 2.7.
    """

    def __init__(self, variance: float, *, left_m: float = 0.0) -> None:
        self.R: FloatArray = np.array([variance])
        self._left_m = left_m
        self._H: FloatArray = np.zeros((1, STATES))
        self._H[0, S] = 1.0
        self._H[0, OMEGA] = -left_m

    def h(self, x: FloatArray) -> FloatArray:
        """Expected speed, shape (R, 1)."""
        return x[:, S : S + 1] - self._left_m * x[:, OMEGA : OMEGA + 1]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian, shape (1, 5)."""
        return self._H


class AntennaPosition:
    """A position sensor ``forward_m`` before and ``left_m`` to the left of the origin (eqs 2.27, 2.28, corrected)."""

    def __init__(self, variance: float, *, forward_m: float = 0.0, left_m: float = 0.0) -> None:
        self.R: FloatArray = np.array([variance, variance])
        self._forward_m = forward_m
        self._left_m = left_m

    def h(self, x: FloatArray) -> FloatArray:
        """Expected east and north position of the antenna, shape (R, 2)."""
        east, north = turned(self._forward_m, self._left_m, x[:, PHI])
        return np.stack([x[:, E] + east, x[:, N] + north], axis=-1)

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian, shape (R, 2, 5)."""
        east, north = turned(self._forward_m, self._left_m, x[:, PHI])
        jacobian = np.zeros((2, STATES, len(x)))
        jacobian[0, E] = jacobian[1, N] = 1.0
        jacobian[0, PHI] = -north
        jacobian[1, PHI] = east
        return jacobian.transpose(2, 0, 1)


def transport(x: FloatArray, P: FloatArray, left_m: float) -> tuple[FloatArray, FloatArray]:
    """State (R, 5) and covariance (R, 5, 5) of the point ``left_m`` to the left of the origin (eqs 2.10 to 2.12)."""
    if left_m == 0.0:
        return x, P
    east, north = turned(0.0, left_m, x[:, PHI])
    moved = x.copy(order="K")
    moved[:, E] += east
    moved[:, N] += north
    moved[:, S] -= left_m * x[:, OMEGA]
    T = np.empty((STATES, STATES, len(x)))
    T[:] = _IDENTITY
    T[E, PHI], T[N, PHI] = -north, east
    T[S, OMEGA] = -left_m
    return moved, np.einsum("rik,lkr->ril", np.einsum("ijr,rjk->rik", T, P), T)
