"""Maps of the field's heights as it was at first and as it is in the end, in the same colours, with axes in metres."""

from __future__ import annotations

import numpy as np
import rerun as rr

from twin.signals import FloatArray
from viz import entities
from viz.levelled import LevelledField, flatness, levelled_field
from viz.map_frame import GAP, LABEL, MapFrame
from viz.relief import FULL_M, TICKS_M, height_colours
from viz.sheet import PanelKind, Run, Sheet
from viz.terrain import Image

TAB = "Heat maps, before and after"
_BAR = 0.03
"""Width of the scale of colours, in longer sides of the map."""


def draw_field_maps(run: Run, sheet: Sheet) -> None:
    """Draw the maps; needs an area to be levelled, and for the second one soil that was moved."""
    field, log, scene = levelled_field(run.scene), run.recording.ground, run.scene
    if field is None:
        return
    _draw_map(run, sheet, field, "before", scene.heights)
    if log is not None:
        _draw_map(run, sheet, field, "after", log.heights_at(scene.heights, run.duration_ns))


def _frame(field: LevelledField) -> MapFrame:
    """Of a map each of whose cells has a node in its middle."""
    half = 0.5 * field.pitch_m
    area = (
        float(field.east_m[0]) - half,
        float(field.north_m[0]) - half,
        float(field.east_m[-1]) + half,
        float(field.north_m[-1]) + half,
    )
    return MapFrame(area_m=area, shape=(len(field.rows), len(field.columns)))


def _draw_map(run: Run, sheet: Sheet, field: LevelledField, which: str, heights_m: FloatArray) -> None:
    root, frame, area = entities.height_map(which), _frame(field), run.scene.levelling.area_m
    assert area is not None
    above = field.picked(heights_m)[::-1] - field.design_height_m
    image = rr.Image(_with_scale(height_colours(above), frame), magnification_filter="nearest", draw_order=0.0)
    sheet.static(f"{root}/heights", image)
    frame.draw_axes(sheet, root, area)
    _draw_scale(sheet, root, frame)
    frame.bound(sheet, root, beside=4.0 * GAP + _BAR + 1.8 * LABEL)
    spread, share = flatness(run.scene, heights_m)
    told = f"S_d {1000.0 * spread:.1f} mm, {100.0 * share:.0f} % within 30 mm"
    sheet.panel(PanelKind.MAP, root, f"{which.capitalize()}: {told}", tab=TAB)


def _with_scale(picture: Image, frame: MapFrame) -> Image:
    """The picture (ny, nx, 3) with the scale of colours to its right, (ny, n, 3)."""
    rows, columns = picture.shape[:2]
    gap, wide = round(GAP * frame.unit), max(1, round(_BAR * frame.unit))
    whole = np.empty((rows, columns + gap + wide, 3), dtype=np.uint8)
    whole[:, :columns] = picture
    whole[:, columns : columns + gap] = entities.MAP_COLOUR
    whole[:, columns + gap :] = height_colours(FULL_M * (1.0 - 2.0 * (np.arange(rows) + 0.5) / rows))[:, np.newaxis]
    return whole


def _draw_scale(sheet: Sheet, root: str, frame: MapFrame) -> None:
    """Name heights of the scale of colours, right of the map."""
    width, height = frame.size
    left, wide = width + GAP * frame.unit, _BAR * frame.unit
    places = [(left + wide + 1.15 * LABEL * frame.unit, 0.5 * height * (1.0 - up / FULL_M)) for up in TICKS_M]
    labels = [f"{1000.0 * up:+.0f} mm" if up else "plane" for up in TICKS_M]
    frame.draw_labels(sheet, f"{root}/scale_labels", places, labels)
