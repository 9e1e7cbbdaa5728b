"""The machines there are: the union a scenario's ``[machine]`` section chooses from by ``kind``.

A new machine is one module with a :class:`~twin.world.machine.MachineBaseConfig` of its own, joined here.
"""

from twin.world.planter_f8 import PlanterF8Config

MachineConfig = PlanterF8Config
