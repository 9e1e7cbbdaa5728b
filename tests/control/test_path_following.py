"""The driver on a kinematic bicycle: what is asked is what is driven, before any soil is involved."""

import math

import pytest
from pydantic import ValidationError

from twin.control.path_following import PathDriver, PathDriverConfig
from twin.signals import Knowledge, VehicleState

WHEELBASE_M = 2.8
STEP_S = 0.02


def _drive(driver: PathDriver, duration_s: float) -> list[tuple[float, VehicleState, float, int, bool]]:
    """Kinematic bicycle, steering lag 0.2 s and 0.6 rad/s, speed lag 0.3 s: (t, state, offset, leg, brake)."""
    east = north = heading = speed = steering = 0.0
    log = []
    for step in range(round(duration_s / STEP_S)):
        state = VehicleState(east_m=east, north_m=north, heading_rad=heading, speed_m_s=speed)
        command = driver.command(Knowledge(t_ns=0, vehicle=state), STEP_S)
        _, offset = driver.path.project(east, north, near_m=driver._station_m)
        log.append((step * STEP_S, state, offset, driver.segment, command.brake))
        speed = 0.0 if command.brake else speed + (command.speed_m_s - speed) * STEP_S / 0.3
        steering += min(max((command.steering_rad - steering) * STEP_S / 0.2, -0.6 * STEP_S), 0.6 * STEP_S)
        east += speed * math.cos(heading) * STEP_S
        north += speed * math.sin(heading) * STEP_S
        heading += speed * math.tan(steering) / WHEELBASE_M * STEP_S
    return log


def _driver(path: list[dict[str, float]], **changes: float) -> PathDriver:
    config = PathDriverConfig.model_validate({"path": path, **changes})
    return PathDriver(config, start_e_n_heading=(0.0, 0.0, 0.0), wheelbase_m=WHEELBASE_M, seed=1)


def test_the_driver_keeps_to_a_path_with_tight_turns() -> None:
    driver = _driver([{"straight_m": 30.0}, {"turn_deg": -180.0, "radius_m": 10.0}, {"straight_m": 20.0}])
    log = _drive(driver, 45.0)
    # A step of curvature 0.1 1/m seen with a steering lag tau leaves about v^2 tau^2 / (2 R) = 0.02 m at 2.5 m/s and
    # 0.26 s net of the preview; a decimetre is what a good driver keeps.
    assert max(abs(entry[2]) for entry in log) < 0.1
    end = log[-1][1]
    assert (end.east_m, end.north_m) == pytest.approx((10.0, -20.0), abs=0.35)


def test_a_stop_lasts_as_long_as_asked() -> None:
    driver = _driver([{"stop_s": 2.0}, {"straight_m": 10.0}, {"stop_s": 3.0}, {"straight_m": 10.0}])
    log = _drive(driver, 45.0)
    first = [t for t, _, _, leg, brake in log if brake and leg == 0]
    second = [t for t, _, _, leg, brake in log if brake and leg == 2]
    assert len(first) * STEP_S == pytest.approx(2.0, abs=0.05)
    assert len(second) * STEP_S == pytest.approx(3.0, abs=0.05)
    stopped_at = next(state.east_m for _, state, _, leg, brake in log if brake and leg == 2)
    assert stopped_at == pytest.approx(10.0, abs=0.3)


def test_acceleration_is_the_one_asked_for() -> None:
    log = _drive(_driver([{"straight_m": 60.0}], speed_m_s=3.0, acceleration_m_s2=0.5), 12.0)
    speed = {round(t, 2): state.speed_m_s for t, state, *_ in log}
    # A ramp of 0.5 m/s^2 through a first-order lag keeps its slope.
    assert speed[4.0] - speed[2.0] == pytest.approx(1.0, abs=0.02)
    assert speed[11.0] == pytest.approx(3.0, abs=0.02)


def test_a_slower_segment_is_entered_at_its_speed() -> None:
    log = _drive(_driver([{"straight_m": 40.0}, {"speed_m_s": 1.0}, {"straight_m": 20.0}], speed_m_s=3.0), 30.0)
    entering = next(state for _, state, _, leg, _ in log if leg == 1)
    assert entering.east_m == pytest.approx(40.0, abs=0.1)
    assert entering.speed_m_s == pytest.approx(1.0, abs=0.2)


def test_wander_is_drawn_from_the_seed_and_bounded_by_its_statistics() -> None:
    path = [{"straight_m": 400.0}]
    offsets = [entry[2] for entry in _drive(_driver(path, wander_m=0.1), 100.0)]
    assert offsets == [entry[2] for entry in _drive(_driver(path, wander_m=0.1), 100.0)]
    rms = math.sqrt(sum(offset**2 for offset in offsets) / len(offsets))
    # The loop (w v = 0.6 rad/s) follows an 8 s wander with a little smoothing; 12 correlation times of data.
    assert 0.03 < rms < 0.2


@pytest.mark.parametrize(
    "segment",
    [
        {},
        {"straight_m": 1.0, "stop_s": 1.0},
        {"turn_deg": 90.0},
        {"radius_m": 10.0, "straight_m": 3.0},
        {"turn_deg": 0.0, "radius_m": 10.0},
        {"straight_m": -1.0},
        {"stop_s": "1"},
    ],
)
def test_segments_that_mean_nothing_are_refused(segment: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        PathDriverConfig.model_validate({"path": [segment]})


# --- a machine that turns by the difference of its wheels ------------------------------------------------------------


def _roll(driver: PathDriver, duration_s: float) -> list[tuple[float, VehicleState, float, int]]:
    """Kinematic two-wheeler, speed and yaw rate lag 0.1 s: (t, state, heading turned in all, leg)."""
    east = north = heading = speed = rate = 0.0
    log = []
    for step in range(round(duration_s / STEP_S)):
        state = VehicleState(
            east_m=east, north_m=north, heading_rad=math.remainder(heading, 2.0 * math.pi), speed_m_s=speed
        )
        command = driver.command(Knowledge(t_ns=0, vehicle=state), STEP_S)
        log.append((step * STEP_S, state, heading, driver.segment))
        speed = 0.0 if command.brake else speed + (command.speed_m_s - speed) * STEP_S / 0.1
        rate = 0.0 if command.brake else rate + (command.yaw_rate_rad_s - rate) * STEP_S / 0.1
        east += speed * math.cos(heading) * STEP_S
        north += speed * math.sin(heading) * STEP_S
        heading += rate * STEP_S
    return log


ROBOT = {"speed_m_s": 0.5, "steering_bandwidth_1_m": 3.0, "preview_s": 0.2}


def test_a_robot_keeps_to_its_path_by_yaw_rate() -> None:
    driver = _driver([{"straight_m": 1.0}, {"turn_deg": 90.0, "radius_m": 0.5}, {"straight_m": 1.0}], **ROBOT)
    end = _roll(driver, 12.0)[-1][1]
    assert (end.east_m, end.north_m) == pytest.approx((1.5, 1.5), abs=0.03)
    assert math.degrees(end.heading_rad) == pytest.approx(90.0, abs=2.0)


@pytest.mark.parametrize("angle_deg", [50.0, -20.0, 180.0, -400.0])
def test_a_spin_turns_by_its_angle_on_the_spot_and_the_path_goes_on_from_there(angle_deg: float) -> None:
    driver = _driver([{"straight_m": 1.0}, {"spin_deg": angle_deg}, {"straight_m": 1.0}], **ROBOT)
    log = _roll(driver, 30.0)
    spinning = [(state, heading) for _, state, heading, leg in log if leg == 1 and abs(state.speed_m_s) < 1e-3]
    assert all(math.hypot(state.east_m - 1.0, state.north_m) < 0.03 for state, _ in spinning)
    # Degree by degree: it is done within one, and what the lag adds of the slow end is 0.3 rad/s x 0.1 s.
    turned = math.degrees(spinning[-1][1])
    assert turned == pytest.approx(angle_deg, abs=1.0 + math.degrees(0.3 * 0.1))
    assert max(abs(math.degrees(heading)) for _, heading in spinning) <= abs(angle_deg) + 1.0
    end = log[-1][1]
    assert (end.east_m, end.north_m) == pytest.approx(
        (1.0 + math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))), abs=0.04
    )
    assert driver.segment_names[driver.segment] == "finished"


def test_a_spin_keeps_to_its_rate() -> None:
    driver = _driver([{"spin_deg": 90.0}], spin_rate_deg_s=30.0, **ROBOT)
    log = _roll(driver, 6.0)
    headings = {round(t, 2): math.degrees(heading) for t, _, heading, _ in log}
    assert headings[1.5] - headings[0.5] == pytest.approx(30.0, abs=0.5)
    assert driver.segment_names == ("spin 90° left", "finished")


@pytest.mark.parametrize(
    ("segment", "message"),
    [({"spin_deg": 0.0}, "no turn"), ({"spin_deg": 30.0, "straight_m": 1.0}, "straight_m and spin_deg")],
)
def test_a_spin_that_says_nothing_or_too_much_is_refused(segment: dict[str, float], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        PathDriverConfig.model_validate({"path": [segment]})
