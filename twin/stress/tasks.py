"""One task of a stress test: all members of one point in one world.

Where the world does not depend on the members it is simulated once, its tape is played to blocks of members on the
ensemble axis, and what they estimate is scored in pieces and thrown away, so memory does not grow with the members.
Where a driver listens to its sensors every member drives its own way, in a world of its own, one after the other.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.execution import Journey, open_members, open_world
from twin.members import Tape
from twin.recording import Stream
from twin.scenario import LoadedScenario
from twin.scoring import bus
from twin.scoring.checks import require_known
from twin.scoring.consistency import NIS_PREFIX
from twin.scoring.envelopes import Envelope
from twin.scoring.metrics import metric_names
from twin.scoring.motion import motion_metrics
from twin.scoring.scorer import Scorer
from twin.signals import COLLISION, NS_PER_S, FloatArray, IntArray, nanoseconds
from twin.stress.plan import Plan

BLOCK = 500
"""Members that are stepped together."""
_ROWS_IN_A_PIECE = 100_000
"""Estimates (instants times members) scored at a time."""
_ENVELOPE_PERIOD_NS = NS_PER_S // 5


@dataclass(kw_only=True)
class TaskResult:
    """What came of all members of one point in one world."""

    metrics: dict[str, FloatArray]
    """(R,) by name."""
    motion: dict[str, float]
    """What the machine did, and what its buses carry: the same for all members."""
    envelopes: dict[str, Envelope]
    nees: dict[str, tuple[IntArray, FloatArray]]
    """By estimator: times (T,) and NEES of the first member (T,)."""
    nis: dict[str, tuple[IntArray, FloatArray]]
    """By ``<estimator>.<column>``: ends of seconds (T,) and the first member's first NIS in each of them (T,)."""
    states: dict[str, int]
    """By estimator: number of states of its covariance."""
    ended_reason: str = "duration"
    ended_t_s: float = 0.0
    wall_s: dict[str, float] = field(default_factory=dict)


def run_task(plan: Plan, point: int, world: int) -> TaskResult:
    """Simulate one world and score all members in it.

    Raises:
        BadInputError: the scenario cannot be built, or a check names a metric that will not exist.
    """
    loaded = plan.load(point, world)
    if loaded.scenario.listens.closes_loop:
        return _each_for_itself(loaded, plan)
    return _over_one_truth(loaded, plan)


def _empty(ended_reason: str = "duration", ended_t_s: float = 0.0) -> TaskResult:
    return TaskResult(
        metrics={}, motion={}, envelopes={}, nees={}, nis={}, states={}, ended_reason=ended_reason, ended_t_s=ended_t_s
    )


def _over_one_truth(loaded: LoadedScenario, plan: Plan) -> TaskResult:
    """The world once, and all members over it."""
    scenario = loaded.scenario
    started = time.perf_counter()
    tape = Tape(scenario)
    with open_world(loaded) as built:
        journey = Journey(scenario, built, tape)
        columns = open_members(loaded, runs=(0,), keep_measurements=False).estimate_columns
        require_known(scenario, metric_names(scenario, journey.truth_columns, columns), where=str(loaded.path))
        reason = journey.go()
        ended_t_s = built.tick * built.dt_ns / NS_PER_S
    truth = journey.truth_stream()
    simulated = time.perf_counter()
    result = _empty(reason, ended_t_s)
    result.motion = {name: float(value[0]) for name, value in motion_metrics(truth, scenario).items()}
    result.motion |= bus.metrics(scenario)
    pieces: list[dict[str, FloatArray]] = []
    watcher = _Watcher(truth.t_ns, result)
    for first in range(0, plan.runs, BLOCK):
        runs = range(first, min(first + BLOCK, plan.runs))
        pieces.append(_score_block(loaded, truth, tape, runs, watcher))
        watcher.first_block = False
    result.metrics = _joined(pieces)
    result.wall_s = {"world": simulated - started, "members": time.perf_counter() - simulated}
    return result


def _each_for_itself(loaded: LoadedScenario, plan: Plan) -> TaskResult:
    """A world for every member, and what it did there among its metrics.

    Of members whose run ended before its time the first names the reason, one that touched a tree last.
    """
    scenario = loaded.scenario
    started = time.perf_counter()
    result = _empty()
    step_ns = max(1, round(NS_PER_S / scenario.recording.truth_hz))
    watcher = _Watcher(np.arange(0, nanoseconds(scenario.duration_s) + 1, step_ns), result)
    pieces: list[dict[str, FloatArray]] = []
    for run in range(plan.runs):
        members = open_members(loaded, runs=(run,), keep_measurements=False)
        columns = members.estimate_columns
        with open_world(loaded) as built:
            journey = Journey(scenario, built, members)
            require_known(scenario, metric_names(scenario, journey.truth_columns, columns), where=str(loaded.path))
            reason = journey.go()
            ended_t_s = built.tick * built.dt_ns / NS_PER_S
        members.finish()
        truth = journey.truth_stream()
        watcher.note_states({name: len(estimator.state_columns) for name, estimator in members.estimators.items()})
        scorer = Scorer(scenario, truth.columns, columns, runs=(run,), watch=watcher.take)
        scorer.add(truth, members.drain_estimates())
        watcher.first_block = False
        pieces.append({**scorer.metrics(), **motion_metrics(truth, scenario)})
        if result.ended_reason == "duration" or (result.ended_reason == COLLISION and reason not in _ORDINARY):
            result.ended_reason, result.ended_t_s = reason, ended_t_s
    result.metrics = _joined(pieces)
    result.motion = bus.metrics(scenario)
    result.wall_s = {"world": 0.0, "members": time.perf_counter() - started}
    return result


_ORDINARY = ("duration", COLLISION)


def _joined(pieces: Sequence[dict[str, FloatArray]]) -> dict[str, FloatArray]:
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def _score_block(
    loaded: LoadedScenario, truth: Stream, tape: Tape, runs: Sequence[int], watcher: _Watcher
) -> dict[str, FloatArray]:
    scenario = loaded.scenario
    members = open_members(loaded, runs=runs, keep_measurements=False)
    columns = members.estimate_columns
    watcher.note_states({name: len(estimator.state_columns) for name, estimator in members.estimators.items()})
    scorer = Scorer(scenario, truth.columns, columns, runs=runs, watch=watcher.take)
    rate_hz = max((config.rate_hz for config in scenario.estimators.values()), default=50.0)
    pause_ns = max(1, int(_ROWS_IN_A_PIECE / len(runs) / rate_hz)) * NS_PER_S
    for _ in tape.play(members, pause_ns=pause_ns):
        scorer.add(truth, members.drain_estimates())
    return scorer.metrics()


class _Watcher:
    """Collects envelopes over all members of a task, NEES and NIS of its first."""

    def __init__(self, t_ns: IntArray, result: TaskResult) -> None:
        self._instants = t_ns[t_ns % _ENVELOPE_PERIOD_NS == 0]
        self._result = result
        self.first_block = True

    def note_states(self, states: dict[str, int]) -> None:
        self._result.states = states

    def take(self, name: str, t_ns: IntArray, values: FloatArray) -> None:
        estimator, _, signal = name.partition(".")
        if signal == "nees" or signal.startswith(NIS_PREFIX):
            if self.first_block:
                self._take_first(estimator, signal, t_ns, values[:, 0])
            return
        if name not in self._result.envelopes:
            self._result.envelopes[name] = Envelope.at(self._instants)
        self._result.envelopes[name].add(t_ns, values)

    def _take_first(self, estimator: str, signal: str, t_ns: IntArray, values: FloatArray) -> None:
        known = ~np.isnan(values)
        if signal == "nees":
            times, before = self._result.nees.get(estimator, (np.empty(0, dtype=np.int64), np.empty(0)))
            self._result.nees[estimator] = np.append(times, t_ns[known]), np.append(before, values[known])
        else:
            key = f"{estimator}.{signal}"
            times, before = self._result.nis.get(key, (np.empty(0, dtype=np.int64), np.empty(0)))
            # One a second, at the end of its second, so that worlds with other arrivals have instants in common.
            ends, first = np.unique(-(-t_ns[known] // NS_PER_S) * NS_PER_S, return_index=True)
            new = ~np.isin(ends, times)
            self._result.nis[key] = np.append(times, ends[new]), np.append(before, values[known][first[new]])
