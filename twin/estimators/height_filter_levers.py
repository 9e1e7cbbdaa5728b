"""How high one point of a rigid body is above another, by the attitude that an AHRS says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import BadInputError
from twin.geometry import rotation_from_rpy
from twin.signals import EstimatorSetup, FloatArray, Mount, SensorInfo


@dataclass(frozen=True, slots=True, kw_only=True)
class Lever:
    """The vector (m) from an AHRS to another point, in the axes of the AHRS."""

    xyz_m: tuple[float, float, float]
    upright: bool = False
    """Taken to stand still over the AHRS, however that leans: only its upward part counts."""

    @classmethod
    def between(cls, ahrs: SensorInfo, point: Mount, setup: EstimatorSetup, *, upright: bool = False) -> Lever:
        """From an AHRS to a point of the same body.

        Raises:
            BadInputError: they sit on different bodies.
        """
        if point.body != ahrs.mount.body:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors: {ahrs.name!r} sits on {ahrs.mount.body!r}, but the height of a "
                f"point on {point.body!r} is needed"
            )
        offset = rotation_from_rpy(*ahrs.mount.rpy_rad).T @ np.subtract(point.xyz_m, ahrs.mount.xyz_m)
        x, y, z = offset.tolist()
        return cls(xyz_m=(x, y, z), upright=upright)

    @property
    def is_nothing(self) -> bool:
        """Whether both are the same point."""
        return not any(self.xyz_m)

    def height(self, attitude: FloatArray) -> FloatArray:
        """(R,) of the point above the AHRS; ``attitude`` (3, R) is roll, pitch, heading."""
        x, y, z = self.xyz_m
        if self.upright:
            return np.full(attitude.shape[1], z)
        sine, cosine = np.sin(attitude[:2]), np.cos(attitude[:2])
        height: FloatArray = cosine[1] * (y * sine[0] + z * cosine[0]) - x * sine[1]
        return height

    def place(self, attitude: FloatArray) -> FloatArray:
        """(3, R) east, north and up of the point, seen from the AHRS."""
        if self.is_nothing:
            return np.zeros((3, attitude.shape[1]))
        x, y, z = self.xyz_m
        if self.upright:
            return np.repeat([[0.0], [0.0], [z]], attitude.shape[1], axis=1)
        (sine_r, sine_p, sine_h), (cosine_r, cosine_p, cosine_h) = np.sin(attitude), np.cos(attitude)
        across = y * sine_r + z * cosine_r
        forward, left = x * cosine_p + sine_p * across, y * cosine_r - z * sine_r
        east, north = cosine_h * forward - sine_h * left, sine_h * forward + cosine_h * left
        return np.stack([east, north, cosine_p * across - x * sine_p])

    def slope(self, attitude: FloatArray) -> FloatArray:
        """(R,) how fast that changes with an attitude error, m/rad, roll and pitch alike uncertain."""
        x, y, z = self.xyz_m
        if self.upright:
            return np.zeros(attitude.shape[1])
        sine, cosine = np.sin(attitude[:2]), np.cos(attitude[:2])
        by_roll = cosine[1] * (y * cosine[0] - z * sine[0])
        by_pitch = -sine[1] * (y * sine[0] + z * cosine[0]) - x * cosine[1]
        slope: FloatArray = np.hypot(by_roll, by_pitch)
        return slope
