"""What came of a stress test: tables, envelopes, checks, the worst members, and the files that keep them."""

from __future__ import annotations

import dataclasses
import json
import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from twin.families import FAMILIES
from twin.scenario import LoadedScenario
from twin.scoring.checks import Outcome
from twin.scoring.consistency import nis_degrees
from twin.scoring.ensemble import (
    QUANTILES,
    Consistency,
    judge_ensemble,
    over_worlds,
    quantiles,
)
from twin.scoring.envelopes import Envelope
from twin.scoring.verdict import SCHEMA, ending, versions
from twin.signals import NS_PER_S, FloatArray
from twin.stress.plan import Plan
from twin.stress.tasks import TaskResult

_WORST = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Worst:
    """A member worth a look: how bad it was, and the command that runs it alone."""

    estimator: str
    metric: str
    value: float
    command: str


@dataclass(kw_only=True)
class Point:
    """All members of one point of ``--vary`` (the only one without)."""

    settings: dict[str, Any]
    table: dict[str, FloatArray]
    """(W, R) by metric."""
    motion: dict[str, FloatArray]
    """(W,) by metric."""
    envelopes: dict[str, Envelope]
    consistency: dict[str, list[Consistency]]
    outcomes: list[Outcome]
    worst: list[Worst]

    @property
    def label(self) -> str:
        """The varied values in words."""
        return ", ".join(f"{key} = {value}" for key, value in self.settings.items())


@dataclass(kw_only=True)
class StressResult:
    """Everything a stress test found."""

    loaded: LoadedScenario
    plan: Plan
    points: list[Point]
    ended: list[str]
    """Tasks whose world ended before its time."""
    timing: dict[str, float] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """``pass``, ``fail`` or ``error`` (a world ended before its time)."""
        if self.ended:
            return "error"
        return "pass" if all(outcome.ok for point in self.points for outcome in point.outcomes) else "fail"

    def as_json(self) -> dict[str, object]:
        """Content of result.json."""
        return {
            "schema": SCHEMA,
            "kind": "stress",
            "scenario": self.loaded.name,
            "scenario_sha256": self.loaded.sha256,
            "seed": self.plan.seeds[0],
            "run": 0,
            "worlds": len(self.plan.seeds),
            "runs": self.plan.runs,
            "verdict": self.verdict,
            "ended": {"reason": self.ended[0] if self.ended else "duration", "t_s": self.loaded.scenario.duration_s},
            "published": dict(self.loaded.scenario.published),
            "points": [_point_json(point) for point in self.points],
            "timing": self.timing,
            "versions": versions(),
        }


def _point_json(point: Point) -> dict[str, object]:
    metrics = {
        name: dict(zip(("p05", "p50", "p95"), map(_number, quantiles(values)), strict=True))
        for name, values in point.table.items()
    }
    return {
        "settings": point.settings,
        "metrics": metrics,
        "checks": [outcome.as_json() for outcome in point.outcomes],
        "consistency": {
            name: [dataclasses.asdict(each) for each in found] for name, found in point.consistency.items()
        },
        "worst": [
            {"estimator": worst.estimator, "metric": worst.metric, "value": _number(worst.value),
             "command": worst.command}
            for worst in point.worst
        ],
    }  # fmt: skip


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


# --- merging ---------------------------------------------------------------------------------------------------------


def merge_results(
    loaded: LoadedScenario, plan: Plan, results: Mapping[tuple[int, int], TaskResult], timing: dict[str, float]
) -> StressResult:
    """Put the tasks of a plan together, in their order."""
    points = []
    ended = []
    for index, settings in enumerate(plan.points):
        tasks = [results[index, world] for world in range(len(plan.seeds))]
        ended += [
            f"seed {plan.seeds[world]}: {task.ended_reason} at {task.ended_t_s:.2f} s"
            for world, task in enumerate(tasks)
            if ending(task.ended_reason, loaded.scenario) != "pass"
        ]
        points.append(_merge_point(loaded, plan, dict(settings), tasks))
    return StressResult(loaded=loaded, plan=plan, points=points, ended=ended, timing=timing)


def _merge_point(loaded: LoadedScenario, plan: Plan, settings: dict[str, Any], tasks: list[TaskResult]) -> Point:
    table = {name: np.stack([task.metrics[name] for task in tasks]) for name in tasks[0].metrics}
    motion = {name: np.array([task.motion[name] for task in tasks]) for name in tasks[0].motion}
    envelopes: dict[str, Envelope] = {}
    for task in tasks:
        for name, envelope in task.envelopes.items():
            if name not in envelopes:
                envelopes[name] = Envelope.at(envelope.t_ns)
            if len(envelopes[name].t_ns) == len(envelope.t_ns):
                envelopes[name].merge(envelope)
    judged = {**{name: np.repeat(value[:, np.newaxis], plan.runs, axis=1) for name, value in motion.items()}, **table}
    return Point(
        settings=settings,
        table=table,
        motion=motion,
        envelopes=envelopes,
        consistency=_consistency(tasks),
        outcomes=judge_ensemble(loaded.scenario, judged),
        worst=_worst_members(loaded, plan, settings, table),
    )


def _consistency(tasks: list[TaskResult]) -> dict[str, list[Consistency]]:
    """NEES and every kind of NIS of each estimator, over the worlds."""
    found: dict[str, list[Consistency]] = {}
    for name, states in tasks[0].states.items():
        nees = over_worlds("nees", [task.nees[name] for task in tasks if name in task.nees], states) if states else None
        columns = [key.partition(".")[2] for key in tasks[0].nis if key.partition(".")[0] == name]
        nis = [
            over_worlds(
                column,
                [task.nis[key] for task in tasks if (key := f"{name}.{column}") in task.nis],
                nis_degrees(column),
            )
            for column in columns
        ]
        known = [value for value in (nees, *nis) if value is not None]
        if known:
            found[name] = known
    return found


def headline_metrics(loaded: LoadedScenario, names: list[str]) -> list[str]:
    """Metrics shown of each estimator: those published or checked, and the largest errors in or without a loss."""
    phase = _worst_phase(loaded)
    wanted = {"seeds.mean_abs_population_error_turns_percent", f"seeds.quality_of_feed{phase}_percent"}
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


# --- files -----------------------------------------------------------------------------------------------------------


def write_files(result: StressResult, folder: Path) -> None:
    """Write ``scenario.toml``, ``members.parquet`` (a row per member) and ``envelopes.parquet``."""
    (folder / "scenario.toml").write_text(result.loaded.toml)
    pq.write_table(pa.concat_tables([_members_table(result, index) for index in range(len(result.points))]),
                   folder / "members.parquet")  # fmt: skip
    pq.write_table(
        pa.concat_tables(
            [
                _envelope_table(index, name, envelope)
                for index, point in enumerate(result.points)
                for name, envelope in point.envelopes.items()
            ]
            or [_envelope_table(0, "", Envelope.at(np.empty(0, dtype=np.int64)))]
        ),
        folder / "envelopes.parquet",
    )


def _members_table(result: StressResult, index: int) -> pa.Table:
    point, plan = result.points[index], result.plan
    worlds, runs = len(plan.seeds), plan.runs
    columns: dict[str, Any] = {"point": np.full(worlds * runs, index)}
    for key, value in point.settings.items():
        columns[key] = pa.array([str(value)] * (worlds * runs))
    columns["seed"] = np.repeat(np.array(plan.seeds, dtype=np.int64), runs)
    columns["run"] = np.tile(np.arange(runs), worlds)
    for name, values in point.table.items():
        columns[name] = values.ravel()
    return pa.table(columns)


def _envelope_table(index: int, name: str, envelope: Envelope) -> pa.Table:
    length = len(envelope.t_ns)
    columns: dict[str, Any] = {
        "point": np.full(length, index),
        "name": pa.array([name] * length, type=pa.string()),
        "t_s": envelope.t_ns / NS_PER_S,
    }
    for fraction in QUANTILES:
        columns[f"p{round(100 * fraction):02d}"] = envelope.quantile(fraction)
    return pa.table(columns)
