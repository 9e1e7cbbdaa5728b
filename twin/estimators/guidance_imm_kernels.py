"""How the modes of :mod:`twin.estimators.guidance_imm` move on, compiled; R members, each over a time of its own."""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import FloatArray

_STATES = 6
_SMALL_RAD = 1e-2
"""Below this angle the integrals of a rotation are their series."""


@compiled
def rates_of_turn(x: FloatArray, slow_m_s: float, fastest_rad_s: float) -> FloatArray:
    """Rate (R,) v x a / |v|^2 of states (R, 6), rad/s; bounded, and a slower vehicle counts as one of ``slow_m_s``."""
    rate = np.empty(len(x))
    for r in range(len(x)):
        square = max(x[r, 2] ** 2 + x[r, 3] ** 2, slow_m_s**2)
        turned = (x[r, 2] * x[r, 5] - x[r, 3] * x[r, 4]) / square
        rate[r] = min(max(turned, -fastest_rad_s), fastest_rad_s)
    return rate


@compiled
def turning_transition(dt_s: FloatArray, rate: FloatArray) -> FloatArray:
    """Transition (R, 6, 6) of a vehicle whose acceleration turns at ``rate`` (R,): once and twice the integral of a
    rotation.
    """
    F = np.zeros((len(dt_s), _STATES, _STATES))
    for r in range(len(dt_s)):
        dt, angle = dt_s[r], rate[r] * dt_s[r]
        square, cosine, sine = angle * angle, np.cos(angle), np.sin(angle)
        if abs(angle) < _SMALL_RAD:
            sinc = 1.0 - square / 6.0 * (1.0 - square / 20.0)  # sin z / z
            half = 0.5 - square / 24.0 * (1.0 - square / 30.0)
            third = angle / 6.0 * (1.0 - square / 20.0)
        else:
            sinc, half, third = sine / angle, (1.0 - cosine) / square, (angle - sine) / square
        for axis in range(_STATES):
            F[r, axis, axis] = 1.0
        for axis in range(2):
            F[r, axis, 2 + axis] = dt
            F[r, axis, 4 + axis] = dt * dt * half
            F[r, 2 + axis, 4 + axis] = dt * sinc
            F[r, 4 + axis, 4 + axis] = cosine
        for block, across in ((0, dt * dt * third), (2, dt * angle * half), (4, sine)):
            F[r, block, 5], F[r, block + 1, 4] = -across, across
    return F


@compiled
def modes_motion(  # noqa: PLR0917 - compiled functions are called by position
    dt_s: FloatArray,
    rate: FloatArray,
    common: FloatArray,
    straight: float,
    curve: float,
    turning: float,
    common_s: float,
    leave: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """F and Q (2, R, 6, 6) of straight and curve, and M (R, 2, 2), over intervals ``dt_s`` (R,).

    Args:
        dt_s: nothing changes over none.
        rate: (R,) of turn in a curve.
        common: (R, 2) variances of the errors that fixes have in common, which wander within ``common_s``.
        straight: density of the acceleration on straights.
        curve: density of the jerk in curves.
        turning: variance of the acceleration of who enters a curve.
        leave: (2,) rates at which the two modes are left, 1/s.
    """
    runs = len(dt_s)
    F, Q, M = np.zeros((2, runs, _STATES, _STATES)), np.zeros((2, runs, _STATES, _STATES)), np.empty((runs, 2, 2))
    F[1] = turning_transition(dt_s, rate)
    total = leave[0] + leave[1]
    for r in range(runs):
        dt = dt_s[r]
        for axis in range(2):
            p, v, a = axis, 2 + axis, 4 + axis
            F[0, r, p, p] = F[0, r, v, v] = 1.0
            F[0, r, p, v] = dt
            wander = 2.0 * common[r, axis] * dt / common_s
            Q[0, r, p, p] = straight * dt**3 / 3.0 + wander
            Q[0, r, v, v] = straight * dt
            Q[0, r, p, v] = Q[0, r, v, p] = straight * dt**2 / 2.0
            Q[1, r, p, p] = curve * dt**5 / 20.0 + wander
            Q[1, r, v, v] = curve * dt**3 / 3.0
            Q[1, r, a, a] = curve * dt
            Q[1, r, p, v] = Q[1, r, v, p] = curve * dt**4 / 8.0
            Q[1, r, p, a] = Q[1, r, a, p] = curve * dt**3 / 6.0
            Q[1, r, v, a] = Q[1, r, a, v] = curve * dt**2 / 2.0
            if dt > 0.0:
                Q[0, r, a, a] = turning
            else:
                F[0, r, a, a] = 1.0
        gone = -np.expm1(-total * dt)
        for i in range(2):
            for j in range(2):
                same = 1.0 if i == j else 0.0
                M[r, i, j] = same + gone * (leave[1 - j] / total - same)
    return F, Q, M
