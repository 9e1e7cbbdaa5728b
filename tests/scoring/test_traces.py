"""Baseline traces: they survive the file, and say when an estimator began to say something else."""

from pathlib import Path

import pytest

from twin.errors import BadInputError
from twin.scoring import traces
from twin.scoring.traces import Trace


def _trace(speed: float) -> Trace:
    return {("central", str(t_s)): ["1.0000", "2.0000", "", "0.1000", f"{speed:.4f}", "nan"] for t_s in range(1, 5)}


def test_a_trace_survives_the_file(tmp_path: Path) -> None:
    path = tmp_path / "baselines" / "a_trace.csv"
    traces.write(path, _trace(2.0))
    assert traces.read(path) == _trace(2.0)
    assert traces.read(tmp_path / "none.csv") == {}


def test_a_trace_says_when_something_moved() -> None:
    now = _trace(2.0)
    assert traces.drifted(_trace(2.0), now) == []
    now["central", "3"][4] = "2.0009"
    assert traces.drifted(_trace(2.0), now) == []
    now["central", "3"][4] = "2.0021"
    assert traces.drifted(_trace(2.0), now) == ["trace of central from 3 s on: speed_m_s 2.0000 -> 2.0021"]
    del now["central", "2"]
    assert traces.drifted(_trace(2.0), now) == ["trace of central has other seconds, from 2 s on"]


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "estimator,t_s\n"])
def test_a_broken_trace_is_bad_input(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a_trace.csv"
    path.write_text(text)
    with pytest.raises(BadInputError, match="trace"):
        traces.read(path)
