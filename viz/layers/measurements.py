"""Positions that sensors reported."""

from __future__ import annotations

import numpy as np
import rerun as rr

from twin.signals import POSITION
from viz import entities
from viz.sheet import Run, Sheet


def packed(colour: entities.Colour) -> int:
    """Colour as 0xRRGGBBAA."""
    red, green, blue = colour
    return red << 24 | green << 16 | blue << 8 | 0xFF


def draw_measured_positions(run: Run, sheet: Sheet) -> None:
    """Draw every reported position where the sensor said it was (at its antenna), coloured by its fix quality."""
    for sensor in run.recording.names("measurements"):
        stream = run.recording.measurements(sensor)
        points = run.columns(stream, *POSITION)
        if points is None:
            continue
        seen = np.isfinite(points).all(axis=1)
        if stream.valid is not None:
            seen &= stream.valid[:, min(run.member, stream.valid.shape[1] - 1)]
        entity = entities.measured_points(sensor)
        colours = np.full(len(points), packed(entities.MEASURED_COLOUR), dtype=np.uint32)
        if stream.has("quality"):
            quality = run.column(stream, "quality")
            for code, colour in entities.QUALITY_COLOURS.items():
                colours[quality == code] = packed(colour)
        sheet.rows(entity, stream.t_ns[seen], rr.Points3D.columns(positions=points[seen], colors=colours[seen]))
        sheet.static(entity, rr.Points3D.from_fields(radii=rr.Radius.ui_points(2.0)))
        sheet.past.append(entity)
