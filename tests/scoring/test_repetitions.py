"""Several runs of one scenario: mean, range, and checks that hold in every run."""

import math

import pytest

from tests.small_scenario import small_scenario
from twin.scenario import resolve
from twin.scoring import Repetitions, Verdict
from twin.scoring.checks import judge

SCENARIO = resolve(small_scenario(checks=[{"metric": "a", "max": 2.0}]), where="test")


def _verdict(run: int, a: float, *, ended: str = "duration", drifted: tuple[str, ...] = ()) -> Verdict:
    metrics = {"a": a}
    return Verdict(
        scenario=SCENARIO,
        scenario_name="small",
        scenario_sha256="",
        seed=1,
        run=run,
        ended_reason=ended,
        ended_t_s=4.0,
        metrics=metrics,
        checks=judge(SCENARIO, metrics),
        timing={"wall_s": 0.5},
        drifted=list(drifted),
    )


def _of(*values: float) -> Repetitions:
    return Repetitions([_verdict(run, value) for run, value in enumerate(values)])


def test_mean_and_range() -> None:
    spread = _of(1.0, 0.5, 1.8).metrics()["a"]
    assert (spread.mean, spread.low, spread.high) == pytest.approx((1.1, 0.5, 1.8))


def test_what_is_not_known_in_one_run_has_no_mean() -> None:
    assert math.isnan(_of(1.0, math.nan).metrics()["a"].mean)
    assert _of(1.0, math.inf).metrics()["a"].mean == math.inf


def test_a_check_has_to_hold_in_every_run_not_in_the_mean() -> None:
    found = _of(1.0, 2.1, 1.0)
    assert found.metrics()["a"].mean < 2.0
    assert [outcome.ok for outcome in found.checks] == [False]
    assert found.verdict == "fail"
    assert found.checks[0].sentence() == "a = 1 to 2.1, required <= 2 in each of 3 runs; fails in run 1"
    assert _of(1.0, 2.0, 1.5).verdict == "pass"
    assert _of(2.0, 2.0).checks[0].sentence() == "a = 2, required <= 2 in each of 2 runs"


def test_a_run_without_a_number_fails() -> None:
    found = _of(1.0, math.nan)
    assert found.verdict == "fail"
    assert found.checks[0].sentence().endswith("fails in run 1")


def test_one_run_reads_as_before() -> None:
    assert _of(1.0).checks[0].sentence() == "a = 1, required <= 2"


def test_the_verdict_is_the_worst() -> None:
    early = _verdict(1, 1.0, ended="the machine tipped over")
    assert Repetitions([_verdict(0, 3.0), early]).verdict == "error"
    assert Repetitions([_verdict(0, 1.0, drifted=("a: 1 -> 2",)), _verdict(1, 1.0)]).verdict == "fail"
    assert Repetitions([_verdict(0, 1.0), _verdict(1, 1.0)]).wall_s == pytest.approx(1.0)
