"""Implement height through RTK loss: the paper's experiments, receivers in trouble, and what it does to a field."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from twin import paths
from twin.scenario import load
from twin.scoring.ensemble import quantiles
from twin.signals import FloatArray
from twin.stress import Point, Task, make_plan, merge_results, run_task

FOLDER = paths.SCENARIOS / "levelling"
TROUBLES = sorted(path.stem for path in FOLDER.glob("scraper_rtk_*.toml"))


def _stressed(name: str, *, runs: int, worlds: int) -> Point:
    path = FOLDER / f"{name}.toml"
    plan = make_plan(path, runs=runs, worlds=worlds, settings=[], vary=[], seed=None)
    tasks = {Task(0, world, 0): run_task(plan, 0, world) for world in range(worlds)}
    return merge_results(load(path), plan, tasks, {}).points[0]


@pytest.mark.parametrize("name", ["scraper_rail_rtk", "scraper_rail_loss_28s"])
def test_the_bench_of_the_paper(name: str) -> None:
    verdict = twin.score(twin.run(name))
    assert verdict.verdict == "pass", [outcome.sentence() for outcome in verdict.checks]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scraper_field_rtk", "scraper_field_loss_28s"])
def test_the_field_of_the_paper(name: str) -> None:
    verdict = twin.score(twin.run(name))
    assert verdict.verdict == "pass", [outcome.sentence() for outcome in verdict.checks]


@pytest.mark.slow
def test_how_long_the_blade_can_be_trusted() -> None:
    # As written the published filter takes in what is half a metre off: it cannot hold 30 mm for 28 s. One that leaves
    # those heights alone lasts about as long as the paper says or less, and differs from run to run by far more than
    # one field run shows. Ours lasts longer than any of them in the median.
    point = _stressed("scraper_rail_loss", runs=200, worlds=1)

    def time_s(estimator: str) -> FloatArray:
        return point.table[f"{estimator}.height.time_to_30mm_s"]

    for published in ("fixed_q", "vpkf", "vpkf_quality"):
        assert np.mean(time_s(published) >= 28.0) <= 0.01
    low, median, high = quantiles(time_s("vpkf_coast"))
    assert median < 28.0
    assert high > 2.0 * median > 4.0 * low
    for other in ("gnss", "fixed_q", "vpkf", "vpkf_quality", "vpkf_coast", "ours_without_vertical_speed"):
        assert quantiles(time_s("ours"))[1] > quantiles(time_s(other))[1]
    # With vertical speed at most half the coasting sigma after a minute.
    with_it, without = (
        point.pooled[f"{name}.honesty.sigma_at_end_of_loss_mm"] for name in ("ours", "ours_without_vertical_speed")
    )
    assert with_it <= 0.5 * without


@pytest.mark.slow
@pytest.mark.parametrize("name", TROUBLES)
def test_ours_is_honest_and_recovers_whatever_happens_to_rtk(name: str) -> None:
    point = _stressed(name, runs=50, worlds=4)
    assert all(outcome.ok for outcome in point.outcomes), [outcome.sentence() for outcome in point.outcomes]


@pytest.mark.slow
def test_what_losing_corrections_costs_a_field_and_what_a_better_filter_saves() -> None:
    flatness: dict[str, float] = {}
    for followed in ("truth", "vpkf", "ours"):
        recording = twin.run("scraper_levelling_loss", set={"implement.follows": followed})
        metrics = twin.score(recording).metrics
        flatness[followed] = metrics["truth.levelling.flatness_after_mm"]
        before = metrics["truth.levelling.flatness_before_mm"]
    # Levelling levels; following the published filter through the loss, it does not; ours saves most of the difference.
    assert flatness["truth"] < before < flatness["vpkf"]
    assert flatness["truth"] <= flatness["ours"]
    assert flatness["ours"] - flatness["truth"] < 0.5 * (flatness["vpkf"] - flatness["truth"])
