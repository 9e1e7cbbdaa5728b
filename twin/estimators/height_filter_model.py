"""The model of the height filter: its state, how it moves on, what a receiver sees of it.

    h' = v,   v' = a - b_0 - b_1 - (leak of the attitude error) + w,   each slow error e' = -e / tau + noise

h is the height of the attitude sensor (AHRS) above the design plane, v its vertical velocity, a what the AHRS says of
the acceleration upwards; b_0 is its offset, b_1 an instability, w white noise.

**The attitude error leaks** into a. Either it is learnt beside (:mod:`twin.estimators.height_filter_tilt`), and two
states of variance one stand for what is left, the offsets of the level accelerometers; or its quadratic part is one
more slow bias b_2 (standard deviation g sigma^2 and half the attitude's correlation time, as the sum of two squares
has), and the rest is noise.

**The receiver's errors** are states too, those of position as numbers of variance one that the observation multiplies
by their standard deviation: c of a fix, d of a fix per second of age and unit of drift, k of a coarse position; s (m/s)
of the vertical speed.

Accelerations are means over the intervals between samples, so a whole span of samples is one step, whose integrals
:func:`twin.estimators.height_filter_kernels.compose` gathers. The noise that slow errors gather within a span is
taken to act at its end; spans are 0.1 s where correlation times are tens of seconds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.estimators.engines import Engine
from twin.estimators.height_filter_kernels import LEAN, Q_HH, Q_HV, Q_VV, SUMS, renew, rise
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import BoolArray, FloatArray

H, V, B0, B1, C = range(5)
"""Places of height, velocity, the bias's offset and instability, and the fix's correlated error."""
UNKNOWN_M, UNKNOWN_M_S = 100.0, 1.0
"""Standard deviation of height and velocity before anything was heard."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowError:
    """A first-order Gauss-Markov state."""

    sigma: float
    correlation_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Where the states are; None for those that this filter does not have."""

    drift: int | None
    """d, of old corrections."""
    coarse: int | None
    """k, of positions that are no fixes."""
    speed: int | None
    """s, of the vertical speed."""
    leak: int | None
    """b_2."""
    tilt: int | None
    """The level accelerometers' offsets, forwards and to the left."""
    pitch: int | None
    """The carrier's pitch error (rad), its trim, and, if there is a tilt, how the two AHRS are aligned."""
    surface: int | None
    """How much deeper wheels stand than the blade cut, and the error of what is known of that, m."""
    size: int

    @classmethod
    def of(
        cls,
        *,
        drift: bool,
        coarse: bool,
        speed: bool,
        leak: bool,
        tilt: bool,
        pitch: bool = False,
        surface: bool = False,
    ) -> Layout:
        """Number the states that are wanted."""
        places: list[int | None] = []
        size = C + 1
        wanted_widths = (
            (drift, 1),
            (coarse, 1),
            (speed, 1),
            (leak, 1),
            (tilt, 2),
            (pitch, 3 if tilt else 2),
            (surface, 2),
        )
        for wanted, width in wanted_widths:
            places.append(size if wanted else None)
            size += width if wanted else 0
        drift_at, coarse_at, speed_at, leak_at, tilt_at, pitch_at, surface_at = places
        return cls(
            drift=drift_at,
            coarse=coarse_at,
            speed=speed_at,
            leak=leak_at,
            tilt=tilt_at,
            pitch=pitch_at,
            surface=surface_at,
            size=size,
        )


class SpanMotion:
    """Moves the state over a span (:class:`twin.estimators.engines.Motion`); :attr:`sums` says what happened in it.

    Args:
        errors: the Gauss-Markov states by place; the coarse one's correlation time is :attr:`coarse_s`.
        offset_sigma: of b_0, m/s^2.
        offset_walk: growth of b_0, m/s^2 per square root of a second.
    """

    def __init__(
        self, layout: Layout, errors: Mapping[int, SlowError], *, offset_sigma: float, offset_walk: float, runs: int
    ) -> None:
        n = layout.size
        self.layout = layout
        self.sums: FloatArray = np.zeros((SUMS, runs))
        """(13, R), of the span to come."""
        self.lean: FloatArray = np.zeros((LEAN, runs))
        """(13, R) what is known of the tilt."""
        self.coarse_s: FloatArray = np.full(runs, 100.0)
        """(R,) correlation time of the coarse positions' error."""
        self._errors = dict(errors)
        self._offset = offset_sigma, offset_walk
        self._F: FloatArray = np.zeros((n, n, runs))
        self._F[np.arange(n), np.arange(n)] = 1.0
        self._Q: FloatArray = np.zeros((n, n, runs))
        self._noise: FloatArray = np.zeros((3, runs))

    def start(self) -> tuple[FloatArray, FloatArray]:
        """State (R, n) and covariance (R, n, n) before anything was heard."""
        n, runs = self.layout.size, self.sums.shape[1]
        sigma = np.zeros(n)
        sigma[H], sigma[V], sigma[B0] = UNKNOWN_M, UNKNOWN_M_S, self._offset[0]
        for place, error in self._errors.items():
            sigma[place] = error.sigma
        if self.layout.coarse is not None:
            sigma[self.layout.coarse] = 1.0
        return np.zeros((runs, n)), np.tile(np.diag(sigma**2), (runs, 1, 1))

    def ahead(self, x: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Height and velocity (2, R) a span after the state x (n, R), their Jacobian (2, n, R) and their noise (3, R):
        variance of height, covariance, variance of velocity."""
        leak, tilt = (-1 if place is None else place for place in (self.layout.leak, self.layout.tilt))
        mean, rows, density = rise(x, self.sums, dt_s, self.lean, leak, tilt, STANDARD_GRAVITY_M_S2)
        noise = np.stack([self.sums[Q_HH], self.sums[Q_HV], self.sums[Q_VV]])
        noise += density * np.array([[dt_s**3 / 3.0], [dt_s**2 / 2.0], [dt_s]])
        return mean, rows, noise

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """The state after the span, (R, n), and the Jacobian (R, n, n), which changes in place at the next call."""
        F, layout = self._F, self.layout
        before = np.ascontiguousarray(x.T)
        for place, error in self._errors.items():
            F[place, place] = math.exp(-dt_s / error.correlation_s)
        if layout.coarse is not None:
            F[layout.coarse, layout.coarse] = np.exp(-dt_s / self.coarse_s)
        after = before * F[np.arange(layout.size), np.arange(layout.size)]
        after[:2], F[:2], self._noise = self.ahead(before, dt_s)
        return after.T, F.transpose(2, 0, 1)

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Noise (R, n, n) gathered in the span linearised last; changes in place at the next call."""
        Q, layout, noise = self._Q, self.layout, self._noise
        Q[H, H], Q[H, V], Q[V, H], Q[V, V] = noise[0], noise[1], noise[1], noise[2]
        Q[B0, B0] = self._offset[1] ** 2 * dt_s
        for place, error in self._errors.items():
            Q[place, place] = error.sigma**2 * -math.expm1(-2.0 * dt_s / error.correlation_s)
        if layout.coarse is not None:
            Q[layout.coarse, layout.coarse] = -np.expm1(-2.0 * dt_s / self.coarse_s)
        return Q.transpose(2, 0, 1)


class SumOfStates:
    """A weighted sum of states, one number (:class:`twin.estimators.engines.Observation`).

    Args:
        weights: by place, one number or (R,).
        variance: (R,) of its white noise.
    """

    def __init__(self, weights: Mapping[int, float | FloatArray], variance: FloatArray, *, size: int) -> None:
        self.R: FloatArray = variance[:, np.newaxis]
        """(R, 1)."""
        self._H: FloatArray = np.zeros((1, size, len(variance)))
        self._places = sorted(weights)
        for place in self._places:
            self._H[0, place] = weights[place]

    def h(self, x: FloatArray) -> FloatArray:
        """Expected measurement (R, 1)."""
        expected = np.zeros(len(x))
        for place in self._places:
            expected = expected + self._H[0, place] * x[:, place]
        return expected[:, np.newaxis]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (R, 1, n)."""
        return self._H.transpose(2, 0, 1)

    def innovation(self, x: FloatArray, P: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Innovation (R,) of ``z`` (R,) and its variance (R,), before an update: what gates look at."""
        y = z - self.h(x)[:, 0]
        S = self.R[:, 0]
        for one in self._places:
            for other in self._places:
                S = S + self._H[0, one] * P[:, one, other] * self._H[0, other]
        return y, S


def renew_state(branch: Engine, place: int, members: BoolArray, mean: FloatArray, variance: FloatArray) -> None:
    """Forget one state of some members; see :func:`twin.estimators.height_filter_kernels.renew`."""
    x, P = np.ascontiguousarray(branch.x.T), np.ascontiguousarray(branch.P.transpose(1, 2, 0))
    x, P = renew(x, P, place, members, mean, variance)
    branch.restore(x.T, P.transpose(2, 0, 1))
