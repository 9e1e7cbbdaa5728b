"""Attitude and heading reference: attitude, and acceleration without gravity in east, north and up (kind ``ahrs``).

    attitude = (roll, pitch, heading) + e,      a = R_e (f + b + n) - g + o

f is the mean specific force over the sample interval in mount axes; b the accelerometers' zero offset, their in-run
instability (Gauss-Markov) and a slow trend; n white noise; R_e the attitude the unit believes in, wrong by e (three
Gauss-Markov processes); o an outlier now and then. Units of this kind integrate at kilohertz and hand out means: here
the mean force is turned by the attitude in the middle of the interval, which leaves out what a steady rate w changes of
it within the interval T, (w T)^2 / 24 of its length. The attitude told is that at the interval's end.

So an attitude error reaches the acceleration as it does in reality: a tilt error d adds g sin d to the horizontal
components, and to the vertical one -g (1 - cos d) and d times the horizontal acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.config import NonNegative, Positive, Probability, Vector3
from twin.geometry import STANDARD_GRAVITY_M_S2, rotation_about, rpy_from_rotation
from twin.sensors import ahrs_kernels
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.noise import GaussMarkov, OccasionalNormals, Streams, WhiteNoise, noise_sigma
from twin.signals import HEADING, NS_PER_S, Capture, FloatArray, Mount, MountMotion

FREE_ACCELERATION = ("free_accel_e_m_s2", "free_accel_n_m_s2", "free_accel_u_m_s2")
COLUMNS = ("roll_rad", "pitch_rad", HEADING, *FREE_ACCELERATION)
_GRAVITY = np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])


class AhrsConfig(SensorConfig):
    """Every error is one standard deviation; whatever is left out is absent. The noise density is one-sided."""

    kind: Literal["ahrs"]

    attitude_sigma_rad: NonNegative = 0.0
    """Error of roll and of pitch."""
    attitude_correlation_s: Positive = 20.0
    """Its 1/e time."""
    heading_sigma_rad: NonNegative = 0.0
    """Error of the heading."""
    heading_correlation_s: Positive = 60.0
    """Its 1/e time."""

    accel_noise_density_m_s2_rthz: NonNegative = 0.0
    """White noise of each axis."""
    accel_bias_m_s2: NonNegative = 0.0
    """Zero offset, drawn once per axis."""
    accel_fixed_bias_m_s2: Vector3 | None = None
    """The zero offset in mount axes, instead of a drawn one; ``accel_bias_m_s2`` stays what the owner expects."""
    accel_bias_instability_m_s2: NonNegative = 0.0
    """The offset's Gauss-Markov part."""
    accel_bias_correlation_s: Positive = 100.0
    """Its 1/e time."""
    accel_trend_m_s3: NonNegative = 0.0
    """Steady growth of the offset of each axis from the start, its rate drawn once."""

    outlier_probability: Probability = 0.0
    """Of an outlier in one sample, in each run independently."""
    outlier_sigma_m_s2: NonNegative = 0.0
    """Standard deviation of an outlier in each component of the free acceleration."""

    @property
    def accel_noise_m_s2(self) -> float:
        """Noise of one sample, 1 sigma."""
        return noise_sigma(density=self.accel_noise_density_m_s2_rthz, rate_hz=self.rate_hz, bandwidth_hz=None)


class Ahrs(Sensor):
    """Attitude and free acceleration. Hidden columns tell what the accelerations' errors are made of.

    ``<acceleration>.bias`` is offset, instability and trend now, in the world's axes; ``.leak`` what the wrong attitude
    adds to the acceleration upwards, ``.outlier`` what an outlier does.
    """

    columns = COLUMNS
    error_columns = COLUMNS
    extra_hidden_columns = (
        *(f"{column}.bias" for column in FREE_ACCELERATION),
        f"{FREE_ACCELERATION[2]}.leak",
        f"{FREE_ACCELERATION[2]}.outlier",
    )

    def __init__(
        self, config: AhrsConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._angles = _angle_errors(config, self._streams, self.period_s)
        self._offset, self._slope = _offset_and_slope(config, self._streams)
        self._instability = _instability(config, self._streams, self.period_s)
        self._noise = WhiteNoise(sigma=[config.accel_noise_m_s2] * 3, stream=self._streams.normal("noise", 3))
        self._outliers = _Outliers(config, self._streams) if config.outlier_probability > 0.0 else None
        self._truth = np.empty(6)
        self._extra = np.zeros((self._runs, len(self.extra_hidden_columns)))
        self._leak = np.zeros(self._runs)

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, MountMotion)
        force = np.ascontiguousarray(capture.mean_specific_force_m_s2)
        middle = capture.rotation @ rotation_about(-0.5 * capture.interval_s * capture.mean_rate_rad_s)
        turned = middle @ force
        self._truth[:3] = rpy_from_rotation(capture.rotation)
        self._truth[3:] = turned - _GRAVITY
        bias = self._offset + self._instability.step() + self._slope * (capture.t_ns / NS_PER_S)
        values = np.empty((self._runs, 6))
        ahrs_kernels.attitude_and_acceleration(
            self._truth[:3],
            np.array(rpy_from_rotation(middle)),
            force,
            turned,
            STANDARD_GRAVITY_M_S2,
            self._angles.step(),
            bias + self._noise.step(),
            values,
            self._leak,
        )
        ahrs_kernels.turn(middle, bias, self._extra)
        self._extra[:, 3] = self._leak
        if self._outliers is not None:
            values[:, 3:] += self._outliers.step()
            self._extra[:, 4] = self._outliers.value[:, 2]
        self._wrap(values, self._wrapped)
        return Reading(values=values, truth=self._truth, hidden=self._extra)

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, AhrsConfig)
        return {
            "free_accel_noise_m_s2": config.accel_noise_m_s2,
            "free_accel_noise_density_m_s2_rthz": config.accel_noise_density_m_s2_rthz,
            "free_accel_bias_m_s2": config.accel_bias_m_s2,
            "free_accel_bias_instability_m_s2": config.accel_bias_instability_m_s2,
            "free_accel_bias_correlation_s": config.accel_bias_correlation_s,
            "free_accel_trend_m_s3": config.accel_trend_m_s3,
            "attitude_sigma_rad": config.attitude_sigma_rad,
            "attitude_correlation_s": config.attitude_correlation_s,
            "heading_sigma_rad": config.heading_sigma_rad,
            "heading_correlation_s": config.heading_correlation_s,
            "outlier_probability": config.outlier_probability,
            "outlier_sigma_m_s2": config.outlier_sigma_m_s2,
            "latency_s": config.latency_s,
        }

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        assert isinstance(config, AhrsConfig)
        angles = [config.attitude_sigma_rad, config.attitude_sigma_rad, config.heading_sigma_rad]
        return np.array([*angles, *[config.accel_noise_m_s2] * 3])


class _Outliers:
    """Errors of single samples, at random in each run; all components of a sample together."""

    def __init__(self, config: AhrsConfig, streams: Streams) -> None:
        self._probability = config.outlier_probability
        self._sigma = config.outlier_sigma_m_s2
        self._chance = streams.uniform("outlier", 1)
        self._sizes = OccasionalNormals(streams=streams, process="outlier_size", least=3)
        self.value: FloatArray = np.zeros((len(streams.runs), 3))
        """(R, 3) of the present sample; changes in place."""

    def step(self) -> FloatArray:
        """Go on to the next sample and return ``value``."""
        self.value.fill(0.0)
        most = 0
        for run in np.flatnonzero(self._chance.next()[:, 0] < self._probability).tolist():
            first = int(self._sizes.used[run])
            self.value[run] = self._sizes.values[run, first : first + 3] * self._sigma
            self._sizes.used[run] = first + 3
            most = max(most, first + 3)
        self._sizes.top_up(most)
        return self.value


def _angle_errors(config: AhrsConfig, streams: Streams, period_s: float) -> GaussMarkov:
    return GaussMarkov(
        sigma=[config.attitude_sigma_rad, config.attitude_sigma_rad, config.heading_sigma_rad],
        tau_s=[config.attitude_correlation_s, config.attitude_correlation_s, config.heading_correlation_s],
        period_s=period_s,
        stream=streams.normal("attitude", 3),
        start=streams.once("attitude_start", 3),
    )


def _offset_and_slope(config: AhrsConfig, streams: Streams) -> tuple[FloatArray, FloatArray]:
    """Zero offset and its growth per second, (R, 3) each."""
    offset = config.accel_bias_m_s2 * streams.once("zero_offset", 3)
    if config.accel_fixed_bias_m_s2 is not None:
        offset[:] = config.accel_fixed_bias_m_s2
    return offset, config.accel_trend_m_s3 * streams.once("trend", 3)


def _instability(config: AhrsConfig, streams: Streams, period_s: float) -> GaussMarkov:
    return GaussMarkov(
        sigma=config.accel_bias_instability_m_s2,
        tau_s=config.accel_bias_correlation_s,
        period_s=period_s,
        stream=streams.normal("bias_instability", 3),
        start=streams.once("bias_instability_start", 3),
    )
