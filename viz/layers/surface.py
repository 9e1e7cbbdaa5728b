"""The field that is being levelled: a surface coloured by its height above the design plane, changing as soil moves."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from twin.signals import FloatArray
from viz import entities
from viz.levelled import FieldChanges, LevelledField, Tile, levelled_field
from viz.relief import FULL_M, TICKS_M, packed_colours
from viz.sheet import Run, Sheet

_OUTLINE, _OUTLINE_LIFT_M = (60, 60, 60), 0.12
_BAR_CELLS = 40
_SIDE, _HEIGHT, _WIDTH, _TOP, _RIM, _LABEL = 1.36, 0.70, 0.05, 0.90, 0.015, 0.24
"""Of the legend: how far to the left, how high and wide, where its top is, the rim around it, and where labels have
their middle, in half heights of the picture."""
_RISE = 0.06
"""The viewer writes labels so far below their points, in the same unit."""
_NEAR = 0.35
"""Where it hangs, between the camera and what that looks at."""
_RIM_COLOUR = 0x282828FF
_HALF_VIEW_RAD = np.radians(27.5)
"""Half of what the camera sees from top to bottom."""


def draw_surface(run: Run, sheet: Sheet) -> None:
    """Draw the field's tiles, the outline of the judged area, and the legend; needs an area to be levelled."""
    field, scene = levelled_field(run.scene), run.scene
    if field is None or scene.levelling.area_m is None:
        return
    changes = field.changes(run.recording.ground, scene.heights.shape[1], run.duration_ns)
    first = field.picked(scene.heights)
    for index, tile in enumerate(field.tiles()):
        _draw_tile(sheet, entities.surface_tile(index), field, tile, changes=changes, first_m=first)
    west, south, east, north = scene.levelling.area_m
    corners = [(west, south), (east, south), (east, north), (west, north), (west, south)]
    up = scene.levelling.design_height_m + _OUTLINE_LIFT_M
    strip = np.column_stack([corners, np.full(5, up)])
    colour = _OUTLINE
    sheet.static(entities.AREA, rr.LineStrips3D([strip], colors=[colour], radii=rr.Radius.ui_points(1.0)))
    _draw_legend(run, sheet)


def _draw_tile(
    sheet: Sheet, entity: str, field: LevelledField, tile: Tile, *, changes: FieldChanges, first_m: FloatArray
) -> None:
    """Draw one tile, anew whenever soil has moved in it.

    Without normals, the viewer does not shade it: its colours are those of the legend.
    """
    times, heights = zip(*changes.of(tile, first_m), strict=True)
    ny, nx = heights[0].shape
    east, north = np.meshgrid(field.east_m[tile.columns], field.north_m[tile.rows])
    up = np.stack(heights)
    vertices = np.stack([np.broadcast_to(east, up.shape), np.broadcast_to(north, up.shape), up], axis=-1)
    colours = packed_colours(up - field.design_height_m)
    columns = rr.Mesh3D.columns(
        vertex_positions=vertices.reshape(-1, 3).astype(np.float32), vertex_colors=colours.reshape(-1)
    )
    sheet.static(entity, rr.Mesh3D.from_fields(triangle_indices=grid_triangles(ny, nx)))
    sheet.rows(entity, np.array(times, dtype=np.int64), columns.partition([ny * nx] * len(times)))


def grid_triangles(ny: int, nx: int) -> NDArray[np.uint32]:
    """Triangles (F, 3) of a grid of vertices, row after row, counter-clockwise from above."""
    corner = np.arange(ny * nx, dtype=np.uint32).reshape(ny, nx)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    return np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)


def _draw_legend(run: Run, sheet: Sheet) -> None:
    """Hang a scale of colours in the upper left of the picture; it goes with what the camera follows."""
    track = run.columns(run.truth, "base_e_m", "base_n_m", "base_u_m") if run.truth is not None else None
    if sheet.eye is None or track is None or run.truth is None:
        return
    eye, target = sheet.eye
    look = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(look, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    above = np.cross(right, look)
    distance = _NEAR * float(np.linalg.norm(target - eye))
    half = distance * float(np.tan(_HALF_VIEW_RAD))
    # A camera that follows something looks at it, whatever it was told to look at.
    top = eye - target + distance * look + half * (_TOP * above - _SIDE * right)
    share = np.linspace(0.0, 1.0, _BAR_CELLS + 1)
    heights = FULL_M * (1.0 - 2.0 * (share[:-1] + 0.5 / _BAR_CELLS))
    # each cell has its own corners, so that the step at 30 mm is not blurred
    corners = np.stack(
        [
            top + half * (across * _WIDTH * right - down[:, np.newaxis] * _HEIGHT * above)
            for down in (share[:-1], share[1:])
            for across in (0.0, 1.0)
        ],
        axis=1,
    )
    sheet.static(f"{entities.HEIGHT_LEGEND}/bar", _quads(corners, np.repeat(packed_colours(heights), 4)))
    behind = 1.01 * (top + half * np.array([
        -_RIM * right + _RIM * above,
        (_WIDTH + _RIM) * right + _RIM * above,
        -_RIM * right - (_HEIGHT + _RIM) * above,
        (_WIDTH + _RIM) * right - (_HEIGHT + _RIM) * above,
    ]) - (eye - target)) + (eye - target)  # fmt: skip
    sheet.static(f"{entities.HEIGHT_LEGEND}/rim", _quads(behind[np.newaxis], np.full(4, _RIM_COLOUR, dtype=np.uint32)))
    places = [
        top + half * (_LABEL * right + (_RISE - 0.5 * (1.0 - height / FULL_M) * _HEIGHT) * above) for height in TICKS_M
    ]
    labels = [f"{1000.0 * height:+.0f} mm" if height else "plane" for height in TICKS_M]
    sheet.static(
        f"{entities.HEIGHT_LEGEND}/labels",
        rr.Points3D(places, labels=labels, show_labels=True, radii=0.0, colors=[(255, 255, 255)]),
    )
    moved = np.flatnonzero(np.any(np.diff(track, axis=0, prepend=np.nan) != 0.0, axis=1))
    columns = rr.Transform3D.columns(translation=track[moved])
    sheet.rows(entities.HEIGHT_LEGEND, run.truth.t_ns[moved], columns)


def _quads(corners: FloatArray, colours: NDArray[np.uint32]) -> rr.Mesh3D:
    """A mesh of quadrangles (N, 4, 3), each from its upper left, upper right, lower left and lower right corner."""
    triangles = 4 * np.arange(len(corners))[:, np.newaxis, np.newaxis] + np.array([[0, 2, 3], [0, 3, 1]])
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3).astype(np.float32),
        triangle_indices=triangles.reshape(-1, 3).astype(np.uint32),
        vertex_colors=colours,
    )
