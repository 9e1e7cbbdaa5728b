"""The carrier of a six-row riding rice transplanter, on which the machines ``scraper`` and ``transplanter`` are built.

No masses or dimensions of such a machine are in the papers that drove one (002: Yanmar 2ZGQ-60D; 003: ISEKI ZP60). All
figures here are choices in the class of six-row riding transplanters: 575 kg with driver, 705 kg with what it carries
behind, wheelbase 1.10 m, track 1.20 m, narrow paddy wheels of 0.65 m and 0.95 m diameter, all driven (40 % of weight
and force on the front axle, which swings about a pivot), front steering to 40 degrees. Wheel and soil together are 150
and 180 kN/m stiff with 4 kN s/m of damping, most of it the soil's: the machine bounces at 4.9 Hz with 0.37 of the
critical damping. In a plough layer the wheels stand 6 cm deep, so that chords of 0.42 m and 0.52 m carry them.

Transplanters drive hydrostatically: the pump's flow sets the speed of the wheels, pressure follows the load within some
hundredths of a second, and leakage gives way a little: by 7 % of 1 m/s to a load of 2 kN, until the pump's servo has
made up for it.

The root link ``chassis`` has its origin in the middle of the rear axle.
"""

from __future__ import annotations

from twin.world.machine import Wheel
from twin.world.tractor import TractorSpec

WHEELBASE_M = 1.10
TRACK_M = 1.20
MASS_KG = 705.0
"""With driver and with what it carries behind."""
NOSE_M = WHEELBASE_M + 0.75
"""From the rear axle."""
SUNK_M = 0.06
"""How deep the wheels stand in the plough layer."""

FRONT, REAR = ("front_wheel_left", "front_wheel_right"), ("rear_wheel_left", "rear_wheel_right")
FRONT_SHARE = 0.4
"""Of the weight, and of the force where the front axle is driven."""
REAR_RADIUS_M = 0.4635
"""Of the loaded rear wheels, and so the height of the rear axle."""


def wheels(sunk_m: float) -> tuple[Wheel, ...]:
    """All wheels, front ones first, as deep in the ground as is said (m)."""
    front, rear = (
        tuple(
            Wheel(
                joint=joint, radius_m=radius, width_m=width, stiffness_n_m=stiffness, damping_n_s_m=4e3, sunk_m=sunk_m
            )
            for joint in joints
        )
        for joints, radius, width, stiffness in ((FRONT, 0.325, 0.09, 150e3), (REAR, 0.475, 0.11, 180e3))
    )
    return (*front, *rear)


DRIVE = TractorSpec(
    wheelbase_m=WHEELBASE_M,
    front_track_m=TRACK_M,
    rear_wheels=REAR,
    knuckles=("steering_left", "steering_right"),
    rolling_radius_m=REAR_RADIUS_M,
    total_mass_kg=MASS_KG,
    largest_force_n=6_000.0,
    torque_lag_s=0.02,
    governor_1_s=40.0,
    integral_s=0.5,
    steering_rate_rad_s=0.6,
    brake_n_m=2_000.0,
    front_wheels=FRONT,
    front_radius_m=0.316,
    front_share=FRONT_SHARE,
    coupling_n_s_m=1_000.0,
)
