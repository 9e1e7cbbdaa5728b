"""The loop that marks what a moving bar sweeps over in a raster, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.signals import FloatArray, IntArray

MOST = 255
"""Counts go no further."""

_Point = tuple[float, float]
_Counts = NDArray[np.uint8]
_Marks = NDArray[np.int32]


@compiled
def _mark(row: int, span: tuple[float, float], number: int, counts: _Counts, last: _Marks) -> None:
    """Count a pass in the cells of a row whose middle lies in [begin, end), where it has not been counted yet."""
    first, after = max(math.ceil(span[0] - 0.5), 0), min(math.ceil(span[1] - 0.5), counts.shape[1])
    for column in range(first, after):
        if last[row, column] != number:
            last[row, column] = number
            if counts[row, column] < MOST:
                counts[row, column] += 1


@compiled
def _crossing(one: _Point, other: _Point, y: float) -> float:
    """Where an edge meets a line of constant y; NaN if it does not. The same whichever end is named first."""
    low, high = (one, other) if one[1] <= other[1] else (other, one)
    if not low[1] <= y < high[1]:
        return math.nan
    return low[0] + (y - low[1]) * (high[0] - low[0]) / (high[1] - low[1])


@compiled
def _fill(triangle: tuple[_Point, _Point, _Point], number: int, counts: _Counts, last: _Marks) -> None:
    """Count a pass in the cells whose middle lies in a triangle; of two that share an edge, in one of them."""
    a, b, c = triangle
    low, high = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
    for row in range(max(math.ceil(low - 0.5), 0), min(math.ceil(high - 0.5), counts.shape[0])):
        begin, end = math.inf, -math.inf
        for x in (_crossing(a, b, row + 0.5), _crossing(b, c, row + 0.5), _crossing(c, a, row + 0.5)):
            if not math.isnan(x):
                begin, end = min(begin, x), max(end, x)
        if begin < end:
            _mark(row, (begin, end), number, counts, last)


@compiled
def sweep(bars: FloatArray, numbers: IntArray, counts: _Counts, last: _Marks) -> None:
    """Count passes in the cells that a bar sweeps over.

    Args:
        bars: (N, 4) x and y of the left end, x and y of the right end at successive times, in cells from the raster's
            first corner.
        numbers: (N,) which pass the bar is at from that time on; none if negative.
        counts: (rows, columns) passes over each cell, added to.
        last: (rows, columns) the pass counted last in each cell, kept up.
    """
    for k in range(len(bars) - 1):
        if numbers[k] < 0:
            continue
        left, right = (bars[k, 0], bars[k, 1]), (bars[k, 2], bars[k, 3])
        left_next, right_next = (bars[k + 1, 0], bars[k + 1, 1]), (bars[k + 1, 2], bars[k + 1, 3])
        # Where the bar turns about a point of its own, its two positions cross there: two triangles meet in a corner.
        along_x, along_y = right[0] - left[0], right[1] - left[1]
        next_x, next_y = right_next[0] - left_next[0], right_next[1] - left_next[1]
        away_x, away_y = left_next[0] - left[0], left_next[1] - left[1]
        across = along_x * next_y - along_y * next_x
        if across != 0.0:
            one = (away_x * next_y - away_y * next_x) / across
            other = (away_x * along_y - away_y * along_x) / across
            if 0.0 < one < 1.0 and 0.0 < other < 1.0:
                pivot = (left[0] + one * along_x, left[1] + one * along_y)
                _fill((left, left_next, pivot), numbers[k], counts, last)
                _fill((right, right_next, pivot), numbers[k], counts, last)
                continue
        _fill((left, right, right_next), numbers[k], counts, last)
        _fill((left, right_next, left_next), numbers[k], counts, last)
