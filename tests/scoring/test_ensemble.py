"""Quantiles, confidence bounds, envelopes and consistency over many members."""

import math

import numpy as np
import pytest

from tests.small_scenario import small_scenario
from twin.scenario import resolve
from twin.scoring.ensemble import bound, judge_ensemble, nees_over_worlds, quantiles
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
        # Half a bin of a fiftieth of a decade: 10 ** (1 / 100) - 1 = 2.3 %.
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
def test_the_order_statistic_covers_the_quantile_with_its_confidence(upper: bool) -> None:
    rng = np.random.default_rng(2)
    trials, members, fraction, confidence = 3000, 200, 0.9, 0.95
    truth = -math.log(1.0 - fraction)
    bounds = [bound(rng.exponential(size=(1, members)), 100 * fraction, confidence, upper=upper) for _ in range(trials)]
    covered = np.mean([value >= truth if upper else value <= truth for value in bounds])
    # At least the confidence (the law is discrete); four standard errors of 3000 trials are 0.016.
    assert covered >= confidence - 0.016
    assert covered <= 0.99


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


def test_over_worlds_the_bound_is_wider_than_if_members_were_independent() -> None:
    rng = np.random.default_rng(3)
    # Each world shifts all its members: 20 worlds of 50 members are worth little more than 20 members.
    values = 1.0 + 0.1 * rng.normal(size=(20, 50)) + rng.normal(size=(20, 1))
    over_worlds = bound(values, 50.0, 0.95, upper=True)
    as_if_independent = bound(values.reshape(1, -1), 50.0, 0.95, upper=True)
    assert over_worlds > as_if_independent > np.median(values)


def test_a_consistent_filter_is_inside_its_nees_bounds_and_an_overconfident_one_is_not() -> None:
    rng = np.random.default_rng(4)
    t_ns = np.arange(200)
    honest = [(t_ns, rng.chisquare(5, size=200)) for _ in range(50)]
    found = nees_over_worlds(honest, 5)
    assert found is not None
    # 95 % of 200 independent instants; four standard errors are 6.2 %.
    assert abs(found.inside - 0.95) < 0.062
    # chi2(250) has mean 250 and standard deviation 22.4: bounds at about 5 +- 1.96 * 0.447.
    assert found.low == pytest.approx(5 - 0.876, abs=0.06)
    assert found.high == pytest.approx(5 + 0.876, abs=0.06)
    overconfident = nees_over_worlds([(t, 4.0 * values) for t, values in honest], 5)
    assert overconfident is not None
    assert overconfident.inside < 0.05
