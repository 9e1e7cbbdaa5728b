"""How a machine keeps to its lane: its offset from the axis, true and estimated, and its distance from the trees."""

from __future__ import annotations

from twin.signals import CLEARANCE, LANE_OFFSET, sigma_column
from viz import entities
from viz.layers.plots import PLOT_HZ
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import thin

CLEARANCE_SERIES = "clearance_to_trees"
PANEL = "lane_offset"


def draw_lane_plot(run: Run, sheet: Sheet) -> None:
    """Plot the offset from the lane's axis, of estimators with a band of one claimed sigma about their line.

    Needs the truth's offset: that a machine keeps to a lane.
    """
    truth = run.truth
    if truth is None or not len(truth) or not run.keeps_lane:
        return
    keep = thin(truth.t_ns, PLOT_HZ)
    if truth.has(CLEARANCE):
        clearance = run.column(truth, CLEARANCE)[keep]
        sheet.line(entities.plot(PANEL, CLEARANCE_SERIES), truth.t_ns[keep], clearance, entities.MEASURED_COLOUR)
    for name in run.estimators:
        stream = run.recording.estimates(name)
        found = run.columns(stream, LANE_OFFSET)
        if found is None:
            continue
        kept, entity = thin(stream.t_ns, PLOT_HZ), entities.plot(PANEL, name)
        sheet.line(entity, stream.t_ns[kept], found[kept, 0], run.colours[name])
        sigma = run.columns(stream, sigma_column(LANE_OFFSET))
        if sigma is not None:
            sheet.band(entity, stream.t_ns[kept], found[kept, 0], sigma[kept, 0], run.colours[name])
    offset = run.column(truth, LANE_OFFSET)[keep]
    entity = entities.plot(PANEL, entities.TRUTH_SERIES)
    sheet.line(entity, truth.t_ns[keep], offset, entities.TRUTH_COLOUR, width=2.0)
    sheet.panel(PanelKind.PLOT, entities.plot(PANEL), "Offset from lane's axis; clearance grey [m]")
    sheet.listed.add(entities.legend_name(CLEARANCE_SERIES))
