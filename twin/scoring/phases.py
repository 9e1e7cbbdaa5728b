"""Phases of a run that are scored apart: turns and straights, and where a sensor has a fault, the loss and after it.

Where a scenario asks for it (``scoring.transition_s``), *transitions* too: the times at which the machine, at its speed
of the moment, is so many seconds or less from where the planned path begins or ceases to bend, or bends otherwise,
before it or after it. A driver turns the wheel a moment before the bend, and what an estimator makes of that shows
after it. A place of the path is where the machine is beside the segment that its driver is at. *Steady turns* and
*steady straights* are what is left of turns and straights without the transitions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.recording import Stream
from twin.scenario import Scenario
from twin.signals import POSITION, SPEED, YAW_RATE, BoolArray, FloatArray, IntArray

_PLACED = ("segment", SPEED, *POSITION[:2])
"""Columns of the truth that tell how far it is to a bend."""


def phase_names(scenario: Scenario, truth_columns: Sequence[str]) -> list[str]:
    """Suffixes of the phases a run of this scenario has; the empty one is the whole run."""
    turning = ["_turns", "_straights"] if YAW_RATE in truth_columns else []
    if _has_transitions(scenario, truth_columns):
        turning += ["_transitions", *(f"_steady{phase}" for phase in turning)]
    return ["", *turning, *(["_loss", "_after"] if scenario.loss_window_s is not None else [])]


def phases(scenario: Scenario, truth: Stream, at: IntArray) -> dict[str, BoolArray]:
    """Which of the truth rows ``at`` belong to which phase, each of shape (len(at),)."""
    found = {"": np.ones(len(at), dtype=np.bool_)}
    if truth.has(YAW_RATE):
        turning = np.abs(truth.column(YAW_RATE)[at, 0]) > scenario.scoring.turning_rad_s
        found |= {"_turns": turning, "_straights": ~turning}
    if _has_transitions(scenario, truth.columns):
        passing = _transitions(scenario, truth, at)
        steady = {f"_steady{phase}": found[phase] & ~passing for phase in ("_turns", "_straights") if phase in found}
        found |= {"_transitions": passing, **steady}
    if scenario.loss_window_s is not None:
        begin, end = scenario.loss_window_s
        t_s = truth.t_s[at]
        found |= {"_loss": (t_s >= begin) & (t_s < end), "_after": t_s >= end}
    return found


def _has_transitions(scenario: Scenario, truth_columns: Sequence[str]) -> bool:
    return scenario.scoring.transition_s is not None and set(_PLACED) <= set(truth_columns)


def _transitions(scenario: Scenario, truth: Stream, at: IntArray) -> BoolArray:
    """Whether the machine is within ``transition_s`` of a place where the path bends otherwise, (len(at),)."""
    points, segments = truth.select(POSITION[:2])[at, 0], truth.column("segment")[at, 0]
    station, changes = np.full(len(at), np.nan), list[float]()
    begin_m, bent = 0.0, 0.0
    for leg in scenario.planned_legs:
        here = np.flatnonzero(segments == leg.index)
        if leg.pieces and len(here):
            station[here] = begin_m + leg.project(points[here])[0]
        for piece in leg.pieces:
            if piece.curvature_1_m != bent:
                changes.append(begin_m)
            begin_m, bent = begin_m + piece.length_m, piece.curvature_1_m
    if bent:
        changes.append(begin_m)
    way = np.abs(truth.column(SPEED)[at, 0]) * (scenario.scoring.transition_s or 0.0)
    near: BoolArray = _nearest(station, np.array(changes)) < way  # False where the machine stands, and for NaN
    return near


def _nearest(station: FloatArray, changes: FloatArray) -> FloatArray:
    """Way (T,) from stations (T,) to the nearest of some others; infinite without any."""
    ends = np.concatenate([[-np.inf], changes, [np.inf]])
    after = np.searchsorted(ends, station, side="left").clip(1, len(ends) - 1)
    way: FloatArray = np.minimum(station - ends[after - 1], ends[after] - station)
    return way
