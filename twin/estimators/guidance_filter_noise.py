"""What the guidance filter holds of its sensors and its machine: their data sheets, and what no data sheet says."""

from __future__ import annotations

import math

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.estimators.guidance_filter_model import PSI, B, Layout, MotionNoise, V
from twin.estimators.roles import IMU
from twin.signals import FloatArray, SensorInfo

_ROUNDING_S = 3.0
"""A gyro's rounding stays the same for so long on a machine that weaves; a choice."""
_ROUNDING_STANDING_S = 100.0
"""The same while it stands: an offset of less than a step is never seen."""


class NoiseConfig(Config):
    """What no data sheet says, 1 sigma; choices."""

    gyro_rad_s: Positive = 0.003
    """Noise of a sample of a gyro whose data sheet is silent."""
    gyro_bias_rad_s: Positive = 0.02
    """Its offset at the start."""
    gyro_bias_walk_rad_s_rts: Positive = 5e-5
    """Walk of the offset of a gyro whose data sheet is silent."""
    gyro_scale_ratio: NonNegative = 0.01
    """Its scale error."""
    turn_rad_s: Positive = 0.15
    """Rate of turn of a machine without a gyro."""
    turn_s: Positive = 2.0
    """How long that lasts."""
    turn_change_rad_s: Positive = 0.5
    """So much it may have begun to turn, or ceased to, where a velocity is not what was expected: a headland turn."""
    acceleration_m_s2_rthz: Positive = 1.0
    """Speed of a machine without a sensor of it walks by so much in a second."""
    slip_ratio: Positive = 0.01
    """Slip of the moment against the speed."""
    slip_s: Positive = 2.0
    """How long that lasts."""
    speed_scale_ratio: Positive = 0.05
    """Rolling radius and steady slip: scale of the told speed."""
    speed_scale_walk_rts: NonNegative = 0.001
    """Its walk while driving, per root of a second: other soil, other load."""
    walk_m_rtm: NonNegative = 0.01
    """Walk of the position per root of a metre: wheels that do not roll where they point."""
    steering_rad: Positive = 0.03
    """Of a steering angle against the way that is driven: slip angles, play."""
    steering_s: Positive = 1.0
    """How long that lasts."""
    steering_offset_rad: Positive = 0.03
    """Offset of the steering angle, where the data sheet is silent."""
    start_heading_rad: Positive = 0.1
    """Of the heading at the start, as set out by the owner."""
    sway_rad: NonNegative = 0.01
    """Tilt of the machine: it moves the antenna by that times its height."""
    sway_s: Positive = 1.0
    """How long that lasts."""
    velocity_m_s: Positive = 0.1
    """Of a receiver's velocity, each axis, where the data sheet is silent."""


class Gyro:
    """Noise of a gyro, from its data sheet."""

    def __init__(self, *, walk_noise: float, bias: float, bias_walk: float, scale: float, rounding: float) -> None:
        self.walk_noise, self.bias, self.bias_walk = walk_noise, bias, bias_walk
        self.scale, self.rounding = scale, rounding

    @property
    def walk_rad_rts(self) -> float:
        """Angle random walk, with the rounding."""
        return math.sqrt(self.walk_noise**2 + self.rounding**2 * _ROUNDING_S)

    @property
    def standing_variance(self) -> float:
        """Of the offset that a standing gyro shows for a second."""
        return self.walk_noise**2 + self.rounding**2 * _ROUNDING_STANDING_S

    @classmethod
    def of(cls, info: SensorInfo | None, noise: NoiseConfig) -> Gyro:
        """Read the data sheet of an inertial unit or a yaw gyro."""
        sheet = {} if info is None else info.datasheet
        prefix = "gyro_" if info is not None and info.kind == IMU else ""
        period_s = 1.0 if info is None else 1.0 / info.rate_hz
        sample = sheet.get(f"{prefix}noise_rad_s", 0.0) or noise.gyro_rad_s
        wander = 2.0 * sheet.get(f"{prefix}bias_instability_rad_s", 0.0) ** 2
        wander /= sheet.get(f"{prefix}bias_correlation_s", 100.0)
        wander += sheet.get(f"{prefix}bias_random_walk_rad_s_rts", 0.0) ** 2
        return cls(
            walk_noise=sample * math.sqrt(period_s),
            bias=sheet.get(f"{prefix}bias_rad_s", 0.0) or noise.gyro_bias_rad_s,
            bias_walk=math.sqrt(wander) or noise.gyro_bias_walk_rad_s_rts,
            scale=sheet.get(f"{prefix}scale_error_ratio", noise.gyro_scale_ratio),
            rounding=sheet.get("resolution_rad_s", 0.0) / math.sqrt(12.0),
        )


class MachineNoise:
    """How well the machine's states are known at the start, and how they wander."""

    def __init__(
        self, noise: NoiseConfig, layout: Layout, *, rate: SensorInfo | None, steering: SensorInfo | None
    ) -> None:
        self.gyro = Gyro.of(rate, noise)
        self._noise, self._layout = noise, layout
        self.motion = MotionNoise(
            heading_rad_rts=self.gyro.walk_rad_rts,
            bias_rad_s_rts=self.gyro.bias_walk,
            turn_rad_s=noise.turn_rad_s,
            turn_s=noise.turn_s,
            acceleration_m_s2_rthz=noise.acceleration_m_s2_rthz,
            slip_ratio=noise.slip_ratio,
            slip_s=noise.slip_s,
            scale_rts=noise.speed_scale_walk_rts,
            walk_m_rtm=noise.walk_m_rtm,
        )
        self._steering_offset = noise.steering_offset_rad
        if steering is not None:  # beside the mounting, play and slip angles that stay
            told = steering.datasheet.get("offset_sigma_rad", noise.steering_offset_rad)
            self._steering_offset = math.hypot(told, 0.5 * noise.steering_offset_rad)

    def start_variances(self) -> FloatArray:
        """(n,) of all states but position and the receiver's errors, which have none here."""
        layout, noise = self._layout, self._noise
        variances = np.zeros(layout.size)
        variances[PSI] = noise.start_heading_rad**2
        variances[B] = self.gyro.bias**2 if layout.has_rate else noise.turn_rad_s**2
        variances[V] = 1e-4 if layout.has_speed else 1.0
        if layout.scale is not None:
            variances[layout.scale] = noise.speed_scale_ratio**2
        if layout.gyro_scale is not None:
            variances[layout.gyro_scale] = self.gyro.scale**2
        if layout.steering is not None:
            variances[layout.steering] = self._steering_offset**2
        return variances
