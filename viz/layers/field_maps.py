"""Maps of the field's heights as it was at first and as it is in the end, in the same colours, with axes in metres.

The maps' own coordinates are cells of the picture: the viewer scales pictures no other way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import rerun as rr

from twin.signals import FloatArray
from viz import entities
from viz.levelled import LevelledField, flatness, levelled_field
from viz.relief import FULL_M, TICKS_M, height_colours
from viz.sheet import PanelKind, Run, Sheet
from viz.terrain import Image

TAB = "Heat maps, before and after"
_INK = (225, 225, 225)
_TICKS = 6
"""At most about so many along the longer side."""
_STEPS_M = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
_LABEL, _BAR, _GAP, _DROP = 0.07, 0.03, 0.03, 0.022
"""Room for labels of ticks, width of the scale of colours, gaps, and how far below its point the viewer writes a label
in a window of 1600 x 900, in longer sides of the map."""
_UNSEEN = rr.Radius.ui_points(0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """Where things lie on a map, in cells to the right and downwards."""

    field: LevelledField

    @property
    def size(self) -> tuple[float, float]:
        return float(len(self.field.columns)), float(len(self.field.rows))

    @property
    def unit(self) -> float:
        """The longer side."""
        return max(self.size)

    def right(self, east_m: float) -> float:
        return 0.5 + (east_m - float(self.field.east_m[0])) / self.field.pitch_m

    def down(self, north_m: float) -> float:
        return 0.5 + (float(self.field.north_m[-1]) - north_m) / self.field.pitch_m


def draw_field_maps(run: Run, sheet: Sheet) -> None:
    """Draw the maps; needs an area to be levelled, and for the second one soil that was moved."""
    field, log, scene = levelled_field(run.scene), run.recording.ground, run.scene
    if field is None:
        return
    _draw_map(run, sheet, field, "before", scene.heights)
    if log is not None:
        _draw_map(run, sheet, field, "after", log.heights_at(scene.heights, run.duration_ns))


def _draw_map(run: Run, sheet: Sheet, field: LevelledField, which: str, heights_m: FloatArray) -> None:
    root, frame = entities.height_map(which), _Frame(field=field)
    above = field.picked(heights_m)[::-1] - field.design_height_m
    image = rr.Image(_with_scale(height_colours(above), frame), magnification_filter="nearest", draw_order=0.0)
    sheet.static(f"{root}/heights", image)
    _draw_axes(run, sheet, root, frame)
    _draw_scale(sheet, root, frame)
    width, height = frame.size
    margin = (_LABEL + 2.0 * _GAP) * frame.unit
    right = width + (4.0 * _GAP + _BAR + 1.8 * _LABEL) * frame.unit
    sheet.bounds[root] = ((-margin, right), (-margin, height + margin))
    spread, share = flatness(run.scene, heights_m)
    told = f"S_d {1000.0 * spread:.1f} mm, {100.0 * share:.0f} % within 30 mm"
    sheet.panel(PanelKind.MAP, root, f"{which.capitalize()}: {told}", tab=TAB)


def _draw_axes(run: Run, sheet: Sheet, root: str, frame: _Frame) -> None:
    """Ticks with metres of east and north, and the outline of the judged area."""
    area = run.scene.levelling.area_m
    assert area is not None
    width, height = frame.size
    span_m = frame.unit * frame.field.pitch_m
    step = next((step for step in _STEPS_M if span_m / step <= _TICKS), _STEPS_M[-1])
    tick = 0.3 * _GAP * frame.unit
    lines, places, labels = [], [], []
    for east in _multiples(step, frame.field.east_m):
        x = frame.right(east)
        lines.append([(x, height), (x, height + tick)])
        places.append((x, height + tick + _DROP * frame.unit))
        labels.append(f"{east:g}")
    for north in _multiples(step, frame.field.north_m):
        y = frame.down(north)
        lines.append([(0.0, y), (-tick, y)])
        places.append((-tick - 0.45 * _LABEL * frame.unit, y))
        labels.append(f"{north:g}")
    places += [(0.5 * width, height + (_LABEL + 0.3 * _GAP) * frame.unit), (0.0, -1.2 * _LABEL * frame.unit)]
    labels += ["east [m]", "north [m]"]
    style = rr.Radius.ui_points(0.7)
    sheet.static(f"{root}/ticks", rr.LineStrips2D(lines, colors=[_INK], radii=style, draw_order=1.0))
    _draw_labels(sheet, f"{root}/labels", places, labels, drop=_DROP * frame.unit)
    west, south, east, north = area
    corners = [(west, south), (east, south), (east, north), (west, north), (west, south)]
    strip = [(frame.right(x), frame.down(y)) for x, y in corners]
    sheet.static(
        f"{root}/area", rr.LineStrips2D([strip], colors=[(0, 0, 0)], radii=rr.Radius.ui_points(1.2), draw_order=2.0)
    )


def _multiples(step: float, values: FloatArray) -> list[float]:
    first, last = math.ceil(values[0] / step), math.floor(values[-1] / step)
    return [step * k for k in range(first, last + 1)]


def _with_scale(picture: Image, frame: _Frame) -> Image:
    """The picture (ny, nx, 3) with the scale of colours to its right, (ny, n, 3)."""
    rows, columns = picture.shape[:2]
    gap, wide = round(_GAP * frame.unit), max(1, round(_BAR * frame.unit))
    whole = np.empty((rows, columns + gap + wide, 3), dtype=np.uint8)
    whole[:, :columns] = picture
    whole[:, columns : columns + gap] = entities.MAP_COLOUR
    whole[:, columns + gap :] = height_colours(FULL_M * (1.0 - 2.0 * (np.arange(rows) + 0.5) / rows))[:, np.newaxis]
    return whole


def _draw_scale(sheet: Sheet, root: str, frame: _Frame) -> None:
    """Name heights of the scale of colours, right of the map."""
    width, height = frame.size
    left, wide = width + _GAP * frame.unit, _BAR * frame.unit
    places = [(left + wide + 1.15 * _LABEL * frame.unit, 0.5 * height * (1.0 - up / FULL_M)) for up in TICKS_M]
    labels = [f"{1000.0 * up:+.0f} mm" if up else "plane" for up in TICKS_M]
    _draw_labels(sheet, f"{root}/scale_labels", places, labels, drop=_DROP * frame.unit)


def _draw_labels(
    sheet: Sheet, entity: str, places: list[tuple[float, float]], labels: list[str], *, drop: float
) -> None:
    # The viewer writes a label a little below its point.
    places = [(x, y - drop) for x, y in places]
    sheet.static(entity, rr.Points2D(places, labels=labels, colors=[_INK], radii=_UNSEEN, show_labels=True))
