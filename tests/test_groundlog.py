"""The log of changed ground: written, read back, applied; and files that are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from twin import groundlog
from twin.errors import BadInputError
from twin.groundlog import FILE, GroundLogWriter, load_ground, save_ground


def _log() -> GroundLogWriter:
    writer = GroundLogWriter()
    writer.append(100, np.array([0, 5]), np.array([1.0, 2.0]))
    writer.append(150, np.zeros(0, dtype=np.int64), np.zeros(0))
    writer.append(200, np.array([5]), np.array([3.0]))
    return writer


def test_the_ground_at_a_time_is_the_first_with_all_changes_until_then() -> None:
    log, first = _log().finish(), np.zeros((2, 3))
    assert np.array_equal(log.heights_at(first, 99), first)
    assert np.array_equal(log.heights_at(first, 100), [[1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    assert np.array_equal(log.heights_at(first, 10**12), [[1.0, 0.0, 0.0], [0.0, 0.0, 3.0]])
    assert not first.any()


def test_it_survives_the_disk(tmp_path: Path) -> None:
    save_ground(_log().finish(), tmp_path)
    read = load_ground(tmp_path)
    assert read is not None
    assert read.t_ns.tolist() == [100, 100, 200]
    assert read.cell.tolist() == [0, 5, 5]
    assert read.height_m.tolist() == [1.0, 2.0, 3.0]


def test_no_soil_no_file(tmp_path: Path) -> None:
    save_ground(None, tmp_path)
    assert load_ground(tmp_path) is None
    save_ground(GroundLogWriter().finish(), tmp_path)
    assert load_ground(tmp_path) is not None


@pytest.mark.parametrize(
    "table",
    [
        pa.table({"a": [1]}),
        pa.table({"t_ns": [2, 1], "cell": [0, 0], "height_m": [0.0, 0.0]}),
        pa.table({"t_ns": [1], "cell": [0], "height_m": [float("nan")]}),
        pa.table({"t_ns": [1], "cell": ["x"], "height_m": [0.0]}),
        pa.table({"t_ns": [1], "cell": pa.array([None], pa.int64()), "height_m": [0.0]}),
        pa.table({"t_ns": pa.array([None, 1], pa.int64()), "cell": [0, 0], "height_m": [0.0, 0.0]}),
        pa.table({"t_ns": [1], "cell": [-1], "height_m": [0.0]}),
    ],
)
def test_other_files_are_refused(tmp_path: Path, table: pa.Table) -> None:
    pq.write_table(table, tmp_path / FILE)
    with pytest.raises(BadInputError, match=FILE):
        load_ground(tmp_path)


def test_a_log_that_would_fill_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_ground(_log().finish(), tmp_path)
    monkeypatch.setattr(groundlog, "_MOST_ROWS", 2)
    with pytest.raises(BadInputError, match="at most 6 are read"):
        load_ground(tmp_path)


def test_cells_beyond_the_ground_are_refused() -> None:
    with pytest.raises(BadInputError, match="cells"):
        _log().finish().heights_at(np.zeros((1, 2)), 100)
