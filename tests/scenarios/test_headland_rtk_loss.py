"""RTK loss in a headland turn: what has to hold over many members, and what has to fail without the state machine."""

import numpy as np
import pytest

from twin.scenario import bundled
from twin.scoring.ensemble import judge_ensemble
from twin.stress import Setting, make_plan, run_task

MEMBERS = 100
pytestmark = pytest.mark.slow


def _failing(settings: list[Setting]) -> list[str]:
    """Sentences of the checks that do not hold over 100 members (59 are enough for 95 % with 95 % confidence)."""
    path = bundled()["planter_headland_rtk_loss"]
    plan = make_plan(path, runs=MEMBERS, worlds=1, settings=settings, vary=[], seed=None)
    found = run_task(plan, 0, 0)
    motion = {name: np.full((1, MEMBERS), value) for name, value in found.motion.items()}
    table = {**motion, **{name: values[np.newaxis] for name, values in found.metrics.items()}}
    outcomes = judge_ensemble(plan.load(0, 0).scenario, table)
    assert outcomes
    return [outcome.sentence() for outcome in outcomes if not outcome.ok]


def test_every_check_holds_over_a_hundred_members() -> None:
    assert _failing([]) == []


def test_a_receiver_that_keeps_its_fix_is_noticed() -> None:
    failing = _failing([("sensors.gnss.state", "fix")])
    assert len(failing) == 1
    assert failing[0].startswith("central.row_position.max_error_loss_m")
