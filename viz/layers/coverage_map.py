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
_PATCH, _PITCH = 0.045, 0.15
"""Side of a patch of colour in the legend, and distance from one to the next, in longer sides of the map."""


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
    image = rr.Image(_with_patches(picture, colours, frame), magnification_filter="nearest", draw_order=0.0)
    sheet.static(f"{root}/counts", image)
    frame.draw_axes(sheet, root, coverage.config.area_m)
    _draw_legend(sheet, root, frame, coverage.shares, coverage.area_m2)
    title = f"Coverage with {coverage.config.swath_m:g} m, of {coverage.area_m2:,.0f} m²"
    sheet.panel(PanelKind.MAP, root, title, tab=title)


def _with_patches(picture: Image, colours: Image, frame: MapFrame) -> Image:
    """The picture (ny, nx, 3) with a patch of each of these colours (n, 3) to its right."""
    rows, columns = picture.shape[:2]
    gap, side = round(GAP * frame.unit), max(1, round(_PATCH * frame.unit))
    tops = [round(line * _PITCH * frame.unit) for line in range(len(colours))]
    whole: Image = np.full((max(rows, tops[-1] + side), columns + gap + side, 3), entities.MAP_COLOUR, dtype=np.uint8)
    whole[:rows, :columns] = picture
    for top, colour in zip(tops, colours, strict=True):
        whole[top : top + side, columns + gap :] = colour
    return whole


def _draw_legend(sheet: Sheet, root: str, frame: MapFrame, shares: dict[str, float], area_m2: float) -> None:
    """Beside the patches of colour, the share of the area that each has."""
    by_count = shares["skip"], shares["covered"] - shares["overlap"], shares["overlap"]
    middle = frame.size[0] + (GAP + _PATCH + 1.6 * LABEL) * frame.unit
    places: list[tuple[float, float]] = []
    labels: list[str] = []
    for line, ((name, _), share) in enumerate(zip(entities.COVERAGE_LEGEND, by_count, strict=True)):
        told = (name, f"{100.0 * share:.2f} %", f"{share * area_m2:,.1f} m²")
        places += [(middle, (line * _PITCH + (0.5 + row) * _PATCH) * frame.unit) for row in range(len(told))]
        labels += told
    frame.draw_labels(sheet, f"{root}/legend", places, labels)
    bottom = (len(entities.COVERAGE_LEGEND) - 1) * _PITCH + 3.0 * _PATCH
    frame.bound(sheet, root, beside=2.0 * GAP + _PATCH + 3.6 * LABEL, least=bottom)
