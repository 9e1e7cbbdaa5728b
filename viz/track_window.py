"""Parts of the plane that maps of a log's track show: all of it, and the place where there is most to see."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.recording import Stream
from twin.scoring.consistency import nis_columns
from twin.signals import POSITION, BoolArray, FloatArray
from viz import entities
from viz.sheet import Run

ALONE, BESIDE = 0.62, 1.15
"""Height of a map over its width: of one that has the window's left half to itself, and of one of two."""
_MARGIN = 0.07
_LEAST_M, CLOSE_M = 2.0, 1.5
"""Least width of a map, and least half width of a close-up."""
_SURROUND = 4.0
"""Half width of a close-up, in sizes of what is to be seen there."""
_OUTLIERS = 0.2
"""Per cent of the positions at either end that do not widen the map."""
_EAST, _NORTH = POSITION[:2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """A part of the plane: its middle and half widths, m."""

    east_m: float
    north_m: float
    half_e_m: float
    half_n_m: float

    @property
    def width(self) -> float:
        """From west to east."""
        return 2.0 * self.half_e_m

    @property
    def edges(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        return (
            self.east_m - self.half_e_m,
            self.north_m - self.half_n_m,
            self.east_m + self.half_e_m,
            self.north_m + self.half_n_m,
        )

    def inside(self, points: FloatArray) -> FloatArray:
        """Points (T, 2) of which those outside are NaN."""
        far = np.abs(points - (self.east_m, self.north_m)) > (self.half_e_m, self.half_n_m)
        return np.where(far.any(axis=1, keepdims=True), math.nan, points)

    def pieces(self, points: FloatArray) -> FloatArray:
        """The parts within the window of the lines between neighbours of points (T, 2), as (N, 2, 2).

        After Liang and Barsky (1984): along a line from 0 to 1, every edge it crosses bounds the part inside.
        """
        west, south, east, north = self.edges
        start, way = points[:-1], np.diff(points, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_low, to_high = ((west, south) - start) / way, ((east, north) - start) / way
        # What runs along an edge's direction is inside all the way, or never.
        beside = (way == 0.0) & ((start < (west, south)) | (start > (east, north)))
        first = np.where(way == 0.0, 0.0, np.minimum(to_low, to_high)).max(axis=1).clip(min=0.0)
        last = np.where(way == 0.0, 1.0, np.maximum(to_low, to_high)).min(axis=1).clip(max=1.0)
        kept = (first < last) & ~beside.any(axis=1)
        ends = [start[kept] + way[kept] * share[kept, np.newaxis] for share in (first, last)]
        return np.stack(ends, axis=1)


def points_of(run: Run, stream: Stream) -> FloatArray | None:
    """Positions (T, 2) of a stream; NaN where a sample was lost; None where it has none."""
    points = run.columns(stream, _EAST, _NORTH)
    if points is None or stream.valid is None:
        return points
    return np.where(stream.valid[:, :1], points, math.nan)


def known_rows(points: FloatArray) -> BoolArray:
    """Which of the points (T, 2) are known, (T,)."""
    known: BoolArray = np.logical_and.reduce(np.isfinite(points), axis=1)
    return known


def windows(run: Run) -> tuple[Window, tuple[Window, str] | None] | None:
    """The whole track, and a close-up with what is to be seen in it, if that is not nearly all there is.

    None where nothing has a position.
    """
    told = list(_places(run))
    if not told:
        return None
    points = np.concatenate(told)
    found = _largest_error(run) or _largest_surprise(run) or _largest_step(run)
    whole = _whole(points, BESIDE)
    if found is None or (half := max(_SURROUND * found[1], CLOSE_M)) > 0.4 * whole.half_e_m:
        return _whole(points, ALONE), None
    (east, north), _, what = found
    return whole, (Window(east_m=east, north_m=north, half_e_m=half, half_n_m=BESIDE * half), what)


def _whole(points: FloatArray, aspect: float) -> Window:
    """All positions but a few that lie far off, in the map's proportions."""
    low, high = np.percentile(points, [_OUTLIERS, 100.0 - _OUTLIERS], axis=0)
    half = np.maximum((0.5 + _MARGIN) * (high - low), 0.5 * _LEAST_M)
    half_e = max(float(half[0]), float(half[1]) / aspect)
    middle = 0.5 * (low + high)
    return Window(east_m=float(middle[0]), north_m=float(middle[1]), half_e_m=half_e, half_n_m=aspect * half_e)


def _places(run: Run) -> Iterator[FloatArray]:
    """Known positions (T, 2) of the receivers, or of the estimators where there is none."""
    receivers = [run.recording.measurements(name) for name in run.recording.names("measurements")]
    estimators = [run.recording.estimates(name) for name in run.estimators]
    for streams in (receivers, estimators):
        found = [points for stream in streams if (points := points_of(run, stream)) is not None]
        known = [points[known_rows(points)] for points in found]
        if any(len(points) for points in known):
            yield from known
            return


# --- where there is most to see --------------------------------------------------------------------------------------

_Found = tuple[tuple[float, float], float, str]
"""East and north, how large it is (m), and what it is."""


def _largest_error(run: Run) -> _Found | None:
    """Where the receiver (or an estimator, if there is none) is farthest from the reference."""
    with_errors = run.recording.names("errors")
    best: _Found | None = None
    for name in [name for name in with_errors if name not in run.estimators] or with_errors:
        told = run.recording.streams[f"errors/{name}"]
        errors = run.columns(told, "error_m")
        stream = run.recording.streams.get(f"estimates/{name}", run.recording.streams.get(f"measurements/{name}"))
        points = None if stream is None else points_of(run, stream)
        if errors is None or stream is None or points is None or not np.isfinite(errors).any():
            continue
        index = int(np.nanargmax(errors[:, 0]))
        place = points[int(np.argmin(np.abs(stream.t_ns - told.t_ns[index])))]
        size = float(errors[index, 0])
        if np.isfinite(place).all() and (best is None or size > best[1]):
            best = (float(place[0]), float(place[1])), size, f"{entities.legend_name(name)} {size:.2g} m off"
    return best


def _largest_surprise(run: Run) -> _Found | None:
    """Where a filter's position update was most unlikely."""
    best, most = None, 0.0
    for name in run.estimators:
        stream = run.recording.estimates(name)
        columns = [column for column in nis_columns(stream.columns) if column.endswith("position")]
        surprise = run.columns(stream, *columns) if columns else None
        points = points_of(run, stream)
        if surprise is None or points is None:
            continue
        value = np.where(known_rows(points), np.nan_to_num(surprise[:, 0]), 0.0)
        index = int(np.argmax(value))
        if value[index] > most:
            most = float(value[index])
            place = float(points[index, 0]), float(points[index, 1])
            best = place, CLOSE_M, f"{entities.legend_name(name)} most surprised"
    return best


def _largest_step(run: Run) -> _Found | None:
    """Where a receiver's position moved farthest from one row to the next."""
    for name in run.recording.names("measurements"):
        points = points_of(run, run.recording.measurements(name))
        if points is None or len(points) < 2:
            continue
        steps = np.nan_to_num(np.hypot(*np.diff(points, axis=0).T))
        index = int(np.argmax(steps))
        if steps[index] > 0.0:
            middle = 0.5 * (points[index] + points[index + 1])
            return (float(middle[0]), float(middle[1])), float(steps[index]), "largest step"
    return None
