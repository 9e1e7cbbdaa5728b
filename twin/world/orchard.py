"""Trees: trunks that stand in lanes, or one by one.

A trunk is an upright cylinder. A lane has a row of trunks on either side of its axis, ``width_m`` apart; in a row they
stand ``spacing_m`` apart from its beginning to its end. How crooked the rows are, which trees are missing and how thick
each is follows from the seed of the world; each lane draws for itself.
"""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from pydantic import Field, Strict, model_validator

from twin.config import Config, NonNegative, Positive, Probability
from twin.errors import BadInputError
from twin.randomness import world_generator
from twin.signals import FloatArray
from twin.world.terrain import Terrain

EAST, NORTH, RADIUS, BOTTOM, TOP = range(5)
TRUNK_COLUMNS = 5

_SMALLEST_SHARE = 0.3
"""No trunk is thinner than this share of the lane's mean radius."""
_MOST_TREES = 10_000
_BELOW_M = 0.2
"""Trunks go on below the ground, so that none hovers over a hollow."""


class TreeConfig(Config):
    """One tree."""

    east_m: float
    """East."""
    north_m: float
    """North."""
    radius_m: Positive = 0.05
    """Of the trunk."""
    height_m: Positive = 1.5
    """Of the trunk above ground."""


class LaneConfig(Config):
    """Two rows of trees with a lane between them."""

    east_m: float = 0.0
    """Where the lane's axis begins, between the first trees."""
    north_m: float = 0.0
    """Where the lane's axis begins, between the first trees."""
    heading_deg: float = 0.0
    """Of the axis, counter-clockwise from east."""
    length_m: Positive
    """From the first trees to the last."""
    width_m: Positive
    """From row to row."""
    spacing_m: Positive
    """From tree to tree in a row."""
    radius_m: Positive = 0.05
    """Mean radius of the trunks."""
    radius_spread_m: NonNegative = 0.0
    """Standard deviation of the radius."""
    height_m: Positive = 1.5
    """Of the trunks above ground."""
    crooked_m: NonNegative = 0.0
    """Standard deviation of a tree's place, along and across its row."""
    missing_probability: Probability = 0.0
    """Of a tree not to be there."""


class OrchardConfig(Config):
    """All trees of the field."""

    trees: Annotated[tuple[TreeConfig, ...], Strict(strict=False), Field(max_length=10_000)] = ()
    """Trees one by one."""
    lanes: Annotated[tuple[LaneConfig, ...], Strict(strict=False), Field(max_length=100)] = ()
    """Lanes."""

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        trees = len(self.trees) + sum(2 * (1 + math.floor(lane.length_m / lane.spacing_m)) for lane in self.lanes)
        if trees > _MOST_TREES:
            raise ValueError(f"orchard: {trees} trees; at most {_MOST_TREES} are allowed")
        return self

    def trunks(self, seed: int) -> FloatArray:
        """Trunks (N, TRUNK_COLUMNS) of this world with BOTTOM 0 and TOP their height: not yet on any ground."""
        single = [(tree.east_m, tree.north_m, tree.radius_m, 0.0, tree.height_m) for tree in self.trees]
        rows = [_lane(lane, seed, index) for index, lane in enumerate(self.lanes)]
        return np.concatenate([np.array(single).reshape(-1, TRUNK_COLUMNS), *rows])


def _lane(lane: LaneConfig, seed: int, index: int) -> FloatArray:
    """Trunks of one lane; a missing tree takes nothing from the others' numbers."""
    generator = world_generator(seed, f"orchard.lanes.{index}")
    count = 1 + math.floor(lane.length_m / lane.spacing_m + 1e-9)
    along = np.tile(lane.spacing_m * np.arange(count), 2)
    across = np.repeat([0.5 * lane.width_m, -0.5 * lane.width_m], count)
    normals = generator.standard_normal((2 * count, 3))
    there = generator.random(2 * count) >= lane.missing_probability
    along = along + lane.crooked_m * normals[:, 0]
    across = across + lane.crooked_m * normals[:, 1]
    radius = np.maximum(lane.radius_m + lane.radius_spread_m * normals[:, 2], _SMALLEST_SHARE * lane.radius_m)
    angle = math.radians(lane.heading_deg)
    east = lane.east_m + math.cos(angle) * along - math.sin(angle) * across
    north = lane.north_m + math.sin(angle) * along + math.cos(angle) * across
    trunks = np.column_stack([east, north, radius, np.zeros(2 * count), np.full(2 * count, lane.height_m)])
    chosen: FloatArray = trunks[there]
    return chosen


def planted(trunks: FloatArray, terrain: Terrain) -> FloatArray:
    """The same trunks on the ground: heights of their bottoms and tops.

    Raises:
        BadInputError: one of them does not stand on the terrain.
    """
    standing = trunks.copy()
    for trunk in standing:
        try:
            ground = terrain.height(trunk[EAST], trunk[NORTH])
        except BadInputError as error:
            raise BadInputError(f"orchard: a tree at {error}") from error
        trunk[BOTTOM], trunk[TOP] = ground - _BELOW_M, ground + trunk[TOP]
    return standing
