"""Where a blade cut, how high its edge was there, and how well that was known: the last of a member's passes.

A pass is a row of points, one every :data:`SPACING_M`. The blade's straight edge is as wide as wheels and more, so the
middle of its edge is the mean of what it left for the left and for the right wheel: whoever comes along the same line,
either way, has its rear axle on that. Points where the blade was at the ground but did not surely cut are kept as
void, since they spoil what was there before.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import BoolArray, FloatArray, IntArray

SPACING_M = 0.3
_POINTS = 2500
"""The last 750 m."""
_EAST, _NORTH, _COSINE, _SINE, HEIGHT, VARIANCE, POINT = range(7)
"""Columns of a point: place of the edge's middle, direction, height (NaN: void) and its variance; their number."""
_RADIUS_M = 0.32
"""As far as a point reaches: half of what a tyre stands on, and a third of a wheel's width beside it at most."""
_LARGEST_ANGLE = 0.17
"""Sine of the angle between two passes that are along one line, 10 degrees."""
_PASS_NS = 3_000_000_000
_YOUNGEST_NS = 20_000_000_000
"""What was cut less long ago is no news: the fix still has the error that it had."""


class SurfaceMap:
    """Points of R members, the oldest of which are forgotten when there are too many."""

    def __init__(self, runs: int, *, points: int = _POINTS) -> None:
        self._points: FloatArray = np.full((runs, points, POINT), np.nan)
        self._t_ns: IntArray = np.full((runs, points), -(2**62), dtype=np.int64)
        self._next: IntArray = np.zeros(runs, dtype=np.int64)
        self._count: IntArray = np.zeros(runs, dtype=np.int64)

    def add(self, t_ns: int, points: FloatArray, members: BoolArray) -> None:
        """Take a point (R, 6) of some members."""
        which = np.flatnonzero(members)
        place = self._next[which]
        self._points[which, place], self._t_ns[which, place] = points[which], t_ns
        self._next[which] = (place + 1) % self._points.shape[1]
        self._count[which] = np.minimum(self._count[which] + 1, self._points.shape[1])

    def find(self, t_ns: int, place: FloatArray, direction: FloatArray, since_ns: IntArray) -> FloatArray:
        """(3, R) height and variance of what the last pass since ``since_ns`` (R,) left at a place (2, R), and how long
        (s) ago; NaN where there was none along the direction (2, R), or one that did not surely cut."""
        where = np.concatenate([place, direction])
        return _find(self._points, self._t_ns, self._next, self._count, t_ns, where, since_ns)


@compiled
def _find(  # noqa: PLR0917 - compiled functions are called by position
    points: FloatArray,
    t_ns: IntArray,
    after: IntArray,
    count: IntArray,
    now_ns: int,
    where: FloatArray,
    since_ns: IntArray,
) -> FloatArray:
    size = points.shape[1]
    out = np.full((3, points.shape[0]), np.nan)
    for m in range(points.shape[0]):
        east, north, cosine, sine = where[0, m], where[1, m], where[2, m], where[3, m]
        if not np.isfinite(east + north + cosine + sine):
            continue
        found, begun, void = 0, 0, False
        height = variance = age = 0.0
        for back in range(count[m]):
            k = (after[m] - 1 - back) % size
            if t_ns[m, k] < since_ns[m] or (found > 0 and begun - t_ns[m, k] > _PASS_NS):
                break
            point = points[m, k]
            if (point[_EAST] - east) ** 2 + (point[_NORTH] - north) ** 2 > _RADIUS_M**2:
                continue
            across = abs(point[_SINE] * cosine - point[_COSINE] * sine) > _LARGEST_ANGLE
            if across or not np.isfinite(point[HEIGHT]) or now_ns - t_ns[m, k] < _YOUNGEST_NS:
                void = True
                break
            begun = t_ns[m, k] if found == 0 else begun
            found += 1
            height += point[HEIGHT]
            variance += point[VARIANCE]
            age += (now_ns - t_ns[m, k]) * 1e-9
        if found > 0 and not void:
            out[0, m], out[1, m], out[2, m] = height / found, variance / found, age / found
    return out
