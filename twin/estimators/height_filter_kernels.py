"""Compiled loops of the height filter: what an AHRS tells over a span of time, and what that does to a state.

Arrays have the members last and contiguous, as in :mod:`twin.estimators.engine_kernels`; each member by itself.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import BoolArray, FloatArray, IntArray

GAIN_V, GAIN_H, FORWARD_V, FORWARD_H, LEFT_V, LEFT_H, Q_VV, Q_HV, Q_HH, EAST, NORTH, COSINE, SINE = range(13)
"""Rows of what :func:`compose` gives."""
SUMS = 13
TILT, OFFSET, OFFSET_SIGMA, BY_OFFSET, REST, CURVATURE, LEAN = 0, 2, 4, 6, 8, 10, 11
"""Rows of what is known of a tilt, forwards and to the left each, and their number."""


@compiled
def compose(begin_ns: IntArray, end_ns: IntArray, rows: FloatArray, from_ns: int, to_ns: int) -> FloatArray:
    """Integrals (13, R) of accelerations that are constant in each of K intervals, from ``from_ns`` to ``to_ns``.

    ``rows`` (6 or more, K, R): acceleration upwards, density of its white error ((m/s^2)^2 s), acceleration eastwards
    and northwards (m/s^2), cosine and sine of the heading. What comes out: gain of velocity and of height; the same of
    the accelerations forwards and to the left; variance of velocity, its covariance with height, variance of height;
    gain of velocity eastwards and northwards; integrals of cosine and sine.
    """
    out = np.zeros((SUMS, rows.shape[2]))
    for k in range(len(begin_ns)):
        first, last = max(begin_ns[k], from_ns), min(end_ns[k], to_ns)
        if last <= first:
            continue
        d = (last - first) * 1e-9
        lever = (to_ns - last) * 1e-9 + 0.5 * d
        square = lever * lever + d * d / 12.0
        for m in range(rows.shape[2]):
            up, east, north = rows[0, k, m] * d, rows[2, k, m] * d, rows[3, k, m] * d
            cosine, sine = rows[4, k, m], rows[5, k, m]
            forward, left = east * cosine + north * sine, north * cosine - east * sine
            out[GAIN_V, m] += up
            out[GAIN_H, m] += up * lever
            out[FORWARD_V, m] += forward
            out[FORWARD_H, m] += forward * lever
            out[LEFT_V, m] += left
            out[LEFT_H, m] += left * lever
            q = rows[1, k, m] * d
            out[Q_VV, m] += q
            out[Q_HV, m] += q * lever
            out[Q_HH, m] += q * square
            out[EAST, m] += east
            out[NORTH, m] += north
            out[COSINE, m] += cosine * d
            out[SINE, m] += sine * d
    return out


@compiled
def lagged(begin_ns: IntArray, end_ns: IntArray, values: FloatArray, at_ns: int, lag_s: float) -> FloatArray:
    """Values (J, K, R), each constant in its interval, as a first-order lag shows them at ``at_ns``, (J, R).

    What was before the first interval is left out.
    """
    out = np.zeros((values.shape[0], values.shape[2]))
    for k in range(len(begin_ns)):
        last = min(end_ns[k], at_ns)
        if last <= begin_ns[k]:
            continue
        weight = np.exp((last - at_ns) * 1e-9 / lag_s) - np.exp((begin_ns[k] - at_ns) * 1e-9 / lag_s)
        for j in range(values.shape[0]):
            for m in range(values.shape[2]):
                out[j, m] += weight * values[j, k, m]
    return out


@compiled
def rise(  # noqa: PLR0917 - compiled functions are called by position
    x: FloatArray, sums: FloatArray, span_s: float, lean: FloatArray, leak: int, tilt: int, gravity: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Height and velocity a span after a state x (n, R), (2, R), their Jacobian (2, n, R), and a density (R,).

    ``leak`` and ``tilt`` are the places of these states, or -1. ``lean`` (11, R) is what is known of the tilt: see
    :class:`twin.estimators.height_filter_tilt.LevelFilter`. The density is that of what it leaves.
    """
    n, runs = x.shape
    mean, rows, density = np.empty((2, runs)), np.zeros((2, n, runs)), np.zeros(runs)
    half = 0.5 * span_s * span_s
    for m in range(runs):
        bias = x[2, m] + x[3, m]
        rows[0, 0, m], rows[0, 1, m], rows[1, 1, m] = 1.0, span_s, 1.0
        rows[0, 2, m], rows[0, 3, m], rows[1, 2, m], rows[1, 3, m] = -half, -half, -span_s, -span_s
        if leak >= 0:
            bias += x[leak, m]
            rows[0, leak, m], rows[1, leak, m] = -half, -span_s
        h = x[0, m] + span_s * x[1, m] + sums[GAIN_H, m] - half * bias
        v = x[1, m] + sums[GAIN_V, m] - span_s * bias
        if tilt >= 0:
            v += lean[CURVATURE, m] * span_s
            h += lean[CURVATURE, m] * half
            for side in range(2):
                t, b, sigma = lean[TILT + side, m], lean[OFFSET + side, m], lean[OFFSET_SIGMA + side, m]
                felt_v = sums[FORWARD_V + 2 * side, m] - b * span_s
                felt_h = sums[FORWARD_H + 2 * side, m] - b * half
                v -= t * felt_v + 0.5 * gravity * t * t * span_s
                h -= t * felt_h + 0.5 * gravity * t * t * half
                true_v, true_h = felt_v + gravity * t * span_s, felt_h + gravity * t * half
                by_offset = lean[BY_OFFSET + side, m]
                rows[1, tilt + side, m] = sigma * (t * span_s - by_offset * true_v)
                rows[0, tilt + side, m] = sigma * (t * half - by_offset * true_h)
                if span_s > 0.0:
                    density[m] += lean[REST + side, m] * (true_v / span_s) ** 2
        mean[0, m], mean[1, m] = h, v
    return mean, rows, density


@compiled
def spread(rows: FloatArray, P: FloatArray, noise: FloatArray) -> FloatArray:
    """Variance of height, covariance, variance of velocity, (3, R): what ``noise`` (3, R) adds to the Jacobian's
    (2, n, R) share of P (n, n, R)."""
    out = noise.copy()
    for i in range(P.shape[0]):
        if not (rows[0, i] != 0.0).any():
            continue
        for j in range(P.shape[0]):
            for m in range(P.shape[2]):
                p = P[i, j, m]
                out[0, m] += rows[0, i, m] * p * rows[0, j, m]
                out[1, m] += rows[0, i, m] * p * rows[1, j, m]
                out[2, m] += rows[1, i, m] * p * rows[1, j, m]
    return out


@compiled
def renew(  # noqa: PLR0917
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
def both_say(one: FloatArray, other: FloatArray) -> FloatArray:
    """The smaller of two deviations (R,) that have the same sign, with it; zero where their signs differ."""
    out = np.zeros(len(one))
    for m in range(len(one)):
        if one[m] * other[m] > 0.0:
            out[m] = one[m] if abs(one[m]) < abs(other[m]) else other[m]
    return out


@compiled
def judge(  # noqa: PLR0917
    evidence: FloatArray, off: FloatArray, usual: FloatArray, shock: FloatArray, probability: float, outlier: float
) -> FloatArray:
    """Bayes' rule for samples that stand out by ``evidence`` (R,), (3, R): the outlier in each as is to be expected,
    the variance that it leaves, and how likely it is one.

    ``off`` (R,) is how far the sample is from where its neighbours want it, which genuine samples are with a mean
    square ``usual`` (R,); outliers of the variance ``outlier`` come with a ``probability``, true shocks of 1 m/s^2 with
    another, ``shock`` (R,).
    """
    out = np.empty((3, len(off)))
    for m in range(len(off)):
        square, wide = 0.5 * evidence[m] * evidence[m], usual[m] + outlier
        # against a genuine sample
        odds = probability * np.sqrt(usual[m] / wide) * np.exp(min(square * (1.0 / usual[m] - 1.0 / wide), 300.0))
        others = shock[m] * np.sqrt(usual[m]) * np.exp(min(square * max(1.0 / usual[m] - 1.0, 0.0), 300.0))
        likely = odds / (1.0 + odds + others)
        share = outlier / wide
        expected = likely * share * off[m]
        variance = likely * (share * usual[m] + (share * off[m]) ** 2) - expected * expected
        out[0, m], out[1, m], out[2, m] = expected, max(variance, 0.0), likely
    return out
