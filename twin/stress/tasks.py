"""One task of a stress test: a block of the members of one point in one world.

Where the world does not depend on the members it is simulated once, its tape is played to the block on the ensemble
axis, and what the members estimate is scored in pieces and thrown away, so memory does not grow with the members.
Where driver or implement goes by what is measured every member moves its own way, in a world of its own, one after the
other.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.execution import Journey, open_members, open_world
from twin.members import Tape
from twin.recording import Stream
from twin.scenario import LoadedScenario
from twin.scoring import bus
from twin.scoring.checks import require_known
from twin.scoring.metrics import metric_names
from twin.scoring.motion import motion_metrics
from twin.scoring.scorer import Scorer
from twin.signals import NS_PER_S, nanoseconds
from twin.stress.plan import Plan, Task
from twin.stress.task_result import TaskResult, Watcher, joined

_ROWS_IN_A_PIECE = 100_000
"""Estimates (instants times members) scored at a time."""


def run_task(plan: Plan, point: int, world: int) -> TaskResult:
    """Simulate one world and score all members in it.

    Raises:
        BadInputError: the scenario cannot be built, or a check names a metric that will not exist.
    """
    return joined(run_block(plan, Task(point, world, block)) for block in range(plan.blocks(point)))


def run_block(plan: Plan, task: Task) -> TaskResult:
    """Simulate one world and score a block of members in it.

    Raises:
        BadInputError: the scenario cannot be built, or a check names a metric that will not exist.
    """
    loaded = plan.load(task.point, task.world)
    runs = plan.members(task)
    if loaded.scenario.listens.closes_loop:
        return _each_for_itself(loaded, runs)
    return _over_one_truth(loaded, runs)


# --- over one truth --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shown:
    """A world that has been simulated: what it showed the sensors, and what was true."""

    tape: Tape
    truth: Stream
    ended_reason: str
    ended_t_s: float


class _LastShown:
    """Keeps the last world, so that blocks of its members that follow one another in a process simulate it once."""

    def __init__(self) -> None:
        self._of = ""
        self._shown: _Shown | None = None

    def show(self, loaded: LoadedScenario) -> _Shown:
        """The world of a scenario (its seed included)."""
        if self._shown is None or self._of != f"{loaded.path} {loaded.sha256}":
            self._shown = None
            self._shown = _simulate(loaded)
            self._of = f"{loaded.path} {loaded.sha256}"
        return self._shown


_last = _LastShown()


def _simulate(loaded: LoadedScenario) -> _Shown:
    scenario = loaded.scenario
    tape = Tape(scenario)
    with open_world(loaded) as built:
        journey = Journey(scenario, built, tape)
        columns = open_members(loaded, runs=(0,), keep_measurements=False).estimate_columns
        require_known(scenario, metric_names(scenario, journey.truth_columns, columns), where=str(loaded.path))
        reason = journey.go()
        ended_t_s = built.tick * built.dt_ns / NS_PER_S
    return _Shown(tape=tape, truth=journey.truth_stream(), ended_reason=reason, ended_t_s=ended_t_s)


def _over_one_truth(loaded: LoadedScenario, runs: Sequence[int]) -> TaskResult:
    """The world once, and the members over it."""
    scenario = loaded.scenario
    started = time.perf_counter()
    shown = _last.show(loaded)
    simulated = time.perf_counter()
    result = TaskResult.empty(shown.ended_reason, shown.ended_t_s)
    result.motion = {name: float(value[0]) for name, value in motion_metrics(shown.truth, scenario).items()}
    result.motion |= bus.metrics(scenario)
    watcher = Watcher(shown.truth.t_ns, result, with_first=runs[0] == 0)
    members = open_members(loaded, runs=runs, keep_measurements=False)
    watcher.note_states({name: len(estimator.state_columns) for name, estimator in members.estimators.items()})
    scorer = Scorer(scenario, shown.truth.columns, members.estimate_columns, runs=runs, watch=watcher.take)
    rate_hz = max((config.rate_hz for config in scenario.estimators.values()), default=50.0)
    pause_ns = max(1, int(_ROWS_IN_A_PIECE / len(runs) / rate_hz)) * NS_PER_S
    for _ in shown.tape.play(members, pause_ns=pause_ns):
        scorer.add(shown.truth, members.drain_estimates(), members.drain_fixes())
    result.metrics, result.honesty = scorer.metrics(), scorer.honesty()
    result.wall_s = {"world": simulated - started, "members": time.perf_counter() - simulated}
    return result


# --- closed loops ----------------------------------------------------------------------------------------------------


def _each_for_itself(loaded: LoadedScenario, runs: Sequence[int]) -> TaskResult:
    """A world for every member, and what it did there among its metrics."""
    return joined(_alone(loaded, run) for run in runs)


def _alone(loaded: LoadedScenario, run: int) -> TaskResult:
    scenario = loaded.scenario
    started = time.perf_counter()
    members = open_members(loaded, runs=(run,), keep_measurements=False)
    columns = members.estimate_columns
    with open_world(loaded) as built:
        journey = Journey(scenario, built, members)
        require_known(scenario, metric_names(scenario, journey.truth_columns, columns), where=str(loaded.path))
        reason = journey.go()
        result = TaskResult.empty(reason, built.tick * built.dt_ns / NS_PER_S)
    members.finish()
    truth = journey.truth_stream()
    # The same instants in every member, also in one whose run ended early.
    step_ns = max(1, round(NS_PER_S / scenario.recording.truth_hz))
    watcher = Watcher(np.arange(0, nanoseconds(scenario.duration_s) + 1, step_ns), result, with_first=run == 0)
    watcher.note_states({name: len(estimator.state_columns) for name, estimator in members.estimators.items()})
    scorer = Scorer(scenario, truth.columns, columns, runs=(run,), watch=watcher.take)
    scorer.add(truth, members.drain_estimates(), members.drain_fixes())
    result.metrics = {**scorer.metrics(), **motion_metrics(truth, scenario)}
    result.honesty = scorer.honesty()
    result.motion = bus.metrics(scenario)
    result.wall_s = {"world": 0.0, "members": time.perf_counter() - started}
    return result
