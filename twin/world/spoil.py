"""Kernels for loose soil: the load in front of a blade, one volume per bin along its edge, and soil that is laid down.

Each transfer takes a volume from one place and adds the same to another.
"""

# ruff: noqa: PLR0917 (compiled functions take positional arguments)
from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.signals import FloatArray

_MOST_SLUMPS = 40
"""Passes over a window in which soil slides down; the next strip's window overlaps it."""
_STILL = 0.02
"""Share of the steepest rise by which soil may stand steeper and stay."""


@compiled
def neighbours(left: float, half_width: float, bin_m: float, count: int) -> tuple[int, float]:
    """Between which two bins' middles a place along the edge lies: the right one, and the share of the left one."""
    place = (left + half_width) / bin_m - 0.5
    k = min(max(math.floor(place), 0), count - 2)
    return k, min(max(place - k, 0.0), 1.0)


@compiled
def draw(load: FloatArray, k: int, area: float, gap: float, steepness: float) -> float:
    """Take from a bin what fills an area below the edge, no higher than the wedge of soil stands; return the volume."""
    volume = float(min(min(gap, math.sqrt(steepness * load[k])) * area, load[k]))
    load[k] -= volume
    return volume


@compiled
def wider(
    window: tuple[int, int, int, int], nodes: float, shape: tuple[int, int]
) -> tuple[int, int, int, int]:  # fmt: skip
    """Window (first and last column, first and last row) with more nodes around it, as far as the grid goes."""
    i0, i1, j0, j1 = window
    more = 2 + math.ceil(nodes)
    return max(i0 - more, 0), min(i1 + more, shape[1] - 1), max(j0 - more, 0), min(j1 + more, shape[0] - 1)


@compiled
def slump(
    heights: FloatArray, changed: NDArray[np.bool_], window: tuple[int, int, int, int], steepest_m: float
) -> None:
    """Let soil slide from node to node until it nowhere rises by more than ``steepest_m`` per cell."""
    i0, i1, j0, j1 = window
    for _ in range(_MOST_SLUMPS):
        still = True
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                for dj, di in ((0, 1), (1, 0), (1, 1), (1, -1)):
                    jj, ii = j + dj, i + di
                    if jj > j1 or ii > i1 or ii < i0:
                        continue
                    drop = heights[j, i] - heights[jj, ii]
                    excess = abs(drop) - steepest_m * math.sqrt(dj * dj + di * di)
                    if excess > _STILL * steepest_m:
                        still = False
                        moved = math.copysign(0.5 * excess, drop)
                        heights[j, i] -= moved
                        heights[jj, ii] += moved
                        changed[j, i] = changed[jj, ii] = True
        if still:
            return


@compiled
def lay(
    heights: FloatArray, changed: NDArray[np.bool_], west: float, south: float, cell: float,
    x: float, y: float, volume: float,
) -> tuple[int, int]:  # fmt: skip
    """Lay soil on the four nodes around a point (on the border, if it is off the grid); tell the first of them."""
    rows, columns = heights.shape
    column = min(max((x - west) / cell, 0.0), columns - 1.0)
    row = min(max((y - south) / cell, 0.0), rows - 1.0)
    i, j = min(int(column), columns - 2), min(int(row), rows - 2)
    u, v, height = column - i, row - j, volume / (cell * cell)
    heights[j, i] += (1.0 - u) * (1.0 - v) * height
    heights[j, i + 1] += u * (1.0 - v) * height
    heights[j + 1, i] += (1.0 - u) * v * height
    heights[j + 1, i + 1] += u * v * height
    changed[j : j + 2, i : i + 2] = True
    return i, j


@compiled
def even_out(load: FloatArray, exchange: float) -> None:
    """Let the load of neighbouring bins flow together: diffusion by ``exchange`` = D s / bin^2."""
    rounds = math.ceil(exchange / 0.25)
    for _ in range(rounds):
        kept = load[0]
        for k in range(load.shape[0] - 1):
            flow = exchange / rounds * (kept - load[k + 1])
            kept = load[k + 1]
            load[k] -= flow
            load[k + 1] += flow


@compiled
def overflow(load: FloatArray, capacity: float) -> tuple[float, float]:
    """Push what bins cannot hold outwards from the middle; return what comes out at the left and at the right end."""
    last = load.shape[0] - 1
    left = right = 0.0
    for k in range(load.shape[0] // 2, last + 1):
        excess = max(load[k] - capacity, 0.0)
        load[k] -= excess
        if k < last:
            load[k + 1] += excess
        else:
            left = excess
    for k in range((load.shape[0] - 1) // 2, -1, -1):
        excess = max(load[k] - capacity, 0.0)
        load[k] -= excess
        if k > 0:
            load[k - 1] += excess
        else:
            right = excess
    return left, right
