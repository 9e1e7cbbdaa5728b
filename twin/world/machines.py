"""The machines there are: the union a scenario's ``[machine]`` section chooses from by ``kind``.

A new machine is one module with a :class:`~twin.world.machine.MachineBaseConfig` of its own, joined here.
"""

from typing import Annotated

from pydantic import Field

from twin.world.orchard_robot import OrchardRobotConfig, OrchardRobotLargeConfig
from twin.world.planter_f8 import PlanterF8Config
from twin.world.prototype_car import PrototypeCarConfig
from twin.world.rail_bench import RailBenchConfig
from twin.world.scraper import ScraperConfig
from twin.world.transplanter import TransplanterConfig

MachineConfig = Annotated[
    PlanterF8Config
    | PrototypeCarConfig
    | OrchardRobotConfig
    | OrchardRobotLargeConfig
    | RailBenchConfig
    | ScraperConfig
    | TransplanterConfig,
    Field(discriminator="kind"),
]
