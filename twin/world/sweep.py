"""Beams of a turning head: where each starts and points, between the pose before and the pose now."""

from __future__ import annotations

import math

import numpy as np

from twin.signals import FloatArray


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
