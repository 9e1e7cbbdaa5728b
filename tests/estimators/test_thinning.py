"""What averaging and picking do to a signal, worked out by hand; then the filter at a lower rate."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.estimators.planter import (
    IMUS,
    ROWS_Y,
    STEP_NS,
    STEP_S,
    gnss,
    make_setup,
    measurement,
    motion,
    profile,
    radar,
    report,
    sensors,
    stream,
)
from tests.estimators.test_row_speed_ekf import NOISE, TRACK, column, make, member, play
from twin.errors import BadInputError
from twin.estimators.thinning import Thinner, Thinning, ticks_per_sample
from twin.estimators.ticks import Tick
from twin.signals import FloatArray, Measurement

N = 5
"""50 Hz to 10 Hz."""


def thinner(thinning: Thinning = "moving_average", *, ticks: int = N) -> Thinner:
    return Thinner(ticks=ticks, thinning=thinning, sensors=("radar", "gnss"), step_ns=STEP_NS)


def tick(index: int, *samples: Measurement, steps: int = 1) -> Tick:
    return Tick(index, steps, [(sample, True) for sample in samples])


def thinned(speeds: FloatArray, thinning: Thinning, *, ticks: int = N) -> FloatArray:
    """A radar's speeds (T,) or (T, R) of ticks 1, 2, ... at the lower rate, (T / n, R)."""
    one = thinner(thinning, ticks=ticks)
    complete = [one.add(tick(index, radar(index * STEP_NS, speed))) for index, speed in enumerate(speeds, start=1)]
    return np.array([each.samples[0][0].values[:, 0] for window in complete for each in window])


def test_averages_hold_their_window_and_are_stamped_at_its_end() -> None:
    one = thinner()
    complete = [one.add(tick(index, radar(index * STEP_NS, float(index)))) for index in range(1, 11)]
    assert [len(each) for each in complete] == [0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    first, second = complete[4][0], complete[9][0]
    assert (first.index, first.steps, second.index, second.steps) == (1, 1, 2, 1)
    sample, fresh = second.samples[0]
    assert fresh
    assert sample.t_ns == sample.t_available_ns == 10 * STEP_NS
    np.testing.assert_array_equal(sample.values, [[8.0]])  # mean of 6 .. 10
    assert first.samples[0][0].values[0, 0] == 3.0


@pytest.mark.parametrize(("thinning", "delay_samples"), [("moving_average", (N - 1) / 2), ("decimation", 0.0)])
def test_a_mean_says_what_was_true_two_samples_before_its_stamp(thinning: Thinning, delay_samples: float) -> None:
    """A ramp of 0.5 m/s^2: at its stamp k the mean of five is 0.5 T (k - 2)."""
    k = np.arange(1, 51)
    found = thinned(0.5 * STEP_S * k, thinning)[:, 0]
    np.testing.assert_allclose(found, 0.5 * STEP_S * (k[N - 1 :: N] - delay_samples), rtol=1e-12)


@pytest.mark.parametrize(("thinning", "factor"), [("moving_average", 1.0 / math.sqrt(N)), ("decimation", 1.0)])
def test_white_noise_falls_by_the_root_of_n_only_in_a_mean(thinning: Thinning, factor: float) -> None:
    """10 000 samples at the lower rate: their standard deviation is known to 0.7 %; five times that is allowed."""
    noise = np.random.default_rng(1).normal(size=(500, 100))
    found = thinned(noise, thinning)
    assert found.std() == pytest.approx(factor, rel=5.0 / math.sqrt(2.0 * found.size))


def test_a_vibration_at_the_new_rate_is_a_constant_to_who_picks_and_nothing_to_who_averages() -> None:
    """10 Hz, 50 samples a second, seen ten times a second: always the same place of the wave, sin(0.7)."""
    k = np.arange(1, 251)
    wave = np.sin(2.0 * math.pi * 10.0 * STEP_S * k + 0.7)
    np.testing.assert_allclose(thinned(wave, "decimation"), math.sin(0.7), atol=1e-12)
    np.testing.assert_allclose(thinned(wave, "moving_average"), 0.0, atol=1e-12)


def test_a_faster_vibration_comes_back_as_a_slow_one() -> None:
    """12 Hz picked at 10 Hz is 2 Hz; the mean lets through sin(5 x) / (5 sin x) of it, x = pi 12 / 50."""
    k = np.arange(1, 501)
    wave = np.sin(2.0 * math.pi * 12.0 * STEP_S * k)
    at_s = STEP_S * k[N - 1 :: N]
    np.testing.assert_allclose(thinned(wave, "decimation")[:, 0], np.sin(2.0 * math.pi * 2.0 * at_s), atol=1e-9)
    x = math.pi * 12.0 * STEP_S
    gain = math.sin(N * x) / (N * math.sin(x))
    middle = np.sin(2.0 * math.pi * 12.0 * (at_s - 2.0 * STEP_S))
    np.testing.assert_allclose(thinned(wave, "moving_average")[:, 0], gain * middle, atol=1e-9)


def test_lost_samples_count_for_nothing_member_by_member() -> None:
    one = thinner(ticks=2)
    one.add(tick(1, radar(STEP_NS, [1.0, 1.0, np.nan], valid=[True, True, False])))
    sample = one.add(tick(2, radar(2 * STEP_NS, [3.0, np.nan, np.nan], valid=[True, False, False])))[0].samples[0][0]
    np.testing.assert_array_equal(sample.values[:, 0], [2.0, 1.0, np.nan])
    np.testing.assert_array_equal(sample.valid, [True, True, False])
    picking = thinner("decimation", ticks=2)
    picking.add(tick(1, radar(STEP_NS, [1.0, 1.0, np.nan], valid=[True, True, False])))
    picked = picking.add(tick(2, radar(2 * STEP_NS, [3.0, 9.0, 9.0], valid=[True, False, False])))[0].samples[0][0]
    np.testing.assert_array_equal(picked.values[:, 0], [3.0, 1.0, np.nan])


def test_position_and_speed_are_averaged_but_not_quality_and_sigma() -> None:
    one = thinner(ticks=10)
    one.add(tick(5, report("gnss", 5 * STEP_NS, 1.0, 10.0, 2.0, sigma_m=0.01, quality=4)))
    both = one.add(tick(10, report("gnss", 10 * STEP_NS, 3.0, 14.0, 3.0, sigma_m=0.4, quality=5)))[0].samples[0][0]
    by_name = dict(zip(both.columns, both.values[0], strict=True))
    assert [by_name[name] for name in ("position_e_m", "position_n_m", "speed_m_s")] == [2.0, 12.0, 2.5]
    assert (by_name["quality"], by_name["sigma_e_m"]) == (5.0, 0.4)


def test_who_samples_slower_than_the_filter_passes_as_it_is() -> None:
    one = thinner()
    samples = {3: 1.0, 13: 2.0}  # 5 Hz into 10 Hz
    found = {}
    for index in range(1, 21):
        arrived = [radar(index * STEP_NS, 0.0)]
        if index in samples:
            arrived.append(measurement("gnss", index * STEP_NS, [samples[index]], columns=("speed_m_s",)))
        for each in one.add(tick(index, *arrived)):
            found[each.index] = {sample.sensor: sample.values[0, 0] for sample, _ in each.samples}
    without = {"radar": 0.0}
    assert found == {1: {**without, "gnss": 1.0}, 2: without, 3: {**without, "gnss": 2.0}, 4: without}


def test_a_window_whose_end_never_came_is_handed_on_by_the_next() -> None:
    one = thinner()
    for index in (1, 2, 3):
        assert one.add(tick(index, radar(index * STEP_NS, float(index)))) == []
    late = one.add(tick(18, radar(18 * STEP_NS, 7.0)))
    assert [(each.index, each.samples[0][0].values[0, 0]) for each in late] == [(1, 2.0)]
    after = one.add(tick(20, radar(20 * STEP_NS, 9.0)))
    assert [(each.index, each.steps, each.samples[0][0].values[0, 0]) for each in after] == [(4, 3, 8.0)]


def test_what_comes_after_its_window_counts_in_the_next() -> None:
    one = thinner()
    assert len(one.add(tick(5, radar(5 * STEP_NS, 1.0)))) == 1
    assert one.add(tick(5, radar(5 * STEP_NS - 1, 2.0), steps=0)) == []
    found = one.add(tick(10, radar(10 * STEP_NS, 4.0)))
    assert found[0].samples[0][0].values[0, 0] == 3.0


@pytest.mark.parametrize("rate_hz", [30.0, 100.0, 20.0])
def test_the_units_rate_has_to_be_a_multiple(rate_hz: float) -> None:
    with pytest.raises(BadInputError, match=r"input_rate_hz = .* whole multiple"):
        make(input_rate_hz=rate_hz)
    assert ticks_per_sample(50.0, 50.0, where="") == 1


# --- the filter behind it --------------------------------------------------------------------------------------------


def test_at_the_units_own_rate_nothing_changes() -> None:
    ticks = stream(*TRACK, **NOISE)
    plain, same = (play(make(**options), ticks) for options in ({}, {"input_rate_hz": 50.0}))
    for a, b in zip(plain, same, strict=True):
        np.testing.assert_array_equal(a.values, b.values)


@pytest.mark.parametrize("thinning", ["moving_average", "decimation"])
def test_row_speeds_converge_at_10_hz(thinning: Thinning) -> None:
    """Constant motion has no delay: a circle is found as at 50 Hz. (1 - K)^k, K = 0.031, is 1e-4 after 290 steps."""
    speed, rate = profile((2.0, 0.0, 0.0), (5.0, 2.5, 0.0), (45.0, 2.5, 0.25))
    estimator = make(input_rate_hz=10.0, thinning=thinning)
    last = play(estimator, stream(speed, rate))[-1]
    values = dict(zip(estimator.columns, last.values[0], strict=True))
    for row, y in enumerate(ROWS_Y, start=1):
        assert values[f"row_speed_{row}_m_s"] == pytest.approx(2.5 - 0.25 * y, abs=1e-4)


def test_the_process_noise_is_added_once_per_step_whatever_the_rate() -> None:
    """The steady variance of the speed is that of its gain K R, K^2 / (1 - K) = Q / R: the same at 50 and 10 Hz."""
    speed, rate = profile((2.0, 0.0, 0.0), (5.0, 2.5, 0.0), (45.0, 2.5, 0.0))
    gain = 0.5 * (math.sqrt(1e-3**2 + 4e-3) - 1e-3)
    for input_rate_hz in (50.0, 10.0):
        estimator = make(input_rate_hz=input_rate_hz)
        last = play(estimator, stream(speed, rate))[-1]
        sigma = last.sigmas[0, estimator.columns.index("speed_m_s")]
        assert sigma**2 == pytest.approx(gain * 0.1, rel=1e-3)


def test_a_slow_filter_holds_its_speed_between_its_steps() -> None:
    estimator = make(input_rate_hz=1.0)
    estimates = play(estimator, stream(*TRACK, **NOISE))
    speed = column(estimator, estimates, "speed_m_s")[:, 0]
    jumps = np.flatnonzero(np.diff(speed) != 0.0) + 2  # tick of the new value, counted from 1
    assert len(jumps) > 20
    assert np.all(jumps % 50 == 0)


def test_calibration_takes_as_long_as_at_the_full_rate() -> None:
    """Biases of 0.3 m/s^2 and 0.02 rad/s, calibrated away in the first 2 s, leave nothing on a straight."""
    speed, rate = profile((3.0, 0.0, 0.0), (5.0, 2.5, 0.0), (20.0, 2.5, 0.0))
    ticks = stream(speed, rate + 0.02, tilt_m_s2=np.full(len(speed), 0.3))
    estimator = make(input_rate_hz=10.0, standstill={"enabled": False})
    last = play(estimator, ticks)[-1]
    values = dict(zip(estimator.columns, last.values[0], strict=True))
    assert values["yaw_rate_rad_s"] == pytest.approx(0.0, abs=1e-9)
    assert values["speed_m_s"] == pytest.approx(2.5, abs=1e-2)


@pytest.mark.parametrize("thinning", ["moving_average", "decimation"])
def test_every_member_equals_its_single_run(thinning: Thinning) -> None:
    runs = 3
    rng = np.random.default_rng(9)
    ticks = [
        [
            measurement(m.sensor, m.t_ns, m.values, columns=m.columns, valid=rng.random(runs) > 0.2)
            if m.sensor != IMUS[0]
            else m
            for m in each
        ]
        for each in stream(*TRACK, runs=runs, **NOISE)
    ]
    options = {"input_rate_hz": 10.0, "thinning": thinning}
    many = make(make_setup(runs=runs), **options)
    together = play(many, ticks)
    for index in range(runs):
        for a, b in zip(together, play(make(**options), member(ticks, index)), strict=True):
            np.testing.assert_allclose(a.values[index], b.values[0], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(a.sigmas[index], b.sigmas[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("input_rate_hz", [50.0, 10.0, 1.0])
def test_the_yaw_rate_of_a_slow_filter_takes_as_many_steps(input_rate_hz: float) -> None:
    """Q once per step ties the gyroscopes' gain to the step, K^2 / (1 - K) = 1e-8 / 2.5e-7: what is left of a turn's
    beginning after n steps is (1 - K)^n, 0.45 of it after 4 steps, at 1 Hz longer than a quick turn."""
    speed, rate = profile((2.0, 0.0, 0.0), (5.0, 2.5, 0.0), (43.0, 2.5, 0.0), (10.0, 2.5, 0.1))
    estimator = make(input_rate_hz=input_rate_hz)
    yaw_rate = column(estimator, play(estimator, stream(speed, rate)), "yaw_rate_rad_s")[:, 0]
    gain = 0.5 * (math.sqrt(0.04**2 + 4.0 * 0.04) - 0.04)
    after_four = round((50.0 + 4.0 / input_rate_hz) / STEP_S) - 1
    assert 0.1 - yaw_rate[after_four] == pytest.approx(0.1 * (1.0 - gain) ** 4, rel=1e-3)


@pytest.mark.parametrize(("thinning", "behind_s"), [("moving_average", 0.45), ("decimation", 0.0)])
def test_averaged_positions_put_the_machine_where_it_was(thinning: Thinning, behind_s: float) -> None:
    """Ten perfect positions a second, averaged to one: 4.5 samples before the stamp, 1.1 m at 2.5 m/s."""
    speed, rate = profile((2.0, 0.0, 0.0), (5.0, 2.5, 0.0), (60.0, 2.5, 0.0))
    truth = motion(speed, rate)
    ticks = stream(speed, rate)
    for index in range(4, len(ticks), 5):
        ticks[index].append(gnss((index + 1) * STEP_NS, truth[index, 0], truth[index, 1], speed[index]))
    setup = make_setup(sensors(gnss=True, gnss_xy=(0.0, 0.0)))
    estimator = make(setup, input_rate_hz=1.0, thinning=thinning, noise={"gps": 1e-3})
    east = column(estimator, play(estimator, ticks), "position_e_m")[:, 0]
    assert truth[-1, 0] - east[-1] == pytest.approx(2.5 * behind_s, abs=0.01)


@pytest.mark.parametrize("thinning", ["moving_average", "decimation"])
def test_standstill_is_recognised_by_what_standing_looks_like_at_the_new_rate(thinning: Thinning) -> None:
    """The thresholds come from a calibration of thinned samples: 5 % of the time is missed, as at the full rate.

    30 members, 40 s and a memory of 0.5 s make some 2400 independent looks: 0.95 within 0.005, and the calibration's
    200 samples know the variance within 10 %, which moves the share by 0.015. Twice both is allowed.
    """
    standing = np.zeros(3000)
    ticks = stream(standing, standing, runs=30, **NOISE)
    estimator = make(make_setup(runs=30), input_rate_hz=10.0, thinning=thinning, calibration_s=20.0)
    found = column(estimator, play(estimator, ticks), "standstill")[1100:]
    assert found.mean() == pytest.approx(0.95, abs=0.04)
