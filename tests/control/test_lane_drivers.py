"""Drivers that keep to a lane on their own, told what they are told and nothing else."""

from __future__ import annotations

import math
from typing import Any

import pytest

from twin.control import HeadingHoldConfig
from twin.control.heading_hold import DRIVING, TURNING_BACK, HeadingHold
from twin.control.lane_keeping import STANDING, STOPPED_AT_END, STOPPED_AT_SIGN
from twin.signals import NS_PER_S, Command, Knowledge, Said, VehicleState

STEP_S = 0.02


class Toy:
    """A machine that does at once what it is asked, told to its driver as the estimator "filter"."""

    def __init__(self, driver: HeadingHold, *, drift_rad_s: float = 0.0, heading_rad: float = 0.0) -> None:
        self.driver = driver
        self.drift_rad_s = drift_rad_s
        self.east_m = self.north_m = self.t_s = 0.0
        self.heading_rad = heading_rad
        self.picture: Said | None = None
        self.filter_error_rad = 0.0
        self.commands: list[Command] = []
        self.states: list[str] = []

    def go(self, duration_s: float) -> None:
        for _ in range(round(duration_s / STEP_S)):
            t_ns = round(self.t_s * NS_PER_S)
            heading = Said(t_ns=t_ns, values={"heading_rad": self.heading_rad + self.filter_error_rad})
            place = Said(t_ns=t_ns, values={"position_e_m": self.east_m, "position_n_m": self.north_m})
            measured = {} if self.picture is None else {"camera": self.picture}
            knowledge = Knowledge(t_ns=t_ns, said={"filter": heading, "wheels": place}, measured=measured)
            command = self.driver.command(knowledge, STEP_S)
            self.commands.append(command)
            self.states.append(self.driver.state)
            moving = command.speed_m_s > 0.0
            self.heading_rad += (command.yaw_rate_rad_s + (self.drift_rad_s if moving else 0.0)) * STEP_S
            self.east_m += command.speed_m_s * math.cos(self.heading_rad) * STEP_S
            self.north_m += command.speed_m_s * math.sin(self.heading_rad) * STEP_S
            self.t_s += STEP_S

    def show(self, *, seen: bool, range_m: float = math.nan) -> None:
        """A picture taken now."""
        values = {"sign_seen": float(seen), "sign_range_m": range_m}
        self.picture = Said(t_ns=round(self.t_s * NS_PER_S), values=values)


def _driver(**changes: Any) -> HeadingHold:
    table = {"kind": "heading_hold", "follows": "filter", "lane_m": 10.0, **changes}
    return HeadingHold(HeadingHoldConfig.model_validate(table), start_e_n_heading=(0.0, 0.0, 0.0))


def test_it_stands_with_the_brake_on_until_its_filters_have_calibrated() -> None:
    toy = Toy(_driver(stand_s=1.0))
    toy.go(0.98)
    assert set(toy.states) == {STANDING}
    assert all(command.brake and command.speed_m_s == 0.0 for command in toy.commands)
    toy.go(0.1)
    assert toy.states[-1] == DRIVING


def test_it_drives_straight_within_five_degrees_and_turns_back_on_the_spot_outside() -> None:
    toy = Toy(_driver(), heading_rad=math.radians(4.9))
    toy.go(2.0)
    assert set(toy.states) == {DRIVING}
    assert all(command.yaw_rate_rad_s == 0.0 for command in toy.commands)
    toy = Toy(_driver(), heading_rad=math.radians(5.1))
    toy.go(0.02)
    assert toy.states == [TURNING_BACK]
    assert toy.commands[0].speed_m_s == 0.0
    assert toy.commands[0].yaw_rate_rad_s == pytest.approx(-math.radians(45.0))
    toy.go(1.0)
    assert abs(math.degrees(toy.heading_rad)) <= 2.5
    assert toy.states[-1] == DRIVING


def test_a_constant_error_of_the_heading_takes_it_off_the_axis_by_its_sine() -> None:
    toy = Toy(_driver(lane_m=4.0, odometer="wheels"))
    toy.filter_error_rad = math.radians(-5.0)
    toy.heading_rad = math.radians(5.0)
    toy.go(12.0)
    assert toy.states[-1] == STOPPED_AT_END
    assert toy.east_m == pytest.approx(4.0, abs=0.02)
    assert toy.north_m == pytest.approx(4.0 * math.tan(math.radians(5.0)), abs=0.01)


def test_a_machine_that_veers_turns_back_each_time_the_tolerance_is_used_up() -> None:
    # It drifts from -2.5 or 2.5 (where it stops turning) to 5: 7.5 degrees at most, at 2 degrees a second.
    toy = Toy(_driver(lane_m=100.0), drift_rad_s=math.radians(2.0))
    toy.go(40.0)
    turns = sum(
        later == TURNING_BACK and before != TURNING_BACK
        for before, later in zip(toy.states, toy.states[1:], strict=False)
    )
    assert 40.0 / (7.5 / 2.0) - 2 <= turns <= 40.0 / (2.5 / 2.0) + 1


def test_the_end_of_the_lane_stops_it_where_no_sign_does() -> None:
    for odometer in (None, "wheels"):
        toy = Toy(_driver(lane_m=2.0, odometer=odometer, camera="camera"))
        toy.go(8.0)
        assert toy.states[-1] == STOPPED_AT_END
        assert toy.east_m == pytest.approx(2.0, abs=0.02)
        assert toy.commands[-1] == Command(brake=True)


def test_a_sign_has_to_be_seen_in_pictures_running() -> None:
    toy = Toy(_driver(camera="camera"))
    for seen in (False, True, False, True):
        toy.show(seen=seen)
        toy.go(0.2)
    assert toy.states[-1] == DRIVING
    toy.show(seen=True)
    toy.go(0.02)
    assert toy.states[-1] == STOPPED_AT_SIGN
    way = toy.east_m
    toy.go(2.0)
    assert toy.east_m - way == pytest.approx(0.5**2 / 2.0, abs=0.02)  # v^2 / 2a
    assert toy.commands[-1].brake


def test_one_old_picture_is_not_counted_twice() -> None:
    toy = Toy(_driver(camera="camera"))
    toy.show(seen=True)
    toy.go(1.0)
    assert toy.states[-1] == DRIVING


def test_it_drives_on_to_a_sign_that_it_is_to_stop_at() -> None:
    sign_m, camera_m = 3.0, 0.13
    toy = Toy(_driver(camera="camera", sign_at_m=0.5))
    while toy.t_s < 9.0:
        toy.show(seen=True, range_m=sign_m - camera_m - toy.east_m)
        toy.go(0.2)
    assert toy.states[-1] == STOPPED_AT_SIGN
    assert sign_m - camera_m - toy.east_m == pytest.approx(0.5, abs=0.02)


def test_without_an_estimate_it_does_not_move() -> None:
    driver = _driver()
    for _ in range(100):
        assert driver.command(Knowledge(t_ns=NS_PER_S), STEP_S).speed_m_s == 0.0
    assert driver.state == STANDING


def test_it_may_follow_the_truth() -> None:
    driver = _driver(follows="truth")
    vehicle = VehicleState(east_m=0.0, north_m=0.0, heading_rad=math.radians(-10.0), speed_m_s=0.0)
    command = driver.command(Knowledge(t_ns=0, vehicle=vehicle), STEP_S)
    assert driver.state == TURNING_BACK
    assert command.yaw_rate_rad_s > 0.0


def test_whoever_follows_nobody_closes_no_loop() -> None:
    assert not HeadingHoldConfig(kind="heading_hold", lane_m=1.0).listens.closes_loop
    assert HeadingHoldConfig(kind="heading_hold", lane_m=1.0, camera="camera").listens.sensors == ("camera",)
    both = HeadingHoldConfig(kind="heading_hold", lane_m=1.0, follows="filter", odometer="filter")
    assert both.listens.estimators == ("filter",)
