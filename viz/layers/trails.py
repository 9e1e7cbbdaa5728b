"""Trails: where row units, or the machine, truly went."""

from __future__ import annotations

import numpy as np
import rerun as rr

from twin.recording import Stream
from twin.signals import POSITION, row_position
from viz import entities
from viz.sheet import Run, Sheet
from viz.thinning import spaced, thin

SEGMENT_M = 0.4
_TRAIL_HZ = 25.0
_LIFT_M = 0.06


def draw_trail(
    run: Run,
    sheet: Sheet,
    *,
    entity: str,
    stream: Stream,
    columns: tuple[str, str],
    colour: entities.Colour,
    width: float,
) -> None:
    """Draw the way of a point (east and north columns) on the ground, growing with the cursor."""
    points = run.columns(stream, *columns)
    if points is None:
        return
    keep = thin(stream.t_ns, _TRAIL_HZ)
    keep = keep[spaced(points[keep], SEGMENT_M * run.scene.scale)]
    if len(keep) < 2:
        return
    points = points[keep]
    strip = np.column_stack([points, run.scene.height_at(points[:, 0], points[:, 1]) + _LIFT_M * run.scene.scale])
    pieces = np.stack([strip[:-1], strip[1:]], axis=1)
    sheet.rows(entity, stream.t_ns[keep[1:]], rr.LineStrips3D.columns(strips=pieces.astype(np.float32)))
    sheet.static(entity, rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(width)))
    sheet.past.append(entity)


def draw_row_trails(run: Run, sheet: Sheet) -> None:
    """Draw where the outer row units truly went, or the reference point of a machine that has none."""
    if run.truth is None:
        return
    trails = {entities.true_trail(row): row_position(row) for row in run.scene.outer_rows}
    for entity, columns in (trails or {entities.true_trail(): (POSITION[0], POSITION[1])}).items():
        draw_trail(
            run,
            sheet,
            entity=entity,
            stream=run.truth,
            columns=columns,
            colour=entities.TRUTH_COLOUR,
            width=1.5,
        )
