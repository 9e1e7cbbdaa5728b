"""Heights: errors in mm, how long they keep within 30 mm, what happens when fixes come back."""

import math

import numpy as np
import pytest

from tests.scoring.heights import estimate_of, fixes_at, heights, lossy, scored, times
from twin.errors import BadInputError
from twin.scoring.metrics import metric_names


def test_errors_are_told_in_mm_with_their_sign_and_by_phase() -> None:
    scenario = lossy(30.0, (10.0, 20.0), from_s=5.0)
    truth, t_s = heights(30.0), times(30.0)
    errors = np.where(t_s < 5.0, 9.0, np.where(t_s < 10.0, -0.002, np.where(t_s < 20.0, -0.010, 0.004)))
    found = scored(scenario, truth, estimate_of(truth, errors)).metrics()
    # 5 s of -2 mm, 10 s of -10 mm, 10 s of 4 mm.
    assert found["one.height.mean_error_mm"] == pytest.approx((5 * -2 + 10 * -10 + 10 * 4) / 25)
    assert found["one.height.rmse_mm"] == pytest.approx(math.sqrt((5 * 4 + 10 * 100 + 10 * 16) / 25))
    assert found["one.height.max_abs_error_mm"] == pytest.approx(10.0)
    assert found["one.height.rmse_loss_mm"] == pytest.approx(10.0)
    assert found["one.height.mean_error_loss_mm"] == pytest.approx(-10.0)
    assert found["one.height.mean_error_after_mm"] == pytest.approx(4.0)
    assert found["one.height.time_to_30mm_s"] == math.inf


def test_the_percentile_over_time_is_within_a_bin_of_the_exact_one_for_each_member() -> None:
    scenario, truth = lossy(60.0, (20.0, 40.0)), heights(60.0)
    errors = np.random.default_rng(1).normal(scale=[0.001, 0.02, 0.3], size=(len(truth), 3))
    found = scored(scenario, truth, estimate_of(truth, errors), piece_s=7.0).metrics()
    exact = np.quantile(np.abs(errors), 0.95, axis=0)
    # A hundred bins to a decade: 10 ** (1 / 100) - 1 = 2.3 %.
    np.testing.assert_allclose(found["one.height.p95_abs_error_mm"], 1000 * exact, rtol=0.024)
    exact = np.quantile(np.abs(errors[1000:2000]), 0.95, axis=0)
    np.testing.assert_allclose(found["one.height.p95_abs_error_loss_mm"], 1000 * exact, rtol=0.024)


def test_a_height_that_is_not_known_has_no_percentile() -> None:
    scenario, truth = lossy(10.0, None), heights(10.0)
    errors = np.full((len(truth), 2), 0.01)
    errors[7, 1] = np.nan
    found = scored(scenario, truth, estimate_of(truth, errors)).metrics()["one.height.p95_abs_error_mm"]
    assert found[0] == pytest.approx(10.0, rel=0.024)
    assert math.isnan(found[1])


@pytest.mark.parametrize("piece_s", [1e4, 0.7])
def test_time_to_30_mm_is_the_first_excess_since_the_loss(piece_s: float) -> None:
    # Members drift by 2 and 1 mm/s from the loss on: 30 mm after 15 s, and never in the 20 s that it lasts.
    scenario, truth = lossy(40.0, (10.0, 30.0), limits={"height": 0.0101}), heights(40.0)
    since = np.maximum(times(40.0) - 10.0, 0.0)[:, np.newaxis]
    estimate = estimate_of(truth, since * np.array([-0.002, 0.001]))
    found = scored(scenario, truth, estimate, piece_s=piece_s).metrics()
    np.testing.assert_allclose(found["one.height.time_to_30mm_s"], [15.0, np.inf], atol=0.021)
    np.testing.assert_allclose(found["one.height.time_to_limit_s"], [5.06, 10.12], atol=0.021)


@pytest.mark.parametrize("piece_s", [1e4, 0.7])
def test_the_jump_is_the_largest_step_of_the_error_in_the_4_seconds_after_the_first_true_fix(piece_s: float) -> None:
    scenario, truth, t_s = lossy(40.0, (10.0, 30.0), fixes_of="gnss"), heights(40.0), times(40.0)
    errors = np.zeros((len(truth), 4))
    # The first member's fix comes 2 s late, at 32 s; it is 40 mm off, jumps by 45 mm at 32.2 s, back by 5 mm later.
    errors[:, 0] = np.where(t_s < 32.2, 0.040, np.where(t_s < 32.6, -0.005, 0.0))
    # The second jumps by 20 mm before its fix and by 30 mm more than 4 s after it, by 1 mm in between.
    errors[:, 1] = np.where(t_s < 30.5, 0.051, np.where(t_s < 31.5, 0.031, np.where(t_s < 35.5, 0.030, 0.0)))
    # The third believes its fix of 31 s after 1.5 s.
    errors[:, 2] = np.where(t_s < 31.1, 0.060, np.where(t_s < 32.5, 0.057, 0.0))
    # The fourth never sees a fix again.
    fixes = fixes_at(40.0, 32.0, 31.0, 31.0, 99.0, until_s=10.0)
    found = scored(scenario, truth, estimate_of(truth, errors), fixes, piece_s).metrics()
    np.testing.assert_allclose(found["one.height.jump_at_reacquisition_mm"], [45.0, 1.0, 57.0, np.nan], rtol=1e-9)


@pytest.mark.parametrize("piece_s", [1e4, 0.7, 0.02])
def test_recovered_is_who_is_within_30_mm_and_says_15_mm_for_a_second(piece_s: float) -> None:
    scenario, truth, t_s = lossy(40.0, (10.0, 30.0), fixes_of="gnss"), heights(40.0), times(40.0)[:, np.newaxis]
    errors, sigmas = np.zeros((len(truth), 6)), np.full((len(truth), 6), 0.010)
    fixes = fixes_at(40.0, 30.0, 30.0, 31.0, 31.0, 31.0, 99.0, until_s=20.0)
    errors[:, :1] = np.where(t_s < 30.4, 0.1, 0.0)  # 0.4 s after the fix
    sigmas[:, 1:2] = np.where(t_s < 31.0, 0.02, 0.015)  # 1 s after it; 15 mm is enough
    # Well from the fix on, but for the blink of an epoch at 31.9 s.
    errors[:, 2:3] = np.where(np.isclose(t_s, 31.9), -0.031, 0.029)
    errors[:, 3:4] = np.where(t_s < 39.5, 0.04, 0.0)  # well for half a second before the end: not shown to last
    # The fifth is well all the time: it has recovered when the fix comes, not before; the sixth has no fix.
    found = scored(scenario, truth, estimate_of(truth, errors, sigmas), fixes, piece_s).metrics()
    expected = [0.4, 1.0, 0.92, np.inf, 0.0, np.nan]
    np.testing.assert_allclose(found["one.height.recovery_s"], expected, atol=1e-9)


def test_who_claims_no_sigma_has_no_recovery() -> None:
    scenario, truth = lossy(20.0, (5.0, 10.0), fixes_of="gnss"), heights(20.0)
    scorer = scored(scenario, truth, estimate_of(truth, np.zeros(len(truth))), fixes_at(20.0, 10.0))
    assert math.isnan(scorer.metrics()["one.height.recovery_s"][0])
    assert scorer.honesty()["one"].members.tolist() == [0, 0, 0]


def test_what_comes_in_hindsight_is_scored_with_the_fixes_before_it() -> None:
    scenario, truth = lossy(20.0, (5.0, 10.0), fixes_of="gnss"), heights(20.0)
    estimate = estimate_of(truth, np.where(times(20.0) < 11.0, 0.05, 0.0), 0.01)
    whole = scored(scenario, truth, estimate, fixes_at(20.0, 10.5)).metrics()
    scorer = scored(scenario, truth, estimate_of(truth, np.zeros(len(truth)))).__class__(
        scenario, truth.columns, {"one": estimate.columns}
    )
    nothing = type(estimate)(columns=estimate.columns, t_ns=estimate.t_ns[:0], values=estimate.values[:0])
    scorer.add(truth, {"one": nothing}, fixes_at(20.0, 10.5))
    scorer.add(truth, {"one": estimate})
    assert scorer.metrics()["one.height.recovery_s"] == whole["one.height.recovery_s"] == pytest.approx(0.5)


def test_names_known_beforehand_are_those_that_come_out() -> None:
    scenario, truth = lossy(20.0, (5.0, 10.0), fixes_of="gnss"), heights(20.0)
    estimate = estimate_of(truth, np.zeros(len(truth)), 0.01)
    scorer = scored(scenario, truth, estimate, fixes_at(20.0, 10.0))
    names = metric_names(scenario, truth.columns, {"one": estimate.columns})
    assert [name for name in names if ".honesty." not in name] == list(scorer.metrics())


@pytest.mark.parametrize(
    ("scoring", "message"),
    [
        ({"fixes_of": "gns"}, "scoring.fixes_of: unknown GNSS receiver 'gns'; did you mean 'gnss'"),
        ({"fixes_of": "radar"}, "scoring.fixes_of: unknown GNSS receiver 'radar'"),
        ({"limits": {"heightt": 0.03}}, "scoring.limits: unknown family 'heightt'; did you mean 'height'"),
        ({"limits": {"speed": 0.03}}, "scoring.limits: unknown family 'speed'"),
    ],
)
def test_wrong_names_are_refused(scoring: dict[str, object], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        lossy(20.0, None, **scoring)
