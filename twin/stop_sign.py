"""The stop sign: what its plate looks like, for whoever draws it, sees it or looks for it.

A regular octagon that stands on a flat side, red with a white border and the word STOP in white across its middle
(after the R1-1 of the US Manual on Uniform Traffic Control Devices: letters a third of the plate's height, a border of
about a fortieth; ours are a little bolder, since the letters are drawn with OpenCV's stroke font).
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.signals import FloatArray

BORDER_SHARE = 0.03
"""Width of the white border, as a share of the plate's size across flats."""
RED_SHARE = 1.0 - 2.0 * BORDER_SHARE
"""Size of the red octagon inside the border, likewise."""
LETTER_SHARE = 0.32
"""Height of the letters, likewise."""
CORNER_SHARE = 1.0 - 1.0 / math.sqrt(2.0)
"""What an octagon's cut corner takes off the side of the square around it: 0.293."""

_RED, _WHITE = (178, 24, 34), (244, 244, 240)
_FINER = 4
_GAMMA = 2.2


def octagon(size: float) -> FloatArray:
    """Corners (8, 2) of a regular octagon of this size across flats about the origin, counter-clockwise."""
    half, side = 0.5 * size, (0.5 - CORNER_SHARE) * size
    corners = [(half, side), (side, half)]
    turned = [(-y, x) for x, y in corners]
    first = [corners[0], corners[1], *turned]
    return np.array([*first, *((-x, -y) for x, y in first)], dtype=np.float64)


def draw_plate(pixels: int) -> NDArray[np.uint8]:
    """Front of the plate, (pixels, pixels, 3) RGB; what lies outside the octagon is the border's white."""
    size = _FINER * pixels
    image = np.full((size, size, 3), _WHITE, dtype=np.uint8)
    # Pixel centres: the middle of the picture is at (size - 1) / 2.
    corners = np.round((octagon(RED_SHARE * size) + 0.5 * (size - 1)) * 16.0).astype(np.int32)
    cv2.fillPoly(image, [corners], _RED, shift=4)
    _write(image, size)
    # Light is averaged, not display values.
    light = ((image / 255.0) ** _GAMMA).astype(np.float32)
    small = cv2.resize(light, (pixels, pixels), interpolation=cv2.INTER_AREA)
    return np.round(255.0 * small ** (1.0 / _GAMMA)).astype(np.uint8)


def _write(image: NDArray[np.uint8], size: int) -> None:
    """The word across the middle: four fifths of the plate wide."""
    font, stroke = cv2.FONT_HERSHEY_SIMPLEX, round(0.055 * size)
    (width, height), _ = cv2.getTextSize("STOP", font, 10.0, 1)
    word = np.zeros((height + 2 * stroke + 40, width + 2 * stroke + 40), dtype=np.uint8)
    cv2.putText(word, "STOP", (stroke + 20, height + stroke + 20), font, 10.0, 255, stroke, cv2.LINE_AA)
    rows, columns = np.flatnonzero(word.any(axis=1)), np.flatnonzero(word.any(axis=0))
    word = word[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    wide, high = round(0.78 * size), round(LETTER_SHARE * size)
    word = cv2.resize(word, (wide, high), interpolation=cv2.INTER_AREA).astype(np.uint8)
    top, left = (size - high) // 2, (size - wide) // 2
    part = image[top : top + high, left : left + wide]
    share = word[..., np.newaxis] / 255.0
    part[:] = np.round(part * (1.0 - share) + np.array(_WHITE) * share)
