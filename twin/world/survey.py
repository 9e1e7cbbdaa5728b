"""How flat a field is: the figures that land levelling is judged by, from the height array itself.

S_d is the standard deviation of the heights over a grid (n - 1 in the denominator); beside it stands the share of
heights within 30 mm of their mean (TD/T 1033-2012, after paper 002) and within 50 mm. They depend on the grid: it is
the terrain's own.
"""

from __future__ import annotations

import math

import numpy as np

from twin.errors import BadInputError
from twin.signals import LEVEL_WITHIN_M, NS_PER_S, FloatArray
from twin.world.terrain import Extent, Terrain

SURVEY_COLUMNS = ("field_sd_m", "field_mean_m", "field_within_30mm", "field_within_50mm")
"""Truth columns of :meth:`FieldSurvey.truth`; the mean is counted from the design plane."""

_NEARLY_LEVEL_M = 0.050
"""As papers on laser levelling have it (from memory)."""


class FieldSurvey:
    """Surveys an area of a terrain, at most once a second.

    Raises:
        BadInputError: the area holds fewer than two nodes of the terrain.
    """

    def __init__(self, terrain: Terrain, area_m: Extent, *, design_height_m: float = 0.0) -> None:
        self._heights = within(area_m, terrain.heights, (terrain.west_m, terrain.south_m), terrain.cell_m)
        """A view: it follows what a blade does."""
        if self._heights.size < 2:
            raise BadInputError(f"levelling.area_m: {area_m} m holds no part of the terrain, which is {terrain.extent}")
        self._design_height_m = design_height_m
        self._second = -1
        self._figures = (math.nan,) * len(SURVEY_COLUMNS)

    def truth(self, t_ns: int) -> tuple[float, ...]:
        """Values of ``SURVEY_COLUMNS`` as they were when this second was first asked for."""
        if t_ns // NS_PER_S != self._second:
            self._second = t_ns // NS_PER_S
            self._figures = self.measure()
        return self._figures

    def measure(self) -> tuple[float, ...]:
        """Values of ``SURVEY_COLUMNS`` now."""
        spread, mean, *shares = flatness(self._heights)
        return spread, mean - self._design_height_m, *shares


def flatness(heights_m: FloatArray) -> tuple[float, float, float, float]:
    """S_d (m), mean (m), and the shares of heights within 30 mm and 50 mm of it; NaN of fewer than two heights."""
    if heights_m.size < 2:
        return (math.nan,) * 4
    mean = float(heights_m.mean())
    off = np.abs(heights_m - mean)
    spread = math.sqrt(float(np.square(off).sum()) / (off.size - 1))
    level, nearly = (np.count_nonzero(off <= limit) / off.size for limit in (LEVEL_WITHIN_M, _NEARLY_LEVEL_M))
    return spread, mean, level, nearly


def within(area_m: Extent, heights_m: FloatArray, origin_m: tuple[float, float], cell_m: float) -> FloatArray:
    """The nodes of a height array (ny, nx) that lie within an area, as a view; ``origin_m`` is its south-west node."""
    west, south, east, north = area_m
    rows = _inside(origin_m[1], cell_m, south, north, heights_m.shape[0])
    columns = _inside(origin_m[0], cell_m, west, east, heights_m.shape[1])
    nodes: FloatArray = heights_m[rows, columns]
    return nodes


def _inside(origin_m: float, cell_m: float, low_m: float, high_m: float, count: int) -> slice:
    """Nodes along one axis that lie within limits (and a thousandth of a cell, for limits that are nodes)."""
    first = math.ceil((low_m - origin_m) / cell_m - 1e-3)
    last = math.floor((high_m - origin_m) / cell_m + 1e-3)
    return slice(min(max(first, 0), count), min(max(last + 1, 0), count))
