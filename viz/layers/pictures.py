"""What cameras saw, and where the detector found a stop sign in it."""

from __future__ import annotations

import numpy as np
import rerun as rr

from viz import entities
from viz.sheet import PanelKind, Run, Sheet

_BOX = ("sign_seen", "box_left_px", "box_top_px", "box_width_px", "box_height_px", "sign_range_m")
_BOX_COLOUR = (255, 214, 10)


def draw_pictures(run: Run, sheet: Sheet) -> None:
    """Draw the pictures of every camera with a box around the sign where one was found, and its distance.

    Pictures are those of the recording's first run: another member shows none, since its noise was another.
    """
    if run.member != 0:
        return
    for sensor, pictures in run.recording.pictures.items():
        entity = entities.picture(sensor)
        blobs = [np.frombuffer(jpeg, dtype=np.uint8) for jpeg in pictures.jpeg]
        media = ["image/jpeg"] * len(pictures)
        sheet.rows(entity, pictures.t_ns, rr.EncodedImage.columns(blob=blobs, media_type=media))
        _draw_boxes(run, sheet, sensor)
        sheet.panel(PanelKind.PICTURE, entity, f"{sensor}: picture with the detected sign")


def _draw_boxes(run: Run, sheet: Sheet, sensor: str) -> None:
    """One box or none at every picture."""
    if sensor not in run.recording.names("measurements"):
        return
    stream = run.recording.measurements(sensor)
    values = run.columns(stream, *_BOX)
    if values is None:
        return
    seen = values[:, 0] == 1.0
    _, left, top, width, height, away = values[seen].T
    half = np.column_stack([0.5 * width, 0.5 * height]).astype(np.float32)
    centres = (np.column_stack([left, top]) + half).astype(np.float32)
    columns = rr.Boxes2D.columns(centers=centres, half_sizes=half, labels=[f"{metres:.2f} m" for metres in away])
    entity = entities.sign_box(sensor)
    sheet.rows(entity, stream.t_ns, columns.partition(seen.astype(np.int64)))
    sheet.static(entity, rr.Boxes2D.from_fields(colors=[_BOX_COLOUR], radii=rr.Radius.ui_points(1.5)))
