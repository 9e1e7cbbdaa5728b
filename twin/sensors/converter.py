"""Analog-to-digital converter that analog sensors share.

A converter of ``bits`` over +- a full scale FS has the step LSB = 2 FS / 2^bits and the codes -2^(bits-1) to
2^(bits-1) - 1. Values are rounded to the nearest code and stop at the last one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from twin.config import Config
from twin.sensors.noise import Quantiser

Bits = Annotated[int, Field(ge=2, le=32)]


class ConverterConfig(Config):
    """A converter that reads one analog sensor."""

    bits: Bits = 10
    """Resolution (paper 003, section 2: 10 bit for all its analog sensors)."""
    full_scale_ratio: Annotated[float, Field(ge=1.0, le=1000.0)] = 1.0
    """What the codes span, as a multiple of what the sensor's range spans: 1 where its output uses all of them."""

    def lsb(self, largest: float) -> float:
        """Step of the output of a sensor with the range +-``largest``, in the sensor's unit."""
        return 2.0 * self.full_scale_ratio * largest / 2.0**self.bits

    def quantiser(self, largest: float) -> Quantiser:
        """Converter of one column; the sensor itself stops at +-``largest``."""
        lsb = self.lsb(largest)
        return Quantiser(lsb=lsb, low=-largest, high=min(largest, self.full_scale_ratio * largest - lsb))


def converter(*, full_scale: Sequence[float | None], bits: int | None) -> Quantiser:
    """Converter of ``bits`` over +-``full_scale`` of each column (n).

    Without bits it only clips; without a full scale a column passes unchanged.
    """
    scale = np.array([np.inf if value is None else value for value in full_scale])
    lsb = np.zeros(len(scale)) if bits is None else np.where(np.isfinite(scale), 2.0 * scale / 2.0**bits, 0.0)
    return Quantiser(lsb=lsb, low=-scale, high=scale - lsb)
