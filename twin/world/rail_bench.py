"""Machine ``rail_bench``: a plate on two vertical rails, moved by hand (paper 002, section 2.4.1, figure 3).

The paper's "parallel rail platform" has a sliding plate with GNSS receiver and AHRS on it, a handle, limit stops, and a
linear motion transducer of 400 mm below the plate. The plate was pulled and pushed at up to 400 mm/s. Height of the
rails, mass of the plate and places of the instruments are choices: the plate is 1 m above the ground in the middle of
its travel, where its slide is at zero, and weighs 8 kg with all that is on it.

The hand follows the command with a lag of 0.03 s; at the stops the plate comes to rest without a blow, which the paper
avoided.

Reference frame: the plate. The root link ``rail`` has its origin on the ground between the rails.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from twin import paths
from twin.signals import Command
from twin.world.lift import LIFT_COLUMNS, Lift, LiftSpec
from twin.world.machine import Actuation, BarConfig, MachineBaseConfig, MachineModel, MountConfig
from twin.world.urdf import Urdf

MIDDLE_M = 1.0
"""Plate above the ground in the middle of its travel."""
TRAVEL_M = 0.2
"""Either way."""

HAND = LiftSpec(
    joint="plate", lowest_m=-TRAVEL_M, highest_m=TRAVEL_M, fastest_up_m_s=1.0, fastest_down_m_s=1.0, lag_s=0.03
)


class HandDrive:
    """A hand on the plate; implements :class:`twin.world.machine.Drive`."""

    columns: tuple[str, ...] = LIFT_COLUMNS
    steering_rad = 0.0
    current_a = 0.0

    def __init__(self, urdf: Urdf) -> None:
        self._lift = Lift(HAND, urdf)
        self.servos: tuple[int, ...] = (self._lift.joint,)
        self.engaged = True

    def reset(self) -> None:
        """Hold the plate in the middle."""
        self._lift.reset()

    def step(self, command: Command, q: list[float], qd: list[float], dt_s: float, out: Actuation) -> None:  # noqa: ARG002
        """Advance by one step from joint positions, and fill ``out``."""
        self._lift.step(command.lift_m_s if self.engaged else 0.0, q, dt_s, out)

    def diagnostics(self) -> tuple[float, ...]:
        """Values of ``columns``."""
        return self._lift.diagnostics()


class RailBenchConfig(MachineBaseConfig):
    """A plate on vertical rails."""

    asset: ClassVar = paths.MACHINES / "rail_bench.urdf"
    default_bar: ClassVar = BarConfig(body="plate", xyz_m=(0.0, 0.0, 0.0))
    default_mounts: ClassVar = {
        "antenna": MountConfig(body="plate", xyz_m=(0.07, 0.16, 0.76)),
        "ahrs": MountConfig(body="plate", xyz_m=(0.06, 0.0, 0.105)),
        "plate": MountConfig(body="plate", xyz_m=(0.0, -0.08, -0.06)),
    }
    fixed: ClassVar = True
    lift: ClassVar = "plate"

    kind: Literal["rail_bench"]

    @property
    def wheelbase_m(self) -> float:
        """Nothing steers."""
        return 0.0

    @property
    def reach_m(self) -> float:
        """The base plate's corners."""
        return 0.6

    def model(self, seed: int) -> MachineModel:  # noqa: ARG002
        """Return the bench to be simulated."""
        return self._assembled(wheels=(), drive=HandDrive)
