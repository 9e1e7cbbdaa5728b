"""Zero offset and trend of a free acceleration, and when what is done."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.bench import STEP_NS, STEP_S, WHITE_M_S2
from twin.estimators.height_preparation import HeightPreparation, HeightPreparationConfig, RunningLine, fit_line
from twin.signals import FloatArray

DENSITY = WHITE_M_S2 / 5.0
"""One-sided, m/s^2/sqrt(Hz)."""


def make(runs: int = 1, **options: object) -> HeightPreparation:
    config = HeightPreparationConfig.model_validate(options)
    return HeightPreparation(config, noise_m_s2=float(WHITE_M_S2), runs=runs)


def prepared(preparation: HeightPreparation, samples: FloatArray) -> FloatArray:
    """Prepared samples (T, R)."""
    there = np.ones(samples.shape[1], dtype=bool)
    return np.array([preparation.take((k + 1) * STEP_NS, row, there) for k, row in enumerate(samples)])


def test_lines_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(0)
    t_s = np.arange(200) * STEP_S
    samples = 3.0 - 0.2 * t_s[:, np.newaxis] + rng.standard_normal((200, 5))
    used = rng.random(samples.shape) > 0.3
    running = RunningLine(5)
    for t, row, there in zip(t_s, samples, used, strict=True):
        running.add(np.full(5, t), np.where(there, row, np.nan), there)
    for run in range(5):
        mine = used[:, run]
        slope, offset = np.polyfit(t_s[mine], samples[mine, run], 1)
        line = running.line()
        assert line.trend[run] == pytest.approx(slope)
        assert line.offset[run] == pytest.approx(offset)
        flat = running.line(trend=np.full(5, 0.5))
        assert flat.offset[run] == pytest.approx((samples[mine, run] - 0.5 * t_s[mine]).mean())
    whole = fit_line(t_s, samples)
    slopes, offsets = np.polyfit(t_s, samples, 1)
    np.testing.assert_allclose(whole.trend, slopes)
    np.testing.assert_allclose(whole.offset, offsets)


def test_a_record_as_the_papers_tells_offset_and_trend() -> None:
    """50 min at 50 Hz, -13.80 mm/s^2 and 1 mm/s^2 an hour, removed with what the record before tells."""
    rng = np.random.default_rng(1)
    t_s = np.arange(1, 150_001) * STEP_S
    trend = 1e-3 / 3600.0
    record = -0.0138 + trend * t_s[:, np.newaxis] + WHITE_M_S2 * rng.standard_normal((150_000, 2))
    line = fit_line(t_s, record)
    np.testing.assert_allclose(line.trend, trend, atol=4.0 * DENSITY * np.sqrt(6.0 / 3000.0**3))
    np.testing.assert_allclose(line.offset, -0.0138, atol=4.0 * 2.0 * DENSITY / np.sqrt(2.0 * 3000.0))
    preparation = make(
        outliers="none",
        offset="given",
        trend="given",
        offset_m_s2=float(line.offset[0]),
        trend_m_s3=float(line.trend[0]),
    )
    left = prepared(preparation, record[:, :1])
    assert abs(left.mean()) < 4.0 * DENSITY / np.sqrt(2.0 * 3000.0)
    assert preparation.acceleration == left[-1]


@pytest.mark.parametrize("outliers", ["none", "robust"])
def test_the_offset_of_a_standstill_is_as_good_as_white_noise_allows(outliers: str) -> None:
    """Standard deviation D / sqrt(2 T) over 2000 members: known to 1.6 %, so 5 % are three sigma."""
    rng = np.random.default_rng(2)
    bias = 0.0138 * rng.standard_normal(2000)
    samples = bias + WHITE_M_S2 * rng.standard_normal((499, 2000))
    preparation = make(2000, outliers=outliers, calibration_s=10.0)
    given = prepared(preparation, samples)
    np.testing.assert_array_equal(given, 0.0)  # it stands
    error = preparation.line.offset - bias
    assert error.std() == pytest.approx(DENSITY / np.sqrt(2.0 * 9.98), rel=0.05)
    assert abs(error.mean()) < 4.0 * error.std() / np.sqrt(2000)


def test_a_trend_fitted_to_a_short_standstill_is_worse_than_none() -> None:
    """Slope D sqrt(6 / T^3): a minute after a standstill of 10 s the line is 2 sqrt(3) 65 / 10 times as wrong."""
    rng = np.random.default_rng(3)
    samples = WHITE_M_S2 * rng.standard_normal((500, 2000))
    mean, line = (make(2000, outliers="none", trend=trend, calibration_s=10.0) for trend in ("none", "standing"))
    prepared(mean, samples)
    prepared(line, samples)
    assert line.line.trend.std() == pytest.approx(DENSITY * np.sqrt(6.0 / 10.0**3), rel=0.05)
    at = line.line.offset + 70.0 * line.line.trend
    assert at.std() / mean.line.offset.std() == pytest.approx(np.hypot(1.0, 2.0 * np.sqrt(3.0) * 6.5), rel=0.06)


def test_published_outliers_are_replaced_while_standing_or_always() -> None:
    rng = np.random.default_rng(4)
    samples = WHITE_M_S2 * rng.standard_normal((1000, 200))
    for outliers, moving in (("standing", 0.0), ("always", 0.168)):
        preparation = make(200, outliers=outliers, calibration_s=10.0)
        shares = []
        for k, row in enumerate(samples):
            preparation.take((k + 1) * STEP_NS, row, np.ones(200, dtype=bool))
            shares.append(preparation.replaced.mean())
        assert np.mean(shares[3:500]) == pytest.approx(0.168, abs=0.01)
        assert np.mean(shares[500:]) == pytest.approx(moving, abs=0.01 if moving else 0.0)


def test_the_calibration_ends_on_time_for_each_member() -> None:
    """Its time counts from the member's first sample; repeated and older samples do not count at all."""
    preparation = make(2, outliers="none", calibration_s=0.1)
    both, first = np.array([True, True]), np.array([True, False])
    for k in range(1, 4):
        preparation.take(k * STEP_NS, np.array([1.0, np.nan]), first)
    for k in range(4, 9):
        preparation.take(k * STEP_NS, np.array([2.0, 4.0]), both)
        preparation.take(k * STEP_NS, np.array([9.0, 9.0]), both)
        preparation.take((k - 2) * STEP_NS, np.array([9.0, 9.0]), both)
    np.testing.assert_allclose(preparation.line.offset, [(3 * 1.0 + 2 * 2.0) / 5, 4.0])
    np.testing.assert_allclose(preparation.acceleration, [2.0 - 7.0 / 5, 0.0])
    preparation.take(9 * STEP_NS, np.array([2.0, 5.0]), both)
    np.testing.assert_allclose(preparation.acceleration, [2.0 - 7.0 / 5, 1.0])


def test_without_offset_and_trend_samples_pass() -> None:
    samples = np.random.default_rng(5).standard_normal((10, 3))
    np.testing.assert_array_equal(prepared(make(3, outliers="none", offset="none"), samples), samples)
