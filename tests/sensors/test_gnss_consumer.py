"""Receivers of papers 003 and 004 over many members: how positions wander, step and are told, against the figures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

from tests.sensors.motions import CONFIGS, DT_NS, STANDING, Motion, constant, drive, preset, sensor
from twin.sensors.gnss_internal_filter import InternalFilter
from twin.signals import NS_PER_S, FloatArray

RUNS = 1000
STOP_S = 1200.0
"""Paper 004: stops of 20 min."""


def within(x: float) -> float:
    """Part of the variance of an exponentially correlated error that falls within a stretch of x correlation times."""
    return 1.0 - 2.0 / x + 2.0 * (1.0 - math.exp(-x)) / (x * x)


def intended(values: dict[str, Any], axis: int, stretch_s: float) -> tuple[float, float]:
    """Variance within a stretch, and of its mean, of the wandering, stepping and white error of a preset."""
    state = values["states"]["single"]
    slow, white = state["correlated_sigma_m"][axis] ** 2, state["white_sigma_m"][axis] ** 2
    step, interval_s = state.get("jump_sigma_m", [0.0] * 3)[axis] ** 2, values.get("jump_interval_s", 1.0)
    inside = slow * within(stretch_s / state["correlation_s"][axis]) + step * within(stretch_s / interval_s) + white
    return inside, slow + step + white - inside


def horizontal_errors(values: dict[str, Any], motion: Motion, duration_s: float, *, runs: int = RUNS) -> FloatArray:
    """(T, R, 2) errors, east and north; nothing else is kept."""
    device = sensor(values, runs=range(runs))
    columns = [device.hidden_columns.index(f"position_{axis}_m.error") for axis in "en"]
    kept, before_ns = [], 0
    while (t_ns := device.next_tick * DT_NS) <= round(duration_s * NS_PER_S):
        kept.append(device.sample(motion(before_ns / NS_PER_S, t_ns / NS_PER_S)).hidden[:, columns])
        before_ns = t_ns
    return np.stack(kept)


def steady_sky(name: str, **changes: Any) -> dict[str, Any]:
    """A preset whose geometry does not swing: its figures are those of the usual geometry."""
    return {key: value for key, value in preset(name).items() if key != "geometry"} | changes


def test_trurover_spreads_within_and_between_stops_as_paper_004_measured() -> None:
    values = steady_sky("trurover")
    error = horizontal_errors(values, STANDING, STOP_S)
    # Table 3: three stops; rms of the standard deviations, and of the means.
    table = (
        ((0.4743, 0.3018, 0.3163), (0.221, -0.725, -0.848)),
        ((0.7210, 0.5001, 0.3907), (0.534, 2.081, 1.086)),
    )
    for axis, (sigmas, means) in enumerate(table):
        inside, between = intended(values, axis, STOP_S)
        assert math.sqrt(inside) == pytest.approx(np.sqrt(np.mean(np.square(sigmas))), rel=0.02)
        assert math.sqrt(between) == pytest.approx(np.sqrt(np.mean(np.square(means))), rel=0.02)
        # Means of independent members are normal: their sum of squares is chi-square.
        mean_square = np.sum(np.mean(error[..., axis], axis=0) ** 2) / between
        assert stats.chi2.ppf(1e-4, RUNS) < mean_square < stats.chi2.ppf(1.0 - 1e-4, RUNS)
        # Variances within stops are not chi-square (what wanders is correlated), but independent between members.
        variances = np.var(error[..., axis], axis=0)
        assert np.mean(variances) == pytest.approx(inside, abs=4.0 * np.std(variances) / math.sqrt(RUNS))


def test_gx1230_is_centimetric_and_its_raw_position_is_not() -> None:
    fixed = horizontal_errors(preset("gx1230"), STANDING, 60.0)
    assert np.sum(fixed[-1, :, 0] ** 2) / 0.01**2 == pytest.approx(RUNS, abs=4.0 * math.sqrt(2.0 * RUNS))
    values = steady_sky("gx1230_raw")
    raw = horizontal_errors(values, STANDING, STOP_S)
    inside, between = intended(values, 0, STOP_S)
    assert np.sum(np.mean(raw[..., 0], axis=0) ** 2) / between == pytest.approx(RUNS, abs=4.0 * math.sqrt(2.0 * RUNS))
    variances = np.var(raw[..., 0], axis=0)
    assert np.mean(variances) == pytest.approx(inside, abs=4.0 * np.std(variances) / math.sqrt(RUNS))


def test_dgps_is_decimetric_and_falls_back_to_single_without_corrections() -> None:
    lost = {"kind": "corrections_lost", "from_s": 10.0}
    log = drive(sensor(preset("dgps") | {"faults": [lost]}, runs=range(200)), STANDING, 80.0)
    quality, sigma = log.values("quality"), log.values("sigma_e_m")
    assert set(quality[:300, 0]) == {2.0}
    # Corrections of 6 s, received at 7 s, are the last: 60 s old at 66 s.
    np.testing.assert_array_equal(quality[(log.t_s >= 66.0)], 1.0)
    np.testing.assert_array_equal(quality[(log.t_s < 66.0)], 2.0)
    assert sigma[0, 0] == 0.5
    assert sigma[-1, 0] == 1.5
    # 200 runs: 5 %.
    assert np.std(log.hidden("position_e_m.error")[0]) == pytest.approx(math.hypot(0.4, 0.05), rel=0.2)


def test_lea_5s_errs_within_a_pass_as_paper_003_measured() -> None:
    values = preset("lea_5s")
    # A pass there and back of 100 m takes 200 s or so; straight, at 0.5 m/s, not along a grid line.
    error = horizontal_errors(values, constant(0.5, heading_rad=1.1), 200.0)
    expected = 0.0
    for axis in range(2):
        inside, _ = intended(values, axis, 200.0)
        expected += 0.5 * (inside + values[f"{('east', 'north')[axis]}_resolution_m"] ** 2 / 12.0)
    variances = np.mean(np.var(error, axis=0), axis=-1)
    assert np.mean(variances) == pytest.approx(expected, abs=4.0 * np.std(variances) / math.sqrt(RUNS))
    # Section 3: RMS 0.72 m about the mean.
    assert math.sqrt(expected) == pytest.approx(0.72, rel=0.02)
    # A bias is two normal numbers; the median of their length is 1.177 sigma, known from 1000 to 2.3 %. The paper's one
    # mean bias of 2.32 m is such a length.
    bias = np.hypot(*np.mean(error, axis=0).T)
    _, between = intended(values, 0, 200.0)
    assert np.median(bias) == pytest.approx(math.sqrt(2.0 * math.log(2.0) * between), rel=4 * 0.023)
    assert 0.5 * np.median(bias) < 2.32 < 2.0 * np.median(bias)


def test_lea_5s_is_correlated_as_its_two_processes_are() -> None:
    fine = preset("lea_5s") | {"east_resolution_m": 0.0, "north_resolution_m": 0.0}
    error = horizontal_errors(fine, STANDING, 601.0, runs=2000)
    for lag in (60, 600):
        left = (1.96**2 * math.exp(-lag / 1600.0) + 0.8**2 * math.exp(-lag / 120.0)) / (1.96**2 + 0.8**2 + 0.05**2)
        for axis in range(2):
            found = np.corrcoef(error[0, :, axis], error[lag, :, axis])[0, 1]
            # Standard error (1 - r^2)/sqrt(2000).
            assert found == pytest.approx(left, abs=4.0 * (1.0 - left * left) / math.sqrt(2000.0))


def test_steps_come_at_their_rate_and_have_their_size() -> None:
    bare = preset("lea_5s")
    bare["states"]["single"] |= {"correlated_sigma_m": [0.0] * 3, "white_sigma_m": [0.0] * 3}
    bare |= {"east_resolution_m": 0.0, "north_resolution_m": 0.0}
    error = horizontal_errors(bare, STANDING, 600.0)
    steps = np.diff(error, axis=0)
    stepped = np.any(steps != 0.0, axis=-1)
    # In an interval of 1 s at least one change with probability 1 - e^{-1/120}; binomial.
    expected = 1.0 - math.exp(-1.0 / 120.0)
    assert np.mean(stepped) == pytest.approx(expected, abs=4.0 * math.sqrt(expected / stepped.size))
    # Both offsets are 0.8 m: a step sqrt(2) times that; some 5000 steps on two axes, each offset is in two of them.
    assert np.sqrt(np.mean(steps[stepped] ** 2)) == pytest.approx(0.8 * math.sqrt(2.0), rel=0.04)
    # From one sample to the next of different members nothing is shared.
    together = np.mean(stepped[:, ::2] & stepped[:, 1::2])
    assert together < 4.0 * expected**2 + 4.0 * expected / math.sqrt(stepped.size)


def test_position_is_told_on_a_grid_whose_steps_are_those_of_paper_003() -> None:
    values = preset("lea_5s")
    log = drive(sensor(values, runs=range(100)), constant(0.73, heading_rad=1.1), 200.0)
    for axis, least_m in (("e", 1.5), ("n", 0.45)):
        step_m = values["east_resolution_m" if axis == "e" else "north_resolution_m"]
        told = log.values(f"position_{axis}_m") / step_m
        np.testing.assert_allclose(told, np.round(told), atol=1e-9)
        changes = np.abs(np.diff(told, axis=0))
        # Section 3: "the least GPS data changing"; every other change is a multiple of it.
        assert changes[changes > 0.5].min() == pytest.approx(1.0)
        assert step_m == pytest.approx(least_m, rel=0.05)


@pytest.mark.parametrize(("field", "metre_per_minute", "step_m"), [(12132.0, 1610.4, 1.573), (2952.0, 1847.5, 0.451)])
def test_the_grid_is_that_of_minutes_in_single_precision(field: float, metre_per_minute: float, step_m: float) -> None:
    # Longitude dddmm.mmmm and latitude ddmm.mmmm of Ningbo, as the number a parser makes of the text.
    assert float(np.spacing(np.float32(field))) * metre_per_minute == pytest.approx(step_m, rel=1e-3)


def test_a_receiver_that_steps_is_the_ordinary_run_as_a_member_too() -> None:
    often = preset("trurover") | {"jump_interval_s": 2.0}
    together, alone = (horizontal_errors(often, constant(2.0), 60.0, runs=runs) for runs in (30, 1))
    np.testing.assert_array_equal(together[:, 0], alone[:, 0])
    device = sensor(often, runs=[17])
    log = drive(device, constant(2.0), 60.0)
    np.testing.assert_array_equal(log.hidden("position_e_m.error")[:, 0], together[:, 17, 0])


def test_dop_sigmas_and_errors_swing_together_and_alike_for_all_members() -> None:
    values = steady_sky("gx1230_raw", geometry={"swing_ratio": 0.5, "period_s": 100.0})
    log = drive(sensor(values, runs=range(RUNS)), STANDING, 100.0)
    hdop, vdop, sigma = log.values("hdop"), log.values("vdop"), log.values("sigma_e_m")
    np.testing.assert_array_equal(hdop, hdop[:, :1] + np.zeros(RUNS))
    # A sine of amplitude 0.5 about 1, seen every second of its 100.
    assert hdop.min() == pytest.approx(0.5, abs=0.001)
    assert hdop.max() == pytest.approx(1.5, abs=0.001)
    assert np.mean(hdop) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(vdop, 1.7 * hdop)
    np.testing.assert_allclose(sigma, 1.0 * hdop)
    total = math.sqrt(0.8**2 + 0.2**2 + 0.25**2)
    error = log.hidden("position_n_m.error")
    for row in (int(np.argmin(hdop[:, 0])), int(np.argmax(hdop[:, 0]))):
        # 1000 runs: 2.2 %.
        assert np.std(error[row]) == pytest.approx(total * hdop[row, 0], rel=4 * 0.022)
    other = drive(sensor(values, seed=2), STANDING, 3.0).values("hdop")
    assert not np.array_equal(other[:, 0], hdop[:3, 0])


def test_the_owner_knows_how_positions_wander_and_step() -> None:
    sheet = sensor(preset("lea_5s")).info.datasheet
    assert sheet["position_correlated_sigma_m"] == pytest.approx(1.96)
    assert sheet["position_correlation_s"] == 1600.0
    assert sheet["position_jump_sigma_m"] == pytest.approx(0.8)
    assert sheet["jump_interval_s"] == 120.0
    assert (sheet["east_resolution_m"], sheet["north_resolution_m"]) == (1.573, 0.451)
    dgps = sensor(preset("dgps"), seed=3, runs=[5]).info.datasheet
    assert dgps == sensor(preset("dgps")).info.datasheet
    assert dgps["single_position_correlated_sigma_m"] == pytest.approx(0.8)
    assert not {"jump_interval_s", "filter_lag_s2"} & set(dgps)
    own = InternalFilter(**preset("trurover")["internal_filter"])
    assert sensor(preset("trurover")).info.datasheet["filter_lag_s2"] == own.lag_s2(0.2)


def test_steps_without_an_interval_are_refused() -> None:
    values = {key: value for key, value in preset("lea_5s").items() if key != "jump_interval_s"}
    with pytest.raises(ValidationError, match="jump_sigma_m of a state needs jump_interval_s"):
        CONFIGS.validate_python(values)
