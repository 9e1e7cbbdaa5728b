"""How well a machine is guided: its offset from the planned lines, and how far across its track estimates put it."""

from __future__ import annotations

import numpy as np

from twin.recording import Stream
from twin.scoring.compared import compare
from twin.scoring.cross_track import cross_track_errors
from twin.scoring.driven_track import DrivenTrack
from twin.scoring.guidance import SEGMENT, off_the_path
from twin.signals import POSITION, BoolArray
from viz import entities
from viz.layers.plots import PLOT_HZ
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import thin

_PANEL = "cross_track"
_PLANE = POSITION[:2]
_WITHIN = (-8.0, 8.0)
"""To which the plot reaches at most at first: as far as receivers err. What an estimator that is lost says is cut."""
_LIMIT_M = 0.1
_LIMIT_SERIES = "limit"


def draw_cross_track_plot(run: Run, sheet: Sheet) -> None:
    """Plot the offset of the machine on its straights, and the estimates' errors there with their claimed sigma.

    Needs the planned segments of a scenario that judges guidance.
    """
    truth, legs = run.truth, run.scene.guided_legs
    if truth is None or not legs or not len(truth) or not all(truth.has(each) for each in (*_PLANE, SEGMENT)):
        return
    for side, name in ((-_LIMIT_M, "below"), (_LIMIT_M, "above")):
        ends = np.array([truth.t_ns[0], truth.t_ns[-1]])
        entity = entities.plot(_PANEL, f"{_LIMIT_SERIES}_{name}")
        sheet.line(entity, ends, np.full(2, side), entities.LIMIT_COLOUR, width=1.0, name="±0.1 m")
    track = DrivenTrack()
    track.add(truth)
    for estimator in run.estimators:
        stream = run.recording.estimates(estimator)
        if all(stream.has(column) for column in _PLANE):
            _draw_errors(run, sheet, estimator, track)
    offset = off_the_path(truth, legs)
    offset[~_on_straights(run, truth)] = np.nan
    keep = thin(truth.t_ns, PLOT_HZ)
    entity = entities.plot(_PANEL, entities.TRUTH_SERIES)
    colour, name = entities.TRUTH_COLOUR, "machine off line"
    sheet.line(entity, truth.t_ns[keep], offset[keep], colour, width=2.0, name=name, within=_WITHIN, broken=True)
    title = "Across the track, left positive, ±1σ [m]"
    sheet.panel(PanelKind.PLOT, entities.plot(_PANEL), title)


def _on_straights(run: Run, truth: Stream) -> BoolArray:
    """For which rows of the truth (T,) the driver is at a straight."""
    straights = np.array([*(leg.is_straight for leg in run.scene.guided_legs), False])
    found: BoolArray = straights[np.minimum(truth.column(SEGMENT)[:, 0].astype(np.int64), len(straights) - 1)]
    return found


def _draw_errors(run: Run, sheet: Sheet, estimator: str, track: DrivenTrack) -> None:
    assert run.truth is not None
    stream = run.recording.estimates(estimator)
    own = stream.member(min(run.member, stream.values.shape[1] - 1))
    compared = compare(run.truth, own, _PLANE)
    kept = thin(compared.t_ns, PLOT_HZ)
    straight = _on_straights(run, run.truth)[compared.at_truth]
    found = cross_track_errors(track, own, compared)
    errors, sigmas = (np.where(straight, values[:, 0], np.nan)[kept] for values in (found.errors_m, found.sigmas_m))
    entity, colour = entities.plot(_PANEL, estimator), run.colours[estimator]
    sheet.line(entity, compared.t_ns[kept], errors, colour, within=_WITHIN, broken=True)
    if np.isfinite(sigmas).any():
        sheet.band(entity, compared.t_ns[kept], np.where(np.isnan(errors), np.nan, 0.0), sigmas, colour)
