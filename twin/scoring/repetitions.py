"""The runs of one scenario in one world: mean and range of each metric, and checks that hold in every run.

Published tables give means over a few repeated drives. A check is a requirement on each run, not on the mean: it holds
if it holds in every repetition. The verdict is the worst of the runs' own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.scenario import Scenario
from twin.scoring.checks import Outcome
from twin.scoring.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """A metric over the repetitions; not a number where one of them has none."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class RepeatedOutcome:
    """A check in every repetition."""

    runs: tuple[int, ...]
    outcomes: tuple[Outcome, ...]

    @property
    def ok(self) -> bool:
        """Whether it holds in every repetition."""
        return all(outcome.ok for outcome in self.outcomes)

    @property
    def metric(self) -> str:
        """What it is about."""
        return self.outcomes[0].check.metric

    def sentence(self) -> str:
        """The check in words: of the run, or of the repetitions from the smallest to the largest value."""
        if len(self.outcomes) == 1:
            return self.outcomes[0].sentence()
        ordered = sorted(self.outcomes, key=lambda outcome: (math.isnan(outcome.value), outcome.value))
        text = ordered[0].sentence(up_to=ordered[-1].value)
        failing = [str(run) for run, outcome in zip(self.runs, self.outcomes, strict=True) if not outcome.ok]
        where = f"; fails in run {', '.join(failing)}" if failing else ""
        return f"{text} in each of {len(self.runs)} runs{where}"


@dataclass(frozen=True, slots=True)
class Repetitions:
    """Verdicts of one scenario in one world, in the order of their run index; one or more."""

    verdicts: list[Verdict]

    @property
    def first(self) -> Verdict:
        """The first run's verdict: the only one that baselines are compared with."""
        return self.verdicts[0]

    @property
    def scenario(self) -> Scenario:
        """What was run."""
        return self.first.scenario

    @property
    def scenario_name(self) -> str:
        """Name of the scenario."""
        return self.first.scenario_name

    @property
    def verdict(self) -> str:
        """``pass``, ``fail`` or ``error``: the worst of the runs."""
        found = [each.verdict for each in self.verdicts]
        return next(kind for kind in ("error", "fail", "pass") if kind in found)

    @property
    def checks(self) -> list[RepeatedOutcome]:
        """Every check with what came of it in each run."""
        runs = tuple(each.run for each in self.verdicts)
        by_check = zip(*(each.checks for each in self.verdicts), strict=True)
        return [RepeatedOutcome(runs, outcomes) for outcomes in by_check]

    @property
    def wall_s(self) -> float:
        """Time that all runs took."""
        return sum(each.timing.get("wall_s", 0.0) for each in self.verdicts)

    def metrics(self) -> dict[str, Spread]:
        """Every metric over the repetitions."""
        found = {}
        for name in self.first.metrics:
            values = np.array([each.metrics[name] for each in self.verdicts])
            found[name] = Spread(mean=float(values.mean()), low=float(values.min()), high=float(values.max()))
        return found
