"""Machine ``prototype_car``: a passenger car with four IMUs on a bar on its roof (paper 000, sections 3.2 and 4.2).

The paper mounted the units of the row units "with pre-defined distances between each one of them" on a bar, put it on
top of a car and drove over a parking lot; it states neither the car nor the distances. Everything here is a choice.

Car: of the class of a rear-driven compact car; 1.5 t, wheelbase 2.65 m, 52 % of its weight on the front axle, centre of
mass 0.55 m above ground. Tyres 205/55 R16: rim + 2 x aspect ratio x width gives a radius of 0.316 m. The yaw inertia of
the whole is near the 2200 kg m2 usual at this mass. The rear wheels carry the driveline's inertia as seen at the axle
in a low gear. Tyre stiffness 190 kN/m is that of the CommonRoad vehicle models' BMW 320i; tyre damping is small.

Suspension: each wheel swings about a hinge across the car, 1.5 m towards the other axle and 0.12 m above the ground:
the instant centre of a real suspension seen from the side. The push of the rear wheels lifts the body there by
0.12 / 1.5 of it, two fifths of what would keep the car from squatting (0.55 / 2.65): a usual share. Springs of
32 kN/m at the wheel (1.5 Hz of body bounce) are somewhat stiff because there are no anti-roll bars; the body leans by
8 degrees per g, as a soft car's does. The dampers have 0.3 of the critical damping. There are no stops: a parking lot
does not need them. The driver's brake, and the governor's, act on the rear wheels alone, as the drive has it.

Drive: the tractor's (``twin.world.tractor``), with quicker steering and speed changes than a tractor's.

Bar: at the longitudinal position of the rear axle, where a car at low speed does not slip sideways, which is what the
coordinated-turn filter takes for granted of its centre C. Rows 1 to 4 are the four units from left to right, 0.8 m
apart. The RTK antenna of the paper "was placed at WSX4" (section 4.2.4): mount ``rtk_antenna``. The radar stands at
the rear bumper, because it has to see the ground.

The car also carries the receivers of paper 004, whose antennas were "at the top of the vehicle", 0.50 m apart: mounts
``antenna`` and ``antenna_reference``.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from twin import paths
from twin.world.machine import BarConfig, MachineBaseConfig, MachineModel, MountConfig, Spring, Wheel
from twin.world.tractor import TractorDrive, TractorSpec

WHEELBASE_M = 2.65
TRACK_M = 1.52
MASS_KG = 1500.0
AXLE_HEIGHT_M = 0.297
"""Of the hubs above level ground: the tyre's radius less 0.019 m of static deflection."""

ROWS_Y_M = (1.2, 0.4, -0.4, -1.2)
BAR_Z_M = 1.30
"""The units, above the rear axle (1.60 m above ground)."""

ANTENNAS_APART_M = 0.5
"""Between the antenna and the one of the reference (paper 004)."""

WHEEL_RATE_N_M = 32e3
"""Of the suspension, vertical at the wheel."""
WHEEL_DAMPING_N_S_M = 2.0e3
"""Of the damper, vertical at the wheel: 2 x 0.3 sqrt(32 kN/m x 335 kg), the quarter of the body."""
ARM_M = 1.5
"""From a wheel's centre to its hinge, along the car."""

_CORNERS = ("front_left", "front_right", "rear_left", "rear_right")

WHEELS = tuple(
    Wheel(joint=f"wheel_{corner}", radius_m=0.316, width_m=0.205, stiffness_n_m=190e3, damping_n_s_m=500.0)
    for corner in _CORNERS
)
SPRINGS = tuple(
    Spring(
        joint=f"suspension_{corner}",
        stiffness_n_m_rad=WHEEL_RATE_N_M * ARM_M**2,
        damping_n_m_s_rad=WHEEL_DAMPING_N_S_M * ARM_M**2,
    )
    for corner in _CORNERS
)

_SPEC = TractorSpec(
    wheelbase_m=WHEELBASE_M,
    front_track_m=TRACK_M,
    rear_wheels=("wheel_rear_left", "wheel_rear_right"),
    knuckles=("steering_left", "steering_right"),
    rolling_radius_m=AXLE_HEIGHT_M,
    total_mass_kg=MASS_KG,
    largest_force_n=6_000.0,
    acceleration_m_s2=3.0,
    steering_rate_rad_s=0.6,
    largest_steering_rad=math.radians(35.0),
    brake_n_m=1_200.0,
)


class PrototypeCarConfig(MachineBaseConfig):
    """A passenger car with a bar of four units on its roof."""

    asset: ClassVar = paths.MACHINES / "prototype_car.urdf"
    default_bar: ClassVar = BarConfig(body="car", xyz_m=(0.0, 0.0, BAR_Z_M), rows_y_m=ROWS_Y_M)
    default_mounts: ClassVar = {
        **{f"row_{row}": MountConfig(body="car", xyz_m=(0.0, y, BAR_Z_M)) for row, y in enumerate(ROWS_Y_M, start=1)},
        "radar": MountConfig(body="car", xyz_m=(-0.72, 0.0, 0.15)),
        "accosat": MountConfig(body="car", xyz_m=(0.0, 0.1, BAR_Z_M)),
        "antenna": MountConfig(body="car", xyz_m=(0.0, -0.1, BAR_Z_M + 0.08)),
        "antenna_reference": MountConfig(body="car", xyz_m=(0.0, -0.1 + ANTENNAS_APART_M, BAR_Z_M + 0.08)),
        "rtk_antenna": MountConfig(body="car", xyz_m=(0.0, ROWS_Y_M[-1], BAR_Z_M + 0.10)),
    }

    wheel_radius_m: ClassVar = AXLE_HEIGHT_M
    track_m: ClassVar = TRACK_M

    kind: Literal["prototype_car"]

    @property
    def wheelbase_m(self) -> float:
        """Of the car."""
        return WHEELBASE_M

    def model(self, seed: int) -> MachineModel:  # noqa: ARG002
        """Return the machine to be simulated."""
        return self._assembled(wheels=WHEELS, drive=lambda urdf: TractorDrive(_SPEC, urdf), springs=SPRINGS)
