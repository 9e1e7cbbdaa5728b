"""Logs in CSV files, read by a mapping (:mod:`twin.formats.csv_mapping`)."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.errors import BadInputError
from twin.formats.csv_mapping import COLUMNS, CsvMapping, Table
from twin.formats.csv_rows import Row, TableReader
from twin.formats.geodetic import Origin
from twin.formats.gnss_fixes import GNSS, Fix, measurements
from twin.formats.log_clock import LONGEST_LOG_NS, Placed, SharedClock, follows
from twin.formats.log_head import HEAD_EPOCHS, LogHead, origin_of, rate_hz, receiver_info
from twin.signals import Measurement, Mount, SensorInfo

_NEUTRAL_IMU = {
    "accel_noise_m_s2": 0.05,
    "accel_bias_m_s2": 0.5,
    "gyro_noise_rad_s": 1e-3,
    "gyro_bias_rad_s": 0.02,
}
"""A choice: a unit of phones and hobby boards, between those of the presets."""


class CsvLog:
    """Sensors in one or several CSV files; see :class:`twin.formats.log.Log`.

    A sample arrives when it is measured. Files are read side by side, on one clock, and each is taken to be in order of
    time: what goes back is passed over. A receiver whose quality the mapping does not tell counts as a single-point one
    (1) where it has a position.

    Args:
        path: one of the files, or their folder; a table without ``file`` is about this one.
        mapping: what the columns mean.
        origin: of the local frame; the first position if None, and somewhere where there is none at all.

    Raises:
        BadInputError: a file is missing, lacks a column, none has a usable row, or the log begins far from ``origin``.
    """

    def __init__(self, path: Path, mapping: CsvMapping, *, origin: Origin | None = None) -> None:
        self.path = path
        self.problems: Counter[str] = Counter()
        self._readers = [TableReader(_file(path, table), table) for table in mapping.tables]
        unused: Counter[str] = Counter()
        rows, heads = zip(*(_look(reader, unused) for reader in self._readers), strict=True)
        if not any(rows):
            kinds = ", ".join(f"{count} {kind}" for kind, count in unused.most_common(5))
            raise BadInputError(f"{path}: no row of it can be used ({kinds or 'nothing at all'})")
        self._first_ns = min(_start_ns(first) for first in rows if first)
        dated = mapping.tables[0].time.since != "start"
        self.start_utc_ns = self._first_ns if dated else None
        fixes = [fix for head in heads for fix in head.fixes]
        self.origin = origin_of(fixes, origin, path=path) if fixes else origin or Origin()
        tables = zip(mapping.tables, rows, heads, strict=True)
        infos = [_info(table, first, head) for table, first, head in tables if first]
        self.sensors: Mapping[str, SensorInfo] = {info.name: info for info in infos}

    def measurements(self) -> Iterator[Measurement]:
        """Measurements in order of arrival; once."""
        streams = [self._stream(reader) for reader in self._readers]
        return heapq.merge(*streams, key=lambda measurement: measurement.t_available_ns)

    def _stream(self, reader: TableReader) -> Iterator[Measurement]:
        return measurements(self._items(reader), self.origin)

    def _items(self, reader: TableReader) -> Iterator[Fix | Measurement]:
        clock: SharedClock[Row] = SharedClock(self.problems, begin_ns=self._first_ns)
        for row in reader.rows(self.problems):
            for placed in clock.put(row, row.t_ns):
                yield _sample(reader.table, placed)
        for placed in clock.finish():
            yield _sample(reader.table, placed)


def _sample(table: Table, placed: Placed[Row]) -> Fix | Measurement:
    sample = _fix if table.kind == GNSS else _measurement
    return sample(table, placed.item, placed.t_ns, placed.t_available_ns)


def _file(path: Path, table: Table) -> Path:
    if table.file is None:
        if path.is_dir():
            raise BadInputError(f"{path}: a folder, and the mapping names no file for its table of kind {table.kind!r}")
        return path
    return (path if path.is_dir() else path.parent) / table.file


def _look(reader: TableReader, unused: Counter[str]) -> tuple[list[Row], LogHead]:
    """The first rows of a table, and what they tell of a receiver."""
    rows, head = list[Row](), LogHead()
    receiver = reader.table.kind == GNSS
    for row in reader.rows(unused):
        if len(rows) < HEAD_EPOCHS:
            rows.append(row)
        if receiver:
            head.take(_fix(reader.table, row, row.t_ns, row.t_ns))
        if len(rows) == HEAD_EPOCHS and (not receiver or head.looked_far or (head.whole and head.best_there_is)):
            break
    return rows, head


def _start_ns(head: Sequence[Row]) -> int:
    """Time of the first row that another follows: a first one far off does not count."""
    pairs = itertools.pairwise(head)
    return next((row.t_ns for row, after in pairs if follows(after.t_ns - row.t_ns, LONGEST_LOG_NS)), head[0].t_ns)


def _fix(table: Table, row: Row, t_ns: int, t_available_ns: int) -> Fix:
    fix = Fix(t_ns, t_available_ns, **row.values)
    if math.isnan(fix.latitude_deg + fix.longitude_deg) or fix.quality == 0.0:
        return fix._replace(latitude_deg=math.nan, longitude_deg=math.nan, height_m=math.nan, quality=0.0)
    return fix if "quality" in table.columns else fix._replace(quality=1.0)


def _measurement(table: Table, row: Row, t_ns: int, t_available_ns: int) -> Measurement:
    columns = COLUMNS[table.kind]
    return Measurement(
        sensor=table.kind,
        t_ns=t_ns,
        t_available_ns=t_available_ns,
        columns=columns,
        values=np.array([[row.values.get(column, math.nan) for column in columns]]),
        valid=np.ones(1, dtype=np.bool_),
    )


def _info(table: Table, rows: Sequence[Row], head: LogHead) -> SensorInfo:
    mount = Mount(body="log", xyz_m=table.xyz_m)
    rate = rate_hz([each.t_ns for each in head.fixes or rows])
    if table.kind == GNSS:
        info = receiver_info([], head.best)
        columns, sheet = info.columns, dict(info.datasheet)
    else:
        columns, sheet = COLUMNS[table.kind], dict(_NEUTRAL_IMU) if table.kind == "imu" else {}
    return SensorInfo(
        name=table.kind,
        kind=table.kind,
        columns=columns,
        mount=mount,
        rate_hz=rate,
        datasheet=sheet | dict(table.datasheet),
    )
