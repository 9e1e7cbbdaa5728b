"""``twin compare`` through the real command."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from tests.cli.command import twin, write_scenario

SPEED_ERROR = "central.row_speed.mean_abs_error_m_s"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with runs 0 and 1 of the small scenario and two stress tests of it."""
    folder = tmp_path_factory.mktemp("compared")
    path = write_scenario(folder, repetitions=2)
    assert twin("run", path, "--no-rrd", cwd=folder).returncode == 0
    for runs in ("2", "3"):
        assert twin("stress", path, "--runs", runs, cwd=folder).returncode == 0
    return folder / "runs" / "small"


def _compare(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    ran = twin("compare", *arguments, cwd=cwd)
    assert "Traceback" not in ran.stdout + ran.stderr
    return ran


def _differences(one: Path, other: Path, *options: str) -> tuple[int, dict[str, Any]]:
    ran = _compare(one, other, "--json", *options, cwd=one.parent)
    told: dict[str, Any] = json.loads(ran.stdout)
    return ran.returncode, told


def _edit_estimates(folder: Path, column: str, factor: float) -> None:
    path = folder / "estimates" / "central.parquet"
    table = pq.read_table(path)
    at = table.column_names.index(column)
    pq.write_table(table.set_column(at, column, pc.multiply(table[column], pa.scalar(factor))), path)


def _edit_result(folder: Path, **changes: Any) -> None:
    path = folder / "result.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


@pytest.fixture
def copy(runs: Path, tmp_path: Path) -> Path:
    """A copy of run 0 that a test may change."""
    return Path(shutil.copytree(runs / "seed1_run0", tmp_path / "copy"))


def test_a_run_is_the_same_as_its_copy(runs: Path, copy: Path) -> None:
    ran = _compare(runs / "seed1_run0", copy, cwd=runs)
    assert ran.returncode == 0, ran.stdout
    assert "the same within 0.001 of each value" in ran.stdout
    code, told = _differences(runs / "seed1_run0", copy, "--tolerance", "0")
    assert code == 0
    assert told == {"same": True, "tolerance": 0.0, "notes": [], "differences": []}


def test_a_moved_column_is_named_with_its_largest_difference(runs: Path, copy: Path) -> None:
    _edit_estimates(copy, "speed_m_s", 1.01)
    code, told = _differences(runs / "seed1_run0", copy)
    assert code == 1
    (found,) = told["differences"]
    assert (found["kind"], found["name"]) == ("stream", "estimates/central")
    assert found["where"].startswith("speed_m_s at ")
    speed = pq.read_table(runs / "seed1_run0" / "estimates" / "central.parquet")["speed_m_s"]
    assert found["largest"] == pytest.approx(0.01 * pc.max(pc.abs(speed)).as_py(), rel=1e-6)
    # 1 % is within 2 %.
    assert _differences(runs / "seed1_run0", copy, "--tolerance", "0.02")[0] == 0
    ran = _compare(runs / "seed1_run0", copy, cwd=runs)
    assert ran.returncode == 1
    assert "estimates/central" in ran.stdout
    assert "1 differences beyond" in ran.stdout


def test_metrics_verdict_and_end_are_compared(runs: Path, copy: Path) -> None:
    metrics = json.loads((copy / "result.json").read_text())["metrics"]
    ended = {"reason": "the machine tipped over", "t_s": 4.0}
    _edit_result(copy, metrics={**metrics, SPEED_ERROR: metrics[SPEED_ERROR] * 1.01}, verdict="error", ended=ended)
    code, told = _differences(runs / "seed1_run0", copy)
    assert code == 1
    found = {(each["kind"], each["name"]): (each["first"], each["second"]) for each in told["differences"]}
    assert found["run", "verdict"] == ("pass", "error")
    assert found["run", "ended"] == ("duration", "the machine tipped over")
    assert found.keys() == {("run", "verdict"), ("run", "ended"), ("metric", SPEED_ERROR)}


def test_a_missing_stream_is_a_difference(runs: Path, copy: Path) -> None:
    (copy / "measurements" / "radar.parquet").unlink()
    code, told = _differences(runs / "seed1_run0", copy)
    assert code == 1
    (found,) = told["differences"]
    assert (found["name"], found["first"], found["second"]) == ("measurements/radar", "there", "missing")


def test_another_run_is_said_and_the_truth_is_shared(runs: Path) -> None:
    code, told = _differences(runs / "seed1_run0", runs / "seed1_run1")
    assert code == 1
    assert told["notes"] == ["another run: 0 and 1"]
    streams = {each["name"] for each in told["differences"] if each["kind"] == "stream"}
    assert {"measurements/radar", "estimates/central"} <= streams
    assert "truth" not in streams
    assert not [each for each in told["differences"] if each["kind"] == "events"]


def _edit_scenario(folder: Path, was: str, becomes: str) -> None:
    path = folder / "scenario.toml"
    text = path.read_text()
    assert was in text
    path.write_text(text.replace(was, becomes))


def test_another_scenario_of_the_same_name_is_said_whatever_the_seeds(runs: Path, copy: Path) -> None:
    another = "the scenario of that name is another one (scenario.toml differs)"
    _edit_result(copy, scenario_sha256="0", seed=2)
    _edit_scenario(copy, "seed = 1\n", "seed = 2\n")
    code, told = _differences(runs / "seed1_run0", copy)
    assert code == 0
    assert told["notes"] == ["another seed: 1 and 2"]
    _edit_scenario(copy, "A short straight", "A longer straight")
    assert _differences(runs / "seed1_run0", copy)[1]["notes"] == ["another seed: 1 and 2", another]
    _edit_result(copy, scenario_sha256="0", seed=1)
    assert _differences(runs / "seed1_run0", copy)[1]["notes"] == [another]


def test_help_says_what_can_be_compared(tmp_path: Path) -> None:
    told = " ".join(twin("compare", "--help", cwd=tmp_path).stdout.split())
    assert "or that of a replayed log" in told


def test_stress_tests_are_compared_by_their_quantiles(runs: Path) -> None:
    two, three = (runs / f"stress_seed1_worlds1_runs{count}" for count in (2, 3))
    assert _differences(two, two)[0] == 0
    code, told = _differences(two, three)
    assert code == 1
    assert "another runs: 2 and 3" in told["notes"]
    assert f"{SPEED_ERROR} p95" in {each["name"] for each in told["differences"]}


@pytest.mark.parametrize(
    ("first", "second", "options", "message"),
    [
        ("seed1_run0", ".", [], "not a run folder"),
        ("nowhere", "seed1_run0", [], "not a run folder"),
        ("seed1_run0", "stress_seed1_worlds1_runs2", [], "is a run, stress_seed1_worlds1_runs2 a stress"),
        ("seed1_run0", "seed1_run0", ["--tolerance", "-1"], "--tolerance -1"),
        ("seed1_run0", "seed1_run0", ["--tolerance", "nan"], "--tolerance nan"),
    ],
)
def test_what_cannot_be_compared_is_refused(
    first: str, second: str, options: list[str], message: str, runs: Path
) -> None:
    ran = _compare(first, second, *options, cwd=runs)
    assert ran.returncode == 2, ran.stdout
    assert message in ran.stderr


@pytest.mark.parametrize("command", ["score", "replay"])
def test_the_folder_of_a_stress_test_is_no_run(command: str, runs: Path) -> None:
    told = twin(command, "stress_seed1_worlds1_runs2", cwd=runs)
    assert told.returncode == 2
    assert "stress_seed1_worlds1_runs2: the folder of a stress test, and no run; compare it with" in told.stderr
    assert told.stderr.count("\n") == 1


@pytest.mark.parametrize("metrics", [3, {"a": "much"}, [1.0]])
def test_a_result_without_numbers_is_refused(metrics: object, runs: Path, copy: Path) -> None:
    _edit_result(copy, metrics=metrics)
    ran = _compare(runs / "seed1_run0", copy, cwd=runs)
    assert ran.returncode == 2
    assert "result.json" in ran.stderr
