"""The machine inside pybullet: one DIRECT client, one multibody, nothing else.

The only module that talks to pybullet. Calls are few because each costs microseconds: root pose, root velocity and
joint states in; one force, one torque, one array of joint torques and one of joint motors out.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from twin.errors import BadInputError
from twin.geometry import STANDARD_GRAVITY_M_S2, quaternion_from_rpy, rotation_from_rpy
from twin.signals import FloatArray
from twin.world.urdf import Urdf, read_urdf


@contextlib.contextmanager
def _quiet_standard_error() -> Iterator[None]:
    """Keep C code from writing to standard error: importing pybullet prints its build time there."""
    try:
        kept = os.dup(2)
    except OSError:
        yield
        return
    sys.stderr.flush()
    with open(os.devnull, "wb") as nowhere:  # noqa: PTH123  (a descriptor is wanted)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


with _quiet_standard_error():
    import pybullet as p

_ROOT = -1
_FASTEST_JOINT_RAD_S = 1_000.0


class PhysicsBody:
    """A machine loaded from its URDF into a client of its own; ``fixed`` holds its root where it is placed."""

    def __init__(self, path: Path, dt_s: float, *, fixed: bool = False) -> None:
        self.urdf: Urdf = read_urdf(path)
        self._client: int | None = p.connect(p.DIRECT)
        self._kw: dict[str, Any] = {"physicsClientId": self._client}
        p.setGravity(0.0, 0.0, -STANDARD_GRAVITY_M_S2, **self._kw)
        p.setPhysicsEngineParameter(fixedTimeStep=dt_s, deterministicOverlappingPairs=1, **self._kw)
        self._body: int = p.loadURDF(str(path), useFixedBase=fixed, flags=p.URDF_USE_INERTIA_FROM_FILE, **self._kw)
        self._fixed = fixed
        names = {
            p.getJointInfo(self._body, j, **self._kw)[1].decode(): j
            for j in range(p.getNumJoints(self._body, **self._kw))
        }
        self._indices = [names[joint.name] for joint in self.urdf.joints]
        self._no_torque = [0.0] * len(self._indices)
        self._remove_damping()
        self._check_inertias()

    def _remove_damping(self) -> None:
        for link in (_ROOT, *self._indices):
            p.changeDynamics(
                self._body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                maxJointVelocity=_FASTEST_JOINT_RAD_S, activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING, **self._kw,
            )  # fmt: skip
        p.setJointMotorControlArray(self._body, self._indices, p.VELOCITY_CONTROL, forces=self._no_torque, **self._kw)

    def _check_inertias(self) -> None:
        """The importer replaces what it does not like without an error; see that it liked everything."""
        for link, index in zip(self.urdf.links, (_ROOT, *self._indices), strict=True):
            info = p.getDynamicsInfo(self._body, index, **self._kw)
            wanted = (link.mass_kg, *link.inertia_kg_m2, *link.com_m)
            if self._fixed and index == _ROOT:
                continue  # what does not move has no mass there
            if not np.allclose((info[0], *info[2], *info[3]), wanted, rtol=1e-9, atol=1e-12):
                raise BadInputError(f"{self.urdf.path}: pybullet read other mass properties for link {link.name!r}")

    def place(self, position_m: FloatArray, rpy_rad: FloatArray) -> None:
        """Put the root's link frame at a pose, at rest, with every joint at zero."""
        # pybullet wants the pose of the inertial frame.
        com = position_m + rotation_from_rpy(*rpy_rad) @ np.array(self.urdf.links[0].com_m)
        p.resetBasePositionAndOrientation(self._body, com, quaternion_from_rpy(*rpy_rad), **self._kw)
        p.resetBaseVelocity(self._body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), **self._kw)
        for index in self._indices:
            p.resetJointState(self._body, index, 0.0, 0.0, **self._kw)

    def read(self, state: FloatArray) -> tuple[list[float], list[float]]:
        """Read pose and velocities into ``state``; return the joints' positions and rates."""
        client, body = self._client, self._body
        position, quaternion = p.getBasePositionAndOrientation(body, physicsClientId=client)
        linear, angular = p.getBaseVelocity(body, physicsClientId=client)
        joints = p.getJointStates(body, self._indices, physicsClientId=client)
        q = [joint[0] for joint in joints]
        qd = [joint[1] for joint in joints]
        state[:] = [*position, *quaternion, *linear, *angular, *q, *qd]
        return q, qd

    def step(
        self, state: FloatArray, loads: list[float], rates: list[float], limits: list[float]
    ) -> tuple[list[float], list[float]]:
        """Apply ``loads`` (force and moment on the root, joint torques), step, and read the new state.

        ``rates`` and ``limits`` are what the joint motors are to hold, see :meth:`hold`.
        """
        client, body = self._client, self._body
        p.applyExternalForce(body, _ROOT, loads[0:3], state[0:3].tolist(), p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(body, _ROOT, loads[3:6], p.WORLD_FRAME, physicsClientId=client)
        p.setJointMotorControlArray(body, self._indices, p.TORQUE_CONTROL, forces=loads[6:], physicsClientId=client)
        self.hold(rates, limits)
        p.stepSimulation(physicsClientId=client)
        return self.read(state)

    def hold(self, rates: list[float], limits: list[float]) -> None:
        """Set the joint motors: the rate each drives its joint at, and the moment it may use for that."""
        p.setJointMotorControlArray(
            self._body, self._indices, p.VELOCITY_CONTROL, targetVelocities=rates, forces=limits,
            physicsClientId=self._client,
        )  # fmt: skip

    def float_freely(self) -> None:
        """Switch gravity off."""
        p.setGravity(0.0, 0.0, 0.0, **self._kw)

    def time_steps(self, steps: int) -> float:
        """Median-of-five wall time of a bare step, us."""
        each = max(1, steps // 5)
        times = []
        for _ in range(5):
            started = time.perf_counter()
            for _ in range(each):
                p.stepSimulation(physicsClientId=self._client)
            times.append((time.perf_counter() - started) / each * 1e6)
        return sorted(times)[2]

    def close(self) -> None:
        """Disconnect; may be called more than once."""
        if self._client is not None:
            p.disconnect(self._client)
            self._client = None
