"""Writes scraper.urdf and the meshes beside it: run it after changing a figure here.

    python assets/machines/build_scraper.py

Lengths in m, masses in kg. Frames: x forward, y left, z up; the root's origin is the middle of the rear axle, that of
the link ``scraper`` the middle of the blade's edge, on the ground the wheels stand on when the lift is at zero.
"""

# ruff: noqa: D103 (a drawing: names and coordinates)
from __future__ import annotations

from pathlib import Path

import drawing
from carrier_drawing import AXLE_HEIGHT, COLOURS, add_running_gear, carrier_meshes, carrier_visuals
from drawing import Builder, block, box, prism, rod

HERE = Path(__file__).resolve().parent

BLADE_X = -0.80
GUIDE_X = -0.52
"""Guide of the lift, behind the rear axle."""
BLADE_WIDTH, BLADE_HEIGHT = 2.4, 0.35
LOWEST, HIGHEST = -0.20, 0.40
MAST = 2.0
"""Height of the antenna above the edge."""


def mesh(colour: str, name: str, xyz: tuple = (0, 0, 0)) -> str:
    return drawing.mesh(colour, f"scraper/{name}", xyz)


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
    return {**carrier_meshes(), "blade": mouldboard(), "end_plates": end_plates()}


def chassis_visuals() -> list[str]:
    return [
        *carrier_visuals("scraper"),
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
    colours = COLOURS | {"blade": (0.92, 0.66, 0.10), "edge": (0.40, 0.41, 0.43), "laser": (0.15, 0.55, 0.20)}
    build = Builder("scraper", colours)
    # 705 kg in all: chassis with driver 430, front axle 25, knuckles 2 x 8, front wheels 2 x 20, rear wheels 2 x 32,
    # scraper 130. The chassis' centre of mass puts 40 % on the front axle:
    # x = (0.4 x 705 x 1.10 - 81 x 1.10 + 130 x 0.81) / 430 = 0.759 m.
    build.link("chassis", 430, (0.759, 0, 0.20), (85, 230, 235), chassis_visuals())
    add_running_gear(build, "scraper")
    # 130 kg: a blade of 80 kg across, 0.2 m above its edge, carriage and mast.
    build.link("scraper", 130, (-0.01, 0, 0.35), (58, 24, 48), scraper_visuals())
    build.slide("lift", "chassis", "scraper", (BLADE_X, 0, -AXLE_HEIGHT), LOWEST, HIGHEST)
    build.write(HERE, meshes())


if __name__ == "__main__":
    main()
