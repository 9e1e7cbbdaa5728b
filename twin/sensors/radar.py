"""Ground-speed radar with a pulse output, and the pulse counter that reads it (kind ``radar``).

The way of a sample:

1. **Doppler.** The beam points forward and down by the mounting angle A. The radar sees the velocity along its beam and
   divides by cos A: ``u = |v_x cos(A + d) - v_z sin(A + d)| / cos A``, with v in the mount's axes (x forward, z up)
   and d the error of mounting. With the ground as reference this gives the pitch sensitivity d(cos)/cos = tan(A) dpitch
   (1.2 % per degree at 35 degrees, nose down reads less), nothing on a steady slope, and a share tan(A) of the mount's
   heave. The direction of travel is lost. White noise is added here.
2. **Lag.** First order, with one time constant when speeding up and another when braking. A lag that chose by the sign
   of the noisy difference would rectify the noise; it changes over only when the smoothed difference between input and
   output exceeds a threshold, and keeps its time constant until the opposite threshold is passed.
3. **Pulses** per metre of lagged speed, and the **counter** that reads them (:mod:`twin.sensors.pulses`).

The measured lag of a radar contains whatever averaging its own electronics do; here it is all in step 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from twin.config import NonNegative, Positive
from twin.sensors import kernels
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.noise import WhiteNoise, decay
from twin.sensors.pulses import SPEED_AND_PULSES, PulseCounter
from twin.signals import NS_PER_S, Capture, FloatArray, Mount, MountMotion


class RadarConfig(SensorConfig):
    """A radar and its pulse counter."""

    kind: Literal["radar"]
    pulses_per_m: Positive
    """Nominal scale."""
    mounting_angle_rad: Annotated[float, Field(ge=0.0, le=1.4)]
    """Of the beam below the horizontal."""
    mounting_error_rad: NonNegative = 0.0
    """Standard deviation of the mounting angle's error, which nobody calibrated away."""
    minimum_speed_m_s: NonNegative
    """Below it there are no pulses."""
    speed_noise_m_s: NonNegative = 0.0
    """Standard deviation of the Doppler speed in one sample, before the lag."""
    lag_speeding_up_s: NonNegative = 0.0
    lag_braking_s: NonNegative = 0.0
    lag_switch_m_s: NonNegative = 0.05
    """Smoothed difference of input and output at which the lag changes over."""
    timer_resolution_s: Positive = 1e-6
    """Step of the counter's clock."""


class _Lag:
    """First-order lag with two time constants and a threshold between them."""

    def __init__(self, config: RadarConfig, *, runs: int, period_s: float) -> None:
        self._gain_up, self._gain_down, self._gain_difference = (
            float(1.0 - decay(tau_s, period_s)[0])
            # Smoothing over the shorter lag: on a ramp the difference settles at acceleration times lag either way.
            for tau_s in (config.lag_speeding_up_s, config.lag_braking_s, self._shorter_s(config))
        )
        self._threshold = config.lag_switch_m_s
        self._gain = np.full(runs, self._gain_up)
        self._difference = np.zeros(runs)
        self._output: FloatArray | None = None

    @staticmethod
    def _shorter_s(config: RadarConfig) -> float:
        return min(config.lag_speeding_up_s, config.lag_braking_s)

    def step(self, speed: FloatArray) -> FloatArray:
        """Take the next input (R,) and return the output, which changes in place at the next call."""
        if self._output is None:
            self._output = speed.copy()
        kernels.two_way_lag(
            speed,
            self._output,
            self._difference,
            self._gain,
            self._gain_up,
            self._gain_down,
            self._gain_difference,
            self._threshold,
        )
        return self._output


class Radar(Sensor):
    """Ground-speed radar. The truth of ``speed_m_s`` is the mount's mean speed along its forward axis."""

    columns = SPEED_AND_PULSES
    error_columns = SPEED_AND_PULSES[:1]
    extra_hidden_columns = ("lagged_speed_m_s",)

    def __init__(
        self, config: RadarConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        angles = config.mounting_angle_rad + config.mounting_error_rad * self._streams.once("mounting_error", 1)[:, 0]
        nominal = math.cos(config.mounting_angle_rad)
        self._forward = np.array([math.cos(angle) / nominal for angle in angles.tolist()])
        self._up = np.array([-math.sin(angle) / nominal for angle in angles.tolist()])
        self._noise = (
            WhiteNoise(sigma=config.speed_noise_m_s, stream=self._streams.normal("noise", 1))
            if config.speed_noise_m_s > 0.0
            else None
        )
        self._truth = np.full(2, np.nan)
        self._lag = _Lag(config, runs=len(runs), period_s=self.period_s)
        self._counter = PulseCounter(
            pulses_per_m=config.pulses_per_m,
            minimum_speed_m_s=config.minimum_speed_m_s,
            timer_resolution_s=config.timer_resolution_s,
            streams=self._streams,
        )

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, MountMotion)
        forward, _, up = (capture.mean_velocity_enu_m_s @ capture.rotation).tolist()
        self._truth[0] = forward
        doppler = np.abs(self._forward * forward + self._up * up)
        if self._noise is not None:
            doppler += self._noise.step()[:, 0]
        lagged = self._lag.step(doppler)
        values = self._counter.step(lagged, capture.t_ns / NS_PER_S, capture.interval_s)
        return Reading(values=values, truth=self._truth, hidden=lagged[:, np.newaxis])

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, RadarConfig)
        return {
            "speed_noise_m_s": self._output_noise(config),
            "pulses_per_m": config.pulses_per_m,
            "mounting_angle_rad": config.mounting_angle_rad,
            "minimum_speed_m_s": config.minimum_speed_m_s,
            "lag_speeding_up_s": config.lag_speeding_up_s,
            "lag_braking_s": config.lag_braking_s,
        }

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        assert isinstance(config, RadarConfig)
        return np.array([self._output_noise(config), 0.0])

    def _output_noise(self, config: RadarConfig) -> float:
        """Noise of the output at a steady speed: white noise behind the faster lag, gain g, keeps g / (2 - g)."""
        tau_s = min(config.lag_speeding_up_s, config.lag_braking_s)
        gain = 1.0 - math.exp(-self.period_s / tau_s) if tau_s > 0.0 else 1.0
        return config.speed_noise_m_s * math.sqrt(gain / (2.0 - gain))
