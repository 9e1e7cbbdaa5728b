"""The attitude error of an AHRS, learnt from a receiver's level velocity, and what it does to the acceleration upwards.

With t_f the negative of its pitch error and t_l its roll error, b_f and b_l the offsets of its level accelerometers, an
AHRS says of the level accelerations a_f (forwards) and a_l (to the left), and of the one upwards, to second order,

    A_f = a_f - g t_f + b_f,   A_l = a_l - g t_l + b_l,   A = a + t_f a_f + t_l a_l - g (t_f^2 + t_l^2) / 2

0.3 degrees are 51 mm/s^2 levelwise, which the receiver's velocity shows at once, but 0.3 mm/s^2 upwards, to and fro
within seconds: more than all else that an accelerometer of this class gets wrong in coasting. Solved for a,

    a = A - t_f (A_f - b_f) - g t_f^2 / 2 - (the same to the left)

The filter's state is t_f, t_l (Gauss-Markov), b_f, b_l (constant) and the velocities v_e, v_n. It knows g t - b well
and either of the two badly, so that what is left in a is an error of b: a constant that acts with t - (dt/db) a_f, and
the rest of t, whose effect is taken for white noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from twin.estimators.engines import Engine
from twin.estimators.height_filter_kernels import (
    BY_OFFSET,
    COSINE,
    CURVATURE,
    EAST,
    LEAN,
    NORTH,
    OFFSET,
    OFFSET_SIGMA,
    Q_VV,
    REST,
    SINE,
    SUMS,
    TILT,
)
from twin.estimators.height_filter_model import SlowError, SumOfStates, renew_state
from twin.estimators.height_filter_receiver import FixReading
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import NS_PER_S, FloatArray, IntArray

_T, _B, _V, _SIZE = 0, 2, 4, 6
_G = STANDARD_GRAVITY_M_S2
_UNKNOWN_M_S = 1.0
_NEVER = -(2**62)


class LevelMotion:
    """How tilts, offsets and level velocities go on (:class:`twin.estimators.engines.Motion`)."""

    def __init__(self, tilt: SlowError, *, offset_sigma: float, runs: int) -> None:
        self.sums: FloatArray = np.zeros((SUMS, runs))
        """(13, R), of the span to come."""
        self._tilt, self._offset_sigma, self._runs = tilt, offset_sigma, runs
        self._F: FloatArray = np.zeros((_SIZE, _SIZE, runs))
        self._F[np.arange(_SIZE), np.arange(_SIZE)] = 1.0
        self._Q: FloatArray = np.zeros((_SIZE, _SIZE, runs))

    def start(self) -> tuple[FloatArray, FloatArray]:
        """State (R, 6) and covariance (R, 6, 6) before anything was heard."""
        sigma = np.repeat([self._tilt.sigma, self._offset_sigma, _UNKNOWN_M_S], 2)
        return np.zeros((self._runs, _SIZE)), np.tile(np.diag(sigma**2), (self._runs, 1, 1))

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """The state after the span, (R, 6), and the Jacobian (R, 6, 6), which changes in place at the next call."""
        F, sums, before = self._F, self.sums, x.T
        kept = math.exp(-dt_s / self._tilt.correlation_s)
        F[_T, _T] = F[_T + 1, _T + 1] = kept
        after = before.copy()
        after[_T : _T + 2] *= kept
        cosine, sine = sums[COSINE], sums[SINE]
        for place, forward, left, gain in ((_V, cosine, -sine, sums[EAST]), (_V + 1, sine, cosine, sums[NORTH])):
            F[place, _T], F[place, _T + 1] = _G * forward, _G * left
            F[place, _B], F[place, _B + 1] = -forward, -left
            after[place] += gain
            for cause in range(_V):
                after[place] += F[place, cause] * before[cause]
        return after.T, F.transpose(2, 0, 1)

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Noise (R, 6, 6) gathered in the span; changes in place at the next call."""
        gathered = self._tilt.sigma**2 * -math.expm1(-2.0 * dt_s / self._tilt.correlation_s)
        self._Q[_T, _T] = self._Q[_T + 1, _T + 1] = gathered
        self._Q[_V, _V] = self._Q[_V + 1, _V + 1] = self.sums[Q_VV]
        return self._Q.transpose(2, 0, 1)


class LevelFilter:
    """Tilts of R members.

    A velocity that does not pass the gate is not used; when that has lasted for ``patience_s`` it begins anew.
    """

    def __init__(
        self,
        tilt: SlowError,
        *,
        offset_sigma: float,
        runs: int,
        gate_sigmas: float,
        patience_s: float,
        engine: Callable[[FloatArray, FloatArray], Engine],
    ) -> None:
        self._tilt = tilt
        self._motion = LevelMotion(tilt, offset_sigma=offset_sigma, runs=runs)
        self._engine = engine(*self._motion.start())
        self._used_ns: IntArray = np.full(runs, _NEVER, dtype=np.int64)
        self._lean: FloatArray | None = None
        self._gate = gate_sigmas**2
        self._patience_ns = round(patience_s * NS_PER_S)

    def advance(self, sums: FloatArray, span_s: float) -> None:
        """Move on by a span with these integrals (13, R)."""
        self._lean = None
        self._motion.sums = sums
        self._engine.predict(self._motion, sums, span_s)

    def hear(self, reading: FixReading, behind_m_s: FloatArray) -> None:
        """Take a velocity that is true now, slower by ``behind_m_s`` (2 or more, R) than the AHRS."""
        if not reading.level_known.any():
            return
        self._lean = None
        lost = reading.t_ns - self._used_ns > self._patience_ns
        kept = reading.level_known
        for axis in range(2):
            observation = SumOfStates({_V + axis: 1.0}, reading.level_variance, size=_SIZE)
            z = reading.level_m_s[axis] + behind_m_s[axis]
            y, S = observation.innovation(self._engine.x, self._engine.P, z)
            passed = np.square(y) <= self._gate * S
            anew = reading.level_known & ~passed & lost
            if anew.any():
                renew_state(self._engine, _V + axis, anew, z, np.square(y))
            used = reading.level_known & (passed | anew)
            self._engine.update(observation, z[:, np.newaxis], used, observation.R)
            kept = kept & used
        self._used_ns = np.where(kept, reading.t_ns, self._used_ns)

    def lean(self) -> FloatArray:
        """(11, R) what is known of tilts now.

        Two rows each, forwards and to the left: tilt t; offset b; its standard deviation; dt/db; for every (m/s^2)^2 of
        true level acceleration the density of what the rest of t does. Then one: what their covariance adds to the
        mean acceleration upwards.
        """
        if self._lean is not None:
            return self._lean
        x, P = self._engine.x, self._engine.P
        lean = np.empty((LEAN, len(x)))
        lean[CURVATURE] = 0.0
        for side in range(2):
            t, b = _T + side, _B + side
            both, tilt, offset = P[:, t, b], P[:, t, t], P[:, b, b]
            rest = np.maximum(tilt - np.square(both) / offset, 0.0)
            lean[TILT + side], lean[OFFSET + side] = x[:, t], x[:, b]
            lean[OFFSET_SIGMA + side], lean[BY_OFFSET + side] = np.sqrt(offset), both / offset
            # the better it is followed, the sooner it is another
            lasting_s = self._tilt.correlation_s * np.minimum(rest / self._tilt.sigma**2, 1.0)
            lean[REST + side] = 2.0 * rest * lasting_s
            lean[CURVATURE] += both - 0.5 * _G * tilt
        self._lean = lean
        return lean

    def snapshot(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """All that is known; nothing is copied, since nothing changes in place."""
        return self._engine.x, self._engine.P, self._used_ns

    def restore(self, snapshot: tuple[FloatArray, FloatArray, IntArray]) -> None:
        """Go back to what was known."""
        self._lean = None
        self._engine.restore(snapshot[0], snapshot[1])
        self._used_ns = snapshot[2]
