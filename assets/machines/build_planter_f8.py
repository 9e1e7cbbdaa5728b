"""Writes planter_f8.urdf and the wheel meshes beside it: run it after changing a figure here.

    python assets/machines/build_planter_f8.py

Lengths in m, masses in kg. Frames: x forward, y left, z up; the root's origin is the middle of the rear axle.
"""

# ruff: noqa: D103, PLR0917 (a drawing: names and coordinates)
from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import drawing
from drawing import Builder, block, box, frustum, lugs, prism, revolve, rim_mesh, rod, tyre_profile, wheel_visuals

HERE = Path(__file__).resolve().parent

COLOURS = {
    "tractor_green": (0.10, 0.36, 0.16), "dark": (0.11, 0.11, 0.12), "glass": (0.35, 0.52, 0.62),
    "rim": (0.92, 0.76, 0.12), "steel": (0.50, 0.52, 0.55), "red": (0.75, 0.10, 0.09), "hopper": (0.93, 0.93, 0.90),
    "lid": (0.15, 0.15, 0.16), "tyre": (0.07, 0.07, 0.075), "light": (1.0, 0.93, 0.70), "amber": (1.0, 0.55, 0.05),
    "sensor": (0.10, 0.45, 0.85), "planter_rim": (0.80, 0.80, 0.78),
}  # fmt: skip

REAR, FRONT, PLANTER = (0.847, 0.52), (0.650, 0.42), (0.437, 0.40)
WHEELBASE, REAR_TRACK, FRONT_TRACK = 2.79, 1.84, 1.84
AXLE_HEIGHT = REAR[0] - 0.060  # static sinkage of the rear tyres
HITCH = (-1.05, 0.0, 0.5 - AXLE_HEIGHT)
ROWS_Y = [0.75 * (3.5 - row) for row in range(8)]
PLANTER_WHEELS_Y = (2.25, 0.75, -0.75, -2.25)


def mesh(colour: str, name: str, xyz: tuple = (0, 0, 0)) -> str:
    return drawing.mesh(colour, f"planter_f8/{name}", xyz)


def meshes() -> dict[str, list]:
    hood = [(0.95, -0.12), (2.95, -0.12), (3.18, 0.05), (3.16, 0.50), (2.95, 0.72), (0.95, 0.92)]
    cab_low = [(-0.55, 0.05), (0.95, -0.10), (1.02, 0.90), (-0.62, 0.92)]
    glass = [(-0.62, 0.92), (1.02, 0.90), (0.82, 1.92), (-0.52, 1.92)]
    fender_outer = [(0.98 * math.cos(a), 0.98 * math.sin(a)) for a in (math.radians(d) for d in range(25, 166, 14))]
    fender = []
    for side in (-1.0, 1.0):
        y0, y1 = sorted((side * 0.64, side * 1.16))
        for (x0, z0), (x1, z1) in pairwise(fender_outer):
            inner = [
                (0.95 * x0, y0, 0.95 * z0),
                (0.95 * x1, y0, 0.95 * z1),
                (0.95 * x1, y1, 0.95 * z1),
                (0.95 * x0, y1, 0.95 * z0),
            ]
            outer = [(x0, y0, z0), (x1, y0, z1), (x1, y1, z1), (x0, y1, z0)]
            fender += block(inner + outer)
    return {
        "tractor_hood": prism(hood, -0.40, 0.40),
        "tractor_cab": prism(cab_low, -0.62, 0.62),
        "tractor_glass": prism(glass, -0.66, 0.66),
        "tractor_fenders": fender,
        "rear_tyre": revolve(tyre_profile(0.955 * REAR[0], REAR[1], 0.50), 48) + lugs(REAR[0], REAR[1], 20, 0.035),
        "rear_rim": rim_mesh(0.50, REAR[1], 8, 1.0),
        "front_tyre": revolve(tyre_profile(0.955 * FRONT[0], FRONT[1], 0.37), 44) + lugs(FRONT[0], FRONT[1], 18, 0.028),
        "front_rim": rim_mesh(0.37, FRONT[1], 8, 1.0),
        "planter_tyre": revolve(tyre_profile(PLANTER[0], PLANTER[1], 0.21), 36),
        "planter_rim": rim_mesh(0.21, PLANTER[1], 5, 1.0),
        "seed_hopper": frustum((0.10, 0.09), (0.25, 0.22), 0.0, 0.34),
        "fertiliser_hopper": frustum((0.25, 0.85), (0.55, 1.15), 0.0, 0.75)
        + block(
            [(x, y, z) for z in (0.75, 1.0) for x, y in ((-0.55, -1.15), (0.55, -1.15), (0.55, 1.15), (-0.55, 1.15))]
        ),
    }


# --- URDF ------------------------------------------------------------------------------------------------------------


def tractor_visuals() -> list[str]:
    q = math.pi / 2
    parts = [
        box("dark", (2.9, 0.42, 0.42), (1.35, 0, -0.05)),
        box("dark", (0.9, 0.56, 0.60), (-0.05, 0, -0.02)),
        rod("dark", 0.14, REAR_TRACK - 0.4, (0, 0, 0), (q, 0, 0)),
        mesh("tractor_green", "tractor_hood"), mesh("tractor_green", "tractor_cab"),
        mesh("glass", "tractor_glass"), mesh("tractor_green", "tractor_fenders"),
        box("tractor_green", (1.62, 1.46, 0.14), (0.14, 0, 1.98)),
        box("dark", (0.04, 0.60, 0.44), (3.16, 0, 0.24)),
        box("light", (0.05, 0.16, 0.10), (3.14, 0.26, 0.52)), box("light", (0.05, 0.16, 0.10), (3.14, -0.26, 0.52)),
        box("light", (0.06, 0.18, 0.09), (0.92, 0.58, 1.90)), box("light", (0.06, 0.18, 0.09), (0.92, -0.58, 1.90)),
        rod("amber", 0.06, 0.16, (-0.45, 0.52, 2.13)),
        rod("dark", 0.05, 1.30, (1.10, -0.52, 1.15)), rod("steel", 0.075, 0.55, (1.10, -0.52, 0.95)),
        box("dark", (0.55, 0.46, 0.40), (0.62, 0.60, -0.30)), box("dark", (0.55, 0.46, 0.40), (0.62, -0.60, -0.30)),
        box("steel", (0.34, 0.85, 0.30), (3.36, 0, -0.12)), box("dark", (0.16, 0.30, 0.20), (3.20, 0, -0.10)),
        box("steel", (0.70, 0.14, 0.08), (-0.72, 0, HITCH[2])), rod("steel", 0.05, 0.18, HITCH),
        rod("sensor", 0.11, 0.08, (0.35, 0, 2.09)),
    ]  # fmt: skip
    for y in (0.66, -0.66):
        for x, lean in ((-0.57, -0.10), (0.92, 0.20)):
            parts.append(box("tractor_green", (0.07, 0.07, 1.04), (x, y, 1.42), (0, -lean, 0)))
    return parts


def planter_visuals() -> list[str]:
    """The frame's origin is the hitch, 0.5 m above the ground."""
    q = math.pi / 2
    parts = [
        box("red", (2.75, 0.16, 0.18), (-1.40, 0, 0.04)),
        rod("steel", 0.09, 0.10, (0, 0, 0)),
        box("red", (2.05, 0.12, 0.14), (-1.95, 0.55, 0.16), (0, 0, -0.52)),
        box("red", (2.05, 0.12, 0.14), (-1.95, -0.55, 0.16), (0, 0, 0.52)),
        box("red", (0.20, 6.0, 0.20), (-2.95, 0, 0.25)),
        box("red", (0.14, 4.6, 0.14), (-2.55, 0, 0.25)),
        mesh("hopper", "fertiliser_hopper", (-2.75, 0, 0.62)),
        box("lid", (1.14, 2.34, 0.06), (-2.75, 0, 1.65)),
        box("steel", (0.5, 0.10, 0.45), (-2.75, 0.6, 0.48)),
        box("steel", (0.5, 0.10, 0.45), (-2.75, -0.6, 0.48)),
        rod("steel", 0.025, 0.36, (-2.75, 0, 1.85)),
        rod("sensor", 0.12, 0.08, (-2.75, 0, 2.05)),
        box("sensor", (0.16, 0.12, 0.12), (-3.0, 0, 0.12)),
        rod("steel", 0.20, 0.34, (-2.2, 0, 0.42), (q, 0, 0)),
        rod("dark", 0.03, 0.5, (-0.9, 0.12, -0.22)),
        box("amber", (0.04, 0.22, 0.14), (-3.08, 2.85, 0.45)),
        box("amber", (0.04, 0.22, 0.14), (-3.08, -2.85, 0.45)),
    ]
    for y in PLANTER_WHEELS_Y:
        parts.append(box("red", (0.12, 0.08, 0.55), (-2.98, y + 0.27, 0.03)))
        parts.append(rod("steel", 0.04, 0.30, (-3.0, y + 0.14, -0.08), (q, 0, 0)))
    for index, y in enumerate(ROWS_Y):
        parts += [
            *(box("steel", (0.50, 0.05, 0.05), (-3.26, y + s, z)) for s in (0.10, -0.10) for z in (0.16, 0.30)),
            box("red", (0.62, 0.12, 0.30), (-3.62, y, 0.16)),
            mesh("hopper", "seed_hopper", (-3.58, y, 0.36)), box("lid", (0.52, 0.46, 0.05), (-3.58, y, 0.72)),
            rod("red", 0.15, 0.10, (-3.55, y + 0.10, 0.24), (q, 0, 0)),
            rod("steel", 0.19, 0.02, (-3.50, y + 0.02, -0.36), (q, 0.06, 0)),
            rod("steel", 0.19, 0.02, (-3.50, y - 0.02, -0.36), (q, -0.06, 0)),
            rod("dark", 0.20, 0.07, (-3.56, y + 0.13, -0.30), (q, 0, 0)),
            rod("dark", 0.20, 0.07, (-3.56, y - 0.13, -0.30), (q, 0, 0)),
            box("steel", (0.62, 0.05, 0.06), (-4.02, y, -0.14), (0, -0.30, 0)),
            rod("dark", 0.15, 0.04, (-4.30, y + 0.07, -0.35), (q + 0.25, 0, 0)),
            rod("dark", 0.15, 0.04, (-4.30, y - 0.07, -0.35), (q - 0.25, 0, 0)),
        ]  # fmt: skip
        if index in {0, 3, 4, 7}:
            parts.append(box("sensor", (0.10, 0.10, 0.08), (-3.88, y, 0.33)))
    return parts


def wheel(
    build: Builder, name: str, parent: str, xyz: tuple, kind: str, mass: float, inertia: tuple, side: float
) -> None:
    rim = "planter_rim" if kind == "planter" else "rim"
    build.link(f"{name}_hub", mass, (0, 0, 0), inertia, wheel_visuals("planter_f8", f"{kind}_", rim, side))
    build.joint(name, parent, f"{name}_hub", xyz, (0, 1, 0))


def main() -> None:
    build = Builder("planter_f8", COLOURS)
    # 6700 kg in all: chassis 5440 + front axle 200 + front wheels 2 x 180 + rear wheels 2 x 350. The chassis' centre of
    # mass puts 40 % on the front axle: x = (0.4 x 6700 x 2.79 - 560 x 2.79) / 5440 = 1.087 m.
    build.link("tractor", 5440, (1.087, 0, 0.25), (1900, 7000, 6600), tractor_visuals())
    axle_z = FRONT[0] - 0.042 - AXLE_HEIGHT
    build.link(
        "front_axle",
        200,
        (0, 0, 0),
        (60, 10, 62),
        [box("dark", (0.22, FRONT_TRACK - 0.42, 0.20), (0, 0, 0)), box("dark", (0.5, 0.3, 0.24), (-0.05, 0, 0.10))],
    )
    build.joint("axle_pivot", "tractor", "front_axle", (WHEELBASE, 0, axle_z), (1, 0, 0))
    for side, name in ((1.0, "left"), (-1.0, "right")):
        y = side * FRONT_TRACK / 2
        build.link(
            f"knuckle_{name}", 30, (0, 0, 0), (1.0, 1.0, 1.0), [box("steel", (0.16, 0.22, 0.30), (0, -0.26 * side, 0))]
        )
        build.joint(f"steering_{name}", "front_axle", f"knuckle_{name}", (0, y, 0), (0, 0, 1))
        wheel(build, f"front_wheel_{name}", f"knuckle_{name}", (0, 0, 0), "front", 150, (30, 46, 30), side)
        # Rear wheel 350 kg (176 kg m2) with the driveline as seen at the axle, about 125 kg m2 a side. The importer
        # needs ixx + izz >= iyy: the 152 instead of 96 kg m2 across change the tractor's yaw inertia by under 2 %.
        wheel(build, f"rear_wheel_{name}", "tractor", (0, side * REAR_TRACK / 2, 0), "rear", 350, (152, 300, 152), side)
    build.link("hitch_clevis", 20, (0, 0, 0), (0.5, 0.5, 0.5), [rod("dark", 0.06, 0.14, (0, 0, 0))])
    build.joint("hitch_yaw", "tractor", "hitch_clevis", HITCH, (0, 0, 1))
    build.link("hitch_eye", 20, (0, 0, 0), (0.5, 0.5, 0.5), [rod("steel", 0.07, 0.06, (0, 0, 0.02))])
    build.joint("hitch_pitch", "hitch_clevis", "hitch_eye", (0, 0, 0), (0, 1, 0))
    # 3500 kg in all: frame 3180 + four wheels of 80. Centre of mass 0.35 m before the wheels: 11 % on the drawbar.
    build.link("planter", 3180, (-2.65, 0, 0.45), (9000, 2600, 11000), planter_visuals())
    build.joint("hitch_roll", "hitch_eye", "planter", (0, 0, 0), (1, 0, 0))
    planter_z = PLANTER[0] - 0.031 - 0.5
    for number, y in enumerate(PLANTER_WHEELS_Y, start=1):
        wheel(build, f"planter_wheel_{number}", "planter", (-3.0, y, planter_z), "planter", 80, (6, 10, 6), 1.0)
    build.write(HERE, meshes())


if __name__ == "__main__":
    main()
