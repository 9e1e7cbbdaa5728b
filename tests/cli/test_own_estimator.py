"""What the command says of faults in an estimator that the user wrote."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.command import twin, write_scenario
from twin.cli import EXIT_INTERNAL
from twin.cli.running import RunOptions, run_scenarios
from twin.estimators.speed_only import SpeedOnly

MINE = """class Mine:
    columns = {columns}

    def __init__(self, setup):
        self.speed = 0.0

    def process(self, sample):
        {process}

    def estimate(self, t):
        return {estimate}
"""


def write_mine(
    folder: Path, *, columns: str = '("speed_m_s",)', process: str = "pass", estimate: str = '{"speed_m_s": self.speed}'
) -> None:
    """Write ``myf.py`` with the estimator ``Mine`` beside the scenarios."""
    (folder / "myf.py").write_text(MINE.format(columns=columns, process=process, estimate=estimate))


def test_its_exception_is_its_traceback_and_one_line(tmp_path: Path) -> None:
    write_mine(tmp_path, process='self.speed = {"y": 1.0}["x"]')
    path = write_scenario(tmp_path)
    result = twin("run", path, "--no-rrd", "--estimator", "myf:Mine", "--out", "out", cwd=tmp_path)
    assert result.returncode == 2
    *trace, line = result.stderr.splitlines()
    assert line == "error: estimator Mine (myf:Mine): process() raised KeyError: 'x' at myf.py:8"
    assert trace[0] == "Traceback (most recent call last):"
    assert [each for each in trace if "File" in each] == [f'  File "{tmp_path / "myf.py"}", line 8, in process']
    assert not list(tmp_path.glob("out/*/*"))


def test_an_exception_of_a_built_in_estimator_is_an_error_of_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(SpeedOnly, "process", fail)
    options = RunOptions(
        seed=None,
        run=0,
        settings=(),
        out=tmp_path / "out",
        rrd=False,
        junit=None,
        nmea=None,
        estimators=(),
        update_baselines=False,
        full_rate=False,
        as_json=False,
    )
    assert run_scenarios([str(write_scenario(tmp_path))], options) == EXIT_INTERNAL
    assert "ZeroDivisionError" in capsys.readouterr().err
