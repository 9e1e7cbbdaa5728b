"""A driver who goes by an estimator: as good as one in the seat where it is told as much, and careful where it is not.

All on a kinematic bicycle, before any soil is involved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.control.bicycle import STEP_S, WHEELBASE_M, Moment, Speech, drive, estimate
from twin.control.followed_estimate import FollowedEstimate
from twin.control.path_following import PathDriver, PathDriverConfig
from twin.signals import HEADING, NS_PER_S, POSITION, SPEED, Knowledge, Said, VehicleState

STRAIGHT = [{"straight_m": 500.0}]
BENDS = [{"stop_s": 1.0}, {"straight_m": 10.0}, {"turn_deg": 90.0, "radius_m": 6.0}, {"straight_m": 20.0}]


def follower(path: Sequence[dict[str, Any]] = STRAIGHT, *, ahead_m: float = 0.0, **changes: Any) -> PathDriver:
    config = PathDriverConfig.model_validate({"path": path, "follows": "est", **changes})
    return PathDriver(config, start_e_n_heading=(0.0, 0.0, 0.0), wheelbase_m=WHEELBASE_M, seed=1, reference_x_m=ahead_m)


def now(step: int) -> int:
    return round(step * STEP_S * NS_PER_S)


def perfect(ahead_m: float = 0.0) -> Speech:
    return lambda step, states: estimate(now(step), states[-1], ahead_m=ahead_m)


def rms(moments: Sequence[Moment]) -> float:
    return math.sqrt(sum(moment.offset_m**2 for moment in moments) / len(moments))


# --- what it believes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ahead_m", [0.0, 1.4, -3.2])
def test_who_is_told_everything_drives_as_from_the_seat(ahead_m: float) -> None:
    seat = drive(follower(BENDS, follows="truth"), 30.0)
    told = drive(follower(BENDS, ahead_m=ahead_m, steering_time_s=0.0), 30.0, perfect(ahead_m))
    # The last crawl to the end is left out: who goes by an estimator takes it for standing when it is asked to stand.
    moving = [step for step, moment in enumerate(seat) if moment.t_s < 2.0 or moment.state.speed_m_s > 0.3]
    for attribute in ("steering_rad", "speed_m_s", "brake"):
        np.testing.assert_allclose(
            [getattr(told[step].command, attribute) for step in moving],
            [getattr(seat[step].command, attribute) for step in moving],
            atol=1e-9,
        )
    assert seat[-1].state.north_m > 15.0


def _belief(**changes: Any) -> FollowedEstimate:
    options = {"ahead_m": 0.0, "stale_after_s": 2.0, "start_e_n_heading": (5.0, 6.0, 0.1)} | changes
    return FollowedEstimate("est", **options)


def _heard(t_s: float, of_s: float, *values: float) -> Knowledge:
    said = Said(t_ns=round(of_s * NS_PER_S), values=dict(zip((*POSITION[:2], HEADING, SPEED), values, strict=True)))
    return Knowledge(t_ns=round(t_s * NS_PER_S), said={"est": said})


def test_an_old_estimate_has_turned_as_it_was_asked_to() -> None:
    belief = _belief()
    for step in range(51):
        seen = belief.look(_heard(0.02 * step, 0.5 if step >= 25 else 0.0, 3.0, 4.0, 3.0, 2.0), 2.0)
        belief.turn(0.01)
    assert seen is not None
    # In 25 steps since: a quarter of a radian on an arc of 1 m, which goes beyond pi.
    assert seen.heading_rad == pytest.approx(3.25 - 2.0 * math.pi)
    radius = 1.0 / 0.25
    assert seen.east_m == pytest.approx(3.0 + radius * (math.sin(3.25) - math.sin(3.0)), abs=3e-3)
    assert seen.north_m == pytest.approx(4.0 - radius * (math.cos(3.25) - math.cos(3.0)), abs=3e-3)


def test_an_old_estimate_has_gone_on_straight_ahead() -> None:
    seen = _belief(ahead_m=0.5).look(_heard(10.0, 9.6, 3.0, 4.0, math.pi / 2, 2.0), 2.0)
    assert seen is not None
    # 0.4 s at 2 m/s northwards, less the half metre.
    assert (seen.east_m, seen.north_m) == pytest.approx((3.0, 4.3))
    assert (seen.heading_rad, seen.speed_m_s) == (math.pi / 2, 2.0)


def test_without_a_speed_it_has_gone_on_as_it_was_asked_to() -> None:
    seen = _belief().look(_heard(10.0, 9.5, 3.0, 4.0, 0.0, math.nan), 1.0)
    assert seen is not None
    assert (seen.east_m, seen.speed_m_s) == pytest.approx((3.5, 1.0))


def test_what_was_not_asked_to_move_stands_whatever_the_receiver_says() -> None:
    seen = _belief().look(_heard(10.0, 10.0, 3.0, 4.0, 0.0, 0.12), 0.0)
    assert seen is not None
    assert seen.speed_m_s == 0.0


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_an_estimate_without_position_or_heading_is_none(missing: int) -> None:
    belief = _belief()
    assert belief.look(Knowledge(t_ns=0), 1.0) is None
    good = [3.0, 4.0, 0.0, 1.0]
    assert belief.look(_heard(1.0, 1.0, *good), 1.0) is not None
    bad = [math.nan if place == missing else value for place, value in enumerate(good)]
    # The last good one is believed, as old as it is, for 2 s.
    later = belief.look(_heard(2.5, 2.5, *bad), 1.0)
    assert later is not None
    assert later.east_m == pytest.approx(4.5)
    assert belief.look(_heard(3.1, 3.1, *bad), 1.0) is None
    assert belief.believed == later


def test_before_the_first_estimate_it_is_where_it_was_set_out() -> None:
    assert _belief().believed == VehicleState(east_m=5.0, north_m=6.0, heading_rad=0.1, speed_m_s=0.0)


def test_who_sets_a_where_it_stands_takes_the_error_of_that_moment_for_none() -> None:
    belief, surveyed = _belief(sets_a=True), _belief()
    for step in range(10):  # the estimate wanders while the machine stands
        heard = _heard(0.1 * step, 0.1 * step, 7.0 + 0.1 * step, 4.0, 0.1, 0.0)
        told = belief.look(heard, 0.0)
        assert told == belief.believed == _belief().believed
        surveyed.look(heard, 0.0)
    moving = _heard(2.0, 2.0, 10.0, 5.0, 0.1, 1.0)
    told, plain = belief.look(moving, 1.0), surveyed.look(moving, 1.0)
    assert told is not None
    assert plain is not None
    # 7.9 m and 4 m were said of the start at 5 m and 6 m.
    assert (told.east_m, told.north_m) == pytest.approx((10.0 - 2.9, 5.0 + 2.0))
    assert (plain.east_m, plain.north_m) == pytest.approx((10.0, 5.0))
    standing_again = belief.look(_heard(3.0, 3.0, 20.0, 5.0, 0.1, 0.0), 0.0)
    assert standing_again is not None
    assert standing_again.east_m == pytest.approx(17.1)


def test_who_sets_a_drives_a_line_beside_nothing_by_a_constant_error() -> None:
    def says(step: int, states: list[VehicleState]) -> Said:
        return estimate(now(step), states[-1], left_m=2.0)

    path = [{"stop_s": 2.0}, {"straight_m": 40.0}]
    assert drive(follower(path), 35.0, says)[-1].offset_m == pytest.approx(-2.0, abs=0.02)
    assert abs(drive(follower(path, sets_a=True), 35.0, says)[-1].offset_m) < 1e-6


# --- nothing to go by ------------------------------------------------------------------------------------------------


def test_with_nothing_to_go_by_it_creeps_straight_on_and_stops_until_there_is() -> None:
    driver = follower([{"stop_s": 2.0}, {"straight_m": 50.0}], speed_m_s=2.0)

    def says(step: int, states: list[VehicleState]) -> Said | None:
        return perfect()(step, states) if step * STEP_S >= 12.0 else None

    log = drive(driver, 30.0, says)
    assert all(moment.command.brake for moment in log if moment.t_s < 1.99)
    blind = [moment for moment in log if 2.1 < moment.t_s < 12.0]
    assert all(moment.command.steering_rad == 0.0 for moment in blind)
    assert max(moment.command.speed_m_s for moment in blind) == 0.5
    # 0.5 m/s for 5 s, reached and left at 0.5 m/s^2.
    assert blind[-1].state.east_m == pytest.approx(2.5, abs=0.1)
    assert blind[-1].command.brake
    after = [moment for moment in log if moment.t_s > 17.0]
    assert after[0].command.speed_m_s == pytest.approx(2.0)
    assert not driver.blind


def test_it_says_that_it_is_blind_while_it_is() -> None:
    driver = follower([{"stop_s": 2.0}, {"straight_m": 50.0}], speed_m_s=2.0)
    blind = []

    def says(step: int, states: list[VehicleState]) -> Said | None:
        blind.append(driver.blind)
        return perfect()(step, states) if not 5.0 <= step * STEP_S < 9.0 else None

    drive(driver, 12.0, says)
    # Standing is no blindness; what was said last is believed for 2 s, and asked for at every step.
    changes = [step * STEP_S for step in range(1, len(blind)) if blind[step] != blind[step - 1]]
    assert changes == pytest.approx([7.0, 9.0], abs=2 * STEP_S)


def test_who_hears_the_same_for_long_while_moving_is_blind_until_it_changes() -> None:
    """A held position must not be driven by: it would take the machine straight on for ever."""
    driver = follower([{"stop_s": 4.0}, {"straight_m": 50.0}], speed_m_s=1.0)
    held: list[VehicleState] = []
    blind = []

    def says(step: int, states: list[VehicleState]) -> Said:
        blind.append(driver.blind)
        if step * STEP_S == 10.0:
            held.append(states[-1])
        silent = 10.0 <= step * STEP_S < 30.0
        return estimate(now(step), held[0] if silent else states[-1])

    log = drive(driver, 40.0, says)
    changes = [step * STEP_S for step in range(1, len(blind)) if blind[step] != blind[step - 1]]
    # Standing for 4 s it hears the same, too, and that is no blindness.
    assert changes == pytest.approx([12.0, 30.0], abs=3 * STEP_S)
    # 2 s at 1 m/s, and then what is left of 0.5 m/s for 5 s.
    stood = [moment.state.east_m for moment in log if 25.0 < moment.t_s < 30.0]
    assert stood[-1] - held[0].east_m < 2.0 * 1.0 + 5.0 * 0.5 + 1.5
    assert max(stood) - min(stood) < 1e-3


def test_it_needs_nobody_to_stand_as_long_as_it_has_to() -> None:
    driver = follower([{"straight_m": 4.0}, {"stop_s": 8.0}, {"straight_m": 4.0}], speed_m_s=1.0)
    hears = [True]

    def says(step: int, states: list[VehicleState]) -> Said | None:
        hears[0] = hears[0] and driver._stood_s == 0.0
        return perfect()(step, states) if hears[0] or step * STEP_S > 14.5 else estimate(0, states[0])

    log = drive(driver, 40.0, says)
    standing = [moment.t_s for moment in log if moment.leg == 1 and moment.command.brake]
    assert standing[-1] - standing[0] == pytest.approx(8.0, abs=0.05)
    assert log[-1].leg == 3


@pytest.mark.parametrize(("silent_s", "keeps_on"), [(1.5, True), (4.0, False)])
def test_in_a_bend_it_holds_the_steering_through_a_silence(silent_s: float, keeps_on: bool) -> None:
    driver = follower([{"turn_deg": 360.0, "radius_m": 6.0}, {"straight_m": 20.0}], speed_m_s=1.0)
    heard: list[Said] = []

    def says(step: int, states: list[VehicleState]) -> Said:
        if not 10.0 <= step * STEP_S < 10.0 + silent_s:
            heard.append(estimate(now(step), states[-1]))
        return heard[-1]

    log = drive(driver, 20.0, says)
    silent = [moment for moment in log if 12.1 <= moment.t_s < 10.0 + silent_s]
    speeds = [moment.command.speed_m_s for moment in log if 5.0 < moment.t_s < 16.0]
    if keeps_on:
        assert speeds == pytest.approx([1.0] * len(speeds))
    else:
        assert min(speeds) == pytest.approx(0.5)
        assert len({moment.command.steering_rad for moment in silent}) == 1
        assert silent[0].command.steering_rad == pytest.approx(math.atan(WHEELBASE_M / 6.0), abs=0.15)
    assert max(abs(moment.offset_m) for moment in log if moment.t_s < 10.0 + silent_s) < 0.6


# --- late, seldom and noisy ------------------------------------------------------------------------------------------


def _receiver(*, late_s: float, heading_rad: float, position_m: float, seed: int = 4) -> Speech:
    """Samples of once a second that arrive late, are taken for current until the next one, and err."""
    random = np.random.default_rng(seed)
    errors = random.standard_normal((400, 2)) * (heading_rad, position_m)

    def says(step: int, states: list[VehicleState]) -> Said | None:
        second = math.floor((step * STEP_S - late_s) + 1e-9)
        if second < 0:
            return None
        turned, left = errors[second]
        return estimate(now(step), states[round(second / STEP_S)], turned_rad=turned, left_m=left)

    return says


def test_a_slow_receiver_does_not_make_it_weave() -> None:
    """Once a second, 0.3 s late: 0.8 s of delay on average, and 0.2 s of the steering's.

    Without a limit w v = 0.75 rad/s: stable up to 0.86 s. With 0.4 rad/s it is stable up to 1.6 s, and heading errors
    of n = 0.03 rad once a second leave offsets of v n sqrt(1 s / 0.4 rad/s) = 0.14 m, somewhat more with the delay.
    """
    receiver = {"late_s": 0.3, "heading_rad": 0.03, "position_m": 0.02}
    calm = drive(follower(speed_m_s=3.0), 160.0, _receiver(**receiver))
    weaving = drive(follower(speed_m_s=3.0, steering_time_s=0.0), 160.0, _receiver(**receiver))
    settled = slice(round(40.0 / STEP_S), None)
    assert rms(calm[settled]) < 0.28
    assert rms(weaving[settled]) > 3.0 * rms(calm[settled])


@pytest.mark.parametrize("speed_m_s", [0.25, 0.73, 1.1])
def test_a_good_receiver_keeps_it_on_its_line(speed_m_s: float) -> None:
    """10 Hz, 0.1 s late, 1 cm and 0.5 degrees: what the loop lets through of white noise is less than a sample of it.

    Offsets by position errors p: p sqrt(5 w v T / 4) < p; by headings n: n sqrt(v T / w) = 0.6 cm at 1.1 m/s.
    """
    random = np.random.default_rng(7)
    errors = random.standard_normal((2000, 2)) * (math.radians(0.5), 0.01)

    def says(step: int, states: list[VehicleState]) -> Said:
        sample = max(step // 5 - 1, 0)
        turned, left = errors[sample]
        return estimate(now(sample * 5), states[sample * 5], turned_rad=turned, left_m=left, ahead_m=1.4)

    log = drive(follower(speed_m_s=speed_m_s, ahead_m=1.4), 120.0, says)
    assert rms(log) < 0.012
    assert log[-1].state.speed_m_s == pytest.approx(speed_m_s, rel=1e-3)


def test_a_leap_of_the_estimate_is_approached_at_a_slant() -> None:
    """Beyond 1/w, sin(psi) = w e / 2 stays at one half; the steering's lag may add a few degrees."""

    def says(step: int, states: list[VehicleState]) -> Said:
        return estimate(
            now(step), states[-1], left_m=0.0 if step * STEP_S < 10.0 else -4.0 * math.cos(states[-1].heading_rad)
        )

    log = drive(follower(speed_m_s=1.0, steering_bandwidth_1_m=1.0, steering_time_s=0.0), 40.0, says)
    slant = max(abs(math.degrees(moment.state.heading_rad)) for moment in log)
    assert 25.0 < slant < 36.0
    assert log[-1].offset_m == pytest.approx(4.0, abs=0.05)


def test_an_estimate_that_leaps_to_the_next_line_does_not_take_the_driver_there() -> None:
    passes = [{"passes": 2, "length_m": 15.0, "width_m": 2.2, "turn_radius_m": 1.1}]
    driver = follower(passes, speed_m_s=1.0)
    leaping = [False]

    def says(step: int, states: list[VehicleState]) -> Said:
        # From 2 m before the end of the first line on, for a second.
        leaping[0] = 13.0 <= states[-1].east_m < 14.0 and driver.segment == 0
        return estimate(now(step), states[-1], left_m=2.2 if leaping[0] else 0.0)

    log = drive(driver, 16.0, says)
    before = [moment for moment in log if moment.state.east_m < 14.0]
    assert {moment.leg for moment in before} == {0}


# --- what it has to be told ------------------------------------------------------------------------------------------


def test_it_tells_whom_it_listens_to_and_what_it_needs() -> None:
    config = PathDriverConfig.model_validate({"path": STRAIGHT, "follows": "est"})
    assert config.listens.estimators == ("est",)
    assert config.listens.closes_loop
    assert not config.listens.truth
    assert config.needed_columns == {"est": ("position_e_m", "position_n_m", "heading_rad", "speed_m_s")}
    seated = PathDriverConfig.model_validate({"path": STRAIGHT})
    assert not seated.listens.closes_loop
    assert seated.needed_columns == {}


@pytest.mark.parametrize(
    "changes", [{"stale_after_s": 0.0}, {"blind_s": -1.0}, {"steering_time_s": "1"}, {"follows": 3}]
)
def test_settings_that_mean_nothing_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        PathDriverConfig.model_validate({"path": STRAIGHT, **changes})
