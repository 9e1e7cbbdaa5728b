"""Phases of a run that are scored apart: turns and straights, and where a sensor has a fault, the loss and after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.recording import Stream
from twin.scenario import Scenario
from twin.signals import YAW_RATE, BoolArray, IntArray


def phase_names(scenario: Scenario, truth_columns: Sequence[str]) -> list[str]:
    """Suffixes of the phases a run of this scenario has; the empty one is the whole run."""
    turning = ["_turns", "_straights"] if YAW_RATE in truth_columns else []
    return ["", *turning, *(["_loss", "_after"] if scenario.loss_window_s is not None else [])]


def phases(scenario: Scenario, truth: Stream, at: IntArray) -> dict[str, BoolArray]:
    """Which of the truth rows ``at`` belong to which phase, each of shape (len(at),)."""
    found = {"": np.ones(len(at), dtype=np.bool_)}
    if truth.has(YAW_RATE):
        turning = np.abs(truth.column(YAW_RATE)[at, 0]) > scenario.scoring.turning_rad_s
        found |= {"_turns": turning, "_straights": ~turning}
    if scenario.loss_window_s is not None:
        begin, end = scenario.loss_window_s
        t_s = truth.t_s[at]
        found |= {"_loss": (t_s >= begin) & (t_s < end), "_after": t_s >= end}
    return found
