"""Metrics of estimates against the truth, matched by column name.

A metric is named ``<estimator>.<family>.<what>_<unit>``. Errors are estimate minus truth at the times that both streams
have, from ``scoring.from_s`` on. Phases: the whole run, ``turns`` (true yaw rate beyond ``scoring.turning_rad_s``) and
``straights`` (the rest); where a sensor has a fault with a time window also ``loss`` (in the window) and ``after``
(from its end on). How fast an estimate follows a change of speed is measured apart (:mod:`twin.scoring.ramps`), and so
is the difference from an estimate that a paper took for the truth (:mod:`twin.scoring.against`), what happens when
fixes come back after a loss (:mod:`twin.scoring.reacquisition`), whether an estimate is as wrong as it says
(:mod:`twin.scoring.honesty`), and what guidance along lines is judged by (:mod:`twin.scoring.guidance`), where a
scenario asks for it. Names are known before a run (:func:`metric_names`), so that a check on a metric that cannot exist
is refused before anything is simulated.

A recording may be scored whole, or in pieces as it is made (:class:`twin.scoring.scorer.Scorer`), so that an ensemble
need not be kept. Values are arrays over the ensemble axis, shape (R,): NaN where a phase did not occur or an estimate
was missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.recording import Recording, hidden_stream
from twin.scenario import Scenario
from twin.scoring import against, bus, guidance
from twin.scoring.honesty import names as honesty_names
from twin.scoring.honesty import pooled_metrics
from twin.scoring.motion import motion_metrics, motion_names
from twin.scoring.phases import phase_names
from twin.scoring.scorer import (
    Scorer,
    consistency_names,
    estimator_measures,
    phased,
    ramp_names,
    reacquisition_names,
    tolerated_family,
)
from twin.scoring.seeds import counted_rows, seed_metric_names
from twin.signals import FloatArray

Metrics = dict[str, FloatArray]


def metric_names(scenario: Scenario, truth: Sequence[str], estimates: Mapping[str, Sequence[str]]) -> list[str]:
    """Names of all metrics that a run with these truth and estimate columns will have."""
    names = motion_names(scenario, truth)
    for estimator, columns in estimates.items():
        for measure in estimator_measures(scenario, truth, columns):
            names += [f"{estimator}.{name}" for name in phased(measure, phase_names(scenario, truth))]
        names += [f"{estimator}.{name}" for name in consistency_names(truth, columns)]
        seeds = seed_metric_names(counted_rows(scenario, truth, columns), phase_names(scenario, truth))
        names += [f"{estimator}.{name}" for name in seeds]
        names += [f"{estimator}.{name}" for name in ramp_names(scenario, truth, columns)]
        names += [f"{estimator}.{name}" for name in reacquisition_names(scenario, truth, columns)]
        if against.shared_rows(scenario, estimator, estimates):
            names.append(f"{estimator}.{against.NAME}")
        names += [f"{estimator}.{name}" for name in guidance.names(scenario, truth, columns)]
    return names + pooled_names(scenario, truth, estimates) + bus.metric_names(scenario)


def pooled_names(scenario: Scenario, truth: Sequence[str], estimates: Mapping[str, Sequence[str]]) -> list[str]:
    """Names of those metrics that are one figure of all members together."""
    names: list[str] = []
    for estimator, columns in estimates.items():
        family = tolerated_family(scenario, truth, columns)
        if family is not None:
            names += [f"{estimator}.{name}" for name in honesty_names(scenario, family)]
    return names


def compute(recording: Recording, scenario: Scenario) -> Metrics:
    """All metrics of a whole recording, each of shape (R,); those that are of the whole of shape (1,)."""
    truth = recording.truth
    estimates = {name: recording.estimates(name) for name in recording.names("estimates")}
    columns = {name: stream.columns for name, stream in estimates.items()}
    scorer = Scorer(scenario, truth.columns, columns, runs=recording.runs)
    receiver = scenario.scoring.fixes_of
    fixes = None if receiver is None else recording.streams.get(hidden_stream(receiver))
    scorer.add(truth, estimates, fixes)
    of_members = scorer.metrics()
    of_all = {**pooled_metrics(scorer.honesty(), scenario), **bus.metrics(scenario)}
    return {
        **motion_metrics(truth, scenario),
        **of_members,
        **{name: np.array([value]) for name, value in of_all.items()},
    }
