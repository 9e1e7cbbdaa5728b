"""A lane by heading, with every filter of the paper and ours, with and without a magnet beside it."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from twin import paths
from twin.scenario import load
from twin.scoring.ensemble import judge_ensemble
from twin.stress import make_plan, run_task

FILTERS = (
    "complementary",
    "madgwick",
    "kalman_imu",
    "kalman_odometry_gyro",
    "kalman_odometry_gyro_mag",
    "integrated_kalman",
    "heading_filter",
)
NAMES = [f"orchard_lane_magnetic_{name}" for name in FILTERS] + ["orchard_lane_kalman_odometry_gyro"]


@pytest.mark.parametrize("name", ["orchard_lane_heading_filter", "orchard_lane_magnetic_complementary"])
def test_one_that_stays_and_one_that_is_led_astray(name: str) -> None:
    verdict = twin.score(twin.run(name))
    assert verdict.verdict == "pass", [outcome.sentence() for outcome in verdict.checks]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_four_worlds_of_five_end_as_the_scenario_says(name: str) -> None:
    path = paths.SCENARIOS / "orchard" / f"{name}.toml"
    plan = make_plan(path, runs=1, worlds=5, settings=[], vary=[], seed=None)
    worlds = [run_task(plan, 0, world).metrics for world in range(5)]
    table = {metric: np.stack([found[metric] for found in worlds]) for metric in worlds[0]}
    outcomes = judge_ensemble(load(path).scenario, table)
    assert all(outcome.ok for outcome in outcomes), [outcome.sentence() for outcome in outcomes]
