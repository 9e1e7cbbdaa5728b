"""Writes what is kept of a replayed log as a .rrd: track on a map, plots over time, lane of qualities, page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from twin.recording import Recording
from viz import entities
from viz.layers.log_plots import draw_log_plots
from viz.layers.track_map import draw_track_map
from viz.legible import legible
from viz.log_page import log_page
from viz.rrd import write_rrd
from viz.scene import Scene
from viz.sheet import Layer, PanelKind, Run, Sheet


def draw_log_page(run: Run, sheet: Sheet) -> None:
    """Write the page about the log, what was passed over, and the metrics."""
    sheet.static(entities.PAGE, rr.TextDocument(legible(log_page(run.result)), media_type=rr.MediaType.MARKDOWN))
    sheet.panel(PanelKind.PAGE, entities.PAGE, "Log and figures")


LOG_LAYERS: tuple[Layer, ...] = (draw_track_map, draw_log_plots, draw_log_page)
"""In the order in which panels appear."""


def write_log_rrd(sketch: Recording, result: dict[str, Any], path: Path) -> None:
    """Write the streams that a replay has kept to ``path``, whole or not at all.

    Args:
        sketch: Thinned streams: ``measurements/``, ``estimates/``, ``errors/``, ``epochs`` and ``reference``.
        result: Content of ``result.json``.
        path: The file; replaced if it exists. Its folder must exist.

    Raises:
        OSError: the file cannot be written.
        TwinError: what was written cannot be read back.
    """
    nowhere = Scene(urdf=None, heights=np.zeros((2, 2)), origin_m=(0.0, 0.0), cell_m=1.0, planned_path=np.zeros((0, 2)))
    write_rrd(sketch, nowhere, result, path, layers=LOG_LAYERS, title=f"{sketch.scenario_name}, replayed")
