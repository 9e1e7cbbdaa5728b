"""Ctrl-C and SIGTERM in mid-run: exit code 130, nothing half-written, nothing of before destroyed."""

import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.cli.command import command_line, environment, twin, write_scenario


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_leaves_the_earlier_one_as_it_was(number: signal.Signals, tmp_path: Path) -> None:
    path = write_scenario(tmp_path)
    assert twin("run", path, "--no-rrd", cwd=tmp_path).returncode == 0
    folder = tmp_path / "runs" / "small" / "seed1_run0"
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}

    process = subprocess.Popen(
        command_line("run", path, "--set", "duration_s=3000.0"),
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert "A short straight" in process.stdout.readline()
    time.sleep(1.0)
    process.send_signal(number)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before
    assert [entry.name for entry in folder.parent.iterdir()] == ["seed1_run0"]
