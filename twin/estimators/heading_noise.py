"""What our heading filter holds of its sensors and its machine: their data sheets, and what no data sheet says."""

from __future__ import annotations

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.signals import SensorInfo


class HeadingNoiseConfig(Config):
    """What a data sheet may leave out, and what is not in any."""

    accel_m_s2: Positive = 0.05
    """Of an accelerometer sample (MPU6050 at rest, 100 Hz)."""
    gyro_rad_s: Positive = float(np.deg2rad(0.05))
    """Of a gyroscope sample (MPU6050 data sheet)."""
    gyro_bias_rad_s: Positive = float(np.deg2rad(20.0))
    """Bias at the start (MPU6050 data sheet)."""
    gyro_bias_walk_rad_s_rts: Positive = 1e-5
    """Growth of the bias per root of a second (MPU6050: 0.3e-5 in one room, more while it warms up)."""
    gyro_scale_ratio: NonNegative = 0.01
    """Scale error of a gyroscope axis."""
    gyro_cross_axis_ratio: NonNegative = 0.01
    """What a gyroscope axis reads of the others' rates (MPU6050 data sheet: +-2 %, read as two sigma)."""
    sway_rad_s: NonNegative = 0.3
    """Rates up to this about another axis are sway that comes back, and what they leak adds up to nothing; a choice."""
    field_ut: Positive = 0.5
    """Of a magnetometer sample (paper 001, section 4.1: 0.24 to 0.70)."""
    level_rad: NonNegative = 0.01
    """Slope of the ground on which the accelerometer's offset was taken, where it was: what that hides of a tilt."""
    speed_m_s: Positive = 1.0
    """Speed of the machine, or of a hand that carries it, 1 sigma; a choice."""
    speed_s: Positive = 0.5
    """How long it keeps such a speed; a choice."""


class Sheet:
    """What the sensors' data sheets say, 1 sigma."""

    def __init__(self, *, accel: float, accel_bias: float, gyro: float, bias: float, walk: float, scale: float) -> None:
        self.accel, self.accel_bias = accel, accel_bias
        self.gyro, self.bias, self.bias_walk, self.scale = gyro, bias, walk, scale
        self.field = 0.0

    @classmethod
    def of(cls, imu: SensorInfo, magnetometer: SensorInfo | None, noise: HeadingNoiseConfig) -> Sheet:
        """Read the data sheets; where one says nothing (or nothing but zero), take what ``noise`` says."""
        sheet = imu.datasheet
        wander = 2.0 * sheet.get("gyro_bias_instability_rad_s", 0.0) ** 2 / sheet.get("gyro_bias_correlation_s", 100.0)
        walk = float(np.sqrt(wander + sheet.get("gyro_bias_random_walk_rad_s_rts", 0.0) ** 2))
        made = cls(
            accel=sheet.get("accel_noise_m_s2", 0.0) or noise.accel_m_s2,
            accel_bias=sheet.get("accel_bias_m_s2", 0.0),
            gyro=sheet.get("gyro_noise_rad_s", 0.0) or noise.gyro_rad_s,
            bias=sheet.get("gyro_bias_rad_s", 0.0) or noise.gyro_bias_rad_s,
            walk=walk or noise.gyro_bias_walk_rad_s_rts,
            scale=sheet.get("gyro_scale_error_ratio", noise.gyro_scale_ratio),
        )
        if magnetometer is not None:
            made.field = magnetometer.datasheet.get("mag_noise_ut", 0.0) or noise.field_ut
        return made
