"""Fewer rows where more cannot be seen."""

from __future__ import annotations

import math

import numpy as np

from twin.signals import NS_PER_S, FloatArray, IntArray


def thin(t_ns: IntArray, max_hz: float) -> IntArray:
    """Indices of every k-th row so that the rate is at most ``max_hz``; the first and the last row stay.

    For things that change smoothly; states are never thinned.
    """
    count = len(t_ns)
    span_s = (int(t_ns[-1]) - int(t_ns[0])) / NS_PER_S if count > 1 else 0.0
    if span_s <= 0.0:
        return np.arange(count)
    step = max(1, math.ceil((count - 1) / span_s / max_hz - 1e-6))
    indices = np.arange(0, count, step)
    return indices if indices[-1] == count - 1 else np.append(indices, count - 1)


def changes(values: FloatArray) -> IntArray:
    """Indices where a sequence (T,) takes another value, the first included; NaN equals NaN."""
    if not len(values):
        return np.empty(0, dtype=np.int64)
    same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    return np.concatenate([[0], np.flatnonzero(~same) + 1])


def steps(values: FloatArray, least: float) -> IntArray:
    """Indices of the rows of (T, n) where a value reaches another multiple of ``least``; first and last row stay."""
    if not len(values):
        return np.empty(0, dtype=np.int64)
    rounded = np.round(values / least)
    moved = np.any(rounded[1:] != rounded[:-1], axis=1)
    moved[-1:] = True
    return np.concatenate([[0], np.flatnonzero(moved) + 1])


def spaced(points: FloatArray, step_m: float) -> IntArray:
    """Indices of the points (N, 2) that lie at least ``step_m`` from the one chosen before; NaN is passed over.

    So a machine that stands adds nothing to its trail.
    """
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    chosen: list[int] = []
    last_x = last_y = math.inf
    for index, (x, y) in zip(finite.tolist(), points[finite].tolist(), strict=True):
        if not chosen or math.hypot(x - last_x, y - last_y) >= step_m:
            chosen.append(index)
            last_x, last_y = x, y
    return np.array(chosen, dtype=np.int64)
