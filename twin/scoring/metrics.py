"""Metrics of estimates against the truth, matched by column name.

A metric is named ``<estimator>.<family>.<what>_<unit>``. Errors are estimate minus truth at the times that both
streams have, from ``scoring.from_s`` on. Phases: the whole run, ``turns`` (true yaw rate beyond
``scoring.turning_rad_s``) and ``straights`` (the rest); where a sensor has a fault with a time window also ``loss`` (in
the window) and ``after`` (from its end on). How fast an estimate follows a change of speed is measured apart
(:mod:`twin.scoring.ramps`), and so is the difference from an estimate that a paper took for the truth
(:mod:`twin.scoring.against`), where a scenario asks for it. Names are known before a run (:func:`metric_names`), so
that a check on a metric that cannot exist is refused before anything is simulated.

A recording may be scored whole, or in pieces as it is made (:class:`Scorer`), so that an ensemble need not be kept.
Values are arrays over the ensemble axis, shape (R,): NaN where a phase did not occur or an estimate was missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.control import PathDriverConfig
from twin.geometry import wrap_angle
from twin.recording import Recording, Stream
from twin.scenario import Scenario
from twin.scoring import against, bus, consistency, ramps
from twin.scoring.measures import Measure, measures_of
from twin.scoring.motion import motion_metrics, motion_names
from twin.scoring.phases import phase_names, phases
from twin.scoring.seeds import SeedScorer, counted_rows, seed_metric_names
from twin.scoring.tallies import MeanOfKnown, Tally
from twin.signals import SPEED, FloatArray, IntArray, nanoseconds, wraps

Metrics = dict[str, FloatArray]


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
    names = motion_names(scenario, truth)
    for estimator, columns in estimates.items():
        for measure in estimator_measures(scenario, truth, columns):
            names += [f"{estimator}.{name}" for name in _phased(measure, phase_names(scenario, truth))]
        names += [f"{estimator}.{name}" for name in _consistency_names(truth, columns)]
        seeds = seed_metric_names(counted_rows(scenario, truth, columns), phase_names(scenario, truth))
        names += [f"{estimator}.{name}" for name in seeds]
        names += [f"{estimator}.{name}" for name in _ramp_names(scenario, truth, columns)]
        if against.shared_rows(scenario, estimator, estimates):
            names.append(f"{estimator}.{against.NAME}")
    return names + bus.metric_names(scenario)


def _ramp_names(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> Sequence[str]:
    asked = scenario.scoring.smallest_ramp_m_s is not None
    return ramps.NAMES if asked and SPEED in shared_columns(truth, estimate) else ()


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
        self._tallies: dict[str, Tally] = {}
        self._means: dict[str, MeanOfKnown] = {
            f"{name}.{metric}": MeanOfKnown()
            for name, columns in estimates.items()
            for metric in _consistency_names(truth_columns, columns)
        }
        rows = {name: counted_rows(scenario, truth_columns, columns) for name, columns in estimates.items()}
        self._seeds = {
            name: SeedScorer(scenario, counted, runs, self._phases) for name, counted in rows.items() if counted
        }
        self._with_ramps = {
            name for name, columns in estimates.items() if _ramp_names(scenario, truth_columns, columns)
        }
        self._ramps: dict[str, ramps.RampTally] = {}
        self._differences = against.DifferenceTally(scenario, estimates)

    def add(self, truth: Stream, estimates: Mapping[str, Stream]) -> None:
        """Take the next piece of every estimator."""
        self._differences.add(estimates)
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
            if name in self._with_ramps:
                errors = compared.errors[:, :, self._columns[name].index(SPEED)]
                speed = truth.column(SPEED)[compared.at_truth, 0]
                self._ramps.setdefault(name, self._ramp_tally(runs)).add(compared.t_ns, speed, errors)

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

    def _tally(self, measure: Measure, runs: int) -> Tally:
        window = self._scenario.loss_window_s
        begin, end = window if window is not None else (0.0, 0.0)
        return Tally(measure, runs, (nanoseconds(begin), nanoseconds(end)))

    def _ramp_tally(self, runs: int) -> ramps.RampTally:
        driver = self._scenario.driver
        assert isinstance(driver, PathDriverConfig), "the scenario has checked it"
        return ramps.RampTally(
            runs,
            acceleration_m_s2=driver.acceleration_m_s2,
            smallest_m_s=self._scenario.scoring.smallest_ramp_m_s or 0.0,
        )

    def metrics(self) -> Metrics:
        """Metrics of all that was added, each of shape (R,); nothing can be added after."""
        found: Metrics = {}
        for name in self._measures:
            for part in (self._tallies, self._means):
                found |= {key: tally.value() for key, tally in part.items() if key.startswith(f"{name}.")}
            if name in self._seeds:
                found |= {f"{name}.{key}": value for key, value in self._seeds[name].metrics().items()}
            if name in self._ramps:
                found |= {f"{name}.{metric}": value for metric, value in self._ramps[name].metrics().items()}
            found |= {f"{name}.{metric}": value for metric, value in self._differences.metrics(name).items()}
        return found


def sampled_nees(truth: Stream, estimate: Stream, compared: Compared) -> tuple[IntArray, FloatArray]:
    """NEES of an estimate's joint state once a second: times (T,), ns, and values (T, R)."""
    once_a_second = compared.t_ns % consistency.NEES_PERIOD_NS == 0
    rows = compared.at_truth[once_a_second], compared.at_estimate[once_a_second]
    states = consistency.state_columns(estimate.columns)
    return compared.t_ns[once_a_second], consistency.nees(truth, estimate, states, *rows)
