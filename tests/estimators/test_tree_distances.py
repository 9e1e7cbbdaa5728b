"""The paper's distances to four trees, scan by scan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.rows import BEAMS, lane, noisy, scan, setup_of, turn
from twin.errors import BadInputError
from twin.estimators.tree_distances import TreeDistances, TreeDistancesConfig
from twin.signals import NS_PER_S, FloatArray

LAYOUT = [
    {"bearing_deg": 97.0, "distance_m": 0.4},
    {"bearing_deg": -97.0, "distance_m": 0.4},
    {"bearing_deg": 25.5, "distance_m": 1.0},
    {"bearing_deg": -25.5, "distance_m": 1.0},
]
FOUR = lane(from_m=0.0, to_m=1.0)


def make(runs: int = 1, **changes: object) -> TreeDistances:
    table = {"kind": "tree_distances", "sensors": ["lidar"], "layout": LAYOUT, **changes}
    return TreeDistances(TreeDistancesConfig.model_validate(table), setup_of(runs=runs))


def drive(
    estimator: TreeDistances,
    trees: FloatArray,
    *,
    speed: float,
    duration_s: float,
    offset_m: float = 0.0,
    seed: int = 1,
) -> tuple[FloatArray, FloatArray]:
    """Along the lane from its first trees: where the axle is after each scan (T,), and what is said (T, n)."""
    rng = np.random.default_rng(seed)
    where, said = [], []
    for k in range(1, round(duration_s / 0.2) + 1):
        t = 0.2 * k
        estimator.process(scan(noisy(turn(trees, lambda t: (speed * t, offset_m, 0.0), t), rng), t))
        where.append(speed * t)
        said.append(estimator.estimate(round(t * NS_PER_S)).values[0])
    return np.array(where), np.array(said)


def test_trees_are_found_at_their_known_places() -> None:
    estimator = make()
    _, said = drive(estimator, FOUR, speed=0.0, duration_s=0.2, offset_m=0.05)
    distances = dict(zip(estimator.columns, said[0], strict=True))
    # 0.05 to the left: 5 cm less to tree 1, more to tree 2. Noise 5 mm over thirteen beams; the bark curves.
    assert distances["tree_1_m"] == pytest.approx(0.355, abs=0.015)
    assert distances["tree_2_m"] == pytest.approx(0.455, abs=0.015)
    assert distances["tree_1_bearing_rad"] > 0.0 > distances["tree_2_bearing_rad"]
    assert distances["tree_3_m"] == pytest.approx(np.hypot(0.945, 0.40) - 0.05, abs=0.04)
    assert distances["pair"] == 1.0


def test_trees_three_and_four_take_over_half_a_metre_from_the_first() -> None:
    where, said = drive(make(), FOUR, speed=0.1, duration_s=8.0)
    pair = said[:, -1]
    # hypot(x + 0.055, 0.45) - 0.05 = 0.5: x = 0.26.
    assert where[np.argmax(pair == 2.0)] == pytest.approx(0.26, abs=0.05)
    assert set(pair) == {1.0, 2.0}
    # Ahead and beside: from 1 m to 0.4 m as the robot comes up to them.
    assert said[-1, 2] == pytest.approx(np.hypot(1.0 - 0.8 - 0.055, 0.45) - 0.05, abs=0.03)


def test_nothing_is_known_after_the_fourth_tree_but_with_the_extension() -> None:
    long = lane(from_m=0.0, to_m=12.0)
    _, four = drive(make(), long, speed=0.1, duration_s=40.0)
    assert four[-1, -1] == 0.0
    _, said = drive(make(repeat_spacing_m=1.0), long, speed=0.1, duration_s=60.0)
    assert (said[1:, -1] > 0.0).mean() > 0.97
    # In the middle of the lane both sides of a pair are always about as far.
    differences = said[said[:, -1] == 2.0][:, 2] - said[said[:, -1] == 2.0][:, 3]
    assert np.abs(differences).max() < 0.15


def test_a_missing_tree_leaves_nothing_to_steer_by() -> None:
    trees = lane(from_m=0.0, to_m=6.0)
    trees = trees[~((trees[:, 0] == 2.0) & (trees[:, 1] > 0.0))]
    where, said = drive(make(repeat_spacing_m=1.0), trees, speed=0.1, duration_s=24.0)
    between = (where > 1.4) & (where < 2.0)
    assert (said[between, -1] == 0.0).mean() > 0.9
    assert (said[where < 1.2, -1] > 0.0).all()


def test_the_left_is_seen_before_the_right() -> None:
    # A pair ahead at the bearing b: half a turn, 0.1 s, lies between the two beams, and the machine comes nearer by
    # v cos(b) 0.1 s times the share of a turn between them, (360 - 2 b) / 360.
    speed, estimator = 0.5, make(repeat_m=0.1)
    trees = FOUR
    t = 0.2
    estimator.process(scan(turn(trees, lambda t: (speed * (t - 0.2), 0.0, 0.0), t), t))
    said = estimator.estimate(round(t * NS_PER_S)).values[0]
    bearing = np.arctan2(0.45, 1.0 - 0.055)
    expected = speed * np.cos(bearing) * 0.2 * (2 * np.pi - 2 * bearing) / (2 * np.pi)
    assert said[2] - said[3] == pytest.approx(expected, abs=0.01)


def test_light_that_drowns_the_trees_loses_them() -> None:
    estimator, rng = make(), np.random.default_rng(2)
    ranges = turn(FOUR, lambda _: (0.0, 0.0, 0.0), 0.2)
    estimator.process(scan(ranges, 0.2))
    assert estimator.estimate(200_000_000).values[0, -1] == 1.0
    for k in range(2, 12):
        lost = rng.random(BEAMS) < 0.9
        wrong = lost & (rng.random(BEAMS) < 0.1)
        values = np.where(lost, np.nan, ranges)
        values[wrong] = 0.12 + 3.38 * rng.random(wrong.sum())
        estimator.process(scan(values, 0.2 * k))
    assert estimator.estimate(round(2.2 * NS_PER_S)).values[0, -1] == 0.0


def test_an_old_scan_is_not_passed_off_as_a_new_one() -> None:
    estimator = make()
    estimator.process(scan(turn(FOUR, lambda _: (0.0, 0.0, 0.0), 0.2), 0.2))
    assert np.isfinite(estimator.estimate(round(0.5 * NS_PER_S)).values[0, :4]).all()
    assert np.isnan(estimator.estimate(round(0.7 * NS_PER_S)).values[0, :4]).all()


def test_members_differ_by_their_own_scans_only() -> None:
    rng = np.random.default_rng(4)
    together, alone = make(runs=2), make()
    for k in range(1, 20):
        ranges = noisy(turn(FOUR, lambda t: (0.1 * t, 0.0, 0.0), 0.2 * k), rng, 2)
        together.process(scan(ranges, 0.2 * k, valid=np.array([True, k % 4 != 0])))
        alone.process(scan(ranges[:1], 0.2 * k))
    t_ns = round(3.8 * NS_PER_S)
    np.testing.assert_array_equal(together.estimate(t_ns).values[:1], alone.estimate(t_ns).values)


def test_it_takes_one_lidar() -> None:
    config = TreeDistancesConfig.model_validate({"kind": "tree_distances", "sensors": ["lidar"], "layout": LAYOUT})
    nothing = replace(setup_of(), sensors={})
    with pytest.raises(BadInputError, match="takes one of kind 'lidar', not 0"):
        TreeDistances(config, nothing)
