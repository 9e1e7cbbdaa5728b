from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from tests.viz.conftest import Written
from tests.viz.synthetic_run import make_recording, make_scene
from twin.errors import BadInputError
from twin.recording import Recording
from viz.fingerprint import fingerprint
from viz.rrd import write_rrd

Change = Callable[[Recording], None]


def written_with(folder: Path, change: Change) -> str:
    recording = make_recording(6.0)
    change(recording)
    write_rrd(recording, make_scene(folder), {}, folder / "run.rrd")
    return fingerprint(folder / "run.rrd")


def nothing(recording: Recording) -> None: ...


def one_nanosecond_later(recording: Recording) -> None:
    stream = recording.estimates("central")
    t_ns = stream.t_ns.copy()
    t_ns[200] += 1
    recording.streams["estimates/central"] = dataclasses.replace(stream, t_ns=t_ns)


def one_value_by_1e_9(recording: Recording) -> None:
    stream = recording.estimates("central")
    stream.values[200, 0, stream.columns.index("row_speed_1_m_s")] += 1e-9


def another_event_text(recording: Recording) -> None:
    recording.events[0] = dataclasses.replace(recording.events[0], text="something else")


def one_quality_code(recording: Recording) -> None:
    stream = recording.measurements("gnss")
    stream.values[3, 0, stream.columns.index("quality")] = 5.0


def test_two_writings_are_equal_in_content_though_not_in_bytes(written: Written, tmp_path: Path) -> None:
    again = tmp_path / "again.rrd"
    write_rrd(written.recording, written.scene, written.result, again)
    assert again.read_bytes() != written.path.read_bytes()
    assert fingerprint(again) == fingerprint(written.path)


@pytest.mark.parametrize("change", [one_nanosecond_later, one_value_by_1e_9, another_event_text, one_quality_code])
def test_any_change_is_seen(tmp_path: Path, change: Change) -> None:
    assert written_with(tmp_path, change) != written_with(tmp_path, nothing)


def scalars_file(path: Path, values: list[float], *, pieces: int, names: tuple[str, ...] = ("time",)) -> Path:
    stream = rr.RecordingStream("test", send_properties=False)
    memory = stream.memory_recording()
    rows = list(enumerate(values))
    cut = -(-len(rows) // pieces)
    # the later piece first: the order of chunks must not count
    for start in reversed(range(0, len(rows), cut)):
        part = rows[start : start + cut]
        stamps = np.array([index for index, _ in part], dtype=np.int64).astype("timedelta64[ns]")
        times = [rr.TimeColumn(name, duration=stamps) for name in names]
        stream.send_columns("a/b", times, rr.Scalars.columns(scalars=[value for _, value in part]))
    path.write_bytes(memory.drain_as_bytes())
    return path


def test_how_rows_are_cut_into_chunks_does_not_count(tmp_path: Path) -> None:
    values = [1.0, 2.0, 3.0, 4.0, 5.0]
    whole = scalars_file(tmp_path / "whole.rrd", values, pieces=1)
    cut = scalars_file(tmp_path / "cut.rrd", values, pieces=3)
    assert fingerprint(whole) == fingerprint(cut)


def test_the_timeline_s_name_counts(tmp_path: Path) -> None:
    first = scalars_file(tmp_path / "first.rrd", [1.0], pieces=1)
    second = scalars_file(tmp_path / "second.rrd", [1.0], pieces=1, names=("t",))
    assert fingerprint(first) != fingerprint(second)


def test_a_file_that_is_no_recording_is_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(b"not a recording")
    with pytest.raises(BadInputError, match="cannot be read"):
        fingerprint(path)
    with pytest.raises(BadInputError, match="cannot be read"):
        fingerprint(tmp_path / "missing.rrd")
