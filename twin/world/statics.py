"""What each wheel carries when a machine stands on level ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.errors import BadInputError
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import FloatArray
from twin.world.urdf import Urdf


def static_loads(urdf: Urdf, wheel_joints: Sequence[str], carried_joints: Sequence[str] = ()) -> FloatArray:
    """Wheel loads, N, of a machine standing level with all joints at zero.

    Virtual work: the vertical forces of weights and wheels must do none when the root heaves, rolls or pitches, nor
    when any joint moves, but for ``carried_joints``, whose springs or servos do. Where that leaves freedom (four wheels
    in a row) the loads of least squares are taken.

    Raises:
        BadInputError: the wheels cannot carry the machine.
    """
    weight, lifts = _balance(urdf, wheel_joints)
    free = np.ones(len(weight), dtype=bool)
    free[[3 + urdf.joint_index(joint) for joint in carried_joints]] = False
    loads: FloatArray = np.asarray(np.linalg.lstsq(lifts[free], weight[free], rcond=None)[0], dtype=np.float64)
    if np.abs(lifts[free] @ loads - weight[free]).max() > 1e-6 * weight[0] or loads.min() <= 0.0:
        raise BadInputError(f"{urdf.path}: the machine cannot stand on its wheels (loads {np.round(loads)} N)")
    return loads


def spring_preloads(
    urdf: Urdf, wheel_joints: Sequence[str], sprung_joints: Sequence[str], loads_n: FloatArray
) -> FloatArray:
    """Moments, N m, of the sprung joints' springs that hold the machine at zero angles on these wheel loads."""
    weight, lifts = _balance(urdf, wheel_joints)
    moments: FloatArray = (weight - lifts @ loads_n)[[3 + urdf.joint_index(joint) for joint in sprung_joints]]
    return moments


def _balance(urdf: Urdf, wheel_joints: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Work against the weight, and work of a unit load of each wheel, per unit of heave, roll, pitch and each joint."""
    places = [_Place(urdf, link.name) for link in urdf.links]
    weight = np.zeros(3 + len(urdf.joints))
    for link, place in zip(urdf.links, places, strict=True):
        weight += link.mass_kg * STANDARD_GRAVITY_M_S2 * _work(urdf, places, link.name, place.point(link.com_m))
    hubs = [urdf.links[urdf.joint_index(joint) + 1].name for joint in wheel_joints]
    lifts = np.column_stack([_work(urdf, places, hub, places[urdf.link_index(hub)].position) for hub in hubs])
    return weight, lifts


class _Place:
    """A link's frame in the root's, all joints at zero."""

    def __init__(self, urdf: Urdf, link: str) -> None:
        self.position, self._rotation = urdf.zero_pose(link)

    def point(self, xyz_m: Sequence[float]) -> FloatArray:
        """Position of a point of the link."""
        return np.asarray(self.position + self._rotation @ np.array(xyz_m), dtype=np.float64)

    def direction(self, xyz: Sequence[float]) -> FloatArray:
        """Direction fixed to the link."""
        return np.asarray(self._rotation @ np.array(xyz), dtype=np.float64)


def _work(urdf: Urdf, places: Sequence[_Place], link: str, point: FloatArray) -> FloatArray:
    """Work of a unit upward force at a point of a link, per unit of heave, roll, pitch and each joint's motion."""
    work = np.zeros(3 + len(urdf.joints))
    work[:3] = 1.0, point[1], -point[0]
    by_child = {joint.child: index for index, joint in enumerate(urdf.joints)}
    while link in by_child:
        index = by_child[link]
        place = places[index + 1]
        arm = point - place.position
        lift = np.array([0.0, 0.0, 1.0] if urdf.joints[index].slides else [arm[1], -arm[0], 0.0])
        work[3 + index] = place.direction(urdf.joints[index].axis) @ lift
        link = urdf.joints[index].parent
    return work
