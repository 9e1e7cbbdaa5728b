"""Runs in which a steered machine follows its path by an estimator: the loop is closed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from tests.small_scenario import small_scenario
from twin.control import build_driver
from twin.errors import BadInputError
from twin.execution import execute, execute_each
from twin.recording import Recording
from twin.replay import replay
from twin.scenario import load, resolve
from twin.scoring import score
from twin.stress import make_plan, run_task

PATH = [{"stop_s": 2.0}, {"straight_m": 14.0}, {"turn_deg": 30.0, "radius_m": 12.0}, {"straight_m": 6.0}]
INS = {
    "kind": "row_speed_ins",
    "sensors": ["imu_1", "imu_4", "imu_5", "imu_8", "radar", "gnss"],
}


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    """A car, whose reference frame is put a metre before its rear axle."""
    rows = [1.2, 0.4, -0.4, -1.2]
    table = small_scenario(
        duration_s=24.0,
        soil={"preset": "asphalt"},
        machine={"kind": "prototype_car", "bar": {"body": "car", "xyz_m": [1.0, 0.0, 1.3], "rows_y_m": rows}},
        driver={"follows": "ins", "speed_m_s": 2.0, "path": PATH},
        estimators={"ins": INS},
    )
    for name, row in (("imu_5", "row_2"), ("imu_8", "row_3")):
        table["sensors"][name]["mount"] = row
    path = tmp_path / "guided.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path


def _offsets(recording: Recording, path: Path) -> np.ndarray:
    """Of the rear axle from the planned path, m."""
    scenario = load(path).scenario
    plan = build_driver(
        scenario.driver,
        start_e_n_heading=scenario.machine.vehicle_start,
        wheelbase_m=scenario.machine.wheelbase_m,
        seed=1,
    ).path
    truth = recording.truth
    places = zip(truth.column("vehicle_e_m")[:, 0], truth.column("vehicle_n_m")[:, 0], strict=True)
    return np.array([plan.project(east, north)[1] for east, north in places])


def _error(recording: Recording, column: str) -> np.ndarray:
    """Of the estimate, at the times of the truth."""
    truth, estimates = recording.truth, recording.estimates("ins")
    return np.interp(truth.t_s, estimates.t_s, estimates.column(column)[:, 0]) - truth.column(column)[:, 0]


def test_a_car_keeps_to_its_path_by_what_its_filter_says(scenario_file: Path) -> None:
    """Offsets are what the loop makes of the estimate's errors, and some centimetres of its own.

    Errors p of the position reach the offset through w^2 / (s + w)^2, errors n of the heading through 2 w / (s + w)^2;
    neither impulse response changes sign, so that no more than p + 2 n / w can come of them, w = 0.25 per metre.
    """
    assert load(scenario_file).scenario.machine.reference_x_m == pytest.approx(1.0)
    recordings = execute_each(load(scenario_file), runs=(0, 1))
    offsets = [_offsets(recording, scenario_file) for recording in recordings]
    for recording, offset in zip(recordings, offsets, strict=True):
        assert [event.text for event in recording.events if event.source == "driver"][-1] == "finished"
        moving = recording.truth.column("segment")[:, 0] > 0
        position, heading = (_error(recording, name)[moving] for name in ("position_n_m", "heading_rad"))
        largest = np.abs(position).max() + 2.0 / 0.25 * np.abs(heading).max()
        assert np.abs(offset).max() < largest + 0.05
        on_line = recording.truth.column("segment")[:, 0] == 1
        assert np.abs(offset[on_line]).max() < 0.04  # an RTK receiver
    assert np.abs(offsets[0] - offsets[1]).max() > 1e-4
    again = replay(recordings[0])
    np.testing.assert_array_equal(again.estimates("ins").values, recordings[0].estimates("ins").values)


def test_what_is_towed_does_not_tell_where_the_tractor_is() -> None:
    table = small_scenario(driver={"follows": "central"})
    with pytest.raises(BadInputError, match=r"driver\.follows: estimates are of a frame on 'planter', which swings"):
        resolve(table, where="here")
    on_tractor = {"bar": {"body": "tractor", "xyz_m": [0.0, 0.0, 0.0]}}
    resolve(small_scenario(driver={"follows": "central"}, machine=on_tractor), where="here")


def test_members_of_a_stress_test_are_the_single_runs(scenario_file: Path) -> None:
    settings = [("duration_s", 8.0)]
    result = run_task(make_plan(scenario_file, runs=2, worlds=1, settings=settings, vary=[], seed=None), 0, 0)
    single = execute(load(scenario_file, settings=settings), runs=(1,))
    assert result.ended_reason == single.ended_reason == "duration"
    name = "ins.row_speed.mean_abs_error_m_s"
    assert result.metrics[name][1] == score(single).metrics[name]


def test_several_runs_cannot_share_a_world(scenario_file: Path) -> None:
    with pytest.raises(BadInputError, match=r"the commands of driver depend.*one run at a time"):
        execute(load(scenario_file), runs=(0, 1))


def test_whom_it_follows_has_to_be_there_and_to_give_a_pose(scenario_file: Path) -> None:
    with pytest.raises(BadInputError, match=r"driver\.follows: unknown estimator 'inns'; did you mean 'ins'"):
        load(scenario_file, settings=[("driver.follows", "inns")])
    with pytest.raises(BadInputError, match=r"driver: 'radar_only' gives no position_e_m.*kind 'path' needs"):
        execute(load(scenario_file, settings=[("driver.follows", "radar_only")]))


@pytest.mark.parametrize(("key", "value"), [("driver.follows", 1), ("driver.stale_after_s", -1.0)])
def test_wrong_settings_are_refused(scenario_file: Path, key: str, value: Any) -> None:
    with pytest.raises(BadInputError, match=key):
        load(scenario_file, settings=[(key, value)])


def test_a_silent_receiver_stops_the_machine_and_it_says_so(tmp_path: Path) -> None:
    """The position that is held through 14 s of silence is no position; the events tell from when until when."""
    table = small_scenario(
        duration_s=28.0,
        soil={"preset": "asphalt"},
        machine={"kind": "prototype_car"},
        driver={"follows": "plain", "speed_m_s": 1.5, "path": [{"stop_s": 2.0}, {"straight_m": 60.0}]},
    )
    table["sensors"] = {
        "gnss": {"preset": "rtk_f9p", "mount": "antenna", "faults": [{"kind": "outage", "from_s": 8.0, "to_s": 22.0}]}
    }
    table["estimators"] = {"plain": {"kind": "guidance_gps", "sensors": ["gnss"]}}
    path = tmp_path / "silent.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    recording = execute(load(path))
    sight = [event for event in recording.events if event.source == "driver.sight"]
    assert [(event.level, event.text) for event in sight] == [("warning", "nothing to go by"), ("info", "sees again")]
    # 2 s after the last fix that came, which is 0.1 s late; and with the first after the silence.
    assert sight[0].t_ns * 1e-9 == pytest.approx(10.1, abs=0.25)
    assert sight[1].t_ns * 1e-9 == pytest.approx(22.2, abs=0.3)
    truth = recording.truth
    speed = truth.column("speed_m_s")[:, 0]
    assert np.abs(speed[(truth.t_s > 18.0) & (truth.t_s < 22.0)]).max() < 0.05
    assert speed[truth.t_s > 27.0].min() > 1.0
