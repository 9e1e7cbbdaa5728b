"""The world in motion: one machine on one terrain, stepped by pybullet, with our tyre-soil forces.

pybullet integrates the machine's tree of rigid bodies (Featherstone); everything that touches the ground is ours
(``twin.world.dynamics``, ``twin.world.tyres``). The machine has no collision shapes: how far it is from the nearest
trunk is part of the truth, and a run ends where they touch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Self

import numpy as np

from twin.errors import BadInputError, WorldEndedError
from twin.geometry import STANDARD_GRAVITY_M_S2, rotation_from_rpy
from twin.signals import (
    CLEARANCE,
    HEADING,
    HEIGHT,
    NS_PER_S,
    POSITION,
    SPEED,
    STROKE,
    VELOCITY,
    YAW_RATE,
    Capture,
    Command,
    FloatArray,
    IntArray,
    Need,
    Said,
    VehicleState,
    row_position,
    row_speed,
)
from twin.world import dynamics, tyres
from twin.world.assembly import assemble
from twin.world.blade import BLADE_COLUMNS, Blade
from twin.world.body import PhysicsBody
from twin.world.clearance import clearance_m
from twin.world.ground import build_ground
from twin.world.levelling import LevellingConfig
from twin.world.light import LightConfig
from twin.world.machine import Actuation, MachineBaseConfig, MachineModel
from twin.world.magnetics import Magnetics, MagneticsConfig
from twin.world.orchard import TRUNK_COLUMNS, OrchardConfig, planted
from twin.world.signs import SignConfig, put_up
from twin.world.soil import Soil, SoilConfig
from twin.world.survey import SURVEY_COLUMNS, FieldSurvey
from twin.world.terrain import AnyTerrain, Terrain
from twin.world.watch import Watch, mount_row

_SOIL_HZ = 50.0
"""How often the blade works the ground: every 2 cm at 1 m/s."""
_SETTLING_S = 4.0
_SETTLING_DAMPING = 3.0
_REASONS = {
    dynamics.OFF_TERRAIN: "the machine left the terrain",
    dynamics.NOT_FINITE: "the simulation diverged: the state is no longer finite",
    dynamics.TIPPED: "the machine tipped over",
}
_WHEEL_COLUMNS = (
    ("normal_n", tyres.NORMAL),
    ("pull_n", tyres.FORCE_X),
    ("side_n", tyres.FORCE_Y),
    ("slip", tyres.SLIP_RATIO),
    ("slip_angle_rad", tyres.SLIP_ANGLE),
)


class World:
    """One machine on one terrain.

    Time is counted in integer ticks of ``dt_ns``. The machine begins settled on the ground with its brakes on; what a
    sensor needs is shown to whoever :meth:`watch`-es it.

    Raises:
        BadInputError: the machine's URDF cannot be used, or the machine does not start on the terrain, or a tree, a
            sign or a magnet does not lie on it.
    """

    def __init__(
        self,
        *,
        terrain: Terrain,
        soil: Soil,
        machine: MachineModel,
        trunks: FloatArray | None = None,
        signs: Sequence[SignConfig] = (),
        magnetics: MagneticsConfig | None = None,
        light: LightConfig | None = None,
        levelling: LevellingConfig | None = None,
        seed: int,
        dt_ns: int = 2_000_000,
    ) -> None:
        self.terrain = terrain
        self._blade = None if machine.blade is None else Blade(machine.blade, terrain)
        self.first_terrain = terrain if self._blade is None else replace(terrain, heights=terrain.heights.copy())
        """The ground as it was before anything moved."""
        levelling = levelling if levelling is not None else LevellingConfig()
        self.design_height_m = levelling.design_height_m
        self._survey: FieldSurvey | None = None
        if levelling.area_m is not None:
            self._survey = FieldSurvey(terrain, levelling.area_m, design_height_m=levelling.design_height_m)
        self.trunks = planted(np.zeros((0, TRUNK_COLUMNS)) if trunks is None else trunks, terrain)
        self.signs = put_up(signs, terrain)
        self._light = light if light is not None else LightConfig()
        self.magnetics = Magnetics(magnetics if magnetics is not None else MagneticsConfig(), terrain, seed=seed)
        self.machine = machine
        self.seed = seed
        self.dt_ns = dt_ns
        self.tick = 0
        self._dt_s = dt_ns / NS_PER_S
        self._body = PhysicsBody(machine.urdf, self._dt_s, fixed=machine.fixed)
        self._open = ExitStack()
        self._open.callback(self._body.close)
        try:
            self._prepare(soil)
            self._settle()
        except BaseException:
            self.close()
            raise

    # --- building ----------------------------------------------------------------------------------------------------

    def _prepare(self, soil: Soil) -> None:
        urdf, machine = self._body.urdf, self.machine
        joints = len(urdf.joints)
        self._drive = machine.drive(urdf)
        self._parts = assemble(urdf, machine, soil, servos=self._drive.servos)
        self._state = np.zeros(dynamics.JOINTS + 2 * joints)
        self._links = np.zeros((joints + 1, dynamics.LINK_COLUMNS))
        self._loads = np.zeros(6 + joints)
        self._command = Command(brake=True)
        self._actuation = Actuation(torque_n_m=np.zeros(joints), brake_n_m=np.zeros(joints), servo_rad_s=[0.0] * joints)
        self._limits = np.zeros(joints)
        self._limits[list(self._drive.servos)] = machine.servo_limit
        self._rolling_resistance = soil.rolling_resistance
        self._deflections = np.zeros((len(machine.wheels), 2))
        self._results = np.zeros((len(machine.wheels), tyres.WHEEL_RESULTS))
        self._lift_joint = None if machine.lift is None else urdf.joint_index(machine.lift)
        self._reference_body = urdf.link_index(machine.reference.body)
        self._reference = mount_row(machine.reference)
        self._rows = np.array(machine.rows_y_m)
        self._watch = Watch(
            urdf=urdf,
            links=self._links,
            joint_positions=self._state[dynamics.JOINTS : dynamics.JOINTS + joints],
            terrain=self.terrain,
            trunks=self.trunks,
            signs=self.signs,
            magnetics=self.magnetics,
            light=self._light,
            current_a=lambda: self._drive.current_a,
            dt_ns=self.dt_ns,
        )
        self._open.callback(self._watch.close)
        self._grid = (terrain := self.terrain).west_m, terrain.south_m, terrain.cell_m
        self._blade_link = 0 if machine.blade is None else urdf.link_index(machine.blade.body)
        # none while the machine settles: the clock has not begun
        self._soil_ticks = 0
        self.truth_columns = self._name_columns()
        self._truth_head = np.zeros(11 + 3 * len(self._rows))

    def _name_columns(self) -> tuple[str, ...]:
        rows = range(1, len(self._rows) + 1)
        head = (*POSITION, *VELOCITY, HEADING, "roll_rad", "pitch_rad", SPEED, YAW_RATE)
        per_row = tuple(name for row in rows for name in (row_speed(row), *row_position(row)))
        drawing = ("base_e_m", "base_n_m", "base_u_m", "base_qx", "base_qy", "base_qz", "base_qw")
        joints = tuple(joint.column for joint in self._body.urdf.joints)
        vehicle = ("vehicle_e_m", "vehicle_n_m", "vehicle_heading_rad", "vehicle_speed_m_s")
        wheels = tuple(f"{wheel.joint}.{name}" for wheel in self.machine.wheels for name, _ in _WHEEL_COLUMNS)
        near = (CLEARANCE,) if len(self.trunks) else ()
        height = (HEIGHT,) if self.machine.lift is not None else ()
        soil = (BLADE_COLUMNS if self._blade is not None else ()) + (SURVEY_COLUMNS if self._survey is not None else ())
        return head + per_row + drawing + joints + vehicle + self._drive.columns + wheels + near + height + soil

    # --- start -------------------------------------------------------------------------------------------------------

    def _settle(self) -> None:
        """Put the machine on the ground and let it come to rest, brakes on, before the clock starts."""
        east, north, heading = self.machine.start
        self._body.place(*self._pose_on_ground(east, north, heading))
        self._read()
        dampers = self._parts.wheels[:, tyres.DAMPING], self._parts.springs[:, dynamics.SPRING_DAMPING]
        figures = [damper.copy() for damper in dampers]
        for damper, figure in zip(dampers, figures, strict=True):
            damper[:] = _SETTLING_DAMPING * figure
        try:
            self.advance(round(_SETTLING_S / self._dt_s))
        except WorldEndedError as error:
            raise BadInputError(f"machine.start: {error.reason} at its start") from error
        for damper, figure in zip(dampers, figures, strict=True):
            damper[:] = figure
        self._drive.reset()
        self.tick = 0
        if self._blade is not None:
            self._soil_ticks = max(1, round(1.0 / _SOIL_HZ / self._dt_s))
        if self.touching:
            raise BadInputError("machine.start: the machine touches a tree at its start")

    def _pose_on_ground(self, east: float, north: float, heading: float) -> tuple[FloatArray, FloatArray]:
        """Position and roll, pitch, yaw of the root that lay the wheels on the ground's mean plane."""
        if self.machine.fixed:
            return np.array([east, north, self._height_at_start(east, north)]), np.array([0.0, 0.0, heading])
        urdf, parts = self._body.urdf, self._parts
        turn = rotation_from_rpy(0.0, 0.0, heading)
        hubs = np.array([urdf.zero_pose(urdf.links[j + 1].name)[0] for j in parts.wheel_joints])
        spots = hubs @ turn.T + np.array([east, north, 0.0])
        ground = np.array([self._height_at_start(x, y) for x, y, _ in spots])
        design = np.column_stack([np.ones(len(hubs)), hubs[:, 0], hubs[:, 1]])
        level, ahead, left = np.linalg.lstsq(design, ground, rcond=None)[0]
        bottom = hubs[:, 2] - parts.wheels[:, tyres.RADIUS] + parts.static_sinkage_m
        position = np.array([east, north, level - float(np.mean(bottom))])
        return position, np.array([math.atan(left), -math.atan(ahead), heading])

    def _height_at_start(self, east_m: float, north_m: float) -> float:
        try:
            return self.terrain.height(east_m, north_m)
        except BadInputError as error:
            raise BadInputError(f"machine.start: a wheel at {error}") from error

    # --- the hot loop ------------------------------------------------------------------------------------------------

    def advance(self, to_tick: int) -> None:
        """Step until ``to_tick``.

        Raises:
            WorldEndedError: the machine tipped over, left the terrain, or the simulation diverged.
        """
        body, drive, actuation, command = self._body, self._drive, self._actuation, self._command
        state, loads, limits, dt = self._state, self._loads, self._limits, self._dt_s
        parts, count = self._parts, len(self._parts.joints)
        tree = parts.parents, parts.joints
        ground: tuple[Any, ...] = (
            state, self._links, parts.wheel_joints, parts.wheels, self._deflections, self._results,
            self.terrain.heights, *self._grid, parts.tools, parts.springs, self._rolling_resistance,
            actuation.torque_n_m, actuation.brake_n_m, dt, loads, limits,
        )  # fmt: skip
        soil_ticks = self._soil_ticks
        watched = self._watch.bodies, self._watch.mounts, self._watch.sums
        mounts: tuple[Any, ...] = parts.root_com, state, self._links, *watched, dt, STANDARD_GRAVITY_M_S2
        q = state[dynamics.JOINTS : dynamics.JOINTS + count].tolist()
        qd = state[dynamics.JOINTS + count :].tolist()
        while self.tick < to_tick:
            drive.step(command, q, qd, dt, actuation)
            status = dynamics.forces(*tree, *ground)
            if status != dynamics.OK:
                raise WorldEndedError(_REASONS[status])
            q, qd = body.step(state, loads.tolist(), actuation.servo_rad_s, limits.tolist())
            dynamics.motion(*tree, *mounts)
            self.tick += 1
            if soil_ticks and self.tick % soil_ticks == 0:
                self._move_soil()

    def _move_soil(self) -> None:
        """Let the blade work the ground up to where it is now, and feel what that takes."""
        blade = self._blade
        assert blade is not None
        blade.step(self._links[self._blade_link])
        self._parts.tools[self._parts.blade_tool, dynamics.TOOL_FORCE] = blade.draught_n

    def drain_ground(self) -> tuple[IntArray, FloatArray]:
        """Cells of the terrain whose height changed since the last call (flat indices) and their heights, (n,) each."""
        if self._blade is None:
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        cells = self._blade.drain_changes()
        return cells, self.terrain.heights.ravel()[cells]

    @property
    def moves_soil(self) -> bool:
        """Whether the machine has a blade."""
        return self._blade is not None

    def _read(self) -> None:
        self._body.read(self._state)
        parts = self._parts
        dynamics.move_links(parts.parents, parts.joints, parts.root_com, self._state, self._links)

    def command(self, command: Command) -> None:
        """Take what a driver asks for, from the next step on."""
        self._command = command

    def engage(self, engaged: bool) -> None:
        """Put the transmission in gear, or in neutral (the machine coasts; brakes still work)."""
        self._drive.engaged = engaged

    # --- what others may know ----------------------------------------------------------------------------------------

    def vehicle(self) -> VehicleState:
        """What the driver sees now."""
        root = self._links[0]
        heading = math.atan2(root[6], root[3])
        speed = float(root[12]) * math.cos(heading) + float(root[13]) * math.sin(heading)
        return VehicleState(
            east_m=float(root[0]),
            north_m=float(root[1]),
            heading_rad=heading,
            speed_m_s=speed,
            steering_rad=self._drive.steering_rad,
        )

    def implement(self) -> Said:
        """Height of the reference frame above the design plane, its vertical speed, and the stroke of its slide."""
        dynamics.reference_truth(self._links, self._reference_body, self._reference, self._rows, self._truth_head)
        head = self._truth_head
        values = {HEIGHT: float(head[2]) - self.design_height_m, VELOCITY[2]: float(head[5])}
        if self._lift_joint is not None:
            values[STROKE] = float(self._state[dynamics.JOINTS + self._lift_joint])
        return Said(t_ns=self.tick * self.dt_ns, values=values)

    @property
    def load_share(self) -> float:
        """How full the blade is now: the soil it carries over the most that it holds; zero where there is none."""
        return 0.0 if self._blade is None else self._blade.load_m3 / self._blade.spec.capacity_m3

    def truth(self) -> FloatArray:
        """Values of ``truth_columns`` at the current tick, shape (n,)."""
        dynamics.reference_truth(self._links, self._reference_body, self._reference, self._rows, self._truth_head)
        state, count, vehicle = self._state, len(self._parts.joints), self.vehicle()
        positions = state[dynamics.JOINTS : dynamics.JOINTS + count]
        return np.concatenate(
            [
                self._truth_head,
                self._links[0, :3],
                state[dynamics.QUATERNION : dynamics.QUATERNION + 4],
                positions,
                (vehicle.east_m, vehicle.north_m, vehicle.heading_rad, vehicle.speed_m_s),
                self._drive.diagnostics(),
                self._results[:, [index for _, index in _WHEEL_COLUMNS]].ravel(),
                [self._clearance(vehicle)] if len(self.trunks) else [],
                [self._truth_head[2] - self.design_height_m] if self.machine.lift is not None else [],
                () if self._blade is None else self._blade.truth(),
                () if self._survey is None else self._survey.truth(self.tick * self.dt_ns),
            ]
        )

    @property
    def touching(self) -> bool:
        """Whether the machine touches a tree now."""
        return len(self.trunks) > 0 and self._clearance(self.vehicle()) <= 0.0

    def _clearance(self, vehicle: VehicleState) -> float:
        outline = self.machine.outline_m
        return clearance_m(self.trunks, vehicle.east_m, vehicle.north_m, vehicle.heading_rad, outline)

    def watch(self, name: str, need: Need) -> None:
        """Answer this need from now on, to :meth:`capture` under this name."""
        self._watch.add(name, need, self.tick)

    def capture(self, name: str) -> Capture:
        """What a watcher needs, now (see :mod:`twin.world.watch`)."""
        return self._watch.capture(name, self.tick)

    def bare_step_us(self, steps: int = 2000) -> float:
        """Wall time of one bare ``pybullet.stepSimulation`` of the same machine, in microseconds.

        A second client holds a copy of the machine as it stands, its joints held by the same motors, without our
        forces and without gravity.
        """
        copy = PhysicsBody(self.machine.urdf, self._dt_s, fixed=self.machine.fixed)
        try:
            copy.hold(self._actuation.servo_rad_s, self._limits.tolist())
            copy.float_freely()
            return copy.time_steps(steps)
        finally:
            copy.close()

    def energy_j(self) -> float:
        """Kinetic, potential and spring energy of the machine, J (tyres as of the latest step's forces)."""
        total = float(np.sum(self._results[:, tyres.SPRING]))
        for joint, stiffness, _, preload in self._parts.springs:
            angle = float(self._state[dynamics.JOINTS + int(joint)])
            total += 0.5 * stiffness * angle**2 - preload * angle
        for link, row in zip(self._body.urdf.links, self._links, strict=True):
            rotation = row[dynamics.ROTATION : dynamics.ROTATION + 9].reshape(3, 3)
            arm = rotation @ link.com_m
            rate = row[dynamics.RATE :]
            velocity = row[dynamics.VELOCITY : dynamics.VELOCITY + 3] + np.cross(rate, arm)
            spin = rotation.T @ rate
            total += 0.5 * link.mass_kg * float(velocity @ velocity)
            total += 0.5 * float(np.array(link.inertia_kg_m2) @ spin**2)
            total += link.mass_kg * STANDARD_GRAVITY_M_S2 * float(row[2] + arm[2])
        return total

    def close(self) -> None:
        """Disconnect from pybullet; may be called more than once."""
        self._open.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def build_world(
    terrain: AnyTerrain,
    soil: SoilConfig,
    machine: MachineBaseConfig,
    *,
    seed: int,
    dt_ns: int = 2_000_000,
    path: FloatArray | None = None,
    orchard: OrchardConfig | None = None,
    signs: Sequence[SignConfig] = (),
    magnetics: MagneticsConfig | None = None,
    light: LightConfig | None = None,
    levelling: LevellingConfig | None = None,
) -> World:
    """Make the world of a scenario; ``path`` as in :func:`twin.world.ground.build_ground`.

    Raises:
        BadInputError: the terrain cannot be made, or the path leaves it.
    """
    ground = build_ground(terrain, machine, seed=seed, path=path, orchard=orchard, signs=signs)
    return World(
        terrain=ground,
        soil=soil.soil(),
        machine=machine.model(seed),
        trunks=orchard.trunks(seed) if orchard is not None else None,
        signs=signs,
        magnetics=magnetics,
        light=light,
        levelling=levelling,
        seed=seed,
        dt_ns=dt_ns,
    )
