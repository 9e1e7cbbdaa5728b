"""Writes rail_bench.urdf (boxes and rods only): run it after changing a figure here.

    python assets/machines/build_rail_bench.py

Lengths in m, masses in kg. Frames: x forward, y left, z up; the root's origin is on the ground between the rails, the
plate's in the middle of the plate.
"""

# ruff: noqa: D103 (a drawing: names and coordinates)
from __future__ import annotations

from pathlib import Path

from drawing import Builder, box, rod

HERE = Path(__file__).resolve().parent

COLOURS = {
    "frame": (0.20, 0.30, 0.45), "steel": (0.70, 0.72, 0.75), "dark": (0.11, 0.11, 0.12),
    "plate": (0.85, 0.60, 0.12), "handle": (0.75, 0.10, 0.09), "ruler": (0.96, 0.94, 0.82),
    "sensor": (0.10, 0.45, 0.85), "antenna": (0.96, 0.96, 0.96),
}  # fmt: skip

MIDDLE = 1.0
"""Height of the plate in the middle of its travel."""
TRAVEL = 0.2
"""Either way (paper 002: 0 to 400 mm)."""
RAILS_Y = 0.25
LOW, HIGH = 0.55, 1.45
"""Ends of the rails."""
PLATE_Z = 0.09
"""Half the plate's height."""


def rail_visuals() -> list[str]:
    stop = TRAVEL + PLATE_Z + 0.015
    length, middle = HIGH - LOW, 0.5 * (HIGH + LOW)
    parts = [
        box("dark", (0.80, 0.90, 0.04), (0, 0, 0.02)),
        box("frame", (0.10, 0.66, 0.08), (-0.12, 0, HIGH + 0.04)), box("frame", (0.10, 0.66, 0.08), (-0.12, 0, LOW)),
        # ruler with a mark at every tenth of a metre of travel, and the transducer's housing
        box("ruler", (0.012, 0.06, 0.56), (-0.03, 0.36, MIDDLE)),
        box("frame", (0.02, 0.08, 0.60), (-0.045, 0.36, MIDDLE)),
        rod("sensor", 0.022, 0.30, (-0.02, -0.08, LOW + 0.02)), rod("steel", 0.008, 0.20, (-0.02, -0.08, LOW + 0.22)),
    ]  # fmt: skip
    for mark in range(-2, 3):
        size = (0.014, 0.06, 0.006) if mark == 0 else (0.014, 0.035, 0.004)
        parts.append(box("dark", size, (-0.029, 0.36, MIDDLE + 0.1 * mark)))
    for side in (1, -1):
        y = side * RAILS_Y
        parts += [
            box("frame", (0.08, 0.08, HIGH + 0.04), (-0.12, side * 0.29, 0.5 * (HIGH + 0.08))),
            rod("steel", 0.015, length, (0, y, middle)),
            # limit stops
            rod("dark", 0.035, 0.03, (0, y, MIDDLE + stop)), rod("dark", 0.035, 0.03, (0, y, MIDDLE - stop)),
            box("frame", (0.14, 0.05, 0.05), (-0.06, y, HIGH)), box("frame", (0.14, 0.05, 0.05), (-0.06, y, LOW)),
            box("frame", (0.62, 0.06, 0.06), (0, side * 0.29, 0.06)),
            box("frame", (0.40, 0.05, 0.05), (-0.21, side * 0.29, 0.25), (0, -1.10, 0)),
        ]  # fmt: skip
    return parts


def plate_visuals() -> list[str]:
    parts = [
        box("plate", (0.03, 0.56, 2.0 * PLATE_Z), (0.035, 0, 0)),
        # handle
        box("steel", (0.10, 0.02, 0.02), (0.10, 0.11, 0)), box("steel", (0.10, 0.02, 0.02), (0.10, -0.11, 0)),
        box("handle", (0.03, 0.26, 0.03), (0.155, 0, 0)),
        # pointer on the ruler, arm to the transducer's rod
        box("handle", (0.02, 0.10, 0.006), (0.0, 0.325, 0)), box("steel", (0.03, 0.04, 0.04), (0.005, -0.08, -0.06)),
        # AHRS, antenna on a post above the frame
        box("sensor", (0.05, 0.06, 0.03), (0.06, 0.0, PLATE_Z + 0.015)),
        box("dark", (0.04, 0.05, 0.02), (0.06, 0.0, PLATE_Z - 0.01)),
        rod("steel", 0.012, 0.70, (0.07, 0.16, 0.36)), rod("antenna", 0.075, 0.05, (0.07, 0.16, 0.735)),
        rod("dark", 0.05, 0.02, (0.07, 0.16, 0.70)),
    ]  # fmt: skip
    for side in (1, -1):
        parts += [box("dark", (0.05, 0.07, 0.05), (0, side * RAILS_Y, z)) for z in (0.055, -0.055)]
    return parts


def main() -> None:
    build = Builder("rail_bench", COLOURS)
    build.link("rail", 120, (0, 0, 0.5), (35, 33, 12), rail_visuals())
    build.link("plate", 8, (0.04, 0.03, 0.05), (0.30, 0.15, 0.25), plate_visuals())
    build.slide("plate", "rail", "plate", (0, 0, MIDDLE), -TRAVEL, TRAVEL)
    build.write(HERE, {})


if __name__ == "__main__":
    main()
