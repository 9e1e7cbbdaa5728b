"""What a machine is to the simulation, and what a scenario can say about one.

A machine is a URDF tree with wheels on some joints, named mounts for sensors, a reference frame whose motion is "the"
motion of the machine, and a drive that turns a :class:`~twin.signals.Command` into joint torques. Each machine module
fills in a :class:`MachineModel` and a configuration derived from :class:`MachineBaseConfig`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol, Self

import numpy as np
from pydantic import Field, Strict, field_validator, model_validator

from twin.config import Config, Vector3
from twin.geometry import rpy_from_rotation, turned
from twin.signals import Command, FloatArray, Mount
from twin.world.blade_spec import BladeSpec
from twin.world.clearance import Outline
from twin.world.urdf import Urdf, read_urdf

STEERING = "steering_rad"
DRIVE_TORQUE = "drive_torque_n_m"
KNEE_M_S = 0.05
"""Speed at which draught has come to 0.7 of its force."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheel:
    """A tyre on a joint. The joint's axis points to the machine's left."""

    joint: str
    radius_m: float
    """Unloaded."""
    width_m: float
    stiffness_n_m: float
    """Vertical."""
    damping_n_s_m: float
    """Vertical."""
    grip: float = 1.0
    """Share of the soil's slip stiffness and friction that it finds: a ball in a socket, which may turn any way, finds
    little."""
    sunk_m: float = 0.0
    """How deep it stands in soft ground, besides its own deflection: the ground under a longer chord carries it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spring:
    """A spring with a damper that carries a hinge's static load at angle zero: a wheel's suspension."""

    joint: str
    stiffness_n_m_rad: float
    """Moment per angle."""
    damping_n_m_s_rad: float
    """Moment per rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draught:
    """Soil-engaging tools: a force against the forward motion of points on a line along a body's y axis."""

    body: str
    x_m: float
    z_m: float
    y_m: tuple[float, ...]
    force_n: float
    """Of all tools together, at speeds well above ``knee_m_s``."""
    knee_m_s: float = KNEE_M_S
    """The force is force v / sqrt(v^2 + knee^2): smooth through standstill, where soil does not push."""


@dataclass(slots=True)
class Actuation:
    """What a drive does to the joints during one step, indexed by joint in the URDF's tree order."""

    torque_n_m: FloatArray
    """(J,) torques on hinges, forces on slides."""
    brake_n_m: FloatArray
    """(J,) dry moments of the brakes; the simulation adds rolling resistance."""
    servo_rad_s: list[float]
    """Rates (rad/s, m/s) at which stiff servos drive the joints they hold; zero elsewhere."""


class Drive(Protocol):
    """Engine, transmission, steering and brakes, with their lags and limits."""

    columns: tuple[str, ...]
    """Diagnostics it adds to the truth."""
    servos: tuple[int, ...]
    """Joints held by a stiff servo."""
    engaged: bool
    """False puts it in neutral: no drive torque; brakes still work."""
    steering_rad: float
    """Steering angle of the equivalent single front wheel now; zero where nothing steers."""
    current_a: float
    """Electric current that all motors draw now; zero where there are none."""

    def reset(self) -> None:
        """Go back to standstill."""

    def step(self, command: Command, q: list[float], qd: list[float], dt_s: float, out: Actuation) -> None:
        """Advance by one step from joint angles and rates, and fill ``out``."""

    def diagnostics(self) -> tuple[float, ...]:
        """Values of ``columns``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineModel:
    """A machine, ready to be simulated."""

    urdf: Path
    wheels: tuple[Wheel, ...]
    mounts: dict[str, Mount]
    reference: Mount
    rows_y_m: tuple[float, ...]
    start: tuple[float, float, float]
    """East m, north m, heading rad of the root link's frame."""
    drive: Callable[[Urdf], Drive]
    outline_m: Outline
    """What may not touch a tree."""
    springs: tuple[Spring, ...] = ()
    draughts: tuple[Draught, ...] = ()
    servo_limit: float = 50_000.0
    """Moment (N m) or force (N) with which each servo can hold its joint."""
    fixed: bool = False
    """As :attr:`MachineBaseConfig.fixed`."""
    lift: str | None = None
    """As :attr:`MachineBaseConfig.lift`."""
    blade: BladeSpec | None = None
    """With which it moves soil."""


class MountConfig(Config):
    """Where something is fixed on the machine."""

    body: str
    """Link of the machine."""
    xyz_m: Vector3
    """Position in the link's frame: forward, left, up."""
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw that turn the link's axes into the mount's."""

    def mount(self) -> Mount:
        """Return the same in radians."""
        roll, pitch, yaw = (math.radians(angle) for angle in self.rpy_deg)
        return Mount(body=self.body, xyz_m=self.xyz_m, rpy_rad=(roll, pitch, yaw))


class BarConfig(Config):
    """The reference frame, whose position, heading and speed are "the" machine's, and the rows along its y axis."""

    body: str
    """Link of the machine."""
    xyz_m: Vector3
    """Origin in the link's frame."""
    rows_y_m: Annotated[tuple[float, ...], Strict(strict=False), Field(max_length=64)] = ()
    """Lateral positions of the row units, from row 1 (leftmost, largest) on; none for a machine without."""

    @field_validator("rows_y_m")
    @classmethod
    def _from_left_to_right(cls, rows: tuple[float, ...]) -> tuple[float, ...]:
        if any(right >= left for left, right in pairwise(rows)):
            raise ValueError("rows_y_m has to fall from row 1 (left, positive) to the last row")
        return rows


class StartConfig(Config):
    """Where the machine stands at the beginning: the middle of the rear axle, where the path begins."""

    east_m: float = 0.0
    """East."""
    north_m: float = 0.0
    """North."""
    heading_deg: float = 0.0
    """Counter-clockwise from east."""


class MachineBaseConfig(Config):
    """What every machine's section has."""

    asset: ClassVar[Path]
    default_mounts: ClassVar[dict[str, MountConfig]]
    default_bar: ClassVar[BarConfig]
    turns_on_the_spot: ClassVar[bool] = False
    """Whether a driver can ask for a spin."""
    fixed: ClassVar[bool] = False
    """Whether it is a bench, whose root stands on the ground and does not move."""
    lift: ClassVar[str | None] = None
    """Slide that raises and lowers the reference frame, an implement whose height counts; None where there is none."""
    wheel_radius_m: ClassVar[float] = 0.0
    """Rolling radius of the wheels of the axle that follows the path, as its owner knows it; zero without wheels."""
    track_m: ClassVar[float] = 0.0
    """Between these wheels."""

    mounts: dict[str, MountConfig] = Field(default_factory=dict)
    """Mounts to add to the machine's own, or to put in their place."""
    bar: BarConfig | None = None
    """Another reference frame with other rows."""
    start: StartConfig = StartConfig()
    """Start pose of the middle of the rear axle."""

    @model_validator(mode="before")
    @classmethod
    def _with_default_mounts(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("mounts", {}), dict):
            return {**data, "mounts": {**cls.default_mounts, **data.get("mounts", {})}}
        return data

    @model_validator(mode="after")
    def _bodies_exist(self) -> Self:
        bodies = [link.name for link in read_urdf(self.asset).links]
        placed = {f"mounts.{name}": mount.body for name, mount in self.mounts.items()}
        if self.bar is not None:
            placed["bar"] = self.bar.body
        for key, body in placed.items():
            if body not in bodies:
                raise ValueError(f"{key}.body: unknown body {body!r} (there are {', '.join(bodies)})")
        return self

    def model(self, seed: int) -> MachineModel:
        """Return the machine to be simulated: the one of this kind that the world of this seed has."""
        raise NotImplementedError

    def _assembled(
        self,
        *,
        wheels: tuple[Wheel, ...],
        drive: Callable[[Urdf], Drive],
        springs: tuple[Spring, ...] = (),
        draughts: tuple[Draught, ...] = (),
        blade: BladeSpec | None = None,
    ) -> MachineModel:
        """Return what the section tells, with what only the machine knows."""
        return MachineModel(
            urdf=self.asset,
            wheels=wheels,
            mounts=self.resolved_mounts,
            reference=self.reference,
            rows_y_m=self.rows_y_m,
            start=self.vehicle_start,
            drive=drive,
            outline_m=self.outline_m,
            springs=springs,
            draughts=draughts,
            fixed=self.fixed,
            lift=self.lift,
            blade=blade,
        )

    @property
    def wheelbase_m(self) -> float:
        """From the rear axle, which follows the path, to the steered one; zero where nothing steers."""
        raise NotImplementedError

    @property
    def joints(self) -> dict[str, bool]:
        """Joints of the machine, and whether each is a slide."""
        return {joint.name: joint.slides for joint in read_urdf(self.asset).joints}

    @property
    def resolved_mounts(self) -> dict[str, Mount]:
        """All mounts, by name."""
        return {name: mount.mount() for name, mount in self.mounts.items()}

    @property
    def _bar(self) -> BarConfig:
        return self.bar if self.bar is not None else self.default_bar

    @property
    def reference(self) -> Mount:
        """The frame whose position, heading and speed the truth columns mean."""
        return Mount(body=self._bar.body, xyz_m=self._bar.xyz_m)

    @property
    def rows_y_m(self) -> tuple[float, ...]:
        """Lateral positions of the row units in the reference frame, row 1 (leftmost) first."""
        return self._bar.rows_y_m

    @property
    def vehicle_start(self) -> tuple[float, float, float]:
        """Start pose of the middle of the rear axle: east m, north m, heading rad."""
        return self.start.east_m, self.start.north_m, math.radians(self.start.heading_deg)

    @property
    def reference_x_m(self) -> float:
        """How far before the root link's origin (the middle of the rear axle) the reference is, with joints at zero."""
        position, rotation = read_urdf(self.asset).zero_pose(self.reference.body)
        return float((position + rotation @ self.reference.xyz_m)[0])

    @property
    def root(self) -> str:
        """Name of the link that all others hang on."""
        return read_urdf(self.asset).links[0].name

    @property
    def reference_swings(self) -> bool:
        """Whether hinges lie between the root link and the reference, so that its heading is not the machine's."""
        urdf = read_urdf(self.asset)
        by_child = {joint.child: joint for joint in urdf.joints}
        body = self.reference.body
        while body in by_child:
            if not by_child[body].slides:
                return True
            body = by_child[body].parent
        return False

    @property
    def reference_start(self) -> tuple[float, float, float]:
        """Nominal start pose of the reference frame (what is drawn, straight behind): east m, north m, heading rad."""
        east, north, heading = self.vehicle_start
        position, rotation = read_urdf(self.asset).zero_pose(self.reference.body)
        forward, left, _ = (position + rotation @ self.reference.xyz_m).tolist()
        by_east, by_north = turned(forward, left, heading)
        own = float(rpy_from_rotation(rotation)[2])
        return east + float(by_east), north + float(by_north), heading + own

    @property
    def footprint_m(self) -> Outline:
        """Rectangle around all joints and row units, as the machine stands straight: (back, right), (front, left).

        In the frame of the root link, forward and left, m.
        """
        urdf = read_urdf(self.asset)
        points = [urdf.zero_pose(link.name)[0][:2] for link in urdf.links]
        position, rotation = urdf.zero_pose(self.reference.body)
        bar = position + rotation @ self.reference.xyz_m
        points += [(bar + rotation @ np.array([0.0, y, 0.0]))[:2] for y in self.rows_y_m]
        low, high = np.min(points, axis=0), np.max(points, axis=0)
        return (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))

    @property
    def outline_m(self) -> Outline:
        """Rectangle around the machine that may not touch a tree, in the frame of the root link."""
        return self.footprint_m

    @property
    def reach_m(self) -> float:
        """No part of the machine is farther from the middle of the rear axle than this."""
        urdf = read_urdf(self.asset)
        ends = [float(math.hypot(*urdf.zero_pose(link.name)[0][:2])) for link in urdf.links]
        return max(ends) + max((abs(y) for y in self.rows_y_m), default=0.0) + abs(self.reference.xyz_m[0])
