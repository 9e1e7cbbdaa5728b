"""What pictures and files keep of streams of any length."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from twin.logreplay import streams
from twin.logreplay.streams import Sketch, Thinned, parquet_files
from twin.recording import Stream
from twin.runfolder import replacing
from twin.signals import FloatArray


def rows(first: int, last: int, values: FloatArray | None = None) -> Stream:
    t_ns = np.arange(first, last, dtype=np.int64)
    told = t_ns.astype(float) if values is None else values
    return Stream(columns=("x",), t_ns=t_ns, values=told[:, np.newaxis, np.newaxis])


@pytest.mark.parametrize("size", [1, 7, 64, 1000])
def test_a_short_stream_is_kept_whole(size: int) -> None:
    thinned = Thinned(100)
    for begin in range(0, 90, size):
        thinned.add(rows(begin, min(90, begin + size)))
    kept = thinned.stream()
    assert kept is not None
    assert kept.t_ns.tolist() == list(range(90))


@pytest.mark.parametrize("size", [1, 13, 500])
@pytest.mark.parametrize("count", [100, 101, 199, 999, 5000])
def test_a_long_stream_is_kept_evenly_with_its_ends_and_peaks(size: int, count: int) -> None:
    rng = np.random.default_rng(count)
    weight = rng.uniform(size=count)
    peaks = rng.choice(count, 5, replace=False)
    weight[peaks] = 10.0 + np.arange(5)
    thinned = Thinned(100)
    for begin in range(0, count, size):
        piece = slice(begin, min(count, begin + size))
        thinned.add(rows(piece.start, piece.stop), weight[piece])
    kept = thinned.stream()
    assert kept is not None
    assert 50 <= len(kept) <= 102
    assert (np.diff(kept.t_ns) > 0).all()
    assert kept.t_ns[-1] == count - 1
    assert (kept.column("x")[:, 0] == kept.t_ns).all()
    assert kept.t_ns[0] < 4 * count / 100 + 1
    assert np.diff(kept.t_ns).max() <= 2 * 4 * count / 100 + 1  # neighbours lie in neighbouring groups
    assert peaks[4] in kept.t_ns  # the largest is never given up


def test_without_weights_the_first_of_each_group_stays() -> None:
    thinned = Thinned(4)
    thinned.add(rows(0, 16))
    kept = thinned.stream()
    assert kept is not None
    assert kept.t_ns.tolist() == [0, 8, 15]


def test_parquet_grows_by_groups_and_reads_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "GROUP_ROWS", 100)
    with parquet_files(tmp_path) as files:
        for begin in range(0, 330, 30):
            files.add("estimates/one", rows(begin, begin + 30))
    path = tmp_path / "estimates" / "one.parquet"
    assert pq.ParquetFile(path).metadata.num_row_groups == 3
    back = Stream.from_arrow(pq.read_table(path))
    assert back.t_ns.tolist() == list(range(330))
    assert back.column("x")[:, 0].tolist() == list(range(330))


def test_what_is_written_before_an_interruption_vanishes(tmp_path: Path) -> None:
    target = tmp_path / "log"

    def interrupted() -> None:
        with replacing(target) as building, parquet_files(building) as files:
            files.add("estimates/one", rows(0, streams.GROUP_ROWS))
            assert (building / "estimates" / "one.parquet").exists()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_sketch_of_nothing_has_no_streams() -> None:
    sketch = Sketch()
    sketch.add("measurements/gnss", rows(0, 0))
    assert sketch.recording("none", ended_t_s=0.0, timing={}).streams == {}
