"""Bad fixes as a receiver comes back to its fix: in each run at its own time, for a while, drawn anew each time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import Log, preset, sensor
from tests.sensors.test_gnss_height import I70, UNTOUCHED, inside, log_of, true_fix
from twin.errors import BadInputError
from twin.signals import FloatArray, IntArray

LOST = {"kind": "corrections_lost", "from_s": 10.0, "to_s": 38.0}


def first_fix(log: Log, after_s: float) -> IntArray:
    """(R,) index of the first sample of quality 4 after this time."""
    later = (log.values("quality") == 4.0) & (log.t_s > after_s - 1e-6)[:, np.newaxis]
    assert later.any(axis=0).all()
    return np.argmax(later, axis=0)


def offsets(log: Log, plain: Log) -> FloatArray:
    """(T, R, 3)."""
    columns = ("position_e_m.error", "position_n_m.error", "position_u_m.error")
    return np.stack([log.hidden(column) - plain.hidden(column) for column in columns], axis=-1)


def test_the_first_second_after_coming_back_is_off_by_one_offset_in_each_run_at_its_own_time() -> None:
    runs = 500
    plain = log_of(LOST, runs=runs, until_s=70.0)
    log = log_of(LOST, {"kind": "bad_reacquisition"}, runs=runs, until_s=70.0)
    off = offsets(log, plain)
    first = first_fix(log, 20.0)
    rows = np.arange(len(log.t_s))[:, np.newaxis]
    burst = (rows >= first) & (rows < first + 10)
    drawn = off[first, np.arange(runs)]
    np.testing.assert_allclose(off, np.where(burst[..., np.newaxis], drawn, 0.0), atol=1e-12)
    # 500 runs: 3.2 %.
    for axis, sigma in enumerate((0.2, 0.2, 0.38)):
        assert np.std(drawn[:, axis]) == pytest.approx(sigma, rel=4 * 0.032)
    assert np.std(log.t_s[first]) > 1.0
    for column in UNTOUCHED:
        np.testing.assert_array_equal(log.values(column), plain.values(column))
    np.testing.assert_array_equal(true_fix(log), (log.values("quality") == 4.0) & ~burst)


def test_each_coming_back_has_an_offset_of_its_own_and_only_those_in_the_window_have_one() -> None:
    again = LOST | {"from_s": 80.0, "to_s": 100.0}
    third = LOST | {"from_s": 150.0, "to_s": 170.0}
    bad = {"kind": "bad_reacquisition", "for_s": 0.5, "sigma_m": [0.0, 0.0, 0.1], "to_s": 140.0}
    runs = 300
    plain = log_of(LOST, again, third, runs=runs, until_s=210.0)
    off = offsets(log_of(LOST, again, third, bad, runs=runs, until_s=210.0), plain)[..., 2]
    column = np.arange(runs)
    one, two, three = (off[first_fix(plain, since), column] for since in (20.0, 90.0, 160.0))
    assert np.std(one) == pytest.approx(0.1, rel=4 * 0.041)
    assert np.std(two) == pytest.approx(0.1, rel=4 * 0.041)
    assert abs(np.corrcoef(one, two)[0, 1]) < 4 / math.sqrt(runs)
    np.testing.assert_array_equal(three, 0.0)
    # Five samples of 0.1 s each time.
    assert np.all(np.sum(np.abs(off) > 1e-12, axis=0) == 10)


def test_a_given_offset_is_cut_off_with_the_window_and_returns_with_every_flap() -> None:
    bad = {"kind": "bad_reacquisition", "for_s": 1.0, "offset_m": [0.0, 0.0, -0.2], "to_s": 20.0}
    flap = {"kind": "flapping_quality", "qualities": [4, 2], "changes_hz": 3.0, "from_s": 10.0, "to_s": 30.0}
    plain, log = log_of(flap, runs=20, until_s=40.0), log_of(flap, bad, runs=20, until_s=40.0)
    off = offsets(log, plain)[..., 2]
    quality = log.values("quality")
    entered = (quality[1:] == 4.0) & (quality[:-1] != 4.0)
    open_now = inside(log, 10.0, 20.0)[1:, np.newaxis]
    np.testing.assert_allclose(off[1:][entered & open_now], -0.2, atol=1e-12)
    assert (entered & open_now).sum() > 100
    np.testing.assert_array_equal(off[~inside(log, 10.0, 20.0)], 0.0)
    np.testing.assert_array_equal(off[quality == 2.0], 0.0)


def test_time_and_sign_may_be_drawn_for_each_run_and_each_time() -> None:
    bad = {"kind": "bad_reacquisition", "offset_m": [0.0, 0.0, 0.2], "either_sign": True, "for_least_s": 0.2,
           "for_s": 1.0}  # fmt: skip
    again = LOST | {"from_s": 80.0, "to_s": 100.0}
    runs = 400
    plain = log_of(LOST, again, runs=runs, until_s=130.0)
    off = offsets(log_of(LOST, again, bad, runs=runs, until_s=130.0), plain)[..., 2]
    np.testing.assert_allclose(np.abs(off[np.abs(off) > 1e-9]), 0.2, atol=1e-12)
    column = np.arange(runs)
    halves = off[: len(off) * 6 // 10], off[len(off) * 6 // 10 :]
    lasted_s = [0.1 * np.sum(np.abs(half) > 1e-9, axis=0) for half in halves]
    signs = [np.sign(off[first_fix(plain, since), column]) for since in (20.0, 90.0)]
    for lasted, sign in zip(lasted_s, signs, strict=True):
        # Evenly from 0.2 to 1 s, the last sample within: a mean of 0.65 s, give or take 0.24 / 20.
        assert lasted.min() >= 0.2 - 1e-9
        assert lasted.max() <= 1.0 + 1e-9
        assert np.mean(lasted) == pytest.approx(0.65, abs=4 * 0.012)
        assert np.std(lasted) == pytest.approx(0.8 / math.sqrt(12.0), rel=0.1)
        assert np.mean(sign > 0.0) == pytest.approx(0.5, abs=4 * 0.025)
    for one, two in (lasted_s, signs, (lasted_s[0], signs[0])):
        assert abs(np.corrcoef(one, two)[0, 1]) < 4 / math.sqrt(runs)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"either_sign": True}, "either_sign goes with offset_m"),
        ({"for_least_s": 2.0}, "for_least_s = 2: longer than for_s = 1"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        sensor(preset(I70) | {"faults": [{"kind": "bad_reacquisition", **options}]})


def test_a_receiver_that_cannot_fix_cannot_fix_badly() -> None:
    with pytest.raises(BadInputError, match="no state of quality 4"):
        sensor(preset("single_point") | {"faults": [{"kind": "bad_reacquisition"}]})
    with pytest.raises(BadInputError, match="cannot happen to this kind of sensor"):
        sensor(preset("ahrs_mti300") | {"faults": [{"kind": "bad_reacquisition"}]})
