"""What a blade does with soil, over time: its load, its draught, and how flat the field has become."""

from __future__ import annotations

import numpy as np

from viz import entities
from viz.layers.load import LOAD
from viz.layers.plots import PLOT_HZ
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import changes, thin

_LOAD_COLOUR: entities.Colour = (205, 150, 90)
_DRAUGHT_COLOUR: entities.Colour = (235, 110, 90)
_FLATNESS_COLOUR: entities.Colour = (120, 200, 230)
_SHARE_COLOURS: tuple[entities.Colour, entities.Colour] = ((120, 200, 130), (80, 120, 90))


def draw_soil_plots(run: Run, sheet: Sheet) -> None:
    """Plot load, draught, S_d, and the shares of the field within 30 and 50 mm of its mean; needs their columns."""
    truth = run.truth
    if truth is None or not len(truth):
        return
    for panel, column, scale, colour, title in (
        ("blade_load", LOAD, 1.0, _LOAD_COLOUR, "Soil in front of the blade [m³]"),
        ("blade_draught", "blade_draught_n", 1e-3, _DRAUGHT_COLOUR, "Draught of the blade [kN]"),
    ):
        if truth.has(column):
            keep = thin(truth.t_ns, PLOT_HZ)
            entity = entities.plot(panel, panel.partition("_")[2])
            sheet.line(entity, truth.t_ns[keep], scale * run.column(truth, column)[keep], colour)
            sheet.panel(PanelKind.PLOT, entities.plot(panel), title)
    _draw_survey(run, sheet, "flatness", {"S_d": ("field_sd_m", 1e3, _FLATNESS_COLOUR)})
    sheet.panel(PanelKind.PLOT, entities.plot("flatness"), "Standard deviation of the field, S_d [mm]")
    within = {
        f"within_{limit}_mm": (f"field_within_{limit}mm", 100.0, colour)
        for limit, colour in zip((30, 50), _SHARE_COLOURS, strict=True)
    }
    _draw_survey(run, sheet, "field_within", within)
    sheet.panel(PanelKind.PLOT, entities.plot("field_within"), "Field within 30, 50 mm of its mean [%]")


def _draw_survey(run: Run, sheet: Sheet, panel: str, series: dict[str, tuple[str, float, entities.Colour]]) -> None:
    """Draw lines of columns that hold their value for a second: one row at each change, and the last."""
    truth = run.truth
    assert truth is not None
    for name, (column, scale, colour) in series.items():
        if truth.has(column):
            values = run.column(truth, column)
            at = np.union1d(changes(values), [len(values) - 1])
            sheet.line(entities.plot(panel, name), truth.t_ns[at], scale * values[at], colour)
