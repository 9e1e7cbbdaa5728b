"""Commands from end to end, through the real command: what they write, say and exit with."""

import csv
import json
import math
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.cli.command import ROOT, command_line, environment, twin, write_scenario
from tests.small_scenario import SMALL
from twin.cli.tables import figure
from twin.stress import Parts, Task, make_plan, run_task

SPEED_ERROR = "central.row_speed.mean_abs_error_m_s"
HOLDS = {"metric": SPEED_ERROR, "max": 10.0}
FAILS = {"metric": SPEED_ERROR, "max": 1e-9}


def _result(folder: Path) -> dict[str, Any]:
    result: dict[str, Any] = json.loads((folder / "result.json").read_text())
    return result


def _run_folder(below: Path) -> Path:
    return below / "runs" / "small" / "seed1_run0"


# --- a run that cannot go on -----------------------------------------------------------------------------------------


def _write_bank(path: Path) -> None:
    """Level ground that, from 10 to 25 m east on, turns into a side slope of 200 %."""
    east, north = np.meshgrid(np.arange(-30.0, 70.5, 0.5), np.arange(-25.0, 25.5, 0.5))
    np.save(path, north * np.clip((east - 10.0) / 15.0, 0.0, 1.0) * 2.0)


def test_a_machine_that_tips_over_ends_the_run_as_an_error(tmp_path: Path) -> None:
    # A rigid tractor goes over where the slope exceeds half its track over the height of its centre of mass, 92 %:
    # that is 17 m east; a soil with a friction of 2 holds it up to 200 %, so it does not slide away instead.
    _write_bank(tmp_path / "bank.npy")
    path = write_scenario(
        tmp_path,
        duration_s=40.0,
        terrain={"kind": "file", "path": "bank.npy", "cell_m": 0.5, "centre_m": [20.0, 0.0]},
        soil={"friction": 2.0, "lateral_stiffness": 20.0},
        driver={"path": [{"straight_m": 40.0}]},
        checks=[HOLDS],
    )
    ran = twin("run", path, "--no-rrd", "--junit", "report.xml", cwd=tmp_path)
    assert ran.returncode == 1, ran.stdout + ran.stderr
    assert "verdict: error (the machine tipped over at " in ran.stdout
    # What is not a number is printed as a dash.
    assert "nan" not in re.findall(r"[a-z]+", ran.stdout.lower())
    result = _result(_run_folder(tmp_path))
    assert result["verdict"] == "error"
    assert result["ended"]["reason"] == "the machine tipped over"
    # 2 m/s are reached in 4 s and 4 m; the slope begins 10 m east and its full 200 % are at 25 m, 7 and 14.5 s after
    # the start; the front axle is up to 3 m ahead.
    assert 5.0 < result["ended"]["t_s"] < 16.0
    suite = ET.parse(tmp_path / "report.xml").getroot()[0]
    assert suite.get("errors") == "1"
    assert "tipped over" in suite.findall("testcase/error")[0].get("message", "")


# --- reports ---------------------------------------------------------------------------------------------------------


def test_a_junit_report_has_a_suite_per_scenario_and_a_case_per_check(tmp_path: Path) -> None:
    good = write_scenario(tmp_path, "good", checks=[HOLDS])
    bad = write_scenario(tmp_path, "bad", checks=[HOLDS, FAILS])
    ran = twin("run", good, bad, "--no-rrd", "--junit", "report.xml", cwd=tmp_path)
    assert ran.returncode == 1
    suites = {suite.get("name"): suite for suite in ET.parse(tmp_path / "report.xml").getroot()}
    # Each has one case more than checks: that it ran to its end.
    counts = {
        name: tuple(int(suite.get(key, "-1")) for key in ("tests", "failures", "errors"))
        for name, suite in suites.items()
    }
    assert counts == {"good": (2, 0, 0), "bad": (3, 1, 0)}
    for name, suite in suites.items():
        cases = suite.findall("testcase")
        assert [case.get("classname") for case in cases] == [name] * counts[name][0]
        assert [case.get("name") for case in cases[:-1]] == [SPEED_ERROR] * (counts[name][0] - 1)
    failed = [case.find("failure") is not None for case in suites["bad"].findall("testcase")]
    assert failed == [False, True, False]
    assert SPEED_ERROR in suites["bad"].findall("testcase/failure")[0].get("message", "")


def test_a_baseline_is_written_compared_and_rewritten_line_by_line(tmp_path: Path) -> None:
    path = write_scenario(tmp_path)
    committed = tmp_path / "baselines" / "small.csv"

    def run(*options: str) -> subprocess.CompletedProcess[str]:
        return twin("run", path, "--no-rrd", "--junit", "report.xml", *options, cwd=tmp_path)

    def compared() -> bool:
        cases = ET.parse(tmp_path / "report.xml").getroot().iter("testcase")
        return "baseline" in [case.get("name") for case in cases]

    assert run().returncode == 0
    assert not compared()
    assert run("--update-baselines").returncode == 0
    with committed.open(newline="") as file:
        values = {row["metric"]: float(row["value"]) for row in csv.DictReader(file)}
    metrics = _result(_run_folder(tmp_path))["metrics"]
    assert values.keys() == metrics.keys()
    # The file holds nine digits.
    assert values[SPEED_ERROR] == pytest.approx(metrics[SPEED_ERROR], rel=1e-8)

    untouched = committed.read_text()
    assert run().returncode == 0
    assert compared()
    assert committed.read_text() == untouched

    lines = untouched.splitlines()
    at = next(index for index, line in enumerate(lines) if line.startswith(SPEED_ERROR + ","))
    # One line off by 1 %, ten times its tolerance; another within its tolerance, which an update must leave alone.
    near = next(
        index for index, line in enumerate(lines) if line.startswith("radar_only.row_speed.mean_abs_error_m_s,")
    )
    lines[at] = f"{SPEED_ERROR},{1.01 * metrics[SPEED_ERROR]:.9g},0.001"
    lines[near] = f"{lines[near].split(',')[0]},{(1.0 + 1e-4) * float(lines[near].split(',')[1]):.9g},0.001"
    tampered = "\n".join(lines) + "\n"
    committed.write_text(tampered)
    drifted = run()
    assert drifted.returncode == 1
    assert f"baseline: {SPEED_ERROR}: " in drifted.stdout
    assert "radar_only.row_speed.mean_abs_error_m_s: " not in drifted.stdout
    assert committed.read_text() == tampered

    assert run("--update-baselines").returncode == 0
    after = committed.read_text().splitlines()
    assert [index for index, line in enumerate(after) if line != lines[index]] == [at]
    assert after[at] == untouched.splitlines()[at]


# --- what there is ---------------------------------------------------------------------------------------------------


def test_list_names_scenarios_presets_and_kinds(tmp_path: Path) -> None:
    told = twin("list", cwd=tmp_path)
    assert told.returncode == 0
    words = told.stdout.split()
    scenarios = {path.stem for path in (ROOT / "scenarios" / "planter").glob("[!_]*.toml")}
    presets = {path.stem for path in (ROOT / "assets" / "sensors").glob("*.toml")}
    assert scenarios | presets <= set(words)
    assert {"row_speed_ekf", "planter_f8", "prototype_car"} <= {word.strip(",") for word in words}
    assert "_planter_f8" not in words


def test_the_schema_is_json_schema_and_knows_the_keys_of_a_scenario(tmp_path: Path) -> None:
    told = twin("schema", cwd=tmp_path)
    assert told.returncode == 0
    schema = json.loads(told.stdout)
    assert {"type", "properties"} <= schema.keys()
    assert schema["type"] == "object"
    assert set(SMALL) <= schema["properties"].keys()
    # Every reference leads somewhere.
    pending, references = [schema], set()
    while pending:
        node = pending.pop()
        if isinstance(node, dict):
            references |= {node["$ref"]} if isinstance(node.get("$ref"), str) else set()
            pending += node.values()
        elif isinstance(node, list):
            pending += node
    assert references
    for reference in references:
        node = schema
        for part in reference.removeprefix("#/").split("/"):
            node = node[part]


# --- one's own estimator ---------------------------------------------------------------------------------------------

MODULE = '''
class Smooth:
    """The radar's speed, smoothed."""

    columns = ("speed_m_s",)

    def __init__(self, setup):
        self.speed_m_s = 0.0

    def process(self, sample):
        if sample.sensor == "radar":
            self.speed_m_s += 0.1 * (sample["speed_m_s"] - self.speed_m_s)

    def estimate(self, t):
        return {"speed_m_s": (self.speed_m_s, 0.1)}
'''
SCRIPT = Path(sys.executable).parent / "twin"


@pytest.mark.parametrize("installed", [False, True], ids=["python -m twin", "twin"])
def test_an_estimator_from_the_current_folder_runs_scores_and_replays(installed: bool, tmp_path: Path) -> None:
    if installed and not SCRIPT.exists():
        pytest.skip("the console script is not installed here")
    (tmp_path / "my_filters.py").write_text(MODULE)
    path = write_scenario(tmp_path)

    def call(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        line = command_line(*arguments)
        line = [str(SCRIPT), *line[3:]] if installed else line
        return subprocess.run(
            line, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=120, check=False
        )

    ran = call("run", path, "--no-rrd", "--estimator", "my_filters:Smooth")
    assert ran.returncode == 0, ran.stdout + ran.stderr
    folder = _run_folder(tmp_path)
    found = _result(folder)["metrics"]["Smooth.speed.max_abs_error_m_s"]
    # From rest to 2 m/s it lags, but speed and estimate both stay between 0 and about 2 m/s.
    assert 0.0 < found < 2.5

    without = call("replay", folder)
    assert without.returncode == 0, without.stdout + without.stderr
    assert "Smooth is not in the scenario and was not replayed" in without.stdout
    replayed = call("replay", folder, "--estimator", "my_filters:Smooth")
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    assert "replay equals the run bit for bit" in replayed.stdout
    assert "not replayed" not in replayed.stdout

    # Another filter under the same name is caught.
    (tmp_path / "my_filters.py").write_text(MODULE.replace("0.1 * (", "0.2 * ("))
    changed = call("replay", folder, "--estimator", "my_filters:Smooth")
    assert changed.returncode == 1
    assert "replay differs from the run: Smooth by up to" in changed.stdout


# --- stress tests that were interrupted ------------------------------------------------------------------------------


def _stress_folder(below: Path) -> Path:
    return below / "small" / "stress_seed1_worlds2_runs2"


def _apart_from_time(folder: Path) -> dict[str, Any]:
    result = _result(folder)
    result.pop("timing")
    return result


def test_a_resumed_stress_test_ends_as_if_it_had_not_been_interrupted(tmp_path: Path) -> None:
    path = write_scenario(tmp_path)
    options = ("stress", path, "--worlds", "2", "--runs", "2", "--out")
    assert twin(*options, tmp_path / "whole", cwd=tmp_path).returncode == 0

    plan = make_plan(path, runs=2, worlds=2, settings=[], vary=[], seed=None)
    parts = Parts(tmp_path / "resumed" / "small", plan, plan.load(0, 0))
    parts.write(Task(0, 0, 0), run_task(plan, 0, 0))
    resumed = twin(*options, tmp_path / "resumed", "--resume", cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    assert "world 1 of 2" not in resumed.stdout
    assert "world 2 of 2" in resumed.stdout

    one, other = (_stress_folder(tmp_path / name) for name in ("whole", "resumed"))
    assert _apart_from_time(one) == _apart_from_time(other)
    for name in ("members.parquet", "envelopes.parquet"):
        assert (one / name).read_bytes() == (other / name).read_bytes()
    assert [entry.name for entry in other.parent.iterdir()] == [other.name]

    # There is nothing left to resume: everything is run again, to the same end.
    again = twin(*options, tmp_path / "resumed", "--resume", cwd=tmp_path)
    assert again.returncode == 0
    assert "world 1 of 2" in again.stdout
    assert _apart_from_time(one) == _apart_from_time(other)


def test_a_terminated_stress_test_leaves_hidden_parts_only(tmp_path: Path) -> None:
    path = write_scenario(tmp_path, duration_s=10.0)
    process = subprocess.Popen(
        command_line("stress", path, "--worlds", "200", "--runs", "1"),
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    parts = tmp_path / "runs" / "small"
    deadline = time.monotonic() + 60.0
    while not list(parts.glob(".stress-*/point*world0_block0.npz")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    (left,) = parts.iterdir()
    assert left.name.startswith(".stress-")
    assert [entry.name for entry in parts.parent.iterdir()] == ["small"]
    names = {entry.name for entry in left.iterdir()}
    assert "point0_world0_block0.npz" in names
    assert all(name.endswith(".npz") and ".partial" not in name for name in names), names


# --- titles and folders that come from elsewhere ---------------------------------------------------------------------


def test_markup_in_a_title_is_text(tmp_path: Path) -> None:
    path = write_scenario(tmp_path, title="Turn [/b] [red]right[/red]", notes="See [/i] [1].")
    ran = twin("run", path, "--no-rrd", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert "Turn [/b] [red]right[/red]" in ran.stdout
    assert "See [/i] [1]." in ran.stdout
    stressed = twin("stress", path, "--runs", "1", cwd=tmp_path)
    assert stressed.returncode == 0, stressed.stderr
    assert "Turn [/b] [red]right[/red]" in stressed.stdout


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder, to be copied and spoilt."""
    where = tmp_path_factory.mktemp("made")
    assert twin("run", write_scenario(where), "--no-rrd", cwd=where).returncode == 0
    return _run_folder(where)


def _spoil_time(folder: Path, t_s: Any) -> None:
    result = _result(folder)
    result["ended"]["t_s"] = t_s
    (folder / "result.json").write_text(json.dumps(result))


def _spoil_column(folder: Path) -> None:
    path = folder / "measurements" / "radar.parquet"
    table = pq.read_table(path)
    at = table.schema.get_field_index("speed_m_s")
    pq.write_table(table.set_column(at, "speed_m_s", pa.array(["fast"] * table.num_rows)), path)


SPOILT = {
    "a run of 30 000 years": (lambda folder: _spoil_time(folder, 1e12), "ended.t_s"),
    "a run of no length": (lambda folder: _spoil_time(folder, math.nan), "ended.t_s"),
    "no measurements of a sensor": (lambda folder: (folder / "measurements" / "radar.parquet").unlink(), "radar"),
    "text for numbers": (_spoil_column, "radar.parquet"),
    "no truth": (lambda folder: (folder / "truth.parquet").unlink(), "truth.parquet"),
    "half a file": (lambda folder: (folder / "truth.parquet").write_bytes(b"PAR1\x00\x00"), "truth.parquet"),
}


@pytest.mark.parametrize("case", SPOILT)
def test_a_spoilt_run_folder_is_refused(case: str, made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "spoilt"
    for file in made.rglob("*"):
        if file.is_file():
            target = folder / file.relative_to(made)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(file.read_bytes())
    spoil, message = SPOILT[case]
    spoil(folder)
    result = twin("replay", folder, cwd=tmp_path, timeout_s=30.0)
    assert result.returncode == 2, result.stdout + result.stderr
    assert message in result.stderr
    assert "Traceback" not in result.stderr + result.stdout


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.012345, "0.0123"),
        (11.68, "11.7"),
        (999.4, "999"),
        (999.7, "1000"),
        (1648.6, "1649"),
        (-12_345.6, "-12346"),
        (2.5e6, "2.5e+06"),
        (float("inf"), "never"),
        (float("nan"), "-"),
        (None, ""),
    ],
)
def test_figures_are_read_without_a_power_of_ten_where_people_have_none(value: float | None, shown: str) -> None:
    assert figure(value) == shown
