"""Machine ``scraper``: a levelling blade behind the carrier of a riding rice transplanter (paper 002, figure 5).

The paper's platform is a "paddy field leveling machine powered by the Yanmar rice transplanter (2ZGQ-60D)", with GNSS
receiver, AHRS and laser receiver above the scraper, driven at 1 m/s. It states neither masses nor dimensions: those of
the carrier are choices (:mod:`twin.world.transplanter_carrier`), and so are the blade's here. It drives in the plough
layer on all four wheels.

A blade behind both axles enlarges what the wheels do: with wheelbase L and the edge a behind the rear axle, its height
is (1 + a/L) z_rear - (a/L) z_front. What it carves, the wheels ride on in the next pass, and where this gain times what
the lift leaves of it is above one, passes make the field rougher. The edge therefore is as near to the wheels as they
allow, a = 0.80 m.

Scraper: 2.4 m wide and 0.35 m high, on a vertical slide. It has no tilt of its own: it rolls and pitches with the
carrier. On its mast sit AHRS, laser receiver and antenna, which is 2 m above the edge. Zero of the slide has the edge
on the ground that the wheels stand on.

Lift: hydraulic cylinder behind a proportional valve, with 0.12 s of dead time, a lag of 0.08 s, 0.22 m/s upwards and
0.25 m/s downwards, and a dead band of 5 mm/s. Published laser-controlled levellers lift at 0.1 to 0.3 m/s (from
memory).

Reference frame: the middle of the blade's edge. The root link ``chassis`` has its origin in the middle of the rear
axle.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from twin import paths
from twin.config import Positive
from twin.signals import Command
from twin.world.blade_spec import BladeSpec
from twin.world.clearance import Outline
from twin.world.lift import LIFT_COLUMNS, Lift, LiftSpec
from twin.world.machine import Actuation, BarConfig, MachineBaseConfig, MachineModel, MountConfig
from twin.world.tractor import TractorDrive
from twin.world.transplanter_carrier import DRIVE, NOSE_M, REAR_RADIUS_M, SUNK_M, TRACK_M, WHEELBASE_M, wheels
from twin.world.urdf import Urdf

BLADE_X_M = -0.80
"""Edge of the blade, from the rear axle."""
BLADE_WIDTH_M = 2.4
BLADE_HEIGHT_M = 0.35
MAST_M = 2.0
"""Antenna above the edge."""
MAST_X_M = -0.09
"""Mast, from the edge."""

WHEELS = wheels(SUNK_M)

LIFT = LiftSpec(
    joint="lift",
    lowest_m=-0.20,
    highest_m=0.40,
    fastest_up_m_s=0.22,
    fastest_down_m_s=0.25,
    lag_s=0.08,
    dead_time_s=0.12,
    dead_band_m_s=0.005,
)


class ScraperDrive:
    """The carrier's drive and the scraper's lift; implements :class:`twin.world.machine.Drive`."""

    columns: tuple[str, ...] = (*TractorDrive.columns, *LIFT_COLUMNS)
    current_a = 0.0
    steering_rad = 0.0

    def __init__(self, urdf: Urdf) -> None:
        self._carrier = TractorDrive(DRIVE, urdf)
        self._lift = Lift(LIFT, urdf)
        self.servos: tuple[int, ...] = (*self._carrier.servos, self._lift.joint)

    @property
    def engaged(self) -> bool:
        """Whether the transmission is in gear."""
        return self._carrier.engaged

    @engaged.setter
    def engaged(self, engaged: bool) -> None:
        self._carrier.engaged = engaged

    def reset(self) -> None:
        """Go back to standstill, the lift at zero."""
        self._carrier.reset()
        self._lift.reset()
        self.steering_rad = 0.0

    def step(self, command: Command, q: list[float], qd: list[float], dt_s: float, out: Actuation) -> None:
        """Advance by one step from joint positions and rates, and fill ``out``."""
        self._carrier.step(command, q, qd, dt_s, out)
        self.steering_rad = self._carrier.steering_rad
        self._lift.step(command.lift_m_s, q, dt_s, out)

    def diagnostics(self) -> tuple[float, ...]:
        """Values of ``columns``."""
        return *self._carrier.diagnostics(), *self._lift.diagnostics()


class ScraperConfig(MachineBaseConfig):
    """A carrier of a rice transplanter with a levelling blade."""

    asset: ClassVar = paths.MACHINES / "scraper.urdf"
    default_bar: ClassVar = BarConfig(body="scraper", xyz_m=(0.0, 0.0, 0.0))
    default_mounts: ClassVar = {
        "antenna": MountConfig(body="scraper", xyz_m=(MAST_X_M, 0.0, MAST_M)),
        "ahrs": MountConfig(body="scraper", xyz_m=(MAST_X_M, 0.0, 1.00)),
        "laser": MountConfig(body="scraper", xyz_m=(MAST_X_M, 0.0, 1.62)),
        "chassis": MountConfig(body="chassis", xyz_m=(0.35, 0.0, 0.085)),
        "lift": MountConfig(body="chassis", xyz_m=(-0.52, 0.0, 0.10)),
    }
    lift: ClassVar = "lift"

    wheel_radius_m: ClassVar = REAR_RADIUS_M
    track_m: ClassVar = TRACK_M

    kind: Literal["scraper"]
    cutting_resistance_kpa: Annotated[float, Field(ge=0.0, le=500.0)] = 10.0
    """Force per cross-section of soil that the blade cuts."""
    soil_density_kg_m3: Annotated[float, Field(gt=0.0, le=3_000.0)] = 1_700.0
    """Of the soil that the blade carries."""
    soil_friction: Annotated[float, Field(ge=0.0, le=2.0)] = 0.5
    """Of carried soil on the ground."""
    repose_deg: Annotated[float, Field(gt=1.0, le=60.0)] = 30.0
    """Slope at which loose soil stands; with the blade's height it says how much the blade carries."""
    blade_height_m: Annotated[Positive, Field(le=1.0)] = BLADE_HEIGHT_M
    """Of the blade above its edge."""

    @property
    def wheelbase_m(self) -> float:
        """Of the carrier."""
        return WHEELBASE_M

    @property
    def outline_m(self) -> Outline:
        """Around carrier and blade, in the frame of the root link."""
        half = 0.5 * BLADE_WIDTH_M
        return (BLADE_X_M - 0.2, -half), (NOSE_M, half)

    @property
    def reach_m(self) -> float:
        """The nose is the farthest from the middle of the rear axle."""
        return NOSE_M

    @property
    def blade(self) -> BladeSpec:
        """The blade in this scenario's soil."""
        return BladeSpec(
            body="scraper",
            middle_m=(0.0, 0.0, 0.0),
            width_m=BLADE_WIDTH_M,
            height_m=self.blade_height_m,
            repose_rad=math.radians(self.repose_deg),
            resistance_pa=1e3 * self.cutting_resistance_kpa,
            density_kg_m3=self.soil_density_kg_m3,
            friction=self.soil_friction,
        )

    def model(self, seed: int) -> MachineModel:  # noqa: ARG002
        """Return the machine to be simulated."""
        return self._assembled(wheels=WHEELS, drive=ScraperDrive, blade=self.blade)
