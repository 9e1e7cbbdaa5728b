"""Reads the rows of one CSV file as one sensor's samples, by a table of a mapping (:mod:`twin.formats.csv_mapping`)."""

from __future__ import annotations

import csv
import decimal
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from twin.errors import BadInputError
from twin.formats.bad_lines import MISSING, NOT_A_NUMBER, OUT_OF_RANGE, BadLineError, any_number, require_plain
from twin.formats.csv_mapping import VARIANCE, Source, Table, TimeColumn, units_of
from twin.formats.dates import require_dated
from twin.formats.gps_time import UNIX_OF_GPS_S, leap_seconds
from twin.formats.lines import lines_of, require_file
from twin.signals import NS_PER_S

_DIGITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""By how many digits a unit of time is longer than a nanosecond."""
_LARGEST_TIME_DIGITS = 20
_LONGEST_TIME = 40
_LIMITS: Mapping[str, tuple[float, float]] = {
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-360.0, 360.0),
    "height_m": (-1e4, 1e5),
    "geoid_m": (-200.0, 200.0),
    "speed_m_s": (-1e3, 1e3),
    "course_deg": (-360.0, 360.0),
    "quality": (0.0, 9.0),
    "satellites": (0.0, 999.0),
    "hdop": (0.0, 9_999.0),
    "vdop": (0.0, 9_999.0),
    "age_s": (0.0, 1e6),
}
_USUAL_LIMITS = (-1e5, 1e5)


class Row(NamedTuple):
    """One row of a table."""

    t_ns: int
    """On the file's own clock."""
    values: dict[str, float]
    """By column of the sensor; NaN where the file has none."""


class _Cell(NamedTuple):
    """How one value is found in a row."""

    name: str
    source: Source
    at: int
    over: int
    scale: float
    limits: tuple[float, float]

    def value(self, cells: Sequence[str]) -> float:
        source = self.source
        if source.constant is not None:
            return source.constant
        value = _number(cells[self.at]) if source.values is None else _word(cells[self.at].strip(), source.values)
        if source.unit == VARIANCE:
            if value < 0.0:
                raise BadLineError(OUT_OF_RANGE)
            value = math.sqrt(value)
        if source.over is not None:
            seconds = _number(cells[self.over])
            value = value / seconds if seconds > 0.0 else math.nan
        value *= self.scale
        if not math.isnan(value) and not self.limits[0] <= value <= self.limits[1]:
            raise BadLineError(OUT_OF_RANGE)
        return value


class TableReader:
    """Reads one table's rows.

    Args:
        path: the file.
        table: what its columns are.

    Raises:
        BadInputError: the file is not there, or lacks a column that the mapping names.
    """

    def __init__(self, path: Path, table: Table) -> None:
        require_file(path)
        self.path, self.table = path, table
        header = next(self._cells(Counter()), [])
        names = [name.strip().strip('"').removeprefix("\ufeff") for name in header]
        self._width = len(names)
        self._time = self._index(names, table.time.column, "time")
        self._columns = [self._cell(names, name, source) for name, source in table.columns.items()]

    def _cell(self, names: Sequence[str], name: str, source: Source) -> _Cell:
        units = units_of(name, divided=source.over is not None)
        return _Cell(
            name=name,
            source=source,
            at=self._index(names, source.column, name),
            over=self._index(names, source.over, name),
            scale=source.scale * (1.0 if source.unit is None else units[source.unit]),
            limits=_LIMITS.get(name, _USUAL_LIMITS),
        )

    def _index(self, names: Sequence[str], column: str | None, what: str) -> int:
        if column is None:
            return -1
        if column not in names:
            there = ", ".join(names[:40]) or "none"
            raise BadInputError(f"{self.path}: no column {column!r} for {what} (there are {there})")
        return names.index(column)

    def _cells(self, problems: Counter[str]) -> Iterator[list[str]]:
        separator = self.table.separator
        for line in lines_of(self.path, problems):
            if line.startswith(b"#"):
                continue
            text = line.decode("utf-8", "replace")
            if '"' not in text:
                yield text.split(separator)
                continue
            try:
                yield next(csv.reader([text], delimiter=separator))
            except (csv.Error, StopIteration):
                problems[NOT_A_NUMBER] += 1

    def rows(self, problems: Counter[str]) -> Iterator[Row]:
        """Rows that can be used, in the file's order; the others are counted."""
        for cells in itertools.islice(self._cells(problems), 1, None):
            try:
                yield self._row(cells)
            except BadLineError as error:
                problems[error.kind] += 1

    def _row(self, cells: Sequence[str]) -> Row:
        if len(cells) != self._width:
            raise BadLineError(MISSING)
        values = {cell.name: cell.value(cells) for cell in self._columns}
        return Row(_time_ns(cells[self._time].strip(), self.table.time), values)


def _word(word: str, values: Mapping[str, float]) -> float:
    if word in values:
        return values[word]
    number = _number(word)
    for name, value in values.items():
        try:
            if float(name) == number:
                return value
        except ValueError:
            continue
    raise BadLineError(OUT_OF_RANGE)


def _number(cell: str) -> float:
    """A number; NaN for an empty cell or one that says so."""
    if not cell or cell.isspace():
        return math.nan
    value = any_number(cell)
    if math.isinf(value):
        raise BadLineError(OUT_OF_RANGE)
    return value


def _time_ns(text: str, column: TimeColumn) -> int:
    """A row's time, ns since 1970 (UTC) or since some moment; no digit of it is lost."""
    if not text:
        raise BadLineError(MISSING)
    try:
        value = decimal.Decimal(text)
    except decimal.InvalidOperation:
        raise BadLineError(NOT_A_NUMBER) from None
    require_plain(text)
    digits = _DIGITS[column.unit]
    if not value.is_finite() or value.adjusted() + digits > _LARGEST_TIME_DIGITS or len(text) > _LONGEST_TIME:
        raise BadLineError(OUT_OF_RANGE)
    t_ns = int(value.scaleb(digits))
    if column.since == "gps":
        t_ns += UNIX_OF_GPS_S * NS_PER_S
        t_ns -= leap_seconds(t_ns / NS_PER_S) * NS_PER_S
    if column.since == "start":
        if not 0 <= t_ns < 2**62:
            raise BadLineError(OUT_OF_RANGE)
    else:
        require_dated(t_ns)
    return t_ns
