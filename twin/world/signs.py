"""Stop signs: octagonal plates on posts that stand in the field.

What a plate looks like is in :mod:`twin.stop_sign`. A sign is there to be seen by cameras: nothing runs into it, and a
lidar's beams pass it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from pydantic import Field, Strict, model_validator

from twin.config import Config, Positive
from twin.errors import BadInputError
from twin.signals import FloatArray
from twin.world.terrain import Terrain

PLATE_E, PLATE_N, PLATE_U, PLATE_HEADING, PLATE_SIZE, POST_BOTTOM = range(6)
SIGN_COLUMNS = 6

_BELOW_M = 0.2
"""Posts go on below the ground."""


class SignConfig(Config):
    """One stop sign."""

    east_m: float
    """East."""
    north_m: float
    """North."""
    heading_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    """Which way the plate faces, counter-clockwise from east: it is read by who comes from there."""
    size_m: Annotated[float, Field(gt=0.0, le=2.0)] = 0.15
    """Of the plate, across flats."""
    height_m: Positive = 0.25
    """Of the plate's middle above ground."""

    @model_validator(mode="after")
    def _above_ground(self) -> Self:
        if self.height_m < 0.5 * self.size_m:
            raise ValueError(
                f"height_m = {self.height_m:g}: half of the plate (size_m = {self.size_m:g}) would be in the ground;"
                f" give {0.5 * self.size_m:g} or more"
            )
        return self


SignsConfig = Annotated[tuple[SignConfig, ...], Strict(strict=False), Field(max_length=100)]
"""All signs of the field."""


def put_up(signs: Sequence[SignConfig], terrain: Terrain) -> FloatArray:
    """Signs (N, SIGN_COLUMNS) on the ground: middle of the plate, its heading (rad), its size, bottom of its post.

    Raises:
        BadInputError: one of them does not stand on the terrain.
    """
    rows = np.empty((len(signs), SIGN_COLUMNS))
    for index, sign in enumerate(signs):
        try:
            ground = terrain.height(sign.east_m, sign.north_m)
        except BadInputError as error:
            raise BadInputError(f"signs.{index}: {error}") from error
        heading = math.radians(sign.heading_deg)
        up = ground + sign.height_m
        rows[index] = sign.east_m, sign.north_m, up, heading, sign.size_m, ground - _BELOW_M
    return rows
