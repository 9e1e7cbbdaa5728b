"""What stands and lies in the field: trees, magnets and iron."""

from __future__ import annotations

import numpy as np
import rerun as rr

from viz import entities
from viz.sheet import Run, Sheet

_BARK, _LEAVES = (104, 78, 54), (74, 118, 52)
_MAGNET, _IRON = (214, 48, 49), (110, 118, 128)
_CROWN_RADII = 8.0
"""Half width of a crown in radii of its trunk; crowns are for the eye alone, nothing else knows of them."""
_LEAST_SHARE = 0.02
"""A magnet is drawn with at least this share of the machine's size, or a small one could not be seen."""


def draw_surroundings(run: Run, sheet: Sheet) -> None:
    """Draw trees with a crown each, and magnets (red) and iron (grey) as balls."""
    _draw_trees(run, sheet)
    smallest = _LEAST_SHARE * run.scene.machine_size_m
    for entity, pieces, colour in (
        (entities.MAGNETS, run.scene.magnets, _MAGNET),
        (entities.IRON, run.scene.iron, _IRON),
    ):
        if len(pieces):
            radii = np.maximum(pieces[:, 3], smallest)
            half = np.repeat(radii[:, np.newaxis], 3, axis=1)
            balls = rr.Ellipsoids3D(centers=pieces[:, :3], half_sizes=half, colors=[colour], fill_mode="solid")
            sheet.static(entity, balls)


def _draw_trees(run: Run, sheet: Sheet) -> None:
    trunks = run.scene.trunks
    if not len(trunks):
        return
    place, radius, bottom, top = trunks[:, :2], trunks[:, 2], trunks[:, 3], trunks[:, 4]
    sheet.static(
        entities.TRUNKS,
        rr.Cylinders3D(
            lengths=top - bottom,
            radii=radius,
            centers=np.column_stack([place, 0.5 * (top + bottom)]),
            colors=[_BARK],
            fill_mode="solid",
        ),
    )
    width = _CROWN_RADII * radius
    sheet.static(
        entities.CROWNS,
        rr.Ellipsoids3D(
            centers=np.column_stack([place, top + 0.5 * width]),
            half_sizes=np.column_stack([width, width, 0.8 * width]),
            colors=[_LEAVES],
            fill_mode="solid",
        ),
    )
