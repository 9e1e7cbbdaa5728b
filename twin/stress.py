"""Many runs of one scenario: noise realisations side by side, in several worlds, with a key varied.

One (point, world) is one task: the world is simulated once, its tape is played to blocks of members on the ensemble
axis, and what they estimate is scored in pieces and thrown away, so memory does not grow with the members. Blocks are
fixed by index and tasks are merged in order, so the numbers do not depend on the number of workers.
"""

from __future__ import annotations

import itertools
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from twin.errors import BadInputError
from twin.execution import Journey, open_members, open_world
from twin.members import Tape
from twin.recording import Stream
from twin.scenario import LoadedScenario, load, parse_setting
from twin.scoring import bus
from twin.scoring.checks import require_known
from twin.scoring.consistency import NIS_PREFIX
from twin.scoring.envelopes import Envelope
from twin.scoring.metrics import Scorer, metric_names
from twin.scoring.motion import motion_metrics
from twin.signals import NS_PER_S, FloatArray, IntArray

BLOCK = 500
"""Members that are stepped together."""
_ROWS_IN_A_PIECE = 100_000
"""Estimates (instants times members) scored at a time."""
_ENVELOPE_PERIOD_NS = NS_PER_S // 5
_LARGEST_RUN = 10_000_000
_RANGE_POINTS = 5

Setting = tuple[str, Any]
Told = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What to run."""

    path: Path
    settings: tuple[Setting, ...]
    runs: int
    seeds: tuple[int, ...]
    """One world each."""
    points: tuple[tuple[Setting, ...], ...]
    """Settings of each point of ``--vary``; one empty point without."""

    def tasks(self) -> list[tuple[int, int]]:
        """Every (point, world), in the order in which results are merged."""
        return list(itertools.product(range(len(self.points)), range(len(self.seeds))))

    def load(self, point: int, world: int) -> LoadedScenario:
        """The scenario of one task.

        Raises:
            BadInputError: it is wrong.
        """
        return load(self.path, settings=[*self.settings, *self.points[point], ("seed", self.seeds[world])])


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


def parse_vary(text: str) -> list[Setting]:
    """Values of ``KEY=LO:HI`` (five, evenly spaced), ``KEY=LO:HI:N`` or ``KEY=A,B,C``.

    Raises:
        BadInputError: none of these forms.
    """
    key, equals, values = text.partition("=")
    if not equals or not key.strip() or not values.strip():
        raise BadInputError(f"--vary {text!r}: expected KEY=LO:HI, KEY=LO:HI:N or KEY=A,B,C")
    if ":" in values and "," not in values:
        parts = values.split(":")
        try:
            low, high = float(parts[0]), float(parts[1])
            count = int(parts[2]) if len(parts) > 2 else _RANGE_POINTS
        except ValueError:
            raise BadInputError(f"--vary {text!r}: a range is LO:HI or LO:HI:N with numbers") from None
        if len(parts) > 3 or not 1 <= count <= 1000 or not np.isfinite([low, high]).all():
            raise BadInputError(f"--vary {text!r}: a range is LO:HI or LO:HI:N with N from 1 to 1000")
        return [(key.strip(), float(value)) for value in np.linspace(low, high, count)]
    return [parse_setting(f"{key}={value}") for value in values.split(",")]


def make_plan(
    path: Path, *, runs: int, worlds: int, settings: Sequence[Setting], vary: Sequence[str], seed: int | None
) -> Plan:
    """Lay out the tasks; every point is loaded once, so that bad input shows before anything is simulated.

    Raises:
        BadInputError: a setting or a varied value is wrong.
    """
    if not 1 <= runs <= _LARGEST_RUN or not 1 <= worlds <= _LARGEST_RUN:
        raise BadInputError(f"--runs {runs} --worlds {worlds}: expected at least 1 of each, at most {_LARGEST_RUN}")
    points = tuple(itertools.product(*(parse_vary(text) for text in vary)))
    first = load(path, settings=[*settings, *points[0], *([("seed", seed)] if seed is not None else [])])
    seeds = tuple(range(first.scenario.seed, first.scenario.seed + worlds))
    plan = Plan(path=path, settings=tuple(settings), runs=runs, seeds=seeds, points=points)
    for point in range(len(points)):
        plan.load(point, 0)
    return plan


# --- one task --------------------------------------------------------------------------------------------------------


def run_task(plan: Plan, point: int, world: int) -> TaskResult:
    """Simulate one world and score all members in it.

    Raises:
        BadInputError: the scenario cannot be built, or a check names a metric that will not exist.
    """
    loaded = plan.load(point, world)
    scenario = loaded.scenario
    started = time.perf_counter()
    tape = Tape(scenario)
    with open_world(loaded) as built:
        journey = Journey(scenario, built, tape)
        reason = journey.go()
        ended_t_s = built.tick * built.dt_ns / NS_PER_S
    truth = journey.truth_stream()
    simulated = time.perf_counter()
    result = TaskResult(
        metrics={},
        motion={
            **{name: float(value[0]) for name, value in motion_metrics(truth, scenario).items()},
            **bus.metrics(scenario),
        },
        envelopes={},
        nees={},
        nis={},
        states={},
        ended_reason=reason,
        ended_t_s=ended_t_s,
    )
    pieces: list[dict[str, FloatArray]] = []
    watcher = _Watcher(truth, result)
    for first in range(0, plan.runs, BLOCK):
        runs = range(first, min(first + BLOCK, plan.runs))
        pieces.append(_score_block(loaded, truth, tape, runs, watcher))
        watcher.first_block = False
    result.metrics = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    result.wall_s = {"world": simulated - started, "members": time.perf_counter() - simulated}
    return result


def _score_block(
    loaded: LoadedScenario, truth: Stream, tape: Tape, runs: Sequence[int], watcher: _Watcher
) -> dict[str, FloatArray]:
    scenario = loaded.scenario
    members = open_members(loaded, runs=runs, keep_measurements=False)
    columns = members.estimate_columns
    require_known(scenario, metric_names(scenario, truth.columns, columns), where=str(loaded.path))
    watcher.note_states({name: len(estimator.state_columns) for name, estimator in members.estimators.items()})
    scorer = Scorer(scenario, truth.columns, columns, runs=runs, watch=watcher.take)
    rate_hz = max((config.rate_hz for config in scenario.estimators.values()), default=50.0)
    pause_ns = max(1, int(_ROWS_IN_A_PIECE / len(runs) / rate_hz)) * NS_PER_S
    for _ in tape.play(members, pause_ns=pause_ns):
        scorer.add(truth, members.drain_estimates())
    return scorer.metrics()


class _Watcher:
    """Collects envelopes over all members of a task, NEES and NIS of its first."""

    def __init__(self, truth: Stream, result: TaskResult) -> None:
        self._instants = truth.t_ns[truth.t_ns % _ENVELOPE_PERIOD_NS == 0]
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


# --- all tasks -------------------------------------------------------------------------------------------------------


def run_tasks(
    plan: Plan, *, workers: int, done: dict[tuple[int, int], TaskResult], tell: Told | None = None
) -> Iterator[tuple[tuple[int, int], TaskResult]]:
    """Run what is not yet in ``done``, in as many processes as asked; results come in the order of the tasks."""
    tasks = [task for task in plan.tasks() if task not in done]
    if workers == 1 or len(tasks) <= 1:
        for task in tasks:
            if tell is not None:
                tell(describe(plan, *task))
            yield task, run_task(plan, *task)
        return
    # A pool that is left early is terminated: an interrupted stress test does not wait for its workers.
    with get_context("spawn").Pool(min(workers, len(tasks)), initializer=_ignore_interrupt) as pool:
        results = pool.imap(partial(_run_one_of, plan), tasks)
        for task, result in zip(tasks, results, strict=True):
            if tell is not None:
                tell(describe(plan, *task))
            yield task, result


def _ignore_interrupt() -> None:
    """Leave Ctrl-C to the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run_one_of(plan: Plan, task: tuple[int, int]) -> TaskResult:
    return run_task(plan, *task)


def describe(plan: Plan, point: int, world: int) -> str:
    """A task in words."""
    varied = ", ".join(f"{key} = {value}" for key, value in plan.points[point])
    parts = [f"world {world + 1} of {len(plan.seeds)} (seed {plan.seeds[world]})", varied]
    return ", ".join(part for part in parts if part)
