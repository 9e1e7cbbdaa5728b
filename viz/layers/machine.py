"""The machine: its URDF, moved by the true pose of its root link and its true joint angles."""

from __future__ import annotations

import numpy as np
import rerun as rr

from twin.geometry import quaternion_from_rpy, rotation_from_quaternion
from twin.signals import FloatArray, IntArray
from viz import entities
from viz.sheet import Run, Sheet
from viz.thinning import steps, thin

POSE_HZ = 50.0
"""Enough for smooth motion at the viewer's frame rate."""

_BASE = ("base_e_m", "base_n_m", "base_u_m")
_QUATERNION = ("base_qx", "base_qy", "base_qz", "base_qw")
_STILL = 1e-4
"""A machine that moves less than this (m, rad, quaternion) is not drawn anew: a tenth of a millimetre."""
_EYE = np.array([-0.70, 0.585, 0.405])
"""From what the camera looks at to where it stands at the start: behind, to the left, above."""
_EYE_DIAGONALS, _BESIDE_MAGNETS = 1.08, 1.8
"""Distance of the camera in diagonals of the machine, and how many times that where magnets lie about."""
_EYE_IN_LANE, _LOOK_IN_LANE = np.array([-1.0, 0.18, 0.62]), np.array([0.55, 0.0, 0.0])
"""Between rows of trees: where the camera stands and where it looks, ahead, left and above of the machine, in units of
a distance that shows the rows on both sides."""
_LANE_HALVES, _FEWEST, _MOST = 1.4, 2.0, 6.0
"""That distance in half widths of the lane, and its least and most in diagonals of the machine."""
_EYE_AT_BENCH, _BENCH_HEIGHTS = np.array([1.0, 0.55, 0.28]), 2.1
"""Of a bench, from what the camera looks at to where it stands, in front of it; and how far off, in heights of its
plate above the ground."""
_EYE_AT_FIELD, _FIELD_DIAGONALS = np.array([-0.70, 0.46, 0.55]), 1.7
"""The same of a machine that levels a field: higher and farther off, so that some of the field is seen."""
_SET_OFF_M = 0.02
"""A machine that is so far from where it began has set off."""
_LOOK_FROM_BACK, _LOOK_M = 0.28, 0.8
"""The camera looks at a point of the machine's middle line, nearer its back, where its tools work, and at this height
(times the scale of the scene), from as many diagonals of the machine away."""
_Frames = tuple[str, str]
"""Names of parent and child frame."""


def joint_column(joint: str, kind: str) -> str:
    """Truth column of a joint's angle or, for a ``prismatic`` one, of its way."""
    return f"joint.{joint}_m" if kind == "prismatic" else f"joint.{joint}_rad"


def draw_machine(run: Run, sheet: Sheet) -> None:
    """Draw the machine moving, with its joints turning; needs the truth's base pose and a URDF.

    The base pose is that of the root link's frame (not of its centre of mass). Joints of which the truth has no column
    stay at zero.
    """
    truth, urdf = run.truth, run.scene.urdf
    if truth is None or urdf is None:
        return
    position, quaternion = run.columns(truth, *_BASE), run.columns(truth, *_QUATERNION)
    if position is None or quaternion is None:
        return
    tree = rr.urdf.UrdfTree.from_file_path(urdf, entity_path_prefix=entities.WORLD)
    tree.log_urdf_to_recording(sheet.stream)
    sheet.hidden.append(entities.collision_geometries(tree.name))
    keep = thin(truth.t_ns, POSE_HZ)
    moved = keep[steps(np.column_stack([position, quaternion])[keep], _STILL)]
    # `tf#/world` is the frame that the entity `world` stands for: there URDF frames and entities meet.
    frames = (f"tf#/{entities.WORLD}", tree.root_link().name)
    _send_pose(
        sheet,
        entities.base_pose(),
        truth.t_ns[moved],
        translation=position[moved],
        quaternion=quaternion[moved],
        frames=frames,
    )
    for joint in tree.joints():
        column = joint_column(joint.name, joint.joint_type)
        if truth.has(column):
            _draw_joint(sheet, joint, truth.t_ns[keep], run.column(truth, column)[keep])
    sheet.rows(entities.FOCUS, truth.t_ns[moved], rr.Points3D.columns(positions=position[moved]))
    sheet.static(entities.FOCUS, rr.Points3D.from_fields(radii=0.01, colors=[(0, 0, 0)]))
    # A followed point is what the camera looks at; of a bench it would be the foot.
    sheet.follow = None if run.scene.bench else entities.FOCUS
    sheet.eye = _seen_from_behind(run, position[0], quaternion[0])
    sheet.begin_ns = sets_off_ns(truth.t_ns, position)


def sets_off_ns(t_ns: IntArray, position: FloatArray) -> int:
    """When plots begin that are to show what happens: 0, or shortly before a machine sets off that stood for long.

    For a drive that follows a stand of more than half of the run, a tenth of the drive before it.
    """
    away = np.flatnonzero(np.linalg.norm(position - position[0], axis=1) > _SET_OFF_M)
    if not len(away):
        return 0
    off, end = int(t_ns[away[0]]), int(t_ns[-1])
    return max(0, off - (end - off) // 10) if 2 * off > end else 0


def _draw_joint(sheet: Sheet, joint: rr.urdf.UrdfJoint, t_ns: IntArray, value: FloatArray) -> None:
    """Send one joint's transform at every change; the SDK's own columns say the same, but take 20 ms per joint."""
    at = steps(value[:, np.newaxis], _STILL)
    translation, quaternion = joint_transform(joint, value[at])
    frames = (joint.parent_link, joint.child_link)
    entity = entities.joint(joint.name)
    _send_pose(sheet, entity, t_ns[at], translation=translation, quaternion=quaternion, frames=frames)


def _send_pose(
    sheet: Sheet, entity: str, t_ns: IntArray, *, translation: FloatArray, quaternion: FloatArray, frames: _Frames
) -> None:
    """Send poses of a child frame in its parent; the names go with every row, since the URDF has static ones."""
    parent, child = frames
    columns = rr.Transform3D.columns(
        translation=translation,
        quaternion=quaternion,
        parent_frame=[parent] * len(t_ns),
        child_frame=[child] * len(t_ns),
    )
    sheet.rows(entity, t_ns, columns)


def joint_transform(joint: rr.urdf.UrdfJoint, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Child link in the parent link at joint values (T,): translations (T, 3) m, quaternions (T, 4) xyzw."""
    axis = np.asarray(joint.axis, dtype=np.float64)
    axis = axis / np.linalg.norm(axis)
    roll, pitch, yaw = joint.origin_rpy
    origin = quaternion_from_rpy(roll, pitch, yaw)
    translation = np.tile(np.asarray(joint.origin_xyz, dtype=np.float64), (len(value), 1))
    if joint.joint_type == "prismatic":
        along = rotation_from_quaternion(origin) @ axis
        return translation + value[:, np.newaxis] * along, np.tile(origin, (len(value), 1))
    # Hamilton product of the origin's rotation and (axis sin(a/2), cos(a/2)).
    vector, scalar = np.sin(value / 2.0)[:, np.newaxis] * axis, np.cos(value / 2.0)[:, np.newaxis]
    turned = origin[3] * vector + scalar * origin[:3] + np.cross(origin[:3], vector)
    return translation, np.hstack([turned, origin[3] * scalar - vector @ origin[:3, np.newaxis]])


def _seen_from_behind(run: Run, position: FloatArray, quaternion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eye and look target of a camera behind the machine, as far off as its size asks for."""
    (back, right), (front, left) = run.scene.footprint_m
    look = np.array([back + _LOOK_FROM_BACK * (front - back), 0.5 * (left + right), _LOOK_M * run.scene.scale])
    x, y, z, w = quaternion
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    level = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    if len(run.scene.trunks):
        ahead = (run.scene.trunks[:, :2] - position[:2]) @ level[:2, :2]
        half = float(np.median(np.abs(ahead[:, 1])))
        size = run.scene.machine_size_m
        distance = min(max(_LANE_HALVES * half, _FEWEST * size), _MOST * size)
        return position + level @ (distance * _EYE_IN_LANE), position + level @ (distance * _LOOK_IN_LANE)
    target = position + level @ look
    if run.scene.bench:
        return _seen_from_front(run, position, level)
    if run.scene.levelling.area_m is not None:
        return target + level @ (_FIELD_DIAGONALS * run.scene.machine_size_m * _EYE_AT_FIELD), target
    distance = _EYE_DIAGONALS * run.scene.machine_size_m * (_BESIDE_MAGNETS if run.scene.magnetic.count else 1.0)
    return target + level @ (distance * _EYE), target


def _seen_from_front(run: Run, position: FloatArray, level: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eye and look target of a camera in front of a bench, which stands upright."""
    height = max(run.scene.levelling.design_height_m - float(position[2]), run.scene.machine_size_m / 3.0)
    target = position + np.array([0.0, 0.0, height])
    return target + level @ (_BENCH_HEIGHTS * height * _EYE_AT_BENCH), target
