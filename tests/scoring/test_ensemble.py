"""Quantiles, confidence bounds, envelopes and consistency over many members."""

import math

import numpy as np
import pytest
from scipy import stats

from tests.small_scenario import small_scenario
from twin.scenario import resolve
from twin.scoring.ensemble import bound, judge_ensemble, over_worlds, quantiles
from twin.scoring.envelopes import Envelope


def test_envelope_quantiles_are_those_of_the_errors_within_a_bin() -> None:
    rng = np.random.default_rng(1)
    errors = np.abs(rng.normal(size=(20, 4000))) * np.logspace(-4, 1, 20)[:, np.newaxis]
    t_ns = np.arange(20) * 200_000_000
    envelope, halves = Envelope.at(t_ns), [Envelope.at(t_ns), Envelope.at(t_ns)]
    envelope.add(t_ns, errors)
    halves[0].add(t_ns[:9], errors[:9])
    halves[0].add(t_ns[9:], errors[9:, :1000])
    halves[1].add(t_ns[9:], errors[9:, 1000:])
    halves[0].merge(halves[1])
    np.testing.assert_array_equal(envelope.counts, halves[0].counts)
    for fraction in (0.05, 0.5, 0.95):
        # One bin of a fiftieth of a decade: 10 ** (1 / 50) - 1 = 4.7 %.
        np.testing.assert_allclose(envelope.quantile(fraction), np.quantile(errors, fraction, axis=1), rtol=0.047)


def test_envelopes_pass_over_what_is_unknown_and_instants_that_are_not_theirs() -> None:
    envelope = Envelope.at(np.array([0, 10]))
    envelope.add(np.array([0, 5, 10]), np.array([[1.0, math.nan], [1.0, 1.0], [0.0, math.inf]]))
    assert envelope.counts.sum(axis=1).tolist() == [1, 2]
    assert math.isnan(Envelope.at(np.array([0])).quantile(0.5)[0])


def test_quantiles_count_never_as_the_largest_and_leave_out_the_unknown() -> None:
    values = np.array([[1.0, 2.0, 3.0, math.inf, math.nan]])
    assert quantiles(values)[0] == 1.0
    assert quantiles(values)[2] == math.inf


@pytest.mark.parametrize("upper", [True, False])
@pytest.mark.parametrize("worlds", [1, 100])
def test_a_bound_covers_what_it_speaks_of_with_its_confidence(upper: bool, worlds: int) -> None:
    rng = np.random.default_rng(2)
    trials, members, fraction, confidence = 1000, 200, 0.9, 0.95
    covered = 0
    for _ in range(trials):
        if worlds == 1:
            values = rng.normal(size=(1, members))
            truth = stats.norm.ppf(fraction)
        else:
            # Twenty members a world, shifted together: the 90 % quantile of a world is its shift and 1.28 of 0.1.
            values = rng.normal(size=(worlds, 1)) + 0.1 * rng.normal(size=(worlds, 20))
            truth = stats.norm.ppf(fraction)
        found = bound(values, 100 * fraction, confidence, upper=upper)
        covered += found >= truth if upper else found <= -truth
    # At least the confidence (the law is discrete); four standard errors of 1000 trials are 0.028.
    assert covered / trials >= confidence - 0.028


def test_too_few_members_for_a_confidence_fail_the_check() -> None:
    # With 10 members no order statistic lies above the 95 % quantile with 95 % confidence: 1 - 0.95 ** 10 = 40 %.
    check = {"metric": "a", "max": 100.0, "percentile": 95.0, "confidence": 0.95}
    scenario = resolve(small_scenario(checks=[check]), where="test")
    assert not judge_ensemble(scenario, {"a": np.ones((1, 10))})[0].ok
    # 59 is the classical number: 1 - 0.95 ** 59 = 95.2 %.
    assert not judge_ensemble(scenario, {"a": np.ones((1, 58))})[0].ok
    assert judge_ensemble(scenario, {"a": np.ones((1, 59))})[0].ok


def test_members_without_a_value_fail_the_check() -> None:
    scenario = resolve(small_scenario(checks=[{"metric": "a", "max": 1.0, "percentile": 50.0}]), where="test")
    assert not judge_ensemble(scenario, {"a": np.array([[0.1, 0.1, math.nan]])})[0].ok
    assert judge_ensemble(scenario, {"a": np.array([[0.1, 0.1, 0.2]])})[0].ok


def test_a_minimum_is_kept_by_at_least_the_percentile_of_the_members() -> None:
    values = np.arange(100.0)[np.newaxis]
    for percentile, minimum, holds in ((95.0, 4.0, True), (95.0, 7.0, False), (5.0, 94.0, True), (5.0, 97.0, False)):
        check = {"metric": "a", "min": minimum, "percentile": percentile}
        scenario = resolve(small_scenario(checks=[check]), where="test")
        assert judge_ensemble(scenario, {"a": values})[0].ok is holds, check


def test_ratios_are_taken_member_by_member() -> None:
    base = np.array([[1.0, 10.0, 100.0]])
    check = {"metric": "a", "ratio_to": "b", "max_ratio": 0.5, "percentile": 100.0}
    scenario = resolve(small_scenario(checks=[check]), where="test")
    assert judge_ensemble(scenario, {"a": 0.5 * base, "b": base})[0].ok
    assert not judge_ensemble(scenario, {"a": 0.5 * base[:, ::-1], "b": base})[0].ok


def test_differences_are_taken_member_by_member_and_without_a_percentile_are_about_their_mean() -> None:
    base = np.array([[1.0, 10.0, 100.0]])
    asked = {"metric": "a", "difference_to": "b", "max_difference": 0.25}
    of_all = resolve(small_scenario(checks=[asked | {"percentile": 100.0}]), where="test")
    assert judge_ensemble(of_all, {"a": base + 0.25, "b": base})[0].ok
    assert not judge_ensemble(of_all, {"a": base[:, ::-1], "b": base})[0].ok
    of_mean = resolve(small_scenario(checks=[asked]), where="test")
    assert judge_ensemble(of_mean, {"a": base[:, ::-1], "b": base})[0].ok
    assert not judge_ensemble(of_mean, {"a": base + np.array([0.0, 0.0, 1.0]), "b": base})[0].ok


def test_never_keeps_a_minimum_and_breaks_a_maximum() -> None:
    never = {"a": np.full((1, 3), math.inf)}
    assert judge_ensemble(resolve(small_scenario(checks=[{"metric": "a", "min": 28.0}]), where="test"), never)[0].ok
    assert not judge_ensemble(resolve(small_scenario(checks=[{"metric": "a", "max": 28.0}]), where="test"), never)[0].ok


def test_nis_over_worlds_is_held_to_its_degrees_of_freedom() -> None:
    rng = np.random.default_rng(5)
    t_ns = np.arange(400)
    worlds = [(t_ns, rng.chisquare(2, size=400)) for _ in range(50)]
    found = over_worlds("nis_gnss_position", worlds, 2)
    assert found is not None
    # chi2(100) / 50 has mean 2 and standard deviation 0.283; 95 % of 400 instants, give or take four standard errors.
    assert found.high - found.low == pytest.approx(2 * 1.96 * 0.283, rel=0.02)
    assert abs(found.inside - 0.95) < 0.044
    wrong = over_worlds("nis_gnss_position", [(t, 1.5 * values) for t, values in worlds], 2)
    assert wrong is not None
    assert wrong.inside < 0.5


def test_a_consistent_filter_is_inside_its_nees_bounds_and_an_overconfident_one_is_not() -> None:
    rng = np.random.default_rng(4)
    t_ns = np.arange(200)
    honest = [(t_ns, rng.chisquare(5, size=200)) for _ in range(50)]
    found = over_worlds("nees", honest, 5)
    assert found is not None
    # 95 % of 200 independent instants; four standard errors are 6.2 %.
    assert abs(found.inside - 0.95) < 0.062
    # chi2(250) has mean 250 and standard deviation 22.4: bounds at about 5 +- 1.96 * 0.447.
    assert found.low == pytest.approx(5 - 0.876, abs=0.06)
    assert found.high == pytest.approx(5 + 0.876, abs=0.06)
    overconfident = over_worlds("nees", [(t, 4.0 * values) for t, values in honest], 5)
    assert overconfident is not None
    assert overconfident.inside < 0.05


def test_only_instants_that_all_worlds_have_count() -> None:
    """Worlds arrive at their own times: of 1, 2, 3 and 2, 3, 4 there are 2 and 3, with means 3 and 5."""
    one = np.array([1, 2, 3]), np.array([100.0, 2.0, 4.0])
    other = np.array([2, 3, 4]), np.array([4.0, 6.0, 100.0])
    found = over_worlds("nees", [one, other], 4)
    assert found is not None
    assert (found.worlds, found.degrees, found.mean) == (2, 4, 4.0)
    # chi2 with 8 degrees of freedom: 2.180 and 17.535 (tables), by two worlds.
    assert found.low == pytest.approx(1.090, abs=1e-3)
    assert found.high == pytest.approx(8.767, abs=1e-3)
    assert found.inside == 1.0
    assert over_worlds("nees", [one, (np.array([7]), np.array([1.0]))], 4) is None
    assert over_worlds("nees", [], 4) is None
