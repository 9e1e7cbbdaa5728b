"""Scoring of estimates in pieces, as they are made; which metrics an estimator gets is said here too."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from twin.control import PathDriverConfig
from twin.families import CROSS_TRACK, Family, tolerated
from twin.recording import Stream
from twin.scenario import Scenario
from twin.scoring import against, consistency, guidance, ramps
from twin.scoring.compared import Compared, as_rows, claimed_sigma, compare, sampled_nees, shared_columns
from twin.scoring.cross_track import CrossTrack, CrossTrackErrors
from twin.scoring.driven_track import DrivenTrack
from twin.scoring.guidance import GuidanceScorer
from twin.scoring.honesty import Honesty
from twin.scoring.measures import Measure, Signal, measures_of
from twin.scoring.phases import phase_names, phases
from twin.scoring.reacquisition import FirstFixes
from twin.scoring.seeds import SeedScorer, counted_rows
from twin.scoring.tallies import MeanOfKnown, Tally
from twin.scoring.tolerance import ToleranceScorer, reacquisition_figures
from twin.signals import SPEED, BoolArray, FloatArray, IntArray, nanoseconds

Watch = Callable[[str, IntArray, FloatArray], None]
"""Is shown error signals: name, times (T,), values (T, R)."""


def estimator_measures(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> list[Measure]:
    """Measures of an estimator with these columns."""
    lossy = scenario.loss_window_s is not None
    return measures_of(
        guidance.judged_columns(scenario, truth, estimate),
        counted_rows=scenario.scoring.rows,
        limits=scenario.scoring.limits if lossy else {},
        lossy=lossy,
    )


def phased(measure: Measure, suffixes: Sequence[str]) -> list[str]:
    """Names of a measure in a run that has phases with these suffixes."""
    if "{phase}" not in measure.name:
        return [measure.name]
    return [measure.name.format(phase=suffix) for suffix in suffixes]


def consistency_names(truth: Sequence[str], estimate: Sequence[str]) -> list[str]:
    """Names of an estimator's consistency metrics."""
    states = consistency.state_columns(estimate)
    names = ["consistency.nees"] if states and set(states) <= set(truth) else []
    return names + [f"consistency.{column}" for column in consistency.nis_columns(estimate)]


def ramp_names(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> Sequence[str]:
    """Names of what is measured of an estimator where the speed changes, if a scenario asks for it."""
    asked = scenario.scoring.smallest_ramp_m_s is not None
    return ramps.NAMES if asked and SPEED in shared_columns(truth, estimate) else ()


def tolerated_family(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> Family | None:
    """The family by whose tolerance an estimator is judged."""
    return tolerated(guidance.judged_columns(scenario, truth, estimate))


def reacquisition_names(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> Sequence[str]:
    """Names of what is measured of an estimator where fixes come back, if a scenario asks for it."""
    family = tolerated_family(scenario, truth, estimate)
    asked = scenario.scoring.fixes_of is not None and scenario.loss_window_s is not None
    return reacquisition_figures(family) if asked and family is not None else ()


class Scorer:
    """Metrics of estimates that arrive in pieces, each with the truth of the same time."""

    def __init__(
        self,
        scenario: Scenario,
        truth_columns: Sequence[str],
        estimates: Mapping[str, Sequence[str]],
        *,
        runs: Sequence[int] = (0,),
        watch: Watch | None = None,
    ) -> None:
        """Score the runs of these indices, from which seeds are drawn.

        ``watch`` is shown every error signal that has an envelope.
        """
        self._scenario = scenario
        self._watch = watch
        self._from_ns = nanoseconds(scenario.scoring.from_s)
        begin, end = scenario.loss_window_s or (0.0, 0.0)
        self._loss_ns = nanoseconds(begin), nanoseconds(end)
        self._columns = {name: shared_columns(truth_columns, columns) for name, columns in estimates.items()}
        self._measures = {
            name: estimator_measures(scenario, truth_columns, columns) for name, columns in estimates.items()
        }
        self._track = DrivenTrack()
        self._cross_tracks = {
            name: CrossTrack()
            for name, columns in estimates.items()
            if CROSS_TRACK in guidance.judged_columns(scenario, truth_columns, columns)
        }
        self._guidance = {
            name: GuidanceScorer(scenario, truth_columns)
            for name, columns in estimates.items()
            if guidance.names(scenario, truth_columns, columns)
        }
        self._phases = phase_names(scenario, truth_columns)
        self._tallies: dict[str, Tally] = {}
        self._means: dict[str, MeanOfKnown] = {
            f"{name}.{metric}": MeanOfKnown()
            for name, columns in estimates.items()
            for metric in consistency_names(truth_columns, columns)
        }
        rows = {name: counted_rows(scenario, truth_columns, columns) for name, columns in estimates.items()}
        self._seeds = {
            name: SeedScorer(scenario, counted, runs, self._phases) for name, counted in rows.items() if counted
        }
        self._with_ramps = {name for name, columns in estimates.items() if ramp_names(scenario, truth_columns, columns)}
        self._ramps: dict[str, ramps.RampTally] = {}
        self._differences = against.DifferenceTally(scenario, estimates)
        self._fixes = FirstFixes(len(runs), self._loss_ns[1])
        self._tolerances = self._build_tolerances(truth_columns, estimates)

    def _build_tolerances(
        self, truth: Sequence[str], estimates: Mapping[str, Sequence[str]]
    ) -> dict[str, ToleranceScorer]:
        found = {}
        for name, columns in estimates.items():
            family = tolerated_family(self._scenario, truth, columns)
            if family is not None:
                with_fixes = bool(reacquisition_names(self._scenario, truth, columns))
                found[name] = ToleranceScorer(self._scenario, family, self._fixes if with_fixes else None)
        return found

    def add(self, truth: Stream, estimates: Mapping[str, Stream], fixes: Stream | None = None) -> None:
        """Take the next piece of every estimator, and of the hidden stream of the receiver ``scoring.fixes_of``.

        What an estimator says of a time must not come before the piece of that stream which holds it.
        """
        if fixes is not None:
            self._fixes.add(fixes)
        self._differences.add(estimates)
        if self._cross_tracks:
            self._track.add(truth)
        for name, estimate in estimates.items():
            compared = compare(truth, estimate, self._columns[name], from_ns=self._from_ns)
            masks = phases(self._scenario, truth, compared.at_truth)
            self._add_measures(name, compared.t_ns, compared.errors, masks, across=False)
            if name in self._cross_tracks:
                self._add_cross_track(name, self._cross_tracks[name].add(self._track, estimate, compared, masks))
            if name in self._guidance:
                straights = masks.get("_straights", masks[""])
                self._guidance[name].add(truth, estimate, compared, straights)
            self._add_consistency(name, truth, estimate, compared)
            if name in self._seeds:
                self._seeds[name].add(truth, phases(self._scenario, truth, np.arange(len(truth))), estimate)
            if name in self._with_ramps:
                errors = compared.errors[:, :, self._columns[name].index(SPEED)]
                speed = truth.column(SPEED)[compared.at_truth, 0]
                runs = estimate.values.shape[1]
                self._ramps.setdefault(name, self._ramp_tally(runs)).add(compared.t_ns, speed, errors)
            if name in self._tolerances and self._tolerances[name].column != CROSS_TRACK:
                scorer = self._tolerances[name]
                column = self._columns[name].index(scorer.column)
                sigmas = claimed_sigma(estimate, scorer.column, compared)
                scorer.add(compared.t_ns, compared.errors[:, :, column], sigmas)

    def _add_measures(
        self, name: str, t_ns: IntArray, errors: FloatArray, masks: Mapping[str, BoolArray], *, across: bool
    ) -> None:
        """Take errors (T, R, n): those of the measures across the track, or of all others."""
        parts = {suffix: as_rows(np.flatnonzero(mask)) for suffix, mask in masks.items()}
        made: dict[Signal, FloatArray] = {}
        for measure in self._measures[name]:
            if measure.across != across:
                continue
            if measure.signal not in made:
                made[measure.signal] = measure.signal(errors)
            values = made[measure.signal]
            if self._watch is not None and measure.envelope:
                self._watch(f"{name}.{measure.envelope}", t_ns, values)
            for suffix in self._phases if "{phase}" in measure.name else [""]:
                key = f"{name}.{measure.name.format(phase=suffix)}"
                if key not in self._tallies:
                    self._tallies[key] = Tally(measure, values.shape[1], self._loss_ns)
                self._tallies[key].add(values[parts[suffix]], t_ns[parts[suffix]])

    def _add_cross_track(self, name: str, pieces: Sequence[CrossTrackErrors]) -> None:
        for piece in pieces:
            self._add_measures(name, piece.t_ns, piece.errors_m[..., np.newaxis], piece.masks, across=True)
            if name in self._tolerances and self._tolerances[name].column == CROSS_TRACK:
                self._tolerances[name].add(piece.t_ns, piece.errors_m, piece.sigmas_m)

    def _finish(self) -> None:
        for name, cross_track in self._cross_tracks.items():
            self._add_cross_track(name, cross_track.finish(self._track))

    def _add_consistency(self, name: str, truth: Stream, estimate: Stream, compared: Compared) -> None:
        nees = self._means.get(f"{name}.consistency.nees")
        if nees is not None:
            t_ns, values = sampled_nees(truth, estimate, compared)
            nees.add(values)
            if self._watch is not None:
                self._watch(f"{name}.nees", t_ns, values)
        for column in consistency.nis_columns(estimate.columns):
            values = estimate.column(column)[as_rows(compared.at_estimate)]
            self._means[f"{name}.consistency.{column}"].add(values)
            if self._watch is not None:
                self._watch(f"{name}.{column}", compared.t_ns, values)

    def _ramp_tally(self, runs: int) -> ramps.RampTally:
        driver = self._scenario.driver
        assert isinstance(driver, PathDriverConfig), "the scenario has checked it"
        return ramps.RampTally(
            runs,
            acceleration_m_s2=driver.acceleration_m_s2,
            smallest_m_s=self._scenario.scoring.smallest_ramp_m_s or 0.0,
        )

    def metrics(self) -> dict[str, FloatArray]:
        """Metrics of all that was added, each of shape (R,); nothing can be added after."""
        self._finish()
        found: dict[str, FloatArray] = {}
        for name in self._measures:
            for part in (self._tallies, self._means):
                found |= {key: tally.value() for key, tally in part.items() if key.startswith(f"{name}.")}
            if name in self._seeds:
                found |= {f"{name}.{key}": value for key, value in self._seeds[name].metrics().items()}
            if name in self._ramps:
                found |= {f"{name}.{metric}": value for metric, value in self._ramps[name].metrics().items()}
            if name in self._tolerances:
                found |= {f"{name}.{metric}": value for metric, value in self._tolerances[name].metrics().items()}
            found |= {f"{name}.{metric}": value for metric, value in self._differences.metrics(name).items()}
            if name in self._guidance:
                found |= {f"{name}.{metric}": value for metric, value in self._guidance[name].metrics().items()}
        return found

    def honesty(self) -> dict[str, Honesty]:
        """What is pooled over members, by estimator: of all that was added; nothing can be added after."""
        self._finish()
        return {name: scorer.honesty() for name, scorer in self._tolerances.items()}
