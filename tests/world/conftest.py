"""Worlds to experiment with."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from twin.world.machine import MachineBaseConfig
from twin.world.orchard_robot import OrchardRobotConfig, OrchardRobotLargeConfig
from twin.world.planter_f8 import PlanterF8Config
from twin.world.prototype_car import PrototypeCarConfig
from twin.world.rail_bench import RailBenchConfig
from twin.world.scraper import ScraperConfig
from twin.world.simulation import World, build_world
from twin.world.soil import SoilConfig
from twin.world.terrain import FlatTerrain, SlopeTerrain
from twin.world.transplanter import TransplanterConfig

WorldMaker = Callable[..., World]

MACHINES: dict[str, type[MachineBaseConfig]] = {
    "planter_f8": PlanterF8Config,
    "prototype_car": PrototypeCarConfig,
    "orchard_robot": OrchardRobotConfig,
    "orchard_robot_large": OrchardRobotLargeConfig,
    "rail_bench": RailBenchConfig,
    "scraper": ScraperConfig,
    "transplanter": TransplanterConfig,
}
"""Machines by kind."""

every_machine = pytest.mark.parametrize("kind", ["planter_f8", "prototype_car"])
"""For tests of what holds for every machine that steers, has rows and rolls freely in neutral."""


def no_tools(kind: str) -> dict[str, Any]:
    """Keys of a machine whose tools, if it has any, are out of the soil."""
    return {"draught_n": 0.0} if kind == "planter_f8" else {}


@pytest.fixture
def make_world() -> Iterator[WorldMaker]:
    """Build worlds that are closed afterwards: terrain, soil and machine keys as keyword arguments."""
    worlds: list[World] = []

    def make(terrain: Any = None, *, kind: str = "planter_f8", soil: str = "tilled", soil_keys: Any = None,
             dt_ns: int = 2_000_000, seed: int = 1, **machine: Any) -> World:  # fmt: skip
        world = build_world(
            terrain or FlatTerrain(kind="flat", cell_m=1.0, size_m=(600.0, 600.0)),
            SoilConfig(preset=soil, **(soil_keys or {})),
            MACHINES[kind](kind=kind, **machine),
            seed=seed,
            dt_ns=dt_ns,
        )
        worlds.append(world)
        return world

    yield make
    for world in worlds:
        world.close()


def slope(percent: float, direction_deg: float = 0.0) -> SlopeTerrain:
    return SlopeTerrain(
        kind="slope", slope_percent=percent, slope_direction_deg=direction_deg, cell_m=1.0, size_m=(600.0, 600.0)
    )


def column(world: World, name: str) -> float:
    return float(world.truth()[world.truth_columns.index(name)])


def record(world: World, ticks: int, every: int, names: tuple[str, ...]) -> np.ndarray:
    """Advance and sample truth columns, shape (samples, names)."""
    indices = [world.truth_columns.index(name) for name in names]
    rows = []
    for _ in range(ticks // every):
        world.advance(world.tick + every)
        rows.append(world.truth()[indices])
    return np.array(rows)
