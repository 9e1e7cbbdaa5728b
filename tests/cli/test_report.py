"""What a person is told of a run, from its verdict on."""

import time
from pathlib import Path

import pytest

from tests.small_scenario import small_scenario, small_scenario_toml
from twin.cli.report import Reporter
from twin.cli.tables import verdict_words
from twin.scenario import LoadedScenario, resolve
from twin.scoring import Repetitions, Verdict
from twin.scoring.checks import judge

METRIC = "central.position.rmse_m"
HOLDS = {"metric": METRIC, "max": 1.0}


def _told(capsys: pytest.CaptureFixture[str], *, baseline_compared: bool = False, **changes: object) -> str:
    """What is printed of a run of the small scenario with changes."""
    scenario = resolve(small_scenario(**changes), where="test")
    metrics = {METRIC: 0.5}
    verdict = Verdict(
        scenario=scenario, scenario_name="small", scenario_sha256="", seed=1, run=0, ended_reason="duration",
        ended_t_s=4.0, metrics=metrics, checks=judge(scenario, metrics), baseline_compared=baseline_compared,
    )  # fmt: skip
    loaded = LoadedScenario(
        name="small", path=Path("small.toml"), scenario=scenario, toml=small_scenario_toml(**changes)
    )
    Reporter(quiet=False).result(loaded, Repetitions([verdict]), [], rrd=False)
    return capsys.readouterr().out


def test_a_run_without_checks_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert "verdict: pass (no checks)\n" in _told(capsys)
    assert "verdict: pass (no checks)\n" in _told(capsys, checks=[{**HOLDS, "stress_only": True}])
    assert "verdict: pass\n" in _told(capsys, checks=[HOLDS])
    # A baseline is a check of another kind.
    assert "verdict: pass\n" in _told(capsys, baseline_compared=True)


def test_progress_is_told_once_there_is_some(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter(range(0, 1000, 10))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(clock)))
    scenario = resolve(small_scenario(), where="test")
    loaded = LoadedScenario(name="small", path=Path("small.toml"), scenario=scenario, toml="")
    with Reporter(quiet=False).progress(loaded) as progress:
        # Two runs one after the other, each from its own begin on.
        for t_s in (0.0, 0.2, 1.0, 1.2, 3.9, 0.0, 0.4, 4.0, 2.0):
            progress(t_s)
    title, *told = capsys.readouterr().out.splitlines()
    assert title == "small: A short straight on flat ground"
    assert told == ["small: 1 of 4 s", "small: 4 of 4 s", "small: 2 of 4 s"]


def test_only_what_passes_needs_to_say_that_nothing_was_checked() -> None:
    assert verdict_words("pass", checked=False).plain == "verdict: pass (no checks)"
    assert verdict_words("error", checked=False).plain == "verdict: error"
