"""Faults inside the receiver: each does what it says inside its window and nothing outside."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, STANDING, Log, constant, drive, preset, sensor
from tests.sensors.test_gnss_errors import errors
from twin.errors import BadInputError

WINDOW = {"from_s": 10.0, "to_s": 20.0}


def log_with(*faults: dict[str, Any], runs: int = 1, until_s: float = 40.0, name: str = "rtk_f9p", **more: Any) -> Log:
    return drive(sensor(preset(name) | more | {"faults": list(faults)}, runs=range(runs)), STANDING, until_s)


def inside(log: Log) -> np.ndarray:
    return (log.t_s >= 10.0) & (log.t_s < 20.0)


def test_corrections_lost_stops_the_age_from_falling_until_they_are_back() -> None:
    age = log_with({"kind": "corrections_lost", **WINDOW}).values("age_s")[:, 0]
    # Those of 9 s arrive at 9.5 s and are the last, those of 20 s arrive at 20.5 s.
    t = np.arange(1, 401) / 10
    saw = 0.5 + (np.arange(1, 401) + 5) % 10 / 10
    np.testing.assert_allclose(age, np.where((t >= 10.0) & (t < 20.5), t - 9.0, saw), atol=1e-9)


def test_corrections_lost_at_a_place() -> None:
    shed = {"kind": "corrections_lost", "inside": {"east_m": [14.9, 29.9]}}
    log = drive(sensor(preset("rtk_f9p") | {"faults": [shed]}), constant(1.5), 40.0)
    by_time = drive(sensor(preset("rtk_f9p") | {"faults": [{"kind": "corrections_lost", **WINDOW}]}), STANDING, 40.0)
    # 1.5 m/s: inside from 10.0 to 19.9 s.
    np.testing.assert_array_equal(log.values("age_s"), by_time.values("age_s"))


def test_corrections_old_ramp_walks_down_the_whole_ladder() -> None:
    log = log_with({"kind": "corrections_old", "from_s": 10.0, "to_s": 330.0}, until_s=360.0, rate_hz=1.0)
    quality, age = log.values("quality")[:, 0], log.values("age_s")[:, 0]
    order = [quality[0], *quality[1:][np.diff(quality) != 0.0]]
    assert order[:4] == [4.0, 5.0, 2.0, 1.0]
    # A second a second, from the last that got through: those of 9 s (10 s and no delay yet: 9.5 s).
    down = (log.t_s >= 10.0) & (log.t_s < 309.0)
    np.testing.assert_allclose(age[down], log.t_s[down] - 9.0, atol=1e-9)
    # The backlog arrives as the window closes: 0.5 s old at best, 1 s at full seconds; and the receiver climbs.
    assert np.isnan(age[(329 - 1)])
    assert quality[-1] == 4.0
    assert age[-1] == 1.0


def test_corrections_old_by_a_constant_age_first_by_waiting_for_it() -> None:
    log = log_with({"kind": "corrections_old", "delay_s": 4.0, "growth": 0.0, **WINDOW})
    age, saw = log.values("age_s")[:, 0], 0.5 + (np.arange(1, 401) + 5) % 10 / 10
    # At 10.0 s, 1.0 s old; nothing new until those of 10 s arrive at 14.5 s.
    waiting = (log.t_s >= 10.0) & (log.t_s < 14.45)
    np.testing.assert_allclose(age[waiting], log.t_s[waiting] - 9.0, atol=1e-9)
    late = (log.t_s >= 14.45) & (log.t_s < 20.0)
    np.testing.assert_allclose(age[late], saw[late] + 4.0, atol=1e-9)
    outside = (log.t_s < 10.0) | (log.t_s >= 20.0)
    np.testing.assert_allclose(age[outside], saw[outside], atol=1e-9)
    assert np.all(log.values("quality") == 4.0)


def test_corrections_old_with_half_the_growth() -> None:
    log = log_with({"kind": "corrections_old", "growth": 0.5, "from_s": 10.0}, until_s=50.0)
    # At 50 s they are 20 s later than usual.
    assert 20.0 < log.values("age_s")[-1, 0] < 22.5


def test_wrong_fix_is_off_by_the_offset_under_a_small_sigma() -> None:
    plain = log_with(runs=20)
    log = log_with({"kind": "wrong_fix", "offset_m": [0.19, -0.1, 0.4], **WINDOW}, runs=20)
    off = errors(log) - errors(plain)
    np.testing.assert_array_equal(off[~inside(log)], 0.0)
    np.testing.assert_allclose(off[inside(log)], np.broadcast_to([0.19, -0.1, 0.4], off[inside(log)].shape), atol=1e-12)
    for column in ("quality", "sigma_e_m", "sigma_u_m", "satellites", "hdop"):
        np.testing.assert_array_equal(log.values(column), plain.values(column))


def test_a_given_offset_may_point_either_way_in_each_run_by_itself() -> None:
    runs = 400
    wrong = {"kind": "wrong_fix", "offset_m": [0.1, 0.0, 0.2], "either_sign": True, **WINDOW}
    off = (errors(log_with(wrong, runs=runs)) - errors(log_with(runs=runs)))[inside(log_with())]
    sign = np.sign(off[0, :, 2])
    np.testing.assert_allclose(off, np.broadcast_to(sign[:, np.newaxis] * [0.1, 0.0, 0.2], off.shape), atol=1e-12)
    # Half of 400: 2.5 %.
    assert np.mean(sign > 0.0) == pytest.approx(0.5, abs=4 * 0.025)
    alone = drive(sensor(preset("rtk_f9p") | {"faults": [wrong]}, runs=range(7, 8)), STANDING, 40.0)
    plain = drive(sensor(preset("rtk_f9p"), runs=range(7, 8)), STANDING, 40.0)
    np.testing.assert_allclose((errors(alone) - errors(plain))[inside(alone)][:, 0], off[:, 7], atol=1e-9)


def test_wrong_fix_says_fixed_where_the_receiver_would_float() -> None:
    masked = {"kind": "satellites_masked", "satellites": 6, **WINDOW}
    log = log_with(masked, {"kind": "wrong_fix", **WINDOW}, runs=500)
    assert np.all(log.values("quality")[inside(log)] == 4.0)
    assert log.values("sigma_e_m")[inside(log)].max() < 0.02
    # Drawn once a window: 0.2, 0.2, 0.38 m, constant within it. 500 runs: 3.2 %.
    window = errors(log)[inside(log)]
    np.testing.assert_allclose(np.std(window[0], axis=0), [0.2, 0.2, 0.38], rtol=4 * 0.032)
    # 10 s of a fix on 6 of 24 satellites: sqrt(21/3) * 5.3 mm up; nothing beside 0.38 m.
    assert np.std(window[-1] - window[0], axis=0).max() < 0.03


def test_wrong_fix_is_another_one_at_another_time() -> None:
    again = {"kind": "wrong_fix", "near": {"line": [[0.0, 0.0]], "within_m": 5.0}}
    motion = constant(2.0)
    back = lambda t0, t1: motion(t0 % 20.0, t0 % 20.0 + (t1 - t0))  # noqa: E731 - the same 40 m again and again

    device = sensor(preset("rtk_f9p") | {"faults": [again], "rate_hz": 1.0}, runs=range(500))
    samples = []
    before = 0.0
    while device.next_tick <= 21_000:
        t = device.next_tick * 0.002
        capture = back(before, t)
        object.__setattr__(capture, "t_ns", round(t * 1e9))
        samples.append(device.sample(capture))
        before = t
    log = Log(sensor=device, samples=samples, taken_ns=[])
    off = errors(log)[:, :, 0]
    first, second = off[1], off[20]
    assert np.std(first) == pytest.approx(0.2, rel=0.13)
    assert np.std(second) == pytest.approx(0.2, rel=0.13)
    assert abs(np.corrcoef(first, second)[0, 1]) < 4 / math.sqrt(500)


def test_zero_covariance_zeroes_what_is_claimed_and_nothing_else() -> None:
    plain = log_with(runs=5, name="rtk_f9p_dual")
    log = log_with({"kind": "zero_covariance", **WINDOW}, runs=5, name="rtk_f9p_dual")
    zeroed = {"sigma_e_m", "sigma_n_m", "sigma_u_m", "sigma_heading_rad"}
    for column in log.sensor.columns:
        expected = plain.values(column).copy()
        if column in zeroed:
            expected[inside(log)] = 0.0
        np.testing.assert_array_equal(log.values(column), expected)


def test_flapping_quality_changes_as_often_as_asked_and_the_error_follows() -> None:
    log = log_with({"kind": "flapping_quality", "qualities": [4, 5, 2], "changes_hz": 4.0, **WINDOW}, runs=200)
    quality = log.values("quality")
    assert np.all(quality[~inside(log)] == 4.0)
    flapping = quality[inside(log)]
    assert np.all(flapping[0] == 4.0)
    # 99 steps of 0.1 s in 200 runs, each a change with 0.4: standard error 0.35 %.
    assert np.mean(np.diff(flapping, axis=0) != 0.0) == pytest.approx(0.4, abs=4 * 0.0035)
    # In the long run a third each; correlated over 1/0.6 steps: 0.6 %, beginning in 4.
    for state in (5.0, 2.0):
        assert np.mean(flapping[20:] == state) == pytest.approx(1 / 3, abs=4 * 0.006)
    east, claimed = errors(log)[inside(log)][..., 0], log.values("sigma_e_m")[inside(log)]
    # Fixed 3.1 mm; differential 0.4 m. Float has 0.37 of its 0.12 m if it was entered from a fix, as half of the times;
    # nearly all of them from differential, settling with 3 s for 0.25 s on average: 0.95; and 0.03 m white.
    floating = math.hypot(0.12 * math.sqrt((0.37**2 + 0.95**2) / 2), 0.03)
    # Runs are independent: 5 %.
    for state, sigma, says in ((4.0, 0.0032, 0.0031), (5.0, floating, 0.006), (2.0, 0.403, 0.5)):
        assert np.std(east[flapping == state]) == pytest.approx(sigma, rel=0.2)
        assert np.mean(claimed[flapping == state]) == pytest.approx(says, rel=0.15)


def test_flapping_comes_back_to_the_same_fix() -> None:
    log = log_with({"kind": "flapping_quality", "qualities": [4, 2], "changes_hz": 5.0, **WINDOW}, runs=50)
    up = errors(log)[..., 2][inside(log)]
    fixed = log.values("quality")[inside(log)] == 4.0
    steps = [np.diff(up[fixed[:, run], run]) for run in range(50)]
    # Between fixes: white 1.7 mm * sqrt(2), age 1.4 mm; a new draw of the fix each time would be 5 mm * sqrt(2) more.
    assert np.std(np.concatenate(steps)) < 0.004


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"kind": "flapping_quality", "qualities": [4], "changes_hz": 1.0}, "at least 2 items"),
        ({"kind": "flapping_quality", "qualities": [4, 4], "changes_hz": 1.0}, "each may stand there once"),
        ({"kind": "wrong_fix", "offset_m": [1.0, 0.0, 0.0], "sigma_m": [1.0, 1.0, 1.0]}, "exclude one another"),
        ({"kind": "corrections_old", "growth": 1.5}, "less than or equal to 1"),
        ({"kind": "satellites_masked", "satellites": -1}, "greater than or equal to 0"),
    ],
)
def test_impossible_receiver_faults_are_refused(fault: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        CONFIGS.validate_python(preset("rtk_f9p") | {"faults": [fault]})


@pytest.mark.parametrize(
    ("name", "fault", "message"),
    [
        ("radar_99ppm", {"kind": "wrong_fix"}, r"faults\[0\]: 'wrong_fix' cannot happen to this kind of sensor"),
        (
            "single_point",
            {"kind": "wrong_fix"},
            r"faults\[0\]: this receiver has no state of quality 4",
        ),
        ("rtk_f9p", {"kind": "flapping_quality", "qualities": [4, 7], "changes_hz": 1.0}, "no state of quality 7"),
        ("rtk_f9p", {"kind": "flapping_quality", "qualities": [4, 5], "changes_hz": 11.0}, "more than one a sample"),
    ],
)
def test_faults_that_a_sensor_cannot_have_are_refused(name: str, fault: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        sensor(preset(name) | {"faults": [fault]})
