"""What a levelling machine did to its field, and how it held its blade.

Flatness is S_d, the standard deviation of the ground's heights over a grid (TD/T 1033-2012, as paper 002 cites it), and
the share of the grid's points within 30 mm (the same) and 50 mm of their mean. Neither sees that an even field lies too
high or too low: their mean height above the design plane tells. The world surveys the area that counts now and then and
holds the figures in between; *before* is the first row of the truth, *after* the last.

The blade's height above the design plane is judged while it works: from ``scoring.from_s`` on, the machine moving, the
blade over the area that counts (anywhere if none is named). A blade that was raised there has not been where it should.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.recording import Stream
from twin.scenario import Scenario
from twin.signals import HEIGHT, POSITION, SPEED, BoolArray, FloatArray, nanoseconds

MOVING_M_S = 0.1
_FIGURES = {
    "field_sd_m": ("truth.levelling.flatness_{}_mm", 1000.0),
    "field_mean_m": ("truth.levelling.mean_height_{}_mm", 1000.0),
    "field_within_30mm": ("truth.levelling.within_30mm_{}_percent", 100.0),
    "field_within_50mm": ("truth.levelling.within_50mm_{}_percent", 100.0),
}
"""By the truth's column: name of the metric, and the factor to its unit."""
_MOVED = {
    "soil_cut_m3": "truth.levelling.volume_moved_m3",
    "soil_spilled_m3": "truth.levelling.volume_spilled_m3",
}
_BLADE = "truth.levelling.blade_rmse_mm"


def names(columns: Sequence[str]) -> list[str]:
    """Names of :func:`metrics` of a run with these truth columns."""
    found = [name.format(when) for column, (name, _) in _FIGURES.items() for when in _WHEN if column in columns]
    if not found:
        return []
    found += [name for column, name in _MOVED.items() if column in columns]
    return found + ([_BLADE] if {HEIGHT, SPEED, *POSITION[:2]} <= set(columns) else [])


_WHEN = {"before": 0, "after": -1}


def metrics(truth: Stream, scenario: Scenario) -> dict[str, FloatArray]:
    """Flatness and mean height before and after, soil moved, and the blade's height while it worked, shape (1,) each.

    The soil is that moved from the first row to the last, at any place. NaN of a blade that never worked.
    """
    found: dict[str, float] = {}
    for column, (name, factor) in _FIGURES.items():
        if truth.has(column):
            values = truth.column(column)[:, 0]
            found |= {name.format(when): factor * float(values[row]) for when, row in _WHEN.items()}
    for column, name in _MOVED.items():
        if truth.has(column):
            values = truth.column(column)[:, 0]
            found[name] = float(values[-1] - values[0])
    if _BLADE in names(truth.columns):
        height = truth.column(HEIGHT)[_works(truth, scenario), 0]
        found[_BLADE] = 1000.0 * math.sqrt(float(np.mean(height**2))) if len(height) else math.nan
    return {name: np.array([found[name]]) for name in names(truth.columns)}


def _works(truth: Stream, scenario: Scenario) -> BoolArray:
    works: BoolArray = truth.t_ns >= nanoseconds(scenario.scoring.from_s)
    works &= np.abs(truth.column(SPEED)[:, 0]) > MOVING_M_S
    if scenario.levelling.area_m is not None:
        west, south, east, north = scenario.levelling.area_m
        at_e, at_n = (truth.column(column)[:, 0] for column in POSITION[:2])
        works &= (at_e >= west) & (at_e <= east) & (at_n >= south) & (at_n <= north)
    return works
