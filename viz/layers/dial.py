"""A compass dial: where the machine truly heads and where every heading filter thinks it does, at every moment.

Up is where the machine headed at the start, which is along the lane for one that keeps to a lane. Beside the ring
stands a list of the estimators with their errors of the moment, as a figure and as a bar on a scale of its own: a ring
of 360 degrees does not show one degree.
"""

from __future__ import annotations

import math

import numpy as np
import rerun as rr

from twin.recording import Stream
from twin.signals import HEADING, POSITION, FloatArray, IntArray
from viz import entities
from viz.layers.plots import errors
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import thin

DIAL_HZ = 10.0
SCALES_DEG = (2.0, 5.0, 10.0, 20.0, 45.0, 90.0, 180.0)
"""Full bars to choose from."""

_MAGNETOMETER = "mag_x_ut"
_FACE, _MARKS = (88, 96, 104), (150, 158, 166)
_TICK_DEG, _LABEL_DEG = 10, 30
_NAMES_X, _BARS_X, _BAR = 3.0, 6.05, 1.5
"""Middle of the list, where bars have their zero, and how long a full one is, in radii of the ring."""
_FIRST_LINE, _LAST_LINE = -0.88, 1.16
_BOUNDS = ((-1.45, 7.9), (-1.32, 1.32))
_LABEL_DROP = 0.13
"""The viewer writes a label so far below its point, in a window of 1600 x 900."""
_UNSEEN = rr.Radius.ui_points(0.0)
_TRUTH_LENGTH, _LONGEST, _SHORTEST = 0.98, 0.93, 0.42
"""Of needles; each estimator's has its own length, so that all tips are seen when all agree."""


def draw_dial(run: Run, sheet: Sheet) -> None:
    """Draw the dial of a machine that goes by compass; needs estimates of the heading."""
    streams = {name: run.recording.estimates(name) for name in run.estimators}
    streams = {name: stream for name, stream in streams.items() if stream.has(HEADING) and len(stream)}
    if not streams or not goes_by_compass(run):
        return
    zero = _start_heading(run, streams)
    _draw_face(sheet, zero)
    if run.truth is not None and run.truth.has(HEADING) and len(run.truth):
        _draw_needle(run, sheet, entities.DIAL_TRUTH, run.truth, zero, length=_TRUTH_LENGTH)
        sheet.static(
            entities.DIAL_TRUTH,
            rr.Arrows2D.from_fields(colors=[entities.TRUTH_COLOUR], radii=rr.Radius.ui_points(5.0), draw_order=1.0),
        )
    found = {name: errors(run, stream, HEADING) for name, stream in streams.items()}
    full = full_bar_deg([np.degrees(error) for error in found.values() if error is not None])
    if any(error is not None for error in found.values()):
        _draw_scale(sheet, full)
    lengths = np.linspace(_LONGEST, _SHORTEST, len(streams))
    lines = np.linspace(_FIRST_LINE, _LAST_LINE, len(streams) + 1)
    _draw_name(sheet, "truth", float(lines[0]), entities.TRUTH_COLOUR)
    for order, (name, length) in enumerate(zip(sorted(streams), lengths, strict=True)):
        entity = entities.dial_needle(name)
        _draw_needle(run, sheet, entity, streams[name], zero, length=float(length))
        style = rr.Arrows2D.from_fields(
            colors=[run.colours[name]], radii=rr.Radius.ui_points(2.0), draw_order=2.0 + order
        )
        sheet.static(entity, style)
        line, error = float(lines[order + 1]), found[name]
        if error is None:
            _draw_name(sheet, name, line, run.colours[name])
        else:
            _draw_error(run, sheet, name, streams[name].t_ns, np.degrees(error), line=line, full=full)
    sheet.bounds[entities.DIAL] = _BOUNDS
    sheet.listed = {entities.legend_name(name) for name in (*streams, entities.TRUTH_SERIES)}
    sheet.panel(PanelKind.DIAL, entities.DIAL, "Heading, up is that of the start [deg], and its errors [deg]")


def goes_by_compass(run: Run) -> bool:
    """Tell whether a run is about headings: it has a magnetometer, or estimators of a heading and no position."""
    measured = (run.recording.measurements(sensor) for sensor in run.recording.names("measurements"))
    estimated = (run.recording.estimates(name) for name in run.estimators)
    return any(stream.has(_MAGNETOMETER) for stream in measured) or any(
        stream.has(HEADING) and not stream.has(POSITION[0]) for stream in estimated
    )


def full_bar_deg(errors_deg: list[FloatArray]) -> float:
    """Smallest scale that holds all but the largest fiftieth of every estimator's errors."""
    sizes = [np.abs(error[np.isfinite(error)]) for error in errors_deg]
    largest = max((float(np.quantile(size, 0.98)) for size in sizes if len(size)), default=0.0)
    return next((scale for scale in SCALES_DEG if scale >= largest), SCALES_DEG[-1])


def direction(relative_rad: FloatArray) -> FloatArray:
    """Points (..., 2) on the ring, to the right and downwards, of angles counter-clockwise from up."""
    return np.stack([-np.sin(relative_rad), -np.cos(relative_rad)], axis=-1)


def _start_heading(run: Run, streams: dict[str, Stream]) -> float:
    first = run.truth if run.truth is not None and run.truth.has(HEADING) and len(run.truth) else None
    values = run.column(first if first is not None else next(iter(streams.values())), HEADING)
    known = values[np.isfinite(values)]
    return float(known[0]) if len(known) else 0.0


def _draw_face(sheet: Sheet, zero: float) -> None:
    """Ring, ticks with degrees (positive to the left), and the four points of the compass."""
    ring = direction(np.linspace(0.0, 2.0 * math.pi, 181))
    ticks = []
    for degrees in range(0, 360, _TICK_DEG):
        at = direction(np.array(math.radians(degrees)))
        ticks.append(np.stack([at * (0.9 if degrees % _LABEL_DEG == 0 else 0.95), at]))
    sheet.static(
        entities.DIAL_FACE,
        rr.LineStrips2D([ring, *ticks], colors=[_FACE], radii=rr.Radius.ui_points(1.0), draw_order=0.0),
    )
    shown = [*range(-120, 121, _LABEL_DEG), 180]
    labels = [f"{degrees:+d}°" if 0 < abs(degrees) < 180 else f"{degrees}°" for degrees in shown]
    _draw_labels(sheet, "degrees", 1.16 * direction(np.radians(shown)), labels, _MARKS)
    compass = np.radians([90.0, 0.0, -90.0, 180.0]) - zero
    _draw_labels(sheet, "compass", 0.74 * direction(compass), ["N", "E", "S", "W"], (235, 120, 100))


def _draw_labels(sheet: Sheet, what: str, places: FloatArray, labels: list[str], colour: entities.Colour) -> None:
    above = places - (0.0, _LABEL_DROP)
    sheet.static(
        f"{entities.DIAL_FACE}/{what}",
        rr.Points2D(above, labels=labels, colors=[colour], radii=_UNSEEN, show_labels=True),
    )


def _draw_needle(run: Run, sheet: Sheet, entity: str, stream: Stream, zero: float, *, length: float) -> None:
    keep = thin(stream.t_ns, DIAL_HZ)
    heading = run.column(stream, HEADING)[keep]
    known = np.isfinite(heading)
    vectors = length * direction(heading[known] - zero)
    columns = rr.Arrows2D.columns(vectors=vectors.astype(np.float32), origins=np.zeros_like(vectors, dtype=np.float32))
    sheet.rows(entity, stream.t_ns[keep][known], columns)


def _draw_scale(sheet: Sheet, full: float) -> None:
    """Zero and both ends of the bars, with figures: positive errors go to the left, as on the ring."""
    strips = [np.array([[_BARS_X + side * _BAR, -1.05], [_BARS_X + side * _BAR, 1.26]]) for side in (-1.0, 0.0, 1.0)]
    sheet.static(
        f"{entities.DIAL_FACE}/scale",
        rr.LineStrips2D(strips, colors=[_FACE], radii=rr.Radius.ui_points(0.5), draw_order=0.0),
    )
    places = np.array([[_BARS_X - side * _BAR, -1.2] for side in (-1.0, 0.0, 1.0)])
    _draw_labels(sheet, "scale_figures", places, [f"-{full:g}°", "0°", f"+{full:g}°"], _MARKS)


def _draw_name(sheet: Sheet, name: str, line: float, colour: entities.Colour) -> None:
    sheet.static(
        entities.dial_name(name),
        rr.Points2D(
            [(_NAMES_X, line - _LABEL_DROP)],
            labels=[entities.legend_name(name)],
            colors=[colour],
            radii=_UNSEEN,
            show_labels=True,
        ),
    )


def _draw_error(
    run: Run, sheet: Sheet, name: str, t_ns: IntArray, error_deg: FloatArray, *, line: float, full: float
) -> None:
    """Name with the error as a figure, and the error as a bar."""
    shown, colour = entities.legend_name(name), run.colours[name]
    keep = thin(t_ns, DIAL_HZ)
    # Adding zero makes a zero of a negative one.
    rounded = np.round(error_deg[keep], 1) + 0.0
    labels = [f"{shown}  {error:+.1f}°" if np.isfinite(error) else shown for error in rounded.tolist()]
    entity = entities.dial_name(name)
    places = [(_NAMES_X, line - _LABEL_DROP)] * len(keep)
    sheet.rows(entity, t_ns[keep], rr.Points2D.columns(positions=places, labels=labels))
    sheet.static(entity, rr.Points2D.from_fields(colors=[colour], radii=_UNSEEN, show_labels=True))
    keep = keep[np.isfinite(error_deg[keep])]
    ends = _BARS_X - _BAR * np.clip(error_deg[keep] / full, -1.0, 1.0)
    bars = np.zeros((len(keep), 2, 2), dtype=np.float32)
    bars[:, 0, 0], bars[:, 1, 0], bars[:, :, 1] = _BARS_X, ends, line
    sheet.rows(entities.dial_bar(name), t_ns[keep], rr.LineStrips2D.columns(strips=bars))
    sheet.static(
        entities.dial_bar(name),
        rr.LineStrips2D.from_fields(colors=[colour], radii=rr.Radius.ui_points(3.0), draw_order=1.0),
    )
