"""Writes orchard_robot.urdf and orchard_robot_large.urdf with the meshes beside them: run it after changing a figure.

    python assets/machines/build_orchard_robot.py

The figures are those of ``twin.world.orchard_robot``; what is only drawn is here. Lengths in m, masses in kg.
Frames: x forward, y left, z up; the root's origin is the middle of the driven axle.
"""

# ruff: noqa: D103 (a drawing: names and coordinates)
from __future__ import annotations

import math
from pathlib import Path

from drawing import Builder, box, mesh, revolve, rim_mesh, rod, tyre_profile, wheel_visuals

from twin.world.orchard_robot import CASTER, DRIVEN, LARGE, SMALL, RobotSize

HERE = Path(__file__).resolve().parent

COLOURS = {
    "deck": (0.86, 0.88, 0.90), "steel": (0.55, 0.57, 0.60), "tyre": (0.08, 0.08, 0.085), "rim": (0.95, 0.76, 0.12),
    "motor": (0.93, 0.72, 0.10), "pi": (0.10, 0.50, 0.22), "arduino": (0.05, 0.45, 0.52), "driver": (0.72, 0.10, 0.12),
    "battery": (0.15, 0.16, 0.18), "lidar": (0.12, 0.12, 0.13), "sensor": (0.10, 0.35, 0.80),
    "camera": (0.10, 0.28, 0.14), "lens": (0.02, 0.02, 0.02), "wire": (0.85, 0.25, 0.10),
}  # fmt: skip


def board(colour: str, size: RobotSize, share: tuple, xyz: tuple) -> str:
    """A box whose size and place count in lengths of the deck (x, y) and its height above the axle (z)."""
    length, width, _ = size.chassis_size_m
    scale = (length, width, size.deck_z_m)
    return box(colour, tuple(a * b for a, b in zip(share, scale, strict=True)), xyz)


def chassis_visuals(size: RobotSize) -> list[str]:
    length, width, _ = size.chassis_size_m
    deck, middle = size.deck_z_m, size.deck_x_m
    inner = size.track_m - size.wheel_width_m
    thick = 0.02 * length
    radius = size.wheel_radius_m
    # Lower plate between the wheels, upper deck above them, four posts.
    parts = [
        box("deck", (length, 0.88 * inner, thick), (middle, 0, -0.10 * radius)),
        box("deck", (length, width, thick), (middle, 0, deck)),
    ]
    height = deck + 0.10 * radius
    for x in (middle - 0.44 * length, middle + 0.44 * length):
        parts += [rod("steel", 0.4 * thick, height, (x, y, deck - 0.5 * height)) for y in (0.36 * inner, -0.36 * inner)]
    # Gear motors on the axle with the slotted discs of the encoders at their inner ends.
    for side in (1.0, -1.0):
        parts.append(box("motor", (1.1 * radius, 0.24 * inner, 0.55 * radius), (0.25 * radius, 0.34 * side * inner, 0)))
        disc = (0, 0.17 * side * inner, 0)
        parts.append(rod("lens", 0.42 * radius, 0.012 * length, disc, (math.pi / 2, 0, 0)))
    # The caster's socket.
    above = size.caster_radius_m - radius
    gap = -0.10 * radius - above
    parts.append(rod("steel", 0.9 * size.caster_radius_m, gap, (size.caster_x_m, 0, above + 0.5 * gap)))
    parts += [
        board("battery", size, (0.34, 0.36, 0.42), (middle + 0.12 * length, 0, 0.26 * deck)),
        board("pi", size, (0.42, 0.44, 0.10), (middle - 0.18 * length, 0.22 * width, deck + 0.06 * deck + thick)),
        board("arduino", size, (0.34, 0.36, 0.10), (middle - 0.22 * length, -0.27 * width, deck + 0.06 * deck + thick)),
        board("driver", size, (0.20, 0.30, 0.36), (middle + 0.28 * length, -0.30 * width, deck + 0.2 * deck + thick)),
    ]
    return parts + sensor_visuals(size, thick)


def sensor_visuals(size: RobotSize, thick: float) -> list[str]:
    deck = size.deck_z_m
    mounts = {name: mount.xyz_m for name, mount in size.mounts.items()}
    lidar, camera, mast, imu = (mounts[name] for name in ("lidar", "camera", "magnetometer", "imu"))
    big = math.sqrt(size.chassis_size_m[0] / SMALL.chassis_size_m[0])
    parts = [box("sensor", (0.020 * big, 0.015 * big, 0.004), (imu[0], imu[1], deck + thick + 0.002))]
    # The lidar on four feet: a puck of 7 cm with a turning head.
    parts += [
        rod("lidar", 0.035 * big, 0.020, (lidar[0], 0, lidar[2] - 0.016)),
        rod("lidar", 0.026 * big, 0.016, (lidar[0], 0, lidar[2])),
        rod("steel", 0.010 * big, lidar[2] - 0.026 - deck, (lidar[0], 0, 0.5 * (deck + lidar[2] - 0.026))),
    ]
    # Camera on a bracket, looking ahead.
    parts += [
        box("steel", (0.004 * big, 0.016 * big, camera[2] - deck), (camera[0] - 0.008, 0, 0.5 * (deck + camera[2]))),
        box("camera", (0.005 * big, 0.025 * big, 0.024 * big), (camera[0] - 0.003, 0, camera[2])),
        rod("lens", 0.005 * big, 0.008 * big, (camera[0] + 0.002, 0, camera[2]), (0, math.pi / 2, 0)),
    ]
    # Magnetometer on a mast.
    parts += [
        rod("steel", 0.003 * big, mast[2] - deck, (mast[0], 0, 0.5 * (deck + mast[2]))),
        box("sensor", (0.018 * big, 0.018 * big, 0.004 * big), mast),
        rod("wire", 0.0012 * big, mast[2] - deck, (mast[0] - 0.004 * big, 0, 0.5 * (deck + mast[2]))),
    ]
    return parts


def ball_profile(radius: float) -> list[tuple[float, float]]:
    """Half a circle, from one pole to the other, and back along the axis."""
    angles = [math.pi * (step / 12.0 - 0.5) for step in range(13)]
    return [(max(0.0, radius * math.cos(angle)), radius * math.sin(angle)) for angle in angles]


def build(name: str, size: RobotSize) -> None:
    radius, width = size.wheel_radius_m, size.wheel_width_m
    meshes = {
        "tyre": revolve(tyre_profile(radius, width, 0.72 * radius), 36),
        "rim": rim_mesh(0.72 * radius, width, 5, 1.0),
        "ball": revolve(ball_profile(size.caster_radius_m), 24),
    }
    urdf = Builder(name, COLOURS)
    mass = size.chassis_mass_kg
    x, y, z = (side**2 for side in size.chassis_size_m)
    inertia = tuple(mass / 12.0 * (a + b) for a, b in ((y, z), (x, z), (x, y)))
    com = (size.chassis_x_m, 0, size.centre_of_mass_z_m)
    urdf.link("chassis", round(mass, 9), com, inertia, chassis_visuals(size))
    for side, joint in zip((1.0, -1.0), DRIVEN, strict=True):
        spin = size.wheel_inertia_kg_m2
        # The importer needs ixx + izz >= iyy.
        hub = joint.replace("wheel", "hub")
        urdf.link(hub, size.wheel_mass_kg, (0, 0, 0), (spin / 2, spin, spin / 2), wheel_visuals(name, "", "rim", side))
        urdf.joint(joint, "chassis", hub, (0, side * size.track_m / 2, 0), (0, 1, 0))
    ball = 0.4 * size.caster_mass_kg * size.caster_radius_m**2
    urdf.link("caster", size.caster_mass_kg, (0, 0, 0), (ball, ball, ball), [mesh("steel", f"{name}/ball")])
    urdf.joint(CASTER, "chassis", "caster", (size.caster_x_m, 0, size.caster_radius_m - radius), (0, 1, 0))
    urdf.write(HERE, meshes)


def main() -> None:
    build("orchard_robot", SMALL)
    build("orchard_robot_large", LARGE)


if __name__ == "__main__":
    main()
