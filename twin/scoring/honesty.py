"""Honesty: is an estimator as wrong as it says, by the second since a loss, over all members and worlds together.

Every epoch is counted from the first on for which the member's estimator claims a sigma, over all from
``scoring.from_s`` on and in bins of a second since the loss (since ``scoring.from_s`` where there is none). Who claims
none later on says nothing just when it is needed: such an epoch is not inside. Counts and sums of members, worlds and
workers add up, and the figures are made of the sums: they are *pooled*, one figure for all members, so that a check on
them is judged once. In a single run they are those of its one member.

* ``honesty.inside_percent``: epochs in which the error is within 2.576 sigma, which is 99 % of a normal law;
* ``honesty.least_inside_percent``: the same in the worst bin;
* ``honesty.unsafe_percent``: epochs in which the error is beyond the family's tolerance while 3 sigma is below it: the
  machine had no chance to stop in time;
* ``honesty.largest_sigma_ratio``: mean sigma / root mean square error, of the epochs with a sigma, in the bin where it
  is largest: who always claims to know little is never wrong, and of no use;
* ``honesty.sigma_at_end_of_loss_<unit>``: mean sigma in the last second of the loss;
* ``honesty.recovered_percent``: members that have recovered (:mod:`twin.scoring.reacquisition`) within 2 s of their
  first true fix, 3 s after a loss longer than 10 s. A member without a true fix has not; where no member had one there
  was nothing to recover by, and the figure is not a number.

A bin counts that has at least half as many such epochs as the fullest: the last of a run holds a single one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.families import Family, family_named
from twin.scenario import Scenario
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray, nanoseconds

INSIDE_SIGMAS = 2.576
"""Two-sided 99 % of a normal law."""
SAFE_SIGMAS = 3.0
_BIN_NS = NS_PER_S
_LEAST_SHARE_OF_FULLEST = 0.5
_SHORT_LOSS_S, _RECOVERY_S, _RECOVERY_AFTER_LONG_LOSS_S = 10.0, 2.0, 3.0
_EPOCHS, _INSIDE, _UNSAFE, _CLAIMED = range(4)
_SQUARES, _SIGMAS = range(2)
_PREFIX = "honesty."


def is_pooled(metric: str) -> bool:
    """Tell whether a metric (with its estimator) is one figure of all members together."""
    return metric.partition(".")[2].startswith(_PREFIX)


def names(scenario: Scenario, family: Family) -> list[str]:
    """Names of the figures of an estimator that is held to this family's tolerance."""
    found = ["inside_percent", "least_inside_percent", "unsafe_percent", "largest_sigma_ratio"]
    if scenario.loss_window_s is not None:
        found.append(f"sigma_at_end_of_loss_{family.unit}")
        if scenario.scoring.fixes_of is not None:
            found.append("recovered_percent")
    return [_PREFIX + name for name in found]


@dataclass(kw_only=True)
class Honesty:
    """Counts and sums of one estimator's epochs. The first row is of all, the others are of the bins."""

    family: str
    counts: IntArray
    """(1 + bins, 4): epochs, those inside, unsafe ones, those with a sigma."""
    sums: FloatArray
    """(1 + bins, 2): squared error and sigma of epochs with a sigma, in the family's unit."""
    members: IntArray
    """(3,): members that claim a sigma after the loss, those of them with a true fix after it, and those of them that
    recovered in time."""

    def copy(self) -> Honesty:
        """The same, that may be added to."""
        return Honesty(
            family=self.family, counts=self.counts.copy(), sums=self.sums.copy(), members=self.members.copy()
        )

    def merge(self, other: Honesty) -> None:
        """Add what was counted of other members."""
        self.counts += other.counts
        self.sums += other.sums
        self.members += other.members


class HonestyTally:
    """Counts the epochs of one estimator, fed in pieces."""

    def __init__(self, scenario: Scenario, family: Family) -> None:
        assert family.tolerance is not None
        self._limit = family.tolerance.error
        self._begin_ns = _begin_ns(scenario)
        self._recovery_s = _recovery_limit_s(scenario)
        bins = max(0, nanoseconds(scenario.duration_s) - self._begin_ns) // _BIN_NS + 1
        self._family = family.name
        self._counts: IntArray = np.zeros((1 + bins, 4), dtype=np.int64)
        self._sums: FloatArray = np.zeros((1 + bins, 2))
        self._began: BoolArray | None = None

    def add(self, t_ns: IntArray, sizes: FloatArray, sigmas: FloatArray) -> None:
        """Take a piece: times (T,), |error| and sigma (T, R) in the family's unit."""
        claimed = ~np.isnan(sigmas)
        counted = self._since_first_claim(claimed)
        inside = sizes <= INSIDE_SIGMAS * sigmas
        unsafe = (sizes > self._limit) & (SAFE_SIGMAS * sigmas < self._limit)
        counts = np.stack([flags.sum(axis=1) for flags in (counted, inside, unsafe, claimed)], axis=1)
        sums = np.stack([_sum_where(claimed, sizes**2), _sum_where(claimed, sigmas)], axis=1)
        self._counts[0] += counts.sum(axis=0)
        self._sums[0] += sums.sum(axis=0)
        since = t_ns >= self._begin_ns
        at = 1 + np.minimum((t_ns[since] - self._begin_ns) // _BIN_NS, len(self._counts) - 2)
        np.add.at(self._counts, at, counts[since])
        np.add.at(self._sums, at, sums[since])

    def _since_first_claim(self, claimed: BoolArray) -> BoolArray:
        """Which epochs (T, R) of a piece come with or after the first for which the member's estimator claimed one."""
        counted: BoolArray = np.logical_or.accumulate(claimed, axis=0)
        if self._began is not None:
            counted |= self._began
        if len(counted):
            self._began = counted[-1].copy()
        return counted

    def counted(self, claims: BoolArray | None = None, recovery_s: FloatArray | None = None) -> Honesty:
        """What was counted; of members (R,) who claims a sigma after the loss and when it recovers, if that is told."""
        members = np.zeros(3, dtype=np.int64)
        if claims is not None and recovery_s is not None:
            had_fix, in_time = ~np.isnan(recovery_s), recovery_s <= self._recovery_s
            members[:] = claims.sum(), (claims & had_fix).sum(), (claims & in_time).sum()
        return Honesty(family=self._family, counts=self._counts.copy(), sums=self._sums.copy(), members=members)


def _sum_where(wanted: BoolArray, values: FloatArray) -> FloatArray:
    total: FloatArray = np.where(wanted, values, 0.0).sum(axis=1)
    return total


def _begin_ns(scenario: Scenario) -> int:
    window = scenario.loss_window_s
    return nanoseconds(scenario.scoring.from_s if window is None else window[0])


def _recovery_limit_s(scenario: Scenario) -> float:
    begin, end = scenario.loss_window_s or (0.0, 0.0)
    return _RECOVERY_S if end - begin <= _SHORT_LOSS_S else _RECOVERY_AFTER_LONG_LOSS_S


# --- figures ---------------------------------------------------------------------------------------------------------


def pooled_metrics(found: Mapping[str, Honesty], scenario: Scenario) -> dict[str, float]:
    """Pooled metrics of all estimators, by name."""
    return {
        f"{estimator}.{name}": value
        for estimator, honesty in found.items()
        for name, value in figures(honesty, scenario).items()
    }


def figures(found: Honesty, scenario: Scenario) -> dict[str, float]:
    """Figures by the names of :func:`names`; NaN where no sigma was claimed, or no fix came to recover by."""
    epochs, claimed = found.counts[1:, _EPOCHS], found.counts[1:, _CLAIMED]
    full, told = _full(epochs), _full(claimed)
    inside = found.counts[1:, _INSIDE][full] / epochs[full]
    values = [
        _percent(found.counts[0, _INSIDE], found.counts[0, _EPOCHS]),
        100.0 * float(inside.min()) if len(inside) else math.nan,
        _percent(found.counts[0, _UNSAFE], found.counts[0, _EPOCHS]),
        _largest_ratio(found.sums[1:][told], claimed[told]),
    ]
    if scenario.loss_window_s is not None:
        values.append(_sigma_at_end(found, scenario.loss_window_s))
        if scenario.scoring.fixes_of is not None:
            claiming, with_fix, recovered = found.members
            values.append(_percent(recovered, claiming) if with_fix > 0 else math.nan)
    return dict(zip(names(scenario, family_named(found.family)), values, strict=True))


def _full(epochs: IntArray) -> BoolArray:
    """Bins that count."""
    full: BoolArray = (epochs > 0) & (epochs >= _LEAST_SHARE_OF_FULLEST * epochs.max(initial=0))
    return full


def _percent(part: np.int64, whole: np.int64) -> float:
    return 100.0 * float(part) / float(whole) if whole > 0 else math.nan


def _largest_ratio(sums: FloatArray, claimed: IntArray) -> float:
    """Largest mean sigma / root mean square error; infinite where there was a sigma and no error at all."""
    if not len(claimed):
        return math.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = (sums[:, _SIGMAS] / claimed) / np.sqrt(sums[:, _SQUARES] / claimed)
    return float(ratios.max())


def _sigma_at_end(found: Honesty, window: tuple[float, float]) -> float:
    """Mean sigma in the last whole second of the loss; NaN where there is none."""
    whole = (nanoseconds(window[1]) - nanoseconds(window[0])) // _BIN_NS
    if not 1 <= whole < len(found.counts) or found.counts[whole, _CLAIMED] == 0:
        return math.nan
    return float(found.sums[whole, _SIGMAS] / found.counts[whole, _CLAIMED])
