"""Reads arrays of numbers from MATLAB files of version 5 (those that ``save -v6`` and ``-v7`` write).

Source: "MAT-File Format", The MathWorks. A file is a header of 128 bytes and then elements: a tag of type and size, and
data padded to 8 bytes; a matrix is an element of elements (flags, dimensions, name, real part), which may be compressed
by zlib. Files come from anywhere, and ``scipy.io`` can be made to crash by a damaged one; here every size is held
against what is there before it is used, and nothing is unpacked beyond what was allowed.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin.errors import BadInputError
from twin.signals import FloatArray

_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
_STORED = {
    1: "<i1", 2: "<u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 9: "<f8", 12: "<i8", 13: "<u8",
}  # fmt: skip
_NUMERIC_CLASSES = range(6, 16)
_COMPLEX = 0x0800
_PEEK_BYTES = 4096
"""Enough for a matrix's flags, dimensions and name."""


class _Element(NamedTuple):
    kind: int
    data: memoryview
    after: int
    """Where the next element begins."""


class _Matrix(NamedTuple):
    name: str
    numeric: bool
    shape: tuple[int, ...]
    real_at: int
    """Where the real part begins, within the matrix."""


class _DamagedError(Exception):
    """Something in the file does not fit."""


def read_arrays(
    path: Path, names: Collection[str], *, largest_file_bytes: int, largest_elements: int
) -> dict[str, FloatArray]:
    """The arrays of real numbers called ``names`` that a file holds, with their shapes; others are not unpacked.

    Raises:
        BadInputError: the file cannot be read, is larger than ``largest_file_bytes``, is of another version, is
            damaged, or one of the arrays has more than ``largest_elements``.
    """
    content = _content(path, largest_file_bytes)
    found: dict[str, FloatArray] = {}
    try:
        at = _HEADER_BYTES
        while at < len(content):
            element = _element(content, at)
            at = element.after
            if element.kind in {_MATRIX, _COMPRESSED}:
                _take(element, names, found, largest_elements)
    except (_DamagedError, struct.error, zlib.error) as error:
        raise BadInputError(f"{path}: the MATLAB file is damaged: {error}") from error
    return found


def _content(path: Path, largest_bytes: int) -> memoryview:
    try:
        size = path.stat().st_size
        if size > largest_bytes:
            raise BadInputError(f"{path}: {size} bytes; allowed: up to {largest_bytes}")
        content = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if content.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise BadInputError(f"{path}: a MATLAB file of version 7.3; save it with -v7")
    if not content.startswith(b"MATLAB 5.0") or content[126:128] != b"IM":
        raise BadInputError(f"{path}: not a MATLAB file of version 5 (little-endian)")
    return memoryview(content)


def _element(data: memoryview, at: int) -> _Element:
    """The element at a place, not padded where it is compressed."""
    kind, size = struct.unpack_from("<II", data, at)
    if kind >> 16:  # a small element: both in one word, up to four bytes in the next
        kind, size, start, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        if size > 4:
            raise _DamagedError(f"a small element of {size} bytes")
    else:
        start = at + 8
        after = start + size if kind == _COMPRESSED else start + (size + 7) // 8 * 8
    if start + size > len(data):
        raise _DamagedError(f"an element of {size} bytes where {len(data) - start} are left")
    return _Element(kind, data[start : start + size], after)


def _take(element: _Element, names: Collection[str], found: dict[str, FloatArray], largest_elements: int) -> None:
    """Add a matrix to what was found, if it is asked for."""
    packed = element.kind == _COMPRESSED
    head = _unpacked(element.data, _PEEK_BYTES)[8:] if packed else element.data
    matrix = _matrix(head)
    if matrix.name not in names or not matrix.numeric:
        return
    count = math.prod(matrix.shape)
    if count > largest_elements:
        raise _DamagedError(f"{matrix.name} has {count} elements; allowed: up to {largest_elements}")
    body = element.data
    if packed:
        body = _unpacked(element.data, 8 + matrix.real_at + 8 + 8 * count)[8:]
    found[matrix.name] = _numbers(_element(body, matrix.real_at), matrix, count)


def _unpacked(data: memoryview, most_bytes: int) -> memoryview:
    return memoryview(zlib.decompressobj().decompress(data, most_bytes))


def _matrix(head: memoryview) -> _Matrix:
    flags = _element(head, 0)
    if len(flags.data) != 8:
        raise _DamagedError("a matrix without flags")
    (flag,) = struct.unpack_from("<I", flags.data)
    dimensions = _element(head, flags.after)
    if not 8 <= len(dimensions.data) <= 32 or len(dimensions.data) % 4:
        raise _DamagedError("a matrix without two to eight dimensions")
    shape = struct.unpack(f"<{len(dimensions.data) // 4}i", dimensions.data)
    if min(shape) < 0:
        raise _DamagedError(f"a matrix of the shape {shape}")
    name = _element(head, dimensions.after)
    numeric = flag & 0xFF in _NUMERIC_CLASSES and not flag & _COMPLEX
    return _Matrix(bytes(name.data).decode("latin-1"), numeric, shape, name.after)


def _numbers(real: _Element, matrix: _Matrix, count: int) -> FloatArray:
    stored = _STORED.get(real.kind)
    if stored is None or len(real.data) != count * np.dtype(stored).itemsize:
        raise _DamagedError(f"{matrix.name} holds {len(real.data)} bytes of the kind {real.kind}")
    numbers = np.frombuffer(real.data, dtype=stored).astype(np.float64)
    return np.ascontiguousarray(numbers.reshape(matrix.shape, order="F"))
