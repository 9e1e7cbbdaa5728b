"""Our driver of a lane: how it steers, when it slows, why it stops."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import pytest
from pydantic import ValidationError

from twin.control.lane_following import (
    DRIVING,
    SLOW_BLIND,
    SLOW_UNSURE,
    STOPPED_BLIND,
    STOPPED_UNSURE,
    LaneFollowing,
    LaneFollowingConfig,
)
from twin.control.lane_keeping import STANDING, STOPPED_AT_END
from twin.signals import NS_PER_S, Command, Knowledge, Said, VehicleState

STEP_S = 0.02


def config(**changes: Any) -> LaneFollowingConfig:
    return LaneFollowingConfig.model_validate({"kind": "lane_following", "follows": "rows", "lane_m": 100.0, **changes})


class Lane:
    """A machine that does at once what it is asked, told of its place ``delay_s`` late."""

    def __init__(
        self, *, offset_m: float = 0.0, heading_rad: float = 0.0, delay_s: float = 0.0, **changes: Any
    ) -> None:
        self.driver = LaneFollowing(config(**changes), start_e_n_heading=(0.0, 0.0, 0.0))
        self.offset_m, self.heading_rad, self.way_m, self.t_s = offset_m, heading_rad, 0.0, 0.0
        self.rows, self.sigma_m, self.curvature_1_m = 2.0, 0.01, 0.0
        self.path: list[tuple[float, float]] = []
        self.states: list[str] = []
        self.command = Command()
        self._told = deque(
            [(offset_m, heading_rad)] * (1 + round(delay_s / STEP_S)), maxlen=1 + round(delay_s / STEP_S)
        )

    def go(self, duration_s: float) -> None:
        for _ in range(round(duration_s / STEP_S)):
            self._told.append((self.offset_m, self.heading_rad))
            offset, heading = self._told[0]
            values = {
                "lane_offset_m": offset,
                "lane_heading_rad": heading,
                "rows_seen": self.rows,
                "lane_offset_m.sigma": self.sigma_m,
            }
            t_ns = round(self.t_s * NS_PER_S)
            self.command = self.driver.command(
                Knowledge(t_ns=t_ns, said={"rows": Said(t_ns=t_ns, values=values)}), STEP_S
            )
            speed = self.command.speed_m_s
            self.heading_rad += (self.command.yaw_rate_rad_s + speed * self.curvature_1_m) * STEP_S
            self.offset_m += speed * math.sin(self.heading_rad) * STEP_S
            self.way_m += speed * math.cos(self.heading_rad) * STEP_S
            self.t_s += STEP_S
            self.path.append((self.way_m, self.offset_m))
            if not self.states or self.states[-1] != self.driver.state:
                self.states.append(self.driver.state)


def test_an_offset_dies_down_critically_damped() -> None:
    machine = Lane(offset_m=0.05, steering_bandwidth_1_m=2.0)
    machine.go(10.0)
    for way in (0.5, 1.0, 2.0):
        s, offset = min(machine.path, key=lambda each: abs(each[0] - way))
        assert offset == pytest.approx(0.05 * (1.0 + 2.0 * s) * math.exp(-2.0 * s), abs=0.002)
    assert min(offset for _, offset in machine.path) > -0.001


def test_wheels_that_differ_hold_it_off_by_curvature_over_bandwidth_squared() -> None:
    machine = Lane(steering_bandwidth_1_m=2.0)
    machine.curvature_1_m = 0.067
    machine.go(20.0)
    assert machine.offset_m == pytest.approx(0.067 / 2.0**2, rel=0.02)


@pytest.mark.parametrize(("product", "stable"), [(0.3, True), (0.55, True), (0.8, False)])
def test_delay_times_bandwidth_decides_over_stability(product: float, stable: bool) -> None:
    # Phase margin 76 degrees at 2.06 w: the limit is at w D = 0.65.
    w, speed = 2.0, 0.5
    machine = Lane(offset_m=0.02, delay_s=product / w / speed, steering_bandwidth_1_m=w, largest_rate_deg_s=360.0)
    machine.go(40.0)
    late = max(abs(offset) for way, offset in machine.path if way > machine.way_m - 4.0)
    assert (late < 0.01) == stable


def test_it_does_not_set_out_before_it_has_seen_the_rows() -> None:
    machine = Lane()
    machine.rows = 0.0
    machine.go(1.0)
    assert machine.states == [STANDING]
    assert machine.command.brake
    machine.rows = 1.0
    machine.go(1.0)
    assert machine.states[-1] == DRIVING


def test_without_rows_it_slows_and_stops_within_its_blind_distance() -> None:
    machine = Lane(blind_m=1.0, slowest_share=0.5, acceleration_m_s2=1.0)
    machine.go(3.0)
    lost_at = machine.way_m
    machine.rows = 0.0
    machine.go(1.0)
    assert machine.driver.state == SLOW_BLIND
    assert machine.command.speed_m_s == pytest.approx(0.25)
    machine.go(10.0)
    assert machine.states == [DRIVING, SLOW_BLIND, STOPPED_BLIND]
    assert machine.way_m - lost_at == pytest.approx(1.0 + 0.25**2 / 2.0, abs=0.02)
    assert machine.command == Command(brake=True)
    machine.rows = 2.0
    machine.go(2.0)
    assert machine.driver.state == STOPPED_BLIND


def test_rows_have_to_be_seen_again_for_a_while() -> None:
    machine = Lane(blind_m=5.0, sure_s=1.0)
    machine.go(2.0)
    for _ in range(4):  # a scan in two, as at the edge of what the light allows
        machine.rows = 0.0
        machine.go(0.2)
        machine.rows = 2.0
        machine.go(0.2)
    assert machine.states == [DRIVING, SLOW_BLIND]
    machine.go(1.1)
    assert machine.states == [DRIVING, SLOW_BLIND, DRIVING]


def test_the_sigma_of_the_offset_slows_it_in_proportion_and_stops_it() -> None:
    machine = Lane(slow_sigma_m=0.06, stop_sigma_m=0.12, slowest_share=0.5)
    machine.go(1.0)
    machine.sigma_m = 0.09
    machine.go(1.0)
    assert machine.driver.state == SLOW_UNSURE
    assert machine.command.speed_m_s == pytest.approx(0.5 * 0.75)
    machine.sigma_m = 0.13
    machine.go(1.0)
    assert machine.driver.state == STOPPED_UNSURE
    assert machine.command.speed_m_s == 0.0


def test_an_estimator_that_falls_silent_is_blind() -> None:
    driver = LaneFollowing(config(blind_m=0.2), start_e_n_heading=(0.0, 0.0, 0.0))
    values = {"lane_offset_m": 0.0, "lane_heading_rad": 0.0, "rows_seen": 2.0, "lane_offset_m.sigma": 0.01}
    for k in range(200):
        said = {"rows": Said(t_ns=0, values=values)}
        driver.command(Knowledge(t_ns=round(k * STEP_S * NS_PER_S), said=said), STEP_S)
    assert driver.state == STOPPED_BLIND


def test_it_stops_at_the_end_and_may_follow_the_truth() -> None:
    machine = Lane(lane_m=2.0)
    machine.go(6.0)
    assert machine.states == [DRIVING, STOPPED_AT_END]
    assert machine.way_m == pytest.approx(2.0, abs=0.02)
    truthful = LaneFollowing(config(follows="truth"), start_e_n_heading=(0.0, 0.0, 0.0))
    vehicle = VehicleState(east_m=0.0, north_m=0.1, heading_rad=0.0, speed_m_s=0.0)
    for _ in range(10):
        command = truthful.command(Knowledge(t_ns=0, vehicle=vehicle), STEP_S)
    assert command.yaw_rate_rad_s < 0.0


def test_the_axis_may_lie_beside_the_start_and_at_an_angle() -> None:
    driver = LaneFollowing(
        config(follows="truth", start_offset_m=0.1, start_heading_deg=90.0), start_e_n_heading=(3.0, 4.0, math.pi)
    )
    # The machine looks west, 90 degrees left of an axis to the north, 0.1 m to the left (west) of it.
    assert driver.path.pose(0.0).heading_rad == pytest.approx(math.pi / 2)
    assert driver.path.pose(0.0).east_m == pytest.approx(3.1)
    vehicle = VehicleState(east_m=3.0, north_m=4.0, heading_rad=math.pi, speed_m_s=0.0)
    said = driver.in_lane(Knowledge(t_ns=0, vehicle=vehicle))
    assert said.values["lane_offset_m"] == pytest.approx(0.1)
    assert said.values["lane_heading_rad"] == pytest.approx(math.pi / 2)


def test_sigmas_the_wrong_way_round_are_refused() -> None:
    with pytest.raises(ValidationError, match=r"slow_sigma_m = 0\.2 must be less"):
        config(slow_sigma_m=0.2)
