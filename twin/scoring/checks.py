"""Checks: requirements of a scenario on its metrics, and what came of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from twin.errors import BadInputError
from twin.scenario import Check, Scenario, unknown
from twin.scoring.honesty import is_pooled


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """A check and what was found."""

    check: Check
    value: float
    """The metric, its ratio to ``ratio_to``, or its difference from ``difference_to``."""
    ok: bool

    def as_json(self) -> dict[str, object]:
        """Entry for result.json: the check's own keys, ``value`` (null where not a number) and ``ok``."""
        value = self.value if math.isfinite(self.value) else None
        return {**self.check.model_dump(exclude_none=True, exclude_defaults=True), "value": value, "ok": self.ok}

    def sentence(self, *, up_to: float | None = None, of_members: bool = False) -> str:
        """The check in words, for tables and JUnit.

        Args:
            up_to: of values from this one up to another.
            of_members: say of how many members it is a statement, where there are several.
        """
        check = self.check
        what, low, high = check.metric, check.min, check.max
        if check.ratio_to is not None:
            what, low, high = f"{what} / {check.ratio_to}", check.min_ratio, check.max_ratio
        elif check.difference_to is not None:
            what, low, high = f"{what} - {check.difference_to}", None, check.max_difference
        bounds = " and ".join(
            text
            for text in (f">= {low:g}" if low is not None else "", f"<= {high:g}" if high is not None else "")
            if text
        )
        first, last = (f"{value:.4g}" for value in (self.value, self.value if up_to is None else up_to))
        given = first if first == last else f"{first} to {last}"
        return f"{what} = {given}, required {bounds}{self._share() if of_members else ''}"

    def _share(self) -> str:
        if self.check.percentile is None:
            return ""
        confidence = f", confidence {100 * self.check.confidence:g} %" if self.check.confidence is not None else ""
        return f" (at {self.check.percentile:g} % of the members{confidence})"


def require_known(scenario: Scenario, names: Collection[str], *, where: str) -> None:
    """Refuse checks and published figures on metrics that the run will not have, or that make no sense of them.

    Raises:
        BadInputError: naming the metric and the nearest one that exists, or what the check may not ask.
    """
    for index, check in enumerate(scenario.checks):
        _require_sense(check, where=f"{where}: checks.{index}")
        for key in ("metric", "ratio_to", "difference_to"):
            metric = getattr(check, key)
            if metric is not None and metric not in names:
                raise BadInputError(f"{where}: checks.{index}.{key}: {_unknown_metric(metric, names)}")
    for metric in scenario.published:
        if metric not in names:
            raise BadInputError(f"{where}: published.{metric}: {_unknown_metric(metric, names)}")


def _require_sense(check: Check, *, where: str) -> None:
    """A pooled metric is one figure of all members: it has no percentile, and goes with no figure of each of them."""
    pooled = is_pooled(check.metric)
    if pooled and check.percentile is not None:
        raise BadInputError(f"{where}.percentile: {check.metric} is one figure of all members together and has none")
    for key in ("ratio_to", "difference_to"):
        other = getattr(check, key)
        if other is not None and is_pooled(other) != pooled:
            one, each = (check.metric, other) if pooled else (other, check.metric)
            raise BadInputError(f"{where}.{key}: {one} is one figure of all members together, {each} is one of each")


def _unknown_metric(metric: str, names: Collection[str]) -> str:
    sentence = unknown(metric, sorted(names), "metric").partition(" (there are ")[0]
    estimators = sorted({name.partition(".")[0] for name in names})
    return f"{sentence} ({len(names)} metrics exist for {', '.join(estimators) or 'no estimator'})"


def judge(scenario: Scenario, metrics: Mapping[str, float]) -> list[Outcome]:
    """Apply every check of a scenario that a single run has to keep; a value that is not a number fails."""
    return [_judge(check, metrics) for check in scenario.checks if not check.stress_only]


def _judge(check: Check, metrics: Mapping[str, float]) -> Outcome:
    value = metrics.get(check.metric, math.nan)
    holds = within(value, check.min, check.max)
    if check.ratio_to is not None:
        below = metrics.get(check.ratio_to, math.nan)
        value = value / below if below and math.isfinite(below) else math.nan
        holds = holds and within(value, check.min_ratio, check.max_ratio)
    if check.difference_to is not None:
        value = value - metrics.get(check.difference_to, math.nan)
        holds = holds and within(value, None, check.max_difference)
    return Outcome(check=check, value=value, ok=holds)


def within(value: float, low: float | None, high: float | None) -> bool:
    """Tell whether a value keeps its bounds; what is not a number keeps none, ``inf`` (never) is a number."""
    return not math.isnan(value) and (low is None or value >= low) and (high is None or value <= high)
