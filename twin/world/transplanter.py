"""Machine ``transplanter``: a six-row riding rice transplanter as a test bed of guidance (paper 003, figures 1 and 2).

The paper's is an ISEKI ZP60 with the antenna of a consumer receiver "mounted on a rigid frame in the front the vehicle
2.5 m above ground level", the antenna of an RTK receiver beside it, a gyroscope on the body, encoders at both rear
wheels and a transducer under the turning axis; its model is a vehicle with one steered front wheel and a driven rear
axle. It states neither masses nor dimensions: those of the carrier are choices
(:mod:`twin.world.transplanter_carrier`), here driven by its rear wheels alone. The planting unit, six rows 0.30 m
apart, weighs 130 kg with seedlings, 0.81 m behind the rear axle, so that axle loads are those of the carrier's module.
It is fixed to the carrier: nothing here needs it to move. Where the antennas stand on the frame is a choice too.

The paper drove on roads, on which wheels do not sink; in a plough layer, ``sunk_m`` = 0.06 has them stand as those of
the scraper.

Reference frame: the middle of the rear axle, on the ground. The root link ``chassis`` has its origin in the middle of
the rear axle.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from twin import paths
from twin.world.clearance import Outline
from twin.world.machine import BarConfig, MachineBaseConfig, MachineModel, MountConfig
from twin.world.tractor import TractorDrive
from twin.world.transplanter_carrier import DRIVE, NOSE_M, REAR_RADIUS_M, TRACK_M, WHEELBASE_M, wheels

ROW_M = 0.30
ROWS = 6
TAIL_M = 1.35
"""The planting arms' farthest point behind the rear axle."""
HALF_WIDTH_M = 1.02
ANTENNA_HEIGHT_M = 2.5
"""Above ground (paper 003, section 2)."""
ANTENNA_X_M = 1.40
"""Frame with the antennas, before the rear axle."""
ANTENNAS_APART_M = 0.3

REAR_DRIVE = replace(DRIVE, front_wheels=None, front_radius_m=0.0, front_share=0.0, coupling_n_s_m=0.0)
"""The carrier's, without the shaft to the front axle."""


def _antenna(y_m: float) -> MountConfig:
    return MountConfig(body="chassis", xyz_m=(ANTENNA_X_M, y_m, ANTENNA_HEIGHT_M - REAR_RADIUS_M))


class TransplanterConfig(MachineBaseConfig):
    """A riding rice transplanter."""

    asset: ClassVar = paths.MACHINES / "transplanter.urdf"
    default_bar: ClassVar = BarConfig(body="chassis", xyz_m=(0.0, 0.0, -REAR_RADIUS_M))
    default_mounts: ClassVar = {
        "gps": _antenna(0.0),
        "rtk": _antenna(-ANTENNAS_APART_M),
        "gyro": MountConfig(body="chassis", xyz_m=(0.35, 0.0, 0.085)),
        "axle": MountConfig(body="chassis", xyz_m=(0.0, 0.0, 0.0)),
        "steering": MountConfig(body="front_axle", xyz_m=(0.0, 0.0, 0.05)),
    }

    wheel_radius_m: ClassVar = REAR_RADIUS_M
    track_m: ClassVar = TRACK_M

    kind: Literal["transplanter"]
    sunk_m: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    """How deep the wheels stand in soft ground."""

    @property
    def wheelbase_m(self) -> float:
        """Of the carrier."""
        return WHEELBASE_M

    @property
    def outline_m(self) -> Outline:
        """Around carrier and planting unit, in the frame of the root link."""
        return (-TAIL_M, -HALF_WIDTH_M), (NOSE_M, HALF_WIDTH_M)

    @property
    def reach_m(self) -> float:
        """The nose is the farthest from the middle of the rear axle."""
        return NOSE_M

    def model(self, seed: int) -> MachineModel:  # noqa: ARG002
        """Return the machine to be simulated."""
        return self._assembled(wheels=wheels(self.sunk_m), drive=lambda urdf: TractorDrive(REAR_DRIVE, urdf))
