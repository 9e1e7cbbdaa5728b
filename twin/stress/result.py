"""What came of a stress test: tables, envelopes, checks and the worst members."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from twin.scenario import LoadedScenario
from twin.scoring.checks import Outcome
from twin.scoring.ensemble import (
    Consistency,
    quantiles,
)
from twin.scoring.envelopes import Envelope
from twin.scoring.verdict import SCHEMA, STRESS, versions
from twin.signals import FloatArray
from twin.stress.plan import Plan

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
    pooled: dict[str, float]
    """One figure of all members of all worlds, by metric."""
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
            "kind": STRESS,
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
        "pooled": {name: _number(value) for name, value in point.pooled.items()},
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
