"""The loop that seeks the nearest places on a driven track, compiled."""

from __future__ import annotations

import math

from twin.compiled import compiled
from twin.signals import FloatArray, IntArray

Beside = tuple[float, float, float, float]
"""Offset (m), east and north part of the course's unit vector, length (m)."""
Spans = tuple[int, int, int]
"""Segment at which a search begins, first and last segment that it may look at."""
_LOOK_M = 0.5
"""How far the search goes on along the track without coming nearer: over what bumps do to a slow machine's course."""


@compiled
def _beside(segment: int, spans: Spans, point: tuple[float, float], track: FloatArray) -> Beside:
    """Offset of a point to the left of a segment (its distance, if the foot is beyond an end), course and length.

    Before the first segment and beyond the last the line goes on along the heading.
    """
    length = math.hypot(track[segment + 1, 0] - track[segment, 0], track[segment + 1, 1] - track[segment, 1])
    east = (track[segment + 1, 0] - track[segment, 0]) / length
    north = (track[segment + 1, 1] - track[segment, 1]) / length
    away_e, away_n = point[0] - track[segment, 0], point[1] - track[segment, 1]
    forward = away_e * east + away_n * north
    left = away_n * east - away_e * north
    beyond = max(forward - length, -forward, 0.0)
    if beyond == 0.0:
        return left, east, north, length
    end = segment + 1 if forward > 0.0 else segment
    if end == spans[1] or end == spans[2] + 1:
        east, north = math.cos(track[end, 2]), math.sin(track[end, 2])
        return (point[1] - track[end, 1]) * east - (point[0] - track[end, 0]) * north, east, north, length
    return math.copysign(math.hypot(left, beyond), left), east, north, length


@compiled
def _walk(spans: Spans, point: tuple[float, float], track: FloatArray) -> Beside:
    """What is beside the nearest segment, both ways along the track for as long as they come nearer."""
    best = _beside(spans[0], spans, point, track)
    for step in (1, -1):
        segment, since = spans[0] + step, 0.0
        while spans[1] <= segment <= spans[2] and since < _LOOK_M:
            here = _beside(segment, spans, point, track)
            since += here[3]
            if abs(here[0]) < abs(best[0]):
                best, since = here, 0.0
            segment += step
    return best


@compiled
def seek(points: FloatArray, spans: IntArray, track: FloatArray, found: FloatArray) -> None:
    """Offsets of points to the left of a track, m, and its course there, rad.

    Args:
        points: (T, R, 2) east and north.
        spans: (T, 3) segment at which each row's search begins, first and last segment that it may look at.
        track: (N, 3) points of the track, N > 1, none like the one before, and the machine's heading there.
        found: (T, R, 2) offset and course; NaN of points that are not known.
    """
    for row in range(points.shape[0]):
        begin = (spans[row, 0], spans[row, 1], spans[row, 2])
        for run in range(points.shape[1]):
            east, north = points[row, run, 0], points[row, run, 1]
            if math.isnan(east) or math.isnan(north):
                found[row, run] = math.nan
            else:
                best = _walk(begin, (east, north), track)
                found[row, run, 0], found[row, run, 1] = best[0], math.atan2(best[2], best[1])
