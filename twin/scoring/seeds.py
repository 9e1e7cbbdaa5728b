"""What the seeds in the ground are worth: evenness of feed and population error, per row and estimator.

After ISO 7256-1:1984, as Kachman and Smith (1995) give it, with x a spacing and x_ref the theoretical one: *multiples*
x <= 0.5 x_ref, *quality of feed* up to 1.5 x_ref, *misses* beyond, each as a share of all spacings, and *precision*
100 sd(x of quality of feed) / x_ref.

These say how evenly a row was fed, not how much: in a turn of 10 m radius the spacing of a row 2.6 m off the middle is
wrong by a quarter, and all of it counts as good feed. What the crop notices is the population error,
100 (seeds per metre of row * x_ref - 1). A row that is outside in one turn is inside in the next, so left turns, right
turns and straights do not make up for one another: the *mean absolute* population error is
100 sum |seeds * x_ref - metres| / sum metres, with a term for each row and each of the three.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.recording import Stream
from twin.scenario import Scenario
from twin.scoring.planting import FEED, MISS, MULTIPLE, Masks, Planting, classes, metered_rows
from twin.signals import YAW_RATE, BoolArray, FloatArray, IntArray

_CLASS_NAMES = ("multiples", "quality_of_feed", "misses")
_BENDS = ("_left_turns", "_right_turns", "_straights")


def counted_rows(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> list[int]:
    """Those of the metered rows that count (``scoring.rows``)."""
    counted = scenario.scoring.rows
    return [row for row in metered_rows(scenario, truth, estimate) if counted is None or row in counted]


def seed_metric_names(rows: Sequence[int], phases: Sequence[str]) -> list[str]:
    """Names of the metrics of these rows, in a run that has these phases (suffixes)."""
    if not rows:
        return []
    kinds = (*_CLASS_NAMES, "precision")
    return [
        *(f"seeds.{kind}{phase}_percent" for kind in kinds for phase in phases),
        *(f"seeds.{kind}_row_{row}_percent" for kind in kinds for row in rows),
        *(f"seeds.mean_abs_population_error{phase}_percent" for phase in phases),
        *(f"seeds.population_error_row_{row}{part}_percent" for row in rows for part in _row_parts(phases)),
    ]


def _row_parts(phases: Sequence[str]) -> list[str]:
    """Parts of a run for which a row's own population error is told: where it turned, to which side."""
    sides = list(_BENDS[:2]) if "_turns" in phases else []
    return ["", *sides, *(phase for phase in phases if phase not in {"", "_turns"})]


def bends(scenario: Scenario, truth: Stream) -> dict[str, BoolArray]:
    """Which rows of the truth belong to left turns, right turns and straights, each of shape (T,)."""
    if not truth.has(YAW_RATE):
        nowhere = np.zeros(len(truth), dtype=np.bool_)
        return dict(zip(_BENDS, (nowhere, nowhere, ~nowhere), strict=True))
    yaw_rate, least = truth.column(YAW_RATE)[:, 0], scenario.scoring.turning_rad_s
    return dict(zip(_BENDS, (yaw_rate > least, yaw_rate < -least, np.abs(yaw_rate) <= least), strict=True))


# --- scoring ---------------------------------------------------------------------------------------------------------


class SeedScorer:
    """Metrics of one estimator's seeds."""

    def __init__(self, scenario: Scenario, rows: Sequence[int], runs: Sequence[int], phases: Sequence[str]) -> None:
        if scenario.seeding is None:
            raise ValueError("the scenario has no [seeding]")
        self._scenario = scenario
        self._planting = Planting(scenario, rows, runs)
        self._spacing_m = scenario.seeding.spacing_m
        self._shape = (len(runs), len(rows))
        self._phases = list(phases)
        self._feed = {phase: _FeedTally(self._shape) for phase in phases}
        parts = dict.fromkeys([*phases, *_row_parts(phases)])
        self._seeds = {part: np.zeros((len(_BENDS), *self._shape)) for part in parts}

    def add(self, truth: Stream, masks: Masks, estimate: Stream) -> None:
        """Take the next piece; ``masks`` tell the phases of the truth's rows."""
        placed = self._planting.add(truth, {**bends(self._scenario, truth), **masks}, estimate)
        meter = placed.seeds.member * self._shape[1] + placed.seeds.row
        ratio = placed.spacing_m / self._spacing_m
        inside = {name: mask[placed.phase_row] for name, mask in self._planting.paths.masks.items()}
        for phase, tally in self._feed.items():
            tally.add(meter[inside[phase]], ratio[inside[phase]])
        for part, counts in self._seeds.items():
            for bend, name in enumerate(_BENDS):
                found = np.bincount(meter[inside[part] & inside[name]], minlength=counts[bend].size)
                counts[bend] += found.reshape(self._shape)

    def metrics(self) -> dict[str, FloatArray]:
        """Metrics by the names of :func:`seed_metric_names`, each of shape (R,); NaN where there was nothing."""
        names = seed_metric_names(self._planting.rows, self._phases)
        if len(self._planting.paths.t_s) < 2:
            return {name: np.full(self._shape[0], np.nan) for name in names}
        found: list[FloatArray] = []
        for kind in (MULTIPLE, FEED, MISS):
            found += [tally.share(kind)[:, 0] for tally in self._feed.values()]
        found += [tally.precision()[:, 0] for tally in self._feed.values()]
        for kind in (MULTIPLE, FEED, MISS):
            found += list(self._feed[""].share(kind, by_row=True).T)
        found += list(self._feed[""].precision(by_row=True).T)
        found += [self._mean_abs_population_error(phase) for phase in self._phases]
        by_part = [self._population_error(part) for part in _row_parts(self._phases)]
        found += [errors[:, row] for row in range(self._shape[1]) for errors in by_part]
        return dict(zip(names, found, strict=True))

    def _driven_m(self, part: str) -> FloatArray:
        """Metres of each row in a part of the run, by bend, (3, rows)."""
        planting = self._planting
        return np.stack([planting.paths.driven_m((part, bend), planting.from_s, planting.until_s) for bend in _BENDS])

    def _population_error(self, part: str) -> FloatArray:
        """Of each member and row in a part of the run, (R, rows), per cent."""
        seeds, driven = self._seeds[part].sum(axis=0), self._driven_m(part).sum(axis=0)
        return 100.0 * (divided(seeds * self._spacing_m, np.broadcast_to(driven, seeds.shape)) - 1.0)

    def _mean_abs_population_error(self, part: str) -> FloatArray:
        driven = self._driven_m(part)[:, np.newaxis]
        wrong = np.abs(self._seeds[part] * self._spacing_m - driven).sum(axis=(0, 2))
        return 100.0 * divided(wrong, np.full_like(wrong, driven.sum()))


class _FeedTally:
    """Counts and sums of the spacings of R x rows meters in one phase."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._counts = np.zeros((3, shape[0] * shape[1]))
        self._sum = np.zeros(shape[0] * shape[1])
        self._squares = np.zeros(shape[0] * shape[1])

    def add(self, meter: IntArray, ratio: FloatArray) -> None:
        """Count seeds (N,) of these meters with these spacings x / x_ref."""
        length = len(self._sum)
        found = classes(ratio)
        for kind in (MULTIPLE, FEED, MISS):
            self._counts[kind] += np.bincount(meter[found == kind], minlength=length)
        fed = found == FEED
        # About the wanted spacing, so that the sums stay small.
        off = ratio[fed] - 1.0
        self._sum += np.bincount(meter[fed], off, minlength=length)
        self._squares += np.bincount(meter[fed], off**2, minlength=length)

    def _gathered(self, values: FloatArray, by_row: bool) -> FloatArray:
        """(R, rows), or (R, 1) of all rows together."""
        split = values.reshape(self._shape)
        return split if by_row else split.sum(axis=1, keepdims=True)

    def share(self, kind: int, *, by_row: bool = False) -> FloatArray:
        """Share of the spacings that are of one class, per cent."""
        number = self._gathered(self._counts[kind], by_row)
        of = self._gathered(self._counts.sum(axis=0), by_row)
        return 100.0 * divided(number, of)

    def precision(self, *, by_row: bool = False) -> FloatArray:
        """Standard deviation of x / x_ref in the feed class, per cent; NaN of less than two."""
        number, total, squares = (
            self._gathered(values, by_row) for values in (self._counts[FEED], self._sum, self._squares)
        )
        variance = divided(squares - total * divided(total, number), number - 1.0)
        return 100.0 * np.sqrt(np.maximum(variance, 0.0))


def divided(number: FloatArray, of: FloatArray) -> FloatArray:
    """Quotient, NaN where there is nothing to divide by."""
    quotient: FloatArray = np.full_like(number, np.nan)
    return np.divide(number, of, out=quotient, where=of > 0.0)
