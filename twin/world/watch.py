"""What the world shows its watchers: each sensor's need, answered when it samples.

The motion of a mount is accumulated step by step by the hot loop (``dynamics.watch_mounts``) in the arrays kept here;
everything else is worked out only when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import assert_never

import numpy as np

from twin.geometry import STANDARD_GRAVITY_M_S2, rotation_from_rpy
from twin.signals import (
    NS_PER_S,
    Capture,
    FloatArray,
    ImageNeed,
    JointMotion,
    JointNeed,
    MagneticField,
    MagneticNeed,
    MotionNeed,
    Mount,
    MountMotion,
    Need,
    Picture,
    RayNeed,
    RayScan,
)
from twin.world import dynamics
from twin.world.beams import cast, swept_beams
from twin.world.light import LightConfig
from twin.world.magnetics import Magnetics
from twin.world.pictures import Scenery
from twin.world.terrain import Terrain
from twin.world.urdf import Urdf


def mount_row(mount: Mount) -> FloatArray:
    """Position on its link and rotation to it, as the kernels of :mod:`twin.world.dynamics` want it, (12,)."""
    return np.array([*mount.xyz_m, *rotation_from_rpy(*mount.rpy_rad).ravel()])


class Watch:
    """The needs of all watchers, and the accumulators of those who need motion.

    Args:
        urdf: the machine.
        links: rows of all links; read whenever something is captured.
        joint_positions: (J,) positions of all joints, likewise.
        terrain: the ground.
        trunks: the trees on it (see :mod:`twin.world.orchard`).
        signs: the stop signs on it (see :mod:`twin.world.signs`).
        magnetics: the magnetic field.
        light: how bright it is.
        current_a: tells the current that the motors draw.
        dt_ns: length of a step.
    """

    def __init__(
        self,
        *,
        urdf: Urdf,
        links: FloatArray,
        joint_positions: FloatArray,
        terrain: Terrain,
        trunks: FloatArray,
        signs: FloatArray,
        magnetics: Magnetics,
        light: LightConfig,
        current_a: Callable[[], float],
        dt_ns: int,
    ) -> None:
        self.bodies = np.zeros(0, dtype=np.int64)
        """Link of each accumulated mount."""
        self.mounts = np.zeros((0, dynamics.MOUNT_COLUMNS))
        self.sums = np.zeros((0, dynamics.ACCUMULATOR_COLUMNS))
        self._urdf = urdf
        self._links = links
        self._joint_positions = joint_positions
        self._terrain = terrain
        self._trunks = trunks
        self._signs = signs
        self._scenery: Scenery | None = None
        self._magnetics = magnetics
        self._light = light
        self._current_a = current_a
        self._dt_ns = dt_ns
        self._needs: dict[str, Need] = {}
        self._joints: dict[str, list[int]] = {}
        self._last_pose: dict[str, tuple[int, tuple[FloatArray, FloatArray]]] = {}
        self._accumulator: dict[str, int] = {}
        self._started_tick: dict[str, int] = {}

    def add(self, name: str, need: Need, tick: int) -> None:
        """Answer this need from now on."""
        self._needs[name] = need
        if isinstance(need, MotionNeed):
            self._accumulate(name, need, tick)
        elif isinstance(need, JointNeed):
            self._joints[name] = [self._urdf.joint_index(joint) for joint in need.joints]
        elif isinstance(need, RayNeed):
            self._last_pose[name] = tick, self._pose(need.mount)

    def capture(self, name: str, tick: int) -> Capture:
        """Answer a need now; what is a mean is one since the previous capture of that name."""
        need = self._needs[name]
        match need:
            case MotionNeed():
                return self._motion(name, tick)
            case JointNeed():
                position, _ = self._pose(need.mount)
                return JointMotion(
                    t_ns=tick * self._dt_ns, position_enu_m=position, position=self._joint_positions[self._joints[name]]
                )
            case MagneticNeed():
                position, rotation = self._pose(need.mount)
                t_ns = tick * self._dt_ns
                return MagneticField(
                    t_ns=t_ns,
                    position_enu_m=position,
                    field_ut=self._magnetics.field_ut(position, t_ns / NS_PER_S) @ rotation,
                    motor_current_a=self._current_a(),
                )
            case RayNeed():
                return self._scan(name, need, tick)
            case ImageNeed():
                return self._picture(need, tick)
            case _:
                assert_never(need)

    def _pose(self, mount: Mount) -> tuple[FloatArray, FloatArray]:
        """Position (3,) and rotation to the world (3, 3) of a mount."""
        row = np.empty(15)
        dynamics.place_mount(self._links[self._urdf.link_index(mount.body)], mount_row(mount), row)
        return row[:3], row[3:12].reshape(3, 3)

    def _scan(self, name: str, need: RayNeed, tick: int) -> RayScan:
        """Beams sent since the previous capture, from where the mount was then to where it is now."""
        before_tick, before = self._last_pose[name]
        now = self._pose(need.mount)
        self._last_pose[name] = tick, now
        t_ns, passed_s = tick * self._dt_ns, (tick - before_tick) * self._dt_ns / NS_PER_S
        share = min(1.0, need.sweep_s / passed_s) if passed_s > 0.0 else 0.0
        origins, directions = swept_beams(before, now, np.array(need.bearings_rad), share)
        ground = self._terrain
        distance = np.empty(len(origins))
        highest = float(ground.heights.max())
        grid = ground.west_m, ground.south_m, ground.cell_m
        cast(origins, directions, need.reach_m, self._trunks, ground.heights, *grid, highest, distance)
        lux = self._light.at(t_ns / NS_PER_S)
        return RayScan(t_ns=t_ns, position_enu_m=now[0], distance_m=distance, illuminance_lux=lux)

    def _picture(self, need: ImageNeed, tick: int) -> Picture:
        """What is seen now; the scenery is built when the first picture is taken."""
        if self._scenery is None:
            self._scenery = Scenery(self._terrain, self._trunks, self._signs)
        position, rotation = self._pose(need.mount)
        t_ns = tick * self._dt_ns
        return Picture(
            t_ns=t_ns,
            position_enu_m=position,
            rgb=self._scenery.picture(need, position, rotation),
            illuminance_lux=self._light.at(t_ns / NS_PER_S),
            sign_xyz_m=self._scenery.nearest_sign(position, rotation),
        )

    def close(self) -> None:
        """Put the scenery away, if there is one."""
        if self._scenery is not None:
            self._scenery.close()
            self._scenery = None

    def _accumulate(self, name: str, need: MotionNeed, tick: int) -> None:
        mount, body = mount_row(need.mount), self._urdf.link_index(need.mount.body)
        row = np.zeros(dynamics.ACCUMULATOR_COLUMNS)
        dynamics.place_mount(self._links[body], mount, row)
        row[dynamics.ACC_START : dynamics.ACC_START + 3] = row[:3]
        rotation = row[dynamics.ACC_ROTATION : dynamics.ACC_ROTATION + 9].reshape(3, 3)
        # Until the first step the machine has stood on its brakes.
        row[dynamics.ACC_LAST_FORCE : dynamics.ACC_LAST_FORCE + 3] = rotation[2] * STANDARD_GRAVITY_M_S2
        row[dynamics.ACC_LAST_RATE : dynamics.ACC_LAST_RATE + 3] = rotation.T @ self._links[body, dynamics.RATE :]
        self._accumulator[name] = len(self.bodies)
        self._started_tick[name] = tick
        self.bodies = np.append(self.bodies, np.int64(body))
        self.mounts = np.vstack([self.mounts, mount])
        self.sums = np.vstack([self.sums, row])

    def _motion(self, name: str, tick: int) -> MountMotion:
        """Motion now and its means since the previous capture of that name.

        With no step in between, the means are those of the latest step (and ``interval_s`` is 0).
        """
        row = self.sums[self._accumulator[name]]
        steps = tick - self._started_tick[name]
        force = row[dynamics.ACC_FORCE : dynamics.ACC_FORCE + 3]
        rate = row[dynamics.ACC_RATE : dynamics.ACC_RATE + 3]
        start = row[dynamics.ACC_START : dynamics.ACC_START + 3]
        position = row[dynamics.ACC_POSITION : dynamics.ACC_POSITION + 3]
        velocity = row[dynamics.ACC_VELOCITY : dynamics.ACC_VELOCITY + 3]
        interval_s = steps * self._dt_ns / NS_PER_S
        last = (dynamics.ACC_LAST_FORCE, dynamics.ACC_LAST_RATE)
        motion = MountMotion(
            t_ns=tick * self._dt_ns,
            interval_s=interval_s,
            position_enu_m=position.copy(),
            rotation=row[dynamics.ACC_ROTATION : dynamics.ACC_ROTATION + 9].reshape(3, 3).copy(),
            velocity_enu_m_s=velocity.copy(),
            mean_velocity_enu_m_s=(position - start) / interval_s if steps else velocity.copy(),
            mean_specific_force_m_s2=force / steps if steps else row[last[0] : last[0] + 3].copy(),
            mean_rate_rad_s=rate / steps if steps else row[last[1] : last[1] + 3].copy(),
        )
        start[:] = position
        force[:] = rate[:] = 0.0
        self._started_tick[name] = tick
        return motion
