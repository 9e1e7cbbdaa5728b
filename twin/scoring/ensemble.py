"""Judging many members: quantiles, checks with percentile and confidence, consistency over worlds.

Under stress a check with ``percentile`` p is a statement about p % of the members: with ``max``, at least p % of them
are at or below it; with ``min``, at least p % are at or above it (without a percentile it is about their mean). A
ratio or a difference is taken member by member, since both metrics saw the same noise. With a ``confidence`` the
statement is made with a distribution-free bound, the order statistic of the binomial law. In a single world members are
independent. Over several worlds the world is the independent unit: the bound is then on the worlds' own percentiles, so
a check that holds says that, with this confidence, at least p % of worlds keep the limit in at least p % of their
members. Where there are too few members (or worlds) for the confidence asked for, the check fails: 59 are needed for 95
% at 95 %.

A pooled metric (:mod:`twin.scoring.honesty`) is one figure of all members of all worlds, a table of (1, 1): a check on
it is judged once, and has no percentile.
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
_LEVEL = 0.95

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
    holds, value = _keeps(check, values, check.min, check.max)
    if check.ratio_to is not None:
        below = table[check.ratio_to]
        ratios = np.divide(values, below, out=np.full_like(values, math.nan), where=(below != 0.0) & np.isfinite(below))
        kept, value = _keeps(check, ratios, check.min_ratio, check.max_ratio)
        holds = holds and kept
    if check.difference_to is not None:
        kept, value = _keeps(check, values - table[check.difference_to], None, check.max_difference)
        holds = holds and kept
    return Outcome(check=check, value=value, ok=holds)


def _keeps(check: Check, values: FloatArray, low: float | None, high: float | None) -> tuple[bool, float]:
    """Tell whether members (W, R) keep both bounds, and the figure that decides (of the upper one if both are)."""
    holds, value = True, math.nan
    if low is not None:
        value = bound(values, check.percentile, check.confidence, upper=False)
        holds = within(value, low, None)
    if high is not None:
        value = bound(values, check.percentile, check.confidence, upper=True)
        holds = holds and within(value, None, high)
    return holds, value


def bound(values: FloatArray, percentile: float | None, confidence: float | None, *, upper: bool) -> float:
    """Figure that ``percentile`` % of members (W, R) are at or below (``upper``), or at or above.

    NaN if any member has no value: a check must not hold because runs fell out. Infinite where there are too few
    members for the confidence asked for.
    """
    if np.isnan(values).any() or not values.size:
        return math.nan
    if percentile is None:
        return float(values.mean())
    # At or above is at or below with the sign turned.
    sign = 1.0 if upper else -1.0
    signed, fraction = sign * values, percentile / 100.0
    if confidence is None:
        return sign * float(np.quantile(signed, fraction, method="inverted_cdf"))
    if values.shape[0] > 1:
        signed = np.quantile(signed, fraction, axis=1, method="inverted_cdf")
    return sign * _upper_bound(signed.ravel(), fraction, confidence)


def _upper_bound(values: FloatArray, fraction: float, confidence: float) -> float:
    """Distribution-free bound: the k-th of n values is above the quantile with P(Binomial(n, fraction) < k)."""
    ranks = np.arange(1, len(values) + 1)
    enough = np.flatnonzero(stats.binom.cdf(ranks - 1, len(values), fraction) >= confidence)
    return float(np.sort(values)[enough[0]]) if len(enough) else math.inf


# --- consistency -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """A chi-square statistic of one estimator over independent worlds, one member of each."""

    statistic: str
    """``nees`` or the NIS column."""
    degrees: int
    """Degrees of freedom of one value; its expectation if consistent."""
    worlds: int
    mean: float
    """Mean over worlds and instants."""
    low: float
    high: float
    """95 % bounds of the mean over worlds at one instant."""
    inside: float
    """Share of instants within the bounds: 0.95 if consistent."""


def _bounds(values: int, degrees: int) -> tuple[float, float]:
    """95 % bounds of the mean of so many independent chi-square values."""
    tail = (1.0 - _LEVEL) / 2.0
    low, high = (float(stats.chi2.ppf(level, values * degrees)) / values for level in (tail, 1.0 - tail))
    return low, high


def over_worlds(statistic: str, worlds: list[tuple[IntArray, FloatArray]], degrees: int) -> Consistency | None:
    """Compare a statistic (times, values of one member) of M worlds with its bounds; None without common instants.

    One member stands for its world: the mean of several would be narrower than the bounds and hide overconfidence. The
    bounds are those of the mean over M worlds at one instant (Bar-Shalom, Li and Kirubarajan 2001, section 5.4).
    """
    if not worlds:
        return None
    common = worlds[0][0]
    for t_ns, _ in worlds[1:]:
        common = np.intersect1d(common, t_ns)
    if not len(common):
        return None
    mean: FloatArray = np.mean([values[np.isin(t_ns, common)] for t_ns, values in worlds], axis=0)
    low, high = _bounds(len(worlds), degrees)
    inside: BoolArray = (mean >= low) & (mean <= high)
    return Consistency(
        statistic=statistic,
        degrees=degrees,
        worlds=len(worlds),
        mean=float(mean.mean()),
        low=low,
        high=high,
        inside=float(inside.mean()),
    )
