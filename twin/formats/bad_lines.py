"""What is wrong with a line of a log, in the words that problems are counted by, and numbers that are nothing else.

Python takes more for a number than a receiver writes: underscores between digits, other scripts' digits, ``nan`` and
``inf``. Here none of these is one.
"""

from __future__ import annotations

import sys

CHECKSUM = "checksum"
NO_CHECKSUM = "no checksum"
NO_HEADER = "no header"
MISSING = "missing fields"
NOT_A_NUMBER = "not a number"
OUT_OF_RANGE = "out of range"

LARGEST = sys.float_info.max
"""As a limit: whatever is finite."""
_MOST_DIGITS = 18
"""Of a whole number; more do not fit into 64 bits."""


class BadLineError(Exception):
    """A line, or a sentence in it, that cannot be used; ``kind`` says why."""

    def __init__(self, kind: str) -> None:
        super().__init__(kind)
        self.kind = kind


def require_plain(word: bytes | str) -> None:
    """See that a word has no characters that only Python takes for parts of a number.

    Raises:
        BadLineError: it has.
    """
    if (b"_" in word) if isinstance(word, bytes) else ("_" in word or not word.isascii()):
        raise BadLineError(NOT_A_NUMBER)


def any_number(word: bytes | str) -> float:
    """A number that may be infinite or NaN.

    Raises:
        BadLineError: it is none.
    """
    try:
        value = float(word)
    except ValueError:
        raise BadLineError(NOT_A_NUMBER) from None
    require_plain(word)
    return value


def number(word: bytes | str, low: float = -LARGEST, high: float = LARGEST) -> float:
    """A number within limits.

    Raises:
        BadLineError: it is none, or beyond the limits, as NaN is.
    """
    value = any_number(word)
    if not low <= value <= high:
        raise BadLineError(OUT_OF_RANGE)
    return value


def whole(word: bytes) -> int:
    """A whole number that is not negative, of digits alone.

    Raises:
        BadLineError: it is none.
    """
    if not word.isdigit() or len(word) > _MOST_DIGITS:
        raise BadLineError(NOT_A_NUMBER)
    return int(word)
