"""Machines ``orchard_robot`` and ``orchard_robot_large``: two driven wheels and a caster (paper 001, chapter 2).

The paper's vehicle is a small kit: wheels of radius 3.30 cm 10.5 cm apart, slotted discs on the two rear wheels'
gear motors, an Arduino that adjusts their speeds, a Raspberry Pi, 0.5 m/s. It states no mass, no motor and no caster;
these are choices:

- 1.3 kg, of which a ball caster 0.11 m ahead of the axle carries a fifth. The ball turns in its socket any way: it
  rolls forward and finds a twentieth of the soil's grip when dragged sideways (friction about 0.05).
- Yellow 1:48 gear motors on two lithium cells, as such kits have them: 250 turns a minute without load, 0.08 N m at
  standstill with 1.2 A, gears whose friction is 0.006 N m; the rotor, seen through the gears, gives most of the
  wheel's 1.5e-4 kg m2.
- Solid rubber tyres: 10 kN/m and 9 N s/m. They are pressed in by half a millimetre; 3.30 cm is what they roll on then.

The large variant is the same design for real orchard floors: wheels of 0.15 m 0.6 m apart, 45 kg, to 1.5 m/s. Nothing
about it is published. Everything that differs is in :class:`RobotSize`; the drawings come from the same figures.

Frame: the root link ``chassis`` has its origin in the middle of the driven axle, which is also the reference frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from twin import paths
from twin.config import Vector3
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.randomness import world_generator
from twin.world.clearance import Outline
from twin.world.differential import DifferentialDrive, DifferentialSpec
from twin.world.machine import BarConfig, MachineBaseConfig, MachineModel, MountConfig, Wheel

DRIVEN = ("wheel_left", "wheel_right")
CASTER = "wheel_caster"
CASTER_SHARE = 0.2
"""Share of the weight that stands on the ball."""
_BALL_GRIP = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSize:
    """All that differs from one robot to the other."""

    wheel_radius_m: float
    """Rolling radius, pressed in by the robot's weight."""
    wheel_width_m: float
    track_m: float
    caster_x_m: float
    """Of the ball, ahead of the axle."""
    caster_radius_m: float
    mass_kg: float
    """Of the whole."""
    wheel_mass_kg: float
    """Of each driven wheel."""
    caster_mass_kg: float
    wheel_inertia_kg_m2: float
    """Of a driven wheel about its axle, with its motor's rotor."""
    chassis_size_m: Vector3
    """Length, width, height of the box that the chassis' inertia is a box's of."""
    centre_of_mass_z_m: float
    """Of the chassis, above the axle."""
    tyre_stiffness_n_m: float
    tyre_damping_n_s_m: float
    stall_torque_n_m: float
    free_rate_rad_s: float
    stall_current_a: float
    gear_friction_n_m: float
    dead_band_rad_s: float
    lag_s: float
    brake_n_m: float
    mast_m: float
    """Height of the magnetometer above the axle: on a mast, away from the motors."""
    deck_z_m: float
    """Height of the upper deck above the axle."""

    @property
    def deck_x_m(self) -> float:
        """Middle of the decks ahead of the axle."""
        return 0.35 * self.chassis_size_m[0] - 0.25 * self.caster_x_m

    @property
    def chassis_mass_kg(self) -> float:
        """What is neither wheel nor ball."""
        return self.mass_kg - 2.0 * self.wheel_mass_kg - self.caster_mass_kg

    @property
    def chassis_x_m(self) -> float:
        """Centre of mass of the chassis ahead of the axle, for the ball's share of the weight."""
        return (CASTER_SHARE * self.mass_kg - self.caster_mass_kg) * self.caster_x_m / self.chassis_mass_kg

    @property
    def outline_m(self) -> Outline:
        """Around decks, wheels and ball."""
        half_deck = 0.5 * self.chassis_size_m[0]
        back = min(self.deck_x_m - half_deck, -self.wheel_radius_m)
        front = max(self.deck_x_m + half_deck, self.caster_x_m + self.caster_radius_m)
        side = max(0.5 * self.chassis_size_m[1], 0.5 * (self.track_m + self.wheel_width_m))
        return (back, -side), (front, side)

    @property
    def wheels(self) -> tuple[Wheel, ...]:
        """Driven wheels and ball."""
        weight_n = self.mass_kg * STANDARD_GRAVITY_M_S2
        pressed_m = 0.5 * (1.0 - CASTER_SHARE) * weight_n / self.tyre_stiffness_n_m
        ball_pressed_m = CASTER_SHARE * weight_n / self.tyre_stiffness_n_m
        driven = [
            Wheel(
                joint=joint,
                radius_m=self.wheel_radius_m + pressed_m,
                width_m=self.wheel_width_m,
                stiffness_n_m=self.tyre_stiffness_n_m,
                damping_n_s_m=self.tyre_damping_n_s_m,
            )
            for joint in DRIVEN
        ]
        ball = Wheel(
            joint=CASTER,
            radius_m=self.caster_radius_m + ball_pressed_m,
            width_m=self.caster_radius_m,
            stiffness_n_m=self.tyre_stiffness_n_m,
            damping_n_s_m=self.tyre_damping_n_s_m,
            grip=_BALL_GRIP,
        )
        return (*driven, ball)

    @property
    def drive(self) -> DifferentialSpec:
        """Motors and their speed loops."""
        return DifferentialSpec(
            wheels=DRIVEN,
            track_m=self.track_m,
            radius_m=self.wheel_radius_m,
            inertia_kg_m2=self.wheel_inertia_kg_m2 + 0.5 * self.mass_kg * self.wheel_radius_m**2,
            stall_torque_n_m=self.stall_torque_n_m,
            free_rate_rad_s=self.free_rate_rad_s,
            stall_current_a=self.stall_current_a,
            gear_friction_n_m=self.gear_friction_n_m,
            dead_band_rad_s=self.dead_band_rad_s,
            lag_s=self.lag_s,
            brake_n_m=self.brake_n_m,
        )

    @property
    def mounts(self) -> dict[str, MountConfig]:
        """Where the sensors sit: x forward of the axle, z above it."""
        front, deck = 0.5 * self.caster_x_m, self.deck_z_m
        places: dict[str, Vector3] = {
            "encoders": (0.0, 0.0, 0.0),
            "imu": (0.25 * self.caster_x_m, 0.0, deck + 0.008),
            "magnetometer": (-0.25 * self.caster_x_m, 0.0, self.mast_m),
            "lidar": (front, 0.0, 2.3 * deck),
            "camera": (self.deck_x_m + 0.47 * self.chassis_size_m[0], 0.0, 1.8 * deck),
        }
        return {name: MountConfig(body="chassis", xyz_m=place) for name, place in places.items()}


SMALL = RobotSize(
    wheel_radius_m=0.0330,
    wheel_width_m=0.026,
    track_m=0.105,
    caster_x_m=0.11,
    caster_radius_m=0.020,
    mass_kg=1.3,
    wheel_mass_kg=0.05,
    caster_mass_kg=0.05,
    wheel_inertia_kg_m2=1.5e-4,
    chassis_size_m=(0.20, 0.12, 0.09),
    centre_of_mass_z_m=0.015,
    tyre_stiffness_n_m=10e3,
    tyre_damping_n_s_m=9.0,
    stall_torque_n_m=0.08,
    free_rate_rad_s=2.0 * math.pi * 250.0 / 60.0,
    stall_current_a=1.2,
    gear_friction_n_m=0.006,
    dead_band_rad_s=0.15,
    lag_s=0.1,
    brake_n_m=0.05,
    mast_m=0.125,
    deck_z_m=0.042,
)

LARGE = RobotSize(
    wheel_radius_m=0.15,
    wheel_width_m=0.08,
    track_m=0.60,
    caster_x_m=0.55,
    caster_radius_m=0.08,
    mass_kg=45.0,
    wheel_mass_kg=2.0,
    caster_mass_kg=1.5,
    wheel_inertia_kg_m2=0.08,
    chassis_size_m=(0.80, 0.50, 0.30),
    centre_of_mass_z_m=0.05,
    tyre_stiffness_n_m=80e3,
    tyre_damping_n_s_m=300.0,
    stall_torque_n_m=30.0,
    free_rate_rad_s=15.0,
    stall_current_a=30.0,
    gear_friction_n_m=0.8,
    dead_band_rad_s=0.05,
    lag_s=0.15,
    brake_n_m=15.0,
    mast_m=0.50,
    deck_z_m=0.19,
)


class _RobotConfig(MachineBaseConfig):
    size: ClassVar[RobotSize]
    turns_on_the_spot: ClassVar = True

    @property
    def wheelbase_m(self) -> float:
        """Nothing steers."""
        return 0.0

    wheel_tolerance: Annotated[float, Field(ge=0.0, le=0.05)] = 0.0
    """Standard deviation of a driven wheel's radius about its nominal one, as a share; drawn with the world's seed.
    Nobody knows: neither the speed loops, which therefore drive an arc, nor odometry."""

    @property
    def outline_m(self) -> Outline:
        """Rectangle around the machine that may not touch a tree, in the frame of the root link."""
        return self.size.outline_m

    def model(self, seed: int) -> MachineModel:
        """Return the machine to be simulated."""
        size = self.size
        drawn = world_generator(seed, "machine.wheels").standard_normal(len(size.wheels)).tolist()
        spread_m = self.wheel_tolerance * size.wheel_radius_m
        return self._assembled(
            wheels=tuple(
                replace(wheel, radius_m=wheel.radius_m + spread_m * normal) if wheel.joint in DRIVEN else wheel
                for wheel, normal in zip(size.wheels, drawn, strict=True)
            ),
            drive=lambda urdf: DifferentialDrive(size.drive, urdf),
        )


class OrchardRobotConfig(_RobotConfig):
    """The paper's small robot: wheels of 3.30 cm, 10.5 cm apart."""

    size: ClassVar = SMALL
    asset: ClassVar = paths.MACHINES / "orchard_robot.urdf"
    default_bar: ClassVar = BarConfig(body="chassis", xyz_m=(0.0, 0.0, 0.0))
    default_mounts: ClassVar = SMALL.mounts

    wheel_radius_m: ClassVar = SMALL.wheel_radius_m
    track_m: ClassVar = SMALL.track_m

    kind: Literal["orchard_robot"]


class OrchardRobotLargeConfig(_RobotConfig):
    """A larger robot of the same design: wheels of 0.15 m, 0.6 m apart."""

    size: ClassVar = LARGE
    asset: ClassVar = paths.MACHINES / "orchard_robot_large.urdf"
    default_bar: ClassVar = BarConfig(body="chassis", xyz_m=(0.0, 0.0, 0.0))
    default_mounts: ClassVar = LARGE.mounts

    wheel_radius_m: ClassVar = LARGE.wheel_radius_m
    track_m: ClassVar = LARGE.track_m

    kind: Literal["orchard_robot_large"]
