"""One run: bit-identity, replay, independence of sensors, the ensemble axis."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import command_line, environment, twin, write_scenario
from twin.execution import execute
from twin.recording import Recording
from twin.replay import differing, replay
from twin.runfolder import read_recording
from twin.scenario import load
from viz.fingerprint import fingerprint


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    sensors = {"radar": {"dropout_probability": 0.1, "latency_jitter_s": 0.03}, "gnss": {"latency_s": 0.1}}
    return write_scenario(tmp_path, sensors=sensors, seeding={"spacing_m": 0.1, "drop_delay_s": 0.0})


def test_two_processes_write_the_same_bytes_and_the_same_recording(scenario_file: Path, tmp_path: Path) -> None:
    processes = [
        subprocess.Popen(
            command_line("run", scenario_file, "--out", tmp_path / name), cwd=tmp_path, env=environment(),
            stdout=subprocess.DEVNULL,
        )
        for name in ("first", "second")
    ]  # fmt: skip
    assert [process.wait(timeout=120) for process in processes] == [0, 0]
    first, second = (tmp_path / name / "small" / "seed1_run0" for name in ("first", "second"))
    names = sorted(file.relative_to(first) for file in first.rglob("*") if file.is_file())
    assert names == sorted(file.relative_to(second) for file in second.rglob("*") if file.is_file())
    for name in names:
        if name.name == "result.json":
            results = [json.loads((folder / name).read_text()) for folder in (first, second)]
            for result in results:
                del result["timing"]
            assert results[0] == results[1]
        elif name.name == "run.rrd":
            assert fingerprint(first / name) == fingerprint(second / name)
        else:
            assert (first / name).read_bytes() == (second / name).read_bytes(), name


def test_replaying_a_run_folder_gives_its_estimates_bit_for_bit(scenario_file: Path, tmp_path: Path) -> None:
    assert twin("run", scenario_file, "--no-rrd", cwd=tmp_path).returncode == 0
    folder = tmp_path / "runs" / "small" / "seed1_run0"
    recorded = read_recording(folder)
    replayed = replay(recorded)
    assert differing(recorded, replayed) == {}
    assert list(replayed.streams) == list(recorded.streams)
    # 3 s at 0.5 m/s2 are 2.2 m or 22 seeds in each of eight rows, less what the radar lags behind.
    assert 80 < len(recorded.streams["seeds/radar_only"]) < 180
    _streams_equal(recorded, replayed, [f"seeds/{name}" for name in recorded.names("seeds")])
    result = twin("replay", folder, cwd=tmp_path)
    assert result.returncode == 0
    assert "replay equals the run bit for bit" in result.stdout
    assert twin("score", folder, cwd=tmp_path).returncode == 0


def test_a_replay_notices_a_changed_measurement(scenario_file: Path) -> None:
    recorded = execute(load(scenario_file))
    radar = recorded.measurements("radar")
    radar.values[100:, 0, radar.columns.index("speed_m_s")] += 1e-9
    assert set(differing(recorded, replay(recorded))) == {"radar_only", "central"}


def _streams_equal(one: Recording, other: Recording, names: list[str]) -> None:
    for name in names:
        np.testing.assert_array_equal(one.streams[name].values, other.streams[name].values, err_msg=name)
        np.testing.assert_array_equal(one.streams[name].t_ns, other.streams[name].t_ns, err_msg=name)


def test_adding_a_sensor_changes_no_other(scenario_file: Path) -> None:
    fewer = execute(load(scenario_file))
    extra = {"preset": "imu_mpu6050", "mount": "row_2", "rate_hz": 50.0}
    more = execute(load(scenario_file, settings=[("sensors.another", extra)]))
    shared = [name for name in fewer.streams if not name.startswith("hidden/")]
    _streams_equal(fewer, more, shared)


def test_another_run_is_another_noise_in_the_same_world_and_another_seed_another_world(scenario_file: Path) -> None:
    rough = [("terrain", {"kind": "rough", "iso8608_class": "C"})]
    loaded = load(scenario_file, settings=rough)
    base, noise, world = (
        execute(loaded),
        execute(loaded, runs=(1,)),
        execute(load(scenario_file, settings=[*rough, ("seed", 2)])),
    )
    np.testing.assert_array_equal(base.truth.values, noise.truth.values)
    assert not np.array_equal(base.measurements("radar").values, noise.measurements("radar").values)
    assert not np.array_equal(base.truth.values, world.truth.values)


def test_members_of_an_ensemble_equal_the_single_runs(scenario_file: Path) -> None:
    loaded = load(scenario_file)
    ensemble = execute(loaded, runs=(0, 1, 2))
    for index in range(3):
        single = execute(loaded, runs=(index,))
        for name in ("radar_only", "central"):
            one, many = single.estimates(name).values[:, 0], ensemble.estimates(name).values[:, index]
            assert np.array_equal(np.isnan(one), np.isnan(many))
            np.testing.assert_allclose(one, many, rtol=1e-9, atol=1e-9)


def test_full_rate_truth_contains_the_ordinary_truth(scenario_file: Path) -> None:
    ordinary, full = execute(load(scenario_file)), execute(load(scenario_file), full_rate=True)
    assert len(full.truth) == 4 * 500 + 1
    np.testing.assert_array_equal(full.truth.values[::10], ordinary.truth.values)
