"""The height of an implement: true, measured and estimated, and how wrong the estimates are beside the limit of 30 mm.

The limit's lines lie in the plot of heights too where a machine is to keep its blade on the plane. Both plots have a
range in which 30 mm can be seen, whatever a filter that has lost the height says.
"""

from __future__ import annotations

import numpy as np
import rerun as rr

from twin.geometry import rotation_from_quaternion
from twin.recording import Stream
from twin.signals import HEIGHT, LEVEL_WITHIN_M, POSITION, BoolArray, FloatArray, sigma_column
from viz import entities
from viz.layers.load import LOAD
from viz.layers.plots import PLOT_HZ, errors
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import thin

MM = 1000.0
MOST_MM = 100.0
"""To which the plots reach at first, from the plane or from zero error."""
_BEYOND_MM = 80.0
"""The same on a bench, from the ends of the true travel."""
_HEIGHTS, _ERRORS = "height", "height_error"
_LIMIT_SERIES = "limit"
_QUATERNION = ("base_qx", "base_qy", "base_qz", "base_qw")


def draw_height_plots(run: Run, sheet: Sheet) -> None:
    """Plot heights above the design plane, and errors; needs a truth that has a height."""
    truth = run.truth
    if truth is None or not run.levels or not len(truth):
        return
    _draw_heights(run, sheet, truth)
    _draw_errors(run, sheet)


def _draw_heights(run: Run, sheet: Sheet, truth: Stream) -> None:
    true_mm = MM * run.column(truth, HEIGHT)
    on_plane = truth.has(LOAD)
    within = (-MOST_MM, MOST_MM)
    if not on_plane:
        within = (float(np.nanmin(true_mm)) - _BEYOND_MM, float(np.nanmax(true_mm)) + _BEYOND_MM)
    for sensor in run.recording.names("measurements"):
        _draw_receiver(run, sheet, sensor, within)
    if on_plane:
        _draw_limits(run, sheet, _HEIGHTS)
    for name in run.estimators:
        stream = run.recording.estimates(name)
        found = run.columns(stream, HEIGHT)
        if found is None:
            continue
        keep, entity = thin(stream.t_ns, PLOT_HZ), entities.plot(_HEIGHTS, name)
        sheet.line(entity, stream.t_ns[keep], MM * found[keep, 0], run.colours[name], within=within)
        sigma = _claimed(run, name, stream)
        if sigma is not None:
            sheet.band(entity, stream.t_ns[keep], MM * found[keep, 0], MM * sigma[keep], run.colours[name])
    keep = thin(truth.t_ns, PLOT_HZ)
    entity = entities.plot(_HEIGHTS, entities.TRUTH_SERIES)
    sheet.line(entity, truth.t_ns[keep], true_mm[keep], entities.TRUTH_COLOUR, width=2.0, within=within)
    sheet.panel(PanelKind.PLOT, entities.plot(_HEIGHTS), "Height above design plane, with ±1σ [mm]")


def _draw_errors(run: Run, sheet: Sheet) -> None:
    """Draw every estimator's error, and the band about zero in which ours claims to be."""
    within = (-MOST_MM, MOST_MM)
    drawn = False
    for name in run.estimators:
        stream = run.recording.estimates(name)
        error = errors(run, stream, HEIGHT)
        if error is None:
            continue
        drawn = True
        keep, entity, colour = thin(stream.t_ns, PLOT_HZ), entities.plot(_ERRORS, name), run.colours[name]
        sheet.line(entity, stream.t_ns[keep], MM * error[keep], colour, within=within)
        sigma = _claimed(run, name, stream)
        if sigma is not None:
            sheet.band(entity, stream.t_ns[keep], np.zeros(len(keep)), MM * sigma[keep], colour)
    if drawn:
        _draw_limits(run, sheet, _ERRORS)
        # truth is white everywhere, and the lane of the receiver's quality tells the colours of its points
        sheet.told_beside.add(entities.plot(_HEIGHTS))
    sheet.panel(PanelKind.PLOT, entities.plot(_ERRORS), "Height error, with claimed ±1σ [mm]")


def _claimed(run: Run, name: str, stream: Stream) -> FloatArray | None:
    """Claimed sigma (T,) m of an estimator whose band is drawn."""
    banded = run.scene.banded
    found = run.columns(stream, sigma_column(HEIGHT))
    return None if found is None or (banded is not None and name not in banded) else found[:, 0]


def _draw_limits(run: Run, sheet: Sheet, panel: str) -> None:
    """Draw a line at the limit on either side."""
    ends = np.array([0, run.duration_ns], dtype=np.int64)
    for sign, side in ((1.0, "above"), (-1.0, "below")):
        entity = entities.plot(panel, f"{_LIMIT_SERIES}_{side}")
        values = np.full(2, sign * MM * LEVEL_WITHIN_M)
        name = f"±{MM * LEVEL_WITHIN_M:.0f} mm"
        sheet.line(entity, ends, values, entities.LIMIT_COLOUR, width=1.0, name=name)


def _draw_receiver(run: Run, sheet: Sheet, sensor: str, within: tuple[float, float]) -> None:
    """Draw a receiver's heights as points, coloured by quality."""
    stream = run.recording.measurements(sensor)
    height = receiver_height(run, sensor, stream)
    if height is None or not stream.has("quality"):
        return
    quality = run.column(stream, "quality")
    valid: BoolArray = np.isfinite(height)
    if stream.valid is not None:
        valid &= stream.valid[:, min(run.member, stream.valid.shape[1] - 1)]
    for code, label in entities.QUALITY_LABELS.items():
        seen = valid & (quality == code)
        if not seen.any():
            continue
        entity = entities.plot(_HEIGHTS, f"{sensor}_{code}")
        name = entities.legend_name(f"{sensor} {label}")
        values = MM * height[seen]
        sheet.rows(entity, stream.t_ns[seen], rr.Scalars.columns(scalars=values))
        sheet.curve(entity, name, stream.t_ns[seen], np.clip(values, *within))
        style = rr.SeriesPoints(
            colors=[entities.QUALITY_COLOURS[code]], names=[name], markers="circle", marker_sizes=[1.5]
        )
        sheet.static(entity, style)


def receiver_height(run: Run, sensor: str, stream: Stream) -> FloatArray | None:
    """Height of the reference frame above the design plane (T,) m that a receiver's position means.

    The true attitude takes it down from the antenna, so that its error is the receiver's alone. None for an antenna
    that does not move with the reference frame, and without a truth.
    """
    up, lever, truth = run.columns(stream, POSITION[2]), run.scene.antennas.get(sensor), run.truth
    attitude = None if truth is None else run.columns(truth, *_QUATERNION)
    if up is None or lever is None or truth is None or attitude is None:
        return None
    offset = (rotation_from_quaternion(attitude) @ lever)[:, 2]
    # relative to the first time, so that float64 keeps nanoseconds apart
    then, now = ((t_ns - truth.t_ns[0]).astype(np.float64) for t_ns in (truth.t_ns, stream.t_ns))
    height: FloatArray = up[:, 0] - np.interp(now, then, offset) - run.scene.levelling.design_height_m
    return height
