"""Kernels of :mod:`twin.world.blade`: what a blade's edge does to the height array.

A node of the grid stands for the cell around it. The sign of its distance to the edge's line tells whether the edge has
passed it, and one strip's last line is the next strip's first: every node is worked on once per pass, at whatever rate
and heading the edge moves. Each transfer takes a volume from one place and adds the same to another.
"""

# ruff: noqa: PLR0917 (compiled functions take positional arguments)
from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.signals import FloatArray
from twin.world.spoil import draw, even_out, lay, neighbours, overflow, slump, wider

# Columns of an edge: its middle, the horizontal unit vector to its left end, height of the middle, rise per metre left.
X, Y, LEFT_X, LEFT_Y, Z, RISE = range(6)
EDGE_COLUMNS = 6
# Figures of a blade (FloatArray).
HALF_WIDTH, TAN_REPOSE, CAPACITY_M2, EVENING_M, RESISTANCE_PA, LOAD_N_M3, BASE_N, SMOOTHING_M = range(8)
# Where the soil went, m^3; cut cross-section and share of the edge in the ground, both over SMOOTHING_M; draught.
CUT, FILLED, SPILLED, SECTION_M2, CONTACT, DRAUGHT_N = range(6)
TOTALS = 6

_FILM_M = 1e-4
"""Less soil moved than this does not count as contact with the edge."""
_WINDROW_M = 0.5
"""Where soil that falls past an end may slide: as far as a windrow 0.3 m high reaches."""


@compiled
def edge_of(link: FloatArray, middle: FloatArray, edge: FloatArray) -> None:
    """Edge of a blade on a link (row of ``twin.world.dynamics``: position, then rotation), into ``edge``."""
    x, y, z = middle[0], middle[1], middle[2]
    for k in range(3):
        edge[(X, Y, Z)[k]] = link[k] + link[3 + 3 * k] * x + link[4 + 3 * k] * y + link[5 + 3 * k] * z
    level = math.hypot(link[4], link[7])
    edge[LEFT_X], edge[LEFT_Y], edge[RISE] = link[4] / level, link[7] / level, link[10] / level


@compiled
def ahead_m(edge: FloatArray, x: float, y: float) -> float:
    """How far a point lies ahead of an edge's line."""
    return float((x - edge[X]) * edge[LEFT_Y] - (y - edge[Y]) * edge[LEFT_X])


@compiled
def _left_m(edge: FloatArray, x: float, y: float) -> float:
    return float((x - edge[X]) * edge[LEFT_X] + (y - edge[Y]) * edge[LEFT_Y])


@compiled
def advance_m(before: FloatArray, after: FloatArray, half_width: float) -> float:
    """How far the end that moved farther forward has moved."""
    dx, dy = half_width * after[LEFT_X], half_width * after[LEFT_Y]
    left = ahead_m(before, after[X] + dx, after[Y] + dy)
    return float(max(left, ahead_m(before, after[X] - dx, after[Y] - dy)))


@compiled
def _window(
    before: FloatArray, after: FloatArray, half_width: float, shape: tuple[int, int],
    west: float, south: float, cell: float,
) -> tuple[int, int, int, int]:  # fmt: skip
    """First and last column, first and last row of the grid that two edges span, with a cell to spare."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for edge in (before, after):
        dx, dy = half_width * abs(edge[LEFT_X]), half_width * abs(edge[LEFT_Y])
        low_x, high_x = min(low_x, edge[X] - dx), max(high_x, edge[X] + dx)
        low_y, high_y = min(low_y, edge[Y] - dy), max(high_y, edge[Y] + dy)
    first, last = math.floor((low_x - west) / cell) - 1, math.ceil((high_x - west) / cell) + 1
    bottom, top = math.floor((low_y - south) / cell) - 1, math.ceil((high_y - south) / cell) + 1
    return max(first, 0), min(last, shape[1] - 1), max(bottom, 0), min(top, shape[0] - 1)


@compiled
def sweep(
    before: FloatArray, after: FloatArray, figures: FloatArray, heights: FloatArray, changed: NDArray[np.bool_],
    west: float, south: float, cell: float, load: FloatArray, totals: FloatArray,
) -> None:  # fmt: skip
    """Cut and fill the nodes that the edge passes between two places.

    A cell half beside the blade's end is worked on in part. Soil in front of the blade stands as a wedge at the angle
    of repose: no more than its height can pass below an edge far above the ground, so that the load of a lifted blade
    stays behind as a heap of that slope.
    """
    half, tangent, area = figures[HALF_WIDTH], figures[TAN_REPOSE], cell * cell
    bin_m = 2.0 * half / load.shape[0]
    i0, i1, j0, j1 = _window(before, after, half + cell, heights.shape, west, south, cell)
    section = worked = thickest = 0.0
    for j in range(j0, j1 + 1):
        y = south + j * cell
        for i in range(i0, i1 + 1):
            x = west + i * cell
            since, until = ahead_m(before, x, y), ahead_m(after, x, y)
            if since <= 0.0 or until > 0.0:
                continue
            share = since / (since - until)
            left = (1.0 - share) * _left_m(before, x, y) + share * _left_m(after, x, y)
            cover = min(1.0, (half - abs(left)) / cell + 0.5)
            if cover <= 0.0:
                continue
            edge = (1.0 - share) * (before[Z] + left * before[RISE]) + share * (after[Z] + left * after[RISE])
            k, upper = neighbours(left, half, bin_m, load.shape[0])
            gap = edge - heights[j, i]
            if gap < 0.0:
                volume = -gap * cover * area
                totals[CUT] += volume
                section += volume
                load[k] += (1.0 - upper) * volume
                load[k + 1] += upper * volume
                heights[j, i] -= volume / area
            else:
                volume = (
                    draw(load, k, (1.0 - upper) * cover * area, gap, 2.0 * tangent / bin_m)
                    + draw(load, k + 1, upper * cover * area, gap, 2.0 * tangent / bin_m)
                )  # fmt: skip
                totals[FILLED] += volume
                heights[j, i] += volume / area
                thickest = max(thickest, volume / area)
            if volume > _FILM_M * area:
                worked += cover * area
            changed[j, i] |= volume > 0.0
    if thickest > tangent * cell:
        slump(heights, changed, wider((i0, i1, j0, j1), thickest / tangent / cell, heights.shape), tangent * cell)
    step = max(advance_m(before, after, half), 1e-9)
    fresh = 1.0 - math.exp(-step / figures[SMOOTHING_M])
    totals[SECTION_M2] += fresh * (section / step - totals[SECTION_M2])
    totals[CONTACT] += fresh * (worked / (2.0 * half * step) - totals[CONTACT])


@compiled
def spill(
    edge: FloatArray, figures: FloatArray, heights: FloatArray, changed: NDArray[np.bool_],
    west: float, south: float, cell: float, load: FloatArray, totals: FloatArray,
) -> None:  # fmt: skip
    """Lay what the blade cannot hold beside its ends, on ground that it has passed."""
    half, capacity = figures[HALF_WIDTH], figures[CAPACITY_M2] * 2.0 * figures[HALF_WIDTH] / load.shape[0]
    for side, volume in zip((1.0, -1.0), overflow(load, capacity)):  # noqa: B905 (numba knows no strict zip)
        if volume <= 0.0:
            continue
        left, back = side * (half + 1.5 * cell), 1.5 * cell
        x = edge[X] + left * edge[LEFT_X] - back * edge[LEFT_Y]
        y = edge[Y] + left * edge[LEFT_Y] + back * edge[LEFT_X]
        i, j = lay(heights, changed, west, south, cell, x, y, volume)
        window = wider((i, i + 1, j, j + 1), _WINDROW_M / cell, heights.shape)
        slump(heights, changed, window, figures[TAN_REPOSE] * cell)
        totals[SPILLED] += volume


@compiled
def set_down(
    edge: FloatArray, figures: FloatArray, heights: FloatArray, changed: NDArray[np.bool_],
    west: float, south: float, cell: float, load: FloatArray, totals: FloatArray,
) -> None:  # fmt: skip
    """Leave the load ahead of the edge, as the wedges that it stood in."""
    half, tangent = figures[HALF_WIDTH], figures[TAN_REPOSE]
    bin_m = 2.0 * half / load.shape[0]
    for k in range(load.shape[0]):
        reach = math.sqrt(2.0 * load[k] / bin_m / tangent)
        parts = 1 + int(2.0 * reach / cell)
        left = (k + 0.5) * bin_m - half
        for part in range(parts):
            # share of a triangle's area between two parallels to its upright side
            share = (2.0 * (parts - part) - 1.0) / parts**2
            ahead = (part + 0.5) / parts * reach
            x = edge[X] + left * edge[LEFT_X] + ahead * edge[LEFT_Y]
            y = edge[Y] + left * edge[LEFT_Y] - ahead * edge[LEFT_X]
            lay(heights, changed, west, south, cell, x, y, share * load[k])
        totals[FILLED] += load[k]
        load[k] = 0.0


@compiled
def work(
    link: FloatArray, middle: FloatArray, figures: FloatArray, heights: FloatArray, changed: NDArray[np.bool_],
    west: float, south: float, cell: float, edge: FloatArray, load: FloatArray, totals: FloatArray,
) -> None:  # fmt: skip
    """Take the edge from where it last was (``edge``) to where its link is now, in strips of about half a cell.

    Backwards it moves no soil: once it has gone back by a cell, it has left its load behind.
    """
    half = figures[HALF_WIDTH]
    target, last, now = np.empty(EDGE_COLUMNS), edge.copy(), np.empty(EDGE_COLUMNS)
    edge_of(link, middle, target)
    advance = advance_m(last, target, half)
    if not np.isfinite(advance) or advance < -cell:
        if np.isfinite(advance):
            set_down(edge, figures, heights, changed, west, south, cell, load, totals)
            totals[SECTION_M2] = totals[CONTACT] = totals[DRAUGHT_N] = 0.0
        edge[:] = target
        return
    if advance < 0.5 * cell:
        return
    parts = int(advance / (0.5 * cell) + 0.5)
    for part in range(1, parts + 1):
        share = part / parts
        for k in range(EDGE_COLUMNS):
            now[k] = (1.0 - share) * last[k] + share * target[k]
        level = math.hypot(now[LEFT_X], now[LEFT_Y])
        now[LEFT_X], now[LEFT_Y] = now[LEFT_X] / level, now[LEFT_Y] / level
        sweep(edge, now, figures, heights, changed, west, south, cell, load, totals)
        bin_m = 2.0 * half / load.shape[0]
        even_out(load, figures[EVENING_M] * advance / parts / bin_m**2)
        spill(now, figures, heights, changed, west, south, cell, load, totals)
        edge[:] = now
    totals[DRAUGHT_N] = (
        figures[BASE_N] * totals[CONTACT]
        + figures[RESISTANCE_PA] * totals[SECTION_M2]
        + figures[LOAD_N_M3] * load.sum()
    )
