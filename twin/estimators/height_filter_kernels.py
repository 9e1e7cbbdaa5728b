"""Compiled loops of the height filter: what an accelerometer tells over a span of time, and what that does to a state.

Arrays have the members last and contiguous, as in :mod:`twin.estimators.engine_kernels`; each member by itself.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import BoolArray, FloatArray, IntArray

GAIN_V, GAIN_H, FORWARD_V, FORWARD_H, LEFT_V, LEFT_H, Q_VV, Q_HV, Q_HH = range(9)
"""Rows of what :func:`compose` gives."""
SUMS = 9


@compiled
def compose(  # noqa: PLR0917 - compiled functions are called by position
    begin_ns: IntArray,
    end_ns: IntArray,
    accel: FloatArray,
    density: FloatArray,
    forward: FloatArray,
    left: FloatArray,
    from_ns: int,
    to_ns: int,
) -> FloatArray:
    """Integrals (9, R) of accelerations that are constant in each of K intervals, from ``from_ns`` to ``to_ns``.

    ``accel`` (K, R) upwards, ``forward`` and ``left`` (K, R) level, m/s^2; ``density`` (K, R) of the white error of
    ``accel``, (m/s^2)^2 s. Rows: gain of velocity and of height; the same of the two level accelerations; variance of
    velocity, its covariance with height, variance of height.
    """
    out = np.zeros((SUMS, accel.shape[1]))
    for k in range(len(begin_ns)):
        first, last = max(begin_ns[k], from_ns), min(end_ns[k], to_ns)
        if last <= first:
            continue
        d = (last - first) * 1e-9
        lever = (to_ns - last) * 1e-9 + 0.5 * d
        square = lever * lever + d * d / 12.0
        for m in range(accel.shape[1]):
            up, ahead, aside = accel[k, m] * d, forward[k, m] * d, left[k, m] * d
            out[GAIN_V, m] += up
            out[GAIN_H, m] += up * lever
            out[FORWARD_V, m] += ahead
            out[FORWARD_H, m] += ahead * lever
            out[LEFT_V, m] += aside
            out[LEFT_H, m] += aside * lever
            q = density[k, m] * d
            out[Q_VV, m] += q
            out[Q_HV, m] += q * lever
            out[Q_HH, m] += q * square
    return out


@compiled
def lagged(begin_ns: IntArray, end_ns: IntArray, values: FloatArray, at_ns: int, lag_s: float) -> FloatArray:
    """Values (K, R), each constant in its interval, as a first-order lag shows them at ``at_ns``, (R,).

    What was before the first interval is left out.
    """
    out = np.zeros(values.shape[1])
    for k in range(len(begin_ns)):
        last = min(end_ns[k], at_ns)
        if last <= begin_ns[k]:
            continue
        weight = np.exp((last - at_ns) * 1e-9 / lag_s) - np.exp((begin_ns[k] - at_ns) * 1e-9 / lag_s)
        for m in range(values.shape[1]):
            out[m] += weight * values[k, m]
    return out


@compiled
def look_ahead(  # noqa: PLR0917
    x: FloatArray, P: FloatArray, sums: FloatArray, span_s: float, places: IntArray, out: FloatArray
) -> None:
    """Height, velocity and their variances, (5, R), a span after a state x (n, R) with P (n, n, R).

    ``places`` are those of height, velocity, the two parts of the bias and, if they are states (six places), of the
    two tilts. Rows of ``out``: height, velocity, variance of height, covariance, variance of velocity.
    """
    n = len(places)
    row_h, row_v = np.zeros(n), np.zeros(n)
    row_h[0], row_h[1], row_v[1] = 1.0, span_s, 1.0
    row_h[2] = row_h[3] = -0.5 * span_s * span_s
    row_v[2] = row_v[3] = -span_s
    for m in range(x.shape[1]):
        if n > 4:
            row_h[4], row_h[5] = -sums[FORWARD_H, m], -sums[LEFT_H, m]
            row_v[4], row_v[5] = -sums[FORWARD_V, m], -sums[LEFT_V, m]
        h, v = sums[GAIN_H, m], sums[GAIN_V, m]
        hh, hv, vv = sums[Q_HH, m], sums[Q_HV, m], sums[Q_VV, m]
        for i in range(n):
            h += row_h[i] * x[places[i], m]
            v += row_v[i] * x[places[i], m]
            for j in range(n):
                p = P[places[i], places[j], m]
                hh += row_h[i] * p * row_h[j]
                hv += row_h[i] * p * row_v[j]
                vv += row_v[i] * p * row_v[j]
        out[0, m], out[1, m], out[2, m], out[3, m], out[4, m] = h, v, hh, hv, vv


@compiled
def renew(
    x: FloatArray, P: FloatArray, place: int, mask: BoolArray, mean: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Forget one state of the masked members: a new mean (R,) and variance (R,), no covariance with the others."""
    x_new, P_new = x.copy(), P.copy()
    for m in range(x.shape[1]):
        if mask[m]:
            x_new[place, m] = mean[m]
            for i in range(x.shape[0]):
                P_new[place, i, m] = 0.0
                P_new[i, place, m] = 0.0
            P_new[place, place, m] = variance[m]
    return x_new, P_new


@compiled
def peak_of_three(before: FloatArray, now: FloatArray, after: FloatArray) -> FloatArray:
    """How far a value stands out from both its neighbours to the same side, (R,) with its sign; zero if it does not."""
    out = np.zeros(len(now))
    for m in range(len(now)):
        one, other = now[m] - before[m], now[m] - after[m]
        if one * other > 0.0:
            out[m] = one if abs(one) < abs(other) else other
    return out
