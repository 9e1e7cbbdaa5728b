"""What the machine did, and what a filter could know of it: the same for all members of an ensemble."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.recording import Stream
from twin.scenario import Scenario
from twin.scoring import guidance, height_bound, lane, levelling, pass_bound
from twin.scoring.causal_bound import causal_bound_m_s
from twin.scoring.measures import row_numbers
from twin.scoring.phases import phases
from twin.signals import SPEED, YAW_RATE, FloatArray, nanoseconds, row_speed

_MOVING_M_S = 0.1


def motion_names(scenario: Scenario, columns: Sequence[str]) -> list[str]:
    """Names of :func:`motion_metrics` of a run with these truth columns."""
    bounds = [f"bound.{name}" for name in _bound_names(scenario, columns)]
    machine = [f"truth.{name}" for name in _motion_names(columns)]
    kept = [*lane.names(columns), *levelling.names(columns), *guidance.machine_names(scenario, columns)]
    return [*machine, *kept, *bounds, *height_bound.names(scenario), *pass_bound.names(scenario)]


def _motion_names(columns: Sequence[str]) -> list[str]:
    if YAW_RATE not in columns:
        return []
    names = ["motion.turning_s", "motion.turned_deg"]
    return names + [f"row_speed.mean_abs_transport_row_{row}_turns_m_s" for row in row_numbers(columns)]


def motion_metrics(truth: Stream, scenario: Scenario) -> dict[str, FloatArray]:
    """What the machine did: time turning, heading change, and the speed that turning adds at each row, shape (1,).

    ``row_speed.mean_abs_transport_row_<i>_turns_m_s`` is the mean of |v_row - v| in turns, which is |y_row| times the
    heading change over the time turning: the error of whoever takes one speed for all rows.
    """
    turned = _turned(truth, scenario) if truth.has(YAW_RATE) else {}
    kept = lane.metrics(truth, scenario) | levelling.metrics(truth, scenario)
    kept |= guidance.machine_metrics(truth, scenario)
    bounds = (_bounds(truth, scenario) if truth.has(YAW_RATE) else {}) | height_bound.metrics(scenario)
    return turned | kept | bounds | pass_bound.metrics(scenario)


def _turned(truth: Stream, scenario: Scenario) -> dict[str, FloatArray]:
    at = np.flatnonzero(truth.t_ns >= nanoseconds(scenario.scoring.from_s))
    turning = at[phases(scenario, truth, at)["_turns"]]
    step_s = float(np.diff(truth.t_s).mean()) if len(truth) > 1 else 0.0
    values = [np.array([step_s * len(turning)])]
    values.append(np.degrees(step_s * np.abs(truth.column(YAW_RATE)[turning]).sum(axis=0)))
    for row in row_numbers(truth.columns):
        extra = np.abs(truth.column(row_speed(row))[turning] - truth.column(SPEED)[turning])
        values.append(extra.mean(axis=0) if len(turning) else np.full(1, math.nan))
    return {f"truth.{name}": value for name, value in zip(_motion_names(truth.columns), values, strict=True)}


# --- what a filter could know ----------------------------------------------------------------------------------------


def _bound_names(scenario: Scenario, columns: Sequence[str]) -> list[str]:
    if scenario.scoring.causal_bound_of is None or YAW_RATE not in columns:
        return []
    return [f"row_speed.mean_abs_error_{phase}_m_s" for phase in ("turns", "straights")]


def _bounds(truth: Stream, scenario: Scenario) -> dict[str, FloatArray]:
    """Bound on the row-speed error of any causal filter with one estimator's sensors, at each phase's mean speed."""
    estimator = scenario.scoring.causal_bound_of
    if estimator is None:
        return {}
    rows = scenario.scoring.rows
    counted = [row for row in row_numbers(truth.columns) if rows is None or row in rows]
    rows_y_m = [scenario.machine.rows_y_m[row - 1] for row in counted]
    found: dict[str, FloatArray] = {}
    at = np.flatnonzero(truth.t_ns >= nanoseconds(scenario.scoring.from_s))
    masks = phases(scenario, truth, at)
    speed = np.abs(truth.column(SPEED)[at, 0])
    for phase in ("turns", "straights"):
        moving = masks[f"_{phase}"] & (speed > _MOVING_M_S)
        bound = math.nan
        if moving.any():
            bound = causal_bound_m_s(
                scenario,
                scenario.estimators[estimator].sensors,
                speed_m_s=float(speed[moving].mean()),
                rows_y_m=rows_y_m,
            )
        found[f"bound.row_speed.mean_abs_error_{phase}_m_s"] = np.array([bound])
    return found
