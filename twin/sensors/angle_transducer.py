"""Potentiometer on the steering: the angle of the equivalent single front wheel (kind ``angle_transducer``).

The wheels of a steered axle stand at different angles l and r, so that their axes meet the rear axle's line in one
point. A single wheel in the middle of the axle, whose axis goes through that point too, stands at the angle d with

    cot d = (cot l + cot r) / 2,
    tan d = (sin^2 s - sin^2 h) / (sin s cos s)     with s = (l + r) / 2, h = (l - r) / 2, the same without infinities

whatever wheelbase and track are. The steering of paper 003's rice transplanter turns by that angle, and so does the
potentiometer under its axis. Errors are those of :mod:`twin.sensors.transducer`: deviation from a straight line, offset
of the mounting, slope, noise; and a converter (:mod:`twin.sensors.converter`) over the whole range, in whose middle the
wheels stand straight. There it was set to zero: what deviation from a straight line it has in the middle is taken off
with everything else, and the offset is what the mounting left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from twin.config import NonNegative
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.converter import ConverterConfig, converter
from twin.sensors.transducer import Transducer, error_sigma
from twin.signals import Capture, FloatArray, JointMotion, JointNeed, Mount, Need

STEERING_ANGLE = "steering_angle_rad"


class AngleTransducerConfig(SensorConfig):
    """A potentiometer, the knuckles it follows and its converter; errors that are left out are absent."""

    kind: Literal["angle_transducer"]
    left_joint: str = "steering_left"
    """Knuckle of the left front wheel."""
    right_joint: str = "steering_right"
    """Knuckle of the right front wheel."""
    range_rad: Annotated[float, Field(gt=0.0, le=2.0 * math.pi)] = math.radians(345.0)
    """Electrical angle, from one end to the other."""
    linearity_ratio: NonNegative = 0.0
    """Largest deviation from a straight line as a part of the range."""
    offset_sigma_rad: NonNegative = 0.0
    """Offset that mounting and calibration left, 1 sigma."""
    scale_error_ratio: NonNegative = 0.0
    """Error of the slope, 1 sigma."""
    noise_rad: NonNegative = 0.0
    """White noise of one sample, 1 sigma."""
    converter: ConverterConfig | None = None
    """What reads it; without it the output has all digits."""

    def need(self, mount: Mount) -> Need:
        """The angles of both knuckles."""
        return JointNeed(mount=mount, joints=(self.left_joint, self.right_joint))

    @property
    def resolution_rad(self) -> float:
        """Step of the output, zero for all digits."""
        return 0.0 if self.converter is None else self.converter.lsb(0.5 * self.range_rad)


def middle_wheel_rad(left_rad: float, right_rad: float) -> float:
    """Angle of the equivalent single front wheel from those of the two.

    Wheels that point to different sides have no such wheel; their mean then stands for it.
    """
    mean, half = 0.5 * (left_rad + right_rad), 0.5 * (left_rad - right_rad)
    if abs(half) >= abs(mean):
        return mean
    sine, cosine = math.sin(mean), math.cos(mean)
    return math.atan2(sine * sine - math.sin(half) ** 2, abs(sine) * cosine) * math.copysign(1.0, sine)


class AngleTransducer(Sensor):
    """Steering angle, rad, positive to the left. Hidden column: its error before noise and converter."""

    columns = (STEERING_ANGLE,)
    error_columns = columns
    extra_hidden_columns = (f"{STEERING_ANGLE}.bias",)

    def __init__(
        self, config: AngleTransducerConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        largest = 0.5 * config.range_rad
        self._transducer = Transducer(
            lowest=-largest,
            span=config.range_rad,
            linearity_ratio=config.linearity_ratio,
            offset_sigma=config.offset_sigma_rad,
            scale_error_ratio=config.scale_error_ratio,
            noise=config.noise_rad,
            zero=0.0,
            converter=(
                converter(full_scale=[largest], bits=None)
                if config.converter is None
                else config.converter.quantiser(largest)
            ),
            streams=self._streams,
        )

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, JointMotion)
        left, right = capture.position.tolist()
        return self._transducer.read(middle_wheel_rad(left, right))

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, AngleTransducerConfig)
        return {
            "range_rad": config.range_rad,
            "linearity_ratio": config.linearity_ratio,
            "offset_sigma_rad": config.offset_sigma_rad,
            "scale_error_ratio": config.scale_error_ratio,
            "noise_rad": config.noise_rad,
            "resolution_rad": config.resolution_rad,
        }

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        """Noise and rounding."""
        assert isinstance(config, AngleTransducerConfig)
        return error_sigma(noise=config.noise_rad, resolution=config.resolution_rad)
