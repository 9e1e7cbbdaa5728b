"""What each estimator believed: its trail, its pose, its row units and how sure it was."""

from __future__ import annotations

import math

import numpy as np
import rerun as rr

from twin.recording import Stream, covariance_column
from twin.signals import HEADING, POSITION, FloatArray, IntArray, row_position
from viz import entities
from viz.layers.trails import draw_trail
from viz.sheet import Run, Sheet
from viz.thinning import thin

MARKER_HZ = 25.0
CHI2_95_2DOF = -2.0 * math.log(0.05)
"""95 % quantile of chi-square with two degrees of freedom: 5.991."""
SMALLEST_M = 0.2
"""Ellipses are drawn with at least this half axis, or RTK's could not be seen."""

_LIFT_M = 0.12
_ARROW, _MARKER_RADIUS = 0.19, 0.005
"""Length of the arrow, and half the thickness of arrow and bar, as shares of the machine's size."""
_EAST, _NORTH = POSITION[:2]


def draw_estimates(run: Run, sheet: Sheet) -> None:
    """Draw every estimator that says where it is."""
    for name in run.estimators:
        stream = run.recording.estimates(name)
        colour = run.colours[name]
        if run.columns(stream, _EAST, _NORTH) is None:
            continue
        rows = [row for row in run.scene.outer_rows if all(stream.has(column) for column in row_position(row))]
        trails = {entities.estimated_row_trail(name, row): row_position(row) for row in rows}
        for entity, columns in (trails or {entities.estimated_trail(name): (_EAST, _NORTH)}).items():
            draw_trail(run, sheet, entity=entity, stream=stream, columns=columns, colour=colour, width=1.5)
        _draw_pose(run, sheet, name, stream)
        _draw_rows(run, sheet, name, stream, rows)
        _draw_ellipse(run, sheet, name, stream)


def _on_ground(run: Run, points: FloatArray) -> FloatArray:
    """Points (T, 2) as (T, 3), a little above the ground."""
    lift = _LIFT_M * run.scene.scale
    return np.column_stack([points, run.scene.height_at(points[:, 0], points[:, 1]) + lift])


def _seen(stream: Stream, values: FloatArray) -> IntArray:
    """Indices of the rows to draw: thinned, and finite in all of ``values`` (T, n)."""
    keep = thin(stream.t_ns, MARKER_HZ)
    return keep[np.isfinite(values[keep]).all(axis=1)]


def _draw_pose(run: Run, sheet: Sheet, name: str, stream: Stream) -> None:
    pose = run.columns(stream, _EAST, _NORTH, HEADING)
    if pose is None:
        return
    keep = _seen(stream, pose)
    pose = pose[keep]
    ahead = (
        _ARROW
        * run.scene.machine_size_m
        * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2]), np.zeros(len(pose))])
    )
    entity = entities.estimated_pose(name)
    sheet.rows(entity, stream.t_ns[keep], rr.Arrows3D.columns(origins=_on_ground(run, pose[:, :2]), vectors=ahead))
    sheet.static(
        entity, rr.Arrows3D.from_fields(colors=[run.colours[name]], radii=_MARKER_RADIUS * run.scene.machine_size_m)
    )


def _draw_rows(run: Run, sheet: Sheet, name: str, stream: Stream, rows: list[int]) -> None:
    """Draw a bar from the first to the last row unit where the estimator has them; beside the true toolbar."""
    if len(rows) < 2:
        return
    ends = run.columns(stream, *row_position(rows[0]), *row_position(rows[-1]))
    if ends is None:
        return
    keep = _seen(stream, ends)
    bars = np.stack([_on_ground(run, ends[keep, :2]), _on_ground(run, ends[keep, 2:])], axis=1)
    entity = entities.estimated_rows(name)
    sheet.rows(entity, stream.t_ns[keep], rr.LineStrips3D.columns(strips=bars.astype(np.float32)))
    sheet.static(
        entity, rr.LineStrips3D.from_fields(colors=[run.colours[name]], radii=_MARKER_RADIUS * run.scene.machine_size_m)
    )


def ellipse_axes(
    variance_e: FloatArray, covariance: FloatArray, variance_n: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standard deviations along the long and the short axis (T,) m, and the long axis' angle from east (T,) rad.

    Closed form of the eigenvalues of ((variance_e, covariance), (covariance, variance_n)).
    """
    mean, half = (variance_e + variance_n) / 2.0, (variance_e - variance_n) / 2.0
    radius = np.hypot(half, covariance)
    long = np.sqrt(mean + radius)
    short = np.sqrt(np.maximum(mean - radius, 0.0))
    return long, short, np.arctan2(covariance, half) / 2.0


def _draw_ellipse(run: Run, sheet: Sheet, name: str, stream: Stream) -> None:
    pairs = ((_EAST, _EAST), (_EAST, _NORTH), (_NORTH, _NORTH))
    known = run.columns(stream, _EAST, _NORTH, *(covariance_column(*pair) for pair in pairs))
    if known is None:
        return
    keep = _seen(stream, known)
    known = known[keep]
    long, short, angle = ellipse_axes(known[:, 2], known[:, 3], known[:, 4])
    half = math.sqrt(CHI2_95_2DOF) * np.column_stack([long, short])
    zeros = np.zeros(len(keep))
    entity = entities.covariance_ellipse(name)
    sheet.rows(
        entity,
        stream.t_ns[keep],
        rr.Ellipsoids3D.columns(
            centers=_on_ground(run, known[:, :2]),
            half_sizes=np.column_stack([np.maximum(half, SMALLEST_M), zeros + 0.01]),
            quaternions=np.column_stack([zeros, zeros, np.sin(angle / 2.0), np.cos(angle / 2.0)]),
        ),
    )
    style = rr.Ellipsoids3D.from_fields(
        colors=[run.colours[name]], line_radii=rr.Radius.ui_points(1.5), fill_mode="majorwireframe"
    )
    sheet.static(entity, style)
