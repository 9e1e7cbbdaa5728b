"""The magnetometer's physics: what it makes of a known field."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, DT_NS, EARTH, STANDING, drive, preset, sensor
from twin.geometry import rotation_from_rpy, wrap_angle
from twin.sensors import Sensor
from twin.signals import NS_PER_S, FloatArray, MagneticField

CONFIG: dict[str, Any] = {"kind": "magnetometer", "rate_hz": 50.0}


def feel(device: Sensor, fields_ut: FloatArray, current_a: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Values (T, R, 3) and hidden columns (T, R, m) for fields (T, 3) in mount axes."""
    values, hidden = [], []
    for field in fields_ut:
        capture = MagneticField(
            t_ns=device.next_tick * DT_NS,
            position_enu_m=np.zeros(3),
            field_ut=np.array(field),
            motor_current_a=current_a,
        )
        sample = device.sample(capture)
        values.append(sample.measurements[0].values)
        hidden.append(sample.hidden)
    return np.array(values), np.array(hidden)


def turned(headings_rad: FloatArray) -> FloatArray:
    """The earth's field in the axes of a level mount, (T, 3)."""
    return np.array([EARTH.enu_ut @ rotation_from_rpy(0.0, 0.0, heading) for heading in headings_rad])


def heading_rad(values: FloatArray) -> FloatArray:
    """True heading of a level unit: the field points declination east of north, pi/2 - D counter-clockwise of east."""
    north = math.pi / 2.0 - EARTH.declination_rad
    return wrap_angle(north - np.arctan2(values[..., 1], values[..., 0]))


def test_the_earths_field_is_what_its_three_figures_say() -> None:
    # 46 uT, 56 degrees down: level part 46 cos 56 = 25.72 uT, 5 degrees east of north; 46 sin 56 = 38.14 uT down.
    east, north, up = EARTH.enu_ut
    assert east == pytest.approx(25.72 * math.sin(math.radians(5.0)), abs=0.01)
    assert north == pytest.approx(25.72 * math.cos(math.radians(5.0)), abs=0.01)
    assert up == pytest.approx(-38.14, abs=0.01)


def test_an_undisturbed_unit_points_to_the_heading_within_its_noise() -> None:
    # Noise s on two axes of a level field H: s / H rad; 0.25 / 25.72 = 0.557 degrees. 1000 samples: 2.2 %; four.
    truth = wrap_angle(np.linspace(0.0, 2.0 * math.pi, 1000))
    values, _ = feel(sensor({**CONFIG, "noise_ut": [0.25, 0.25, 0.25]}), turned(truth))
    error = wrap_angle(heading_rad(values[:, 0]) - truth)
    assert np.std(error) == pytest.approx(0.25 / 25.72, rel=0.09)
    assert abs(np.mean(error)) < 4.0 * 0.25 / 25.72 / math.sqrt(1000.0)


def test_a_perfect_unit_gives_the_field() -> None:
    values, hidden = feel(sensor(CONFIG), turned(np.array([0.3, 1.0])))
    np.testing.assert_allclose(values[:, 0], turned(np.array([0.3, 1.0])), rtol=1e-15)
    assert np.all(hidden == 0.0)


def test_hard_iron_is_constant_in_the_machines_axes() -> None:
    # Two readings half a turn apart add up to twice the level offset (paper 001, eqs 16 to 18).
    device = sensor({**CONFIG, "hard_iron_ut": 20.0}, runs=range(1000))
    values, hidden = feel(device, turned(np.array([0.4, 0.4 + math.pi])))
    bias = hidden[:, :, 3:6]
    np.testing.assert_allclose(values.mean(axis=0)[:, :2], bias[0, :, :2], atol=1e-9)
    np.testing.assert_array_equal(bias[0], bias[1])
    # 3000 draws: 1.3 % of the sigma; four.
    assert np.std(bias[0]) == pytest.approx(20.0, rel=0.053)


def test_soft_iron_makes_an_ellipse_and_no_offset() -> None:
    device = sensor({**CONFIG, "soft_iron_ratio": 0.1}, runs=range(500))
    values, _ = feel(device, turned(np.linspace(0.0, 2.0 * math.pi, 73)[:-1]))
    level = np.linalg.norm(values[:, :, :2] - values[:, :, :2].mean(axis=0), axis=2)
    assert np.median(level.max(axis=0) / level.min(axis=0)) > 1.05
    # The response to the opposite field is the opposite: what a full turn leaves on average is the vertical part only.
    values, _ = feel(device, np.array([[10.0, -5.0, 30.0], [-10.0, 5.0, -30.0]]))
    np.testing.assert_allclose(values[0], -values[1], rtol=1e-12)


def test_motors_shift_it_in_proportion_to_their_current() -> None:
    config = {**CONFIG, "motor_field_ut_a": [0.5, -0.3, 0.2]}
    still, _ = feel(sensor(config), turned(np.zeros(1)))
    running, hidden = feel(sensor(config), turned(np.zeros(1)), current_a=2.0)
    np.testing.assert_allclose(running[0, 0] - still[0, 0], [1.0, -0.6, 0.4], atol=1e-12)
    np.testing.assert_allclose(hidden[0, 0, 3:6], [1.0, -0.6, 0.4], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "lsb_ut", "largest_ut"),
    [("mag_qmc5883l", 0.0083333, 200.0), ("mag_qmc5883l_8g", 0.033333, 800.0), ("mag_hmc5883l", 0.091743, 130.0)],
)
def test_counts_and_range_are_the_data_sheets(name: str, lsb_ut: float, largest_ut: float) -> None:
    # QMC5883L: 12000 counts per gauss (100 uT) at 2 G, 3000 at 8 G; HMC5883L: 1090.
    device = sensor(preset(name))
    assert device.info.datasheet["resolution_ut"] == pytest.approx(lsb_ut, rel=1e-4)
    values, _ = feel(device, np.array([[20.0, -10.0, 30.0]] * 20 + [[2e3, -2e3, 2e3]]))
    counts = values[:-1] / lsb_ut
    np.testing.assert_allclose(counts, np.round(counts), atol=0.05)
    assert np.abs(np.diff(values[:-1], axis=0)).max() > 0.0
    np.testing.assert_allclose(np.abs(values[-1]), largest_ut, atol=lsb_ut)


def test_the_presets_noise_is_what_the_paper_measured_at_rest() -> None:
    device = sensor(preset("mag_qmc5883l"), runs=range(20))
    assert device.info.datasheet["mag_noise_ut"] == pytest.approx(math.sqrt((0.236**2 + 0.303**2 + 0.696**2) / 3.0))
    assert device.info.datasheet["mag_noise_x_ut"] == 0.236
    log = drive(device, STANDING, 10.0)
    values = np.stack([measurement.values for measurement in log.measurements])
    # 20 x 500 samples: 0.7 %; four.
    np.testing.assert_allclose(values.std(axis=0).mean(axis=0), [0.236, 0.303, 0.696], rtol=0.03)


def test_a_member_measures_what_its_own_run_measures() -> None:
    together = drive(sensor(preset("mag_qmc5883l"), runs=range(5)), STANDING, 1.0)
    alone = drive(sensor(preset("mag_qmc5883l"), runs=(3,)), STANDING, 1.0)
    for one, other in zip(together.measurements, alone.measurements, strict=True):
        np.testing.assert_array_equal(one.values[3:4], other.values)


def test_a_range_of_zero_is_refused() -> None:
    with pytest.raises(ValidationError, match="range_ut"):
        CONFIGS.validate_python({**CONFIG, "mount": "m", "range_ut": 0.0})


def test_time_stamps_are_the_ticks() -> None:
    device = sensor(CONFIG)
    first = device.next_tick * DT_NS
    feel(device, turned(np.zeros(3)))
    assert device.next_tick * DT_NS - first == 3 * NS_PER_S // 50
