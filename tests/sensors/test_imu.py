"""The IMU's physics: what it makes of known forces and rates."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, STANDING, circle, drive, preset, sensor, spin
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.sensors.imu import Imu
from twin.signals import FloatArray

COLUMNS = Imu.columns


def test_perfect_imu_gives_mean_specific_force_and_rate() -> None:
    log = drive(sensor({"kind": "imu", "rate_hz": 50.0}), circle(2.0, 10.0), 0.1)
    assert len(log.samples) == 5
    # 2 m/s on 10 m to the left: 0.4 m/s^2 to the left, 0.2 rad/s.
    np.testing.assert_allclose(log.measurements[0].values, [[0.0, 0.4, G, 0.0, 0.0, 0.2]], atol=1e-12)


def test_row_unit_noise_has_the_variances_of_paper_000() -> None:
    # Table 4.1: accelerometers 0.05 to 0.5 (m/s^2)^2, gyros 1e-6 (rad/s)^2. 3 axes x 20 runs x 250 samples: variance to
    # sqrt(2/15000) = 1.2 %, within four of that; rounding to 1.2e-3 m/s^2 and 1.3e-4 rad/s adds lsb^2/12.
    log = drive(sensor(preset("imu_row_unit"), runs=range(20)), STANDING, 5.0)
    values = np.stack([measurement.values for measurement in log.measurements])
    spread = np.var(values, axis=0, ddof=1)
    accel, gyro = spread[:, :3].mean(), spread[:, 3:].mean()
    assert accel == pytest.approx(0.05, rel=0.05)
    assert gyro == pytest.approx(1e-6 + (2 * 4.363323 / 2**16) ** 2 / 12, rel=0.05)


def test_datasheet_tells_the_noise_and_never_a_drawn_error() -> None:
    one, other = (sensor(preset("imu_row_unit"), seed=seed, runs=[run]).info for seed, run in ((1, 0), (2, 7)))
    assert one == other
    assert one.datasheet["accel_noise_m_s2"] == pytest.approx(np.sqrt(0.05), rel=1e-4)
    assert one.datasheet["gyro_noise_rad_s"] == pytest.approx(1e-3, rel=1e-4)


def test_turn_on_bias_is_constant_and_has_its_sigma_over_runs() -> None:
    device = sensor({"kind": "imu", "rate_hz": 50.0, "gyro_bias_rad_s": 0.04, "accel_bias_m_s2": 0.5}, runs=range(1000))
    log = drive(device, STANDING, 0.1)
    gyro = log.values("gyro_y_rad_s")
    np.testing.assert_array_equal(gyro[0], gyro[-1])
    # 1000 runs: standard error of a sigma 1/sqrt(2000) = 2.2 %.
    assert np.std(gyro[0]) == pytest.approx(0.04, rel=0.09)
    assert np.std(log.values("accel_z_m_s2")[0] - G) == pytest.approx(0.5, rel=0.09)
    np.testing.assert_array_equal(log.hidden("gyro_y_rad_s.bias"), gyro)


def test_hidden_bias_moves_as_gauss_markov_plus_random_walk() -> None:
    config = {
        "kind": "imu",
        "rate_hz": 50.0,
        "gyro_bias_instability_rad_s": 1e-3,
        "gyro_bias_correlation_s": 1.0,
        "gyro_bias_random_walk_rad_s_rts": 1e-3,
    }
    log = drive(sensor(config, runs=range(1500)), STANDING, 4.0)
    # After 4 s: sigma^2 + K^2 t = 1e-6 (1 + 4); first sample: 1e-6 (1 + 0.02). Four standard errors of 3.7 %.
    bias = log.hidden("gyro_x_rad_s.bias")
    assert np.var(bias[-1]) == pytest.approx(5e-6, rel=0.15)
    assert np.var(bias[0]) == pytest.approx(1.02e-6, rel=0.15)
    np.testing.assert_allclose(log.values("gyro_x_rad_s"), bias, atol=1e-15)


def test_scale_misalignment_and_tilt_act_on_the_truth() -> None:
    config = {"kind": "imu", "rate_hz": 50.0}
    force, rate = (0.0, 0.0, 10.0), (0.0, 0.0, 1.0)

    def column(name: str, **errors: float) -> FloatArray:
        log = drive(sensor(config | errors, runs=range(1000)), spin(force, rate), 0.02)
        return log.measurements[0].column(name)

    # Standard error of a sigma over 1000 runs: 2.2 %; four of them.
    assert np.std(column("gyro_z_rad_s", gyro_scale_error_ratio=0.02)) == pytest.approx(0.02, rel=0.09)
    assert np.std(column("gyro_x_rad_s", gyro_misalignment_rad=0.01)) == pytest.approx(0.01, rel=0.09)
    assert np.std(column("accel_y_m_s2", accel_misalignment_rad=0.01)) == pytest.approx(0.1, rel=0.09)
    assert np.ptp(column("accel_y_m_s2", gyro_misalignment_rad=0.01)) == 0.0
    # A tilted unit sees g sin(tilt) across and keeps the length of the vector; both triads tilt together.
    tilted = drive(sensor(config | {"mounting_tilt_rad": 0.02}, runs=range(1000)), spin(force, rate), 0.02)
    values = tilted.measurements[0].values
    np.testing.assert_allclose(np.linalg.norm(values[:, :3], axis=1), 10.0, rtol=1e-12)
    np.testing.assert_allclose(values[:, :3], 10.0 * values[:, 3:], atol=1e-12)
    assert np.std(values[:, 0]) == pytest.approx(0.2, rel=0.09)


def test_output_is_quantised_and_clipped() -> None:
    config = {"kind": "imu", "rate_hz": 50.0, "accel_range_m_s2": 16.0, "gyro_range_rad_s": 4.0, "adc_bits": 8}
    log = drive(sensor(config), spin((3.3, -99.0, 99.0), (0.1, 9.0, -9.0)), 0.02)
    # LSB 32/256 = 0.125 and 8/256 = 0.03125; codes -128 to 127.
    np.testing.assert_array_equal(log.measurements[0].values, [[3.25, -16.0, 15.875, 0.09375, 3.96875, -4.0]])


def test_bandwidth_delays_the_signal() -> None:
    # A step at t = 1 s through 2 Hz: one time constant 1/(2 pi 2) = 79.6 ms; samples are at 20 ms.
    device = sensor({"kind": "imu", "rate_hz": 50.0, "gyro_bandwidth_hz": 2.0})
    log = drive(device, lambda t0, t1: spin((0, 0, G), (0, 0, 1.0 if t0 >= 0.999 else 0.0))(t0, t1), 1.5)
    after = log.t_s > 1.001
    expected = 1.0 - np.exp(-(log.t_s[after] - 1.0) * 4 * np.pi)
    np.testing.assert_allclose(log.values("gyro_z_rad_s")[after, 0], expected, atol=1e-9)


def test_bits_without_a_range_are_refused() -> None:
    with pytest.raises(ValidationError, match="adc_bits needs"):
        CONFIGS.validate_python({"kind": "imu", "mount": "m", "rate_hz": 50.0, "adc_bits": 12})


@pytest.mark.parametrize(
    ("accel_g", "gyro_deg_s", "accel_lsb", "gyro_lsb_deg_s"),
    [(2, 250, 0.0006, 0.0076), (4, 500, 0.0012, 0.0153), (8, 1000, 0.0024, 0.0305), (16, 2000, 0.0048, 0.0610)],
)
def test_the_mpu6050_has_its_resolution_in_all_four_ranges(
    accel_g: int, gyro_deg_s: int, accel_lsb: float, gyro_lsb_deg_s: float
) -> None:
    # Paper 001, eqs 8 to 15: 16 bits over twice the range, to the digits printed there.
    ranges = {"accel_range_m_s2": accel_g * G, "gyro_range_rad_s": np.radians(gyro_deg_s)}
    log = drive(sensor(preset("imu_mpu6050") | ranges), STANDING, 4.0)
    values = np.concatenate([measurement.values for measurement in log.measurements])
    for column, lsb, printed in (
        (0, 2.0 * accel_g * G / 2**16, accel_lsb),
        (3, np.radians(2.0 * gyro_deg_s / 2**16), np.radians(gyro_lsb_deg_s)),
    ):
        assert lsb == pytest.approx(printed, rel=0.01)
        steps = values[:, column] / lsb
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
        assert len(np.unique(np.round(steps))) > 1


def test_a_bno085_is_quieter_in_bias_and_has_its_ranges() -> None:
    sheet = sensor(preset("imu_bno085")).info.datasheet
    assert sheet["accel_range_m_s2"] == pytest.approx(8.0 * G)
    assert sheet["gyro_range_rad_s"] == pytest.approx(np.radians(2000.0), rel=1e-6)
    assert sheet["gyro_bias_rad_s"] < sensor(preset("imu_mpu6050")).info.datasheet["gyro_bias_rad_s"]
