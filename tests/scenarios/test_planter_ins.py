"""The strapdown filter's scenarios: each passes, and a fault's fails when what handles the fault is taken out."""

import tomllib
from typing import Any

import pytest

from twin.execution import execute
from twin.scenario import bundled, load
from twin.scoring import score
from twin.scoring.verdict import Verdict

pytestmark = pytest.mark.slow

HANDLING = {
    "gyro_stuck": "gating.watch_units",
    "noisy_unit": "gating.watch_units",
    "radar_dead": "gating.enabled",
    "radar_slipping": "gating.enabled",
    "gnss_jump": "gating.enabled",
    "gnss_clock": "gating.enabled",
    "gnss_gone": "scale_states",
}


def judged(name: str, *, needs: list[str], settings: list[tuple[str, Any]] | None = None) -> Verdict:
    """The verdict on a scenario, of whose estimators only those run that the checks need."""
    path = bundled()[name]
    estimators = tomllib.loads(load(path).toml)["estimators"]
    only = ("estimators", {each: estimators[each] for each in needs})
    return score(execute(load(path, settings=[only, *(settings or [])])))


def failed(verdict: Verdict) -> list[str]:
    assert verdict.checks, "the scenario checks nothing"
    return [outcome.sentence() for outcome in verdict.checks if not outcome.ok]


def test_every_fault_has_its_handling() -> None:
    assert sorted(HANDLING) == sorted(name.removeprefix("planter_fault_") for name in bundled() if "_fault_" in name)


@pytest.mark.parametrize("fault", HANDLING)
def test_a_fault_is_handled(fault: str) -> None:
    assert failed(judged(f"planter_fault_{fault}", needs=["ins"])) == []


@pytest.mark.parametrize(("fault", "handling"), HANDLING.items())
def test_a_fault_does_its_harm_where_its_handling_is_taken_out(fault: str, handling: str) -> None:
    without = judged(f"planter_fault_{fault}", needs=["ins"], settings=[(f"estimators.ins.{handling}", False)])
    assert failed(without) != []


@pytest.mark.parametrize("slope", ["3", "3_rtk_loss", "5", "5_rtk_loss"])
def test_a_slope_costs_the_strapdown_filter_nothing(slope: str) -> None:
    assert failed(judged(f"planter_slope_{slope}", needs=["central", "ins"])) == []


def test_on_level_ground_it_is_near_what_can_be_known() -> None:
    assert failed(judged("planter_level", needs=["central", "ins", "smoother"])) == []
