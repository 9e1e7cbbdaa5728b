"""Eqs 70 and 71 as a control law: what it asks, and whether what it does is stable."""

from __future__ import annotations

import itertools
import math
from collections import deque
from typing import Any

import numpy as np
import pytest

from twin.control.lane_keeping import STOPPED_AT_END
from twin.control.tree_distances import DRIVING, NO_TREES, TreeDistancesDriver, TreeDistancesDriverConfig
from twin.signals import NS_PER_S, Command, FloatArray, Knowledge, Said

STEP_S = 0.02
LEVER_M, HALF_M = 0.055, 0.4


def driver(**changes: Any) -> TreeDistancesDriver:
    table = {"kind": "tree_distances", "follows": "distances", "lane_m": 1000.0, "acceleration_m_s2": 5.0, **changes}
    return TreeDistancesDriver(TreeDistancesDriverConfig.model_validate(table), start_e_n_heading=(0.0, 0.0, 0.0))


def told(pair: float, first: float, second: float, third: float = math.nan, fourth: float = math.nan) -> Knowledge:
    names = ("tree_1_m", "tree_2_m", "tree_3_m", "tree_4_m")
    values = {"pair": pair} | dict(zip(names, (first, second, third, fourth), strict=True))
    return Knowledge(t_ns=NS_PER_S, said={"distances": Said(t_ns=NS_PER_S, values=values)})


def test_the_difference_in_centimetres_times_k_is_the_yaw_rate() -> None:
    machine = driver(speed_m_s=0.1)
    # 3 cm nearer to the tree on the left: to the right at 0.03 rad/s.
    command = machine.command(told(1.0, 0.37, 0.40), STEP_S)
    assert command == Command(speed_m_s=pytest.approx(0.1), yaw_rate_rad_s=pytest.approx(-0.03))
    assert machine.state == DRIVING
    assert machine.command(told(2.0, 0.37, 0.40, 0.95, 0.90), STEP_S).yaw_rate_rad_s == pytest.approx(0.05)


def test_without_trees_it_goes_straight_on_at_the_same_speed() -> None:
    machine = driver(speed_m_s=0.1)
    command = machine.command(told(0.0, math.nan, 0.40), STEP_S)
    assert command == Command(speed_m_s=pytest.approx(0.1))
    assert machine.state == NO_TREES


def test_it_stops_at_the_end_of_the_lane_whatever_it_sees() -> None:
    machine = driver(lane_m=1.0)
    for _ in range(200):
        command = machine.command(told(0.0, math.nan, math.nan), STEP_S)
    assert machine.state == STOPPED_AT_END
    assert command.brake


def swing(speed_m_s: float, delay_s: float, duration_s: float) -> FloatArray:
    """Offsets of a robot between walls 0.4 m to either side, seen ``delay_s`` ago from a lidar ahead of the axle."""
    machine = driver(speed_m_s=speed_m_s)
    offset, heading, offsets = 1e-4, 0.0, []
    seen = deque([offset] * (1 + round(delay_s / STEP_S)), maxlen=1 + round(delay_s / STEP_S))
    for _ in range(round(duration_s / STEP_S)):
        seen.append(offset + LEVER_M * math.sin(heading))
        command = machine.command(told(1.0, HALF_M - seen[0], HALF_M + seen[0]), STEP_S)
        heading += command.yaw_rate_rad_s * STEP_S
        offset += command.speed_m_s * math.sin(heading) * STEP_S
        offsets.append(offset)
    return np.array(offsets)


@pytest.mark.parametrize(("speed", "delay"), [(0.1, 0.3), (0.1, 0.0), (0.5, 0.3), (0.5, 0.1), (0.25, 0.3)])
def test_the_law_is_a_swing_damped_by_lever_less_delay(speed: float, delay: float) -> None:
    # e'' + 2 k (l - v T) e' + 2 k v e = 0 with k = 1 rad/s per metre: amplitudes grow by exp(k (v T - l) t). Steps in
    # which the heading moves first and the offset by the new one add neither damping nor delay.
    offsets = swing(speed, delay, 80.0)
    crossings = np.flatnonzero(np.diff(np.signbit(offsets)))
    period_s = 2.0 * np.mean(np.diff(crossings)) * STEP_S
    assert period_s == pytest.approx(2.0 * math.pi / math.sqrt(2.0 * speed), rel=0.03)
    half = [np.abs(offsets[a:b]).max() for a, b in itertools.pairwise(crossings)]
    growth = np.polyfit(STEP_S * crossings[:-1], np.log(half), 1)[0]
    # The first order of a delay: the next is of the order of (rate T)^2.
    assert growth == pytest.approx(speed * delay - LEVER_M, abs=0.002, rel=0.5 * speed * delay + 0.02)


def test_the_truth_tells_no_distances() -> None:
    with pytest.raises(ValueError, match="name an estimator of kind 'tree_distances'"):
        driver(follows="truth")
