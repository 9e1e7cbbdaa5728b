"""The displacement transducer: straight within its linearity, with the steps of its converter and its calibration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import DT_NS, preset, sensor
from twin.signals import FloatArray, JointMotion, JointNeed

PERFECT: dict[str, Any] = {"kind": "displacement_transducer", "rate_hz": 50.0, "joint": "plate"}


def read(strokes_m: FloatArray, *, runs: int = 1, **config: Any) -> FloatArray:
    """Readings over a sweep, (T, R)."""
    device = sensor(PERFECT | config, runs=range(runs))
    rows = []
    for stroke in strokes_m.tolist():
        capture = JointMotion(
            t_ns=device.next_tick * DT_NS, position_enu_m=np.zeros(3), position=np.array([stroke], dtype=np.float64)
        )
        rows.append(device.sample(capture).measurements[0].column("displacement_m"))
    return np.stack(rows)


SWEEP = np.linspace(-0.2, 0.2, 401)


def test_it_asks_for_its_joint() -> None:
    need = sensor(PERFECT | {"joint": "lift"}).need
    assert isinstance(need, JointNeed)
    assert need.joints == ("lift",)


def test_a_perfect_one_gives_the_stroke_within_its_range() -> None:
    np.testing.assert_array_equal(read(SWEEP)[:, 0], SWEEP)
    np.testing.assert_allclose(read(np.array([-0.5, 0.1, 0.5]))[:, 0], [-0.2, 0.1, 0.2], atol=1e-12)
    shifted = {"range_m": 0.6, "range_from_m": -0.1}
    np.testing.assert_allclose(read(np.array([-0.5, 0.1, 0.55]), **shifted)[:, 0], [-0.1, 0.1, 0.5], atol=1e-12)


def test_deviation_from_a_straight_line_is_smooth_and_within_the_linearity() -> None:
    error = read(SWEEP, runs=1000, linearity_ratio=0.0002) - SWEEP[:, np.newaxis]
    allowed = 0.0002 * 0.4  # 0.08 mm
    largest = np.abs(error).max(axis=0)
    assert largest.max() <= allowed * (1.0 + 1e-9)
    # Drawn evenly up to what is allowed: mean a half, standard deviation 1/sqrt(12); 1000 runs.
    assert np.mean(largest) == pytest.approx(0.5 * allowed, abs=4 * allowed / np.sqrt(12_000.0))
    assert largest.max() > 0.95 * allowed
    assert 0.4 < np.mean(error[200] > 0.0) < 0.6
    # Smooth: half a sine has the largest slope pi times amplitude over range; and no error at the ends.
    slope = np.abs(np.diff(error, axis=0)).max(axis=0) / 0.001
    assert np.all(slope <= np.pi * largest / 0.4 * (1.0 + 1e-6) + 1e-12)
    np.testing.assert_allclose(error[[0, -1]], 0.0, atol=1e-15)


def test_readings_are_multiples_of_the_converters_step() -> None:
    step = 3.711e-5
    counts = read(SWEEP, resolution_m=step)[:, 0] / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    error = read(SWEEP[1:-1], resolution_m=step)[:, 0] - SWEEP[1:-1]
    assert np.abs(error).max() <= 0.5 * step * (1.0 + 1e-9)


def test_calibration_and_noise_have_their_sigmas() -> None:
    still = np.array([0.1, 0.1])
    # 2000 runs: 1.6 %.
    assert np.std(read(still, runs=2000, offset_sigma_m=0.002)[0]) == pytest.approx(0.002, rel=4 * 0.016)
    assert np.std(read(still, runs=2000, scale_error_ratio=0.01)[0]) == pytest.approx(0.001, rel=4 * 0.016)
    noisy = read(still, runs=2000, noise_m=0.0003) - 0.1
    assert np.std(noisy[0]) == pytest.approx(0.0003, rel=4 * 0.016)
    assert abs(np.corrcoef(noisy[0], noisy[1])[0, 1]) < 4 / np.sqrt(2000)


def test_the_benchs_is_ten_times_better_than_a_lifts() -> None:
    bench, lift = (read(SWEEP[20:-20], runs=200, **preset(name)) for name in ("lmt_millay", "lift_stroke"))
    truth = SWEEP[20:-20, np.newaxis]
    bench_mm, lift_mm = (1e3 * np.sqrt(np.mean((values - truth) ** 2)) for values in (bench, lift))
    # Calibration 0.1 mm and 0.07 % of up to 180 mm (0.073 rms), bow 0.08 / sqrt(3) * 0.73, noise 0.05 mm: 0.142 mm.
    # Those drawn once: 200 runs, 5 % of each.
    assert bench_mm == pytest.approx(0.142, rel=0.2)
    # 2 mm, 0.5 % (0.52), bow 1 / sqrt(3) * 0.73 (0.42), noise 0.3: 2.13 mm.
    assert lift_mm == pytest.approx(2.13, rel=0.2)
    sheet = sensor(preset("lmt_millay")).info.datasheet
    assert sheet["linearity_ratio"] * sheet["range_m"] == pytest.approx(0.08e-3)
