"""Runs the real command in a process of its own."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import tomli_w

from tests.small_scenario import small_scenario

ROOT = Path(__file__).resolve().parents[2]


def command_line(*arguments: str | Path) -> list[str]:
    """The argument vector of the command ``twin``."""
    return [sys.executable, "-m", "twin", *map(str, arguments)]


def environment() -> dict[str, str]:
    """An environment in which the package is found and the terminal is a plain one."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "TERM": "dumb", "NO_COLOR": "1", "COLUMNS": "200"}


def twin(*arguments: str | Path, cwd: Path, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    """Run ``twin`` with these arguments to its end."""
    return subprocess.run(
        command_line(*arguments),
        cwd=cwd,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


def hears_interrupts() -> None:
    """Let a new process hear Ctrl-C, which one that was started in the background has been told to ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted(
    *arguments: str | Path, cwd: Path, number: int, begins_with: str, timeout_s: float = 60.0
) -> tuple[int, str]:
    """Start ``twin`` and send it a signal a second after its first line; return exit code and standard error."""
    process = subprocess.Popen(
        command_line(*arguments),
        cwd=cwd,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hears_interrupts,  # noqa: PLW1509  (no threads here)
    )
    assert process.stdout is not None
    assert begins_with in process.stdout.readline()
    time.sleep(1.0)
    process.send_signal(number)
    _, errors = process.communicate(timeout=timeout_s)
    return process.returncode, errors


def write_scenario(folder: Path, name: str = "small", **changes: object) -> Path:
    """Write the small scenario with changes to ``folder/name.toml``."""
    path = folder / f"{name}.toml"
    path.write_text(tomli_w.dumps(small_scenario(**changes)))
    return path
