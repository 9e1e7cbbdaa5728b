"""The steering potentiometer: the angle of the wheel in the middle, and what a potentiometer makes of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import DT_NS, preset, sensor
from twin.signals import FloatArray, JointMotion, JointNeed

PERFECT: dict[str, Any] = {"kind": "angle_transducer", "rate_hz": 1.0}
ANGLES = np.radians(np.linspace(-70.0, 70.0, 281))


def knuckles(angle_rad: float, *, wheelbase_m: float = 1.10, track_m: float = 1.2) -> FloatArray:
    """Angles of both front wheels on a turn about a point on the rear axle's line."""
    if angle_rad == 0.0:
        return np.zeros(2)
    radius_m, side = wheelbase_m / math.tan(angle_rad), math.copysign(1.0, angle_rad)
    # Their axes meet there: a wheel whose steering axis is so far to the side of it stands square to the line from it.
    return np.array([math.atan2(side * wheelbase_m, side * (radius_m + y)) for y in (-0.5 * track_m, 0.5 * track_m)])


def read(angles_rad: FloatArray, *, runs: int = 1, **config: Any) -> FloatArray:
    """Readings over a sweep, (T, R)."""
    device = sensor(PERFECT | config, runs=range(runs))
    rows = []
    for angle in angles_rad.tolist():
        capture = JointMotion(
            t_ns=device.next_tick * DT_NS, position_enu_m=np.zeros(3), position=knuckles(angle, track_m=0.8)
        )
        rows.append(device.sample(capture).measurements[0].column("steering_angle_rad"))
    return np.stack(rows)


def test_it_asks_for_both_knuckles() -> None:
    need = sensor(PERFECT).need
    assert isinstance(need, JointNeed)
    assert need.joints == ("steering_left", "steering_right")


def test_a_perfect_one_gives_the_angle_of_the_wheel_in_the_middle() -> None:
    # A single wheel in the middle of the axle, whose axis goes through the same point of the rear axle's line.
    np.testing.assert_allclose(read(ANGLES)[:, 0], ANGLES, atol=1e-12)
    for wheelbase_m, track_m in ((2.0, 0.9), (1.1, 1.2)):
        device = sensor(PERFECT)
        wheels = knuckles(0.5, wheelbase_m=wheelbase_m, track_m=track_m)
        assert wheels[0] > 0.5 > wheels[1]
        capture = JointMotion(t_ns=device.next_tick * DT_NS, position_enu_m=np.zeros(3), position=wheels)
        assert device.sample(capture).measurements[0].values[0, 0] == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize("wheels", [(0.01, -0.01), (1e-9, -2e-9), (0.0, 0.0), (0.0, 0.02)])
def test_wheels_that_point_to_different_sides_give_their_mean(wheels: tuple[float, float]) -> None:
    device = sensor(PERFECT)
    capture = JointMotion(t_ns=device.next_tick * DT_NS, position_enu_m=np.zeros(3), position=np.array(wheels))
    assert device.sample(capture).measurements[0].values[0, 0] == pytest.approx(0.5 * sum(wheels), abs=1e-15)


def test_the_n35_has_1024_steps_over_345_degrees() -> None:
    step = math.radians(345.0) / 1024.0
    counts = read(ANGLES, runs=20, **preset("potentiometer_n35")) / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-4)
    assert sensor(preset("potentiometer_n35")).info.datasheet["resolution_rad"] == pytest.approx(step, rel=1e-6)


def test_the_n35_errs_as_its_figures_say() -> None:
    straight = read(np.zeros(2), runs=2000, **preset("potentiometer_n35"))
    # With the wheels straight, where it was set to zero: 1 deg of mounting; noise 0.1; rounding 0.337/sqrt(12).
    # 2000 runs: 1.6 %.
    expected = math.sqrt(1.0 + 0.1**2 + 0.337**2 / 12.0)
    assert np.degrees(np.std(straight[0])) == pytest.approx(expected, rel=4 * 0.016)
    # Turned by 60 deg the bow shows, drawn evenly within 0.5 % of 345 deg, less what it is in the middle.
    turned = read(np.full(2, math.radians(60.0)), runs=2000, **preset("potentiometer_n35"))
    bow = 1.725 * (1.0 - math.cos(math.pi * 60.0 / 345.0)) / math.sqrt(3.0)
    assert np.degrees(np.std(turned[0])) == pytest.approx(math.hypot(expected, bow), rel=4 * 0.016)
    # Offset and bow stay: two readings differ by noise and rounding alone.
    assert np.degrees(np.abs(straight[1] - straight[0]).max()) < 2 * 0.337 + 5 * 0.1 * math.sqrt(2.0)
