"""The attitude that our heading filter holds above its engine: quaternions, their matrices, and the heading."""

from __future__ import annotations

import numpy as np

from twin.estimators.heading_model import exponential, product, rotation_of
from twin.geometry import wrap_angle
from twin.signals import BoolArray, FloatArray


class HeldAttitude:
    """Attitude of R members, body to world."""

    def __init__(self, heading_rad: float, *, runs: int) -> None:
        self.q: FloatArray = np.tile([0.0, 0.0, np.sin(0.5 * heading_rad), np.cos(0.5 * heading_rad)], (runs, 1))
        """(R, 4), (x, y, z, w)."""
        self.matrix: FloatArray = rotation_of(self.q)
        """(R, 3, 3)."""
        self.heading: FloatArray = np.full(runs, heading_rad)
        """(R,) without jumps, rad."""

    def level(self, members: BoolArray, *, roll: FloatArray, pitch: FloatArray, heading: FloatArray) -> None:
        """Set the attitude of some members, (R,) each, rad."""
        level = product(_about(1, pitch), _about(0, roll))
        level = product(_about(2, heading), level)
        self.q = np.where(members[:, np.newaxis], level, self.q)
        self._follow()

    def turn(self, rate: FloatArray, dt_s: float) -> FloatArray:
        """Turn at body rates (R, 3), rad/s; return the matrices (R, 3, 3) of half the way."""
        half = rotation_of(product(self.q, exponential(0.5 * dt_s * rate)))
        self.q = product(self.q, exponential(dt_s * rate))
        self._follow()
        return half

    def correct(self, rotation: FloatArray) -> None:
        """Turn by rotation vectors in world axes (R, 3), rad."""
        self.q = product(exponential(rotation), self.q)
        self._follow()

    def tilt(self) -> tuple[FloatArray, FloatArray]:
        """Roll and pitch (R,), rad."""
        matrix = self.matrix
        return np.arctan2(matrix[:, 2, 1], matrix[:, 2, 2]), np.arcsin(np.clip(-matrix[:, 2, 0], -1.0, 1.0))

    def _follow(self) -> None:
        self.matrix = rotation_of(self.q)
        heading = np.arctan2(self.matrix[:, 1, 0], self.matrix[:, 0, 0])
        self.heading = self.heading + wrap_angle(heading - self.heading)


def _about(axis: int, angle: FloatArray) -> FloatArray:
    vector = np.zeros((len(angle), 3))
    vector[:, axis] = angle
    return exponential(vector)
