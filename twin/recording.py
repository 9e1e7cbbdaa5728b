"""Every stream of a run, columnar: what scoring, pictures and files read.

A recording lives in memory first. Its streams are named ``truth``, ``measurements/<sensor>``, ``hidden/<sensor>``,
``estimates/<estimator>`` and ``seeds/<estimator>``; disk (one Parquet file per stream, one scalar per column) is the
save format of an ordinary run, that is of one member.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from twin.errors import BadInputError
from twin.groundlog import GroundLog, save_ground
from twin.parquet import read_table
from twin.pictures import FOLDER as PICTURE_FOLDER
from twin.pictures import Pictures, save_pictures
from twin.signals import NS_PER_S, BoolArray, Event, FloatArray, IntArray
from twin.validation import did_you_mean
from twin.world.terrain import Terrain

TRUTH = "truth"
_FIRST_ROWS = 64


def measurement_stream(sensor: str) -> str:
    """Name of the stream of what a sensor gave."""
    return f"measurements/{sensor}"


def hidden_stream(sensor: str) -> str:
    """Name of the stream of a sensor's true errors, which estimators never get."""
    return f"hidden/{sensor}"


def estimate_stream(estimator: str) -> str:
    """Name of the stream of what an estimator said."""
    return f"estimates/{estimator}"


def seed_stream_name(estimator: str) -> str:
    """Name of the stream of the seeds that an estimator's row speeds put in the ground (rows are seeds)."""
    return f"seeds/{estimator}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """Rows in time of named scalar columns, for R runs."""

    columns: tuple[str, ...]
    t_ns: IntArray
    """(T,) time of validity."""
    values: FloatArray
    """(T, R, n)."""
    t_available_ns: IntArray | None = None
    """(T,) time of arrival, for measurements."""
    valid: BoolArray | None = None
    """(T, R), for measurements."""

    @property
    def t_s(self) -> FloatArray:
        """(T,) time of validity in seconds."""
        return self.t_ns / NS_PER_S

    def __len__(self) -> int:
        return len(self.t_ns)

    def has(self, column: str) -> bool:
        """Tell whether this column exists."""
        return column in self.columns

    def column(self, name: str) -> FloatArray:
        """One column, shape (T, R).

        Raises:
            KeyError: no such column.
        """
        try:
            return self.values[:, :, self.columns.index(name)]
        except ValueError:
            raise KeyError(f"no column {name!r}; there are {', '.join(self.columns)}") from None

    def select(self, names: Sequence[str]) -> FloatArray:
        """Several columns, shape (T, R, len(names))."""
        return np.stack([self.column(name) for name in names], axis=-1)

    def member(self, index: int) -> Stream:
        """Only one run of the ensemble axis (R = 1)."""
        valid = None if self.valid is None else self.valid[:, index : index + 1]
        return Stream(
            columns=self.columns,
            t_ns=self.t_ns,
            values=self.values[:, index : index + 1],
            t_available_ns=self.t_available_ns,
            valid=valid,
        )

    def to_arrow(self, run: int = 0) -> pa.Table:
        """One run as an Arrow table: ``t_ns``, for measurements ``t_available_ns`` and ``valid``, then the columns."""
        fields: dict[str, pa.Array] = {"t_ns": pa.array(self.t_ns)}
        if self.t_available_ns is not None:
            fields["t_available_ns"] = pa.array(self.t_available_ns)
        if self.valid is not None:
            fields["valid"] = pa.array(self.valid[:, run])
        for index, name in enumerate(self.columns):
            fields[name] = pa.array(np.ascontiguousarray(self.values[:, run, index]))
        return pa.table(fields)

    @staticmethod
    def from_arrow(table: pa.Table) -> Stream:
        """Inverse of :meth:`to_arrow`, with R = 1.

        Raises:
            ValueError: a column has another type than a recorded one.
            KeyError: there is no time.
        """
        special = {"t_ns", "t_available_ns", "valid"}
        for name, kind in zip(table.schema.names, table.schema.types, strict=True):
            wanted = pa.types.is_int64 if name in special else pa.types.is_floating
            if not (pa.types.is_boolean if name == "valid" else wanted)(kind):
                raise ValueError(f"column {name!r} has type {kind}")
        columns = tuple(name for name in table.column_names if name not in special)
        arrays = [table[name].to_numpy() for name in columns]
        values = np.stack(arrays, axis=-1) if arrays else np.empty((table.num_rows, 0))
        return Stream(
            columns=columns,
            t_ns=table["t_ns"].to_numpy(),
            values=values[:, np.newaxis, :],
            t_available_ns=table["t_available_ns"].to_numpy() if "t_available_ns" in table.column_names else None,
            valid=(
                table["valid"].to_numpy(zero_copy_only=False)[:, np.newaxis] if "valid" in table.column_names else None
            ),
        )


class StreamWriter:
    """Collects the rows of one stream of R runs, in one array that grows by doubling."""

    def __init__(self, columns: tuple[str, ...], runs: int) -> None:
        self.columns = columns
        self._values: FloatArray = np.empty((_FIRST_ROWS, runs, len(columns)))
        self._valid: BoolArray = np.ones((_FIRST_ROWS, runs), dtype=np.bool_)
        self._t_ns: list[int] = []
        self._t_available_ns: list[int] = []

    def append(
        self, t_ns: int, *parts: FloatArray, t_available_ns: int | None = None, valid: BoolArray | None = None
    ) -> None:
        """Add a row: arrays of shape (R, k) that stand side by side in ``columns``, and ``valid`` (R,); all copied.

        Columns for which there are none are NaN.
        """
        row = len(self._t_ns)
        if row == len(self._values):
            self._values = np.concatenate([self._values, np.empty_like(self._values)])
            self._valid = np.concatenate([self._valid, np.ones_like(self._valid)])
        first = 0
        for part in parts:
            last = first + part.shape[1]
            self._values[row, :, first:last] = part
            first = last
        if first < len(self.columns):
            self._values[row, :, first:] = np.nan
        self._t_ns.append(t_ns)
        if t_available_ns is not None and valid is not None:
            self._t_available_ns.append(t_available_ns)
            self._valid[row] = valid

    def finish(self) -> Stream:
        """Return what was collected as a :class:`Stream`."""
        rows = len(self._t_ns)
        measured = bool(self._t_available_ns)
        return Stream(
            columns=self.columns,
            t_ns=np.array(self._t_ns, dtype=np.int64),
            values=self._values[:rows].copy(),
            t_available_ns=np.array(self._t_available_ns, dtype=np.int64) if measured else None,
            valid=self._valid[:rows].copy() if measured else None,
        )

    def drain(self) -> Stream:
        """Return what was collected, and start again in the same memory.

        The stream's values are valid until the next :meth:`append`.
        """
        rows = len(self._t_ns)
        stream = Stream(columns=self.columns, t_ns=np.array(self._t_ns, dtype=np.int64), values=self._values[:rows])
        self._t_ns, self._t_available_ns = [], []
        return stream


@dataclass(kw_only=True)
class Recording:
    """All streams of a run (or of an ensemble over one truth) and how it ended."""

    scenario_toml: str
    """The resolved scenario."""
    scenario_name: str
    seed: int
    runs: tuple[int, ...]
    """Run indices along the ensemble axis."""
    streams: dict[str, Stream] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    pictures: dict[str, Pictures] = field(default_factory=dict)
    """What the cameras of the first run saw, by sensor."""
    terrain: Terrain | None = None
    """The ground as it was at the beginning, for pictures; only in memory."""
    ground: GroundLog | None = None
    """How it changed; None where no machine moves soil."""
    ended_reason: str = "duration"
    ended_t_s: float = 0.0
    timing: dict[str, float] = field(default_factory=dict)

    @property
    def truth(self) -> Stream:
        """The truth stream (R = 1: all members share it)."""
        return self.stream(TRUTH)

    def names(self, prefix: str) -> list[str]:
        """Names below ``measurements``, ``hidden``, ``estimates`` or ``seeds``, in the order of the scenario."""
        return [name.removeprefix(prefix + "/") for name in self.streams if name.startswith(prefix + "/")]

    def stream(self, name: str) -> Stream:
        """One stream by its whole name.

        Raises:
            KeyError: no such stream.
        """
        try:
            return self.streams[name]
        except KeyError:
            beside = [each for each in self.streams if each.partition("/")[0] == name.partition("/")[0]]
            there = ", ".join(beside or self.streams) or "none"
            raise KeyError(f"no stream {name!r}{did_you_mean(name, self.streams)} (there are {there})") from None

    def measurements(self, sensor: str) -> Stream:
        """What a sensor gave."""
        return self.stream(measurement_stream(sensor))

    def hidden(self, sensor: str) -> Stream:
        """A sensor's true errors."""
        return self.stream(hidden_stream(sensor))

    def estimates(self, estimator: str) -> Stream:
        """What an estimator said; sigma of column ``c`` is column ``c + '.sigma'`` (see :func:`sigma_column`)."""
        return self.stream(estimate_stream(estimator))

    def to_arrow(self, stream: str, run: int = 0) -> pa.Table:
        """One stream of one run as an Arrow table."""
        return self.stream(stream).to_arrow(run)


def covariance_column(first: str, second: str) -> str:
    """Column holding the covariance of two state columns in an estimate stream."""
    return f"cov({first},{second})"


_EVENT_SCHEMA = pa.schema(
    [("t_ns", pa.int64()), ("source", pa.string()), ("level", pa.string()), ("text", pa.string())]
)


def save(recording: Recording, folder: Path) -> None:
    """Write an ordinary run (R = 1): ``scenario.toml``, one Parquet file per stream, ``events.parquet``, pictures.

    The bytes depend on the recording alone.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scenario.toml").write_text(recording.scenario_toml)
    for name, stream in recording.streams.items():
        path = folder / f"{name}.parquet"
        path.parent.mkdir(exist_ok=True)
        pq.write_table(stream.to_arrow(), path)
    save_pictures(recording.pictures, folder)
    save_ground(recording.ground, folder)
    rows = [
        {"t_ns": event.t_ns, "source": event.source, "level": event.level, "text": event.text}
        for event in recording.events
    ]
    pq.write_table(pa.Table.from_pylist(rows, schema=_EVENT_SCHEMA), folder / "events.parquet")


def load_streams(folder: Path, *, with_truth: bool = True) -> dict[str, Stream]:
    """Read every stream of a run folder, or of a replayed log's, which has no truth.

    Raises:
        BadInputError: a file is missing or not readable as Parquet.
    """
    streams: dict[str, Stream] = {}
    others = (path for path in sorted(folder.glob("*/*.parquet")) if path.parent.name != PICTURE_FOLDER)
    for path in [*([folder / "truth.parquet"] if with_truth else []), *others]:
        name = path.relative_to(folder).with_suffix("").as_posix()
        try:
            streams[name] = Stream.from_arrow(read_table(path))
        except (OSError, pa.ArrowException, KeyError, ValueError) as error:
            raise BadInputError(f"{path}: cannot be read as a recorded stream ({error})") from error
    return streams


def load_events(folder: Path) -> list[Event]:
    """Read the event log of a run folder.

    Raises:
        BadInputError: the file is missing or not readable.
    """
    path = folder / "events.parquet"
    try:
        return [Event(**row) for row in read_table(path).cast(_EVENT_SCHEMA).to_pylist()]
    except (OSError, pa.ArrowException, ValueError) as error:
        raise BadInputError(f"{path}: cannot be read as an event log ({error})") from error
