"""Streams of a log on their way to disk: Parquet files that grow by row groups, and what pictures keep of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from twin.recording import Recording, Stream
from twin.signals import FloatArray

GROUP_ROWS = 8192
MOST_ROWS = 16_384
"""Of a stream in a picture: between half of it and all are kept of a longer one."""


class ParquetFiles:
    """Parquet files of a folder, one per stream, that grow by row groups.

    They are such as :func:`twin.recording.save` writes, but for the groups.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._writers: dict[str, pq.ParquetWriter] = {}
        self._waiting: dict[str, list[pa.Table]] = {}

    def add(self, name: str, stream: Stream) -> None:
        """Take rows of a stream (R = 1)."""
        if self._folder is None:
            return
        waiting = self._waiting.setdefault(name, [])
        waiting.append(stream.to_arrow())
        if sum(table.num_rows for table in waiting) >= GROUP_ROWS:
            self._write(name)

    def _write(self, name: str) -> None:
        assert self._folder is not None
        table = pa.concat_tables(self._waiting[name])
        self._waiting[name] = []
        if name not in self._writers:
            path = self._folder / f"{name}.parquet"
            path.parent.mkdir(exist_ok=True)
            self._writers[name] = pq.ParquetWriter(path, table.schema)
        self._writers[name].write_table(table, row_group_size=max(table.num_rows, 1))

    def finish(self) -> None:
        """Write what waits."""
        for name, waiting in self._waiting.items():
            if waiting:
                self._write(name)

    def close(self) -> None:
        """Close the files."""
        for writer in self._writers.values():
            writer.close()


@contextmanager
def parquet_files(folder: Path | None) -> Iterator[ParquetFiles]:
    """Files in ``folder``, closed in any case; None: nothing is written.

    Raises:
        OSError: they cannot be written.
    """
    files = ParquetFiles(folder)
    try:
        yield files
        files.finish()
    finally:
        files.close()


class Thinned:
    """At most ``most_rows`` rows of a stream of any length, spread over all of it.

    Of each group of so many neighbours the row with the largest weight is kept, so that peaks stay; where there are
    none, the first. When there are too many groups, each two become one.
    """

    def __init__(self, most_rows: int = MOST_ROWS) -> None:
        self._most = most_rows - most_rows % 2
        self._stride = 1
        self._kept = self._waiting = self._last = _Rows.none()

    def add(self, stream: Stream, weight: FloatArray | None = None) -> None:
        """Take rows (R = 1), with a weight (T,) each; an unknown one (NaN) is the smallest."""
        rows = _Rows.of(stream, weight)
        if not len(rows):
            return
        self._last = rows[-1:]
        rows = self._waiting + rows
        while len(rows) >= self._stride:
            groups = min(len(rows) // self._stride, self._most - len(self._kept))
            whole = groups * self._stride
            self._kept += rows[:whole].heaviest(self._stride)
            rows = rows[whole:]
            if len(self._kept) == self._most:
                self._kept = self._kept.heaviest(2)
                self._stride *= 2
        self._waiting = rows

    def stream(self) -> Stream | None:
        """What was kept, with the last row of all; None of nothing."""
        kept = self._kept
        if len(self._waiting):
            kept += self._waiting.heaviest(len(self._waiting))
        if not len(kept):
            return None
        if kept.shape is None:
            return None
        if kept.row_times[-1] != self._last.row_times[-1]:
            kept += self._last
        return kept.as_stream()


class _Rows:
    """Rows as arrays: times, values, validity and weight."""

    def __init__(self, shape: Stream | None, arrays: tuple[np.ndarray, ...]) -> None:
        self.shape = shape
        self._arrays = arrays

    @classmethod
    def none(cls) -> _Rows:
        return cls(None, ())

    @classmethod
    def of(cls, stream: Stream, weight: FloatArray | None) -> _Rows:
        count = len(stream)
        weighed = np.zeros(count) if weight is None else np.where(np.isnan(weight), -1.0, weight)
        valid = np.ones(count, dtype=np.bool_) if stream.valid is None else stream.valid[:, 0]
        return cls(stream, (stream.t_ns, stream.values[:, 0], valid, weighed))

    @property
    def row_times(self) -> np.ndarray:
        return self._arrays[0]

    def __len__(self) -> int:
        return len(self._arrays[0]) if self._arrays else 0

    def __getitem__(self, which: slice) -> _Rows:
        # Copies, or a view of a few rows would keep the whole block in memory.
        return _Rows(self.shape, tuple(array[which].copy() for array in self._arrays))

    def __add__(self, other: _Rows) -> _Rows:
        if not len(self):
            return other
        if not len(other):
            return self
        pairs = zip(self._arrays, other._arrays, strict=True)
        return _Rows(self.shape, tuple(np.concatenate(pair) for pair in pairs))

    def heaviest(self, group: int) -> _Rows:
        """Of each group of rows the one with the largest weight; the first of those that share it."""
        if group == 1 or not len(self):
            return self
        weight = self._arrays[-1].reshape(-1, group)
        chosen = np.arange(len(weight)) * group + weight.argmax(axis=1)
        return _Rows(self.shape, tuple(array[chosen] for array in self._arrays))

    def as_stream(self) -> Stream:
        assert self.shape is not None
        t_ns, values, valid, _ = self._arrays
        return Stream(
            columns=self.shape.columns,
            t_ns=t_ns,
            values=values[:, np.newaxis],
            t_available_ns=None if self.shape.t_available_ns is None else t_ns,
            valid=None if self.shape.valid is None else valid[:, np.newaxis],
        )


class Sketch:
    """What pictures need of a replay: its streams, thinned."""

    def __init__(self) -> None:
        self._streams: dict[str, Thinned] = {}

    def add(self, name: str, stream: Stream, weight: FloatArray | None = None) -> None:
        """Take rows of a stream."""
        self._streams.setdefault(name, Thinned()).add(stream, weight)

    def recording(self, name: str, *, ended_t_s: float, timing: Mapping[str, float]) -> Recording:
        """A recording of what was kept; it has no scenario and no truth."""
        kept = {stream: thinned.stream() for stream, thinned in self._streams.items()}
        return Recording(
            scenario_toml="",
            scenario_name=name,
            seed=0,
            runs=(0,),
            streams={stream: rows for stream, rows in kept.items() if rows is not None},
            ended_reason="end of log",
            ended_t_s=ended_t_s,
            timing=dict(timing),
        )
