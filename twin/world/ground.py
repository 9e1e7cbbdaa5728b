"""The ground that a scenario needs: terrain around everything that stands, drives and lies on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.errors import BadInputError
from twin.signals import FloatArray
from twin.world.machine import MachineBaseConfig
from twin.world.orchard import TRUNK_COLUMNS, OrchardConfig
from twin.world.signs import SignConfig
from twin.world.terrain import MARGIN_M, AnyTerrain, Terrain, build_terrain, wanted_extent


def build_ground(
    terrain: AnyTerrain,
    machine: MachineBaseConfig,
    *,
    seed: int,
    path: FloatArray | None = None,
    orchard: OrchardConfig | None = None,
    signs: Sequence[SignConfig] = (),
) -> Terrain:
    """Make the ground before anything has moved on it.

    ``path`` (N, 2) is what the driver plans to follow (east and north of the middle of the rear axle): the terrain is
    made to cover it with the machine's reach around (and all trees and signs), or, if its size is configured, has to.

    Raises:
        BadInputError: the terrain cannot be made, or the path leaves it.
    """
    start = machine.vehicle_start[:2]
    points = np.array([start]) if path is None else np.vstack([path[:, :2], start])
    trunks = orchard.trunks(seed) if orchard is not None else np.zeros((0, TRUNK_COLUMNS))
    posts = np.array([(sign.east_m, sign.north_m) for sign in signs]).reshape(-1, 2)
    covered = wanted_extent(np.vstack([points, trunks[:, :2], posts]), machine.reach_m)
    ground = build_terrain(terrain, seed=seed, extent=covered)
    _require_room(ground, points, machine.reach_m)
    return ground


def _require_room(ground: Terrain, points: FloatArray, reach_m: float) -> None:
    wanted = wanted_extent(points, reach_m)
    west, south, east, north = ground.extent
    if (
        wanted[0] + MARGIN_M < west
        or wanted[1] + MARGIN_M < south
        or (wanted[2] - MARGIN_M > east or wanted[3] - MARGIN_M > north)
    ):
        raise BadInputError(
            f"driver: the planned path leaves the terrain: with the machine around it, it needs east {wanted[0]:.0f} to"
            f" {wanted[2]:.0f} m and north {wanted[1]:.0f} to {wanted[3]:.0f} m; the terrain is {west:.0f} to"
            f" {east:.0f} m by {south:.0f} to {north:.0f} m"
        )
