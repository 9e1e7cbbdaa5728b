"""Coverage: how much of a field the implement worked, how much of that twice, and how much it left out.

The implement is a bar of the swath's width at the machine's reference frame, square to its heading. From one true pose
to the next it sweeps over a polygon; the area that counts is divided into cells, and a cell belongs to a pass if its
middle lies in one of the polygons. A cell is *covered* if a pass went over it, *overlapped* if two different ones did,
*skipped* if none. A pass is a straight with the turn that follows it, until the next straight that does not simply go
on in its line, or until the implement is raised: raised segments cover nothing. What a pass covers again itself, as a
bar does that turns about a point of its own, is no overlap. The whole run counts, whatever ``scoring.from_s`` says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.control.planned_legs import PlannedLeg
from twin.coverage import CoverageConfig
from twin.recording import Stream
from twin.scenario import Scenario
from twin.scoring.sweep import sweep
from twin.signals import HEADING, POSITION, FloatArray, IntArray

SEGMENT = "segment"
_NEEDED = frozenset({*POSITION[:2], HEADING, SEGMENT})
_KINDS = ("covered", "overlap", "skip")
NAMES = (*(f"coverage.{kind}_percent" for kind in _KINDS), *(f"coverage.{kind}_m2" for kind in _KINDS))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coverage:
    """What the passes of a run went over."""

    config: CoverageConfig
    counts: NDArray[np.uint8]
    """(rows, columns) passes over each cell; row 0 is the southern edge, column 0 the western."""

    @property
    def area_m2(self) -> float:
        """The area that counts."""
        west, south, east, north = self.config.area_m
        return (east - west) * (north - south)

    @property
    def shares(self) -> dict[str, float]:
        """Share of the area that is covered, overlapped and skipped."""
        covered, twice = (np.count_nonzero(self.counts >= least) / self.counts.size for least in (1, 2))
        return dict(zip(_KINDS, (covered, twice, 1.0 - covered), strict=True))


def names(scenario: Scenario, truth: Sequence[str]) -> list[str]:
    """Names of :func:`metrics` of a run with these truth columns."""
    return list(NAMES) if scenario.coverage is not None and set(truth) >= _NEEDED else []


def metrics(truth: Stream, scenario: Scenario) -> dict[str, float]:
    """Shares of the area in per cent, and in m2."""
    found = coverage_of(truth, scenario)
    if found is None:
        return {}
    shares = list(found.shares.values())
    values = [*(100.0 * share for share in shares), *(found.area_m2 * share for share in shares)]
    return dict(zip(NAMES, values, strict=True))


def coverage_of(truth: Stream, scenario: Scenario) -> Coverage | None:
    """What the machine covered; None where a scenario has no ``[coverage]``, or the truth tells too little."""
    config = scenario.coverage
    if config is None or not names(scenario, truth.columns):
        return None
    segments = truth.column(SEGMENT)[:, 0].astype(np.int64)
    numbers = np.array(passes_of(scenario.planned_legs), dtype=np.int64)
    return cover(
        config,
        truth.select(POSITION[:2])[:, 0],
        truth.column(HEADING)[:, 0],
        numbers[np.minimum(segments, len(numbers) - 1)],
    )


def passes_of(legs: Sequence[PlannedLeg]) -> list[int]:
    """Number of the pass that each segment belongs to; -1 of raised ones."""
    found: list[int] = []
    number, begins, turned = -1, True, False
    for leg in legs:
        if leg.raised:
            found.append(-1)
            begins = True
            continue
        if begins or (turned and leg.is_straight):
            number += 1
            begins = turned = False
        turned |= leg.is_arc or leg.spins
        found.append(number)
    return found


def cover(config: CoverageConfig, points_m: FloatArray, headings_rad: FloatArray, numbers: IntArray) -> Coverage:
    """Sweep a bar through poses: middles (N, 2), headings (N,), and which pass it is at from each pose on (N,)."""
    left = np.column_stack([-np.sin(headings_rad), np.cos(headings_rad)])
    west, south = config.area_m[:2]
    deep, wide = config.cell_size_m
    ends = [(points_m + side * config.swath_m * left - (west, south)) / (wide, deep) for side in (0.5, -0.5)]
    counts = np.zeros(config.shape, dtype=np.uint8)
    last = np.full(config.shape, -1, dtype=np.int32)
    sweep(np.ascontiguousarray(np.hstack(ends)), np.ascontiguousarray(numbers), counts, last)
    return Coverage(config=config, counts=counts)
