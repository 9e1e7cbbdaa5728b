"""What the command says of faults in an estimator that the user wrote."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.command import twin, write_scenario
from tests.cli.test_replay_log import write_nmea
from twin.cli import EXIT_INTERNAL
from twin.cli.own_columns import note_misspelt
from twin.cli.running import RunOptions, run_scenarios
from twin.estimators.speed_only import SpeedOnly
from twin.signals import sigma_column

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


def test_a_misspelt_column_is_noted(tmp_path: Path) -> None:
    write_mine(tmp_path, columns='("sped_m_s", "speed_bias_m_s")', estimate='{"sped_m_s": 1.0, "speed_bias_m_s": 0.0}')
    path = write_scenario(tmp_path, duration_s=1.0)
    result = twin("run", path, "--no-rrd", "--json", "--estimator", "myf:Mine", "--out", "out", cwd=tmp_path)
    note = "note: estimator Mine: column 'sped_m_s' is not one that is scored; did you mean 'speed_m_s'?\n"
    assert (result.returncode, result.stderr) == (0, note)
    (folder,) = tmp_path.glob("out/small/*")
    again = twin("replay", folder, "--estimator", "myf:Mine", cwd=tmp_path)
    assert (again.returncode, again.stderr) == (0, note)


def test_a_misspelt_column_over_a_log_is_noted(tmp_path: Path) -> None:
    write_mine(tmp_path, columns='("positon_e_m", "position_n_m")', estimate="dict.fromkeys(self.columns, 0.0)")
    write_nmea(tmp_path / "drive.nmea", 50)
    result = twin("replay", "drive.nmea", "--no-rrd", "--estimator", "myf:Mine", cwd=tmp_path)
    note = "note: estimator Mine: column 'positon_e_m' is not one that is scored; did you mean 'position_e_m'?\n"
    assert (result.returncode, result.stderr) == (0, note)


def test_columns_of_the_users_own_are_no_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    scored = ("speed_m_s", "heading_rad")

    def noted(*columns: str) -> str:
        note_misspelt({"mine": (*columns, *map(sigma_column, columns))}, scored)
        return capsys.readouterr().err

    assert noted("speed_m_s", "speed_bias_m_s", "height_bias_m", "gyro_bias_rad_s") == ""
    assert noted("heading_rad", "heading_2_rad") == ""  # what it is near to is there too
    assert "'hieght_m' is not one that is scored; did you mean 'height_m'?" in noted("speed_m_s", "hieght_m")
    assert noted("bias") == "note: estimator mine: none of its columns is one that is scored (bias)\n"
