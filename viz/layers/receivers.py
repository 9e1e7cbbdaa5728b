"""What a GNSS receiver says of itself and what is true: error beside reported sigma, and the age of corrections.

Where a machine's height is what it is about, error and sigma are those of the height, else horizontal ones.

Drawn only of receivers whose quality changes during the run: one that keeps its fix has nothing to show here.
"""

from __future__ import annotations

import numpy as np
import rerun as rr

from twin.recording import Stream, hidden_stream
from twin.signals import FloatArray, IntArray
from viz import entities
from viz.sheet import PanelKind, Run, Sheet

_ERRORS, _SIGMAS = ("position_e_m.error", "position_n_m.error"), ("sigma_e_m", "sigma_n_m")
_ERROR_UP, _SIGMA_UP = "position_u_m.error", "sigma_u_m"
_MM = 1000.0


def draw_receivers(run: Run, sheet: Sheet) -> None:
    """Plot error, reported sigma and age of every receiver whose quality changes."""
    for sensor in run.recording.names("measurements"):
        stream = run.recording.measurements(sensor)
        quality = run.columns(stream, "quality")
        if quality is None or len(np.unique(quality[~np.isnan(quality)])) < 2:
            continue
        _draw_honesty(run, sheet, sensor, stream)
        _draw_age(run, sheet, sensor, stream)


def _draw_honesty(run: Run, sheet: Sheet, sensor: str, stream: Stream) -> None:
    panel = f"{sensor}_error"
    hidden = run.recording.streams.get(hidden_stream(sensor))
    errors, sigmas = ((_ERROR_UP,), (_SIGMA_UP,)) if run.levels else (_ERRORS, _SIGMAS)
    true = run.columns(hidden, *errors) if hidden is not None else None
    if hidden is not None and true is not None:
        values = _MM * true[:, 0] if run.levels else np.hypot(*true.T)
        _line(sheet, (panel, "true error"), hidden.t_ns, values, entities.TRUTH_COLOUR)
    claimed = run.columns(stream, *sigmas)
    if claimed is not None:
        values = _MM * claimed[:, 0] if run.levels else np.hypot(*claimed.T)
        _line(sheet, (panel, "reported sigma"), stream.t_ns, values, entities.QUALITY_COLOURS[2])
    # Short: the viewer scrolls a title that does not fit, and the picture never comes to rest.
    what = "height error, true and reported σ [mm]" if run.levels else "error, true and reported σ [m]"
    sheet.panel(PanelKind.PLOT, entities.plot(panel), f"{entities.legend_name(sensor).upper()} {what}")


def _draw_age(run: Run, sheet: Sheet, sensor: str, stream: Stream) -> None:
    age = run.columns(stream, "age_s")
    if age is None:
        return
    panel = f"{sensor}_age"
    _line(sheet, (panel, "age"), stream.t_ns, age[:, 0], entities.QUALITY_COLOURS[5])
    sheet.panel(PanelKind.PLOT, entities.plot(panel), f"{entities.legend_name(sensor).upper()}: age of corrections [s]")


def _line(sheet: Sheet, place: tuple[str, str], t_ns: IntArray, values: FloatArray, colour: entities.Colour) -> None:
    panel, series = place
    entity = entities.plot(panel, series.replace(" ", "_"))
    known = np.isfinite(values)
    sheet.rows(entity, t_ns[known], rr.Scalars.columns(scalars=values[known]))
    sheet.curve(entity, series, t_ns[known], values[known])
    if known.any():
        sheet.static(entity, rr.SeriesLines(colors=[colour], names=[series], widths=[1.5]))
