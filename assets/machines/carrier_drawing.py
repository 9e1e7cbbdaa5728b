"""The carrier of a riding rice transplanter, as the machines on it are drawn. Used by their build scripts.

Lengths in m, masses in kg. Frames: x forward, y left, z up; the root's origin is the middle of the rear axle.
"""

# ruff: noqa: D103 (a drawing: names and coordinates)
from __future__ import annotations

import math

import drawing
from drawing import Builder, box, lugs, prism, revolve, rim_mesh, rod, wheel_visuals

COLOURS = {
    "paint": (0.78, 0.09, 0.10), "white": (0.93, 0.93, 0.90), "dark": (0.11, 0.11, 0.12), "seat": (0.16, 0.16, 0.18),
    "steel": (0.55, 0.57, 0.60), "tyre": (0.07, 0.07, 0.075), "rim": (0.93, 0.93, 0.90), "light": (1.0, 0.93, 0.70),
    "amber": (1.0, 0.55, 0.05), "sensor": (0.10, 0.45, 0.85), "antenna": (0.96, 0.96, 0.96),
}  # fmt: skip

FRONT, REAR = (0.325, 0.09), (0.475, 0.11)
"""Radius and width of the wheels."""
WHEELBASE, TRACK = 1.10, 1.20
AXLE_HEIGHT = REAR[0] - 0.0115  # static deflection of the rear wheels
FRONT_Z = FRONT[0] - 0.009 - AXLE_HEIGHT


def paddy_wheel(radius: float, width: float, count: int) -> list:
    """Narrow rubber hoop with bars across, as wheels for mud have."""
    ring = [
        (0.80 * radius, -0.30 * width), (0.90 * radius, -0.36 * width), (0.90 * radius, 0.36 * width),
        (0.80 * radius, 0.30 * width),
    ]  # fmt: skip
    return revolve(ring, 44) + lugs(radius, width, count, 0.06 * radius)


def carrier_meshes() -> dict[str, list]:
    hood = [(0.72, 0.02), (1.52, -0.02), (1.62, 0.10), (1.60, 0.42), (1.40, 0.58), (0.72, 0.66)]
    floor = [(-0.36, -0.06), (0.74, -0.06), (0.74, 0.06), (0.10, 0.06), (-0.02, 0.16), (-0.36, 0.20)]
    pod = [(-0.34, 0.18), (0.04, 0.14), (0.06, 0.42), (-0.30, 0.46)]
    nose = [(1.50, -0.10), (1.74, -0.06), (1.76, 0.02), (1.50, 0.04)]
    return {
        "hood": prism(hood, -0.27, 0.27) + prism(nose, -0.22, 0.22),
        "body": prism(floor, -0.46, 0.46) + prism(pod, -0.30, 0.30),
        "front_tyre": paddy_wheel(*FRONT, 14),
        "front_rim": rim_mesh(0.80 * FRONT[0], FRONT[1], 5, 1.0),
        "rear_tyre": paddy_wheel(*REAR, 18),
        "rear_rim": rim_mesh(0.80 * REAR[0], REAR[1], 6, 1.0),
    }


def carrier_visuals(folder: str) -> list[str]:
    """The root link's, with meshes from a folder."""
    q = math.pi / 2
    return [
        box("dark", (1.70, 0.22, 0.20), (0.50, 0, -0.10)),
        rod("dark", 0.07, TRACK - 0.12, (0, 0, 0), (q, 0, 0)),
        drawing.mesh("paint", f"{folder}/hood"), drawing.mesh("white", f"{folder}/body"),
        box("dark", (0.02, 0.34, 0.22), (1.615, 0, 0.25)),
        box("light", (0.03, 0.10, 0.08), (1.60, 0.20, 0.40)), box("light", (0.03, 0.10, 0.08), (1.60, -0.20, 0.40)),
        # seat, wheel, panel
        box("seat", (0.40, 0.44, 0.10), (-0.10, 0, 0.51)),
        box("seat", (0.10, 0.44, 0.40), (-0.30, 0, 0.74), (0, -0.15, 0)),
        rod("dark", 0.02, 0.36, (0.66, 0, 0.72), (0, -0.5, 0)), rod("dark", 0.17, 0.025, (0.57, 0, 0.88), (0, -0.5, 0)),
        box("dark", (0.14, 0.40, 0.10), (0.76, 0, 0.68), (0, -0.4, 0)),
        # hand rails at the nose, fenders
        *(rod("steel", 0.016, 0.62, (1.50, 0.38 * side, 0.25)) for side in (1, -1)),
        *(rod("steel", 0.016, 0.80, (1.12, 0.38 * side, 0.56), (0, q, 0)) for side in (1, -1)),
        *(box("white", (0.72, 0.14, 0.03), (-0.02, TRACK / 2 * side, 0.53)) for side in (1, -1)),
        *(box("white", (0.20, 0.14, 0.03), (0.42, TRACK / 2 * side, 0.47), (0, 0.6, 0)) for side in (1, -1)),
        *(box("steel", (0.05, 0.30, 0.05), (-0.25, 0.44 * side, 0.50)) for side in (1, -1)),
        rod("amber", 0.045, 0.12, (-0.32, 0.26, 1.03)), rod("steel", 0.012, 0.30, (-0.32, 0.26, 0.86)),
    ]  # fmt: skip


def add_running_gear(build: Builder, folder: str) -> None:
    """Front axle on its pivot, knuckles and wheels, hung on the link ``chassis``: 145 kg."""
    build.link(
        "front_axle",
        25,
        (0, 0, 0),
        (4, 0.6, 4.2),
        [box("dark", (0.10, TRACK - 0.20, 0.09), (0, 0, 0)), box("dark", (0.26, 0.16, 0.14), (-0.02, 0, 0.05))],
    )
    build.joint("axle_pivot", "chassis", "front_axle", (WHEELBASE, 0, FRONT_Z), (1, 0, 0))
    for side, name in ((1.0, "left"), (-1.0, "right")):
        y = side * TRACK / 2
        build.link(
            f"knuckle_{name}",
            8,
            (0, 0, 0),
            (0.1, 0.1, 0.1),
            [box("steel", (0.07, 0.09, 0.22), (0, -0.10 * side, 0.04))],
        )
        build.joint(f"steering_{name}", "front_axle", f"knuckle_{name}", (0, y, 0), (0, 0, 1))
        # Wheels spin with their own 1.5 and 5 kg m2 and as much again of the driveline as seen at the wheel.
        build.link(
            f"front_wheel_{name}_hub", 20, (0, 0, 0), (1.6, 3.0, 1.6), wheel_visuals(folder, "front_", "rim", side)
        )
        build.joint(f"front_wheel_{name}", f"knuckle_{name}", f"front_wheel_{name}_hub", (0, 0, 0), (0, 1, 0))
        build.link(
            f"rear_wheel_{name}_hub", 32, (0, 0, 0), (5.2, 10.0, 5.2), wheel_visuals(folder, "rear_", "rim", side)
        )
        build.joint(f"rear_wheel_{name}", "chassis", f"rear_wheel_{name}_hub", (0, y, 0), (0, 1, 0))
