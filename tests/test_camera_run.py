"""A robot with a camera drives towards a stop sign: from the world to the record and back."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

import twin
from tests.cli.command import twin as command
from twin.errors import BadInputError
from twin.execution import Journey, execute, execute_each, open_members, open_world
from twin.members import Tape
from twin.recording import Recording, save
from twin.replay import differing, replay
from twin.scenario import load

TABLE: dict[str, Any] = {
    "title": "A lane with a sign at its end",
    "duration_s": 5.0,
    "terrain": {"kind": "rough", "iso8608_class": "A", "cell_m": 0.05},
    "soil": {"preset": "firm"},
    "machine": {"kind": "orchard_robot", "start": {"heading_deg": 90.0}},
    "light": {"lux": 10_000.0},
    "orchard": {"lanes": [{"heading_deg": 90.0, "length_m": 5.0, "width_m": 1.2, "spacing_m": 1.0}]},
    "signs": [{"east_m": 0.0, "north_m": 3.0, "heading_deg": -90.0}],
    "driver": {
        "speed_m_s": 0.5,
        "steering_bandwidth_1_m": 3.0,
        "preview_s": 0.2,
        "path": [{"stop_s": 1.0}, {"straight_m": 1.8}],
    },
    "sensors": {
        "camera": {"preset": "camera_pi_v2", "mount": "camera"},
        "imu": {"preset": "imu_mpu6050", "mount": "imu"},
        "encoders": {"preset": "wheel_encoders_lm393", "mount": "encoders"},
        "compass": {"preset": "mag_qmc5883l", "mount": "magnetometer"},
    },
    "estimators": {"heading": {"kind": "heading_filter", "sensors": ["imu", "encoders", "compass"]}},
}


@pytest.fixture(scope="module")
def scenario_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("camera") / "sign.toml"
    path.write_text(tomli_w.dumps(TABLE), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def driven(scenario_file: Path) -> Recording:
    return execute(load(scenario_file))


def test_the_robot_sees_the_sign_come_nearer(driven: Recording) -> None:
    camera, truth = driven.measurements("camera"), driven.truth
    assert len(camera) == 25
    np.testing.assert_array_equal(camera.t_available_ns, camera.t_ns + 100_000_000)
    at = np.searchsorted(truth.t_ns, camera.t_ns)
    # The camera sits 0.11 m or so ahead of the axle; the plate is 0.14 m above it.
    ahead = 3.0 - truth.column("position_n_m")[at, 0] - 0.11
    away = camera.column("sign_range_m")[:, 0]
    near = ahead < 2.5
    assert near.sum() > 5
    assert camera.column("sign_seen")[near, 0].min() == 1.0
    np.testing.assert_allclose(away[near], np.hypot(ahead[near], 0.14), rtol=0.1)
    hidden = driven.hidden("camera")
    np.testing.assert_allclose(away[near], hidden.column("true_sign_range_m")[near, 0], rtol=0.06)
    bearing = camera.column("sign_bearing_rad")[near, 0]
    np.testing.assert_allclose(bearing, hidden.column("true_sign_bearing_rad")[near, 0], atol=np.radians(1.0))


def test_pictures_are_in_the_record_and_in_the_folder(driven: Recording, tmp_path: Path, scenario_file: Path) -> None:
    pictures = driven.pictures["camera"]
    np.testing.assert_array_equal(pictures.t_ns, driven.measurements("camera").t_ns)
    assert (pictures.width_px, pictures.height_px) == (320, 240)
    last = pictures.rgb(-1)
    row = driven.measurements("camera").values[-1, 0]
    left, top, width, height = (int(value) for value in row[3:])
    inside = last[top : top + height, left : left + width].astype(int)
    # The octagon fills 0.83 of its box, and letters an eighth; edges are blurred.
    assert np.mean(inside[..., 0] > 1.5 * inside[..., 2]) > 0.5
    verdict = twin.score(driven)
    assert verdict.verdict == "pass"
    again = twin.run(str(scenario_file))
    for name, recording in (("a", driven), ("b", again)):
        save(recording, tmp_path / name)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*.parquet"))
    assert Path("pictures/camera.parquet") in files
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), str(file)


def test_members_are_the_single_runs_and_have_the_pictures_of_the_first(scenario_file: Path) -> None:
    loaded = load(scenario_file, settings=[("duration_s", 1.0), ("light.lux", 12.0)])
    ensemble, apart = execute(loaded, runs=(0, 1)), execute_each(loaded, runs=(0, 1))
    for index in range(2):
        single = execute(loaded, runs=(index,))
        alone = single.measurements("camera").values[:, 0]
        np.testing.assert_array_equal(alone, ensemble.measurements("camera").values[:, index])
        np.testing.assert_array_equal(alone, apart[index].measurements("camera").values[:, 0])
        assert single.pictures["camera"].jpeg == apart[index].pictures["camera"].jpeg
    assert ensemble.pictures["camera"].jpeg == apart[0].pictures["camera"].jpeg
    # In a dim light each run has its own grain.
    assert apart[0].pictures["camera"].jpeg != apart[1].pictures["camera"].jpeg


def test_a_stress_test_sees_the_same_and_drops_the_pictures(scenario_file: Path) -> None:
    loaded = load(scenario_file, settings=[("duration_s", 1.0)])
    tape = Tape(loaded.scenario)
    with open_world(loaded) as world:
        assert Journey(loaded.scenario, world, tape).go() == "duration"
    played = open_members(loaded, runs=(3,))
    dropping = open_members(loaded, runs=(3,), keep_measurements=False)
    for members in (played, dropping):
        for _ in tape.play(members, pause_ns=300_000_000):
            pass
    single = execute(loaded, runs=(3,))
    measured = played.streams()["measurements/camera"].values
    np.testing.assert_array_equal(measured, single.measurements("camera").values)
    assert played.pictures()["camera"].jpeg == single.pictures["camera"].jpeg
    assert dropping.pictures() == {}


def test_a_replay_is_the_run_to_the_last_bit_and_keeps_the_pictures(driven: Recording) -> None:
    again = replay(driven)
    assert set(differing(driven, again).values()) <= {0.0}
    assert again.pictures["camera"].jpeg == driven.pictures["camera"].jpeg


def test_a_run_folder_is_read_back_with_its_pictures(driven: Recording, scenario_file: Path, tmp_path: Path) -> None:
    done = command("run", scenario_file, "--no-rrd", "--out", tmp_path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "sign" / "seed1_run0"
    back = twin.open(folder)
    assert back.pictures["camera"].jpeg == driven.pictures["camera"].jpeg
    assert "pictures/camera" not in back.streams
    spoilt = tmp_path / "spoilt"
    shutil.copytree(folder, spoilt)
    (spoilt / "pictures" / "camera.parquet").write_bytes(b"nothing")
    with pytest.raises(BadInputError, match=r"camera\.parquet: cannot be read as pictures"):
        twin.open(spoilt)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("signs.0.height_m", 0.01, r"signs\.0.*height_m = 0\.01: half of the plate"),
        ("signs.0.size", 0.2, r"signs\.0\.size.*did you mean 'size_m'"),
        ("signs", {"east_m": 0.0}, "signs"),
        ("sensors.camera.width_px", 5000, r"sensors\.camera.*width_px"),
        ("sensors.camera.mount", "lens", "unknown mount 'lens'"),
        ("sensors.camera.preset", "camera_pi_v3", "did you mean 'camera_pi_v2'"),
        ("duration_s", 30_000.0, "GB of memory"),
    ],
)
def test_wrong_keys_are_named(scenario_file: Path, key: str, value: Any, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        load(scenario_file, settings=[(key, value)])


def test_a_sign_off_the_ground_is_named_with_its_file(scenario_file: Path) -> None:
    loaded = load(
        scenario_file,
        settings=[("terrain.size_m", [20.0, 20.0]), ("signs.0.north_m", 50.0), ("sensors", {}), ("estimators", {})],
    )
    with pytest.raises(BadInputError, match=r"sign\.toml: signs\.0: .*off the terrain"):
        execute(loaded)
