"""The position-velocity model of paper 003: motion and what is seen of it, as printed and put right.

State [x, y, psi, v] and perhaps the steering angle delta: x east, y north (m), psi from north, clockwise (rad), v
(m/s), delta of the front wheel, positive to the right (rad). T is the time of a step, W the wheelbase.

**As published** (eqs 3, 4, 10, 11): X(k+1) = Phi X(k), P(k+1) = Phi P Phi^T + Q with

    Phi = [1 0 0 T sin(psi + c delta); 0 1 0 T cos(psi + c delta); 0 0 1 T tan(delta) / W; 0 0 0 1].

x and y are those of the antenna (H of eq 6 sees them so). The paper leaves c open: a point a ahead of the rear axle
moves in the direction psi + atan(a tan(delta) / W), so that c = a / W to first order. Its "delta with a capital delta
before it" is the steering angle away from straight on: v tan(delta) / W is the rate of turn of a bicycle. Phi moves the
state as it should, but is no Jacobian: it has no derivative with respect to psi, so that a position never corrects the
heading, and P claims that a wrong heading leads nowhere wrong.

**Corrected**: x and y are those of the middle of the rear axle, which does not slip sideways; a step is the chord of an
arc; F is the Jacobian; the antenna's lever arm is in h.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.estimators.coordinated_turn import sinc_and_derivative
from twin.geometry import turned
from twin.signals import FloatArray

X, Y, PSI, V, DELTA = range(5)


class _Steered:
    """Process noise, and where the steering angle comes from: the input, or the state if it is one."""

    def __init__(self, *, process_variances: Sequence[float], step_s: float, wheelbase_m: float) -> None:
        self.states = len(process_variances)
        self._Q = np.diag(np.asarray(process_variances, dtype=np.float64))
        self._eye = np.eye(self.states)
        self._step_s = step_s
        self._per_wheelbase = 1.0 / wheelbase_m if wheelbase_m > 0.0 else 0.0

    def delta(self, x: FloatArray, u: FloatArray) -> FloatArray:
        """Steering angle (R,)."""
        return x[:, DELTA] if self.states > DELTA else u

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise of ``dt_s``: eq 12 per step of the paper."""
        return self._Q * (dt_s / self._step_s)

    def _identity(self, runs: int) -> FloatArray:
        identity = np.zeros((runs, self.states, self.states))
        identity[:] = self._eye
        return identity


class PublishedMotion(_Steered):
    """Eqs 4, 10 and 11; ``c`` is their c."""

    def __init__(self, *, process_variances: Sequence[float], step_s: float, wheelbase_m: float, c: float) -> None:
        super().__init__(process_variances=process_variances, step_s=step_s, wheelbase_m=wheelbase_m)
        self._c = c

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Phi X and Phi, for the steering angle ``u`` (R,) if it is no state."""
        delta = self.delta(x, u)
        direction = x[:, PSI] + self._c * delta
        Phi, moved = self._identity(len(x)), x.copy()
        for state, rate in ((X, np.sin(direction)), (Y, np.cos(direction)), (PSI, np.tan(delta) * self._per_wheelbase)):
            Phi[:, state, V] = dt_s * rate
            moved[:, state] += Phi[:, state, V] * x[:, V]
        return moved, Phi


class CorrectedMotion(_Steered):
    """The middle of the rear axle on the arc of a circle, and its Jacobian."""

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """State after ``dt_s`` and F, for the steering angle ``u`` (R,) if it is no state."""
        delta, speed = self.delta(x, u), x[:, V]
        per_speed = 0.5 * dt_s * np.tan(delta) * self._per_wheelbase
        half = per_speed * speed
        sinc, slope = sinc_and_derivative(half)
        sine, cosine = np.sin(x[:, PSI] + half), np.cos(x[:, PSI] + half)
        way = dt_s * speed
        moved = x.copy()
        moved[:, X] += way * sinc * sine
        moved[:, Y] += way * sinc * cosine
        moved[:, PSI] += 2.0 * half
        F = self._identity(len(x))
        F[:, X, PSI], F[:, Y, PSI] = way * sinc * cosine, -way * sinc * sine
        bend_x, bend_y = way * (slope * sine + sinc * cosine), way * (slope * cosine - sinc * sine)  # with half
        F[:, X, V] = dt_s * sinc * sine + bend_x * per_speed
        F[:, Y, V] = dt_s * sinc * cosine + bend_y * per_speed
        F[:, PSI, V] = 2.0 * per_speed
        if self.states > DELTA:
            with_delta = 0.5 * way * self._per_wheelbase / np.square(np.cos(delta))
            F[:, X, DELTA], F[:, Y, DELTA], F[:, PSI, DELTA] = (
                bend_x * with_delta,
                bend_y * with_delta,
                2.0 * with_delta,
            )
        return moved, F


class Rows:
    """Rows of H of eq 6: each sees one state, or none (the last as published, for which no state stands)."""

    def __init__(self, seen: Sequence[int | None], variances: Sequence[float], *, states: int) -> None:
        self.R: FloatArray = np.asarray(variances, dtype=np.float64)
        self._H: FloatArray = np.zeros((len(seen), states))
        for row, state in enumerate(seen):
            if state is not None:
                self._H[row, state] = 1.0
        first = seen[0]
        neighbours = first is not None and list(seen) == list(range(first, first + len(seen)))
        self._states = slice(first, first + len(seen)) if neighbours and first is not None else None
        """The states seen, if they are neighbours."""

    def h(self, x: FloatArray) -> FloatArray:
        """Expected measurement, shape (R, m)."""
        expected: FloatArray = x @ self._H.T if self._states is None else x[:, self._states]
        return expected

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian, shape (m, n)."""
        return self._H


class Antenna:
    """Position of an antenna ``forward_m`` before and ``left_m`` to the left of the state's point."""

    def __init__(self, variances: Sequence[float], *, forward_m: float, left_m: float) -> None:
        self.R: FloatArray = np.asarray(variances, dtype=np.float64)
        self._forward_m, self._left_m = forward_m, left_m

    def arm(self, x: FloatArray) -> FloatArray:
        """From the state's point to the antenna, east and north (R, 2)."""
        return np.stack(turned(self._forward_m, self._left_m, 0.5 * np.pi - x[:, PSI]), axis=-1)

    def h(self, x: FloatArray) -> FloatArray:
        """Expected east and north, shape (R, 2)."""
        expected: FloatArray = x[:, [X, Y]] + self.arm(x)
        return expected

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian, shape (R, 2, n)."""
        east, north = self.arm(x).T
        jacobian = np.zeros((len(x), 2, x.shape[1]))
        jacobian[:, 0, X] = jacobian[:, 1, Y] = 1.0
        jacobian[:, 0, PSI], jacobian[:, 1, PSI] = north, -east
        return jacobian
