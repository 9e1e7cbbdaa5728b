"""What the filters of paper 004 reckon at every fix and every output, compiled; member after member.

Arrays are float64 and contiguous, with the ensemble axis R first.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.geometry import turned
from twin.signals import BoolArray, FloatArray

_turned = compiled(turned)
_AXES = 3
_LEAST_M_S = 1e-3


@compiled
def axes_transition(dt_s: FloatArray) -> FloatArray:
    """Eqs 4 and 13 for all axes at once, (R, 9, 9), over ``dt_s`` (R,)."""
    F = np.zeros((len(dt_s), 3 * _AXES, 3 * _AXES))
    for r in range(len(dt_s)):
        dt = dt_s[r]
        for axis in range(_AXES):
            p, v, a = axis, _AXES + axis, 2 * _AXES + axis
            F[r, p, p] = F[r, v, v] = F[r, a, a] = 1.0
            F[r, p, v] = F[r, v, a] = dt
            F[r, p, a] = 0.5 * dt * dt
    return F


@compiled
def moved_axes(x: FloatArray, P: FloatArray, dt_s: FloatArray, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """State x (R, 9) and each axis' covariance (R, 3, 3, 3) after ``dt_s`` (R,).

    P (R, 9, 9) has no covariances between the axes; Q (R, 3, 3) is what one axis gathers.
    """
    runs = len(dt_s)
    moved, spread = np.empty_like(x), np.empty((runs, _AXES, 3, 3))
    F, half = np.eye(3), np.empty((3, 3))
    for r in range(runs):
        dt = dt_s[r]
        F[0, 1] = F[1, 2] = dt
        F[0, 2] = 0.5 * dt * dt
        for axis in range(_AXES):
            for i in range(3):
                total = 0.0
                for k in range(i, 3):
                    total += F[i, k] * x[r, _AXES * k + axis]
                moved[r, _AXES * i + axis] = total
                for j in range(3):
                    half[i, j] = 0.0
                    for k in range(i, 3):
                        half[i, j] += F[i, k] * P[r, _AXES * k + axis, _AXES * j + axis]
            for i in range(3):
                for j in range(3):
                    total = Q[r, i, j]
                    for k in range(j, 3):
                        total += half[i, k] * F[j, k]
                    spread[r, axis, i, j] = total
    return moved, spread


@compiled
def turned_antenna(  # noqa: PLR0917 - compiled functions are called by position
    velocity: FloatArray,
    acceleration: FloatArray,
    fast: BoolArray,
    held: FloatArray,
    forward: float,
    left: float,
    slow_m_s: float,
    tightest_1_m: float,
) -> tuple[FloatArray, FloatArray]:
    """Heading and speed (R,) of a machine whose antenna moves by ``velocity`` and ``acceleration`` (R, 2).

    Where ``fast`` (R,) is False, or the antenna is slower than ``slow_m_s``, the heading is ``held`` (R,).
    """
    runs = len(velocity)
    heading, speed = np.empty(runs), np.empty(runs)
    for r in range(runs):
        east, north = velocity[r, 0], velocity[r, 1]
        along = np.hypot(east, north)
        if not (fast[r] and along >= slow_m_s):
            heading[r], speed[r] = held[r], along
            continue
        omega = (east * acceleration[r, 1] - north * acceleration[r, 0]) / along**2
        omega = min(max(omega, -tightest_1_m * along), tightest_1_m * along)
        inwards = np.arcsin(min(max(omega * forward / along, -0.9), 0.9))
        angle = np.arctan2(north, east) - inwards
        heading[r] = angle - 2.0 * np.pi * np.ceil((angle - np.pi) / (2.0 * np.pi))
        speed[r] = along * np.cos(inwards) + omega * left
    return heading, speed


@compiled
def velocity_sigmas(velocity: FloatArray, P: FloatArray, speed: FloatArray) -> FloatArray:
    """Sigmas (R, 2) of heading and speed, of velocities (R, 2) with covariance P (R, 2, 2).

    NaN where a variance is negative.
    """
    sigmas = np.empty((len(velocity), 2))
    for r in range(len(velocity)):
        course = np.arctan2(velocity[r, 1], velocity[r, 0])
        cosine, sine = np.cos(course), np.sin(course)
        both = cosine * sine * (P[r, 0, 1] + P[r, 1, 0])
        across = sine * sine * P[r, 0, 0] - both + cosine * cosine * P[r, 1, 1]
        along = cosine * cosine * P[r, 0, 0] + both + sine * sine * P[r, 1, 1]
        sigmas[r, 1] = np.sqrt(along) if along >= 0.0 else np.nan
        sigmas[r, 0] = min(np.sqrt(across) / max(abs(speed[r]), _LEAST_M_S), np.pi) if across >= 0.0 else np.nan
    return sigmas


@compiled
def under_antenna(antenna: FloatArray, heading: FloatArray, arm: tuple[float, float, float]) -> FloatArray:
    """Position (R, 3) of the reference under an antenna (R, 3) that is ``arm`` forward, to the left and up of it."""
    place = np.empty_like(antenna)
    for r in range(len(antenna)):
        east, north = _turned(arm[0], arm[1], heading[r])
        place[r, 0], place[r, 1] = antenna[r, 0] - east, antenna[r, 1] - north
        place[r, 2] = antenna[r, 2] - arm[2]
    return place


PRINTED, STEP, CONTINUOUS = range(3)
"""Forms of the process noise."""


@compiled
def straight_noise(dt_s: FloatArray, variance: float, form: int) -> FloatArray:
    """Eq 11, printed, corrected or continuous: of one axis over ``dt_s`` (R,), (R, 3, 3)."""
    Q = np.zeros((len(dt_s), 3, 3))
    for r in range(len(dt_s)):
        dt = dt_s[r]
        if form == CONTINUOUS:
            Q[r, 0, 0], Q[r, 1, 1] = variance * dt**3 / 3.0, variance * dt
            Q[r, 0, 1] = Q[r, 1, 0] = variance * dt**2 / 2.0
        else:
            Q[r, 0, 0] = variance * dt**2
            Q[r, 0, 1] = Q[r, 1, 0] = variance * dt
            if form == STEP and dt > 0.0:
                Q[r, 1, 1] = variance
    return Q


@compiled
def curve_noise(dt_s: FloatArray, variance: float, form: int) -> FloatArray:
    """Eq 15, or continuous: of one axis over ``dt_s`` (R,), (R, 3, 3)."""
    Q, g = np.zeros((len(dt_s), 3, 3)), np.empty(3)
    for r in range(len(dt_s)):
        dt = dt_s[r]
        if form == CONTINUOUS:
            Q[r, 0, 0], Q[r, 1, 1], Q[r, 2, 2] = variance * dt**5 / 20.0, variance * dt**3 / 3.0, variance * dt
            Q[r, 0, 1] = Q[r, 1, 0] = variance * dt**4 / 8.0
            Q[r, 0, 2] = Q[r, 2, 0] = variance * dt**3 / 6.0
            Q[r, 1, 2] = Q[r, 2, 1] = variance * dt**2 / 2.0
        elif dt > 0.0:
            g[0], g[1], g[2] = 0.5 * dt**2, dt, 1.0
            for i in range(3):
                for j in range(3):
                    Q[r, i, j] = variance * (g[i] * g[j])
    return Q
