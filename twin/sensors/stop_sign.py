"""Finds a stop sign in a picture.

Paper 001 (section 2.4) uses OpenCV with a trained Haar cascade, which it does not print. This detector knows what a
stop sign is instead (:mod:`twin.stop_sign`), and works in four steps:

1. **Colour.** Pixels that are red in hue, saturation and value (HSV). Hue hardly depends on the brightness; the limits
   of saturation and value are low, since glare takes saturation away and dusk takes value.
2. **Contours** of the red areas, their gaps closed, and of each its convex hull. An area has to fill its hull
   (a sign does, scattered soil and leaves do not), be large enough, no wider than high by more than a fifth and lie
   wholly in the picture.
3. **Octagon.** The hull is compared with a regular octagon stretched over its bounding box, which a plate seen
   obliquely from any side nearly is: intersection over union. A square has 0.83, a triangle less; perspective takes
   some per cent from a true sign.
4. **Letters.** The ratio of green light to red, which no brightness changes, is 1 on white and far less on the red of
   the sign, whatever glare adds to both. Averaged over the band of the letters it has to lie between plain red and
   plain white, and above and below that band it has to be plainly red. Averages need no letter to be legible.

The distance follows from the height of the red octagon, since seeing a plate from the side makes it narrower and not
lower. Its edges are where the light, averaged over the plate's middle columns, is half that of red paint and half that
of what is beyond, interpolated between rows. The bearing is that of the middle of the bounding box.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.signals import FloatArray
from twin.stop_sign import RED_SHARE, octagon

SMALLEST_PX = 10
"""Height of the red octagon below which nothing is judged: letters are some three pixels high then."""

_HUES = (9, 168)
"""Red is at most the first or at least the second, in OpenCV's half degrees."""
_LEAST_SATURATION, _LEAST_VALUE = 60, 25
_GAPS_PX = (3, 7, 11)
"""Of red areas, closed one after the other until a sign is found: in a small picture of a sign the rim beside the
letters is pink, and its red falls apart above and below them."""
_LEAST_SOLIDITY = 0.88
_WIDTH_TO_HEIGHT = (0.42, 1.2)
"""Cosine of 65 degrees; and some room above 1 for pixels."""
_LEAST_OVERLAP = 0.87
_LETTER_BAND = (0.16, 0.40)
"""Half height and half width of the part that is judged for letters, in units of the octagon's height and width."""
_RED_BAND = (0.24, 0.42, 0.20)
"""From and to, above and below the middle, and half width of the parts that have to be red."""
_WHITE_SHARE = (0.2, 0.8)
"""Of the letters in their band; the strokes of our sign cover about half of it."""
_MOST_RED_RATIO = 0.5
"""Green over red light in the red parts: 0.01 on paint, 0.3 in strong glare."""
_BEYOND_PX = 3
_LINEAR: FloatArray = (np.arange(256) / 255.0) ** 2.2
"""Light of display values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """A stop sign in a picture."""

    left_px: float
    top_px: float
    width_px: float
    height_px: float
    """Bounding box of the red octagon."""
    red_height_px: float
    """Height of the red octagon at its middle, finer than whole pixels."""

    def place(self, *, size_m: float, focal_px: float, picture_px: tuple[int, int]) -> tuple[float, float]:
        """Distance of the plate's middle (m) and its bearing (rad, positive to the left), for a plate of this size.

        ``picture_px`` is the picture's width and height. The camera is taken to look level.
        """
        depth = focal_px * RED_SHARE * size_m / self.red_height_px
        right = (self.left_px + 0.5 * self.width_px - 0.5 * picture_px[0]) / focal_px
        down = (self.top_px + 0.5 * self.height_px - 0.5 * picture_px[1]) / focal_px
        return depth * math.sqrt(1.0 + right * right + down * down), -math.atan(right)


def find_stop_sign(rgb: NDArray[np.uint8]) -> Detection | None:
    """The largest stop sign in a picture (h, w, 3) RGB, if there is one."""
    mask = _red(rgb)
    best: Detection | None = None
    for gap_px in _GAPS_PX:
        closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((gap_px, gap_px), dtype=np.uint8))
        contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        for contour in contours:
            left, top, width, height = cv2.boundingRect(contour)
            if _looks_like_an_octagon(np.asarray(contour, dtype=np.int32), mask.shape):
                found = _read(rgb, (left, top, width, height))
                if found is not None and (best is None or found.height_px > best.height_px):
                    best = found
        if best is not None:
            return best
    return None


def _red(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Red pixels as 255, (h, w)."""
    hsv = cv2.cvtColor(cv2.GaussianBlur(rgb, (3, 3), 0.0), cv2.COLOR_RGB2HSV)
    least = _LEAST_SATURATION, _LEAST_VALUE
    low = cv2.inRange(hsv, np.array([0, *least]), np.array([_HUES[0], 255, 255]))
    high = cv2.inRange(hsv, np.array([_HUES[1], *least]), np.array([179, 255, 255]))
    return cv2.bitwise_or(low, high).astype(np.uint8)


def _looks_like_an_octagon(contour: NDArray[np.int32], shape: tuple[int, ...]) -> bool:
    left, top, width, height = cv2.boundingRect(contour)
    if height < SMALLEST_PX or not _WIDTH_TO_HEIGHT[0] * height <= width <= _WIDTH_TO_HEIGHT[1] * height:
        return False
    if left == 0 or top == 0 or left + width == shape[1] or top + height == shape[0]:
        return False
    hull = cv2.convexHull(contour).astype(np.float32).reshape(-1, 2)
    area = cv2.contourArea(hull)
    if cv2.contourArea(contour) < _LEAST_SOLIDITY * area:
        return False
    # A contour runs through the middles of pixels: it is a pixel narrower and lower than what it surrounds.
    middle = left + 0.5 * (width - 1), top + 0.5 * (height - 1)
    ideal = (octagon(1.0) * [width - 1, height - 1] + middle).astype(np.float32)
    common, _ = cv2.intersectConvexConvex(hull, ideal)
    return common >= _LEAST_OVERLAP * (area + cv2.contourArea(ideal) - common)


def _read(rgb: NDArray[np.uint8], box: tuple[int, int, int, int]) -> Detection | None:
    """Judge the letters in a red octagon with this bounding box, and measure its height."""
    left, top, width, height = box
    first = max(0, top - _BEYOND_PX)
    light = _LINEAR[rgb[first : top + height + _BEYOND_PX, left : left + width, :2]]
    across = np.abs((np.arange(width) + 0.5) / width - 0.5)
    upright = np.abs((np.arange(len(light)) + first - top + 0.5) / height - 0.5)
    outer = (upright >= _RED_BAND[0]) & (upright <= _RED_BAND[1])
    paint = light[np.ix_(outer, across <= _RED_BAND[2])].mean(axis=(0, 1))
    red = _ratio(paint)
    if red > _MOST_RED_RATIO:
        return None
    letters = _ratio(light[np.ix_(upright <= _LETTER_BAND[0], across <= _LETTER_BAND[1])])
    white = (letters.mean() - red) / (1.0 - red)
    if not _WHITE_SHARE[0] <= white <= _WHITE_SHARE[1]:
        return None
    profile = light[:, across <= _RED_BAND[2]].mean(axis=1)
    middle = top - first + height // 2
    upper, lower = _edge(profile[middle::-1], paint, 0.5 * height), _edge(profile[middle:], paint, 0.5 * height)
    if upper is None or lower is None:
        return None
    return Detection(left_px=left, top_px=top, width_px=width, height_px=height, red_height_px=upper + lower)


def _ratio(light: FloatArray) -> FloatArray:
    """Green over red of light (..., 2) that is red and green, at most 1."""
    ratio: FloatArray = np.minimum(light[..., 1] / np.maximum(light[..., 0], 1e-6), 1.0)
    return ratio


def _edge(profile: FloatArray, paint: FloatArray, expected: float) -> float | None:
    """Samples from the middle of a sign to its edge, about ``expected``; None if the red does not end there.

    ``profile`` (n, 2) is the red and green light outwards from the middle, ``paint`` (2,) that of the red octagon. The
    edge is where the light is half that of the paint and half that of what is least red just beyond; how much of each
    a sample has is taken from its ratio, so that an uneven brightness does not count.
    """
    ratio = _ratio(profile)
    start = max(1, math.floor(expected) - 2)
    beyond = start + int(np.argmax(ratio[start:]))
    less = paint - profile[beyond]
    share = (paint[1] - ratio * paint[0]) / np.minimum(less[1] - ratio * less[0], -1e-9)
    for row in range(beyond, start - 1, -1):
        if share[row - 1] <= 0.5 < share[row]:
            return row - 1 + float((0.5 - share[row - 1]) / (share[row] - share[row - 1]))
    return None
