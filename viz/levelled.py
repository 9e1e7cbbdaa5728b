"""The part of the ground that is being levelled: at which pitch it is drawn, in which tiles, and how it changes.

The area is drawn in tiles of a few metres, so that where a blade works only the tiles around it are sent anew: the
whole area at every half second would be a hundred times as much.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin.groundlog import GroundLog
from twin.signals import NS_PER_S, FloatArray, IntArray
from twin.world import survey
from viz.scene import Scene

MARGIN_M = 2.0
"""Drawn around the judged area: what the blade leaves beside it."""
PITCH_M = 0.15
"""Nodes drawn are at least so far apart ..."""
MOST_NODES = 60_000
"""... and at most so many."""
STEP_NS = NS_PER_S // 2
"""How often the ground is drawn anew."""
_TILE_M = 2.5
_MOST_TILES = 160


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tile:
    """A rectangle of the field's nodes; neighbours share the nodes between them."""

    rows: slice
    columns: slice


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelledField:
    """Nodes of the height array that are drawn of the field to be levelled."""

    rows: IntArray
    """(ny,) rows of the height array, evenly spaced."""
    columns: IntArray
    """(nx,)."""
    east_m: FloatArray
    """(nx,)."""
    north_m: FloatArray
    """(ny,)."""
    design_height_m: float

    @property
    def stride(self) -> int:
        """Nodes of the height array from one drawn node to the next."""
        return int(self.rows[1] - self.rows[0])

    @property
    def pitch_m(self) -> float:
        """Distance of neighbouring nodes."""
        return float(self.east_m[1] - self.east_m[0])

    def picked(self, heights_m: FloatArray) -> FloatArray:
        """The drawn nodes (ny, nx) of a height array."""
        return heights_m[np.ix_(self.rows, self.columns)]

    def tiles(self) -> list[Tile]:
        """Cut the field into tiles."""
        depth, width = np.ptp(self.north_m), np.ptp(self.east_m)
        side = max(_TILE_M, math.sqrt(depth * width / _MOST_TILES))
        cuts = []
        for count, length in ((len(self.rows), depth), (len(self.columns), width)):
            ends = np.unique(np.linspace(0, count - 1, max(1, round(length / side)) + 1).round().astype(int)).tolist()
            cuts.append([slice(first, last + 1) for first, last in pairwise(ends)])
        return [Tile(rows=rows, columns=columns) for rows in cuts[0] for columns in cuts[1]]

    def changes(self, log: GroundLog | None, width: int, end_ns: int) -> FieldChanges:
        """The changes of the drawn nodes, from the log of ground so many nodes wide, until the end of the run."""
        if log is None:
            empty = np.zeros(0, dtype=np.int64)
            return FieldChanges(t_ns=empty, row=empty, column=empty, height_m=np.zeros(0))
        row, column = np.divmod(log.cell, width)
        (i, over_i), (j, over_j) = (
            np.divmod(found - nodes[0], self.stride) for found, nodes in ((row, self.rows), (column, self.columns))
        )
        drawn = (over_i == 0) & (over_j == 0) & (i >= 0) & (i < len(self.rows)) & (j >= 0) & (j < len(self.columns))
        t_ns = np.minimum(np.maximum(-(-log.t_ns[drawn] // STEP_NS), 1) * STEP_NS, max(end_ns, 1))
        return FieldChanges(t_ns=t_ns, row=i[drawn], column=j[drawn], height_m=log.height_m[drawn])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FieldChanges:
    """New heights of drawn nodes, in order of time, which goes in steps, so that several changes are one."""

    t_ns: IntArray
    """(K,)."""
    row: IntArray
    """(K,) index into the field's rows."""
    column: IntArray
    """(K,)."""
    height_m: FloatArray
    """(K,)."""

    def of(self, tile: Tile, first_m: FloatArray) -> Iterator[tuple[int, FloatArray]]:
        """Heights of a tile, at 0 and whenever one of them changes; ``first_m`` (ny, nx) is the field's."""
        heights = first_m[tile.rows, tile.columns].copy()
        yield 0, heights.copy()
        own = np.flatnonzero(
            (self.row >= tile.rows.start) & (self.row < tile.rows.stop)
            & (self.column >= tile.columns.start) & (self.column < tile.columns.stop)
        )  # fmt: skip
        if not len(own):
            return
        times, begins = np.unique(self.t_ns[own], return_index=True)
        for t_ns, changed in zip(times.tolist(), np.split(own, begins[1:]), strict=True):
            rows, columns = self.row[changed] - tile.rows.start, self.column[changed] - tile.columns.start
            heights[rows, columns] = self.height_m[changed]
            yield t_ns, heights.copy()


def levelled_field(scene: Scene) -> LevelledField | None:
    """The nodes to draw of a scene with an area to be levelled; None without one, or if none of it is on the ground."""
    area = scene.levelling.area_m
    if area is None:
        return None
    west, south, east, north = area
    spans = []
    for origin, low, high, count in (
        (scene.origin_m[1], south, north, scene.heights.shape[0]),
        (scene.origin_m[0], west, east, scene.heights.shape[1]),
    ):
        first = math.floor((low - MARGIN_M - origin) / scene.cell_m)
        last = math.ceil((high + MARGIN_M - origin) / scene.cell_m)
        spans.append((min(max(first, 0), count - 1), min(max(last, 0), count - 1)))
    if any(last - first < 2 for first, last in spans):
        return None
    nodes = math.prod(last - first + 1 for first, last in spans)
    wanted = max(math.ceil(PITCH_M / scene.cell_m - 1e-9), math.ceil(math.sqrt(nodes / MOST_NODES)), 1)
    stride = min(wanted, *(last - first for first, last in spans))
    rows, columns = (np.arange(first, last + 1, stride) for first, last in spans)
    return LevelledField(
        rows=rows,
        columns=columns,
        east_m=scene.origin_m[0] + columns * scene.cell_m,
        north_m=scene.origin_m[1] + rows * scene.cell_m,
        design_height_m=scene.levelling.design_height_m,
    )


def flatness(scene: Scene, heights_m: FloatArray) -> tuple[float, float]:
    """S_d (m) and share within 30 mm of the mean, of the nodes of ground within the area to be levelled.

    NaN where there are fewer than two.
    """
    area = scene.levelling.area_m
    assert area is not None
    spread, _, share, _ = survey.flatness(survey.within(area, heights_m, scene.origin_m, scene.cell_m))
    return spread, share


def highest_ground(heights_m: FloatArray, log: GroundLog | None) -> FloatArray:
    """The highest that each node of the ground ever is, for lines that soil is not to bury.

    Raises:
        BadInputError: the log does not belong to ground of this size.
    """
    if log is None:
        return heights_m
    highest = log.heights_at(heights_m, -1)
    np.maximum.at(highest.ravel(), log.cell, log.height_m)
    return highest
