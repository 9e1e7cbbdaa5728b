"""When samples are taken and when they arrive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.sensors.motions import DT_NS, STANDING, constant, drive, sensor
from tests.sensors.test_gnss import PERFECT
from twin.errors import BadInputError
from twin.signals import NS_PER_S

IMU = {"kind": "imu", "rate_hz": 50.0}


def test_first_sample_is_due_one_period_after_the_start_and_then_evenly() -> None:
    log = drive(sensor(IMU), STANDING, 1.0)
    assert log.taken_ns == [20_000_000 * k for k in range(1, 51)]
    assert [m.t_ns for m in log.measurements] == log.taken_ns
    assert [m.t_available_ns for m in log.measurements] == log.taken_ns


@pytest.mark.parametrize(
    ("rate_hz", "nearest"), [(30.0, "29.41176471, 31.25"), (1000.0, "500"), (499.0, "250, 500"), (0.3, "0.300120048")]
)
def test_a_rate_that_does_not_divide_is_refused(rate_hz: float, nearest: str) -> None:
    with pytest.raises(BadInputError) as error:
        sensor(IMU | {"rate_hz": rate_hz})
    message = str(error.value)
    assert message.startswith(f"rate_hz = {rate_hz:g}: does not divide the physics rate 500 Hz; nearest that do: ")
    assert nearest in message


@pytest.mark.parametrize("rate_hz", [500.0, 250.0, 100.0, 31.25, 500 / 3, 1.0, 0.1])
def test_rates_that_divide_are_taken(rate_hz: float) -> None:
    assert sensor(IMU | {"rate_hz": rate_hz}).next_tick == round(500 / rate_hz)


def test_latency_delays_arrival_to_a_tick_and_not_the_stamp() -> None:
    log = drive(sensor(IMU | {"latency_s": 0.0051}), STANDING, 0.1)
    for taken, measurement in zip(log.taken_ns, log.measurements, strict=True):
        assert measurement.t_ns == taken
        assert measurement.t_available_ns == taken + 6_000_000


def test_latency_jitter_is_exponential_and_puts_samples_out_of_order() -> None:
    log = drive(sensor(PERFECT | {"latency_s": 0.1, "latency_jitter_s": 0.2}), STANDING, 300.0)
    arrival = np.array([m.t_available_ns for m in log.measurements])
    delay = (arrival - np.array(log.taken_ns)) / NS_PER_S
    assert delay.min() >= 0.1
    assert np.all(arrival % DT_NS == 0)
    # 3000 exponential delays of mean 0.2 s: standard error 0.2/sqrt(3000); rounding up to a tick adds half of one.
    assert delay.mean() == pytest.approx(0.301, abs=4 * 0.2 / math.sqrt(3000))
    # A sample overtakes its predecessor if the delays differ by more than the period: e^{-0.1/0.2}/2 = 0.30.
    assert np.mean(np.diff(arrival) < 0) == pytest.approx(math.exp(-0.5) / 2, abs=0.05)


def test_time_jitter_moves_the_true_instant_and_not_the_stamp() -> None:
    log = drive(sensor(PERFECT | {"time_jitter_s": 0.01}), constant(2.0), 200.0)
    stamps = np.array([m.t_ns for m in log.measurements])
    assert stamps.tolist() == [100_000_000 * k for k in range(1, len(stamps) + 1)]
    late = (np.array(log.taken_ns) - stamps) / NS_PER_S
    # 2000 values: sigma to 1.6 %; rounding to 2 ms adds 0.3 %.
    assert np.std(late) == pytest.approx(0.01, rel=0.07)
    np.testing.assert_allclose(log.hidden("clock_error_s")[:, 0], -late, atol=1e-12)
    # At 2 m/s the position is that of the true instant.
    np.testing.assert_allclose(log.values("position_e_m")[:, 0], 2.0 * np.array(log.taken_ns) / NS_PER_S, atol=1e-9)


def test_large_time_jitter_keeps_samples_in_order() -> None:
    log = drive(sensor(IMU | {"time_jitter_s": 1.0}), STANDING, 10.0)
    assert np.diff(log.taken_ns).min() >= DT_NS


def test_dropouts_are_binomial_and_differ_between_runs() -> None:
    log = drive(sensor(IMU | {"dropout_probability": 0.2}, runs=range(40)), STANDING, 10.0)
    lost = ~log.valid
    # 40 * 500 draws: standard error sqrt(0.2 * 0.8/20000) = 0.28 %.
    assert lost.mean() == pytest.approx(0.2, abs=4 * 0.0028)
    assert not np.array_equal(lost[:, 0], lost[:, 1])
    values = log.values("accel_z_m_s2")
    assert np.isnan(values[lost]).all()
    assert np.isfinite(values[~lost]).all()


def test_a_single_run_gives_no_measurement_for_a_lost_sample() -> None:
    log = drive(sensor(IMU | {"dropout_probability": 0.5}), STANDING, 10.0)
    empty = [sample for sample in log.samples if not sample.measurements]
    # 500 draws: standard error 2.2 %.
    assert len(empty) / 500 == pytest.approx(0.5, abs=0.09)
    assert all(np.isfinite(sample.hidden).all() for sample in empty)
