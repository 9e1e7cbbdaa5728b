"""Prismatic joints and fixed roots: our kinematics and forces against pybullet's own and against mechanics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet as p
import pytest

from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.geometry import rotation_from_rpy
from twin.signals import FloatArray
from twin.world import dynamics
from twin.world.assembly import assemble
from twin.world.body import PhysicsBody
from twin.world.machine import MachineModel, Mount
from twin.world.soil import ASPHALT
from twin.world.statics import static_loads
from twin.world.urdf import Urdf, read_urdf

_URDF = """<robot name="slider">
<link name="base"><inertial><origin xyz="0.1 0 0.2"/><mass value="8"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
 iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0 0.1 0"/><mass value="2"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0"
 iyz="0"/></inertial></link>
<link name="plate"><inertial><origin xyz="0 0 0.1"/><mass value="3"/><inertia ixx=".2" iyy=".2" izz=".2" ixy="0" ixz="0"
 iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0.3 0 0.4" rpy="0.1 0.2 0.3"/>
 <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1e6" velocity="1e3"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="plate"/><origin xyz="0 0.2 0.5" rpy="0.3 0 0.1"/>
 <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1e6" velocity="1e3"/></joint>
</robot>"""


@pytest.fixture
def urdf(tmp_path: Path) -> Urdf:
    path = tmp_path / "slider.urdf"
    path.write_text(_URDF)
    return read_urdf(path)


def _assembly(urdf: Urdf) -> tuple[FloatArray, FloatArray, FloatArray]:
    model = MachineModel(
        urdf=urdf.path, wheels=(), mounts={}, reference=Mount(body="plate", xyz_m=(0.0, 0.0, 0.0)), rows_y_m=(),
        start=(0.0, 0.0, 0.0), drive=lambda _: None, outline_m=((0.0, 0.0), (0.0, 0.0)), fixed=True,  # type: ignore
    )  # fmt: skip
    parts = assemble(urdf, model, ASPHALT, servos=())
    return parts.parents, parts.joints, parts.root_com


def test_links_move_as_pybullet_moves_them(urdf: Urdf) -> None:
    parents, joints, com = _assembly(urdf)
    client = p.connect(p.DIRECT)
    body = p.loadURDF(str(urdf.path), flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    quaternion = p.getQuaternionFromEuler((0.2, -0.3, 1.0))
    p.resetBasePositionAndOrientation(body, (1.0, 2.0, 3.0), quaternion, physicsClientId=client)
    p.resetBaseVelocity(body, (0.5, -0.2, 0.1), (0.3, 0.4, -0.5), physicsClientId=client)
    positions, rates = (0.7, 0.35), (1.1, -0.6)
    for j in range(2):
        p.resetJointState(body, j, positions[j], rates[j], physicsClientId=client)
    state = np.array([1.0, 2.0, 3.0, *quaternion, 0.5, -0.2, 0.1, 0.3, 0.4, -0.5, *positions, *rates])
    links = np.zeros((3, dynamics.LINK_COLUMNS))
    dynamics.move_links(parents, joints, com, state, links)
    for j in range(2):
        answer = p.getLinkState(body, j, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=client)
        ours = links[j + 1]
        assert ours[:3] == pytest.approx(answer[4], abs=1e-6)
        rotation = ours[3:12].reshape(3, 3)
        assert rotation.ravel() == pytest.approx(p.getMatrixFromQuaternion(answer[5]), abs=1e-6)
        # pybullet keeps its frames of links in single precision, and tells the velocity of the centre of mass
        arm = rotation @ urdf.links[j + 1].com_m
        assert ours[12:15] + np.cross(ours[15:18], arm) == pytest.approx(answer[6], abs=1e-6)
        assert ours[15:18] == pytest.approx(answer[7], abs=1e-6)
    p.disconnect(client)


def test_a_force_pushes_a_slide_by_its_part_along_the_axis(urdf: Urdf) -> None:
    # Power of a force equals that of what the joints and the root feel of it: virtual work, at any velocity.
    parents, joints, com = _assembly(urdf)
    rng = np.random.default_rng(4)
    links = np.zeros((3, dynamics.LINK_COLUMNS))
    for _ in range(20):
        axis = rng.normal(size=4)
        state = np.array(
            [*rng.normal(size=3), *(axis / np.linalg.norm(axis)), *rng.normal(size=6), *rng.normal(size=4)]
        )
        dynamics.move_links(parents, joints, com, state, links)
        link = links[2]
        arm, force = rng.normal(size=3), rng.normal(size=3)
        loads = np.zeros(8)
        point = tuple((link[:3] + arm).tolist())
        dynamics._add_force(parents, joints, links, 2, point, tuple(force.tolist()), state[:3], loads)
        velocity = link[12:15] + np.cross(link[15:18], arm)
        power = loads[:3] @ state[7:10] + loads[3:6] @ state[10:13] + loads[6:] @ state[15:17]
        assert power == pytest.approx(force @ velocity, rel=1e-9, abs=1e-12)


def test_a_fixed_root_stays_and_its_slide_falls_freely(urdf: Urdf) -> None:
    body = PhysicsBody(urdf.path, 0.002, fixed=True)
    body.place(np.zeros(3), np.zeros(3))
    state = np.zeros(13 + 4)
    body.read(state)
    for _ in range(100):
        # the hinge is held still, the slide is free
        body.step(state, [0.0] * 8, [0.0, 0.0], [1e6, 0.0])
    axis = rotation_from_rpy(0.1, 0.2, 0.3) @ rotation_from_rpy(0.3, 0.0, 0.1) @ np.array([0.0, 0.0, 1.0])
    assert state[7:13] == pytest.approx(np.zeros(6), abs=1e-12)
    assert state[16] == pytest.approx(-G * axis[2] * 0.2, rel=1e-3)
    body.close()


def test_what_a_servo_holds_loads_the_wheels_as_if_it_were_rigid(tmp_path: Path) -> None:
    wheels = "".join(
        f'<link name="w{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
        f'<joint name="j{k}" type="continuous"><parent link="base"/><child link="w{k}"/><origin xyz="{x} {y} 0"/>'
        f'<axis xyz="0 1 0"/></joint>'
        for k, (x, y) in enumerate([(0, 0.5), (0, -0.5), (2, 0)])
    )
    path = tmp_path / "cart.urdf"
    path.write_text(
        '<robot name="cart"><link name="base"><inertial><origin xyz="1 0 0"/><mass value="10"/>'
        '<inertia ixx="1" iyy="1" izz="1"/></inertial>'
        '</link><link name="tool"><inertial><mass value="4"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
        '<joint name="lift" type="prismatic"><parent link="base"/><child link="tool"/><origin xyz="-1 0 0"/>'
        f'<axis xyz="0 0 1"/></joint>{wheels}</robot>'
    )
    urdf = read_urdf(path)
    loads = static_loads(urdf, ["j0", "j1", "j2"], ["lift"])
    # about the axle: 10 kg at 1 m less the tool's 4 kg at -1 m, on the wheel at 2 m, which carries its own kilogram too
    assert loads == pytest.approx([G * (17.0 - 4.0) / 2.0, G * (17.0 - 4.0) / 2.0, G * (3.0 + 1.0)], rel=1e-9)


def test_other_joints_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "planar.urdf"
    path.write_text(_URDF.replace('type="prismatic"', 'type="planar"'))
    with pytest.raises(Exception, match="planar; expected revolute, continuous or prismatic"):
        read_urdf(path)
