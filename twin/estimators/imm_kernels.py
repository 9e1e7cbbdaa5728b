"""The algebra of the ensemble form of the IMM (:mod:`twin.estimators.imm_engine`), compiled: member after member.

Arrays are float64 and contiguous, shapes as there: x (R, N, n), P (R, N, n, n), mu (R, N), F and Q (N, R, n, n),
M (R, N, N), H (N, m, n). No member's numbers depend on what other members there are.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import BoolArray, FloatArray

LEAST_PROBABILITY = 1e-12
"""Of any mode, so that none is lost for good."""


@compiled
def mean_of(x: FloatArray, P: FloatArray, mu: FloatArray) -> tuple[FloatArray, FloatArray]:
    """State (R, n) and covariance (R, n, n) of the mixture."""
    runs, modes, n = x.shape
    mean, whole, apart = np.zeros((runs, n)), np.zeros((runs, n, n)), np.empty(n)
    for r in range(runs):
        for j in range(modes):
            for a in range(n):
                mean[r, a] += mu[r, j] * x[r, j, a]
        for j in range(modes):
            for a in range(n):
                apart[a] = x[r, j, a] - mean[r, a]
            for a in range(n):
                for b in range(n):
                    whole[r, a, b] += mu[r, j] * (P[r, j, a, b] + apart[a] * apart[b])
    return mean, whole


@compiled
def mix(x: FloatArray, P: FloatArray, mu: FloatArray, M: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What each mode starts the next prediction from: x0, P0 and c."""
    runs, modes, n = x.shape
    x0, P0, c = np.zeros_like(x), np.zeros_like(P), np.zeros_like(mu)
    apart = np.empty(n)
    for r in range(runs):
        for j in range(modes):
            for i in range(modes):
                c[r, j] += mu[r, i] * M[r, i, j]
            for i in range(modes):
                w = M[r, i, j] * mu[r, i] / c[r, j]
                for a in range(n):
                    x0[r, j, a] += w * x[r, i, a]
            for i in range(modes):
                w = M[r, i, j] * mu[r, i] / c[r, j]
                for a in range(n):
                    apart[a] = x[r, i, a] - x0[r, j, a]
                for a in range(n):
                    for b in range(n):
                        P0[r, j, a, b] += w * (P[r, i, a, b] + apart[a] * apart[b])
    return x0, P0, c


@compiled
def move(x: FloatArray, P: FloatArray, F: FloatArray, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """F x and F P F^T + Q, exactly symmetric."""
    runs, modes, n = x.shape
    moved, spread, half = np.zeros_like(x), np.empty_like(P), np.empty((n, n))
    for r in range(runs):
        for j in range(modes):
            half[:] = 0.0
            for a in range(n):
                for k in range(n):
                    f = F[j, r, a, k]
                    if f != 0.0:
                        moved[r, j, a] += f * x[r, j, k]
                        for b in range(n):
                            half[a, b] += f * P[r, j, k, b]
            for a in range(n):
                for b in range(a, n):
                    total = Q[j, r, a, b]
                    for k in range(n):
                        total += half[a, k] * F[j, r, b, k]
                    spread[r, j, a, b] = total
                    spread[r, j, b, a] = total
    return moved, spread


@compiled
def weigh(c: FloatArray, log_likelihood: FloatArray) -> FloatArray:
    """Mode probabilities (R, N) after a fix."""
    runs, modes = c.shape
    mu = np.empty_like(c)
    for r in range(runs):
        highest = -np.inf
        for j in range(modes):
            mu[r, j] = np.log(c[r, j]) + log_likelihood[r, j]
            highest = max(highest, mu[r, j])
        total = 0.0
        for j in range(modes):
            mu[r, j] = max(np.exp(mu[r, j] - highest), LEAST_PROBABILITY)
            total += mu[r, j]
        for j in range(modes):
            mu[r, j] /= total
    return mu


@compiled
def correct_modes(  # noqa: C901, PLR0917 - plain loops, called by position
    H: FloatArray, x: FloatArray, P: FloatArray, z: FloatArray, R: FloatArray, mask: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Update all modes of the masked members; the others keep their numbers.

    The components, whose errors are independent, are taken one after the other: the joint update, the determinant of
    its S the product of theirs. Joseph's form as in :func:`twin.estimators.engine_kernels.correct`. Returns x, P and
    the modes' log-likelihoods (R, N) but for a constant.
    """
    runs, modes, n = x.shape
    x, P, said = x.copy(), P.copy(), np.zeros((runs, modes))
    PHt, K, rest = np.empty(n), np.empty(n), np.empty(n)
    for r in range(runs):
        if not mask[r]:
            continue
        for j in range(modes):
            for part in range(H.shape[1]):
                y, S = z[r, part], R[r, part]
                for a in range(n):
                    PHt[a] = 0.0
                    for k in range(n):
                        PHt[a] += P[r, j, a, k] * H[j, part, k]
                    y -= H[j, part, a] * x[r, j, a]
                    S += H[j, part, a] * PHt[a]
                said[r, j] -= 0.5 * (y * y / S + np.log(S))
                for a in range(n):
                    K[a] = PHt[a] / S
                    x[r, j, a] += K[a] * y
                    rest[a] = K[a] * R[r, part]
                for a in range(n):
                    for b in range(n):
                        P[r, j, a, b] -= K[a] * PHt[b]
                        rest[a] -= P[r, j, a, b] * H[j, part, b]
                for a in range(n):
                    for b in range(n):
                        P[r, j, a, b] += rest[a] * K[b]
    return x, P, said
