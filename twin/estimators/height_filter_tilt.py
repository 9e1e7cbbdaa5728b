"""The attitude error of an AHRS, learnt from a receiver's level velocity, and what it does to the acceleration upwards.

With t_f the negative of its pitch error and t_l its roll error, b_f and b_l the offsets of its level accelerometers, an
AHRS says of the level accelerations a_f (forwards) and a_l (to the left), and of the one upwards, to second order,

    A_f = a_f - g t_f + b_f,   A_l = a_l - g t_l + b_l,   A = a + t_f a_f + t_l a_l - g (t_f^2 + t_l^2) / 2

0.3 degrees are 51 mm/s^2 levelwise, which the receiver's velocity shows at once, but 0.3 mm/s^2 upwards, to and fro
within seconds: more than all else that an accelerometer of this class gets wrong in coasting. Solved for a,

    a = A - t_f (A_f - b_f) - g t_f^2 / 2 - (the same to the left)

The filter's state is t_f, t_l (Gauss-Markov), b_f, b_l (constant), the velocities v_e, v_n, and the heading's error, a
turn of the level acceleration that looks like a tilt when the machine turns. It knows g t - b well and
either of the two badly. With errors dt and db of what it knows, and A_f as it is, the solution above is short by

    -a_f dt + t db + g dt^2 / 2

with the true a_f, which has nothing to do with dt. So what is left in a is an error of b, a constant that acts with
t - (dt/db) a_f; the rest of dt, whose effect is taken for white noise; and the mean of the last term.
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
    LASTING,
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

_T, _B, _V, _PSI, _SIZE = 0, 2, 4, 6, 7
_G = STANDARD_GRAVITY_M_S2
_UNKNOWN_M_S = 1.0
_NEVER = -(2**62)
_SILENT_S, _SPEED_S = 1.0, 10.0
"""After so long without a velocity only this is known of it: how fast machines work, for so long one way; choices."""

LevelSnapshot = tuple[FloatArray, FloatArray, IntArray, FloatArray]


class LevelMotion:
    """How tilts, offsets and level velocities go on (:class:`twin.estimators.engines.Motion`)."""

    def __init__(self, tilt: SlowError, heading: SlowError, *, offset_sigma: float, runs: int) -> None:
        self.sums: FloatArray = np.zeros((SUMS, runs))
        """(13, R), of the span to come."""
        self._tilt, self._heading = tilt, heading
        self._offset_sigma, self._runs = offset_sigma, runs
        self._F: FloatArray = np.zeros((_SIZE, _SIZE, runs))
        self._F[np.arange(_SIZE), np.arange(_SIZE)] = 1.0
        self._Q: FloatArray = np.zeros((_SIZE, _SIZE, runs))

    def start(self) -> tuple[FloatArray, FloatArray]:
        """State (R, 7) and covariance (R, 7, 7) before anything was heard."""
        sigma = np.append(np.repeat([self._tilt.sigma, self._offset_sigma, _UNKNOWN_M_S], 2), self._heading.sigma)
        return np.zeros((self._runs, _SIZE)), np.tile(np.diag(sigma**2), (self._runs, 1, 1))

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """The state after the span, (R, 7), and the Jacobian (R, 7, 7), which changes in place at the next call."""
        F, sums, before = self._F, self.sums, x.T
        kept = math.exp(-dt_s / self._tilt.correlation_s)
        F[_T, _T] = F[_T + 1, _T + 1] = kept
        F[_PSI, _PSI] = math.exp(-dt_s / self._heading.correlation_s)
        after = before * F[np.arange(_SIZE), np.arange(_SIZE)]
        cosine, sine = sums[COSINE], sums[SINE]
        for place, forward, left, gain, turned in (
            (_V, cosine, -sine, sums[EAST], sums[NORTH]),
            (_V + 1, sine, cosine, sums[NORTH], -sums[EAST]),
        ):
            F[place, _T], F[place, _T + 1] = _G * forward, _G * left
            F[place, _B], F[place, _B + 1] = -forward, -left
            F[place, _PSI] = turned
            after[place] += gain
            for cause in (*range(_V), _PSI):
                after[place] += F[place, cause] * before[cause]
        return after.T, F.transpose(2, 0, 1)

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Noise (R, 7, 7) gathered in the span; changes in place at the next call."""
        for place, error in ((_T, self._tilt), (_T + 1, self._tilt), (_PSI, self._heading)):
            self._Q[place, place] = error.sigma**2 * -math.expm1(-2.0 * dt_s / error.correlation_s)
        self._Q[_V, _V] = self._Q[_V + 1, _V + 1] = self.sums[Q_VV]
        return self._Q.transpose(2, 0, 1)


class LevelFilter:
    """Tilts of R members.

    A velocity that does not pass the gate is not used; when that has lasted for ``patience_s`` it begins anew. Where
    none comes, the machine still has no more than its working speed, ``speed_m_s``: what looks like more is a tilt.
    """

    def __init__(
        self,
        tilt: SlowError,
        heading: SlowError,
        *,
        offset_sigma: float,
        lag_s: float,
        speed_m_s: float,
        runs: int,
        gate_sigmas: float,
        patience_s: float,
        engine: Callable[[FloatArray, FloatArray], Engine],
    ) -> None:
        self._tilt = tilt
        self._motion = LevelMotion(tilt, heading, offset_sigma=offset_sigma, runs=runs)
        self._engine = engine(*self._motion.start())
        self._used_ns: IntArray = np.full(runs, _NEVER, dtype=np.int64)
        self._lean: FloatArray | None = None
        self._lag_s, self._speed_m_s = lag_s, speed_m_s
        self._silent_s: FloatArray = np.zeros(runs)
        self._gate = gate_sigmas**2
        self._patience_ns = round(patience_s * NS_PER_S)

    def advance(self, sums: FloatArray, span_s: float) -> None:
        """Move on by a span with these integrals (13, R)."""
        self._lean = None
        self._motion.sums = sums
        self._engine.predict(self._motion, sums, span_s)
        self._silent_s = self._silent_s + span_s
        silent = self._silent_s > _SILENT_S
        if silent.any():
            variance = np.full(len(silent), self._speed_m_s**2 * 2.0 * _SPEED_S / span_s)
            for axis in range(2):
                slow = SumOfStates({_V + axis: 1.0}, variance, size=_SIZE)
                self._engine.update(slow, np.zeros((len(silent), 1)), silent, slow.R)

    def hear(self, reading: FixReading, behind_m_s: FloatArray, heading_rad: FloatArray) -> None:
        """Take a velocity that is true now, slower by ``behind_m_s`` (2 or more, R) than the AHRS, which heads (R,).

        The receiver's lag is made good by the acceleration as the AHRS says it, with its tilt and offset.
        """
        if not reading.level_known.any():
            return
        self._lean = None
        lost = reading.t_ns - self._used_ns > self._patience_ns
        kept = reading.level_known
        cosine, sine = self._lag_s * np.cos(heading_rad), self._lag_s * np.sin(heading_rad)
        for axis, (forward, left) in enumerate(((cosine, -sine), (sine, cosine))):
            weights = {_T: -_G * forward, _T + 1: -_G * left, _B: forward, _B + 1: left, _V + axis: np.ones(len(sine))}
            observation = SumOfStates(weights, reading.level_variance, size=_SIZE)
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
        self._silent_s = np.where(kept, 0.0, self._silent_s)

    def lean(self) -> FloatArray:
        """(13, R) what is known of tilts now.

        Two rows each, forwards and to the left: tilt t; offset b; its standard deviation; dt/db; variance of the rest
        of t; for how long that lasts (s). Then one: what the tilts' variance adds to the mean acceleration upwards.
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
            lean[REST + side], lean[LASTING + side] = rest, lasting_s
            lean[CURVATURE] += 0.5 * _G * tilt
        self._lean = lean
        return lean

    def snapshot(self) -> LevelSnapshot:
        """All that is known; nothing is copied, since nothing changes in place."""
        return self._engine.x, self._engine.P, self._used_ns, self._silent_s

    def restore(self, snapshot: LevelSnapshot) -> None:
        """Go back to what was known."""
        self._lean = None
        self._engine.restore(snapshot[0], snapshot[1])
        self._used_ns, self._silent_s = snapshot[2:]
