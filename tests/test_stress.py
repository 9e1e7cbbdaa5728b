"""Stress tests: the same numbers as single runs, whatever the blocks and workers; files, resuming, verdicts."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.cli.command import twin, write_scenario
from twin.errors import BadInputError
from twin.execution import execute
from twin.scenario import load
from twin.scoring import score
from twin.stress import Parts, Task, TaskResult, make_plan, parse_vary, run_task, run_tasks
from twin.stress import plan as planning

CHECK = {"metric": "central.row_speed.mean_abs_error_m_s", "max": 0.5, "percentile": 90.0}


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    sensors = {
        "gnss": {"preset": "rtk_chcnav_i70", "faults": [{"kind": "corrections_lost", "from_s": 2.0, "to_s": 3.5}]},
        "radar": {"dropout_probability": 0.1},
    }
    scoring = {"limits": {"row_speed": 0.05}}
    seeding = {"spacing_m": 0.05, "skip_probability": 0.1, "drop_spread_s": 0.01}
    return write_scenario(tmp_path, sensors=sensors, scoring=scoring, seeding=seeding, checks=[CHECK])


def _same(one: TaskResult, other: TaskResult) -> None:
    assert one.metrics.keys() == other.metrics.keys()
    for name, values in one.metrics.items():
        np.testing.assert_array_equal(values, other.metrics[name], err_msg=name)
    for name, envelope in one.envelopes.items():
        np.testing.assert_array_equal(envelope.counts, other.envelopes[name].counts, err_msg=name)


def test_members_score_as_the_single_runs_do(scenario_file: Path) -> None:
    plan = make_plan(scenario_file, runs=4, worlds=1, settings=[], vary=[], seed=None)
    found = run_task(plan, 0, 0).metrics
    assert np.ptp(found["radar_only.seeds.misses_percent"]) > 0.0
    for run in range(4):
        alone = score(execute(load(scenario_file), runs=(run,))).metrics
        for name, values in found.items():
            np.testing.assert_allclose(values[run], alone[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_blocks_do_not_change_the_numbers(scenario_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = make_plan(scenario_file, runs=5, worlds=1, settings=[], vary=[], seed=None)
    whole = run_task(plan, 0, 0)
    monkeypatch.setattr(planning, "BLOCK", 2)
    pieces = run_task(make_plan(scenario_file, runs=5, worlds=1, settings=[], vary=[], seed=None), 0, 0)
    for name, values in whole.metrics.items():
        np.testing.assert_allclose(values, pieces.metrics[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_workers_do_not_change_the_numbers(scenario_file: Path) -> None:
    plan = make_plan(scenario_file, runs=2, worlds=2, settings=[], vary=["driver.speed_m_s=1.0,2.0"], seed=None)
    alone = dict(run_tasks(plan, workers=1, done={}))
    together = dict(run_tasks(plan, workers=2, done={}))
    assert list(alone) == list(together) == [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0)]
    for task, result in alone.items():
        _same(result, together[task])


def test_finished_tasks_survive_the_disk(scenario_file: Path, tmp_path: Path) -> None:
    plan = make_plan(scenario_file, runs=2, worlds=1, settings=[], vary=[], seed=None)
    parts = Parts(tmp_path, plan, plan.load(0, 0))
    result = run_task(plan, 0, 0)
    task = Task(0, 0, 0)
    parts.write(task, result)
    read = parts.read(task)
    _same(result, read)
    np.testing.assert_equal(read.motion, result.motion)
    assert read.states == result.states
    assert dict(run_tasks(plan, workers=1, done=parts.finished())) == {}
    next(tmp_path.glob(".stress-*/*.npz")).write_bytes(b"broken")
    assert parts.finished() == set()
    parts.remove()
    assert not list(tmp_path.glob(".stress-*"))


def test_values_to_vary_are_ranges_or_lists() -> None:
    assert [value for _, value in parse_vary("a.b=1:2")] == [1.0, 1.25, 1.5, 1.75, 2.0]
    assert [value for _, value in parse_vary("a=0:1:3")] == [0.0, 0.5, 1.0]
    assert parse_vary("sensors.gnss.preset=rtk_f9p,lea_5s") == [
        ("sensors.gnss.preset", "rtk_f9p"), ("sensors.gnss.preset", "lea_5s"),
    ]  # fmt: skip
    for wrong in ("a", "a=", "a=1:b", "a=1:2:0", "a=1:2:3:4", "a=2:1", "a=1:-1:3"):
        with pytest.raises(BadInputError, match="--vary"):
            parse_vary(wrong)


def test_the_command_writes_a_table_envelopes_plots_and_a_verdict(scenario_file: Path, tmp_path: Path) -> None:
    result = twin("stress", scenario_file, "--runs", "6", "--worlds", "2", "--json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    told = json.loads(result.stdout)[0]
    folder = tmp_path / "runs" / "small" / "stress_seed1_worlds2_runs6"
    assert json.loads((folder / "result.json").read_text()) == told
    assert told["verdict"] == "pass"
    members = pq.read_table(folder / "members.parquet")
    assert members.num_rows == 12
    values = members["central.row_speed.mean_abs_error_m_s"].to_numpy()
    assert told["points"][0]["metrics"]["central.row_speed.mean_abs_error_m_s"]["p50"] in values
    for name in ("envelopes.png", "distributions.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    assert pq.read_table(folder / "envelopes.parquet").num_rows > 0
    worst = told["points"][0]["worst"][0]["command"].split()
    assert worst[:2] == ["twin", "run"]
    assert worst[2] == str(scenario_file)
    again = twin(*worst[1:], "--no-rrd", "--json", cwd=tmp_path)
    name = f"{told['points'][0]['worst'][0]['estimator']}.{told['points'][0]['worst'][0]['metric']}"
    expected = told["points"][0]["worst"][0]["value"]
    assert json.loads(again.stdout)[0]["metrics"][name] == pytest.approx(expected, rel=1e-9)


def test_a_check_that_fails_over_the_members_fails_the_command(scenario_file: Path, tmp_path: Path) -> None:
    # With 10 members no order statistic lies above the 90 % quantile with 99 % confidence: 1 - 0.9 ** 10 = 65 %.
    result = twin("stress", scenario_file, "--runs", "10", "--set", "checks.0.confidence=0.99", cwd=tmp_path)
    assert result.returncode == 1
    assert "FAIL" in result.stdout


def test_bad_stress_input_is_refused(scenario_file: Path, tmp_path: Path) -> None:
    for arguments, message in (
        (["--vary", "driver.speed_m_s"], "expected KEY=LO:HI"),
        (["--vary", "driver.speed_m_s=-1,2"], "driver.speed_m_s: given -1"),
        (["--runs", "0"], "runs"),
    ):
        result = twin("stress", scenario_file, *arguments, cwd=tmp_path)
        assert result.returncode == 2, result.stderr
        assert message in result.stderr
        assert "Traceback" not in result.stderr
