"""The verdict on a run, and its ``result.json``."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version

from twin.recording import Recording
from twin.scenario import Scenario, loads
from twin.scoring import metrics as metrics_module
from twin.scoring.checks import Outcome, judge
from twin.scoring.lane import ON_COLLISION
from twin.signals import COLLISION

SCHEMA = 1
LOG = "log"
"""``kind`` in the result of a replayed log; those of runs have none."""
STRESS = "stress"
"""``kind`` in the result of a stress test."""
_PACKAGES = ("agtwin", "numpy", "pybullet", "filterpy", "rerun-sdk")


@dataclass(kw_only=True)
class Verdict:
    """What a run was worth."""

    scenario: Scenario
    scenario_name: str
    scenario_sha256: str
    seed: int
    run: int
    ended_reason: str
    ended_t_s: float
    metrics: dict[str, float]
    checks: list[Outcome]
    timing: dict[str, float] = field(default_factory=dict)
    drifted: list[str] = field(default_factory=list)
    baseline_compared: bool = False

    @property
    def verdict(self) -> str:
        """``pass``, ``fail`` (a check does not hold, or a baseline drifted) or ``error`` (the run ended early).

        How a run may end is said by :func:`ending`.
        """
        ended = ending(self.ended_reason, self.scenario)
        if ended != "pass":
            return ended
        return "pass" if all(outcome.ok for outcome in self.checks) and not self.drifted else "fail"

    def as_json(self) -> dict[str, object]:
        """Content of result.json."""
        return {
            "schema": SCHEMA,
            "scenario": self.scenario_name,
            "scenario_sha256": self.scenario_sha256,
            "seed": self.seed,
            "run": self.run,
            "verdict": self.verdict,
            "ended": {"reason": self.ended_reason, "t_s": self.ended_t_s},
            "metrics": {name: _number(value) for name, value in self.metrics.items()},
            "published": dict(self.scenario.published),
            "checks": [outcome.as_json() for outcome in self.checks],
            "baseline": {"compared": self.baseline_compared, "drifted": self.drifted},
            "timing": {name: _number(value) for name, value in self.timing.items()},
            "versions": versions(),
        }


def ending(reason: str, scenario: Scenario) -> str:
    """What the end of a run is worth by itself: ``pass``, ``fail`` or ``error``.

    To run to the end of its time passes, to end early is an error. Touching a tree is what checks are for: where one
    asks for it the checks decide, where none does it fails.
    """
    if reason == "duration":
        return "pass"
    if reason != COLLISION:
        return "error"
    return "pass" if any(check.metric in ON_COLLISION for check in scenario.checks) else "fail"


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def versions() -> dict[str, str]:
    """Versions of this package and of what its numbers depend on."""
    found: dict[str, str] = {}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def score(recording: Recording) -> Verdict:
    """Judge an ordinary recording (R = 1) by the checks of its own scenario."""
    scenario = loads(recording.scenario_toml, where=f"{recording.scenario_name}/scenario.toml")
    values = {name: float(value[0]) for name, value in metrics_module.compute(recording, scenario).items()}
    return Verdict(
        scenario=scenario,
        scenario_name=recording.scenario_name,
        scenario_sha256=hashlib.sha256(recording.scenario_toml.encode()).hexdigest(),
        seed=recording.seed,
        run=recording.runs[0],
        ended_reason=recording.ended_reason,
        ended_t_s=recording.ended_t_s,
        metrics=values,
        checks=judge(scenario, values),
        timing=dict(recording.timing),
    )
