"""Displacement transducer on one slide: a voltage for its stroke, and a converter (kind ``displacement_transducer``).

Its errors are those of :mod:`twin.sensors.transducer`. Paper 002 measures the plate of its rail this way, and
calibrated 121.6 mm/V + 1.853 mm against a ruler; a stroke sensor in a lift's cylinder is another with other figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from twin.config import NonNegative, Positive
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.noise import Quantiser
from twin.sensors.transducer import Transducer, error_sigma
from twin.signals import Capture, FloatArray, JointMotion, JointNeed, Mount, Need

DISPLACEMENT = "displacement_m"


class DisplacementTransducerConfig(SensorConfig):
    """A transducer, the joint it sits on and its converter; errors that are left out are absent."""

    kind: Literal["displacement_transducer"]
    joint: str
    """Slide of the machine whose stroke it measures."""
    range_m: Positive = 0.4
    """Measuring range."""
    range_from_m: float | None = None
    """Stroke at the range's lower end; without it, the range is centred on the joint's zero."""
    linearity_ratio: NonNegative = 0.0
    """Largest deviation from a straight line as a part of the range."""
    offset_sigma_m: NonNegative = 0.0
    """Offset that the calibration left, 1 sigma."""
    scale_error_ratio: NonNegative = 0.0
    """Error of the slope that the calibration left, 1 sigma."""
    noise_m: NonNegative = 0.0
    """White noise of one sample, 1 sigma."""
    resolution_m: NonNegative = 0.0
    """Step of the converter; zero for all digits."""

    def need(self, mount: Mount) -> Need:
        """The stroke of the joint."""
        return JointNeed(mount=mount, joints=(self.joint,), slides=True)

    @property
    def lowest_m(self) -> float:
        """Stroke at the lower end of the range."""
        return -0.5 * self.range_m if self.range_from_m is None else self.range_from_m


class DisplacementTransducer(Sensor):
    """Stroke of one slide, m, in the joint's own coordinate. Hidden column: its error before noise and converter."""

    columns = (DISPLACEMENT,)
    error_columns = columns
    extra_hidden_columns = (f"{DISPLACEMENT}.bias",)

    def __init__(
        self,
        config: DisplacementTransducerConfig,
        *,
        name: str,
        mount: Mount,
        dt_ns: int,
        seed: int,
        runs: Sequence[int],
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        highest_m = config.lowest_m + config.range_m
        self._transducer = Transducer(
            lowest=config.lowest_m,
            span=config.range_m,
            linearity_ratio=config.linearity_ratio,
            offset_sigma=config.offset_sigma_m,
            scale_error_ratio=config.scale_error_ratio,
            noise=config.noise_m,
            converter=Quantiser(lsb=config.resolution_m, low=config.lowest_m, high=highest_m),
            streams=self._streams,
        )

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, JointMotion)
        return self._transducer.read(float(capture.position[0]))

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, DisplacementTransducerConfig)
        return {
            "range_m": config.range_m,
            "range_from_m": config.lowest_m,
            "linearity_ratio": config.linearity_ratio,
            "offset_sigma_m": config.offset_sigma_m,
            "scale_error_ratio": config.scale_error_ratio,
            "noise_m": config.noise_m,
            "resolution_m": config.resolution_m,
        }

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        """Noise and rounding."""
        assert isinstance(config, DisplacementTransducerConfig)
        return error_sigma(noise=config.noise_m, resolution=config.resolution_m)
