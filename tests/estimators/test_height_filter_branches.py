"""What the height filter believes: wrong fixes, bad re-acquisitions, flapping, stuck and late heights, float."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.estimators.height_bench import Result, honesty, recovered, run
from tests.estimators.test_height_filter import ours
from twin.estimators.height_filter_branches import COASTING, CONTRADICTED, PROBATION, TRACKING, WAITING

MEMBERS = 100
BEGIN_S = 20.0


def through(*faults: dict[str, Any], end_s: float, members: int = MEMBERS, **options: Any) -> Result:
    """A run with these faults; an accelerometer whose offset is soon known keeps it short."""
    changes = {"accel_bias_m_s2": 0.002}
    return run({"ours": ours(**options)}, duration_s=end_s, members=members, faults=faults, ahrs_changes=changes)[
        "ours"
    ]


def at(result: Result, t_s: float) -> int:
    return int(np.argmin(np.abs(result.t_s - t_s)))


def modes(result: Result, t_s: float) -> np.ndarray:
    return result.extra["mode"][at(result, t_s)]


def is_honest(result: Result, from_s: float) -> None:
    """As required, less three standard errors of a share that ``MEMBERS`` slow errors tell."""
    found = honesty(result, from_s)
    assert found.inside >= 0.99 - 3.0 * np.sqrt(0.99 * 0.01 / MEMBERS)
    assert found.unsafe <= 0.001
    assert found.worst_ratio <= 1.5


def test_a_wrong_fix_out_of_tracking_is_refused_to_its_end() -> None:
    fault = {"kind": "wrong_fix", "offset_m": [0.0, 0.0, 0.2], "from_s": BEGIN_S, "to_s": BEGIN_S + 15.0}
    for vertical_speed in (True, False):
        found = through(fault, end_s=BEGIN_S + 20.0, vertical_speed=vertical_speed)
        is_honest(found, BEGIN_S)
        assert (modes(found, BEGIN_S + 10.0) == CONTRADICTED).all()
        # nobody follows 0.2 m: what is left is what coasting loses, three and a half sigma of it
        last = at(found, BEGIN_S + 15.0)
        assert (np.abs(found.error_m[last]) < 4.0 * found.sigma_m[last]).all()
        assert recovered(found, BEGIN_S + 15.0, 3.0) >= 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / MEMBERS)


def test_nobody_is_locked_out_for_good() -> None:
    """A fix that stays 2 m off is believed after the patience of 20 s."""
    found = through(
        {"kind": "wrong_fix", "offset_m": [0.0, 0.0, 2.0], "from_s": BEGIN_S}, end_s=BEGIN_S + 22.0, members=20
    )
    assert (np.abs(found.error_m[at(found, BEGIN_S + 19.5)]) < 0.5).all()
    assert (np.abs(found.error_m[-1] - 2.0) < 0.1).all()
    assert (modes(found, BEGIN_S + 22.0) == TRACKING).all()


def test_a_wrong_start_gives_way_as_soon_as_the_truth_has_lasted_as_long() -> None:
    found = through({"kind": "wrong_fix", "offset_m": [0.0, 0.0, 0.5], "to_s": 3.0}, end_s=8.0, members=20)
    assert (np.abs(found.error_m[at(found, 2.5)] - 0.5) < 0.1).all()
    assert (np.abs(found.error_m[at(found, 6.5)]) < 0.1).all()


@pytest.mark.parametrize("lost_s", [12.0, 25.0])
def test_fixes_that_are_all_wrong_at_first_are_not_believed(lost_s: float) -> None:
    faults = (
        {"kind": "corrections_lost", "from_s": BEGIN_S, "to_s": BEGIN_S + lost_s},
        {"kind": "bad_reacquisition", "offset_m": [0.0, 0.0, 0.2], "for_s": 1.0, "from_s": BEGIN_S},
    )
    found = through(*faults, end_s=BEGIN_S + lost_s + 20.0)
    is_honest(found, BEGIN_S)
    allowed = 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / MEMBERS)
    assert recovered(found, BEGIN_S + lost_s, 2.0 if lost_s <= 10.0 else 3.0) >= allowed
    # no member goes where the bad fixes are
    assert (np.abs(found.error_m) < 4.5 * found.sigma_m)[found.t_s > BEGIN_S].mean() > 0.9999
    assert (found.extra["mode"] == PROBATION).any(axis=0).mean() > 0.9


def test_after_a_short_loss_fixes_are_used_within_two_seconds() -> None:
    found = through({"kind": "outage", "from_s": BEGIN_S, "to_s": BEGIN_S + 5.0}, end_s=BEGIN_S + 9.0)
    is_honest(found, BEGIN_S)
    assert (modes(found, BEGIN_S + 4.0) == COASTING).all()
    assert recovered(found, BEGIN_S + 5.0, 2.0) >= 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / MEMBERS)


def test_flapping_does_no_harm() -> None:
    """Fixes are a third of what comes, for 20 s: they keep the height, and float and differential do not spoil it."""
    fault = {"kind": "flapping_quality", "qualities": [4, 5, 2], "changes_hz": 4.0, "from_s": BEGIN_S, "to_s": 40.0}
    found = through(fault, end_s=42.0)
    is_honest(found, BEGIN_S)
    before, within = honesty(found, 15.0, BEGIN_S), honesty(found, BEGIN_S, 40.0)
    # a loss of a second or two at times costs little
    assert within.rmse_m < 1.25 * before.rmse_m


def test_a_stuck_height_is_noticed() -> None:
    fault = {"kind": "stuck", "columns": ["position_u_m"], "from_s": BEGIN_S, "to_s": BEGIN_S + 15.0}
    found = through(fault, end_s=BEGIN_S + 19.0)
    is_honest(found, BEGIN_S)
    assert (modes(found, BEGIN_S + 5.0) == COASTING).all()
    assert recovered(found, BEGIN_S + 15.0, 3.0) >= 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / MEMBERS)


def test_what_a_stuck_height_did_before_it_was_refused_is_in_doubt() -> None:
    """Its digits move, so that nobody sees it stand still; until the plate has left it, it draws the state."""
    fault = {"kind": "stuck", "columns": ["position_u_m"], "noise": 0.001, "from_s": BEGIN_S, "to_s": BEGIN_S + 15.0}
    found = honesty(through(fault, end_s=BEGIN_S + 15.0, members=300), BEGIN_S)
    assert found.inside >= 0.985
    assert found.worst_bin_inside >= 0.97
    assert found.worst_ratio <= 1.5


def test_late_samples_are_put_where_they_belong() -> None:
    """Half a second late for 10 s: acceleration bridges it. Of two good estimates the one that knows less differs from
    the other by what it knows less: the mean square is the difference of their variances."""
    fault = {"kind": "latency_step", "latency_s": 0.5, "from_s": BEGIN_S, "to_s": BEGIN_S + 10.0}
    late, prompt = through(fault, end_s=BEGIN_S + 12.0), through(end_s=BEGIN_S + 12.0)
    is_honest(late, BEGIN_S)
    counted = (late.t_s > BEGIN_S + 1.0) & (late.t_s < BEGIN_S + 10.0)
    square = np.square(late.error_m[counted] - prompt.error_m[counted]).mean()
    variances = (np.square(late.sigma_m[counted]) - np.square(prompt.sigma_m[counted])).mean()
    assert square == pytest.approx(variances, rel=0.2)
    # all is made good when the last has come
    assert np.abs(late.error_m[-1] - prompt.error_m[-1]).max() < 1e-6


def test_float_is_not_believed_to_its_sigma() -> None:
    """40 s of float, which claims 26 mm and is decimetres off."""
    fault = {"kind": "satellites_masked", "satellites": 6, "from_s": BEGIN_S, "to_s": BEGIN_S + 40.0}
    found = through(fault, end_s=BEGIN_S + 41.0)
    is_honest(found, BEGIN_S)
    assert honesty(found, BEGIN_S + 30.0, BEGIN_S + 40.0).rmse_m < 0.1


def test_zero_covariance_means_unknown() -> None:
    fault = {"kind": "zero_covariance", "from_s": 0.0}
    found, plain = through(fault, end_s=12.0, members=5), through(end_s=12.0, members=5)
    np.testing.assert_array_equal(found.error_m, plain.error_m)


def test_modes_tell_the_story() -> None:
    found = through({"kind": "corrections_lost", "from_s": 5.0, "to_s": 18.0}, end_s=30.0, members=20)
    assert (modes(found, 0.1) == WAITING).all()
    assert (modes(found, 5.0) == TRACKING).all()
    assert (modes(found, 17.0) == COASTING).all()
    assert set(np.unique(found.extra["mode"])) <= {WAITING, TRACKING, COASTING, PROBATION}
