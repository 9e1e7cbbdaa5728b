"""Writes scraper.urdf and the meshes beside it: run it after changing a figure here.

    python assets/machines/build_scraper.py

Lengths in m, masses in kg. Frames: x forward, y left, z up; the root's origin is the middle of the rear axle, that of
the link ``scraper`` the middle of the blade's edge, on the ground the wheels stand on when the lift is at zero.
"""

# ruff: noqa: D103 (a drawing: names and coordinates)
from __future__ import annotations

import math
from pathlib import Path

import drawing
from drawing import Builder, block, box, lugs, prism, revolve, rim_mesh, rod, wheel_visuals

HERE = Path(__file__).resolve().parent

COLOURS = {
    "paint": (0.78, 0.09, 0.10), "white": (0.93, 0.93, 0.90), "dark": (0.11, 0.11, 0.12), "seat": (0.16, 0.16, 0.18),
    "steel": (0.55, 0.57, 0.60), "blade": (0.92, 0.66, 0.10), "edge": (0.40, 0.41, 0.43), "tyre": (0.07, 0.07, 0.075),
    "rim": (0.93, 0.93, 0.90), "light": (1.0, 0.93, 0.70), "amber": (1.0, 0.55, 0.05), "sensor": (0.10, 0.45, 0.85),
    "antenna": (0.96, 0.96, 0.96), "laser": (0.15, 0.55, 0.20),
}  # fmt: skip

FRONT, REAR = (0.325, 0.09), (0.475, 0.11)
"""Radius and width of the wheels."""
WHEELBASE, TRACK = 1.10, 1.20
AXLE_HEIGHT = REAR[0] - 0.0115  # static deflection of the rear wheels
FRONT_Z = FRONT[0] - 0.009 - AXLE_HEIGHT
BLADE_X = -0.80
GUIDE_X = -0.52
"""Guide of the lift, behind the rear axle."""
BLADE_WIDTH, BLADE_HEIGHT = 2.4, 0.35
LOWEST, HIGHEST = -0.20, 0.40
MAST = 2.0
"""Height of the antenna above the edge."""


def mesh(colour: str, name: str, xyz: tuple = (0, 0, 0)) -> str:
    return drawing.mesh(colour, f"scraper/{name}", xyz)


def paddy_wheel(radius: float, width: float, count: int) -> list:
    """Narrow rubber hoop with bars across, as wheels for mud have."""
    ring = [
        (0.80 * radius, -0.30 * width), (0.90 * radius, -0.36 * width), (0.90 * radius, 0.36 * width),
        (0.80 * radius, 0.30 * width),
    ]  # fmt: skip
    return revolve(ring, 44) + lugs(radius, width, count, 0.06 * radius)


def mouldboard() -> list:
    """Blade from its edge upwards: curved back and forward again, 2.4 m wide."""
    half, thick, parts = 0.5 * BLADE_WIDTH, 0.018, 6

    def face(part: int) -> tuple[float, float]:
        z = BLADE_HEIGHT * part / parts
        return -0.30 * z * (1.0 - z / BLADE_HEIGHT) - 0.01, z

    triangles = []
    for part in range(parts):
        (x0, z0), (x1, z1) = face(part), face(part + 1)
        base = [(x0 - thick, -half, z0), (x0, -half, z0), (x0, half, z0), (x0 - thick, half, z0)]
        top = [(x1 - thick, -half, z1), (x1, -half, z1), (x1, half, z1), (x1 - thick, half, z1)]
        triangles += block(base + top)
    return triangles


def end_plates() -> list:
    half = 0.5 * BLADE_WIDTH
    outline = [(-0.05, 0.01), (0.22, 0.01), (0.26, 0.16), (0.04, 0.37), (-0.05, 0.37)]
    return prism(outline, half - 0.006, half + 0.006) + prism(outline, -half - 0.006, -half + 0.006)


def meshes() -> dict[str, list]:
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
        "blade": mouldboard(),
        "end_plates": end_plates(),
    }


def chassis_visuals() -> list[str]:
    q = math.pi / 2
    return [
        box("dark", (1.70, 0.22, 0.20), (0.50, 0, -0.10)),
        rod("dark", 0.07, TRACK - 0.12, (0, 0, 0), (q, 0, 0)),
        mesh("paint", "hood"), mesh("white", "body"),
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
        # the guide of the lift: two posts behind the axle, braced to the frame, and the cylinder
        *(box("dark", (0.06, 0.07, 1.00), (GUIDE_X, 0.22 * side, 0.10)) for side in (1, -1)),
        box("dark", (0.06, 0.52, 0.07), (GUIDE_X, 0, 0.60)), box("dark", (0.06, 0.52, 0.07), (GUIDE_X, 0, -0.36)),
        *(box("dark", (0.34, 0.05, 0.06), (-0.38, 0.22 * side, -0.06)) for side in (1, -1)),
        rod("steel", 0.035, 0.50, (GUIDE_X, 0, 0.32)),
        box("sensor", (0.10, 0.08, 0.05), (0.35, 0.0, 0.085)),
    ]  # fmt: skip


def scraper_visuals() -> list[str]:
    """The frame's origin is the middle of the edge."""
    slide_x = GUIDE_X - BLADE_X
    low = AXLE_HEIGHT - 0.30
    return [
        mesh("blade", "blade"), mesh("blade", "end_plates"),
        box("edge", (0.012, BLADE_WIDTH, 0.06), (-0.004, 0, 0.03)),
        box("steel", (0.09, 2.0, 0.09), (-0.09, 0, 0.27)),
        *(box("blade", (0.08, 0.03, 0.28), (-0.06, y, 0.17)) for y in (-0.9, -0.45, 0.45, 0.9)),
        # carriage on the guide, arms to the blade
        *(box("blade", (0.11, 0.10, 0.34), (slide_x, 0.22 * side, low + 0.12)) for side in (1, -1)),
        *(box("blade", (slide_x + 0.12, 0.06, 0.08), (0.5 * slide_x, 0.22 * side, low + 0.10)) for side in (1, -1)),
        *(box("blade", (0.07, 0.06, 0.16), (-0.06, 0.22 * side, low + 0.06)) for side in (1, -1)),
        box("steel", (0.06, 0.44, 0.06), (slide_x, 0, low + 0.02)), rod("edge", 0.02, 0.40, (slide_x, 0, low + 0.22)),
        # mast: AHRS, laser receiver, antenna
        box("dark", (0.12, 0.12, 0.10), (-0.09, 0, 0.36)),
        rod("steel", 0.025, MAST - 0.40, (-0.09, 0, 0.38 + 0.5 * (MAST - 0.40))),
        box("sensor", (0.06, 0.08, 0.05), (-0.09, 0, 1.00)),
        rod("laser", 0.06, 0.22, (-0.09, 0, 1.62)), rod("dark", 0.064, 0.05, (-0.09, 0, 1.62)),
        rod("antenna", 0.085, 0.06, (-0.09, 0, MAST)), rod("dark", 0.06, 0.02, (-0.09, 0, MAST - 0.04)),
    ]  # fmt: skip


def main() -> None:
    build = Builder("scraper", COLOURS)
    # 705 kg in all: chassis with driver 430, front axle 25, knuckles 2 x 8, front wheels 2 x 20, rear wheels 2 x 32,
    # scraper 130. The chassis' centre of mass puts 40 % on the front axle:
    # x = (0.4 x 705 x 1.10 - 81 x 1.10 + 130 x 0.81) / 430 = 0.759 m.
    build.link("chassis", 430, (0.759, 0, 0.20), (85, 230, 235), chassis_visuals())
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
            f"front_wheel_{name}_hub", 20, (0, 0, 0), (1.6, 3.0, 1.6), wheel_visuals("scraper", "front_", "rim", side)
        )
        build.joint(f"front_wheel_{name}", f"knuckle_{name}", f"front_wheel_{name}_hub", (0, 0, 0), (0, 1, 0))
        build.link(
            f"rear_wheel_{name}_hub", 32, (0, 0, 0), (5.2, 10.0, 5.2), wheel_visuals("scraper", "rear_", "rim", side)
        )
        build.joint(f"rear_wheel_{name}", "chassis", f"rear_wheel_{name}_hub", (0, y, 0), (0, 1, 0))
    # 130 kg: a blade of 80 kg across, 0.2 m above its edge, carriage and mast.
    build.link("scraper", 130, (-0.01, 0, 0.35), (58, 24, 48), scraper_visuals())
    build.slide("lift", "chassis", "scraper", (BLADE_X, 0, -AXLE_HEIGHT), LOWEST, HIGHEST)
    build.write(HERE, meshes())


if __name__ == "__main__":
    main()
