"""Lines of a text file from anywhere, in memory that does not grow with the file or with a line that never ends."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from twin.errors import BadInputError

LONGEST_LINE = 2048
"""Bytes; the longest sentence of a receiver has a few hundred, a row of a table somewhat more."""
TOO_LONG = "too long"
UNREADABLE = "cannot be read"
_CHUNK = 1 << 16


def require_file(path: Path) -> None:
    """See that there is a file to be read.

    Raises:
        BadInputError: it is missing, no ordinary file (a folder, a pipe, a device), empty, or may not be read.
    """
    try:
        if not path.exists():
            raise BadInputError(f"{path}: no such file")
        if not path.is_file():
            raise BadInputError(f"{path}: not a file")
        with path.open("rb") as file:
            if not file.read(1):
                raise BadInputError(f"{path}: the file is empty")
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error


def lines_of(path: Path, problems: Counter[str]) -> Iterator[bytes]:
    """Lines of a file that are not empty, without their ends (line feed, carriage return or both).

    A line of more than ``LONGEST_LINE`` bytes is passed over and counted as ``TOO_LONG``; where the disk refuses, the
    file ends, counted as ``UNREADABLE``.
    """
    try:
        with path.open("rb") as file:
            yield from _lines(file, problems)
    except OSError:
        problems[UNREADABLE] += 1


def _lines(file: BinaryIO, problems: Counter[str]) -> Iterator[bytes]:
    rest = b""
    passing_over = False
    while chunk := file.read(_CHUNK):
        parts = (rest + chunk).replace(b"\r", b"\n").split(b"\n")
        rest = parts.pop()
        for part in parts:
            if passing_over:
                passing_over = False
            elif len(part) > LONGEST_LINE:
                problems[TOO_LONG] += 1
            elif part:
                yield part
        if passing_over:
            rest = b""
        elif len(rest) > LONGEST_LINE:
            problems[TOO_LONG] += 1
            passing_over = True
            rest = b""
    if rest and not passing_over:
        yield rest
