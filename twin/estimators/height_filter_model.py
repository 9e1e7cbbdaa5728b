"""The model of the height filter: its state, how it moves on, what a receiver sees of it.

    h' = v,   v' = a - b_0 - b_1 - a_f t_f - a_l t_l + w,   each error e' = -e / tau + noise

h is the height of the attitude sensor (AHRS) above the design plane, v its vertical velocity, a what the AHRS says of
the acceleration upwards. Its errors: b_0 an offset, b_1 an instability, w white noise, and the attitude error (t_f, t_l)
by which level acceleration forwards and to the left, a_f and a_l, leaks into Up. The receiver's errors are states too,
those of position as numbers of variance one that the observation multiplies by their standard deviation: c of a fix,
g of a fix per second of age and unit of drift, k of a coarse position; s (m/s) of the vertical speed.

Accelerations are means over the intervals between samples, so a whole span of samples is one linear step, whose
integrals :func:`twin.estimators.height_filter_kernels.compose` gathers. The noise that the slow errors gather within a
span is taken to act at its end; spans are 0.1 s where correlation times are tens of seconds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.estimators.height_filter_kernels import (
    FORWARD_H,
    FORWARD_V,
    GAIN_H,
    GAIN_V,
    LEFT_H,
    LEFT_V,
    Q_HH,
    Q_HV,
    Q_VV,
)
from twin.signals import FloatArray, IntArray

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
    """Of old corrections."""
    coarse: int | None
    """Of positions that are no fixes."""
    speed: int | None
    """Of the vertical speed."""
    tilt: int | None
    """Attitude error forwards; to the left is the next."""
    size: int

    @classmethod
    def of(cls, *, drift: bool, coarse: bool, speed: bool, tilt: bool) -> Layout:
        """Number the states that are wanted."""
        places: list[int | None] = []
        size = C + 1
        for wanted, width in ((drift, 1), (coarse, 1), (speed, 1), (tilt, 2)):
            places.append(size if wanted else None)
            size += width if wanted else 0
        return cls(drift=places[0], coarse=places[1], speed=places[2], tilt=places[3], size=size)

    @property
    def motion_places(self) -> IntArray:
        """(4,) or (6,) places that height and velocity a moment later depend on."""
        tilt = [] if self.tilt is None else [self.tilt, self.tilt + 1]
        return np.array([H, V, B0, B1, *tilt], dtype=np.int64)


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
        self.sums: FloatArray = np.zeros((9, runs))
        """(9, R), of the span to come."""
        self.coarse_s: FloatArray = np.full(runs, 100.0)
        """(R,) correlation time of the coarse positions' error."""
        self._errors = dict(errors)
        self._offset = offset_sigma, offset_walk
        self._F: FloatArray = np.zeros((n, n, runs))
        self._F[np.arange(n), np.arange(n)] = 1.0
        self._Q: FloatArray = np.zeros((n, n, runs))

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

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """The state after the span, (R, n), and the Jacobian (R, n, n), which changes in place at the next call."""
        F, sums, layout = self._F, self.sums, self.layout
        F[H, V] = dt_s
        F[H, B0] = F[H, B1] = -0.5 * dt_s * dt_s
        F[V, B0] = F[V, B1] = -dt_s
        for place, error in self._errors.items():
            F[place, place] = math.exp(-dt_s / error.correlation_s)
        if layout.coarse is not None:
            F[layout.coarse, layout.coarse] = np.exp(-dt_s / self.coarse_s)
        if layout.tilt is not None:
            F[H, layout.tilt], F[V, layout.tilt] = -sums[FORWARD_H], -sums[FORWARD_V]
            F[H, layout.tilt + 1], F[V, layout.tilt + 1] = -sums[LEFT_H], -sums[LEFT_V]
        before = x.T
        after = before * F[np.arange(layout.size), np.arange(layout.size)]
        for place in layout.motion_places.tolist()[1:]:
            after[H] += F[H, place] * before[place]
            if place != V:
                after[V] += F[V, place] * before[place]
        after[H] += sums[GAIN_H]
        after[V] += sums[GAIN_V]
        return after.T, F.transpose(2, 0, 1)

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Noise (R, n, n) gathered in the span; changes in place at the next call."""
        Q, sums = self._Q, self.sums
        Q[H, H], Q[H, V], Q[V, H], Q[V, V] = sums[Q_HH], sums[Q_HV], sums[Q_HV], sums[Q_VV]
        Q[B0, B0] = self._offset[1] ** 2 * dt_s
        for place, error in self._errors.items():
            Q[place, place] = error.sigma**2 * -math.expm1(-2.0 * dt_s / error.correlation_s)
        coarse = self.layout.coarse
        if coarse is not None:
            Q[coarse, coarse] = -np.expm1(-2.0 * dt_s / self.coarse_s)
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
