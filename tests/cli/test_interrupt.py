"""Ctrl-C and SIGTERM in mid-run: exit code 130, nothing half-written, nothing of before destroyed."""

import signal
from pathlib import Path

import pytest

from tests.cli.command import interrupted, twin, write_scenario


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_leaves_the_earlier_one_as_it_was(number: signal.Signals, tmp_path: Path) -> None:
    path = write_scenario(tmp_path)
    assert twin("run", path, "--no-rrd", cwd=tmp_path).returncode == 0
    folder = tmp_path / "runs" / "small" / "seed1_run0"
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}

    code, errors = interrupted(
        "run",
        path,
        "--set",
        "duration_s=3000.0",
        cwd=tmp_path,
        number=number,
        begins_with="A short straight",
        timeout_s=30.0,
    )
    assert code == 130
    assert "Traceback" not in errors
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before
    assert [entry.name for entry in folder.parent.iterdir()] == ["seed1_run0"]
