"""Runs in which the driver listens to estimators: the loop is closed, and a tree ends it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from twin.errors import BadInputError
from twin.execution import execute, execute_each
from twin.recording import Recording
from twin.replay import replay
from twin.scenario import load
from twin.scoring import score
from twin.stress import make_plan, run_task

TABLE: dict[str, Any] = {
    "title": "A robot in a lane",
    "duration_s": 7.0,
    "terrain": {"kind": "flat"},
    "soil": {"preset": "firm"},
    "machine": {"kind": "orchard_robot", "wheel_tolerance": 0.01},
    "orchard": {"lanes": [{"length_m": 4.0, "width_m": 1.0, "spacing_m": 1.0}]},
    "driver": {"kind": "heading_hold", "follows": "heading", "odometer": "odometry", "lane_m": 2.0, "stand_s": 2.0},
    "sensors": {
        "imu": {"preset": "imu_mpu6050", "mount": "imu"},
        "encoders": {"preset": "wheel_encoders_lm393", "mount": "encoders"},
    },
    "estimators": {
        "odometry": {"kind": "wheel_odometry", "sensors": ["encoders"]},
        "heading": {
            "kind": "heading_kalman",
            "inputs": "odometry_gyro",
            "sensors": ["imu", "encoders"],
            "preparation": {"standstill_s": 2.0},
        },
    },
}


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    path = tmp_path / "lane.toml"
    path.write_text(tomli_w.dumps(TABLE), encoding="utf-8")
    return path


def _run(path: Path, run: int = 0, **settings: Any) -> Recording:
    return execute(
        load(path, settings=[(key.replace("__", "."), value) for key, value in settings.items()]), runs=(run,)
    )


def _metrics(recording: Recording) -> dict[str, float]:
    return score(recording).metrics


def test_every_run_drives_its_own_way_and_says_how_it_went(scenario_file: Path) -> None:
    first, second = execute_each(load(scenario_file), runs=(0, 1))
    offsets = [recording.truth.column("lane_offset_m")[:, 0] for recording in (first, second)]
    assert np.abs(offsets[0] - offsets[1]).max() > 1e-4
    np.testing.assert_array_equal(offsets[0], _run(scenario_file).truth.column("lane_offset_m")[:, 0])
    metrics = _metrics(first)
    assert metrics["truth.lane.max_abs_offset_m"] == np.abs(offsets[0]).max()
    assert metrics["truth.lane.stopped_at_end"] == metrics["truth.lane.finished"] == 1.0
    assert metrics["truth.lane.stopped_at_sign"] == 0.0
    assert metrics["truth.lane.way_m"] == pytest.approx(2.0, abs=0.15)  # a slot is 1 cm, and braking takes 12 cm


def test_members_of_a_stress_test_are_the_single_runs(scenario_file: Path) -> None:
    result = run_task(make_plan(scenario_file, runs=2, worlds=1, settings=[], vary=[], seed=None), 0, 0)
    for run in range(2):
        single = _metrics(_run(scenario_file, run))
        for name in ("truth.lane.final_offset_m", "heading.heading.mean_abs_error_deg", "truth.clearance.min_m"):
            assert result.metrics[name][run] == single[name]
    assert result.ended_reason == "duration"


def test_a_replay_says_what_the_driver_heard(scenario_file: Path) -> None:
    recording = _run(scenario_file)
    again = replay(recording)
    for name in TABLE["estimators"]:
        np.testing.assert_array_equal(again.estimates(name).values, recording.estimates(name).values)


def test_several_runs_cannot_share_a_world(scenario_file: Path) -> None:
    with pytest.raises(BadInputError, match=r"lane\.toml: the commands of driver depend.*one run at a time"):
        execute(load(scenario_file), runs=(0, 1))


def test_wheels_of_unlike_size_drive_an_arc(scenario_file: Path) -> None:
    # Loops that hold equal wheel rates w turn the robot at w (r_R - r_L) / b, as long as nobody corrects it. The ball,
    # L ahead, is dragged aside; its share of the wheels' slip stiffness, c = 0.05 * 0.2 / 0.4 for its grip and load,
    # takes 2 c (L / b)^2 = 5.5 % of that, and side slip and rolling of the tyres a little more.
    free = {"driver__tolerance_deg": 90.0, "machine__wheel_tolerance": 0.004}
    for seed in range(1, 5):
        recording = _run(scenario_file, **free, seed=seed)
        machine = load(scenario_file, settings=[("machine.wheel_tolerance", 0.004)]).scenario.machine.model(seed)
        left, right = machine.wheels[0].radius_m, machine.wheels[1].radius_m
        truth = recording.truth
        cruising = (truth.t_s > 3.5) & (truth.t_s < 5.0)
        turned = np.ptp(np.unwrap(truth.column("heading_rad")[cruising, 0]))
        rate = truth.column("joint.wheel_left_rad")[cruising, 0]
        expected = np.ptp(rate) * abs(right - left) / 0.105 / 1.055
        assert turned == pytest.approx(expected, rel=0.05)


def test_a_tree_in_the_way_ends_the_run(scenario_file: Path) -> None:
    trees = [{"east_m": 1.2, "north_m": 0.0, "radius_m": 0.05}]
    recording = _run(scenario_file, orchard={"trees": trees})
    assert recording.ended_reason == "collision"
    assert "touched a tree" in recording.events[-1].text
    # It ends when the front, 0.1425 m ahead of the axle, is at the trunk; it moves up to 1 cm between two looks.
    last = recording.truth.column("vehicle_e_m")[-1, 0]
    assert last + 0.1425 == pytest.approx(1.15, abs=0.03)
    verdict = score(recording)
    assert verdict.metrics["truth.clearance.touched"] == 1.0
    assert verdict.metrics["truth.lane.finished"] == 0.0
    assert verdict.verdict == "fail"


@pytest.mark.parametrize(("most", "verdict"), [(0.0, "fail"), (1.0, "pass")])
def test_checks_say_whether_a_run_may_end_at_a_tree(scenario_file: Path, most: float, verdict: str) -> None:
    trees = [{"east_m": 1.2, "north_m": 0.0, "radius_m": 0.05}]
    checks = [{"metric": "truth.clearance.touched", "max": most}]
    assert score(_run(scenario_file, orchard={"trees": trees}, checks=checks)).verdict == verdict


def test_a_machine_may_not_start_in_a_tree(scenario_file: Path) -> None:
    with pytest.raises(BadInputError, match=r"machine\.start: the machine touches a tree"):
        _run(scenario_file, orchard={"trees": [{"east_m": 0.1, "north_m": 0.0}]})


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("driver.follows", "headings", "driver.follows: unknown estimator 'headings'; did you mean 'heading'"),
        ("driver.camera", "cameras", "driver.camera: unknown sensor 'cameras'"),
        ("driver.kind", "heading_held", "driver"),
        ("driver.lane_m", -1.0, "driver.lane_m"),
        ("scoring.smallest_ramp_m_s", 0.2, "scoring.smallest_ramp_m_s"),
    ],
)
def test_wrong_drivers_are_refused(scenario_file: Path, key: str, value: Any, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        load(scenario_file, settings=[(key, value)])


def test_a_driver_needs_columns_of_those_it_listens_to(scenario_file: Path) -> None:
    with pytest.raises(BadInputError, match=r"lane\.toml: driver: 'heading' gives no position_e_m, position_n_m"):
        execute(load(scenario_file, settings=[("driver.odometer", "heading")]))
    with pytest.raises(BadInputError, match="driver: 'imu' gives no sign_seen"):
        execute(load(scenario_file, settings=[("driver.camera", "imu")]))
