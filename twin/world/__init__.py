"""The physical world: terrain, soil, machines and the simulation that moves them.

The configuration sections are light to import; only :mod:`twin.world.simulation` imports pybullet.
"""

from twin.world.levelling import LevellingConfig
from twin.world.light import LightConfig
from twin.world.machines import MachineConfig
from twin.world.magnetics import MagneticsConfig
from twin.world.orchard import OrchardConfig
from twin.world.signs import SignsConfig
from twin.world.soil import SoilConfig
from twin.world.terrain import TerrainConfig

__all__ = [
    "LevellingConfig",
    "LightConfig",
    "MachineConfig",
    "MagneticsConfig",
    "OrchardConfig",
    "SignsConfig",
    "SoilConfig",
    "TerrainConfig",
]
