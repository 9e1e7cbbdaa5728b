"""Colours of heights above a design plane: pale within 30 mm of it, then blue for hollows and red for humps.

The step at 30 mm is on purpose: the share of a field within that limit is what levelling is judged by (TD/T 1033-2012),
and it is to be seen. Blue and red are told apart by people who cannot tell red from green.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.signals import LEVEL_WITHIN_M, FloatArray

FULL_M = 0.100
"""Height from which on the colour does not change any more."""
TICKS_M = (FULL_M, LEVEL_WITHIN_M, 0.0, -LEVEL_WITHIN_M, -FULL_M)
"""Heights that legends name."""

_STOPS: tuple[tuple[float, tuple[int, int, int]], ...] = (
    (-FULL_M, (18, 42, 130)),
    (-LEVEL_WITHIN_M, (110, 175, 235)),
    (-LEVEL_WITHIN_M, (214, 226, 214)),
    (0.0, (244, 243, 226)),
    (LEVEL_WITHIN_M, (240, 226, 196)),
    (LEVEL_WITHIN_M, (244, 150, 100)),
    (FULL_M, (135, 12, 30)),
)
_LIMITS = np.array([height for height, _ in _STOPS])
_LIMITS[[1, 5]] += np.array([-1e-9, 1e-9])
"""What is exactly at a limit is within it."""
_COLOURS = np.array([colour for _, colour in _STOPS], dtype=np.float64)


def height_colours(above_m: FloatArray) -> NDArray[np.uint8]:
    """Colours (..., 3), 0 to 255, of heights above the design plane of any shape."""
    above = np.asarray(above_m, dtype=np.float64)
    channels = [np.interp(above, _LIMITS, _COLOURS[:, channel]) for channel in range(3)]
    colours: NDArray[np.uint8] = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
    return colours


def packed_colours(above_m: FloatArray) -> NDArray[np.uint32]:
    """The same, each as one number 0xRRGGBBAA."""
    red, green, blue = np.moveaxis(height_colours(above_m).astype(np.uint32), -1, 0)
    packed: NDArray[np.uint32] = red << 24 | green << 16 | blue << 8 | 0xFF
    return packed
