"""The driven track as a line that points are measured against, near where the machine was.

The line joins the true poses; poses closer together than two centimetres are left out, so that a bump or a standing
machine gives it no corners. Where the track crosses itself, or a second pass runs a row's width beside the first, only
that part of it counts that was driven shortly before and after: from the true place the nearest one is sought along the
track, as long as it comes nearer, and no farther than the machine got in the time window. Beyond the window's ends, and
beyond those of the track, the line goes on straight.
"""

from __future__ import annotations

import math

import numpy as np

from twin.recording import Stream
from twin.scoring.feet import seek
from twin.signals import HEADING, NS_PER_S, POSITION, FloatArray, IntArray

WINDOW_NS = 30 * NS_PER_S
"""How long before and after an instant the track counts."""
_STEP_M = 0.02
"""Least distance between points of the track, and half the largest where poses are closer: an arc of one metre's radius
leaves such a chord by 0.04^2 / 8 m, a fifth of a millimetre."""


class DrivenTrack:
    """The true track of a machine, fed in pieces of the truth (R = 1)."""

    def __init__(self) -> None:
        self._east: list[float] = []
        self._north: list[float] = []
        self._reached_ns: list[int] = []
        self._heading: list[float] = []
        self._points: FloatArray = np.zeros((0, 3))
        """(N, 3) east, north and the machine's heading."""
        self._times: IntArray = np.zeros(0, dtype=np.int64)
        self.until_ns = -1
        """Time of the last pose."""

    def add(self, truth: Stream) -> None:
        """Take the poses that are later than those known."""
        first = int(np.searchsorted(truth.t_ns, self.until_ns, side="right"))
        if first >= len(truth):
            return
        east, north = (truth.column(column)[first:, 0].tolist() for column in POSITION[:2])
        heading = truth.column(HEADING)[first:, 0].tolist() if truth.has(HEADING) else [math.nan] * len(east)
        before = len(self._east)
        for t_ns, e, n, course in zip(truth.t_ns[first:].tolist(), east, north, heading, strict=True):
            if not self._east or math.hypot(e - self._east[-1], n - self._north[-1]) >= _STEP_M:
                self._east.append(e)
                self._north.append(n)
                self._heading.append(course)
                self._reached_ns.append(t_ns)
        self.until_ns = int(truth.t_ns[-1])
        if len(self._east) > before:
            self._points = _with_courses(np.column_stack([self._east, self._north, self._heading]))
            self._times = np.array(self._reached_ns, dtype=np.int64)

    @property
    def moved(self) -> bool:
        """Whether there is a line yet."""
        return len(self._points) > 1

    def covers(self, t_ns: IntArray) -> int:
        """How many of these times (T,), in rising order, have the track known to the end of their window."""
        return int(np.searchsorted(t_ns, self.until_ns - WINDOW_NS, side="right")) if self.moved else 0

    def offsets(self, t_ns: IntArray, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offsets (T, R) of points (T, R, 2) to the left of the track at times (T,), m, and its course there, rad.

        NaN of unknown points, and of all if the machine never moved and has no heading.
        """
        if not self.moved:
            return self._beside_the_start(points_m)
        spans = np.column_stack([self._segment(t) for t in (t_ns, t_ns - WINDOW_NS, t_ns + WINDOW_NS)])
        found = np.empty(points_m.shape)
        seek(np.ascontiguousarray(points_m), spans, self._points, found)
        return found[..., 0], found[..., 1]

    def _beside_the_start(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        east, north, heading = self._points[0] if len(self._points) else np.full(3, math.nan)
        offset = (points_m[..., 1] - north) * math.cos(heading) - (points_m[..., 0] - east) * math.sin(heading)
        return offset, np.full(points_m.shape[:-1], heading)

    def _segment(self, t_ns: IntArray) -> IntArray:
        """Segment that ends at the last point reached by these times (T,); before the second point, the first."""
        reached: IntArray = np.searchsorted(self._times, t_ns, side="right") - 1
        return np.maximum(reached - 1, 0)


def _with_courses(points: FloatArray) -> FloatArray:
    """Points (N, 3) of a track; where no heading is known, that of the way from the point before."""
    if len(points) > 1 and np.isnan(points[:, 2]).any():
        step = np.diff(points[:, :2], axis=0)
        course = np.arctan2(step[:, 1], step[:, 0])
        points[:, 2] = np.where(np.isnan(points[:, 2]), np.insert(course, 0, course[0]), points[:, 2])
    return points
