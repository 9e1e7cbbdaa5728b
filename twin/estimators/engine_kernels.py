"""The algebra of the ensemble engine, compiled: members lie next to each other, in blocks that stay in the cache.

Arrays are float64 with the members last and contiguous: x (n, R), P, F and Q (n, n, R), H (n, R). Every member's
numbers are summed in the same order, whatever other members there are. A Jacobian is mostly zeros, the same for all
members: what is zero in all of them is skipped, which changes no sum.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import BoolArray, FloatArray

_BLOCK = 64


@compiled
def nonzero(array: FloatArray) -> BoolArray:
    """Which rows of (n, R) are not zero in all members, (n,)."""
    found = np.zeros(array.shape[0], dtype=np.bool_)
    for i in range(array.shape[0]):
        for m in range(array.shape[1]):
            if array[i, m] != 0.0:
                found[i] = True
                break
    return found


@compiled
def propagate(F: FloatArray, P: FloatArray, Q: FloatArray) -> FloatArray:  # noqa: C901, PLR0912 - plain loops
    """F P F^T + Q, exactly symmetric; all (n, n, R), Q perhaps (n, n, 1)."""
    n, runs = P.shape[0], P.shape[2]
    used = np.zeros((n, n), dtype=np.bool_)
    for i in range(n):
        used[i] = nonzero(F[i])
    out = np.empty_like(P)
    half = np.empty((n, n, _BLOCK))
    same = Q.shape[2] == 1
    for first in range(0, runs, _BLOCK):
        size = min(_BLOCK, runs - first)
        for i in range(n):
            for j in range(n):
                for m in range(size):
                    half[i, j, m] = 0.0
            for k in range(n):
                if used[i, k]:
                    for j in range(n):
                        for m in range(size):
                            half[i, j, m] += F[i, k, first + m] * P[k, j, first + m]
        for i in range(n):
            for j in range(i, n):
                for m in range(size):
                    out[i, j, first + m] = Q[i, j, 0] if same else Q[i, j, first + m]
                for k in range(n):
                    if used[j, k]:
                        for m in range(size):
                            out[i, j, first + m] += half[i, k, m] * F[j, k, first + m]
                if j > i:
                    for m in range(size):
                        out[j, i, first + m] = out[i, j, first + m]
    return out


@compiled
def innovation_covariance(P: FloatArray, H: FloatArray, noise: FloatArray) -> FloatArray:
    """S = H P H^T + diag(noise), (m, m, R); H (m, n, R) and noise (m, R)."""
    parts, n, runs = H.shape
    S, PHt = np.zeros((parts, parts, runs)), np.empty(n)
    for r in range(runs):
        for j in range(parts):
            for a in range(n):
                PHt[a] = 0.0
                for b in range(n):
                    PHt[a] += P[a, b, r] * H[j, b, r]
            S[j, j, r] = noise[j, r]
            for i in range(parts):
                for a in range(n):
                    S[i, j, r] += H[i, a, r] * PHt[a]
    return S


@compiled
def normalised_square(y: FloatArray, S: FloatArray) -> FloatArray:
    """y^T S^-1 y, (R,), of y (m, R) and S (m, m, R), by the factors L D L^T of S."""
    parts, runs = y.shape
    out, L, d, left = np.zeros(runs), np.zeros((parts, parts)), np.empty(parts), np.empty(parts)
    for r in range(runs):
        for i in range(parts):
            d[i], left[i] = S[i, i, r], y[i, r]
            for j in range(i):
                L[i, j] = S[i, j, r]
                for k in range(j):
                    L[i, j] -= L[i, k] * d[k] * L[j, k]
                L[i, j] /= d[j]
                d[i] -= L[i, j] * L[i, j] * d[j]
                left[i] -= L[i, j] * left[j]
            out[r] += left[i] * left[i] / d[i]
    return out


@compiled
def correct(  # noqa: C901, PLR0912, PLR0917 - plain loops, called by position
    x: FloatArray, P: FloatArray, H: FloatArray, y: FloatArray, R: FloatArray, mask: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Update with one component: innovation y and variance R, (R,) each; masked-out members keep their numbers.

    Joseph's form without ever forming I - K H: M = P - K (P H^T)^T, then P+ = M + (K R - M H^T) K^T. Returns x, P and
    y^2 / S (0 where masked out).
    """
    n, runs = x.shape
    used = nonzero(H)
    x_new, P_new, nis = np.empty_like(x), np.empty_like(P), np.empty(runs)
    PHt, K, rest = np.empty((n, _BLOCK)), np.empty((n, _BLOCK)), np.empty((n, _BLOCK))
    inverse = np.empty(_BLOCK)
    for first in range(0, runs, _BLOCK):
        size = min(_BLOCK, runs - first)
        for m in range(size):
            inverse[m] = R[first + m]
        for i in range(n):
            for m in range(size):
                PHt[i, m] = 0.0
            for k in range(n):
                if used[k]:
                    for m in range(size):
                        PHt[i, m] += P[i, k, first + m] * H[k, first + m]
            if used[i]:
                for m in range(size):
                    inverse[m] += H[i, first + m] * PHt[i, m]
        for m in range(size):
            inverse[m] = 1.0 / inverse[m] if mask[first + m] else 0.0
            nis[first + m] = y[first + m] * y[first + m] * inverse[m]
        for i in range(n):
            for m in range(size):
                K[i, m] = PHt[i, m] * inverse[m]
                x_new[i, first + m] = x[i, first + m] + K[i, m] * y[first + m]
                rest[i, m] = K[i, m] * R[first + m]
            for j in range(n):
                for m in range(size):
                    P_new[i, j, first + m] = P[i, j, first + m] - K[i, m] * PHt[j, m]
                if used[j]:
                    for m in range(size):
                        rest[i, m] -= P_new[i, j, first + m] * H[j, first + m]
        for i in range(n):
            for j in range(n):
                for m in range(size):
                    P_new[i, j, first + m] += rest[i, m] * K[j, m]
    return x_new, P_new, nis


@compiled
def correct_in_turn(  # noqa: PLR0917 - called by position
    x: FloatArray, P: FloatArray, H: FloatArray, y: FloatArray, R: FloatArray, mask: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """:func:`correct` by all components one after the other: H (m, n, R), y and R (m, R).

    Each is corrected by what the components before it have not explained. Returns x, P and the normalised square of
    all components, NaN where masked out; there ``y`` may be anything.
    """
    n, runs = x.shape
    x_new, P_new, nis, left = x, P, np.zeros(runs), np.empty(runs)
    for part in range(H.shape[0]):
        for m in range(runs):
            explained = 0.0
            if part:
                for i in range(n):
                    explained += H[part, i, m] * (x_new[i, m] - x[i, m])
            left[m] = y[part, m] - explained if mask[m] else 0.0
        x_new, P_new, square = correct(x_new, P_new, H[part], left, R[part], mask)
        for m in range(runs):
            nis[m] += square[m] if mask[m] else np.nan
    return x_new, P_new, nis
