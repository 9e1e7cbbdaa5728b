"""Machine ``planter_f8``: a tractor and a rigid eight-row precision planter behind it (paper 000, section 3.3).

Tractor: of the class of a 110 kW row-crop tractor; 6.7 t, wheelbase 2.79 m, 40 % of its weight on the front axle,
which swings about its centre pivot. Tyre radii follow from the designations (rim + 2 x aspect ratio x width):
520/70 R38 gives 0.847 m, 420/70 R28 0.650 m, 400/60-15.5 0.437 m. Mass, wheelbase, track and inertias are choices for
that class, not one maker's data. The rear wheels carry the driveline's inertia as seen at the axle.

Planter: eight rows 0.75 m apart on a toolbar that rests on four wheels, as the Vaderstad Tempo F8 does (trade press:
materielagricole.info, "Tempo F8", four wheels, hoppers of 70 l per row and a 1.3 to 1.6 m3 fertiliser hopper). Its
3.5 t, the drawbar length and the wheel positions are choices. The wheels are rigid on the frame (the real ones are
levelled hydraulically), and the row units' gauge wheels carry no weight here.

The hitch is free in yaw, pitch and roll: a drawbar eye on a ball or pin lets the implement roll against the tractor,
and locking it would make the two machines, each standing on wheels of its own, twist one another on uneven ground.

Vertical tyre stiffness 250 to 350 kN/m and damping of 2 to 4 kN s/m lie in the range measured for rolling tractor
tyres (Lines and Murphy 1991, from memory).
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from twin import paths
from twin.world.machine import BarConfig, Draught, MachineBaseConfig, MachineModel, MountConfig, Wheel
from twin.world.tractor import TractorDrive, TractorSpec

ROWS = 8
ROW_SPACING_M = 0.75
ROWS_Y_M = tuple(ROW_SPACING_M * ((ROWS - 1) / 2.0 - row) for row in range(ROWS))
BAR_X_M = -3.55
"""The row-unit line, from the hitch."""
BAR_Z_M = 0.25
"""Toolbar height, from the hitch (0.75 m above ground)."""
HITCH_HEIGHT_M = 0.5
AXLE_X_M = -3.0
"""The planter's wheels, from the hitch."""
HITCH_BEHIND_AXLE_M = 1.05
"""The hitch, behind the tractor's rear axle."""

WHEELBASE_M = 2.79
FRONT_TRACK_M = REAR_TRACK_M = 1.84
ROLLING_RADIUS_M = 0.78
"""Of the rear wheels."""

DRAUGHT_PER_ROW_N = 500.0
"""ASABE D497: row-crop planter, mounted, seeding only, 500 N per row (+-25 %). The standard's 900 N for a drawn one
includes its rolling resistance, which the tyre-soil model adds itself."""

_REAR, _FRONT, _PLANTER = "rear_wheel", "front_wheel", "planter_wheel"

WHEELS = (
    *(
        Wheel(joint=f"{_FRONT}_{side}", radius_m=0.650, width_m=0.42, stiffness_n_m=300e3, damping_n_s_m=3e3)
        for side in ("left", "right")
    ),
    *(
        Wheel(joint=f"{_REAR}_{side}", radius_m=0.847, width_m=0.52, stiffness_n_m=350e3, damping_n_s_m=4e3)
        for side in ("left", "right")
    ),
    *(
        Wheel(joint=f"{_PLANTER}_{number}", radius_m=0.437, width_m=0.40, stiffness_n_m=250e3, damping_n_s_m=2e3)
        for number in (1, 2, 3, 4)
    ),
)

_SPEC = TractorSpec(
    wheelbase_m=WHEELBASE_M,
    front_track_m=FRONT_TRACK_M,
    rear_wheels=(f"{_REAR}_left", f"{_REAR}_right"),
    knuckles=("steering_left", "steering_right"),
    rolling_radius_m=ROLLING_RADIUS_M,
    total_mass_kg=10_200.0,
    largest_force_n=45_000.0,
)


class PlanterF8Config(MachineBaseConfig):
    """A tractor with a rigid eight-row precision planter."""

    asset: ClassVar = paths.MACHINES / "planter_f8.urdf"
    default_bar: ClassVar = BarConfig(body="planter", xyz_m=(BAR_X_M, 0.0, BAR_Z_M), rows_y_m=ROWS_Y_M)
    default_mounts: ClassVar = {
        **{
            f"row_{row}": MountConfig(body="planter", xyz_m=(BAR_X_M, y, BAR_Z_M))
            for row, y in enumerate(ROWS_Y_M, start=1)
        },
        "radar": MountConfig(body="planter", xyz_m=(-3.0, 0.0, 0.12)),
        "antenna": MountConfig(body="planter", xyz_m=(-2.75, 0.0, 2.05)),
        "tractor_antenna": MountConfig(body="tractor", xyz_m=(0.35, 0.0, 2.10)),
    }

    wheel_radius_m: ClassVar = ROLLING_RADIUS_M
    track_m: ClassVar = REAR_TRACK_M

    kind: Literal["planter_f8"]
    draught_n: Annotated[float, Field(ge=0.0, le=200_000.0)] = ROWS * DRAUGHT_PER_ROW_N
    """Pull that all row units together need, while moving."""

    @property
    def wheelbase_m(self) -> float:
        """Of the tractor."""
        return WHEELBASE_M

    def model(self, seed: int) -> MachineModel:  # noqa: ARG002
        """Return the machine to be simulated."""
        return self._assembled(
            wheels=WHEELS,
            drive=lambda urdf: TractorDrive(_SPEC, urdf),
            draughts=(Draught(body="planter", x_m=BAR_X_M, z_m=-HITCH_HEIGHT_M, y_m=ROWS_Y_M, force_n=self.draught_n),),
        )
