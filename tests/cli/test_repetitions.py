"""Repetitions of a scenario and the table after several, through the real command."""

import csv
import io
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from tests.cli.command import twin, write_scenario
from tests.small_scenario import small_scenario
from twin.cli.running import Crash
from twin.cli.tables import counts, summary_table
from twin.scenario import resolve
from twin.scoring import Repetitions, Verdict
from twin.scoring.checks import judge

SPEED_ERROR = "central.row_speed.mean_abs_error_m_s"
FAULTY = {"faults": [{"kind": "outage", "from_s": 2.0, "to_s": 3.0}]}


def _files(folder: Path) -> dict[str, bytes]:
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file() and file.name not in {"result.json", "run.rrd", "scenario.toml"}
    }


@pytest.fixture(scope="module")
def repeated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Three repetitions of the small scenario from run 1 on, and what was said."""
    folder = tmp_path_factory.mktemp("repeated")
    path = write_scenario(folder, repetitions=3, sensors={"radar": FAULTY}, published={SPEED_ERROR: 0.1})
    ran = twin("run", path, "--run", "1", cwd=folder)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return folder, ran.stdout


def test_each_repetition_is_the_ordinary_run_of_its_index(repeated: tuple[Path, str]) -> None:
    folder, _ = repeated
    runs = folder / "runs" / "small"
    assert sorted(entry.name for entry in runs.iterdir()) == ["seed1_run1", "seed1_run2", "seed1_run3"]
    path = folder / "small.toml"
    alone = twin("run", path, "--run", "3", "--set", "repetitions=1", "--no-rrd", "--out", folder / "alone", cwd=folder)
    assert alone.returncode == 0, alone.stderr
    ordinary = _files(folder / "alone" / "small" / "seed1_run3")
    assert {"truth.parquet", "events.parquet", "estimates/central.parquet"} <= ordinary.keys()
    assert _files(runs / "seed1_run3") == ordinary
    # Another run has another noise, in the same world.
    other = _files(runs / "seed1_run2")
    assert other["truth.parquet"] == ordinary["truth.parquet"]
    assert other["estimates/central.parquet"] != ordinary["estimates/central.parquet"]
    results = [json.loads((runs / f"seed1_run{run}" / "result.json").read_text()) for run in (1, 2, 3)]
    assert [result["run"] for result in results] == [1, 2, 3]
    one = json.loads((folder / "alone" / "small" / "seed1_run3" / "result.json").read_text())
    assert results[2]["metrics"] == one["metrics"]


def test_a_repetition_replays_bit_for_bit_and_only_the_first_is_for_the_viewer(repeated: tuple[Path, str]) -> None:
    folder, _ = repeated
    runs = folder / "runs" / "small"
    replayed = twin("replay", runs / "seed1_run2", cwd=folder)
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    assert "replay equals the run bit for bit" in replayed.stdout
    assert [(runs / f"seed1_run{run}" / "run.rrd").is_file() for run in (1, 2, 3)] == [True, False, False]


def test_the_table_shows_mean_and_range(repeated: tuple[Path, str]) -> None:
    folder, said = repeated
    values = [
        json.loads((folder / "runs" / "small" / f"seed1_run{run}" / "result.json").read_text())["metrics"][SPEED_ERROR]
        for run in (1, 2, 3)
    ]
    assert len(set(values)) == 3
    (line,) = (line for line in said.splitlines() if "row_speed.mean_abs_error_m_s" in line and "central" in line)
    cells = [cell.strip() for cell in line.strip("│ ").split("│")]
    assert cells[2:] == [f"{np.mean(values):.3g}", f"{min(values):.3g} .. {max(values):.3g}", "0.1"]
    assert "3 runs of 4 s simulated" in said


def test_a_check_that_one_repetition_breaks_fails_and_baselines_are_of_the_first(tmp_path: Path) -> None:
    # The white noise of the radar differs from run to run, so there is a limit between the best and the worst.
    path = write_scenario(tmp_path, repetitions=3)
    told = twin("run", path, "--no-rrd", "--json", "--update-baselines", cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    results = json.loads(told.stdout)
    assert [result["run"] for result in results] == [0, 1, 2]
    values = [result["metrics"][SPEED_ERROR] for result in results]
    with (tmp_path / "baselines" / "small.csv").open(newline="") as file:
        committed = {row["metric"]: float(row["value"]) for row in csv.DictReader(file)}
    assert committed[SPEED_ERROR] == pytest.approx(values[0], rel=1e-8)
    assert [result["baseline"]["compared"] for result in results] == [True, False, False]

    limit = sorted(values)[1]
    path = write_scenario(tmp_path, repetitions=3, checks=[{"metric": SPEED_ERROR, "max": limit}])
    failed = twin("run", path, "--no-rrd", "--junit", "report.xml", cwd=tmp_path)
    assert failed.returncode == 1, failed.stdout
    worst = values.index(max(values))
    assert f"in each of 3 runs; fails in run {worst}" in failed.stdout
    (suite,) = ET.parse(tmp_path / "report.xml").getroot()
    # One check, the baseline (of the first run) and that it ran to its end.
    assert (suite.get("tests"), suite.get("failures")) == ("3", "1")


@pytest.mark.parametrize("wrong", [0, 21, 2.0])
def test_only_one_to_twenty_repetitions(wrong: float, tmp_path: Path) -> None:
    ran = twin("run", write_scenario(tmp_path, repetitions=wrong), cwd=tmp_path)
    assert ran.returncode == 2
    assert f"repetitions: given {wrong}" in ran.stderr


# --- the table after several scenarios -------------------------------------------------------------------------------


def test_several_scenarios_end_with_one_table(tmp_path: Path) -> None:
    folder = tmp_path / "family"
    folder.mkdir()
    published = {SPEED_ERROR: 0.1, "radar_only.row_speed.mean_abs_error_m_s": 0.2}
    write_scenario(folder, "with_published", published=published)
    write_scenario(folder, "without", checks=[{"metric": "central.position.rmse_m", "max": 1e-9}])
    ran = twin("run", folder, "--no-rrd", cwd=tmp_path)
    assert ran.returncode == 1, ran.stderr
    table = [line.split() for line in ran.stdout.partition("All scenarios")[2].splitlines() if line.strip()]
    result = json.loads((tmp_path / "runs" / "with_published" / "seed1_run0" / "result.json").read_text())
    ours = result["metrics"]
    by_first = {line[0]: line for line in table}
    first, second = SPEED_ERROR, "radar_only.row_speed.mean_abs_error_m_s"
    assert by_first["with_published"] == [
        "with_published", *first.split(".", 1), f"{ours[first]:.3g}", "0.1", f"{ours[first] / 0.1:.3g}", "pass"
    ]  # fmt: skip
    assert by_first["radar_only"] == [*second.split(".", 1), f"{ours[second]:.3g}", "0.2", f"{ours[second] / 0.2:.3g}"]
    assert by_first["without"][:3] == ["without", "radar_only", "row_speed.mean_abs_error_m_s"]
    assert by_first["without"][-1] == "fail"
    assert ran.stdout.rstrip().endswith("2 scenarios: 1 pass 1 fail; 0 of 1 checks hold")


def _verdict(name: str, metrics: dict[str, float], **changes: object) -> Repetitions:
    scenario = resolve(small_scenario(**changes), where="test")
    return Repetitions([
        Verdict(
            scenario=scenario, scenario_name=name, scenario_sha256="", seed=1, run=0, ended_reason="duration",
            ended_t_s=4.0, metrics=metrics, checks=judge(scenario, metrics),
        )
    ])  # fmt: skip


def _printed(entries: Sequence[Repetitions | Crash]) -> list[str]:
    """Lines of the last table on a terminal of 120 columns."""
    out = io.StringIO()
    console = Console(file=out, width=120, force_terminal=False)
    console.print(summary_table(entries))
    console.print(counts(entries))
    return out.getvalue().splitlines()


def test_the_table_fits_a_terminal_of_120_columns_and_breaks_no_figure() -> None:
    metrics = {
        "distributed_with_gnss_1_hz.row_speed.mean_abs_error_row_1_turns_m_s": 0.0123456,
        "radar_only.row_speed.mean_abs_error_straights_m_s": 1.5e-7,
    }
    published = dict.fromkeys(metrics, 0.0456)
    lines = _printed([_verdict("planter_constant_radius_moving_average_10_hz", metrics, published=published)])
    assert max(map(len, lines)) <= 120
    for cells in (["0.0123", "0.0456", "0.271", "pass"], ["1.5e-07", "0.0456", "3.29e-06"]):
        assert any(all(cell in line.split() for cell in cells) for line in lines), (cells, lines)


def test_every_estimator_has_a_line_with_what_it_does_to_the_crop() -> None:
    speed, crop = "row_speed.mean_abs_error_turns_m_s", "seeds.mean_abs_population_error_turns_percent"
    metrics = {
        f"radar_only.{speed}": 0.5, f"radar_only.{crop}": 12.5, f"central.{speed}": 0.25, f"central.{crop}": 0.5,
        "central.consistency.nees": 9.0,
    }  # fmt: skip
    estimators = {
        "radar_only": {"kind": "radar_only", "sensors": ["radar"]},
        "central": {"kind": "row_speed_ekf", "sensors": ["imu_1", "radar"]},
    }
    lines = _printed([
        _verdict("plain", metrics, estimators=estimators),
        _verdict("published", metrics, estimators=estimators, published={f"central.{speed}": 0.5}),
        _verdict("nothing_known", {f"central.{speed}": math.nan}),
        Crash(scenario="broken", trace="..."),
    ])  # fmt: skip
    rows = [line.split() for line in lines if line.strip()]
    assert rows[-7:-1] == [
        ["plain", "radar_only", speed, "0.5", "12.5", "pass"],
        ["central", speed, "0.25", "0.5"],
        ["published", "central", speed, "0.25", "0.5", "0.5", "0.5", "pass"],
        ["radar_only", speed, "0.5", "12.5"],
        ["nothing_known", "pass"],
        ["broken", "crashed"],
    ]
    assert lines[-1] == "4 scenarios: 3 pass 1 crashed; 0 of 0 checks hold"
