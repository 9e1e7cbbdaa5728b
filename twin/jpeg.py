"""Pictures as JPEG: how the record keeps them.

What is read back may come from anybody: the size that a file claims is looked at before it is decoded.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.errors import BadInputError

QUALITY = 90
LARGEST_SIDE_PX = 4096
LARGEST_BYTES = 4_000_000
"""Of one picture; noise alone at quality 90 takes some 1.5 bytes a pixel."""

_START, _MARKER, _SCAN = b"\xff\xd8", 0xFF, 0xDA
_FRAMES = frozenset({0xC0, 0xC1, 0xC2})
"""Markers of the frame headers of baseline, extended and progressive JPEG."""

cv2.setNumThreads(1)  # Pictures are small, and stress tests have a process for every core.


@dataclass(frozen=True, slots=True, kw_only=True)
class EncodedPicture:
    """A picture that a sensor took."""

    t_ns: int
    """When it says it was taken."""
    jpeg: bytes


def encode(rgb: NDArray[np.uint8]) -> bytes:
    """JPEG of a picture (h, w, 3) RGB; equal pictures give equal bytes."""
    done, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert done, "OpenCV could not encode a picture"
    return data.tobytes()


def size_px(jpeg: bytes) -> tuple[int, int]:
    """Width and height that the frame header of a JPEG states.

    Raises:
        BadInputError: it is not a JPEG, or too large.
    """
    if len(jpeg) > LARGEST_BYTES:
        raise BadInputError(f"a picture of {len(jpeg)} bytes; at most {LARGEST_BYTES} are read")
    if not jpeg.startswith(_START):
        raise BadInputError("not a JPEG picture")
    at = 2
    # Segments: a marker of two bytes, a length of two bytes that counts itself, content.
    while at + 9 <= len(jpeg) and jpeg[at] == _MARKER and jpeg[at + 1] != _SCAN:
        if jpeg[at + 1] in _FRAMES:
            height, width = int.from_bytes(jpeg[at + 5 : at + 7]), int.from_bytes(jpeg[at + 7 : at + 9])
            if not (0 < width <= LARGEST_SIDE_PX and 0 < height <= LARGEST_SIDE_PX):
                raise BadInputError(
                    f"a picture of {width} x {height} pixels; at most {LARGEST_SIDE_PX} a side are read"
                )
            return width, height
        at += 2 + int.from_bytes(jpeg[at + 2 : at + 4])
    raise BadInputError("a JPEG picture without a frame header")


def decode(jpeg: bytes) -> NDArray[np.uint8]:
    """Picture (h, w, 3) RGB of a JPEG.

    Raises:
        BadInputError: it cannot be decoded, or is too large.
    """
    width, height = size_px(jpeg)
    try:
        image = cv2.imdecode(np.frombuffer(jpeg, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:
        raise BadInputError(f"a JPEG picture that cannot be decoded ({error})") from error
    if image is None or image.shape != (height, width, 3):
        raise BadInputError("a JPEG picture that cannot be decoded")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8)
