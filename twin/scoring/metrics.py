"""Metrics of estimates against the truth, matched by column name.

A metric is named ``<estimator>.<family>.<what>_<unit>``. Errors are estimate minus truth at the times that both
streams have, from ``scoring.from_s`` on. Phases: the whole run, ``turns`` (true yaw rate beyond
``scoring.turning_rad_s``) and ``straights`` (the rest); where a sensor has a fault with a time window also ``loss`` (in
the window) and ``after`` (from its end on). Names are known before a run (:func:`metric_names`), so that a check on a
metric that cannot exist is refused before anything is simulated.

A recording may be scored whole, or in pieces as it is made (:class:`Scorer`), so that an ensemble need not be kept.
Values are arrays over the ensemble axis, shape (R,): NaN where a phase did not occur or an estimate was missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.geometry import wrap_angle
from twin.recording import Recording, Stream
from twin.scenario import Scenario
from twin.scoring import bus, consistency
from twin.scoring.causal_bound import causal_bound_m_s
from twin.scoring.measures import Measure, measures_of, row_numbers
from twin.scoring.seeds import SeedScorer, counted_rows, seed_metric_names
from twin.signals import NS_PER_S, SPEED, YAW_RATE, BoolArray, FloatArray, IntArray, nanoseconds, row_speed, wraps

Metrics = dict[str, FloatArray]

_MOVING_M_S = 0.1


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


def shared_columns(truth: Sequence[str], estimate: Sequence[str]) -> list[str]:
    """Columns of an estimate that the truth has too: what is scored."""
    return [column for column in estimate if column in truth]


def estimator_measures(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> list[Measure]:
    """Measures of an estimator with these columns."""
    limits = {str(family): limit for family, limit in scenario.scoring.limits.items()}
    if scenario.loss_window_s is None:
        limits = {}
    return measures_of(shared_columns(truth, estimate), counted_rows=scenario.scoring.rows, limits=limits)


def metric_names(scenario: Scenario, truth: Sequence[str], estimates: Mapping[str, Sequence[str]]) -> list[str]:
    """Names of all metrics that a run with these truth and estimate columns will have."""
    names = [f"truth.{name}" for name in _motion_names(truth)]
    names += [f"bound.{name}" for name in _bound_names(scenario, truth)]
    for estimator, columns in estimates.items():
        for measure in estimator_measures(scenario, truth, columns):
            names += [f"{estimator}.{name}" for name in _phased(measure, phase_names(scenario, truth))]
        names += [f"{estimator}.{name}" for name in _consistency_names(truth, columns)]
        seeds = seed_metric_names(counted_rows(scenario, truth, columns), phase_names(scenario, truth))
        names += [f"{estimator}.{name}" for name in seeds]
    return names + bus.metric_names(scenario)


def _consistency_names(truth: Sequence[str], estimate: Sequence[str]) -> list[str]:
    states = consistency.state_columns(estimate)
    names = ["consistency.nees"] if states and set(states) <= set(truth) else []
    return names + [f"consistency.{column}" for column in consistency.nis_columns(estimate)]


def _phased(measure: Measure, suffixes: Sequence[str]) -> list[str]:
    if "{phase}" not in measure.name:
        return [measure.name]
    return [measure.name.format(phase=suffix) for suffix in suffixes]


def compute(recording: Recording, scenario: Scenario) -> Metrics:
    """All metrics of a whole recording, each of shape (R,)."""
    truth = recording.truth
    estimates = {name: recording.estimates(name) for name in recording.names("estimates")}
    columns = {name: stream.columns for name, stream in estimates.items()}
    scorer = Scorer(scenario, truth.columns, columns, runs=recording.runs)
    scorer.add(truth, estimates)
    of_buses = {name: np.array([value]) for name, value in bus.metrics(scenario).items()}
    return {**motion_metrics(truth, scenario), **scorer.metrics(), **of_buses}


# --- errors ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """Estimate minus truth at common times."""

    t_ns: IntArray
    """(T,)."""
    errors: FloatArray
    """(T, R, n), angles wrapped."""
    at_truth: IntArray
    """(T,) rows of the truth."""
    at_estimate: IntArray
    """(T,) rows of the estimate."""


def compare(truth: Stream, estimate: Stream, columns: Sequence[str], *, from_ns: int = 0) -> Compared:
    """Errors of some columns at the times that truth and estimate share, from ``from_ns`` on."""
    shared, at_truth, at_estimate = np.intersect1d(truth.t_ns, estimate.t_ns, return_indices=True)
    counts = shared >= from_ns
    at_truth, at_estimate = at_truth[counts], at_estimate[counts]
    of_truth = [truth.columns.index(column) for column in columns]
    of_estimate = [estimate.columns.index(column) for column in columns]
    errors = estimate.values[at_estimate][:, :, of_estimate] - truth.values[at_truth][:, :, of_truth]
    for index, column in enumerate(columns):
        if wraps(column):
            errors[:, :, index] = wrap_angle(errors[:, :, index])
    return Compared(t_ns=shared[counts], errors=errors, at_truth=at_truth, at_estimate=at_estimate)


# --- scoring in pieces -----------------------------------------------------------------------------------------------


class Scorer:
    """Metrics of estimates that arrive in pieces, each with the truth of the same time."""

    def __init__(
        self,
        scenario: Scenario,
        truth_columns: Sequence[str],
        estimates: Mapping[str, Sequence[str]],
        *,
        runs: Sequence[int] = (0,),
        watch: Callable[[str, IntArray, FloatArray], None] | None = None,
    ) -> None:
        """Score the runs of these indices, from which seeds are drawn.

        ``watch`` is shown every error signal that has an envelope: its name, times (T,) and values (T, R).
        """
        self._scenario = scenario
        self._watch = watch
        self._from_ns = nanoseconds(scenario.scoring.from_s)
        self._columns = {name: shared_columns(truth_columns, columns) for name, columns in estimates.items()}
        self._measures = {
            name: estimator_measures(scenario, truth_columns, columns) for name, columns in estimates.items()
        }
        self._phases = phase_names(scenario, truth_columns)
        self._tallies: dict[str, _Tally] = {}
        self._means: dict[str, _MeanOfKnown] = {
            f"{name}.{metric}": _MeanOfKnown()
            for name, columns in estimates.items()
            for metric in _consistency_names(truth_columns, columns)
        }
        rows = {name: counted_rows(scenario, truth_columns, columns) for name, columns in estimates.items()}
        self._seeds = {
            name: SeedScorer(scenario, counted, runs, self._phases) for name, counted in rows.items() if counted
        }

    def add(self, truth: Stream, estimates: Mapping[str, Stream]) -> None:
        """Take the next piece of every estimator."""
        for name, estimate in estimates.items():
            compared = compare(truth, estimate, self._columns[name], from_ns=self._from_ns)
            masks = phases(self._scenario, truth, compared.at_truth)
            runs = estimate.values.shape[1]
            for measure in self._measures[name]:
                values = measure.signal(compared.errors)
                if self._watch is not None and measure.envelope:
                    self._watch(f"{name}.{measure.envelope}", compared.t_ns, values)
                for suffix in self._phases if "{phase}" in measure.name else [""]:
                    key = f"{name}.{measure.name.format(phase=suffix)}"
                    tally = self._tallies.setdefault(key, self._tally(measure, runs))
                    tally.add(values[masks[suffix]], compared.t_ns[masks[suffix]])
            self._add_consistency(name, truth, estimate, compared)
            if name in self._seeds:
                self._seeds[name].add(truth, phases(self._scenario, truth, np.arange(len(truth))), estimate)

    def _add_consistency(self, name: str, truth: Stream, estimate: Stream, compared: Compared) -> None:
        nees = self._means.get(f"{name}.consistency.nees")
        if nees is not None:
            t_ns, values = sampled_nees(truth, estimate, compared)
            nees.add(values)
            if self._watch is not None:
                self._watch(f"{name}.nees", t_ns, values)
        for column in consistency.nis_columns(estimate.columns):
            values = estimate.column(column)[compared.at_estimate]
            self._means[f"{name}.consistency.{column}"].add(values)
            if self._watch is not None:
                self._watch(f"{name}.{column}", compared.t_ns, values)

    def _tally(self, measure: Measure, runs: int) -> _Tally:
        window = self._scenario.loss_window_s
        begin, end = window if window is not None else (0.0, 0.0)
        return _Tally(measure, runs, (nanoseconds(begin), nanoseconds(end)))

    def metrics(self) -> Metrics:
        """Metrics of all that was added, each of shape (R,)."""
        found: Metrics = {}
        for name in self._measures:
            for part in (self._tallies, self._means):
                found |= {key: tally.value() for key, tally in part.items() if key.startswith(f"{name}.")}
            if name in self._seeds:
                found |= {f"{name}.{key}": value for key, value in self._seeds[name].metrics().items()}
        return found


def sampled_nees(truth: Stream, estimate: Stream, compared: Compared) -> tuple[IntArray, FloatArray]:
    """NEES of an estimate's joint state once a second: times (T,), ns, and values (T, R)."""
    once_a_second = compared.t_ns % consistency.NEES_PERIOD_NS == 0
    rows = compared.at_truth[once_a_second], compared.at_estimate[once_a_second]
    states = consistency.state_columns(estimate.columns)
    return compared.t_ns[once_a_second], consistency.nees(truth, estimate, states, *rows)


class _MeanOfKnown:
    """Mean over time of values (T, R) that may be unknown (NaN) now and then."""

    def __init__(self) -> None:
        self._sum: FloatArray = np.zeros(1)
        self._count: FloatArray = np.zeros(1)

    def add(self, values: FloatArray) -> None:
        known = ~np.isnan(values)
        self._sum = self._sum + np.where(known, values, 0.0).sum(axis=0)
        self._count = self._count + known.sum(axis=0)

    def value(self) -> FloatArray:
        mean: FloatArray = np.full(len(self._sum), math.nan)
        return np.divide(self._sum, self._count, out=mean, where=self._count > 0)


class _Tally:
    """One reduction over time, for R runs, fed in pieces of shape (T, R)."""

    def __init__(self, measure: Measure, runs: int, loss_ns: tuple[int, int]) -> None:
        self._reduction = measure.reduction
        self._limit = measure.limit
        self._loss_ns = loss_ns
        self._count = 0
        start = {"max": -math.inf, "time_to": math.inf, "last": math.nan}.get(measure.reduction, 0.0)
        self._held: FloatArray = np.full(runs, start)

    def add(self, values: FloatArray, t_ns: IntArray) -> None:
        if not len(values):
            return
        self._count += len(values)
        match self._reduction:
            case "mean":
                self._held += values.sum(axis=0)
            case "rms":
                self._held += (values**2).sum(axis=0)
            case "max":
                self._held = np.maximum(self._held, values.max(axis=0))
            case "last":
                self._held = values[-1].copy()
            case "time_to":
                self._time_first_excess(values, t_ns)

    def _time_first_excess(self, values: FloatArray, t_ns: IntArray) -> None:
        begin, end = self._loss_ns
        since = (t_ns >= begin) & (t_ns < end)
        # An error that is not known before the first excess makes its time unknown (NaN stays NaN in a minimum).
        stops = ~(values[since] <= self._limit)
        if len(stops):
            at = stops.argmax(axis=0)
            first = (t_ns[since][at] - begin) / NS_PER_S
            first[np.isnan(values[since][at, np.arange(len(at))])] = math.nan
            found = np.where(stops.any(axis=0), first, math.inf)
            self._held = np.where(np.isinf(self._held), found, self._held)

    def value(self) -> FloatArray:
        if self._count == 0:
            return np.full_like(self._held, math.nan)
        if self._reduction == "mean":
            return self._held / self._count
        return np.sqrt(self._held / self._count) if self._reduction == "rms" else self._held


# --- what the machine really did -------------------------------------------------------------------------------------


def _motion_names(columns: Sequence[str]) -> list[str]:
    if YAW_RATE not in columns:
        return []
    names = ["motion.turning_s", "motion.turned_deg"]
    return names + [f"row_speed.mean_abs_transport_row_{row}_turns_m_s" for row in row_numbers(columns)]


def motion_metrics(truth: Stream, scenario: Scenario) -> Metrics:
    """What the machine did: time turning, heading change, and the speed that turning adds at each row, shape (1,).

    ``row_speed.mean_abs_transport_row_<i>_turns_m_s`` is the mean of |v_row - v| in turns, which is |y_row| times the
    heading change over the time turning: the error of whoever takes one speed for all rows.
    """
    if not truth.has(YAW_RATE):
        return {}
    at = np.flatnonzero(truth.t_ns >= nanoseconds(scenario.scoring.from_s))
    turning = at[phases(scenario, truth, at)["_turns"]]
    step_s = float(np.diff(truth.t_s).mean()) if len(truth) > 1 else 0.0
    values = [np.array([step_s * len(turning)])]
    values.append(np.degrees(step_s * np.abs(truth.column(YAW_RATE)[turning]).sum(axis=0)))
    for row in row_numbers(truth.columns):
        extra = np.abs(truth.column(row_speed(row))[turning] - truth.column(SPEED)[turning])
        values.append(extra.mean(axis=0) if len(turning) else np.full(1, math.nan))
    found = {f"truth.{name}": value for name, value in zip(_motion_names(truth.columns), values, strict=True)}
    return found | _bounds(truth, scenario)


# --- what a filter could know ----------------------------------------------------------------------------------------


def _bound_names(scenario: Scenario, columns: Sequence[str]) -> list[str]:
    if scenario.scoring.causal_bound_of is None or YAW_RATE not in columns:
        return []
    return [f"row_speed.mean_abs_error_{phase}_m_s" for phase in ("turns", "straights")]


def _bounds(truth: Stream, scenario: Scenario) -> Metrics:
    """Bound on the row-speed error of any causal filter with one estimator's sensors, at each phase's mean speed."""
    estimator = scenario.scoring.causal_bound_of
    if estimator is None:
        return {}
    rows = scenario.scoring.rows
    counted = [row for row in row_numbers(truth.columns) if rows is None or row in rows]
    rows_y_m = [scenario.machine.rows_y_m[row - 1] for row in counted]
    found: Metrics = {}
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
