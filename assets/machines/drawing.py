"""What the machines' drawings are made of: simple meshes, and a URDF writer. Used by the build scripts beside it.

Lengths in m, masses in kg. Frames: x forward, y left, z up.
"""

# ruff: noqa: D101, D102, D103, PLR0917 (a drawing: names and coordinates)
from __future__ import annotations

import math
import struct
from pathlib import Path


def numbers(*values: float) -> str:
    return " ".join(f"{value:.6g}" for value in values)


# --- meshes ----------------------------------------------------------------------------------------------------------


def write_stl(path: Path, triangles: list[tuple[tuple[float, ...], ...]]) -> None:
    """Binary STL with facet normals."""
    with path.open("wb") as file:
        file.write(path.stem.encode().ljust(80, b" ") + struct.pack("<I", len(triangles)))
        for a, b, c in triangles:
            u = [b[k] - a[k] for k in range(3)]
            v = [c[k] - a[k] for k in range(3)]
            n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
            size = math.sqrt(sum(x * x for x in n)) or 1.0
            file.write(struct.pack("<12fH", *(x / size for x in n), *a, *b, *c, 0))


def revolve(profile: list[tuple[float, float]], segments: int) -> list:
    """Surface of revolution about y of a closed (radius, y) profile, given counter-clockwise seen from +phi."""

    def point(radius: float, y: float, step: int) -> tuple[float, float, float]:
        angle = 2.0 * math.pi * step / segments
        return radius * math.cos(angle), y, radius * math.sin(angle)

    triangles = []
    for (r0, y0), (r1, y1) in zip(profile, profile[1:] + profile[:1], strict=True):
        for step in range(segments):
            a, b = point(r0, y0, step), point(r1, y1, step)
            c, d = point(r1, y1, step + 1), point(r0, y0, step + 1)
            if r0 > 0.0:
                triangles.append((a, c, d))
            if r1 > 0.0:
                triangles.append((a, b, c))
    return triangles


def block(corners: list[tuple[float, float, float]]) -> list:
    """Hexahedron: four corners of the base, then the four above them."""
    a, b, c, d, e, f, g, h = corners
    quads = [(d, c, b, a), (e, f, g, h), (a, b, f, e), (b, c, g, f), (c, d, h, g), (d, a, e, h)]
    return [t for p, q, r, s in quads for t in ((p, q, r), (p, r, s))]


def lugs(radius: float, width: float, count: int, height: float) -> list:
    """Chevron bars of a traction tyre."""
    triangles = []
    for side in (-1.0, 1.0):
        for index in range(count):
            start = 2.0 * math.pi * (index + (0.5 if side > 0 else 0.0)) / count
            sweep, thick = 0.62 * 2.0 * math.pi / count * 1.6, 0.30 * 2.0 * math.pi / count

            def at(angle: float, r: float, y: float) -> tuple[float, float, float]:
                return r * math.cos(angle), y, r * math.sin(angle)

            inner, outer = 0.01 * side, 0.50 * width * side
            low, high = radius - 2.2 * height, radius
            base = [
                at(start, low, inner),
                at(start + thick, low, inner),
                at(start + thick + sweep, low - height, outer),
                at(start + sweep, low - height, outer),
            ]
            top = [
                at(start, high, inner),
                at(start + thick, high, inner),
                at(start + thick + sweep, high - 0.6 * height, outer),
                at(start + sweep, high - 0.6 * height, outer),
            ]
            triangles += block(base + top if side > 0 else [*base[::-1], *top[::-1]])
    return triangles


def tyre_profile(radius: float, width: float, rim: float) -> list[tuple[float, float]]:
    half = 0.5 * width
    return [
        (rim, -0.72 * half),
        (0.5 * (rim + radius), -half),
        (0.93 * radius, -0.92 * half),
        (radius, -0.55 * half),
        (radius, 0.55 * half),
        (0.93 * radius, 0.92 * half),
        (0.5 * (rim + radius), half),
        (rim, 0.72 * half),
    ]


def rim_mesh(rim: float, width: float, spokes: int, outward: float) -> list:
    """Dish with holes between spokes, so that the turning shows."""
    half = 0.5 * width
    triangles = revolve(
        [(0.90 * rim, -0.72 * half), (1.01 * rim, -0.74 * half), (1.01 * rim, 0.74 * half), (0.90 * rim, 0.72 * half)],
        36,
    )
    y0, y1 = 0.10 * half * outward, 0.34 * half * outward
    low, high = min(y0, y1), max(y0, y1)
    triangles += revolve(
        [
            (0.0, low - 0.10 * half),
            (0.34 * rim, low - 0.10 * half),
            (0.34 * rim, high + 0.12 * half),
            (0.0, high + 0.12 * half),
        ],
        24,
    )
    for index in range(spokes):
        angle = 2.0 * math.pi * index / spokes
        wide_in, wide_out = 0.60 * math.pi / spokes, 0.42 * math.pi / spokes

        def at(turn: float, r: float, y: float, angle: float = angle) -> tuple[float, float, float]:
            return r * math.cos(angle + turn), y, r * math.sin(angle + turn)

        corners = [
            at(-wide_in, 0.30 * rim, low),
            at(-wide_out, 0.93 * rim, low),
            at(wide_out, 0.93 * rim, low),
            at(wide_in, 0.30 * rim, low),
        ]
        above = [
            at(-wide_in, 0.30 * rim, high),
            at(-wide_out, 0.93 * rim, high),
            at(wide_out, 0.93 * rim, high),
            at(wide_in, 0.30 * rim, high),
        ]
        triangles += block(corners + above)
    return triangles


def prism(outline: list[tuple[float, float]], y0: float, y1: float, taper: float = 1.0) -> list:
    """Extrude a convex (x, z) outline, given counter-clockwise seen from -y, along y."""
    left = [(x, y0, z) for x, z in outline]
    right = [(x, y1, z) for x, z in outline]
    if taper != 1.0:
        raise ValueError("not tapered")
    triangles = []
    for i in range(1, len(outline) - 1):
        triangles.append((left[0], left[i], left[i + 1]))
        triangles.append((right[0], right[i + 1], right[i]))
    for i in range(len(outline)):
        j = (i + 1) % len(outline)
        triangles += [(left[i], right[i], right[j]), (left[i], right[j], left[j])]
    return triangles


def frustum(bottom: tuple[float, float], top: tuple[float, float], z0: float, z1: float, x0: float = 0.0) -> list:
    """Four-sided funnel: half sizes (x, y) at the bottom and at the top."""

    def ring(half: tuple[float, float], z: float) -> list[tuple[float, float, float]]:
        hx, hy = half
        return [(x0 - hx, -hy, z), (x0 + hx, -hy, z), (x0 + hx, hy, z), (x0 - hx, hy, z)]

    return block(ring(bottom, z0) + ring(top, z1))


# --- URDF ------------------------------------------------------------------------------------------------------------


class Builder:
    def __init__(self, robot: str, colours: dict[str, tuple[float, float, float]]) -> None:
        self.robot = robot
        self.lines = [
            '<?xml version="1.0"?>',
            f"<!-- Written by build_{robot}.py: change the figures there. -->",
            f'<robot name="{robot}">',
        ]
        for name, rgb in colours.items():
            self.lines.append(f'  <material name="{name}"><color rgba="{numbers(*rgb)} 1"/></material>')

    def link(self, name: str, mass: float, com: tuple, inertia: tuple, visuals: list[str]) -> None:
        ixx, iyy, izz = inertia
        self.lines += [
            f'  <link name="{name}">',
            f'    <inertial><origin xyz="{numbers(*com)}"/><mass value="{mass:g}"/>',
            f'      <inertia ixx="{ixx:g}" iyy="{iyy:g}" izz="{izz:g}" ixy="0" ixz="0" iyz="0"/></inertial>',
            *visuals, "  </link>",
        ]  # fmt: skip

    def joint(self, name: str, parent: str, child: str, xyz: tuple, axis: tuple, limit: float | None = None) -> None:
        kind = "continuous" if limit is None else "revolute"
        bounds = "" if limit is None else f'<limit lower="{-limit:g}" upper="{limit:g}" effort="1e6" velocity="100"/>'
        self.lines.append(
            f'  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{numbers(*xyz)}"/><axis xyz="{numbers(*axis)}"/>{bounds}</joint>'
        )

    def slide(self, name: str, parent: str, child: str, xyz: tuple, lowest: float, highest: float) -> None:
        """A prismatic joint along z."""
        self.lines.append(
            f'  <joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{numbers(*xyz)}"/><axis xyz="0 0 1"/>'
            f'<limit lower="{lowest:g}" upper="{highest:g}" effort="1e6" velocity="100"/></joint>'
        )

    def write(self, folder: Path, meshes: dict[str, list]) -> None:
        """Write ROBOT.urdf into ``folder``, and its meshes into a folder of its name beside it."""
        below = folder / self.robot
        if meshes:
            below.mkdir(exist_ok=True)
        for name, triangles in meshes.items():
            write_stl(below / f"{name}.stl", triangles)
        (folder / f"{self.robot}.urdf").write_text("\n".join([*self.lines, "</robot>", ""]))


def shape(colour: str, geometry: str, xyz: tuple = (0, 0, 0), rpy: tuple = (0, 0, 0)) -> str:
    return (
        f'    <visual><origin xyz="{numbers(*xyz)}" rpy="{numbers(*rpy)}"/><geometry>{geometry}</geometry>'
        f'<material name="{colour}"/></visual>'
    )


def box(colour: str, size: tuple, xyz: tuple, rpy: tuple = (0, 0, 0)) -> str:
    return shape(colour, f'<box size="{numbers(*size)}"/>', xyz, rpy)


def rod(colour: str, radius: float, length: float, xyz: tuple, rpy: tuple = (0, 0, 0)) -> str:
    return shape(colour, f'<cylinder radius="{radius:g}" length="{length:g}"/>', xyz, rpy)


def mesh(colour: str, path: str, xyz: tuple = (0, 0, 0), rpy: tuple = (0, 0, 0)) -> str:
    return shape(colour, f'<mesh filename="{path}.stl"/>', xyz, rpy)


def wheel_visuals(folder: str, kind: str, rim_colour: str, side: float) -> list[str]:
    """Meshes ``KINDtyre`` and ``KINDrim``; ``side`` is -1 for a wheel whose outside is its right."""
    turn = (0, 0, 0) if side > 0 else (0, 0, math.pi)
    return [mesh("tyre", f"{folder}/{kind}tyre", rpy=turn), mesh(rim_colour, f"{folder}/{kind}rim", rpy=turn)]
