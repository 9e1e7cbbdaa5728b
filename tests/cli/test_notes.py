"""Notes before a run, through the real command: on standard error, without another exit code."""

import json
from pathlib import Path

import pytest

from tests.cli.command import twin, write_scenario

FAULT = {"kind": "outage", "from_s": 3.0}


@pytest.mark.parametrize("command", [["run", "--no-rrd"], ["stress", "--runs", "1"]], ids=lambda value: value[0])
def test_a_fault_after_the_end_is_told(command: list[str], tmp_path: Path) -> None:
    path = write_scenario(tmp_path, sensors={"gnss": {"faults": [FAULT]}})
    told = twin(*command, path, "--set", "duration_s=3.0", "--json", cwd=tmp_path)
    assert told.returncode == 0
    assert told.stderr == (
        f"note: {path}: sensors.gnss.faults.0.from_s = 3: has no effect, the run ends at duration_s = 3\n"
    )
    assert len(json.loads(told.stdout)) == 1


def test_a_fault_that_begins_in_time_is_not_told(tmp_path: Path) -> None:
    path = write_scenario(tmp_path, sensors={"gnss": {"faults": [FAULT]}})
    told = twin("run", path, "--no-rrd", cwd=tmp_path)
    assert (told.returncode, told.stderr) == (0, "")
