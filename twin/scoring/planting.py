"""The seeds in the ground: where those that an estimator metered truly lie.

A seed lands where its row unit truly is when it comes to rest. Its spacing is the way along the row's true path from
the seed that landed before it in that row; seeds on one spot, or behind the last one, have a spacing of zero or less.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.control.seed_metering import SeedMeter, Seeds
from twin.recording import Recording, Stream, seed_stream_name
from twin.scenario import Scenario
from twin.scoring.measures import row_numbers
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray, row_position, row_speed

MULTIPLE, FEED, MISS = 0, 1, 2
"""Classes of a spacing."""
STREAM_COLUMNS = ("row", "position_e_m", "position_n_m", "spacing_m", "feed_class")
_MULTIPLE_UP_TO, _FEED_UP_TO = 0.5, 1.5

Masks = Mapping[str, BoolArray]
"""By suffix of the phase: which rows of the truth belong to it."""


def metered_rows(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> list[int]:
    """Row units of which the estimate has the speed and the truth speed and place; none without ``[seeding]``."""
    if scenario.seeding is None:
        return []
    known = [row for row in row_numbers(estimate) if {row_speed(row), *row_position(row)} <= set(truth)]
    return sorted(known)


# --- placing ---------------------------------------------------------------------------------------------------------


class TruePaths:
    """Where some row units truly went; the truth may come in pieces."""

    def __init__(self, rows: Sequence[int]) -> None:
        self._rows = list(rows)
        self.t_s: FloatArray = np.empty(0)
        """(T,)."""
        self.east_m: FloatArray = np.empty((0, len(rows)))
        self.north_m: FloatArray = np.empty((0, len(rows)))
        self.along_m: FloatArray = np.empty((0, len(rows)))
        """(T, rows) way from the start, backwards negative."""
        self.masks: dict[str, BoolArray] = {}
        """(T,) by phase."""
        self._speed: FloatArray = np.empty((0, len(rows)))

    def extend(self, truth: Stream, masks: Masks) -> None:
        """Add those rows of the truth that are new."""
        new = truth.t_s > self.t_s[-1] if len(self.t_s) else np.ones(len(truth), dtype=np.bool_)
        if not new.any():
            return
        values = truth.values[new, 0]

        def columns(names: Sequence[str], before: FloatArray) -> FloatArray:
            return np.concatenate([before, values[:, [truth.columns.index(name) for name in names]]])

        known = max(0, len(self.t_s) - 1)
        self.t_s = np.concatenate([self.t_s, truth.t_s[new]])
        self.east_m = columns([row_position(row)[0] for row in self._rows], self.east_m)
        self.north_m = columns([row_position(row)[1] for row in self._rows], self.north_m)
        self._speed = columns([row_speed(row) for row in self._rows], self._speed)
        chord = np.hypot(np.diff(self.east_m[known:], axis=0), np.diff(self.north_m[known:], axis=0))
        step = np.copysign(chord, self._speed[known:-1] + self._speed[known + 1 :])
        start = self.along_m[known:] if len(self.along_m) else np.zeros((1, len(self._rows)))
        self.along_m = np.concatenate([self.along_m[:known], np.cumsum(np.concatenate([start, step]), axis=0)])
        nothing = np.empty(0, dtype=np.bool_)
        self.masks = {name: np.concatenate([self.masks.get(name, nothing), mask[new]]) for name, mask in masks.items()}

    def before(self, t_s: FloatArray) -> tuple[IntArray, FloatArray]:
        """Row of the truth before each time (N,), and the part of the step to the next one that has passed."""
        at = np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, max(0, len(self.t_s) - 2))
        return at, (t_s - self.t_s[at]) / (self.t_s[at + 1] - self.t_s[at])

    def between(self, values: FloatArray, seeds: Seeds) -> FloatArray:
        """``values`` (T, rows) where each seed's row unit was as it landed, (N,)."""
        at, part = self.before(seeds.landed_s)
        return values[at, seeds.row] * (1.0 - part) + values[at + 1, seeds.row] * part

    def driven_m(self, phases: Iterable[str], from_s: float, to_s: float) -> FloatArray:
        """Way of each row where all of these phases hold, from one time to another, (rows,)."""
        inside = np.logical_and.reduce([self.masks[phase][:-1] for phase in phases])
        steps = np.diff(self.along_m, axis=0)
        length_s = np.diff(self.t_s)
        share = np.clip((to_s - self.t_s[:-1]) / length_s, 0.0, 1.0) * (self.t_s[:-1] >= from_s)
        driven: FloatArray = (share * inside) @ steps
        return driven


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """Seeds in the ground."""

    seeds: Seeds
    phase_row: IntArray
    """(N,) row of the truth that tells their phase."""
    spacing_m: FloatArray
    """(N,) from the seed that landed before in the same row; NaN for the first."""


class Planting:
    """What one estimator's meters put in the ground, from ``scoring.from_s`` on; all may come in pieces."""

    def __init__(self, scenario: Scenario, rows: Sequence[int], runs: Sequence[int]) -> None:
        if scenario.seeding is None:
            raise ValueError("the scenario has no [seeding]")
        self.rows = list(rows)
        self.paths = TruePaths(rows)
        self.from_s = scenario.scoring.from_s
        self._meter = SeedMeter(scenario.seeding, seed=scenario.seed, runs=runs, rows=rows)
        self._last_m = np.full((len(runs), len(rows)), np.nan)

    @property
    def until_s(self) -> float:
        """Until when all seeds have been placed."""
        return min(self._meter.settled_s, float(self.paths.t_s[-1]) if len(self.paths.t_s) else -np.inf)

    def add(self, truth: Stream, masks: Masks, estimate: Stream) -> Placed:
        """Take the next estimates; return the seeds that have landed since the last time."""
        self.paths.extend(truth, masks)
        self._meter.turn(estimate.t_s, estimate.select([row_speed(row) for row in self.rows]))
        seeds = self._meter.landed(self.until_s)
        # Two rows of the truth are needed to place anything between them.
        seeds = seeds.those((seeds.landed_s >= self.from_s) & (len(self.paths.t_s) > 1))
        if not len(seeds.landed_s):
            return Placed(seeds=seeds, phase_row=np.empty(0, dtype=np.int64), spacing_m=np.empty(0))
        return Placed(seeds=seeds, phase_row=self.paths.before(seeds.landed_s)[0], spacing_m=self._spacing(seeds))

    def _spacing(self, seeds: Seeds) -> FloatArray:
        along = self.paths.between(self.paths.along_m, seeds)
        row = seeds.member * len(self.rows) + seeds.row
        begins = np.diff(row, prepend=-1) != 0
        before = np.concatenate([[np.nan], along[:-1]])
        before[begins] = self._last_m.ravel()[row[begins]]
        ends = np.diff(row, append=-1) != 0
        self._last_m.ravel()[row[ends]] = along[ends]
        spacing: FloatArray = along - before
        return spacing


def classes(ratio: FloatArray) -> FloatArray:
    """Class of each spacing x / x_ref (N,): 0 multiple, 1 feed, 2 miss; NaN where there is no spacing."""
    feed = np.where(ratio <= _MULTIPLE_UP_TO, MULTIPLE, np.where(ratio <= _FEED_UP_TO, FEED, MISS))
    return np.where(np.isnan(ratio), np.nan, feed)


# --- recording -------------------------------------------------------------------------------------------------------


def seed_stream(scenario: Scenario, truth: Stream, estimate: Stream, *, run: int) -> Stream | None:
    """Seeds of all rows that one estimator (R = 1) put in the ground from ``scoring.from_s`` on; None without any.

    In order of landing. Columns: :data:`STREAM_COLUMNS`; spacing and class are NaN for the first seed of a row.
    """
    rows = metered_rows(scenario, truth.columns, estimate.columns)
    if not rows or scenario.seeding is None:
        return None
    planting = Planting(scenario, rows, (run,))
    placed = planting.add(truth, {}, estimate)
    if not len(placed.spacing_m):
        return None
    seeds, paths = placed.seeds, planting.paths
    values = np.column_stack(
        [
            np.array(rows, dtype=np.float64)[seeds.row],
            paths.between(paths.east_m, seeds),
            paths.between(paths.north_m, seeds),
            placed.spacing_m,
            classes(placed.spacing_m / scenario.seeding.spacing_m),
        ]
    )
    order = np.argsort(seeds.landed_s, kind="stable")
    t_ns = np.rint(seeds.landed_s[order] * NS_PER_S).astype(np.int64)
    return Stream(columns=STREAM_COLUMNS, t_ns=t_ns, values=values[order, np.newaxis])


def seed_streams(scenario: Scenario, recording: Recording) -> dict[str, Stream]:
    """Streams ``seeds/<estimator>`` of an ordinary run; none of an ensemble, whose members plant at their own times."""
    if len(recording.runs) != 1:
        return {}
    found: dict[str, Stream] = {}
    for name in recording.names("estimates"):
        stream = seed_stream(scenario, recording.truth, recording.estimates(name), run=recording.runs[0])
        if stream is not None:
            found[seed_stream_name(name)] = stream
    return found
