"""Ctrl-C and SIGTERM in mid-run: exit code 130, nothing half-written, nothing of before destroyed."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from tests.cli.command import environment, hears_interrupts, interrupted, twin, write_scenario


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
    assert errors == "interrupted\n"
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before
    assert [entry.name for entry in folder.parent.iterdir()] == ["seed1_run0"]


def _ends(code: str, cwd: Path) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=cwd,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
        timeout=30.0,
        preexec_fn=hears_interrupts,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_waits_for_the_end_of_an_import(number: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "plugin.py").write_text(f"import signal\nsignal.raise_signal({int(number)})\nprint('imported')\n")
    wait = "import sys, time\nsys.path.insert(0, '.')\nimport plugin\ntime.sleep(60.0)\n"
    code = "import twin.cli.app, twin.cli\ndef app(**_):\n" + textwrap.indent(wait, " ")
    ended = _ends(code + "twin.cli.app.app = app\ntwin.cli.main()\n", tmp_path)
    assert ended == (130, "imported\n", "interrupted\n")


def test_an_interrupt_that_c_code_made_another_exception_of_is_still_one(tmp_path: Path) -> None:
    code = (
        "import signal, twin.cli.app, twin.cli\n"
        "def app(**_):\n"
        " try: signal.raise_signal(signal.SIGINT)\n"
        " except KeyboardInterrupt: raise SystemError('returned a result with an exception set')\n"
        "twin.cli.app.app = app\ntwin.cli.main()\n"
    )
    assert _ends(code, tmp_path) == (130, "", "interrupted\n")
