"""What happens at every physics step, outside pybullet: where every link is, and what the ground does to the wheels.

The machine is a tree: link 0 is the root, link i + 1 hangs on joint i. From pose and velocity of the root and of the
joints :func:`move_links` works out every link's pose and velocity. :func:`ground_forces` sums all forces into what the
tree needs: one wrench on the root and one moment (on a slide, one force) per joint. That is exact: a force F at a point
p of a link acts on the generalised coordinates as F and (p - c) x F on the root (c: its centre of mass), as
a_j . ((p - p_j) x F) on each hinge j between (axis a_j through p_j) and as a_j . F on each slide, and it costs three
calls instead of one per wheel.
"""

# ruff: noqa: PLR0917 (compiled functions are called by position: keywords cost time there)
from __future__ import annotations

import math

import numpy as np

from twin.compiled import compiled
from twin.signals import FloatArray, IntArray
from twin.world.tyres import (
    ARM,
    HALF_LENGTH,
    HALF_WIDTH,
    NORMAL,
    RADIUS,
    SPIN_INERTIA,
    ground_plane,
    tyre_force,
)

# Layout of the state read from pybullet: root's centre of mass, quaternion, velocity, angular velocity, then positions
# (rad, m) and rates of the joints.
POSITION, QUATERNION, LINEAR, ANGULAR, JOINTS = 0, 3, 7, 10, 13

# Layout of a link's row: origin (3), rotation (9, row-major), velocity of the origin (3), angular velocity (3).
ORIGIN, ROTATION, VELOCITY, RATE = 0, 3, 12, 15
LINK_COLUMNS = 18

# Layout of a joint's constant row: origin in the parent (3), rotation to the parent (9), axis (3), 1 if it slides.
SLIDES = 15
JOINT_COLUMNS = 16

# Layout of a watched mount's row: position on the link (3), rotation to the link (9).
MOUNT_COLUMNS = 12
# Layout of its accumulator: position (3), rotation (9), velocity (3), sums of specific force (3) and rate (3), position
# at the beginning of the interval (3), specific force (3) and rate (3) of the latest step.
ACC_POSITION, ACC_ROTATION, ACC_VELOCITY, ACC_FORCE, ACC_RATE, ACC_START, ACC_LAST_FORCE, ACC_LAST_RATE = (
    0,
    3,
    12,
    15,
    18,
    21,
    24,
    27,
)
ACCUMULATOR_COLUMNS = 30

# Layout of a soil-engaging point's row: link, position on it (3), force, knee speed.
TOOL_FORCE = 4

# Layout of a spring's row: joint, stiffness and damping about it, moment at angle zero.
SPRING_JOINT, SPRING_STIFFNESS, SPRING_DAMPING, SPRING_PRELOAD = range(4)

OK, OFF_TERRAIN, NOT_FINITE, TIPPED = range(4)
_COS_TIPPED = 0.5
"""A body whose up axis leans by more than 60 degrees has tipped over."""


@compiled
def move_links(
    parents: IntArray, joints: FloatArray, root_com: FloatArray, state: FloatArray, links: FloatArray
) -> None:
    """Fill ``links`` (L, LINK_COLUMNS) from ``state``."""
    x, y, z, w = state[3], state[4], state[5], state[6]
    root = links[0]
    root[3], root[4], root[5] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)
    root[6], root[7], root[8] = 2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)
    root[9], root[10], root[11] = 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)
    for k in range(3):
        root[RATE + k] = state[ANGULAR + k]
    # pybullet speaks of the centre of mass; the link's frame lies at -com from it.
    dx = -(root[3] * root_com[0] + root[4] * root_com[1] + root[5] * root_com[2])
    dy = -(root[6] * root_com[0] + root[7] * root_com[1] + root[8] * root_com[2])
    dz = -(root[9] * root_com[0] + root[10] * root_com[1] + root[11] * root_com[2])
    root[0], root[1], root[2] = state[0] + dx, state[1] + dy, state[2] + dz
    root[12] = state[7] + root[16] * dz - root[17] * dy
    root[13] = state[8] + root[17] * dx - root[15] * dz
    root[14] = state[9] + root[15] * dy - root[16] * dx
    count = parents.shape[0]
    for j in range(count):
        _hang(links[parents[j]], joints[j], state[JOINTS + j], state[JOINTS + count + j], links[j + 1])


@compiled
def _hang(parent: FloatArray, joint: FloatArray, angle: float, rate: float, child: FloatArray) -> None:
    """Place a child link on its parent."""
    ox, oy, oz = joint[0], joint[1], joint[2]
    ax, ay, az = joint[12], joint[13], joint[14]
    stroke = stroke_rate = 0.0
    if joint[SLIDES] > 0.0:
        stroke, stroke_rate, angle, rate = angle, rate, 0.0, 0.0
    cosine, sine = math.cos(angle), math.sin(angle)
    rest = 1.0 - cosine
    turn = (
        (cosine + ax * ax * rest, ax * ay * rest - az * sine, ax * az * rest + ay * sine),
        (ay * ax * rest + az * sine, cosine + ay * ay * rest, ay * az * rest - ax * sine),
        (az * ax * rest - ay * sine, az * ay * rest + ax * sine, cosine + az * az * rest),
    )
    for r in range(3):
        p0, p1, p2 = parent[3 + 3 * r], parent[4 + 3 * r], parent[5 + 3 * r]
        # parent rotation times the joint's fixed rotation
        m0 = p0 * joint[3] + p1 * joint[6] + p2 * joint[9]
        m1 = p0 * joint[4] + p1 * joint[7] + p2 * joint[10]
        m2 = p0 * joint[5] + p1 * joint[8] + p2 * joint[11]
        for c in range(3):
            child[3 + 3 * r + c] = m0 * turn[0][c] + m1 * turn[1][c] + m2 * turn[2][c]
        axis = m0 * ax + m1 * ay + m2 * az
        child[r] = p0 * ox + p1 * oy + p2 * oz + stroke * axis  # lever arm, for now
        child[RATE + r] = parent[RATE + r] + rate * axis
        child[VELOCITY + r] = stroke_rate * axis
    dx, dy, dz = child[0], child[1], child[2]
    wx, wy, wz = parent[15], parent[16], parent[17]
    child[12] += parent[12] + wy * dz - wz * dy
    child[13] += parent[13] + wz * dx - wx * dz
    child[14] += parent[14] + wx * dy - wy * dx
    child[0], child[1], child[2] = parent[0] + dx, parent[1] + dy, parent[2] + dz


@compiled
def place_mount(link: FloatArray, mount: FloatArray, out: FloatArray) -> None:
    """Position, rotation and velocity of a mount into the first 15 numbers of ``out``."""
    dx = link[3] * mount[0] + link[4] * mount[1] + link[5] * mount[2]
    dy = link[6] * mount[0] + link[7] * mount[1] + link[8] * mount[2]
    dz = link[9] * mount[0] + link[10] * mount[1] + link[11] * mount[2]
    out[0], out[1], out[2] = link[0] + dx, link[1] + dy, link[2] + dz
    for r in range(3):
        a, b, c = link[3 + 3 * r], link[4 + 3 * r], link[5 + 3 * r]
        for k in range(3):
            out[3 + 3 * r + k] = a * mount[3 + k] + b * mount[6 + k] + c * mount[9 + k]
    wx, wy, wz = link[15], link[16], link[17]
    out[12] = link[12] + wy * dz - wz * dy
    out[13] = link[13] + wz * dx - wx * dz
    out[14] = link[14] + wx * dy - wy * dx


@compiled
def watch_mounts(
    bodies: IntArray, mounts: FloatArray, links: FloatArray, sums: FloatArray, dt: float, gravity: float
) -> None:
    """Add one step to the accumulators of the watched mounts.

    Specific force is the change of velocity over the step minus gravity, in axes half-way between the step's two
    attitudes; the rate is the one the step turned with, in the same axes.
    """
    now = np.empty(15)
    for m in range(bodies.shape[0]):
        link, total = links[bodies[m]], sums[m]
        place_mount(link, mounts[m], now)
        fx = (now[12] - total[12]) / dt
        fy = (now[13] - total[13]) / dt
        fz = (now[14] - total[14]) / dt + gravity
        for k in range(3):
            a = 0.5 * (total[3 + k] + now[3 + k])
            b = 0.5 * (total[6 + k] + now[6 + k])
            c = 0.5 * (total[9 + k] + now[9 + k])
            force = a * fx + b * fy + c * fz
            rate = a * link[15] + b * link[16] + c * link[17]
            total[ACC_FORCE + k] += force
            total[ACC_RATE + k] += rate
            total[ACC_LAST_FORCE + k] = force
            total[ACC_LAST_RATE + k] = rate
        for k in range(15):
            total[k] = now[k]


@compiled
def _add_force(
    parents: IntArray, joints: FloatArray, links: FloatArray, link: int, point: tuple[float, float, float],
    force: tuple[float, float, float], com: FloatArray, loads: FloatArray,
) -> None:  # fmt: skip
    """Add a force at a point of a link to ``loads``: force (3) and moment (3) on the root, then one per joint."""
    fx, fy, fz = force
    dx, dy, dz = point[0] - com[0], point[1] - com[1], point[2] - com[2]
    loads[0] += fx
    loads[1] += fy
    loads[2] += fz
    loads[3] += dy * fz - dz * fy
    loads[4] += dz * fx - dx * fz
    loads[5] += dx * fy - dy * fx
    while link > 0:
        row, joint = links[link], joints[link - 1]
        ax = row[3] * joint[12] + row[4] * joint[13] + row[5] * joint[14]
        ay = row[6] * joint[12] + row[7] * joint[13] + row[8] * joint[14]
        az = row[9] * joint[12] + row[10] * joint[13] + row[11] * joint[14]
        if joint[SLIDES] > 0.0:
            loads[5 + link] += ax * fx + ay * fy + az * fz
        else:
            dx, dy, dz = point[0] - row[0], point[1] - row[1], point[2] - row[2]
            loads[5 + link] += ax * (dy * fz - dz * fy) + ay * (dz * fx - dx * fz) + az * (dx * fy - dy * fx)
        link = parents[link - 1]


@compiled
def ground_forces(
    parents: IntArray, joints: FloatArray, state: FloatArray, links: FloatArray,
    wheel_joints: IntArray, wheels: FloatArray, deflections: FloatArray, results: FloatArray,
    heights: FloatArray, west: float, south: float, cell: float, dt: float, loads: FloatArray,
) -> int:  # fmt: skip
    """Forces of the ground on all wheels into ``loads`` (6 + joints); tell if the machine cannot go on."""
    loads[:] = 0.0
    if not np.isfinite(state.sum()):
        return NOT_FINITE
    com = state[0:3]
    count = parents.shape[0]
    for i in range(wheel_joints.shape[0]):
        j = wheel_joints[i]
        hub, joint, carrier = links[j + 1], joints[j], links[parents[j]]
        if carrier[11] < _COS_TIPPED:
            return TIPPED
        # spin axis, pointing left
        ax = hub[3] * joint[12] + hub[4] * joint[13] + hub[5] * joint[14]
        ay = hub[6] * joint[12] + hub[7] * joint[13] + hub[8] * joint[14]
        az = hub[9] * joint[12] + hub[10] * joint[13] + hub[11] * joint[14]
        level = math.hypot(ax, ay)
        hx, hy = ay / level, -ax / level
        wheel = wheels[i]
        mean, along, across, inside = ground_plane(
            heights, west, south, cell, hub[0], hub[1], hx, hy, wheel[HALF_LENGTH], wheel[HALF_WIDTH]
        )
        if not inside:
            return OFF_TERRAIN
        gx, gy = along * hx - across * hy, along * hy + across * hx
        nz = 1.0 / math.sqrt(1.0 + gx * gx + gy * gy)
        nx, ny = -gx * nz, -gy * nz
        # forward in the ground plane: axis x normal
        fx, fy, fz = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
        size = math.sqrt(fx * fx + fy * fy + fz * fz)
        fx, fy, fz = fx / size, fy / size, fz / size
        lx, ly, lz = ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx
        arm = (hub[2] - mean) * nz
        wx, wy, wz = hub[15], hub[16], hub[17]
        rx, ry, rz = -arm * nx, -arm * ny, -arm * nz
        vx = hub[12] + wy * rz - wz * ry
        vy = hub[13] + wz * rx - wx * rz
        vz = hub[14] + wx * ry - wy * rx
        closing = -(hub[12] * nx + hub[13] * ny + hub[14] * nz)
        renewal = abs(state[JOINTS + count + j] * arm)
        result = results[i]
        tyre_force(
            wheel, deflections[i], result, dt, wheel[RADIUS] - arm, closing,
            fx * vx + fy * vy + fz * vz, lx * vx + ly * vy + lz * vz, renewal,
        )  # fmt: skip
        result[ARM] = arm
        n, x, y = result[0], result[1], result[2]
        force = (n * nx + x * fx + y * lx, n * ny + x * fy + y * ly, n * nz + x * fz + y * lz)
        _add_force(parents, joints, links, j + 1, (hub[0] + rx, hub[1] + ry, hub[2] + rz), force, com, loads)
    return OK


@compiled
def tool_forces(
    parents: IntArray, joints: FloatArray, state: FloatArray, links: FloatArray, tools: FloatArray, loads: FloatArray
) -> None:
    """Add the draught of soil-engaging points; a row of ``tools`` is link, x, y, z, force and knee speed."""
    com = state[0:3]
    for i in range(tools.shape[0]):
        tool = tools[i]
        link = int(tool[0])
        row = links[link]
        dx = row[3] * tool[1] + row[4] * tool[2] + row[5] * tool[3]
        dy = row[6] * tool[1] + row[7] * tool[2] + row[8] * tool[3]
        dz = row[9] * tool[1] + row[10] * tool[2] + row[11] * tool[3]
        vx = row[12] + row[16] * dz - row[17] * dy
        vy = row[13] + row[17] * dx - row[15] * dz
        vz = row[14] + row[15] * dy - row[16] * dx
        fx, fy, fz = row[3], row[6], row[9]
        speed = fx * vx + fy * vy + fz * vz
        size = -tool[4] * speed / math.sqrt(speed * speed + tool[5] * tool[5])
        point = (row[0] + dx, row[1] + dy, row[2] + dz)
        _add_force(parents, joints, links, link, point, (size * fx, size * fy, size * fz), com, loads)


@compiled
def spring_moments(state: FloatArray, springs: FloatArray, loads: FloatArray) -> None:
    """Add the moments of springs and dampers in hinges."""
    count = (state.shape[0] - JOINTS) // 2
    for i in range(springs.shape[0]):
        spring = springs[i]
        j = int(spring[SPRING_JOINT])
        angle, rate = state[JOINTS + j], state[JOINTS + count + j]
        loads[6 + j] += spring[SPRING_PRELOAD] - spring[SPRING_STIFFNESS] * angle - spring[SPRING_DAMPING] * rate


@compiled
def dry_moments(
    state: FloatArray, wheel_joints: IntArray, wheels: FloatArray, results: FloatArray, rolling_resistance: float,
    torque: FloatArray, brake: FloatArray, dt: float, loads: FloatArray, limits: FloatArray,
) -> None:  # fmt: skip
    """Drive torques, and brakes and rolling resistance of the wheels, onto the joints.

    A dry moment that cannot stop its wheel within this step is a plain torque against the rotation. One that might is
    left to pybullet's joint motor (``limits``), which finds the moment that holds the wheel: exact, but each such row
    costs the solver time. Where both apply they give the same motion.
    """
    count = torque.shape[0]
    for j in range(count):
        loads[6 + j] += torque[j]
    for i in range(wheel_joints.shape[0]):
        j = wheel_joints[i]
        rate = state[JOINTS + count + j]
        moment = brake[j] + rolling_resistance * results[i, NORMAL] * results[i, ARM]
        fastest_stop = (moment + abs(loads[6 + j])) * dt / wheels[i, SPIN_INERTIA]
        if abs(rate) > 2.0 * fastest_stop:
            loads[6 + j] -= math.copysign(moment, rate)
            limits[j] = 0.0
        else:
            limits[j] = moment


@compiled
def forces(
    parents: IntArray, joints: FloatArray, state: FloatArray, links: FloatArray,
    wheel_joints: IntArray, wheels: FloatArray, deflections: FloatArray, results: FloatArray,
    heights: FloatArray, west: float, south: float, cell: float, tools: FloatArray, springs: FloatArray,
    rolling_resistance: float, torque: FloatArray, brake: FloatArray, dt: float,
    loads: FloatArray, limits: FloatArray,
) -> int:  # fmt: skip
    """All that acts on the machine during one step; tell if it cannot go on."""
    status = ground_forces(
        parents, joints, state, links, wheel_joints, wheels, deflections, results, heights, west, south, cell, dt, loads
    )
    if status == OK:
        tool_forces(parents, joints, state, links, tools, loads)
        spring_moments(state, springs, loads)
        dry_moments(state, wheel_joints, wheels, results, rolling_resistance, torque, brake, dt, loads, limits)
    return status


@compiled
def motion(
    parents: IntArray, joints: FloatArray, root_com: FloatArray, state: FloatArray, links: FloatArray,
    bodies: IntArray, mounts: FloatArray, sums: FloatArray, dt: float, gravity: float,
) -> None:  # fmt: skip
    """Where everything is after a step, and what the watched mounts felt during it."""
    move_links(parents, joints, root_com, state, links)
    watch_mounts(bodies, mounts, links, sums, dt, gravity)


@compiled
def reference_truth(links: FloatArray, body: int, mount: FloatArray, rows: FloatArray, out: FloatArray) -> None:
    """Motion of the reference frame and its rows into ``out``.

    Position (3), velocity (3), heading, roll, pitch, forward speed, yaw rate, then per row speed, east and north.
    """
    frame = np.empty(15)
    link = links[body]
    place_mount(link, mount, frame)
    for k in range(3):
        out[k], out[3 + k] = frame[k], frame[12 + k]
    heading = math.atan2(frame[6], frame[3])
    out[6] = heading
    out[7] = math.atan2(frame[10], frame[11])
    out[8] = math.asin(min(1.0, max(-1.0, -frame[9])))
    cosine, sine = math.cos(heading), math.sin(heading)
    out[9] = frame[12] * cosine + frame[13] * sine
    # heading rate: of the x axis' horizontal direction; equals the vertical rate on level ground
    px = link[16] * frame[9] - link[17] * frame[6]
    py = link[17] * frame[3] - link[15] * frame[9]
    out[10] = (frame[3] * py - frame[6] * px) / (frame[3] ** 2 + frame[6] ** 2)
    for i in range(rows.shape[0]):
        dx, dy, dz = frame[4] * rows[i], frame[7] * rows[i], frame[10] * rows[i]
        vx = frame[12] + link[16] * dz - link[17] * dy
        vy = frame[13] + link[17] * dx - link[15] * dz
        out[11 + 3 * i] = vx * cosine + vy * sine
        out[12 + 3 * i] = frame[0] + dx
        out[13 + 3 * i] = frame[1] + dy
