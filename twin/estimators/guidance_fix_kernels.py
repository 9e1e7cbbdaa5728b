"""What guidance filters do with every sample of a receiver and at every output, compiled; member after member."""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import BoolArray, FloatArray, IntArray

EAST, NORTH, SPEED, COURSE, SIGMA_E, SIGMA_N, QUALITY, HDOP, AGE = range(9)
"""Columns of a fix."""
COLUMNS = 9
_NS_PER_S = 1e9


@compiled
def read_fix(values: FloatArray, valid: BoolArray, places: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """A receiver's sample (R, n) as columns (9, R), its position (R, 2), and whether (R,) it has one.

    ``places`` (9,) are the columns' places, -1 for what the receiver does not tell (NaN). Speed and course of a sample
    that was lost are none, nor is a reported sigma of zero.
    """
    runs = len(values)
    columns, position = np.empty((COLUMNS, runs)), np.empty((runs, 2))
    there = np.empty(runs, dtype=np.bool_)
    for r in range(runs):
        for column in range(COLUMNS):
            columns[column, r] = values[r, places[column]] if places[column] >= 0 else np.nan
        if not valid[r]:
            columns[SPEED, r] = columns[COURSE, r] = np.nan
        for column in (SIGMA_E, SIGMA_N):
            if not columns[column, r] > 0.0:
                columns[column, r] = np.nan
        position[r, 0], position[r, 1] = columns[EAST, r], columns[NORTH, r]
        known = np.isfinite(position[r, 0]) and np.isfinite(position[r, 1])
        there[r] = known and valid[r] and columns[QUALITY, r] != 0.0
    return columns, position, there


@compiled
def motion_of(  # noqa: PLR0917 - compiled functions are called by position
    t_ns: int,
    position: FloatArray,
    there: BoolArray,
    told_speed: FloatArray,
    told_course: FloatArray,
    last_ns: IntArray,
    last: FloatArray,
    longest_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Speed and course (R,) as told, or of the way since the last position; that (``last``, ``last_ns``) is renewed."""
    runs = len(position)
    speed, course = np.empty(runs), np.empty(runs)
    for r in range(runs):
        east = north = np.nan
        dt_s = (t_ns - last_ns[r]) / _NS_PER_S
        if there[r]:
            if 0.0 < dt_s <= longest_s:
                east, north = (position[r, 0] - last[r, 0]) / dt_s, (position[r, 1] - last[r, 1]) / dt_s
            last[r, 0], last[r, 1], last_ns[r] = position[r, 0], position[r, 1], t_ns
        tells_speed, tells_course = np.isfinite(told_speed[r]), np.isfinite(told_course[r])
        speed[r] = told_speed[r] if tells_speed else np.hypot(east, north)
        course[r] = told_course[r] if tells_speed or tells_course else np.arctan2(north, east)
    return speed, course


@compiled
def row_of(
    state: FloatArray, sigmas: FloatArray, further: FloatArray, news: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A guidance filter's row (R, 4 + k + n) and its sigmas: state with sigmas (R, 4), headings wrapped into (-pi, pi];
    further columns (R, k), and news (R, n), which have none and are taken (NaN from then on).
    """
    runs, k, n = len(state), further.shape[1], news.shape[1]
    values, all_sigmas = np.empty((runs, 4 + k + n)), np.full((runs, 4 + k + n), np.nan)
    for r in range(runs):
        for i in range(4):
            values[r, i], all_sigmas[r, i] = state[r, i], sigmas[r, i]
        angle = state[r, 2]
        values[r, 2] = angle - 2.0 * np.pi * np.ceil((angle - np.pi) / (2.0 * np.pi))
        for i in range(k):
            values[r, 4 + i] = further[r, i]
        for i in range(n):
            values[r, 4 + k + i] = news[r, i]
            news[r, i] = np.nan
    return values, all_sigmas


@compiled
def roots_of_diagonal(covariance: FloatArray) -> FloatArray:
    """Sigmas (R, n) of a covariance (R, n, n); a variance below zero counts as zero."""
    runs, n = covariance.shape[:2]
    sigmas = np.empty((runs, n))
    for r in range(runs):
        for i in range(n):
            variance = covariance[r, i, i]
            sigmas[r, i] = 0.0 if variance < 0.0 else np.sqrt(variance)  # NaN stays
    return sigmas
