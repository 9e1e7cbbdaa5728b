"""The lidar's physics: what it makes of known distances."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, DT_NS, preset, sensor
from twin.sensors import Sensor
from twin.signals import FloatArray, RayNeed, RayScan

CONFIG: dict[str, Any] = {"kind": "lidar", "rate_hz": 5.0, "min_range_m": 0.12, "max_range_m": 3.5}


def scan(device: Sensor, distance_m: float, lux: float = 500.0, turns: int = 1) -> FloatArray:
    """Ranges (T, R, n) of turns in which every beam goes the same way."""
    ranges = []
    for _ in range(turns):
        beams = len(device.columns)
        capture = RayScan(
            t_ns=device.next_tick * DT_NS,
            position_enu_m=np.zeros(3),
            distance_m=np.full(beams, distance_m),
            illuminance_lux=lux,
        )
        ranges.append(device.sample(capture).measurements[0].values)
    return np.array(ranges)


def test_beams_go_all_round_and_take_a_turn() -> None:
    device = sensor({**CONFIG, "beams": 8})
    assert isinstance(device.need, RayNeed)
    assert device.need.bearings_rad == pytest.approx([k * math.pi / 4.0 for k in range(8)])
    assert device.need.sweep_s == 0.2
    assert device.need.reach_m == 3.5
    assert device.columns == tuple(f"range_{k}_m" for k in range(8))
    assert sensor(preset("lidar_lds01")).columns[27] == "range_027_m"


def test_a_perfect_unit_gives_the_distance_within_its_range() -> None:
    device = sensor(CONFIG)
    assert np.all(scan(device, 1.234) == 1.234)
    for nothing in (0.11, 3.51, math.inf):
        assert np.isnan(scan(device, nothing)).all()


@pytest.mark.parametrize(("distance", "noise", "bias"), [(0.3, 0.005, 0.0055), (2.0, 0.035, 0.036)])
def test_the_lds01_errs_as_its_data_sheet_says(distance: float, noise: float, bias: float) -> None:
    # Accuracy +-15 mm below 0.5 m and +-5 % beyond, two sigma, noise (10 mm, 3.5 %) included.
    ranges = scan(sensor(preset("lidar_lds01"), runs=range(400)), distance, turns=3)
    means = ranges.mean(axis=(0, 2))
    # 400 x 1080 values: 0.1 % of the noise; 400 units: 3.5 % of the bias; four of each, and the millimetre's rounding.
    assert np.std(ranges - means[:, np.newaxis]) == pytest.approx(math.hypot(noise, 0.001 / math.sqrt(12.0)), rel=0.01)
    assert np.std(means) == pytest.approx(bias, rel=0.15)
    assert 2.0 * math.hypot(noise, bias) == pytest.approx(0.015 if distance < 0.5 else 0.05 * distance, rel=0.02)
    np.testing.assert_allclose(ranges * 1e3, np.round(ranges * 1e3), atol=1e-6)


@pytest.mark.parametrize(("lux", "lost"), [(9_999.0, 0.0), (20_000.0, 0.5), (100_000.0, 0.9)])
def test_light_takes_points_away_and_makes_some_wrong(lux: float, lost: float) -> None:
    ranges = scan(sensor(preset("lidar_lds01"), runs=range(100)), 1.0, lux=lux, turns=5)
    # 180 000 beams: standard errors below 0.12 %. A tenth of what drowns is wrong: uniform over 0.12 to 3.5 m, of which
    # 0.8 to 1.2 m is 11.8 %.
    assert np.isnan(ranges).mean() == pytest.approx(0.9 * lost, abs=0.005)
    seen = ranges[np.isfinite(ranges)]
    wrong = (np.abs(seen - 1.0) > 0.2).sum() / ranges.size
    assert wrong == pytest.approx(0.1 * lost * (1.0 - 0.4 / 3.38), abs=0.005)
    assert seen.min() >= 0.12
    assert seen.max() <= 3.5


def test_points_are_lost_in_any_light_with_their_probability() -> None:
    ranges = scan(sensor({**CONFIG, "lost_probability": 0.2}, runs=range(50)), 1.0)
    assert np.isnan(ranges).mean() == pytest.approx(0.2, abs=0.012)


def test_a_member_measures_what_its_own_run_measures() -> None:
    together = scan(sensor(preset("lidar_lds01"), runs=range(5)), 0.7, lux=3e4, turns=3)
    alone = scan(sensor(preset("lidar_lds01"), runs=(2,)), 0.7, lux=3e4, turns=3)
    np.testing.assert_array_equal(together[:, 2:3], alone)


def test_a_range_the_wrong_way_round_is_refused() -> None:
    with pytest.raises(ValidationError, match="min_range_m = 4 must be less"):
        CONFIGS.validate_python({**CONFIG, "mount": "m", "min_range_m": 4.0})
