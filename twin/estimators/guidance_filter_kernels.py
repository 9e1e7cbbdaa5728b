"""Model and output of the guidance filter (:mod:`twin.estimators.guidance_filter_model`), compiled.

Arrays are float64; states x (R, n) are contiguous, what comes out has the members last. ``places`` are those of
:attr:`twin.estimators.guidance_filter_model.Layout.places`, -1 for a state that is missing.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.geometry import turned
from twin.signals import BoolArray, FloatArray, IntArray

_turned = compiled(turned)
_E, _N, _PSI, _B, _V = range(5)
SCALE, GYRO_SCALE, STEERING, SLOW, OTHER, JUMP, DRIFT, ANCHOR = range(8)
"""Order of the places."""
HEADING_WALK, BIAS_WALK, TURN, TURN_S, ACCELERATION, SLIP, SLIP_S, SCALE_WALK, WALK = range(9)
"""Order of the machine's noises, the fields of :class:`twin.estimators.guidance_filter_model.MotionNoise`."""
SLOW_M, SLOW_S, OTHER_M, OTHER_S, JUMP_M, JUMP_S, DRIFT_S = range(7)
"""Rows of the receiver's noises (7, R)."""


@compiled
def _keeps(  # noqa: PLR0917 - compiled functions are called by position
    noise: FloatArray, receiver: FloatArray, m: int, dt_s: float, has_rate: bool, rate_known: bool, speed_known: bool
) -> tuple[float, float, float, float, float, float]:
    """What a span leaves of member m's rate, slip, slow, other, jump and drift."""
    rate = 1.0 if rate_known or has_rate else np.exp(-dt_s / noise[TURN_S])
    slip = np.exp(-dt_s / noise[SLIP_S]) if speed_known else 1.0
    slow, other = np.exp(-dt_s / receiver[SLOW_S, m]), np.exp(-dt_s / receiver[OTHER_S, m])
    jump, drift = np.exp(-dt_s / receiver[JUMP_S, m]), np.exp(-dt_s / receiver[DRIFT_S, m])
    return rate, slip, slow, other, jump, drift


@compiled
def span_transition(  # noqa: PLR0917
    x: FloatArray,
    places: IntArray,
    noise: FloatArray,
    receiver: FloatArray,
    dt_s: float,
    has_rate: bool,
    means: FloatArray,
    known: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """State (n, R) after a span, and the Jacobian (n, n, R).

    ``means`` (3, R) are told rate, told speed and the share of the rate that counts, ``known`` (3, R) whether rate and
    speed are known and whether the machine stands.
    """
    runs, n = x.shape
    moved, F = np.empty((n, runs)), np.zeros((n, n, runs))
    for m in range(runs):
        rate, speed, share, stands = means[0, m], means[1, m], means[2, m], known[2, m]
        for i in range(n):
            moved[i, m] = x[m, i]
            F[i, i, m] = 1.0
        k = x[m, places[SCALE]] if places[SCALE] >= 0 else 0.0
        g = x[m, places[GYRO_SCALE]] if places[GYRO_SCALE] >= 0 else 0.0
        turned = share * dt_s * (rate * (1.0 + g) - x[m, _B])
        step = 0.0 if stands else dt_s
        way = step * (speed * (1.0 + k) + x[m, _V])
        half = 0.5 * turned
        chord = way * np.sin(half) / half if half != 0.0 else way
        cosine, sine = np.cos(x[m, _PSI] + half), np.sin(x[m, _PSI] + half)
        moved[_E, m] += chord * cosine
        moved[_N, m] += chord * sine
        moved[_PSI, m] += turned
        east, north = -chord * sine, chord * cosine
        F[_E, _PSI, m], F[_N, _PSI, m] = east, north
        F[_E, _V, m], F[_N, _V, m] = step * cosine, step * sine
        if places[SCALE] >= 0:
            F[_E, places[SCALE], m], F[_N, places[SCALE], m] = step * speed * cosine, step * speed * sine
        # what a change of the rate does: the heading turns, the chord by half of it
        by_bias = -dt_s * share
        F[_PSI, _B, m], F[_E, _B, m], F[_N, _B, m] = by_bias, 0.5 * east * by_bias, 0.5 * north * by_bias
        if places[GYRO_SCALE] >= 0:
            by_scale, place = dt_s * share * rate, places[GYRO_SCALE]
            F[_PSI, place, m] = by_scale
            F[_E, place, m], F[_N, place, m] = 0.5 * east * by_scale, 0.5 * north * by_scale
        by_rate, slip, slow, other, jump, drift = _keeps(noise, receiver, m, dt_s, has_rate, known[0, m], known[1, m])
        moved[_B, m] *= by_rate
        F[_B, _B, m] = by_rate
        moved[_V, m] *= slip
        F[_V, _V, m] = slip
        errors = ((places[SLOW], slow), (places[OTHER], other), (places[JUMP], jump), (places[DRIFT], drift))
        for first, keep in errors:
            if first >= 0:
                for place in range(first, first + 2):
                    moved[place, m] *= keep
                    F[place, place, m] = keep
    return moved, F


@compiled
def span_noise(  # noqa: PLR0917
    n: int,
    places: IntArray,
    noise: FloatArray,
    receiver: FloatArray,
    dt_s: float,
    has_rate: bool,
    means: FloatArray,
    known: BoolArray,
) -> FloatArray:
    """Process noise of a span, (n, n, R); arguments as those of :func:`span_transition`."""
    runs = means.shape[1]
    Q = np.zeros((n, n, runs))
    for m in range(runs):
        speed, moves = abs(means[1, m]), not known[2, m]
        by_rate, slip, slow, other, jump, drift = _keeps(noise, receiver, m, dt_s, has_rate, known[0, m], known[1, m])
        if moves:
            Q[_E, _E, m] = Q[_N, _N, m] = noise[WALK] ** 2 * dt_s * max(speed, 0.1)
            silent = noise[TURN] ** 2 * 2.0 * noise[TURN_S] if has_rate else 0.0
            Q[_PSI, _PSI, m] = (noise[HEADING_WALK] ** 2 if known[0, m] else silent) * dt_s
            if places[SCALE] >= 0:
                Q[places[SCALE], places[SCALE], m] = noise[SCALE_WALK] ** 2 * dt_s
        if has_rate:
            Q[_B, _B, m] = noise[BIAS_WALK] ** 2 * dt_s
        else:  # the rate of turn changes all the time, not at the end of a span
            change, turns = noise[TURN] ** 2 * (1.0 - by_rate**2), -dt_s * means[2, m]
            Q[_B, _B, m] = change
            Q[_PSI, _PSI, m] += change * turns**2 / 3.0
            Q[_PSI, _B, m] = Q[_B, _PSI, m] = change * turns / 2.0
        walked = noise[ACCELERATION] ** 2 * dt_s
        Q[_V, _V, m] = (noise[SLIP] * speed) ** 2 * (1.0 - slip**2) if known[1, m] else walked
        for first, variance in (
            (places[SLOW], receiver[SLOW_M, m] ** 2 * (1.0 - slow**2)),
            (places[OTHER], receiver[OTHER_M, m] ** 2 * (1.0 - other**2)),
            (places[JUMP], receiver[JUMP_M, m] ** 2 * (1.0 - jump**2)),
            (places[DRIFT], 1.0 - drift**2),
        ):
            if first >= 0:
                Q[first, first, m] = Q[first + 1, first + 1, m] = variance
    return Q


@compiled
def seen_antenna(
    x: FloatArray, places: IntArray, forward_m: float, left_m: float, drift_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Expected position of an antenna (2, R) and the Jacobian (2, n, R); ``drift_m`` (R,) is what D counts."""
    runs, n = x.shape
    seen, H = np.empty((2, runs)), np.zeros((2, n, runs))
    slow, jump, drift = places[SLOW], places[JUMP], places[DRIFT]
    for m in range(runs):
        east, north = _turned(forward_m, left_m, x[m, _PSI])
        seen[0, m], seen[1, m] = x[m, _E] + east + x[m, slow], x[m, _N] + north + x[m, slow + 1]
        H[0, _PSI, m], H[1, _PSI, m] = -north, east
        for axis in range(2):
            H[axis, axis, m] = H[axis, slow + axis, m] = 1.0
            if jump >= 0:
                seen[axis, m] += x[m, jump + axis]
                H[axis, jump + axis, m] = 1.0
            if drift >= 0:
                seen[axis, m] += drift_m[m] * x[m, drift + axis]
                H[axis, drift + axis, m] = drift_m[m]
    return seen, H


@compiled
def seen_velocity(  # noqa: PLR0917
    x: FloatArray,
    places: IntArray,
    means: FloatArray,
    standing: BoolArray,
    forward_m: float,
    left_m: float,
    lag_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Expected velocity (2, R) of the antenna behind a lag, and the Jacobian (2, n, R); ``means`` as those of
    :func:`span_transition`.
    """
    runs, n = x.shape
    seen, H = np.empty((2, runs)), np.zeros((2, n, runs))
    for m in range(runs):
        told, speed, share = means[0, m], means[1, m], means[2, m]
        k = x[m, places[SCALE]] if places[SCALE] >= 0 else 0.0
        g = x[m, places[GYRO_SCALE]] if places[GYRO_SCALE] >= 0 else 0.0
        moving = 0.0 if standing[m] else 1.0
        rate = share * (told * (1.0 + g) - x[m, _B])
        along, aside = moving * (speed * (1.0 + k) + x[m, _V]) - left_m * rate, forward_m * rate
        direction = x[m, _PSI] - lag_s * rate
        cosine, sine = np.cos(direction), np.sin(direction)
        east, north = along * cosine - aside * sine, along * sine + aside * cosine
        seen[0, m], seen[1, m] = east, north
        H[0, _PSI, m], H[1, _PSI, m] = -north, east
        H[0, _V, m], H[1, _V, m] = moving * cosine, moving * sine
        by_east = share * (-left_m * cosine - forward_m * sine + lag_s * north)
        by_north = share * (-left_m * sine + forward_m * cosine - lag_s * east)
        H[0, _B, m], H[1, _B, m] = -by_east, -by_north
        if places[SCALE] >= 0:
            H[0, places[SCALE], m], H[1, places[SCALE], m] = moving * cosine * speed, moving * sine * speed
        if places[GYRO_SCALE] >= 0:
            H[0, places[GYRO_SCALE], m], H[1, places[GYRO_SCALE], m] = by_east * told, by_north * told
    return seen, H


@compiled
def told_state(
    x: FloatArray, P: FloatArray, places: IntArray, speeds: FloatArray, standing: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """East, north, heading and speed (R, 4), their covariance (R, 4, 4), and relative variances (R, 2) of the position.

    P is (R, n, n), contiguous, ``speeds`` (R,) the told ones. With an anchor, the position is that of its frame.
    """
    runs, n = x.shape
    state, covariance, relative = np.empty((runs, 4)), np.empty((runs, 4, 4)), np.empty((runs, 2))
    scale, anchor = places[SCALE], places[ANCHOR]
    with_speed = np.empty(n)
    for m in range(runs):
        moving = 0.0 if standing[m] else 1.0
        k = x[m, scale] if scale >= 0 else 0.0
        state[m, :3] = x[m, :3]
        state[m, 3] = moving * (speeds[m] * (1.0 + k) + x[m, _V])
        variance = 0.0
        for i in range(n):
            with_speed[i] = moving * P[m, i, _V]
            if scale >= 0:
                with_speed[i] += moving * speeds[m] * P[m, i, scale]
        variance = moving * with_speed[_V]
        if scale >= 0:
            variance += moving * speeds[m] * with_speed[scale]
        for i in range(3):
            for j in range(3):
                covariance[m, i, j] = P[m, i, j]
            covariance[m, i, 3] = covariance[m, 3, i] = with_speed[i]
        covariance[m, 3, 3] = variance
        for i in range(2):
            relative[m, i] = P[m, i, i]
            if anchor >= 0:
                place = anchor + i
                relative[m, i] += 2.0 * P[m, i, place] + P[m, place, place]
                state[m, i] += x[m, place]
                for j in range(2):
                    covariance[m, i, j] += x[m, place] * x[m, anchor + j]
    return state, covariance, relative
