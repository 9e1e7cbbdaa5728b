"""Content fingerprint of a .rrd: equal for two runs that recorded the same.

The files themselves differ at every writing: row ids and chunk ids hold the clock and random bits.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader

from twin.errors import BadInputError

_PROPERTIES = "/__properties"
_Key = tuple[str, str, tuple[str, ...]]
"""Entity, component, names of its timelines."""


class _Hash(Protocol):
    def update(self, data: bytes, /) -> None: ...


def fingerprint(path: Path) -> str:
    """Hash the recording in a .rrd: sha256 over entity, component, timelines, times and values, sorted by time.

    Row ids, chunk ids, the cut into chunks, the blueprint (whose views have random ids) and recording properties do not
    count; every value bit and every nanosecond does. Rows of one component with equal times keep their order in the
    file.

    Raises:
        BadInputError: the file cannot be read as a recording.
    """
    try:
        return _fingerprint(path)
    except (OSError, RuntimeError, ValueError) as error:
        raise BadInputError(f"{path}: cannot be read as a .rrd recording ({error})") from error


def _fingerprint(path: Path) -> str:
    found: dict[_Key, list[tuple[Any, pa.Array]]] = defaultdict(list)
    for chunk in RrdReader(path).stream():
        if chunk.entity_path.startswith(_PROPERTIES):
            continue
        timelines = tuple(sorted(chunk.timeline_names))
        batch = chunk.to_record_batch()
        times = [batch[name].cast(pa.int64()).to_numpy() for name in timelines]
        for field in batch.schema:
            if (field.metadata or {}).get(b"rerun:kind") != b"data":
                continue
            values = batch[field.name]
            known = values.is_valid().to_numpy(zero_copy_only=False)
            stamps = np.array([time[known] for time in times], dtype=np.int64).reshape(len(times), int(known.sum()))
            if known.any():
                found[chunk.entity_path, field.name, timelines].append((stamps, values.drop_null()))
    digest = hashlib.sha256()
    for key in sorted(found):
        stamps = np.concatenate([part for part, _ in found[key]], axis=1)
        values = pa.concat_arrays([part for _, part in found[key]])
        order = np.lexsort(stamps[::-1]) if len(stamps) else np.arange(len(values))
        digest.update(repr(key).encode())
        digest.update(np.ascontiguousarray(stamps[:, order]).tobytes())
        _hash_array(digest, values.take(pa.array(order)))
    return digest.hexdigest()


def _hash_array(digest: _Hash, array: pa.Array) -> None:
    """Feed values, not buffers: how Arrow slices, pads and offsets them must not count."""
    digest.update(f"{array.type}:{len(array)}:{array.null_count};".encode())
    if array.null_count:
        digest.update(array.is_valid().to_numpy(zero_copy_only=False).tobytes())
        array = array.drop_null()
    kind = array.type
    if pa.types.is_fixed_size_list(kind):
        _hash_array(digest, array.flatten())
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind):
        digest.update(array.value_lengths().to_numpy(zero_copy_only=False).tobytes())
        _hash_array(digest, array.flatten())
    elif pa.types.is_struct(kind):
        for index, child in enumerate(array.flatten()):
            digest.update(kind.field(index).name.encode())
            _hash_array(digest, child)
    elif pa.types.is_union(kind):
        digest.update(repr(array.to_pylist()).encode())
    elif pa.types.is_primitive(kind):
        digest.update(array.to_numpy(zero_copy_only=False).tobytes())
    else:
        for value in array.to_pylist():
            content = value if isinstance(value, bytes) else repr(value).encode()
            digest.update(f"{len(content)}:".encode() + content)
