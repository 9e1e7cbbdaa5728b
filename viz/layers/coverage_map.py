"""Map of what the implement covered: once, twice or not at all, seen from above, with the shares of each."""

from __future__ import annotations

import math

import numpy as np
import rerun as rr

from viz import entities
from viz.map_frame import GAP, LABEL, MapFrame
from viz.sheet import PanelKind, Run, Sheet
from viz.terrain import Image

_MOST_CELLS = 1_000_000
"""Of the picture: of more, every second one or fewer are drawn."""
_PATCH = 0.045
"""Side of a patch of colour in the legend, in longer sides of the map."""
_LINES = 2
"""Of text beside a patch."""


def draw_coverage_map(run: Run, sheet: Sheet) -> None:
    """Draw the map and its legend; needs a scenario with an area to be covered."""
    coverage = run.scene.coverage
    if coverage is None:
        return
    stride = math.ceil(math.sqrt(coverage.counts.size / _MOST_CELLS))
    # from the middle of each group of cells
    counts = coverage.counts[stride // 2 :: stride, stride // 2 :: stride][::-1]
    colours = np.array([colour for _, colour in entities.COVERAGE_LEGEND], dtype=np.uint8)
    picture: Image = colours[np.minimum(counts, len(colours) - 1)]
    root, frame = entities.COVERAGE_MAP, MapFrame(area_m=coverage.config.area_m, shape=counts.shape)
    sheet.static(f"{root}/counts", rr.Image(picture, magnification_filter="nearest", draw_order=0.0))
    frame.draw_axes(sheet, root, coverage.config.area_m)
    _draw_legend(sheet, root, frame, coverage.shares, coverage.area_m2)
    title = f"Coverage with {coverage.config.swath_m:g} m, of {coverage.area_m2:,.0f} m²"
    sheet.panel(PanelKind.MAP, root, title, tab=title)


def _draw_legend(sheet: Sheet, root: str, frame: MapFrame, shares: dict[str, float], area_m2: float) -> None:
    """Patches of colour to the right of the map, with the share of the area that each has."""
    by_count = shares["skip"], shares["covered"] - shares["overlap"], shares["overlap"]
    left, side = frame.size[0] + GAP * frame.unit, _PATCH * frame.unit
    pitch = (_LINES + 1.2) * side
    boxes: list[tuple[float, float, float, float]] = []
    places: list[tuple[float, float]] = []
    labels: list[str] = []
    for line, ((name, _), share) in enumerate(zip(entities.COVERAGE_LEGEND, by_count, strict=True)):
        top = line * pitch
        boxes.append((left, top, side, side))
        told = (name, f"{100.0 * share:.2f} %", f"{share * area_m2:,.1f} m²")
        places += [(left + side + 1.6 * LABEL * frame.unit, top + (0.5 + row) * side) for row in range(len(told))]
        labels += told
    patches = rr.Boxes2D(
        array=np.array(boxes),
        array_format=rr.Box2DFormat.XYWH,
        colors=[colour for _, colour in entities.COVERAGE_LEGEND],
        radii=rr.Radius.ui_points(0.0),
        draw_order=1.0,
    )
    sheet.static(f"{root}/legend/patches", patches)
    frame.draw_labels(sheet, f"{root}/legend/labels", places, labels)
    frame.bound(sheet, root, beside=2.0 * GAP + _PATCH + 3.6 * LABEL)
