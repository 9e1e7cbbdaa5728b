"""Honesty pooled over members: known shares, merged as if counted together, judged once."""

import math

import numpy as np
import pytest
from scipy import stats

from tests.scoring.heights import estimate_of, fixes_at, heights, lossy, scored, times
from tests.small_scenario import small_scenario
from twin.errors import BadInputError
from twin.scenario import Check, resolve
from twin.scoring.checks import require_known
from twin.scoring.ensemble import judge_ensemble
from twin.scoring.honesty import figures, is_pooled, pooled_metrics


def test_shares_are_those_of_the_epochs_and_of_the_worst_second_since_the_loss() -> None:
    # From 10 s to 20 s nothing is lost yet; the loss lasts from 20 s to 24 s, the run to 30 s.
    scenario, truth, t_s = lossy(30.0, (20.0, 24.0), from_s=10.0), heights(30.0), times(30.0)
    second = np.floor(t_s)
    fifth = np.round((t_s - second) * 50) < 10
    sigmas = np.select([second == 21, second == 23], [0.030, 0.005], 0.010)
    # Outside (2.6 sigma) for the fifth part of second 15 and all of 22; 31 mm off for the fifth part of 23.
    errors = np.select([(second == 15) & fifth, second == 22, (second == 23) & fifth], [0.026, 0.026, 0.031], 0.010)
    found = figures(scored(scenario, truth, estimate_of(truth, errors, sigmas)).honesty()["one"], scenario)
    # 20 s count; outside are 0.2 s of second 15, 1 s of 22 and 0.2 s of 23.
    assert found["honesty.inside_percent"] == pytest.approx(100 * (20 - 1.4) / 20)
    assert found["honesty.least_inside_percent"] == 0.0
    # 3 sigma is 15 mm when the error is 31 mm: 0.2 s of 20 s.
    assert found["honesty.unsafe_percent"] == pytest.approx(100 * 0.2 / 20)
    assert found["honesty.largest_sigma_ratio"] == pytest.approx(3.0)
    assert found["honesty.sigma_at_end_of_loss_mm"] == pytest.approx(5.0)
    assert "honesty.recovered_percent" not in found


def test_an_honest_normal_error_is_inside_in_99_percent_and_its_sigma_is_its_rms() -> None:
    scenario, truth = lossy(10.0, (2.0, 8.0)), heights(10.0)
    errors = np.random.default_rng(3).normal(scale=0.012, size=(len(truth), 400))
    found = figures(scored(scenario, truth, estimate_of(truth, errors, 0.012)).honesty()["one"], scenario)
    # 200 000 independent epochs: the standard error of a share of 99.0 % is 0.022 %; of a second's 20 000, 0.07 %.
    assert found["honesty.inside_percent"] == pytest.approx(99.0, abs=0.1)
    assert 98.6 < found["honesty.least_inside_percent"] < 99.0
    # |e| > 30 mm is beyond 2.5 sigma, but 3 sigma is 36 mm: nobody was told that all is safe.
    assert found["honesty.unsafe_percent"] == 0.0
    # The root mean square of 20 000 normal values has a relative standard error of 0.5 %.
    assert found["honesty.largest_sigma_ratio"] == pytest.approx(1.0, abs=0.02)
    safe = figures(scored(scenario, truth, estimate_of(truth, errors, 0.0099)).honesty()["one"], scenario)
    assert safe["honesty.unsafe_percent"] == pytest.approx(100 * 2 * stats.norm.sf(2.5), abs=0.12)


def test_members_pieces_and_parts_add_up() -> None:
    scenario, truth = lossy(20.0, (5.0, 12.0), fixes_of="gnss"), heights(20.0)
    rng = np.random.default_rng(4)
    errors, fixes = rng.normal(scale=0.012, size=(len(truth), 5)), fixes_at(20.0, *rng.uniform(12.0, 15.0, 5))
    estimate = estimate_of(truth, errors, 0.01)
    whole = scored(scenario, truth, estimate, fixes).honesty()["one"]
    merged = None
    for members in (slice(0, 2), slice(2, 5)):
        some = type(estimate)(columns=estimate.columns, t_ns=estimate.t_ns, values=estimate.values[:, members])
        their = type(fixes)(columns=fixes.columns, t_ns=fixes.t_ns, values=fixes.values[:, members])
        found = scored(scenario, truth, some, their, piece_s=0.7).honesty()["one"]
        if merged is None:
            merged = found
        else:
            merged.merge(found)
    assert merged is not None
    np.testing.assert_array_equal(merged.counts, whole.counts)
    np.testing.assert_array_equal(merged.members, whole.members)
    np.testing.assert_allclose(merged.sums, whole.sums, rtol=1e-12)
    for name, value in figures(whole, scenario).items():
        assert figures(merged, scenario)[name] == pytest.approx(value, rel=1e-12), name


@pytest.mark.parametrize(("loss_s", "percent"), [(10.0, 50.0), (10.5, 75.0)])
def test_recovery_may_take_longer_after_a_long_loss(loss_s: float, percent: float) -> None:
    scenario, truth = lossy(30.0, (5.0, 5.0 + loss_s), fixes_of="gnss"), heights(30.0)
    # Members are well 1, 2, 2.5 and 3.5 s after a fix that comes with the end of the loss.
    late = 5.0 + loss_s + np.array([1.0, 2.0, 2.5, 3.5])
    errors = np.where(times(30.0)[:, np.newaxis] < late - 1e-6, 0.05, 0.0)
    scorer = scored(scenario, truth, estimate_of(truth, errors, 0.01), fixes_at(30.0, *[5.0 + loss_s] * 4))
    assert figures(scorer.honesty()["one"], scenario)["honesty.recovered_percent"] == percent


def test_a_member_without_a_true_fix_has_not_recovered() -> None:
    scenario, truth = lossy(20.0, (5.0, 10.0), fixes_of="gnss"), heights(20.0)
    estimate = estimate_of(truth, np.zeros((len(truth), 2)), 0.01)
    found = figures(scored(scenario, truth, estimate, fixes_at(20.0, 10.0, 99.0)).honesty()["one"], scenario)
    assert found["honesty.recovered_percent"] == 50.0


def test_where_no_member_had_a_true_fix_nobody_could_recover() -> None:
    scenario, truth = lossy(20.0, (5.0, 10.0), fixes_of="gnss"), heights(20.0)
    estimate = estimate_of(truth, np.zeros((len(truth), 2)), 0.01)
    honesty = scored(scenario, truth, estimate, fixes_at(20.0, 99.0, 99.0)).honesty()["one"]
    assert math.isnan(figures(honesty, scenario)["honesty.recovered_percent"])
    # Another world in which one of two had one: of all four one has recovered.
    honesty.merge(scored(scenario, truth, estimate, fixes_at(20.0, 10.0, 99.0)).honesty()["one"])
    assert figures(honesty, scenario)["honesty.recovered_percent"] == 25.0


def test_who_claims_no_sigma_is_neither_honest_nor_not() -> None:
    scenario, truth = lossy(20.0, (5.0, 10.0), fixes_of="gnss"), heights(20.0)
    estimate = estimate_of(truth, np.zeros(len(truth)))
    found = pooled_metrics(scored(scenario, truth, estimate, fixes_at(20.0, 10.0)).honesty(), scenario)
    assert len(found) == 6
    assert all(is_pooled(name) and math.isnan(value) for name, value in found.items())


@pytest.mark.parametrize("piece_s", [1e4, 0.7])
def test_who_stops_claiming_a_sigma_is_not_inside(piece_s: float) -> None:
    scenario, truth, t_s = lossy(20.0, (5.0, 10.0)), heights(20.0), times(20.0)
    # The first member's estimator settles for 2 s and is silent in the loss from 6 s to 8 s; the second's never is.
    silent = (t_s < 2.0) | ((t_s >= 6.0) & (t_s < 8.0))
    sigmas = np.stack([np.where(silent, np.nan, 0.010), np.full(len(t_s), 0.010)], axis=1)
    errors = np.where(silent[:, np.newaxis], 0.100, 0.005) * [1.0, 0.0] + [0.0, 0.005]
    found = figures(
        scored(scenario, truth, estimate_of(truth, errors, sigmas), None, piece_s).honesty()["one"], scenario
    )
    # 18 s and 20 s count, of which 2 s are silent; the worst seconds are those with one of two members.
    assert found["honesty.inside_percent"] == pytest.approx(100 * 36 / 38)
    assert found["honesty.least_inside_percent"] == pytest.approx(50.0)
    assert found["honesty.unsafe_percent"] == 0.0
    # Sigma and error where both are known: 10 mm and 5 mm.
    assert found["honesty.largest_sigma_ratio"] == pytest.approx(2.0)
    assert found["honesty.sigma_at_end_of_loss_mm"] == pytest.approx(10.0)


def test_an_unknown_height_with_a_claimed_sigma_is_not_inside_and_has_no_ratio() -> None:
    scenario, truth = lossy(10.0, None), heights(10.0)
    errors = np.where(times(10.0) < 5.0, np.nan, 0.01)
    found = figures(scored(scenario, truth, estimate_of(truth, errors, 0.01)).honesty()["one"], scenario)
    assert found["honesty.inside_percent"] == 50.0
    assert math.isnan(found["honesty.largest_sigma_ratio"])


def test_a_pooled_figure_is_judged_once_whatever_the_number_of_members() -> None:
    checks = [
        {"metric": "a.honesty.inside_percent", "min": 98.5},
        {"metric": "a.honesty.sigma_at_end_of_loss_mm", "ratio_to": "b.honesty.sigma_at_end_of_loss_mm",
         "max_ratio": 0.5},
    ]  # fmt: skip
    scenario = resolve(small_scenario(checks=checks), where="test")
    pooled = {"a.honesty.inside_percent": 98.6, "a.honesty.sigma_at_end_of_loss_mm": 40.0,
              "b.honesty.sigma_at_end_of_loss_mm": 90.0}  # fmt: skip
    table = {name: np.array([[value]]) for name, value in pooled.items()} | {"a.height.rmse_mm": np.ones((50, 10))}
    assert [outcome.ok for outcome in judge_ensemble(scenario, table)] == [True, True]
    table["a.honesty.inside_percent"] = np.array([[98.4]])
    assert [outcome.ok for outcome in judge_ensemble(scenario, table)] == [False, True]


@pytest.mark.parametrize(
    ("check", "message"),
    [
        ({"max": 1.0, "percentile": 95.0}, "checks.0.percentile: a.honesty.unsafe_percent is one figure of all"),
        ({"ratio_to": "a.height.rmse_mm", "max_ratio": 1.0}, "checks.0.ratio_to: a.honesty.unsafe_percent is one"),
        ({"difference_to": "a.height.rmse_mm", "max_difference": 1.0}, "a.height.rmse_mm is one of each"),
    ],
)
def test_checks_that_a_pooled_figure_cannot_answer_are_refused(check: dict[str, float], message: str) -> None:
    table = small_scenario(checks=[{"metric": "a.honesty.unsafe_percent", **check}])
    scenario = resolve(table, where="test")
    assert isinstance(scenario.checks[0], Check)
    with pytest.raises(BadInputError, match=message):
        require_known(scenario, ["a.honesty.unsafe_percent", "a.height.rmse_mm"], where="file.toml")
