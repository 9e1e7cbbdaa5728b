"""The yaw gyro: mean rate over its interval, its errors, range and converter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, STANDING, circle, drive, preset, sensor, spin

PERFECT: dict[str, Any] = {"kind": "yaw_gyro", "rate_hz": 1.0}
YAW = "yaw_rate_rad_s"


def test_a_perfect_one_gives_the_mean_rate_so_that_its_sum_is_the_angle() -> None:
    device = sensor(PERFECT)

    def swinging(t0: float, t1: float) -> Any:
        # Rate sin(t): its mean over an interval is the difference of -cos.
        return spin((0.0, 0.0, 9.8), (0.3, -0.2, (math.cos(t0) - math.cos(t1)) / (t1 - t0)))(t0, t1)

    log = drive(device, swinging, 10.0)
    assert np.sum(log.values(YAW)) == pytest.approx(1.0 - math.cos(10.0), abs=1e-12)
    np.testing.assert_allclose(log.hidden(f"{YAW}.error"), 0.0, atol=1e-15)


def test_scale_bias_walk_and_noise_have_their_sigmas() -> None:
    def spread(at: int, rate: float, **errors: float) -> float:
        log = drive(sensor(PERFECT | errors, runs=range(2000)), spin((0.0, 0.0, 9.8), (0.0, 0.0, rate)), 9.0)
        return float(np.std(log.values(YAW)[at] - rate))

    # 2000 runs: 1.6 %, four of them.
    assert spread(0, 0.5, scale_error_ratio=0.01) == pytest.approx(0.005, rel=0.064)
    assert spread(0, 0.5, bias_rad_s=0.005) == pytest.approx(0.005, rel=0.064)
    assert spread(8, 0.5, bias_random_walk_rad_s_rts=0.001) == pytest.approx(0.003, rel=0.064)
    # One-sided density D, averaged over 1 s: the noise bandwidth is half the rate, D sqrt(1/2).
    assert spread(8, 0.5, noise_density_rad_s_rthz=0.001) == pytest.approx(0.001 / math.sqrt(2.0), rel=0.064)


def test_it_stops_at_its_range_and_has_the_steps_of_its_converter() -> None:
    log = drive(sensor(preset("gyro_gx1"), runs=range(50)), circle(1.1, 2.5), 60.0)
    # 0.5 to 4.5 V of 5 V: 1024 steps span 1.25 times +-70 degrees a second.
    lsb = math.radians(2.0 * 70.0 * 1.25 / 1024.0)
    steps = log.values(YAW) / lsb
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert sensor(preset("gyro_gx1")).info.datasheet["resolution_rad_s"] == pytest.approx(lsb, rel=1e-6)
    fast = drive(sensor(preset("gyro_gx1")), spin((0.0, 0.0, 9.8), (0.0, 0.0, 3.0)), 3.0).values(YAW)
    np.testing.assert_allclose(fast, math.radians(70.0), atol=0.5 * lsb)
    slow = drive(sensor(preset("gyro_gx1")), spin((0.0, 0.0, 9.8), (0.0, 0.0, -3.0)), 3.0).values(YAW)
    np.testing.assert_allclose(slow, -math.radians(70.0), atol=0.5 * lsb)


def test_a_rounded_rate_errs_evenly_within_a_step() -> None:
    config = PERFECT | {"range_rad_s": 1.0, "converter": {"bits": 10}, "noise_density_rad_s_rthz": 0.02}
    log = drive(sensor(config, runs=range(100)), STANDING, 50.0)
    # Noise of 0.0141 is seven steps of 1/512: rounding adds lsb^2/12. 5000 values: variance to 2 %.
    expected = 0.02**2 / 2.0 + (2.0 / 1024.0) ** 2 / 12.0
    assert np.var(log.values(YAW)) == pytest.approx(expected, rel=0.08)


def test_a_converter_without_a_range_is_refused() -> None:
    with pytest.raises(ValidationError, match="converter needs range_rad_s"):
        CONFIGS.validate_python(PERFECT | {"mount": "m", "converter": {"bits": 10}})
