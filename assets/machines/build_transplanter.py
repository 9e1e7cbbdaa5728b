"""Writes transplanter.urdf and the meshes beside it: run it after changing a figure here.

    python assets/machines/build_transplanter.py

Lengths in m, masses in kg. Frames: x forward, y left, z up; the root's origin is the middle of the rear axle.
"""

# ruff: noqa: D103 (a drawing: names and coordinates)
from __future__ import annotations

import math
from pathlib import Path

import drawing
from carrier_drawing import AXLE_HEIGHT, COLOURS, add_running_gear, carrier_meshes, carrier_visuals
from drawing import Builder, box, prism, rod

HERE = Path(__file__).resolve().parent
FOLDER = "transplanter"

ROWS_Y = (0.75, 0.45, 0.15, -0.15, -0.45, -0.75)
ROW = 0.30
HALF = 0.94
"""Half of the width of the planting unit."""
TOP, BOTTOM = (-0.64, 0.92), (-1.22, -0.12)
"""Front and rear end of the board on which the seedling mats slide down to the planting arms, (x, z)."""
FRAME_X, ANTENNA_HEIGHT = 1.40, 2.5
"""Frame with the antennas, before the rear axle; antennas above ground."""
ANTENNAS_Y = (0.0, -0.3)
"""Consumer receiver and reference."""

# The carrier with its driver, and the planting unit with seedlings: mass, centre of mass, moments of inertia about it.
CARRIER = 430.0, (0.759, 0.20), (85.0, 230.0, 235.0)
UNIT = 130.0, (-0.81, 0.15), (48.0, 18.0, 48.0)


def on_board(share: float, above: float) -> tuple[float, float]:
    """A point by its share of the way down the board and its distance above it."""
    dx, dz = BOTTOM[0] - TOP[0], BOTTOM[1] - TOP[1]
    length = math.hypot(dx, dz)
    return TOP[0] + share * dx + above * dz / length, TOP[1] + share * dz - above * dx / length


def slab(  # noqa: PLR0917 (a quad)
    begin: float, end: float, low: float, high: float, y0: float, y1: float
) -> list:
    """Part of the board, or of what lies on it."""
    outline = [on_board(begin, low), on_board(begin, high), on_board(end, high), on_board(end, low)]
    return prism(outline, y0, y1)


def mats() -> list:
    """Six lanes of seedlings, each of two mats."""
    return [
        triangle
        for y in ROWS_Y
        for begin, end in ((0.06, 0.50), (0.52, 0.97))
        for triangle in slab(begin, end, 0.03, 0.085, y - 0.43 * ROW, y + 0.43 * ROW)
    ]


def dividers() -> list:
    edges = [y + 0.5 * ROW for y in ROWS_Y] + [ROWS_Y[-1] - 0.5 * ROW]
    return [triangle for y in edges for triangle in slab(0.0, 1.0, 0.0, 0.11, y - 0.008, y + 0.008)]


def floats() -> list:
    """Three boards that slide on the mud under the planting unit."""
    z = -AXLE_HEIGHT
    outline = [(-1.32, z + 0.015), (-0.62, z + 0.015), (-0.46, z + 0.09), (-0.50, z + 0.11), (-1.32, z + 0.07)]
    return [
        triangle
        for y, half in ((0.60, 0.22), (0.0, 0.16), (-0.60, 0.22))
        for triangle in prism(outline, y - half, y + half)
    ]


def meshes() -> dict[str, list]:
    board = slab(0.0, 1.0, 0.0, 0.03, -HALF, HALF)
    return {**carrier_meshes(), "board": board + dividers(), "mats": mats(), "floats": floats()}


def unit_visuals() -> list[str]:
    q = math.pi / 2
    return [
        drawing.mesh("white", f"{FOLDER}/board"), drawing.mesh("seedling", f"{FOLDER}/mats"),
        drawing.mesh("float", f"{FOLDER}/floats"),
        # frame, and the links that lift it
        box("steel", (0.09, 1.72, 0.09), (-0.86, 0, -0.20)),
        *(box("dark", (0.05, 0.05, 0.72), (-0.80, 0.30 * side, 0.14), (0, 0.35, 0)) for side in (1, -1)),
        *(rod("dark", 0.022, 0.56, (-0.58, 0.20 * side, -0.12), (0, q - 0.22, 0)) for side in (1, -1)),
        rod("dark", 0.022, 0.50, (-0.56, 0, 0.12), (0, q - 0.22, 0)),
        # a case for two rows each, with an arm at either side of it
        *(box("paint", (0.44, 0.07, 0.11), (-1.08, y, -0.22)) for y in (0.60, 0.0, -0.60)),
        *(rod("dark", 0.035, 0.24, (-1.27, y, -0.22), (q, 0, 0)) for y in (0.60, 0.0, -0.60)),
        *(box("amber", (0.05, 0.035, 0.26), (-1.27, y, -0.22), (0, 0.6, 0)) for y in ROWS_Y),
        *(rod("steel", 0.008, 0.14, (-1.24 - 0.07, y, -0.36), (0, 0.25, 0)) for y in ROWS_Y),
        # line markers, folded up
        *(rod("steel", 0.014, 1.10, (-0.70, (HALF + 0.02) * side, 0.36), (0.12 * -side, -0.2, 0)) for side in (1, -1)),
        *(rod("dark", 0.09, 0.02, (-0.81, (HALF + 0.08) * side, 0.91), (q, 0, 0)) for side in (1, -1)),
    ]  # fmt: skip


def front_visuals() -> list[str]:
    """Shelves for spare mats, and the frame of the antennas."""
    q = math.pi / 2
    top = ANTENNA_HEIGHT - AXLE_HEIGHT
    return [
        *(
            box(colour, (0.62, 0.30, height), (1.10, 0.60 * side, z + above))
            for side in (1, -1)
            for z in (0.40, 0.72)
            for colour, height, above in (("steel", 0.02, 0.0), ("seedling", 0.05, 0.035))
        ),
        *(
            rod("steel", 0.016, 0.84, (x, 0.46 * side, 0.40))
            for side in (1, -1)
            for x in (0.84, 1.36)
        ),
        *(rod("steel", 0.022, top - 0.04, (FRAME_X, 0.40 * side, 0.5 * top)) for side in (1, -1)),
        rod("steel", 0.022, 0.84, (FRAME_X, 0, top - 0.06), (q, 0, 0)),
        *(rod("steel", 0.016, 0.84, (FRAME_X, 0, z), (q, 0, 0)) for z in (0.02, 1.0)),
        *(rod("antenna", 0.075, 0.045, (FRAME_X, y, top - 0.02)) for y in ANTENNAS_Y),
        *(rod("dark", 0.045, 0.03, (FRAME_X, y, top - 0.05)) for y in ANTENNAS_Y),
        box("sensor", (0.10, 0.08, 0.05), (0.35, 0.0, 0.085)),
    ]  # fmt: skip


def joined() -> tuple[float, tuple[float, float, float], tuple[float, float, float]]:
    """Carrier and unit as one body: mass, centre of mass, moments of inertia about it.

    Its product of inertia, 99.8 kg x 1.57 m x 0.05 m = 8 kg m2, is left out.
    """
    (m1, (x1, z1), i1), (m2, (x2, z2), i2) = CARRIER, UNIT
    mass = m1 + m2
    reduced = m1 * m2 / mass
    dx, dz = x1 - x2, z1 - z2
    apart = reduced * dz**2, reduced * (dx**2 + dz**2), reduced * dx**2
    ixx, iyy, izz = (a + b + c for a, b, c in zip(i1, i2, apart, strict=True))
    return mass, ((m1 * x1 + m2 * x2) / mass, 0.0, (m1 * z1 + m2 * z2) / mass), (ixx, iyy, izz)


def main() -> None:
    colours = COLOURS | {"paint": (0.07, 0.27, 0.60), "seedling": (0.33, 0.60, 0.16), "float": (0.90, 0.42, 0.10)}
    build = Builder(FOLDER, colours)
    # 705 kg in all, 40 % of it on the front axle, as the scraper: the planting unit weighs what the scraper does, at
    # the same distance behind the axle.
    build.link("chassis", *joined(), [*carrier_visuals(FOLDER), *unit_visuals(), *front_visuals()])
    add_running_gear(build, FOLDER)
    build.write(HERE, meshes())


if __name__ == "__main__":
    main()
