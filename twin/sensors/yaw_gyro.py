"""Gyroscope for the yaw rate alone, read by a control unit that integrates it between two samples (kind ``yaw_gyro``).

    out = Q( (1 + k) r + b_0 + b_rw + n )

r is the mean rate about the mount's z axis over the sample interval: since the sample before, so that the sum of
``out`` times the interval is the angle turned, however unevenly the samples come. k is the scale error, b_0 the bias at
turn-on, b_rw its random walk, n white noise averaged over the interval, Q the range and the converter
(:mod:`twin.sensors.converter`).

A real gyroscope stops at its range, and is converted, before its rate is averaged. The world tells only the mean over
the interval, so here Q acts on the mean: a jerk beyond the range that is over within the interval is averaged as if the
gyroscope had followed it, and the converter's rounding is that of one conversion, although the mean of many noisy ones
is finer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from twin.config import NonNegative, Positive
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.converter import ConverterConfig, converter
from twin.sensors.noise import RandomWalk, WhiteNoise, noise_sigma
from twin.signals import YAW_RATE, Capture, FloatArray, Mount, MountMotion


class YawGyroConfig(SensorConfig):
    """Every error is one standard deviation; whatever is left out is absent. The noise density is one-sided."""

    kind: Literal["yaw_gyro"]
    noise_density_rad_s_rthz: NonNegative = 0.0
    bias_rad_s: NonNegative = 0.0
    """Bias at turn-on, drawn once."""
    bias_random_walk_rad_s_rts: NonNegative = 0.0
    """Growth of the bias's random walk, per square root of a second."""
    scale_error_ratio: NonNegative = 0.0
    range_rad_s: Positive | None = None
    """Largest rate that it tells, either way."""
    converter: ConverterConfig | None = None
    """What reads it; without it the output has all digits."""

    @model_validator(mode="after")
    def _check_converter(self) -> Self:
        if self.converter is not None and self.range_rad_s is None:
            raise ValueError("converter needs range_rad_s")
        return self

    @property
    def noise_rad_s(self) -> float:
        """Noise of one sample, 1 sigma."""
        return noise_sigma(density=self.noise_density_rad_s_rthz, rate_hz=self.rate_hz, bandwidth_hz=None)

    @property
    def resolution_rad_s(self) -> float:
        """Step of the output, zero for all digits."""
        if self.converter is None or self.range_rad_s is None:
            return 0.0
        return self.converter.lsb(self.range_rad_s)


class YawGyro(Sensor):
    """Mean yaw rate over the sample interval, rad/s, positive to the left. Hidden column: its bias now."""

    columns = (YAW_RATE,)
    error_columns = columns
    extra_hidden_columns = (f"{YAW_RATE}.bias",)

    def __init__(
        self, config: YawGyroConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._gain: FloatArray = 1.0 + config.scale_error_ratio * self._streams.once("scale", 1)
        start = config.bias_rad_s * self._streams.once("turn_on_bias", 1)
        self._bias = RandomWalk(
            density=[config.bias_random_walk_rad_s_rts],
            period_s=self.period_s,
            stream=self._streams.normal("bias_random_walk", 1),
            start=start,
        )
        self._noise = WhiteNoise(sigma=[config.noise_rad_s], stream=self._streams.normal("noise", 1))
        if config.converter is not None and config.range_rad_s is not None:
            self._converter = config.converter.quantiser(config.range_rad_s)
        else:
            self._converter = converter(full_scale=[config.range_rad_s], bits=None)

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, MountMotion)
        rate = float(capture.mean_rate_rad_s[2])
        bias = self._bias.step().copy()
        values = self._gain * rate + bias + self._noise.step()
        return Reading(values=self._converter.apply(values), truth=np.array([rate]), hidden=bias)

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, YawGyroConfig)
        sheet = {
            "noise_rad_s": config.noise_rad_s,
            "noise_density_rad_s_rthz": config.noise_density_rad_s_rthz,
            "bias_rad_s": config.bias_rad_s,
            "bias_random_walk_rad_s_rts": config.bias_random_walk_rad_s_rts,
            "scale_error_ratio": config.scale_error_ratio,
            "resolution_rad_s": config.resolution_rad_s,
        }
        return sheet if config.range_rad_s is None else {**sheet, "range_rad_s": config.range_rad_s}

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        """Noise and rounding."""
        assert isinstance(config, YawGyroConfig)
        return np.array([np.hypot(config.noise_rad_s, config.resolution_rad_s / np.sqrt(12.0))])
