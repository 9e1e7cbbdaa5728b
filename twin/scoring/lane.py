"""How a machine kept to its lane, and to its distance from the trees: what closed loops are judged by.

The offset is that of the middle of the driven axle from the lane's axis, positive to the left, from ``scoring.from_s``
on; its root mean square is over the time in which the driver neither stands nor has stopped. ``finished`` is 1 for a
run whose driver stopped, at the sign or at the end of the lane, without having touched a tree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.control.lane_keeping import STANDING, STOPPED_AT_END, STOPPED_AT_SIGN, LaneDriverConfig
from twin.recording import Stream
from twin.scenario import Scenario
from twin.signals import CLEARANCE, LANE_OFFSET, FloatArray, nanoseconds

_FINISHED = "truth.lane.finished"
_COLLIDED = "truth.clearance.touched"
_CLEARANCE = "truth.clearance.min_m"
ON_COLLISION = frozenset({_FINISHED, _COLLIDED, _CLEARANCE})
"""Metrics a check of which says whether a run may end at a tree."""
_OFFSETS = ("truth.lane.rms_offset_m", "truth.lane.max_abs_offset_m", "truth.lane.final_offset_m")
_STOPS = {"truth.lane.stopped_at_sign": STOPPED_AT_SIGN, "truth.lane.stopped_at_end": STOPPED_AT_END}
_WAY = "truth.lane.way_m"


def names(columns: Sequence[str]) -> list[str]:
    """Names of :func:`metrics` of a run with these truth columns."""
    clearance = [_CLEARANCE, _COLLIDED] if CLEARANCE in columns else []
    return clearance + ([*_OFFSETS, _WAY, *_STOPS, _FINISHED] if LANE_OFFSET in columns else [])


def metrics(truth: Stream, scenario: Scenario) -> dict[str, FloatArray]:
    """Offset from the axis, way made along it, how the drive ended, distance from the trees; each of shape (1,)."""
    found: dict[str, float] = {}
    if truth.has(CLEARANCE):
        nearest = float(truth.column(CLEARANCE).min())
        found |= {_CLEARANCE: nearest, _COLLIDED: float(nearest <= 0.0)}
    if truth.has(LANE_OFFSET) and isinstance(scenario.driver, LaneDriverConfig):
        found |= dict(zip(_OFFSETS, _sizes(truth, scenario, scenario.driver.states), strict=True))
        axis_deg = scenario.machine.start.heading_deg - scenario.driver.start_heading_deg
        found[_WAY] = _way(truth, math.radians(axis_deg))
        last = scenario.driver.states[round(float(truth.column("segment")[-1, 0]))]
        found |= {name: float(last == state) for name, state in _STOPS.items()}
        touched = found.get(_COLLIDED, 0.0) > 0.0
        found[_FINISHED] = float(last in _STOPS.values() and not touched)
    return {name: np.array([value]) for name, value in found.items()}


def _sizes(truth: Stream, scenario: Scenario, states: Sequence[str]) -> tuple[float, float, float]:
    """Root mean square while driving, largest and last offset, m; NaN where there is none."""
    counted = truth.t_ns >= nanoseconds(scenario.scoring.from_s)
    moving = [not state.startswith((STANDING, "stopped")) for state in states]
    driving = counted & np.array(moving)[truth.column("segment")[:, 0].astype(int)]
    offset = truth.column(LANE_OFFSET)[:, 0]
    rms = math.sqrt(float(np.mean(offset[driving] ** 2))) if driving.any() else math.nan
    if not counted.any():
        return rms, math.nan, math.nan
    return rms, float(np.abs(offset[counted]).max()), float(offset[counted][-1])


def _way(truth: Stream, heading_rad: float) -> float:
    """Along the axis from the first to the last instant, m."""
    east, north = (truth.column(f"vehicle_{axis}_m")[:, 0] for axis in "en")
    return float((east[-1] - east[0]) * math.cos(heading_rad) + (north[-1] - north[0]) * math.sin(heading_rad))
