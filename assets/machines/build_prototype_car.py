"""Writes prototype_car.urdf and the meshes beside it: run it after changing a figure here.

    python assets/machines/build_prototype_car.py

Lengths in m, masses in kg. Frames: x forward, y left, z up; the root's origin is the middle of the rear axle.
"""

# ruff: noqa: D103 (a drawing: names and coordinates)
from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import drawing
from drawing import Builder, block, box, prism, revolve, rim_mesh, rod, tyre_profile, wheel_visuals

HERE = Path(__file__).resolve().parent

COLOURS = {
    "paint": (0.62, 0.10, 0.12), "dark": (0.10, 0.10, 0.11), "glass": (0.30, 0.42, 0.50), "rim": (0.78, 0.79, 0.80),
    "steel": (0.55, 0.57, 0.60), "tyre": (0.07, 0.07, 0.075), "light": (1.0, 0.96, 0.82),
    "rear_light": (0.85, 0.05, 0.05), "plate": (0.95, 0.95, 0.92), "sensor": (0.10, 0.45, 0.85),
    "antenna": (0.96, 0.96, 0.96),
}  # fmt: skip

RADIUS, WIDTH, RIM = 0.316, 0.205, 0.215
WHEELBASE, TRACK = 2.65, 1.52
AXLE_HEIGHT = RADIUS - 0.019  # static deflection of the tyres
ARM, PIVOT_HEIGHT = 1.5, 0.12
UNITS_Y = (1.2, 0.4, -0.4, -1.2)
BAR_Z = 1.30
HALF = 0.86
"""Half of the body's width."""


def mesh(colour: str, name: str) -> str:
    """Body meshes are drawn with z counted from the ground."""
    return drawing.mesh(colour, f"prototype_car/{name}", (0, 0, -AXLE_HEIGHT))


def on_ground(colour: str, size: tuple, xyz: tuple, rpy: tuple = (0, 0, 0)) -> str:
    """A box whose z counts from the ground."""
    x, y, z = xyz
    return box(colour, size, (x, y, z - AXLE_HEIGHT), rpy)


def arch(centre_x: float) -> list:
    """Panel around a wheel opening, on both sides: from the opening's circle to the rectangle that it is cut from."""
    inner, half_length, height = 0.365, 0.47, 0.72 - AXLE_HEIGHT
    corner = math.atan2(height, half_length)
    angles = sorted({*(math.radians(d) for d in range(0, 181, 15)), corner, math.pi - corner})
    triangles = []
    for side in (-1.0, 1.0):
        y0, y1 = sorted((side * 0.64, side * HALF))
        for a, b in pairwise(angles):
            corners = []
            for angle in (a, b):
                c, s = math.cos(angle), math.sin(angle)
                far = min(half_length / max(abs(c), 1e-9), height / max(s, 1e-9))
                corners.append([(centre_x + r * c, AXLE_HEIGHT + r * s) for r in (inner, far)])
            (i0, o0), (i1, o1) = corners
            triangles += prism([i0, o0, o1, i1], y0, y1)
    return triangles


def tapered(bottom: list[tuple], top: list[tuple], inset: float, half: float) -> list:
    """Two (x, z) points below and two above, as wide as ``half`` below and narrower by ``inset`` above."""
    (x0, z0), (x1, z1) = bottom
    (x2, z2), (x3, z3) = top
    low, high = half, half - inset
    below = [(x0, -low, z0), (x1, -low, z1), (x1, low, z1), (x0, low, z0)]
    return block([*below, (x2, -high, z2), (x3, -high, z3), (x3, high, z3), (x2, high, z2)])


def pillar(bottom: tuple, top: tuple, width: float) -> list:
    """A post of the cabin on both sides."""
    triangles = []
    for side in (-1.0, 1.0):
        corners = []
        for (x, z), y in ((bottom, 0.76), (top, 0.58)):
            right, left = sorted((side * y, side * (y + 0.065)))
            corners += [(x, right, z), (x + width, right, z), (x + width, left, z), (x, left, z)]
        triangles += block(corners)
    return triangles


def meshes() -> dict[str, list]:
    shell = [(-0.76, 0.72), (3.48, 0.72), (3.45, 0.80), (2.48, 0.98), (-0.70, 1.02)]
    sills = prism([(0.47, 0.22), (WHEELBASE - 0.47, 0.22), (WHEELBASE - 0.47, 0.72), (0.47, 0.72)], -HALF, HALF)
    front = [(WHEELBASE + 0.47, 0.22), (3.46, 0.25), (3.52, 0.45), (3.48, 0.72), (WHEELBASE + 0.47, 0.72)]
    rear = [(-0.78, 0.45), (-0.72, 0.28), (-0.47, 0.25), (-0.47, 0.72), (-0.76, 0.72)]
    return {
        "body": prism(shell, -HALF, HALF) + sills + prism(front, -HALF, HALF) + prism(rear, -HALF, HALF)
        + arch(0.0) + arch(WHEELBASE),
        "glass": tapered([(-0.64, 1.01), (2.36, 0.98)], [(-0.34, 1.44), (1.50, 1.44)], 0.18, 0.80),
        "roof": tapered([(-0.42, 1.43), (1.54, 1.43)], [(-0.36, 1.49), (1.40, 1.49)], 0.04, 0.66)
        + pillar((2.30, 0.98), (1.44, 1.45), 0.09) + pillar((0.92, 0.99), (0.78, 1.45), 0.09)
        + pillar((-0.70, 1.01), (-0.40, 1.45), 0.22),
        "tyre": revolve(tyre_profile(RADIUS, WIDTH, RIM), 48),
        "rim": rim_mesh(RIM, WIDTH, 5, 2.2),
    }  # fmt: skip


def car_visuals() -> list[str]:
    parts = [
        mesh("paint", "body"), mesh("glass", "glass"), mesh("paint", "roof"),
        on_ground("dark", (4.05, 1.20, 0.40), (1.36, 0, 0.42)),
        on_ground("dark", (0.04, 0.95, 0.13), (3.49, 0, 0.60)), on_ground("dark", (0.04, 1.30, 0.10), (3.49, 0, 0.36)),
        on_ground("plate", (0.02, 0.52, 0.11), (-0.785, 0, 0.56)),
        on_ground("plate", (0.02, 0.52, 0.11), (3.53, 0, 0.46)),
    ]  # fmt: skip
    for side in (1, -1):
        parts += [
            on_ground("light", (0.10, 0.30, 0.10), (3.43, 0.66 * side, 0.74)),
            on_ground("rear_light", (0.06, 0.24, 0.20), (-0.735, 0.73 * side, 0.86)),
            on_ground("paint", (0.12, 0.20, 0.14), (1.95, 0.93 * side, 1.02)),
            on_ground("dark", (0.16, 0.015, 0.03), (0.72, 0.865 * side, 0.88)),
            on_ground("dark", (0.16, 0.015, 0.03), (1.72, 0.865 * side, 0.87)),
            on_ground("dark", (0.01, 0.01, 0.60), (0.95, 0.86 * side, 0.70)),
            # feet of the bar, at the roof's edges
            on_ground("steel", (0.10, 0.06, 0.10), (0.0, 0.56 * side, 1.53)),
        ]
    # The bar, one unit above it at each row; the receivers' antennas beside the middle and at row 4.
    parts.append(box("steel", (0.06, 2.56, 0.05), (0, 0, BAR_Z - 0.06)))
    parts += [box("sensor", (0.14, 0.12, 0.07), (0, y, BAR_Z)) for y in UNITS_Y]
    parts += [
        box("dark", (0.10, 0.08, 0.06), (0, 0.1, BAR_Z)),
        rod("antenna", 0.05, 0.04, (0, -0.1, BAR_Z + 0.06)), rod("steel", 0.015, 0.12, (0, -0.1, BAR_Z)),
        rod("antenna", 0.08, 0.06, (0, UNITS_Y[-1], BAR_Z + 0.08)),
        box("sensor", (0.14, 0.12, 0.12), (-0.80, 0, 0.15)),
    ]  # fmt: skip
    return parts


def main() -> None:
    build = Builder("prototype_car", COLOURS)
    # 1500 kg in all: body 1340, four hinged carriers of 15, two knuckles of 10, four wheels of 20. 780 kg stand on the
    # front axle, 90 of them at its wheels: x = (780 - 90) 2.65 / 1340. The whole's centre of mass 0.55 m above ground:
    # (1500 x 0.55 - 160 x 0.297) / 1340 = 0.580. With 372 kg m2 of the wheels' masses, 2270 kg m2 about the vertical.
    build.link("car", 1340, (690 * WHEELBASE / 1340, 0, 0.580 - AXLE_HEIGHT), (450, 1800, 1900), car_visuals())
    for end, axle_x, ahead in (("front", WHEELBASE, -1.0), ("rear", 0.0, 1.0)):
        for side, name in ((1.0, "left"), (-1.0, "right")):
            corner = f"{end}_{name}"
            hub = (-ahead * ARM, 0.0, AXLE_HEIGHT - PIVOT_HEIGHT)
            build.link(f"carrier_{corner}", 15, hub, (0.3, 0.3, 0.3), [])
            pivot = (axle_x + ahead * ARM, side * TRACK / 2, PIVOT_HEIGHT - AXLE_HEIGHT)
            build.joint(f"suspension_{corner}", "car", f"carrier_{corner}", pivot, (0, 1, 0))
            parent, spin = f"carrier_{corner}", 1.2
            # 20 kg spin with 1.2 kg m2; at the rear with the driveline as seen at the axle, about 4 kg m2 a side. The
            # importer needs ixx + izz >= iyy: 2.6 instead of 0.65 kg m2 across are nothing beside 2270.
            across = 0.65
            if end == "front":
                build.link(f"knuckle_{name}", 10, (0, 0, 0), (0.2, 0.2, 0.2), [])
                build.joint(f"steering_{name}", parent, f"knuckle_{name}", hub, (0, 0, 1))
                parent, hub = f"knuckle_{name}", (0.0, 0.0, 0.0)
            else:
                spin, across = 5.2, 2.6
            visuals = wheel_visuals("prototype_car", "", "rim", side)
            build.link(f"hub_{corner}", 20, (0, 0, 0), (across, spin, across), visuals)
            build.joint(f"wheel_{corner}", parent, f"hub_{corner}", hub, (0, 1, 0))
    build.write(HERE, meshes())


if __name__ == "__main__":
    main()
