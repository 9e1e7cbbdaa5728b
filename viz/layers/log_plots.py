"""Plots over time of a replayed log: speed, errors against a reference, surprise of filters, claimed sigma, quality."""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from twin.recording import Stream
from twin.scoring.consistency import nis_columns, nis_degrees
from twin.signals import HEADING, POSITION, SPEED, FloatArray, sigma_column
from viz import entities
from viz.layers.states import draw_lane
from viz.sheet import PanelKind, Run, Sheet

_SURPRISE_MOST = 6.0
"""To which the plot of surprise reaches at first: five times what is unlikely is off the plot, not squeezing it."""
_LOST = 6.0
"""Errors widen their plot to no more than so many times those of whoever is wrong least."""
_LIMIT = "95 % if consistent"
_DEGREES = math.degrees(1.0)
_PLOTTED = 0.998
"""Share of the values that decide how far a plot reaches."""


def draw_log_plots(run: Run, sheet: Sheet) -> None:
    """Draw every plot of which the streams hold something."""
    _draw_errors(run, sheet)
    _draw_surprise(run, sheet)
    _draw_motion(run, sheet)
    _draw_sigmas(run, sheet)
    _draw_headings(run, sheet)
    _draw_qualities(run, sheet)


def _draw_errors(run: Run, sheet: Sheet) -> None:
    """Horizontal distance from the reference, and, darker, the root of the sum of the claimed variances."""
    panel = "reference_error"
    shown = {name: run.recording.streams[f"errors/{name}"] for name in run.recording.names("errors")}
    found = {name: run.columns(stream, "error_m", "sigma_m") for name, stream in shown.items()}
    told = {name: each for name, each in found.items() if each is not None and np.isfinite(each[:, 0]).any()}
    reaches = [_reach(each[:, 0]) for each in told.values()]
    # A filter that is lost must not squeeze the others into a line.
    most = min(max(reaches, default=0.0), _LOST * min(reaches, default=0.0))
    for name, each in told.items():
        t_ns, colour, entity = (
            shown[name].t_ns,
            run.colours.get(name, entities.MEASURED_COLOUR),
            entities.plot(panel, name),
        )
        label, dim = entities.legend_name(name), entities.dimmed(colour)
        sheet.line(entities.band(entity), t_ns, each[:, 1], dim, name=label, width=0.8, within=(0.0, most))
        sheet.line(entity, t_ns, each[:, 0], colour, within=(0.0, most))
    sheet.panel(PanelKind.PLOT, entities.plot(panel), "Error, and (dark) claimed σ [m]")


def _draw_surprise(run: Run, sheet: Sheet) -> None:
    """Root of the normalised innovation squared per degree of freedom: one on average, if the filter is consistent."""
    panel, degrees = "surprise", 0
    for name in run.estimators:
        stream = run.recording.estimates(name)
        columns = nis_columns(stream.columns)
        column = next((each for each in columns if each.endswith("position")), columns[0] if columns else None)
        found = None if column is None else run.columns(stream, column)
        if column is None or found is None or not np.isfinite(found).any():
            continue
        degrees = nis_degrees(column)
        surprise = np.sqrt(found[:, 0] / degrees)
        sheet.line(
            entities.plot(panel, name),
            stream.t_ns,
            surprise,
            run.colours[name],
            width=1.0,
            within=(0.0, _SURPRISE_MOST),
        )
    if degrees:
        limit = math.sqrt(float(stats.chi2.ppf(0.95, degrees)) / degrees)
        t_ns = np.array([0, run.duration_ns], dtype=np.int64)
        entity = entities.plot(panel, "limit")
        sheet.line(entity, t_ns, np.full(2, limit), entities.LIMIT_COLOUR, name=_LIMIT)
    sheet.panel(PanelKind.PLOT, entities.plot(panel), "Innovation of position over its σ [-]")


def _draw_motion(run: Run, sheet: Sheet) -> None:
    """Speeds: the receiver's own in grey, and the estimators'."""
    panel = "speed"
    for sensor, stream in _receivers_first(run):
        _line(run, sheet, stream, SPEED, at=(panel, sensor), colour=entities.MEASURED_COLOUR)
    for name in run.estimators:
        _line(run, sheet, run.recording.estimates(name), SPEED, at=(panel, name), colour=run.colours[name])
    sheet.panel(PanelKind.PLOT, entities.plot(panel), "Speed [m/s]")


def _draw_sigmas(run: Run, sheet: Sheet) -> None:
    """What receiver and estimators claim of their horizontal position."""
    panel = "claimed_sigma"
    shown: list[tuple[str, Stream, tuple[str, str], entities.Colour]] = [
        (name, stream, ("sigma_e_m", "sigma_n_m"), entities.MEASURED_COLOUR) for name, stream in _receivers_first(run)
    ]
    pair = (sigma_column(POSITION[0]), sigma_column(POSITION[1]))
    shown += [(name, run.recording.estimates(name), pair, run.colours[name]) for name in run.estimators]
    for name, stream, columns, colour in shown:
        found = run.columns(stream, *columns)
        if found is None:
            continue
        sigma = np.hypot(found[:, 0], found[:, 1])
        if np.isfinite(sigma).any():
            sheet.line(entities.plot(panel, name), stream.t_ns, sigma, colour, within=(0.0, _reach(sigma)))
    sheet.panel(PanelKind.PLOT, entities.plot(panel), "Claimed σ of position [m]")


def _draw_headings(run: Run, sheet: Sheet) -> None:
    panel = "heading"
    for sensor, stream in _receivers_first(run):
        grey = entities.MEASURED_COLOUR
        _line(run, sheet, stream, "course_rad", at=(panel, sensor), colour=grey, scale=_DEGREES)
    for name in run.estimators:
        stream = run.recording.estimates(name)
        _line(run, sheet, stream, HEADING, at=(panel, name), colour=run.colours[name], scale=_DEGREES)
    sheet.panel(PanelKind.PLOT, entities.plot(panel), "Heading, from east to the left [deg]")


def _draw_qualities(run: Run, sheet: Sheet) -> None:
    """The lane of the receiver's quality."""
    epochs = run.recording.streams.get("epochs")
    quality = None if epochs is None else run.columns(epochs, "quality")
    if epochs is not None and quality is not None and np.isfinite(quality).any():
        codes = entities.QUALITY_LABELS
        styles = {float(code): (label, entities.QUALITY_COLOURS[code]) for code, label in codes.items()}
        known = np.isfinite(quality[:, 0])
        draw_lane(sheet, "quality", epochs.t_ns[known], quality[known, 0], styles)
    sheet.panel(PanelKind.LANES, entities.STATE, "States")


def _receivers_first(run: Run) -> list[tuple[str, Stream]]:
    return [(name, run.recording.measurements(name)) for name in run.recording.names("measurements")]


def _line(
    run: Run,
    sheet: Sheet,
    stream: Stream,
    column: str,
    *,
    at: tuple[str, str],
    colour: entities.Colour,
    scale: float = 1.0,
) -> None:
    """Draw a column as a series (panel, series)."""
    found = run.columns(stream, column)
    if found is not None and np.isfinite(found).any():
        sheet.line(entities.plot(*at), stream.t_ns, scale * found[:, 0], colour, width=1.2)


def _reach(values: FloatArray) -> float:
    """How far a plot of these values reaches: a few that are very large do not squeeze the others."""
    return 1.1 * float(np.nanquantile(values, _PLOTTED))
