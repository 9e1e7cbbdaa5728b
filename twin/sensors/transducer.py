"""What transducers that turn a position into a voltage share, whatever they measure.

    out = Q( s + L(s) + b + k s + n )

s is the true position; L the transducer's deviation from a straight line, half a sine over the measuring range, of an
amplitude drawn within what the data sheet allows, less what it is where the transducer was set to zero; b and k what
its calibration left of offset and slope; n white noise; Q the ends of the range and the converter's resolution.
"""

from __future__ import annotations

import numpy as np

from twin.sensors.base import Reading
from twin.sensors.noise import Quantiser, Streams, WhiteNoise
from twin.signals import FloatArray


class Transducer:
    """R transducers of one kind; all figures in the unit of the position.

    Args:
        lowest: position at the lower end of the measuring range.
        span: length of that range.
        linearity_ratio: largest deviation from a straight line as a part of the range.
        offset_sigma: offset that the calibration left, 1 sigma.
        scale_error_ratio: error of the slope that it left, 1 sigma.
        noise: white noise of one sample, 1 sigma.
        zero: position at which it was set to zero, so that there the offset is all its error; None if nowhere.
        converter: ends and digits of the output, one column.
        streams: where its errors come from.
    """

    def __init__(
        self,
        *,
        lowest: float,
        span: float,
        linearity_ratio: float,
        offset_sigma: float,
        scale_error_ratio: float,
        noise: float,
        zero: float | None = None,
        converter: Quantiser,
        streams: Streams,
    ) -> None:
        self._lowest, self._span = lowest, span
        between = 2.0 * streams.uniform("linearity", 1).next() - 1.0
        self._bow: FloatArray = linearity_ratio * span * between
        self._at_zero = 0.0 if zero is None else self._half_sine(zero)
        self._offset = offset_sigma * streams.once("offset", 1)
        self._scale = scale_error_ratio * streams.once("scale", 1)
        self._noise = WhiteNoise(sigma=noise, stream=streams.normal("noise", 1)) if noise > 0.0 else None
        self._converter = converter

    def read(self, position: float) -> Reading:
        """Output (R, 1) at a true position; hidden is the error before noise and converter (R, 1)."""
        bent = self._bow * (self._half_sine(position) - self._at_zero)
        bias = bent + self._offset + self._scale * position
        values = position + bias
        if self._noise is not None:
            values = values + self._noise.step()
        return Reading(values=self._converter.apply(values), truth=np.array([position]), hidden=bias)

    def _half_sine(self, position: float) -> float:
        part = min(max((position - self._lowest) / self._span, 0.0), 1.0)
        return float(np.sin(np.pi * part))


def error_sigma(*, noise: float, resolution: float) -> FloatArray:
    """(1,) standard deviation of one sample: noise and rounding."""
    return np.array([np.hypot(noise, resolution / np.sqrt(12.0))])
