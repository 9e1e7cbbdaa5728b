"""Checks and baselines."""

import math
from pathlib import Path

import pytest

from tests.small_scenario import small_scenario
from twin.errors import BadInputError
from twin.scenario import resolve
from twin.scoring import baselines
from twin.scoring.baselines import Baseline
from twin.scoring.checks import judge, require_known


def _judge(metrics: dict[str, float], **check: float | str) -> bool:
    scenario = resolve(small_scenario(checks=[check]), where="test")
    return judge(scenario, metrics)[0].ok


def test_bounds_hold_up_to_and_including_their_value() -> None:
    assert _judge({"a": 1.0}, metric="a", max=1.0)
    assert not _judge({"a": 1.0 + 1e-9}, metric="a", max=1.0)
    assert _judge({"a": 1.0}, metric="a", min=1.0)
    assert not _judge({"a": 0.9}, metric="a", min=1.0)


def test_ratios_hold_within_their_bounds() -> None:
    assert _judge({"a": 1.0, "b": 5.0}, metric="a", ratio_to="b", max_ratio=0.2)
    assert not _judge({"a": 1.1, "b": 5.0}, metric="a", ratio_to="b", max_ratio=0.2)
    assert not _judge({"a": 1.0, "b": 5.0}, metric="a", ratio_to="b", min_ratio=0.3)


def test_a_difference_is_held_up_to_its_limit_and_may_be_as_negative_as_it_likes() -> None:
    asked = {"metric": "a", "difference_to": "b", "max_difference": 0.25}
    assert _judge({"a": 1.25, "b": 1.0}, **asked)
    assert not _judge({"a": 1.26, "b": 1.0}, **asked)
    assert _judge({"a": 0.0, "b": 100.0}, **asked)
    assert not _judge({"a": math.nan, "b": 1.0}, **asked)
    assert not _judge({"a": 1.0}, **asked)
    assert not _judge({"a": 1.1, "b": 1.0}, **asked, max=1.0)


def test_a_difference_says_in_words_what_it_asks_for() -> None:
    check = {"metric": "a", "difference_to": "b", "max_difference": 0.2}
    scenario = resolve(small_scenario(checks=[check]), where="test")
    assert judge(scenario, {"a": 1.0, "b": 0.5})[0].sentence() == "a - b = 0.5, required <= 0.2"


def test_a_share_of_members_is_told_where_there_are_members() -> None:
    check = {"metric": "a", "max": 2.0, "percentile": 50.0, "confidence": 0.95}
    (outcome,) = judge(resolve(small_scenario(checks=[check]), where="test"), {"a": 1.0})
    assert outcome.sentence() == "a = 1, required <= 2"
    assert outcome.sentence(of_members=True) == "a = 1, required <= 2 (at 50 % of the members, confidence 95 %)"


@pytest.mark.parametrize(
    ("check", "message"),
    [
        ({"metric": "a", "difference_to": "b"}, "difference_to goes with max_difference"),
        ({"metric": "a", "max": 1.0, "max_difference": 0.2}, "difference_to goes with max_difference"),
        (
            {"metric": "a", "difference_to": "b", "max_difference": 0.2, "ratio_to": "b", "max_ratio": 1.0},
            "ratio_to or difference_to, not both",
        ),
    ],
)
def test_half_a_difference_is_refused(check: dict[str, float | str], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        resolve(small_scenario(checks=[check]), where="test")


def test_the_other_metric_of_a_difference_has_to_exist() -> None:
    check = {"metric": "a", "difference_to": "b", "max_difference": 0.2}
    scenario = resolve(small_scenario(checks=[check]), where="test")
    with pytest.raises(BadInputError, match=r"file: checks.0.difference_to: "):
        require_known(scenario, ["a"], where="file")


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_not_a_number_fails(value: float) -> None:
    assert not _judge({"a": value}, metric="a", max=1.0)
    assert not _judge({"a": math.nan}, metric="a", min=1.0)
    assert not _judge({"a": 1.0, "b": value}, metric="a", ratio_to="b", min_ratio=0.0)
    assert not _judge({"a": 1.0, "b": 0.0}, metric="a", ratio_to="b", max_ratio=2.0)


def test_a_check_on_an_unknown_metric_names_the_nearest() -> None:
    scenario = resolve(small_scenario(checks=[{"metric": "central.position.rms_m", "max": 1.0}]), where="test")
    with pytest.raises(BadInputError, match=r"file: checks.0.metric: .*did you mean 'central.position.rmse_m'"):
        require_known(scenario, ["central.position.rmse_m"], where="file")


def test_never_keeps_a_minimum() -> None:
    assert _judge({"a": math.inf}, metric="a", min=28.0)
    assert Baseline(math.inf).holds(math.inf)
    assert not Baseline(math.inf).holds(30.0)


def test_a_baseline_holds_within_its_tolerance_and_only_there() -> None:
    baseline = Baseline(2.0, 1e-3)
    assert baseline.holds(2.0019)
    assert not baseline.holds(2.0021)
    assert not baseline.holds(math.nan)
    assert Baseline(math.nan).holds(math.nan)


def test_baselines_survive_the_file_and_an_update_rewrites_only_what_moved(tmp_path: Path) -> None:
    path = tmp_path / "baselines" / "a.csv"
    baselines.write(path, baselines.updated({}, {"a": 1.0 / 3.0, "b": 2.0, "gone": 3.0}))
    before = path.read_text().splitlines()
    known = baselines.read(path)
    now = {"a": 1.0 / 3.0 * (1.0 + 1e-4), "b": 2.5}
    assert {line.partition(":")[0] for line in baselines.drifted(known, now)} == {"b", "gone"}
    baselines.write(path, baselines.updated(known, now))
    after = path.read_text().splitlines()
    assert [line for line in after if line not in before] == ["b,2.5,0.001"]
    assert not baselines.drifted(baselines.read(path), now)


def test_a_broken_baseline_is_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("metric,value\na,notanumber\n")
    with pytest.raises(BadInputError, match="not a baseline"):
        baselines.read(path)
