"""How the ground changed during a run: heights of cells, as far as a machine moved soil there.

Only what changed is kept: rows of time, cell and new height. The cell is the flat index into the height array of the
terrain as it was at the beginning, row after row. On disk it is ``ground.parquet`` beside the streams.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from twin.errors import BadInputError
from twin.parquet import read_table
from twin.signals import FloatArray, IntArray

FILE = "ground.parquet"
_MOST_ROWS = 30_000_000
"""Ten hours, the longest run, with 800 cells changed every second."""
_COLUMNS = ("t_ns", "cell", "height_m")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundLog:
    """Heights of cells from a time on; rows in the order of time, each cell at most once at a time."""

    t_ns: IntArray
    """(K,)."""
    cell: IntArray
    """(K,) flat index into the terrain's heights."""
    height_m: FloatArray
    """(K,)."""

    def heights_at(self, heights_m: FloatArray, t_ns: int) -> FloatArray:
        """The ground at ``t_ns``, a copy, from the ground at the beginning.

        Raises:
            BadInputError: the log does not belong to ground of this size.
        """
        if len(self.cell) and not 0 <= int(self.cell.min()) <= int(self.cell.max()) < heights_m.size:
            raise BadInputError(f"{FILE}: cells that the ground does not have")
        then = heights_m.copy()
        upto = int(np.searchsorted(self.t_ns, t_ns, side="right"))
        # Of repeated indices numpy keeps the last, which is the latest.
        then.ravel()[self.cell[:upto]] = self.height_m[:upto]
        return then


class GroundLogWriter:
    """Collects changes."""

    def __init__(self) -> None:
        self._parts: list[tuple[IntArray, IntArray, FloatArray]] = []

    def append(self, t_ns: int, cell: IntArray, height_m: FloatArray) -> None:
        """Take the cells that changed since the last call, and their heights now, (n,) each."""
        if len(cell):
            self._parts.append((np.full(len(cell), t_ns, dtype=np.int64), cell, height_m))

    def finish(self) -> GroundLog:
        """Return what was collected."""
        empty = np.zeros(0, dtype=np.int64)
        t_ns, cell, height_m = zip((empty, empty, np.zeros(0)), *self._parts, strict=True)
        return GroundLog(t_ns=np.concatenate(t_ns), cell=np.concatenate(cell), height_m=np.concatenate(height_m))


def save_ground(log: GroundLog | None, folder: Path) -> None:
    """Write ``ground.parquet``, if there is anything to write."""
    if log is not None:
        table = pa.table({"t_ns": log.t_ns, "cell": log.cell, "height_m": log.height_m})
        pq.write_table(table, folder / FILE)


def load_ground(folder: Path) -> GroundLog | None:
    """Read it back; None where no soil moved.

    Raises:
        BadInputError: the file is no such log.
    """
    path = folder / FILE
    if not path.exists():
        return None
    try:
        return _log_of(read_table(path, most_cells=_MOST_ROWS * len(_COLUMNS)))
    except (OSError, pa.ArrowException, ValueError) as error:
        raise BadInputError(f"{path}: cannot be read as a log of the ground ({error})") from error


def _log_of(table: pa.Table) -> GroundLog:
    if tuple(table.column_names) != _COLUMNS:
        raise ValueError(f"expected the columns {', '.join(_COLUMNS)}")
    if any(column.null_count for column in table.columns):
        raise ValueError("a value is missing")
    t_ns, cell = (table[name].cast(pa.int64()).to_numpy() for name in _COLUMNS[:2])
    height_m = table["height_m"].cast(pa.float64()).to_numpy()
    if np.any(np.diff(t_ns) < 0):
        raise ValueError("rows out of order")
    if np.any(cell < 0):
        raise ValueError("a cell before the first")
    if not np.isfinite(height_m).all():
        raise ValueError("a height that is no number")
    return GroundLog(t_ns=t_ns, cell=cell, height_m=height_m)
