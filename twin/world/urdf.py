"""Reads a machine's URDF: links with mass properties, joints as a tree.

Only what our machines use is allowed: one root, revolute, continuous and prismatic joints (rigid parts are visuals of
a link, or mounts), inertial frames parallel to the link frame and without products of inertia.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from twin.errors import BadInputError
from twin.geometry import rotation_from_rpy
from twin.signals import FloatArray

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A rigid body: mass, centre of mass in the link frame, principal moments of inertia about it."""

    name: str
    mass_kg: float
    com_m: Triple
    inertia_kg_m2: Triple


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A hinge or a slide: ``origin`` places the child's frame in the parent's at zero; the axis is the child's."""

    name: str
    parent: str
    child: str
    origin_m: Triple
    origin_rpy: Triple
    axis: Triple
    slides: bool
    """Whether the child is pushed along the axis, instead of turned about it."""

    @property
    def column(self) -> str:
        """Name of its position in the truth, with its unit."""
        return f"joint.{self.name}_{'m' if self.slides else 'rad'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Urdf:
    """A machine's bodies: ``links[0]`` is the root and ``links[i + 1]`` hangs on ``joints[i]``, parents first."""

    path: Path
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    @property
    def mass_kg(self) -> float:
        """Mass of the whole machine."""
        return sum(link.mass_kg for link in self.links)

    def link_index(self, name: str) -> int:
        """Index of a link by name."""
        return [link.name for link in self.links].index(name)

    def joint_index(self, name: str) -> int:
        """Index of a joint by name."""
        return [joint.name for joint in self.joints].index(name)

    def parent_indices(self) -> list[int]:
        """Link index of each joint's parent."""
        return [self.link_index(joint.parent) for joint in self.joints]

    def zero_pose(self, link: str) -> tuple[FloatArray, FloatArray]:
        """Position (3,) and rotation (3, 3) of a link in the root's frame, with every joint at zero."""
        position, rotation = np.zeros(3), np.eye(3)
        by_child = {joint.child: joint for joint in self.joints}
        while link in by_child:
            joint = by_child[link]
            turn = rotation_from_rpy(*joint.origin_rpy)
            position = np.array(joint.origin_m) + turn @ position
            rotation = turn @ rotation
            link = joint.parent
        return position, rotation


@lru_cache(maxsize=16)
def read_urdf(path: Path) -> Urdf:
    """Read and check a URDF file.

    Raises:
        BadInputError: the file is missing, is not XML, or uses what the simulation does not model.
    """
    try:
        root = ET.parse(path).getroot()  # noqa: S314 (an asset of this package)
    except (OSError, ET.ParseError) as error:
        raise BadInputError(f"{path}: cannot be read as a URDF ({error})") from error
    links = {element.attrib["name"]: _link(element, path) for element in root.findall("link")}
    joints = [_joint(element, path) for element in root.findall("joint")]
    children = {joint.child for joint in joints}
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        raise BadInputError(f"{path}: expected one root link, found {', '.join(roots) or 'none'}")
    ordered_links, ordered_joints = [links[roots[0]]], []
    reached = roots
    while reached:
        parent = reached.pop(0)
        for joint in joints:
            if joint.parent == parent:
                ordered_joints.append(joint)
                ordered_links.append(links[joint.child])
                reached.append(joint.child)
    return Urdf(path=path, links=tuple(ordered_links), joints=tuple(ordered_joints))


def _triple(text: str) -> Triple:
    x, y, z = (float(word) for word in text.split())
    return x, y, z


def _origin(element: ET.Element | None) -> tuple[Triple, Triple]:
    origin = None if element is None else element.find("origin")
    attributes = {} if origin is None else origin.attrib
    return _triple(attributes.get("xyz", "0 0 0")), _triple(attributes.get("rpy", "0 0 0"))


def _link(element: ET.Element, path: Path) -> Link:
    name = element.attrib["name"]
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    tensor = None if inertial is None else inertial.find("inertia")
    if inertial is None or mass is None or tensor is None:
        raise BadInputError(f"{path}: link {name!r} has no mass or inertia")
    com, rpy = _origin(inertial)
    x, y, z = (float(tensor.attrib[key]) for key in ("ixx", "iyy", "izz"))
    products = [float(tensor.attrib.get(key, "0")) for key in ("ixy", "ixz", "iyz")]
    if any(rpy) or any(products):
        raise BadInputError(f"{path}: link {name!r}: the inertial frame has to be parallel to the link frame")
    # pybullet sets an inertia that breaks this to zero, with no more than a line on stderr.
    if min(x, y, z) <= 0.0 or x + y < z or y + z < x or z + x < y:
        raise BadInputError(f"{path}: link {name!r}: moments of inertia {x:g}, {y:g}, {z:g} cannot belong to a body")
    return Link(name=name, mass_kg=float(mass.attrib["value"]), com_m=com, inertia_kg_m2=(x, y, z))


def _joint(element: ET.Element, path: Path) -> Joint:
    name, kind = element.attrib["name"], element.attrib["type"]
    if kind not in {"revolute", "continuous", "prismatic"}:
        raise BadInputError(f"{path}: joint {name!r} is {kind}; expected revolute, continuous or prismatic")
    parent, child, axis = element.find("parent"), element.find("child"), element.find("axis")
    if parent is None or child is None or axis is None:
        raise BadInputError(f"{path}: joint {name!r} lacks parent, child or axis")
    direction = _triple(axis.attrib["xyz"])
    if not math.isclose(math.hypot(*direction), 1.0, rel_tol=1e-9):
        raise BadInputError(f"{path}: joint {name!r}: the axis has to have length one")
    origin_m, origin_rpy = _origin(element)
    return Joint(
        name=name,
        parent=parent.attrib["link"],
        child=child.attrib["link"],
        origin_m=origin_m,
        origin_rpy=origin_rpy,
        axis=direction,
        slides=kind == "prismatic",
    )
