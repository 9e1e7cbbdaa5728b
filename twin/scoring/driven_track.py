"""The driven track as a line that points are measured against, near where the machine was.

The line joins the true poses; poses closer together than two centimetres are left out, so that a bump or a standing
machine gives it no corners. Where the track crosses itself, or a second pass runs a row's width beside the first, only
that part of it counts that was driven shortly before and after: from the true place the foot of the perpendicular is
sought along the track, as far as the machine got in the time window. Beyond the window's ends, and beyond those of the
track, the line goes on straight.
"""

from __future__ import annotations

import math

import numpy as np

from twin.recording import Stream
from twin.signals import HEADING, NS_PER_S, POSITION, BoolArray, FloatArray, IntArray

WINDOW_NS = 30 * NS_PER_S
"""How long before and after an instant the track counts."""
_STEP_M = 0.02
"""Least distance between points of the track, and half the largest where poses are closer: an arc of one metre's radius
leaves such a chord by 0.04^2 / 8 m, a fifth of a millimetre."""
_ROUNDS = 24
_CLOSE_M = 0.2 * _STEP_M
"""A foot that moves less than this is in its segment, or in one of the two beside."""
_LEAST_SLOPE = 0.25
_CURVATURE_REACH = 10
_NEIGHBOURS = (-1, 0, 1)


class DrivenTrack:
    """The true track of a machine, fed in pieces of the truth (R = 1)."""

    def __init__(self) -> None:
        self._east: list[float] = []
        self._north: list[float] = []
        self._reached_ns: list[int] = []
        self._heading_rad = math.nan
        self._points: FloatArray = np.zeros((0, 2))
        self._stations: FloatArray = np.zeros(0)
        self._times: IntArray = np.zeros(0, dtype=np.int64)
        self.until_ns = -1
        """Time of the last pose."""

    def add(self, truth: Stream) -> None:
        """Take the poses that are later than those known."""
        first = int(np.searchsorted(truth.t_ns, self.until_ns, side="right"))
        if first >= len(truth):
            return
        east, north = (truth.column(column)[first:, 0].tolist() for column in POSITION[:2])
        if not self._east and truth.has(HEADING):
            self._heading_rad = float(truth.column(HEADING)[first, 0])
        before = len(self._east)
        for t_ns, e, n in zip(truth.t_ns[first:].tolist(), east, north, strict=True):
            if not self._east or math.hypot(e - self._east[-1], n - self._north[-1]) >= _STEP_M:
                self._east.append(e)
                self._north.append(n)
                self._reached_ns.append(t_ns)
        self.until_ns = int(truth.t_ns[-1])
        if len(self._east) > before:
            self._points = np.column_stack([self._east, self._north])
            lengths = np.hypot(*np.diff(self._points, axis=0).T)
            self._stations = np.concatenate([[0.0], np.cumsum(lengths)])
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
        now, first, last = (self._reached(t) for t in (t_ns, t_ns - WINDOW_NS, t_ns + WINDOW_NS))
        known: BoolArray = np.isfinite(points_m[..., 0]) & np.isfinite(points_m[..., 1])
        points_m = np.where(known[..., np.newaxis], points_m, self._points[now])
        low, high = self._stations[first], self._stations[last]
        segments = self._segments_at(self._feet(points_m, self._stations[now], low, high))
        offset, course = self._nearest(points_m, segments, low, high)
        unknown = np.where(known, 0.0, np.nan)
        return offset + unknown, course + unknown

    def _beside_the_start(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        course = np.full(points_m.shape[:-1], self._heading_rad)
        start = np.array([self._east[0], self._north[0]]) if self._east else np.full(2, math.nan)
        away = points_m - start
        return away[..., 1] * np.cos(course) - away[..., 0] * np.sin(course), course

    def _reached(self, t_ns: IntArray) -> IntArray:
        """Last point of the track that was reached by these times (T,), (T, 1); before the first, the first."""
        found: IntArray = np.searchsorted(self._times, t_ns, side="right") - 1
        return np.maximum(found, 0)[:, np.newaxis]

    def _segments_at(self, stations: FloatArray) -> IntArray:
        """Segment that holds a station; at a point the one that ends there."""
        found = np.searchsorted(self._stations, stations, side="left") - 1
        return np.clip(found, 0, len(self._stations) - 2)

    def _courses(self, segments: IntArray) -> tuple[FloatArray, FloatArray]:
        """Unit vectors (..., 2) along segments, and their lengths."""
        step = self._points[segments + 1] - self._points[segments]
        length = self._stations[segments + 1] - self._stations[segments]
        return step / length[..., np.newaxis], length

    def _feet(self, points_m: FloatArray, start: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Stations (T, R) at which the line to a point is square to the track, sought from ``start`` (T, 1) on.

        Newton's method: at a station, the point lies ``ahead`` along the track and ``left`` of it, and a step along a
        track of curvature k brings it (1 - k left) nearer for each metre.
        """
        stations = np.broadcast_to(start, points_m.shape[:-1]).copy()
        seeks = np.ones(stations.shape, dtype=np.bool_)
        ends = self._segments_at(low), self._segments_at(high)
        for _ in range(_ROUNDS):
            segments = self._segments_at(stations)
            along, _ = self._courses(segments)
            forward, left = _in_axes(points_m - self._points[segments], along)
            ahead = forward - (stations - self._stations[segments])
            slope = np.maximum(1.0 - self._curvature(segments, *ends) * left, _LEAST_SLOPE)
            moved = np.where(seeks, np.clip(stations + ahead / slope, low, high) - stations, 0.0)
            stations += moved
            # each for itself, so that a member's figures are those of its own run
            seeks &= np.abs(moved) > _CLOSE_M
            if not seeks.any():
                break
        return stations

    def _curvature(self, segments: IntArray, first: IntArray, last: IntArray) -> FloatArray:
        """Of the track about a segment, from how courses differ over some segments either way, 1/m."""
        behind = np.maximum(segments - _CURVATURE_REACH, first)
        before = np.minimum(segments + _CURVATURE_REACH, last)
        ahead, left = _in_axes(self._courses(before)[0], self._courses(behind)[0])
        apart = self._stations[before] - self._stations[behind]
        return np.divide(np.arctan2(left, ahead), apart, out=np.zeros_like(left), where=apart > 0.0)

    def _nearest(
        self, points_m: FloatArray, segments: IntArray, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Offset from, and course of, the nearest of the segments about these; the outermost go on straight."""
        best = np.full(points_m.shape[:-1], np.inf)
        offset, course = np.zeros_like(best), np.zeros_like(best)
        first, last = self._segments_at(low), self._segments_at(high)
        for shift in _NEIGHBOURS:
            at = np.clip(segments + shift, first, last)
            along, length = self._courses(at)
            forward, left = _in_axes(points_m - self._points[at], along)
            beyond = np.where(at > first, np.maximum(-forward, 0.0), 0.0)
            beyond += np.where(at < last, np.maximum(forward - length, 0.0), 0.0)
            distance = np.hypot(left, beyond)
            nearer = distance < best - 1e-12
            best = np.where(nearer, distance, best)
            offset = np.where(nearer, np.copysign(distance, left), offset)
            course = np.where(nearer, np.arctan2(along[..., 1], along[..., 0]), course)
        return offset, course


def _in_axes(vectors: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parts of vectors (..., 2) along unit vectors (..., 2), and to the left of them."""
    forward = vectors[..., 0] * along[..., 0] + vectors[..., 1] * along[..., 1]
    return forward, vectors[..., 1] * along[..., 0] - vectors[..., 0] * along[..., 1]
