"""Inertial measurement unit: three accelerometers and three gyroscopes (kind ``imu``).

Both triads follow the error model of :mod:`twin.sensors.noise`,

    x_out = Q( L(T x) + b_0 + b_rw + b_gm + n )

with x the mean specific force (m/s^2) or angular rate (rad/s) over the sample interval in the nominal mount's axes;
T scale, misalignment and the mounting tilt that both triads share; L a first-order low-pass if a bandwidth is given;
b_0 the bias at turn-on, b_rw its random walk, b_gm its instability (Gauss-Markov); n white noise, behind the same
first-order bandwidth if there is one; Q the converter. Without a bandwidth the unit integrates over its interval, as
units with delta-angle and delta-velocity outputs do, and noise and signal are averaged alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from twin.config import NonNegative, Positive
from twin.sensors import kernels
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.converter import Bits, converter
from twin.sensors.noise import (
    GaussMarkov,
    LowPass,
    RandomWalk,
    Streams,
    WhiteNoise,
    first_order_tau_s,
    noise_sigma,
    sensitivity_matrices,
)
from twin.signals import Capture, FloatArray, Mount, MountMotion

_COLUMNS = (
    "accel_x_m_s2",
    "accel_y_m_s2",
    "accel_z_m_s2",
    "gyro_x_rad_s",
    "gyro_y_rad_s",
    "gyro_z_rad_s",
)


class ImuConfig(SensorConfig):
    """Every error is one standard deviation; whatever is left out is absent. Noise densities are one-sided."""

    kind: Literal["imu"]

    accel_noise_density_m_s2_rthz: NonNegative = 0.0
    accel_bias_m_s2: NonNegative = 0.0
    """Bias at turn-on, drawn once per axis."""
    accel_bias_instability_m_s2: NonNegative = 0.0
    """The bias's Gauss-Markov part."""
    accel_bias_correlation_s: Positive = 100.0
    accel_bias_random_walk_m_s2_rts: NonNegative = 0.0
    """Growth of the bias's random walk, per square root of a second."""
    accel_scale_error_ratio: NonNegative = 0.0
    accel_misalignment_rad: NonNegative = 0.0
    """Each axis's part of each other axis."""
    accel_bandwidth_hz: Positive | None = None
    accel_range_m_s2: Positive | None = None

    gyro_noise_density_rad_s_rthz: NonNegative = 0.0
    gyro_bias_rad_s: NonNegative = 0.0
    """Bias at turn-on, drawn once per axis."""
    gyro_bias_instability_rad_s: NonNegative = 0.0
    """The bias's Gauss-Markov part."""
    gyro_bias_correlation_s: Positive = 100.0
    gyro_bias_random_walk_rad_s_rts: NonNegative = 0.0
    """Growth of the bias's random walk, per square root of a second."""
    gyro_scale_error_ratio: NonNegative = 0.0
    gyro_misalignment_rad: NonNegative = 0.0
    """Each axis's part of each other axis."""
    gyro_bandwidth_hz: Positive | None = None
    gyro_range_rad_s: Positive | None = None

    mounting_tilt_rad: NonNegative = 0.0
    """Roll, pitch and yaw of the unit as mounted against its nominal mount, each."""
    adc_bits: Bits | None = None
    """Resolution over +- the range; without it the output has all digits."""

    @model_validator(mode="after")
    def _check_converter(self) -> Self:
        if self.adc_bits is not None and self.accel_range_m_s2 is None and self.gyro_range_rad_s is None:
            raise ValueError("adc_bits needs accel_range_m_s2 or gyro_range_rad_s")
        return self

    @property
    def accel_noise_m_s2(self) -> float:
        """Noise of one sample, 1 sigma."""
        return noise_sigma(
            density=self.accel_noise_density_m_s2_rthz, rate_hz=self.rate_hz, bandwidth_hz=self.accel_bandwidth_hz
        )

    @property
    def gyro_noise_rad_s(self) -> float:
        """Noise of one sample, 1 sigma."""
        return noise_sigma(
            density=self.gyro_noise_density_rad_s_rthz, rate_hz=self.rate_hz, bandwidth_hz=self.gyro_bandwidth_hz
        )


def _triads(accel: float, gyro: float) -> FloatArray:
    """Six columns from one value per triad."""
    return np.repeat([accel, gyro], 3)


class Imu(Sensor):
    """Three-axis accelerometer and gyroscope. Hidden columns: each axis's bias now, and its total error."""

    columns = _COLUMNS
    error_columns = _COLUMNS
    extra_hidden_columns = tuple(f"{column}.bias" for column in _COLUMNS)

    def __init__(
        self, config: ImuConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        accel, gyro = _draw_sensitivity(config, self._streams)
        self._sensitivity = np.concatenate([accel, gyro], axis=1)
        self._truth = np.empty(6)
        self._bandwidth = _bandwidth(config, self.period_s)
        self._noise = _noise(config, self._streams, self.period_s)
        self._slow_bias, self._instability = _biases(config, self._streams, self.period_s)
        self._converter = converter(
            full_scale=[config.accel_range_m_s2] * 3 + [config.gyro_range_rad_s] * 3, bits=config.adc_bits
        )

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, MountMotion)
        truth = self._truth
        truth[:3] = capture.mean_specific_force_m_s2
        truth[3:] = capture.mean_rate_rad_s
        signal = np.empty((self._runs, 6))
        kernels.two_triads(self._sensitivity, truth, signal)
        if self._bandwidth is not None:
            signal = self._bandwidth.step(signal)
        bias = self._slow_bias.step() if isinstance(self._slow_bias, RandomWalk) else self._slow_bias
        if self._instability is not None:
            bias = bias + self._instability.step()
        values = signal + bias
        if self._noise is not None:
            np.add(values, self._noise.step(), out=values)
        return Reading(values=self._converter.apply(values), truth=truth, hidden=bias)

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, ImuConfig)
        sheet = {
            "accel_noise_m_s2": config.accel_noise_m_s2,
            "accel_noise_density_m_s2_rthz": config.accel_noise_density_m_s2_rthz,
            "accel_bias_m_s2": config.accel_bias_m_s2,
            "accel_bias_instability_m_s2": config.accel_bias_instability_m_s2,
            "accel_bias_correlation_s": config.accel_bias_correlation_s,
            "accel_bias_random_walk_m_s2_rts": config.accel_bias_random_walk_m_s2_rts,
            "gyro_noise_rad_s": config.gyro_noise_rad_s,
            "gyro_noise_density_rad_s_rthz": config.gyro_noise_density_rad_s_rthz,
            "gyro_bias_rad_s": config.gyro_bias_rad_s,
            "gyro_bias_instability_rad_s": config.gyro_bias_instability_rad_s,
            "gyro_bias_correlation_s": config.gyro_bias_correlation_s,
            "gyro_bias_random_walk_rad_s_rts": config.gyro_bias_random_walk_rad_s_rts,
            "gyro_scale_error_ratio": config.gyro_scale_error_ratio,
            "mounting_tilt_rad": config.mounting_tilt_rad,
        }
        optional = {
            "accel_bandwidth_hz": config.accel_bandwidth_hz,
            "accel_range_m_s2": config.accel_range_m_s2,
            "gyro_bandwidth_hz": config.gyro_bandwidth_hz,
            "gyro_range_rad_s": config.gyro_range_rad_s,
        }
        return sheet | {key: value for key, value in optional.items() if value is not None}

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        assert isinstance(config, ImuConfig)
        return _triads(config.accel_noise_m_s2, config.gyro_noise_rad_s)


def _draw_sensitivity(config: ImuConfig, streams: Streams) -> tuple[FloatArray, FloatArray]:
    """T of the accelerometers and of the gyroscopes, (R, 3, 3) each."""
    tilt = config.mounting_tilt_rad * streams.once("mounting_tilt", 3)
    return (
        sensitivity_matrices(
            scale=config.accel_scale_error_ratio * streams.once("accel_scale", 3),
            misalignment=config.accel_misalignment_rad * streams.once("accel_misalignment", 6),
            tilt_rpy_rad=tilt,
        ),
        sensitivity_matrices(
            scale=config.gyro_scale_error_ratio * streams.once("gyro_scale", 3),
            misalignment=config.gyro_misalignment_rad * streams.once("gyro_misalignment", 6),
            tilt_rpy_rad=tilt,
        ),
    )


def _taus_s(config: ImuConfig) -> FloatArray:
    return _triads(first_order_tau_s(config.accel_bandwidth_hz), first_order_tau_s(config.gyro_bandwidth_hz))


def _bandwidth(config: ImuConfig, period_s: float) -> LowPass | None:
    taus_s = _taus_s(config)
    return LowPass(tau_s=taus_s, period_s=period_s) if taus_s.any() else None


def _noise(config: ImuConfig, streams: Streams, period_s: float) -> WhiteNoise | GaussMarkov | None:
    sigma = _triads(config.accel_noise_m_s2, config.gyro_noise_rad_s)
    taus_s = _taus_s(config)
    if not sigma.any():
        return None
    if not taus_s.any():
        return WhiteNoise(sigma=sigma, stream=streams.normal("noise", 6))
    # White noise behind a first-order low-pass, sampled, is exactly a Gauss-Markov process.
    return GaussMarkov(
        sigma=sigma,
        tau_s=taus_s,
        period_s=period_s,
        stream=streams.normal("noise", 6),
        start=streams.once("noise_start", 6),
    )


def _biases(config: ImuConfig, streams: Streams, period_s: float) -> tuple[RandomWalk | FloatArray, GaussMarkov | None]:
    turn_on = streams.once("turn_on_bias", 6) * _triads(config.accel_bias_m_s2, config.gyro_bias_rad_s)
    walk = _triads(config.accel_bias_random_walk_m_s2_rts, config.gyro_bias_random_walk_rad_s_rts)
    slow: RandomWalk | FloatArray = turn_on
    if walk.any():
        slow = RandomWalk(density=walk, period_s=period_s, stream=streams.normal("bias_random_walk", 6), start=turn_on)
    sigma = _triads(config.accel_bias_instability_m_s2, config.gyro_bias_instability_rad_s)
    if not sigma.any():
        return slow, None
    instability = GaussMarkov(
        sigma=sigma,
        tau_s=_triads(config.accel_bias_correlation_s, config.gyro_bias_correlation_s),
        period_s=period_s,
        stream=streams.normal("bias_instability", 6),
        start=streams.once("bias_instability_start", 6),
    )
    return slow, instability
