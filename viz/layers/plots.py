"""Plots over time: row speeds and their errors, yaw rate, position and heading errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr

from twin.geometry import wrap_angle
from twin.recording import Stream
from twin.signals import HEADING, POSITION, SPEED, YAW_RATE, FloatArray, IntArray, row_speed, sigma_column, wraps
from viz import entities
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import thin

PLOT_HZ = 25.0
_COARSE_RAD_S = 0.2
_DEGREES = math.degrees(1.0)
_EAST, _NORTH = POSITION[:2]


def draw_row_speed_plots(run: Run, sheet: Sheet) -> None:
    """Plot the outer rows' speeds (true, estimated, and what the speed sensor measured), then their errors."""
    side = dict(zip(run.scene.outer_rows, ("left end", "right end"), strict=False))
    for row in run.scene.outer_rows:
        panel = f"row_{row}_speed"
        for sensor, stream in _speed_sensors(run):
            _draw_line(run, sheet, stream, SPEED, panel=panel, series=sensor, colour=entities.MEASURED_COLOUR)
        _draw_values(run, sheet, row_speed(row), panel=panel)
        sheet.panel(PanelKind.PLOT, entities.plot(panel), f"Speed of row {row}, {side[row]} [m/s]")
    for row in run.scene.outer_rows:
        panel = f"row_{row}_speed_error"
        _draw_errors(run, sheet, row_speed(row), panel=panel)
        sheet.panel(PanelKind.PLOT, entities.plot(panel), f"Speed error of row {row}, with claimed ±1σ [m/s]")


def draw_motion_plots(run: Run, sheet: Sheet) -> None:
    """Plot yaw rate, and errors of position and heading; a machine in a lane or one that levels has plots enough."""
    if not run.keeps_lane and not run.levels:
        counted = [name for name, stream in _estimates(run) if is_counted(run, stream)]
        _draw_values(run, sheet, YAW_RATE, panel="yaw_rate", scale=_DEGREES, without=counted)
        title = "Yaw rate, counted ones left out [deg/s]" if counted else "Yaw rate [deg/s]"
        sheet.panel(PanelKind.PLOT, entities.plot("yaw_rate"), title)
    _draw_errors(run, sheet, HEADING, panel="heading_error", scale=_DEGREES)
    sheet.panel(PanelKind.PLOT, entities.plot("heading_error"), "Heading error, with claimed ±1σ [deg]")
    _draw_position_errors(run, sheet)
    sheet.panel(PanelKind.PLOT, entities.plot("position_error"), "Horizontal position error, with claimed σ [m]")


def is_counted(run: Run, stream: Stream) -> bool:
    """Tell whether an estimator's yaw rate is too coarse to be drawn, such as one of slots counted in a short step.

    It is where its error is larger than what there is to be seen, and too large for any gyroscope.
    """
    error = errors(run, stream, YAW_RATE)
    if error is None or run.truth is None or not np.isfinite(error).any():
        return False
    size = float(np.sqrt(np.nanmean(error**2)))
    return size > _COARSE_RAD_S and size > float(np.sqrt(np.nanmean(run.column(run.truth, YAW_RATE) ** 2)))


def true_values(run: Run, column: str, t_ns: IntArray) -> FloatArray | None:
    """Truth of a column at times (T,), interpolated between its rows, or ``None`` where the truth has it not."""
    truth = run.truth
    if truth is None or not truth.has(column) or not len(truth):
        return None
    values = run.column(truth, column)
    if np.array_equal(t_ns, truth.t_ns):
        return values
    if wraps(column):
        values = np.unwrap(values)
    # relative to the first time, so that float64 keeps nanoseconds apart
    start = truth.t_ns[0]
    at: FloatArray = np.interp((t_ns - start).astype(float), (truth.t_ns - start).astype(float), values)
    return at


def errors(run: Run, stream: Stream, column: str) -> FloatArray | None:
    """Estimate minus truth (T,), wrapped where the column is a direction; ``None`` where either has it not."""
    true = true_values(run, column, stream.t_ns) if stream.has(column) else None
    if true is None:
        return None
    difference = run.column(stream, column) - true
    return wrap_angle(difference) if wraps(column) else difference


def _speed_sensors(run: Run) -> Iterator[tuple[str, Stream]]:
    """Sensors of ground speed alone, such as a radar (a GNSS receiver gives positions too)."""
    for sensor in run.recording.names("measurements"):
        stream = run.recording.measurements(sensor)
        if stream.has(SPEED) and not stream.has(_EAST):
            yield sensor, stream


def _estimates(run: Run) -> Iterator[tuple[str, Stream]]:
    for name in run.estimators:
        yield name, run.recording.estimates(name)


def _send(
    sheet: Sheet, entity: str, t_ns: IntArray, values: FloatArray, *, name: str, colour: entities.Colour, width: float
) -> None:
    """Send one line; gaps (NaN) are left out."""
    known = np.isfinite(values)
    sheet.rows(entity, t_ns[known], rr.Scalars.columns(scalars=values[known]))
    sheet.curve(entity, name, t_ns[known], values[known])
    if known.any():
        sheet.static(entity, rr.SeriesLines(colors=[colour], names=[name], widths=[width]))


def _draw_line(
    run: Run,
    sheet: Sheet,
    stream: Stream,
    column: str,
    *,
    panel: str,
    series: str,
    colour: entities.Colour,
    scale: float = 1.0,
    width: float = 1.0,
) -> None:
    if not stream.has(column) or not len(stream):
        return
    keep = thin(stream.t_ns, PLOT_HZ)
    values = scale * run.column(stream, column)[keep]
    name = entities.legend_name(series)
    _send(sheet, entities.plot(panel, series), stream.t_ns[keep], values, name=name, colour=colour, width=width)


def _draw_values(
    run: Run, sheet: Sheet, column: str, *, panel: str, scale: float = 1.0, without: Sequence[str] = ()
) -> None:
    """Draw one column of the truth and of every estimator that has it and is not left out."""
    if run.truth is not None:
        _draw_line(
            run,
            sheet,
            run.truth,
            column,
            panel=panel,
            series=entities.TRUTH_SERIES,
            colour=entities.TRUTH_COLOUR,
            scale=scale,
            width=2.0,
        )
    for name, stream in _estimates(run):
        if name not in without:
            colour = run.colours[name]
            _draw_line(run, sheet, stream, column, panel=panel, series=name, colour=colour, scale=scale, width=1.5)


def _draw_errors(run: Run, sheet: Sheet, column: str, *, panel: str, scale: float = 1.0) -> None:
    """Draw every estimator's error, and a band of one claimed standard deviation either side of zero.

    An honest filter's error stays inside its band for two thirds of the time.
    """
    for name, stream in _estimates(run):
        error = errors(run, stream, column)
        if error is None:
            continue
        keep = thin(stream.t_ns, PLOT_HZ)
        t_ns, colour, label = stream.t_ns[keep], run.colours[name], entities.legend_name(name)
        entity = entities.plot(panel, name)
        _send(sheet, entity, t_ns, scale * error[keep], name=label, colour=colour, width=1.5)
        if stream.has(sigma_column(column)):
            sigma = scale * run.column(stream, sigma_column(column))[keep]
            sheet.band(entity, t_ns, np.zeros(len(keep)), sigma, colour)
            # as far as it matters: a filter that knows nothing must not flatten the errors' plot
            seen = np.nan_to_num(np.minimum(sigma, 1.5 * np.nanmax(np.abs(scale * error[keep]), initial=0.0)))
            for side in (-1.0, 1.0):
                sheet.curve(entity, label, t_ns, side * seen)


def _draw_position_errors(run: Run, sheet: Sheet) -> None:
    """Draw the horizontal distance from the truth, and the square root of the claimed variances' sum."""
    panel = "position_error"
    for name, stream in _estimates(run):
        east, north = errors(run, stream, _EAST), errors(run, stream, _NORTH)
        if east is None or north is None:
            continue
        keep = thin(stream.t_ns, PLOT_HZ)
        t_ns, colour, label = stream.t_ns[keep], run.colours[name], entities.legend_name(name)
        entity = entities.plot(panel, name)
        _send(sheet, entity, t_ns, np.hypot(east, north)[keep], name=label, colour=colour, width=1.5)
        sigmas = run.columns(stream, sigma_column(_EAST), sigma_column(_NORTH))
        if sigmas is not None:
            claimed = np.hypot(sigmas[keep, 0], sigmas[keep, 1])
            dim = entities.dimmed(colour)
            _send(sheet, entities.band(entity), t_ns, claimed, name=f"{label} σ", colour=dim, width=1.0)
