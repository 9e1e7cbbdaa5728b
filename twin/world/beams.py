"""Beams of light from a turning head: where each starts and points, and what it meets first.

Beams meet trunks exactly, and the ground where it rises above them on steps of a fifth of a cell, the last step divided
in proportion. There is nothing else to meet.
"""

# ruff: noqa: PLR0917 (compiled functions are called by position: keywords cost time there)
from __future__ import annotations

import math

import numpy as np

from twin.compiled import compiled
from twin.signals import FloatArray
from twin.world.orchard import BOTTOM, EAST, NORTH, RADIUS, TOP


def swept_beams(
    before: tuple[FloatArray, FloatArray], now: tuple[FloatArray, FloatArray], bearings_rad: FloatArray, share: float
) -> tuple[FloatArray, FloatArray]:
    """Origins and unit directions (n, 3) in the world of n beams that are sent one after the other.

    A pose is a position (3,) and a rotation to the world (3, 3). Between the two the head is taken to move and turn at
    constant rates. The beams go out evenly over the last ``share`` of that time, the last one now; bearings are
    counter-clockwise from the mount's x axis, in its x-y plane.
    """
    count = len(bearings_rad)
    when = 1.0 - share * (1.0 - np.arange(1, count + 1) / count)
    (start, turned), (end, rotation) = before, now
    origins = start + when[:, np.newaxis] * (end - start)
    local = np.column_stack([np.cos(bearings_rad), np.sin(bearings_rad), np.zeros(count)])
    axis, angle = _axis_angle(turned.T @ rotation)
    part = (when * angle)[:, np.newaxis]
    along = (local @ axis)[:, np.newaxis] * axis
    # Rodrigues' formula.
    moved = local * np.cos(part) + np.cross(axis, local) * np.sin(part) + along * (1.0 - np.cos(part))
    return origins, moved @ turned.T


def _axis_angle(rotation: FloatArray) -> tuple[FloatArray, float]:
    """Unit axis (3,) and angle of a rotation by less than half a turn."""
    twist = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(twist))
    if sine < 1e-12:
        return np.array([0.0, 0.0, 1.0]), 0.0
    return twist / sine, math.atan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0))


@compiled
def cast(
    origins: FloatArray, directions: FloatArray, reach: float, trunks: FloatArray,
    heights: FloatArray, west: float, south: float, cell: float, highest: float, out: FloatArray,
) -> None:  # fmt: skip
    """Distance to what each beam meets first into ``out`` (n,), infinite where nothing lies within ``reach``.

    Beams start at ``origins`` (n, 3) along unit ``directions`` (n, 3); ``highest`` is the highest point of the ground.
    """
    for ray in range(origins.shape[0]):
        ox, oy, oz = origins[ray, 0], origins[ray, 1], origins[ray, 2]
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        nearest = reach
        met = False
        level = dx * dx + dy * dy
        if level > 0.0:
            for index in range(trunks.shape[0]):
                trunk = trunks[index]
                ax, ay = trunk[EAST] - ox, trunk[NORTH] - oy
                middle = (ax * dx + ay * dy) / level
                gap = ax * ax + ay * ay - middle * middle * level
                square = trunk[RADIUS] * trunk[RADIUS] - gap
                if square < 0.0:
                    continue
                distance = middle - math.sqrt(square / level)
                if 0.0 <= distance < nearest and trunk[BOTTOM] <= oz + distance * dz <= trunk[TOP]:
                    nearest = distance
                    met = True
        if oz + min(0.0, dz) * nearest < highest:
            ground = _meets_ground(ox, oy, oz, dx, dy, dz, nearest, heights, west, south, cell)
            if ground < nearest:
                nearest = ground
                met = True
        out[ray] = nearest if met else math.inf


@compiled
def _meets_ground(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, reach: float,
    heights: FloatArray, west: float, south: float, cell: float,
) -> float:  # fmt: skip
    """Distance to the ground along a beam; infinite where it stays above it or leaves the terrain."""
    rows, columns = heights.shape
    step = 0.2 * cell
    s = before = above = 0.0
    while True:
        x = (ox + s * dx - west) / cell
        y = (oy + s * dy - south) / cell
        if not (0.0 <= x <= columns - 1 and 0.0 <= y <= rows - 1):
            return math.inf
        i, j = min(int(x), columns - 2), min(int(y), rows - 2)
        u, v = x - i, y - j
        lower = heights[j, i] + u * (heights[j, i + 1] - heights[j, i])
        upper = heights[j + 1, i] + u * (heights[j + 1, i + 1] - heights[j + 1, i])
        now = oz + s * dz - (lower + v * (upper - lower))
        if now <= 0.0:
            return before + (s - before) * above / (above - now) if now < above else s
        if s >= reach:
            return math.inf
        above, before = now, s
        s = min(s + step, reach)
