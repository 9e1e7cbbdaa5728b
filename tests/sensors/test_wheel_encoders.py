"""Slots counted are the way driven, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import DT_NS, sensor
from twin.sensors import Sensor
from twin.signals import NS_PER_S, FloatArray, JointMotion, JointNeed

SLOT_RAD = 2.0 * math.pi / 20.0
CONFIG = {"kind": "wheel_encoders", "rate_hz": 50.0}


def turn(device: Sensor, angles: Callable[[float], tuple[float, float]], duration_s: float) -> tuple[FloatArray, Any]:
    """Counts (T, R, 2) and the hidden errors (T, R, 2) of wheels that turn as given."""
    counts, errors = [], []
    while (t_ns := device.next_tick * DT_NS) <= duration_s * NS_PER_S:
        sample = device.sample(
            JointMotion(t_ns=t_ns, position_enu_m=np.zeros(3), position=np.array(angles(t_ns / NS_PER_S)))
        )
        counts.append(sample.measurements[0].values)
        errors.append(sample.hidden[:, :2])
    return np.array(counts), np.array(errors)


def test_one_slot_is_the_circumference_over_twenty() -> None:
    # 2 m with 3.3 cm: 2 / (2 pi 0.033 / 20) = 192.9 slots; the phase makes that 192 or 193.
    radius_m, way_m, duration_s = 0.033, 2.0, 4.0
    device = sensor(CONFIG, runs=range(2000))
    assert device.need == JointNeed(mount=device.mount, joints=("wheel_left", "wheel_right"))
    begin = device.next_tick * DT_NS / NS_PER_S
    rate = way_m / radius_m / (duration_s - begin)
    counts, errors = turn(device, lambda t: (rate * (t - begin), -rate * (t - begin)), duration_s)
    slots = way_m / (2.0 * math.pi * radius_m / 20.0)
    assert slots == pytest.approx(192.9, abs=0.05)
    assert set(np.unique(counts[-1, :, 0])) == {192.0, 193.0}
    assert set(np.unique(counts[-1, :, 1])) == {-193.0, -192.0}
    # Over many phases the mean is the way itself: standard error sqrt(p (1 - p) / 2000) = 0.7 % of a slot; four.
    assert counts[-1, :, 0].mean() == pytest.approx(slots, abs=0.027)
    assert counts[-1, :, 1].mean() == pytest.approx(-slots, abs=0.027)
    assert np.abs(errors).max() < 1.0
    assert np.diff(counts[:, 0, 0]).min() >= 0.0
    assert np.array_equal(counts, np.round(counts))


def test_a_wheel_that_comes_back_counts_back() -> None:
    device = sensor(CONFIG, runs=range(50))
    counts, _ = turn(device, lambda t: (3.0 * math.sin(2.0 * math.pi * (t - 0.02) / 2.0),) * 2, 2.02)
    assert np.all(counts[-1] == 0.0)
    highest = 3.0 / SLOT_RAD
    assert np.all(np.abs(counts.max(axis=0) - highest) < 1.0)


@pytest.mark.parametrize("slots", [1, 20, 1024])
def test_any_number_of_slots(slots: int) -> None:
    device = sensor({**CONFIG, "slots_per_turn": slots})
    assert device.info.datasheet["slots_per_turn"] == slots
    counts, _ = turn(device, lambda t: (math.pi * t, 0.0), 4.0)
    turns = math.pi * (len(counts) - 1) * 0.02 / (2.0 * math.pi)
    assert counts[-1, 0, 0] == pytest.approx(turns * slots, abs=0.999)
    assert np.all(counts[:, :, 1] == 0.0)


def test_missed_slots_are_missing_and_have_their_probability() -> None:
    device = sensor({**CONFIG, "missed_slot_probability": 0.1}, runs=range(200))
    counts, errors = turn(device, lambda t: (10.0 * t, -10.0 * t), 20.0)
    passed = 10.0 * 19.98 / SLOT_RAD
    # 200 runs x 636 slots: standard error of the share 0.3 / sqrt(127200) = 0.08 %; four, and the phase's half slot.
    for side, sign in ((0, 1.0), (1, -1.0)):
        assert (sign * counts[-1, :, side]).mean() == pytest.approx(0.9 * passed, rel=0.005)
        assert np.all(sign * np.diff(counts[:, :, side], axis=0) >= 0.0)
        assert np.all(sign * errors[-1, :, side] < 0.0)


def test_a_member_counts_what_its_own_run_counts() -> None:
    config = {**CONFIG, "missed_slot_probability": 0.05}
    together, _ = turn(sensor(config, runs=range(6)), lambda t: (9.0 * t, 7.0 * t), 3.0)
    alone, _ = turn(sensor(config, runs=(4,)), lambda t: (9.0 * t, 7.0 * t), 3.0)
    np.testing.assert_array_equal(together[:, 4:5], alone)
    assert not np.array_equal(together[:, 3:4], alone)
