"""Judging many members: quantiles, checks with percentile and confidence, consistency over worlds.

A check under stress is applied to its ``percentile`` over all members (without one: to their mean). With a
``confidence`` it is applied to the one-sided confidence bound of that percentile instead, so a check that holds says:
with this confidence, at least this share of runs keeps the limit. In a single world members are independent and the
bound is the order statistic of the binomial law; over several worlds the world is the independent unit and the bound
comes from resampling whole worlds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from twin.scenario import Check, Scenario
from twin.scoring.checks import Outcome, within
from twin.signals import BoolArray, FloatArray, IntArray

QUANTILES = (0.05, 0.5, 0.95)
_RESAMPLES = 2000
_NEES_LEVEL = 0.95

Table = Mapping[str, FloatArray]
"""(W, R) by metric: worlds and members."""


def quantiles(values: FloatArray) -> FloatArray:
    """5, 50 and 95 % of all members (W, R); NaN (a phase that never came) is left out, inf (never) counts."""
    known = values[~np.isnan(values)]
    if not len(known):
        return np.full(len(QUANTILES), math.nan)
    return np.quantile(known, QUANTILES, method="inverted_cdf")


def judge_ensemble(scenario: Scenario, table: Table) -> list[Outcome]:
    """Apply every check of a scenario to all members of one point."""
    return [_judge(check, table) for check in scenario.checks]


def _judge(check: Check, table: Table) -> Outcome:
    values = table[check.metric]
    if check.ratio_to is None:
        low, high = (bound(values, check.percentile, check.confidence, upper=upper) for upper in (False, True))
        holds = within(low, check.min, None) and within(high, None, check.max)
        return Outcome(check=check, value=low if check.max is None else high, ok=holds)
    over, under = (bound(each, check.percentile, None, upper=True) for each in (values, table[check.ratio_to]))
    ratio = over / under if under and math.isfinite(under) else math.nan
    holds = within(over, check.min, check.max) and within(ratio, check.min_ratio, check.max_ratio)
    return Outcome(check=check, value=ratio, ok=holds)


def bound(values: FloatArray, percentile: float | None, confidence: float | None, *, upper: bool) -> float:
    """Percentile of members (W, R), or its one-sided confidence bound; without a percentile the mean.

    NaN if any member has no value: a check must not hold because runs fell out. Infinite where there are too few
    members for the confidence asked for.
    """
    if np.isnan(values).any() or not values.size:
        return math.nan
    if percentile is None:
        return float(values.mean())
    if confidence is None:
        return float(np.quantile(values, percentile / 100.0, method="inverted_cdf"))
    if values.shape[0] == 1:
        return _order_statistic(values[0], percentile / 100.0, confidence, upper=upper)
    return _resampled(values, percentile / 100.0, confidence, upper=upper)


def _order_statistic(values: FloatArray, fraction: float, confidence: float, *, upper: bool) -> float:
    """Distribution-free bound: the k-th of n values lies above the quantile with P(Binomial(n, fraction) < k)."""
    ordered, count = np.sort(values), len(values)
    ranks = np.arange(1, count + 1)
    if upper:
        enough = np.flatnonzero(stats.binom.cdf(ranks - 1, count, fraction) >= confidence)
        return float(ordered[enough[0]]) if len(enough) else math.inf
    enough = np.flatnonzero(stats.binom.sf(ranks - 1, count, fraction) >= confidence)
    return float(ordered[enough[-1]]) if len(enough) else -math.inf


def _resampled(values: FloatArray, fraction: float, confidence: float, *, upper: bool) -> float:
    generator = np.random.default_rng(0)
    worlds = values.shape[0]
    drawn = [
        np.quantile(values[generator.integers(worlds, size=worlds)], fraction, method="inverted_cdf")
        for _ in range(_RESAMPLES)
    ]
    return float(np.quantile(drawn, confidence if upper else 1.0 - confidence, method="inverted_cdf"))


# --- consistency -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """NEES of one estimator over independent worlds."""

    states: int
    worlds: int
    mean: float
    """Mean NEES over worlds and instants; ``states`` if consistent."""
    low: float
    high: float
    """95 % bounds of the mean over worlds at one instant."""
    inside: float
    """Share of instants within them; 0.95 if consistent."""


def nees_over_worlds(worlds: list[tuple[IntArray, FloatArray]], states: int) -> Consistency | None:
    """Compare NEES (times, mean over members) of M worlds with its chi-square bounds; None without common instants.

    The mean over members of one world stands for that world: that is never wider than one member, so an honest
    filter is inside at least as often as stated.
    """
    if not worlds:
        return None
    common = worlds[0][0]
    for t_ns, _ in worlds[1:]:
        common = np.intersect1d(common, t_ns)
    if not len(common):
        return None
    at_common = [values[np.isin(t_ns, common)] for t_ns, values in worlds]
    mean: FloatArray = np.mean(at_common, axis=0)
    count = len(worlds)
    tail = (1.0 - _NEES_LEVEL) / 2.0
    low, high = (float(stats.chi2.ppf(level, count * states)) / count for level in (tail, 1.0 - tail))
    inside: BoolArray = (mean >= low) & (mean <= high)
    return Consistency(
        states=states, worlds=count, mean=float(mean.mean()), low=low, high=high, inside=float(inside.mean())
    )
