"""AccoSat: a ground-speed sensor that fuses an accelerometer with DGPS and gives pulses (kind ``accosat``).

Paper 000 (sections 3.4 and 4.2.5) has two of them: 25 Hz, a 3D accelerometer merged with DGPS, "radar compatible",
not bound to a mounting angle. The maker's filter is not published; what is here is the usual one for such a pair.

1. **Receiver.** ``z = L(|v_h|) + e_gm + e_w``: horizontal speed behind the receiver's own first-order filter L, with a
   time-correlated and a white error, several times a second, handed on after a latency.
2. **Accelerometer.** ``f = T x + b_0 + b_gm + n`` along the unit's forward axis (:mod:`twin.sensors.noise`); T holds
   scale and the tilt at which the unit was mounted, so gravity's share g sin(tilt) is in f.
3. **Fusion**, a critically damped second-order complementary filter with the time constant tau. Speed v and offset c:
   ``v += T (f - c)`` at every sample, and with every fix, interval T_g, left = e^{-T_g / tau},
   ``v += (1 - left^2) (z - v)``,  ``c -= ((1 - left)^2 / T_g) (z - v)``. (The gains put both poles at ``left``: the
   fading-memory filter, which is a steady-state Kalman filter's form.) The offset is all the unit knows of its tilt:
   what is steady (bias, mounting, a slope) is gone after a few tau; what is faster (pitching, a slope entered) leaks in
   as g times the change of pitch, until the fixes have pulled it out.
4. **Pulses** per metre of v, and the counter that reads them (:mod:`twin.sensors.pulses`).

What follows from it: no dependence on the mounting angle but the accelerometer's scale, cos(tilt). A beginning ramp
is followed by the accelerometer; as it goes on the lag grows towards the receiver's own (latency and velocity filter),
for the fixes are taken as current. A slope entered shifts the speed for some tau. The direction of travel is lost: in
reverse the accelerometer has the wrong sign and the fixes have to carry the filter.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from twin.config import NonNegative, Positive
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.noise import GaussMarkov, Streams, WhiteNoise, decay, noise_sigma, sensitivity_matrices
from twin.sensors.pulses import SPEED_AND_PULSES, PulseCounter
from twin.signals import NS_PER_S, Capture, FloatArray, Mount, MountMotion


class AccoSatConfig(SensorConfig):
    """An AccoSat and its pulse counter; errors are one standard deviation."""

    kind: Literal["accosat"]
    pulses_per_m: Positive
    """Nominal scale."""
    minimum_speed_m_s: NonNegative
    """Below it there are no pulses."""
    timer_resolution_s: Positive = 1e-6
    """Step of the counter's clock."""
    fusion_time_constant_s: Positive
    """Below it the accelerometer speaks, above it the receiver."""

    receiver_rate_hz: Positive
    """DGPS fixes per second; must divide the sensor's rate."""
    receiver_latency_s: NonNegative = 0.0
    """From a fix to its use; rounded to the sensor's samples."""
    receiver_velocity_lag_s: NonNegative = 0.0
    """Time constant of the receiver's own velocity filter."""
    receiver_white_m_s: NonNegative = 0.0
    """White error of the receiver's speed."""
    receiver_correlated_m_s: NonNegative = 0.0
    """Time-correlated error of the receiver's speed."""
    receiver_correlation_s: Positive = 10.0

    accel_noise_density_m_s2_rthz: NonNegative = 0.0
    """One-sided."""
    accel_bias_m_s2: NonNegative = 0.0
    """Bias at turn-on."""
    accel_bias_instability_m_s2: NonNegative = 0.0
    """The bias's Gauss-Markov part."""
    accel_bias_correlation_s: Positive = 100.0
    accel_scale_error_ratio: NonNegative = 0.0
    mounting_tilt_rad: NonNegative = 0.0
    """Roll, pitch and yaw of the unit as mounted against its nominal mount, each."""

    @model_validator(mode="after")
    def _check_receiver_rate(self) -> Self:
        ratio = self.rate_hz / self.receiver_rate_hz
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9 * ratio:
            raise ValueError(f"receiver_rate_hz = {self.receiver_rate_hz:g} does not divide rate_hz = {self.rate_hz:g}")
        return self

    @property
    def fix_gain(self) -> float:
        """What the fusion takes of a fix's innovation into its speed."""
        left = math.exp(-1.0 / (self.receiver_rate_hz * self.fusion_time_constant_s))
        return 1.0 - left * left

    @property
    def offset_gain_per_s(self) -> float:
        """What it takes into its accelerometer offset."""
        left = math.exp(-1.0 / (self.receiver_rate_hz * self.fusion_time_constant_s))
        return (1.0 - left) ** 2 * self.receiver_rate_hz

    @property
    def speed_noise_m_s(self) -> float:
        """Noise of the output at a steady speed.

        A fading-memory filter keeps (1 - q)(1 + 4 q + 5 q^2) / (1 + q)^3 of a white variance (q = ``left``); the
        correlated part is taken to pass as it is.
        """
        q = math.sqrt(1.0 - self.fix_gain)
        kept = (1.0 - q) * (1.0 + 4.0 * q + 5.0 * q * q) / (1.0 + q) ** 3
        return math.hypot(self.receiver_white_m_s * math.sqrt(kept), self.receiver_correlated_m_s)


class AccoSat(Sensor):
    """The sensor. The truth of ``speed_m_s`` is the mount's mean speed along its forward axis."""

    columns = SPEED_AND_PULSES
    error_columns = SPEED_AND_PULSES[:1]
    extra_hidden_columns = ("fused_speed_m_s",)

    def __init__(
        self, config: AccoSatConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._truth = np.full(2, np.nan)
        self._receiver = _Receiver(config, period_s=self.period_s, streams=self._streams)
        self._accelerometer = _ForwardAccelerometer(config, period_s=self.period_s, streams=self._streams)
        self._fusion = _Fusion(config)
        self._counter = PulseCounter(
            pulses_per_m=config.pulses_per_m,
            minimum_speed_m_s=config.minimum_speed_m_s,
            timer_resolution_s=config.timer_resolution_s,
            streams=self._streams,
        )

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, MountMotion)
        self._truth[0] = capture.mean_velocity_enu_m_s @ capture.rotation[:, 0]
        east, north, _ = capture.mean_velocity_enu_m_s.tolist()
        fused = self._fusion.step(
            self._accelerometer.step(capture.mean_specific_force_m_s2),
            self._receiver.step(math.hypot(east, north)),
            capture.interval_s,
        )
        values = self._counter.step(fused, capture.t_ns / NS_PER_S, capture.interval_s)
        return Reading(values=values, truth=self._truth, hidden=fused[:, np.newaxis])

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, AccoSatConfig)
        return {
            "speed_noise_m_s": config.speed_noise_m_s,
            "pulses_per_m": config.pulses_per_m,
            "minimum_speed_m_s": config.minimum_speed_m_s,
        }

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        assert isinstance(config, AccoSatConfig)
        return np.array([config.speed_noise_m_s, 0.0])


class _Receiver:
    """Speed of a DGPS receiver, when it comes."""

    def __init__(self, config: AccoSatConfig, *, period_s: float, streams: Streams) -> None:
        self._every = round(config.rate_hz / config.receiver_rate_hz)
        self._late = round(config.receiver_latency_s / period_s)
        self._keep = float(decay(config.receiver_velocity_lag_s, period_s)[0])
        self._white = WhiteNoise(sigma=config.receiver_white_m_s, stream=streams.normal("receiver", 1))
        self._correlated = GaussMarkov(
            sigma=config.receiver_correlated_m_s,
            tau_s=config.receiver_correlation_s,
            period_s=1.0 / config.receiver_rate_hz,
            stream=streams.normal("receiver_correlated", 1),
            start=streams.once("receiver_correlated_start", 1),
        )
        self._lagged: float | None = None
        self._under_way: deque[tuple[int, FloatArray]] = deque()
        self._count = 0

    def step(self, speed: float) -> FloatArray | None:
        """Take the true speed of one sample; return the fix (R,) that is handed on with it, if there is one.

        The first is handed on at once: the receiver was on before.
        """
        first = self._lagged is None
        self._lagged = speed if self._lagged is None else speed + self._keep * (self._lagged - speed)
        if self._count % self._every == 0:
            fix = self._lagged + self._white.step()[:, 0] + self._correlated.step()[:, 0]
            self._under_way.append((self._count if first else self._count + self._late, fix))
        arrived = None
        while self._under_way and self._under_way[0][0] <= self._count:
            arrived = self._under_way.popleft()[1]
        self._count += 1
        return arrived


class _ForwardAccelerometer:
    """The unit's forward axis."""

    def __init__(self, config: AccoSatConfig, *, period_s: float, streams: Streams) -> None:
        scale = np.zeros((len(streams.runs), 3))
        scale[:, 0] = config.accel_scale_error_ratio * streams.once("accel_scale", 1)[:, 0]
        axes = sensitivity_matrices(
            scale=scale,
            misalignment=np.zeros((len(streams.runs), 6)),
            tilt_rpy_rad=config.mounting_tilt_rad * streams.once("mounting_tilt", 3),
        )
        self._x, self._y, self._z = (np.ascontiguousarray(axes[:, 0, axis]) for axis in range(3))
        self._bias = config.accel_bias_m_s2 * streams.once("turn_on_bias", 1)[:, 0]
        self._instability = GaussMarkov(
            sigma=config.accel_bias_instability_m_s2,
            tau_s=config.accel_bias_correlation_s,
            period_s=period_s,
            stream=streams.normal("bias_instability", 1),
            start=streams.once("bias_instability_start", 1),
        )
        sigma = noise_sigma(density=config.accel_noise_density_m_s2_rthz, rate_hz=config.rate_hz, bandwidth_hz=None)
        self._noise = WhiteNoise(sigma=sigma, stream=streams.normal("accelerometer", 1))

    def step(self, force: FloatArray) -> FloatArray:
        """What it reads (R,) of the specific force (3,) on the mount."""
        x, y, z = force.tolist()
        wander = self._instability.step()[:, 0] + self._noise.step()[:, 0]
        read: FloatArray = x * self._x + y * self._y + z * self._z + self._bias + wander
        return read


class _Fusion:
    """The complementary filter; starts settled on its first samples."""

    def __init__(self, config: AccoSatConfig) -> None:
        self._fix_gain = config.fix_gain
        self._offset_gain = config.offset_gain_per_s
        self._speed: FloatArray | None = None
        self._offset: FloatArray = np.zeros(0)

    def step(self, felt: FloatArray, fix: FloatArray | None, interval_s: float) -> FloatArray:
        """Take a reading (R,) and perhaps a fix (R,); return the speed (R,)."""
        if self._speed is None:
            assert fix is not None, "the receiver's first fix comes with the first sample"
            self._speed, self._offset = fix, felt
            return self._speed
        speed = self._speed + interval_s * (felt - self._offset)
        if fix is not None:
            innovation = fix - speed
            speed = speed + self._fix_gain * innovation
            self._offset = self._offset - self._offset_gain * innovation
        self._speed = speed
        return speed
