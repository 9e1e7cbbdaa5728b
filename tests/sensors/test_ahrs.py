"""The attitude and heading reference: how attitude errors leak, what the accelerometers do, what is told of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import STANDING, Log, Motion, circle, drive, preset, sensor
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.geometry import rotation_from_rpy
from twin.sensors.ahrs import COLUMNS, FREE_ACCELERATION
from twin.signals import NS_PER_S, FloatArray, MountMotion

PERFECT = {"kind": "ahrs", "rate_hz": 50.0}
UP = FREE_ACCELERATION[2]


Triple = tuple[float, float, float]


def accelerated(acceleration: Triple, rpy_rad: Triple = (0.0, 0.0, 0.0)) -> Motion:
    """A mount that keeps its attitude under a constant acceleration (east, north, up)."""
    rotation = rotation_from_rpy(*rpy_rad)
    east, north, up = acceleration

    def motion(t0: float, t1: float) -> MountMotion:
        return MountMotion(
            t_ns=round(t1 * NS_PER_S),
            interval_s=t1 - t0,
            position_enu_m=np.zeros(3),
            rotation=rotation,
            velocity_enu_m_s=np.zeros(3),
            mean_velocity_enu_m_s=np.zeros(3),
            mean_specific_force_m_s2=rotation.T @ np.array([east, north, up + G]),
            mean_rate_rad_s=np.zeros(3),
        )

    return motion


def log_of(*, runs: int = 1, until_s: float = 0.1, motion: Motion = STANDING, **errors: Any) -> Log:
    return drive(sensor(PERFECT | errors, runs=range(runs)), motion, until_s)


def test_perfect_unit_gives_attitude_and_acceleration_without_gravity_however_it_is_tilted() -> None:
    log = log_of(motion=accelerated((0.3, -0.2, 0.5), (0.2, -0.3, 2.5)))
    np.testing.assert_allclose(log.measurements[-1].values, [[0.2, -0.3, 2.5, 0.3, -0.2, 0.5]], atol=1e-12)


def test_acceleration_is_the_mean_over_the_interval_while_the_mount_turns() -> None:
    log = log_of(motion=circle(2.0, 10.0), until_s=1.0)
    # 0.4 m/s^2 to the left of a heading of 0.2 rad/s t; the mean of a vector that turns is its middle, times sinc.
    middle = 0.2 * (log.t_s - 0.01)
    shrunk = 0.4 * np.sinc(0.2 * 0.01 / np.pi)
    np.testing.assert_allclose(log.values("heading_rad")[:, 0], 0.2 * log.t_s, atol=1e-12)
    np.testing.assert_allclose(log.values(FREE_ACCELERATION[0])[:, 0], -shrunk * np.sin(middle), atol=1e-6)
    np.testing.assert_allclose(log.values(FREE_ACCELERATION[1])[:, 0], shrunk * np.cos(middle), atol=1e-6)
    np.testing.assert_allclose(log.values(UP), 0.0, atol=1e-12)


def test_heading_wraps() -> None:
    log = log_of(runs=200, motion=accelerated((0.0, 0.0, 0.0), (0.0, 0.0, 3.14)), heading_sigma_rad=0.02)
    heading = log.values("heading_rad")
    assert np.abs(heading).max() <= math.pi
    assert np.ptp(heading) > 6.0
    assert np.abs(log.hidden("heading_rad.error")).max() < 0.1


def tilt_errors(log: Log) -> tuple[FloatArray, FloatArray]:
    return log.hidden("roll_rad.error")[-1], log.hidden("pitch_rad.error")[-1]


def test_a_tilt_error_leaks_into_the_vertical_by_its_cosine_and_into_the_horizontal_by_its_sine() -> None:
    sigma = math.radians(0.3)
    log = log_of(runs=4000, attitude_sigma_rad=sigma)
    roll, pitch = tilt_errors(log)
    up = log.values(UP)[-1]
    tilt = np.arccos(np.cos(roll) * np.cos(pitch))
    np.testing.assert_allclose(up, -G * (1.0 - np.cos(tilt)), atol=1e-13)
    # Two axes of 0.3 degrees: g sigma^2 = 0.27 mm/s^2 on average (0.13 each), exponentially distributed: 1.6 %.
    assert -np.mean(up) == pytest.approx(G * sigma**2, rel=4 * 0.016)
    # Forward by g sin(pitch error), to the left by -g sin(roll error); the heading is east.
    np.testing.assert_allclose(log.values(FREE_ACCELERATION[0])[-1], G * np.cos(roll) * np.sin(pitch), atol=1e-13)
    np.testing.assert_allclose(log.values(FREE_ACCELERATION[1])[-1], -G * np.sin(roll), atol=1e-13)
    np.testing.assert_array_equal(log.hidden(f"{UP}.leak"), log.hidden(f"{UP}.error"))


def test_horizontal_acceleration_leaks_into_the_vertical_by_the_tilt_error() -> None:
    sigma = math.radians(0.3)
    log = log_of(runs=4000, attitude_sigma_rad=sigma, motion=accelerated((0.5, 0.0, 0.0)))
    roll, pitch = tilt_errors(log)
    still = -G * (1.0 - np.cos(roll) * np.cos(pitch))
    leaked = log.hidden(f"{UP}.leak")[-1] - still
    np.testing.assert_allclose(leaked, -0.5 * np.sin(pitch), atol=1e-13)
    # 0.5 m/s^2 and 0.3 degrees: 2.6 mm/s^2; 4000 runs: 1.1 %.
    assert np.std(leaked) == pytest.approx(2.6e-3, rel=0.05)


def test_a_heading_error_leaves_the_vertical_alone_and_turns_the_horizontal() -> None:
    log = log_of(runs=50, heading_sigma_rad=0.02, motion=accelerated((0.5, 0.0, 0.1)))
    error = log.hidden("heading_rad.error")[-1]
    np.testing.assert_allclose(log.values(UP), 0.1, atol=1e-12)
    np.testing.assert_allclose(log.values(FREE_ACCELERATION[1])[-1], 0.5 * np.sin(error), atol=1e-13)


def test_attitude_errors_have_their_sigma_and_last_as_long_as_told() -> None:
    log = log_of(
        runs=1000,
        until_s=1.02,
        attitude_sigma_rad=0.005,
        attitude_correlation_s=1.0,
        heading_sigma_rad=0.02,
        heading_correlation_s=2.0,
    )
    # 1000 runs: sigma to 2.2 %, correlation to sqrt((1 - r^2)^2 / 1000) < 3.2 %.
    for column, sigma, tau_s in (("roll_rad", 0.005, 1.0), ("pitch_rad", 0.005, 1.0), ("heading_rad", 0.02, 2.0)):
        error = log.hidden(f"{column}.error")
        assert np.std(error[0]) == pytest.approx(sigma, rel=4 * 0.022)
        assert np.corrcoef(error[0], error[50])[0, 1] == pytest.approx(math.exp(-1.0 / tau_s), abs=4 * 0.032)
    assert abs(np.corrcoef(log.hidden("roll_rad.error")[0], log.hidden("pitch_rad.error")[0])[0, 1]) < 4 * 0.032


def test_noise_has_its_density_in_the_allan_deviation() -> None:
    density = 60e-6 * G
    log = log_of(runs=40, until_s=100.0, accel_noise_density_m_s2_rthz=density)
    up = log.values(UP)
    # One sample averages 20 ms: density * sqrt(25 Hz) = 2.94 mm/s^2. 200000 samples: 0.16 %.
    assert np.std(up) == pytest.approx(density * 5.0, rel=4 * 0.0016)
    # White: N / sqrt(tau) with N = density / sqrt(2); 40 * 99 differences at 1 s: 1.4 % with their overlap of one.
    means = up.reshape(100, 50, 40).mean(axis=1)
    adev = np.sqrt(np.mean(np.diff(means, axis=0) ** 2) / 2.0)
    assert adev == pytest.approx(density / math.sqrt(2.0), rel=4 * 0.014)


def test_bias_is_offset_instability_and_trend() -> None:
    log = log_of(runs=1500, until_s=4.0, accel_bias_m_s2=0.01)
    bias = log.hidden(f"{UP}.bias")
    np.testing.assert_array_equal(bias[0], bias[-1])
    # 1500 runs: 1.8 %.
    assert np.std(bias[0]) == pytest.approx(0.01, rel=4 * 0.018)
    np.testing.assert_allclose(log.values(UP), bias, atol=1e-13)

    log = log_of(runs=1500, until_s=4.0, accel_bias_instability_m_s2=1e-3, accel_bias_correlation_s=1.0)
    bias = log.hidden(f"{UP}.bias")
    assert np.std(bias[0]) == pytest.approx(1e-3, rel=4 * 0.018)
    assert np.std(bias[-1]) == pytest.approx(1e-3, rel=4 * 0.018)
    assert np.corrcoef(bias[0], bias[50])[0, 1] == pytest.approx(math.exp(-1.0), abs=4 * 0.026)

    log = log_of(runs=1500, until_s=4.0, accel_trend_m_s3=1e-3)
    bias = log.hidden(f"{UP}.bias")
    np.testing.assert_allclose(bias, np.outer(log.t_s, bias[-1] / 4.0), atol=1e-15)
    assert np.std(bias[-1]) == pytest.approx(4e-3, rel=4 * 0.018)


def test_a_zero_offset_can_be_given_and_turns_with_the_mount() -> None:
    given = {"accel_bias_m_s2": 0.5, "accel_fixed_bias_m_s2": [0.0, 0.0, -0.0138]}
    level = log_of(runs=3, **given)
    np.testing.assert_allclose(level.values(UP), -0.0138, atol=1e-12)
    # On its side, rolled by 90 degrees with the heading east, the unit's z axis points to the south.
    rolled = log_of(motion=accelerated((0.0, 0.0, 0.0), (math.pi / 2, 0.0, 0.0)), **given)
    np.testing.assert_allclose(rolled.values(UP), 0.0, atol=1e-12)
    np.testing.assert_allclose(rolled.values(FREE_ACCELERATION[1]), 0.0138, atol=1e-12)
    np.testing.assert_allclose(rolled.hidden(f"{FREE_ACCELERATION[1]}.bias"), 0.0138, atol=1e-12)
    assert level.sensor.info.datasheet["free_accel_bias_m_s2"] == 0.5


def test_outliers_come_as_often_and_as_large_as_told_in_each_run_by_itself() -> None:
    log = log_of(runs=100, until_s=20.0, outlier_probability=0.02, outlier_sigma_m_s2=0.1)
    outlier = log.hidden(f"{UP}.outlier")
    hit = outlier != 0.0
    # 100000 samples: probability to sqrt(0.0196 / 1e5) = 0.044 %; 2000 outliers: sigma to 1.6 %.
    assert np.mean(hit) == pytest.approx(0.02, abs=4 * 0.00044)
    assert np.std(outlier[hit]) == pytest.approx(0.1, rel=4 * 0.016)
    np.testing.assert_allclose(log.values(UP), outlier, atol=1e-13)
    # All components together, each by itself.
    east = log.hidden(f"{FREE_ACCELERATION[0]}.error")
    np.testing.assert_array_equal(np.abs(east) > 1e-12, hit)
    assert abs(np.corrcoef(east[hit], outlier[hit])[0, 1]) < 4 / math.sqrt(2000)
    assert not np.array_equal(hit[:, 0], hit[:, 1])


def test_the_preset_is_an_mti300() -> None:
    log = drive(sensor(preset("ahrs_mti300"), runs=range(400)), STANDING, 1.0)
    assert log.sensor.columns == COLUMNS
    sheet = log.sensor.info.datasheet
    assert sheet["free_accel_noise_m_s2"] == pytest.approx(60e-6 * G * 5.0, rel=1e-5)
    assert sheet["free_accel_bias_instability_m_s2"] == pytest.approx(15e-6 * G, rel=1e-5)
    assert sheet["attitude_sigma_rad"] == pytest.approx(math.radians(0.3), rel=1e-4)
    # Within a run, beside the outliers, of which there is one in a thousand samples: 20000 of them, 0.5 %.
    up, outlier = log.values(UP), log.hidden(f"{UP}.outlier") != 0.0
    within = np.nanvar(np.where(outlier, np.nan, up), axis=0, ddof=1)
    assert math.sqrt(np.mean(within)) == pytest.approx(sheet["free_accel_noise_m_s2"], rel=4 * 0.005)
    assert np.mean(outlier) == pytest.approx(sheet["outlier_probability"], abs=4 * math.sqrt(0.001 / 20_000))
    other = sensor(preset("ahrs_mti300"), seed=7, runs=[3]).info
    assert other.datasheet == sheet
