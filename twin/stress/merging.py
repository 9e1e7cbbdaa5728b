"""Puts the tasks of a stress test together, as they come: members of a world, worlds of a point, points of a plan."""

from __future__ import annotations

import itertools
import json
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from twin.families import FAMILIES
from twin.scenario import LoadedScenario
from twin.scoring.consistency import nis_degrees
from twin.scoring.ensemble import Consistency, judge_ensemble, over_worlds
from twin.scoring.envelopes import Envelope
from twin.scoring.guidance import HEADLINES as GUIDANCE_HEADLINES
from twin.scoring.honesty import Honesty, pooled_metrics
from twin.scoring.verdict import ending
from twin.signals import FloatArray, IntArray
from twin.stress.plan import Plan, Task
from twin.stress.result import Point, StressResult, Worst
from twin.stress.task_result import TaskResult, joined, merge_envelopes, merge_honesty

_WORST = 2


def merge_results(
    loaded: LoadedScenario, plan: Plan, results: Mapping[Task, TaskResult], timing: dict[str, float]
) -> StressResult:
    """Put all tasks of a plan together."""
    merged = merge_in_order(loaded, plan, (results[task] for task in plan.tasks()))
    merged.timing = timing
    return merged


def merge_in_order(loaded: LoadedScenario, plan: Plan, results: Iterable[TaskResult]) -> StressResult:
    """Put the results of a plan's tasks together as they come, in the order of the tasks; none is kept."""
    coming = iter(results)
    points, ended = [], []
    for index, settings in enumerate(plan.points):
        members = _Members()
        for seed in plan.seeds:
            world = joined(itertools.islice(coming, plan.blocks(index)))
            members.add(world)
            if ending(world.ended_reason, loaded.scenario) != "pass":
                ended.append(f"seed {seed}: {world.ended_reason} at {world.ended_t_s:.2f} s")
        points.append(_point(loaded, plan, index, dict(settings), members))
    return StressResult(loaded=loaded, plan=plan, points=points, ended=ended)


class _Members:
    """All members of one point, world after world."""

    def __init__(self) -> None:
        self.metrics: list[dict[str, FloatArray]] = []
        self.motion: list[dict[str, float]] = []
        self.envelopes: dict[str, Envelope] = {}
        self.honesty: dict[str, Honesty] = {}
        self.states: dict[str, int] = {}
        self.nees: list[dict[str, tuple[IntArray, FloatArray]]] = []
        self.nis: list[dict[str, tuple[IntArray, FloatArray]]] = []

    def add(self, world: TaskResult) -> None:
        """Take all members of the next world."""
        self.metrics.append(world.metrics)
        self.motion.append(world.motion)
        merge_envelopes(self.envelopes, world.envelopes)
        merge_honesty(self.honesty, world.honesty)
        self.states = self.states or world.states
        self.nees.append(world.nees)
        self.nis.append(world.nis)


def _point(loaded: LoadedScenario, plan: Plan, index: int, settings: dict[str, Any], members: _Members) -> Point:
    table = {name: np.stack([metrics[name] for metrics in members.metrics]) for name in members.metrics[0]}
    motion = {name: np.array([each[name] for each in members.motion]) for name in members.motion[0]}
    pooled = pooled_metrics(members.honesty, plan.load(index, 0).scenario)
    judged = {name: np.repeat(value[:, np.newaxis], plan.runs, axis=1) for name, value in motion.items()}
    judged |= table | {name: np.array([[value]]) for name, value in pooled.items()}
    return Point(
        settings=settings,
        table=table,
        motion=motion,
        pooled=pooled,
        envelopes=members.envelopes,
        consistency=_consistency(members),
        outcomes=judge_ensemble(loaded.scenario, judged),
        worst=_worst_members(loaded, plan, settings, table),
    )


def _consistency(members: _Members) -> dict[str, list[Consistency]]:
    """NEES and every kind of NIS of each estimator, over the worlds."""
    found: dict[str, list[Consistency]] = {}
    for name, states in members.states.items():
        known = []
        if states:
            known.append(over_worlds("nees", [world[name] for world in members.nees if name in world], states))
        for key in members.nis[0]:
            if key.partition(".")[0] == name:
                column = key.partition(".")[2]
                worlds = [world[key] for world in members.nis if key in world]
                known.append(over_worlds(column, worlds, nis_degrees(column)))
        statistics = [value for value in known if value is not None]
        if statistics:
            found[name] = statistics
    return found


def headline_metrics(loaded: LoadedScenario, names: list[str]) -> list[str]:
    """Metrics shown of each estimator: those published or checked, and the largest errors in or without a loss."""
    phase = _worst_phase(loaded)
    wanted = {"seeds.mean_abs_population_error_turns_percent", f"seeds.quality_of_feed{phase}_percent"}
    wanted |= set(GUIDANCE_HEADLINES)
    for family in FAMILIES:
        wanted |= {family.metric(figure, phase) for figure in family.shown_of_many}
        wanted.add(family.time_to_limit)
        if family.tolerance is not None:
            wanted |= {family.time_to_tolerance, family.jump, family.recovery}
    asked = {check.metric for check in loaded.scenario.checks} | set(loaded.scenario.published)
    return [name for name in names if name in asked or name.partition(".")[2] in wanted]


def _worst_phase(loaded: LoadedScenario) -> str:
    """The phase that counts: the loss if there is one."""
    return "_loss" if loaded.scenario.loss_window_s is not None else ""


def _worst_members(
    loaded: LoadedScenario, plan: Plan, settings: Mapping[str, Any], table: Mapping[str, FloatArray]
) -> list[Worst]:
    """The worst members of each estimator by the figure of its first family that has one."""
    worst: list[Worst] = []
    seen: set[str] = set()
    judging = sorted((family for family in FAMILIES if family.worst), key=lambda family: family.worst_rank)
    for wanted in [family.metric(family.worst, _worst_phase(loaded)) for family in judging]:
        for name, values in table.items():
            estimator, _, metric = name.partition(".")
            if metric != wanted or estimator in seen:
                continue
            seen.add(estimator)
            order = np.argsort(-np.nan_to_num(values, nan=-1.0), axis=None, kind="stable")[:_WORST]
            for flat in order.tolist():
                world, run = divmod(flat, values.shape[1])
                command = _command(loaded, plan, settings, plan.seeds[world], run)
                worst.append(
                    Worst(estimator=estimator, metric=metric, value=float(values[world, run]), command=command)
                )
    return worst


def _command(loaded: LoadedScenario, plan: Plan, settings: Mapping[str, Any], seed: int, run: int) -> str:
    words = ["twin", "run", loaded.name if loaded.bundled else str(loaded.path), "--seed", str(seed), "--run", str(run)]
    for key, value in [*plan.settings, *settings.items()]:
        # Numbers, text, booleans and arrays are written alike in JSON and TOML.
        literal = json.dumps(value)
        words += ["--set", f"{key}={literal}"]
    return shlex.join(words)
