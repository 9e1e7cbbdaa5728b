"""The package from Python, as the README shows it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import twin
from tests.small_scenario import small_scenario
from twin.errors import BadInputError
from twin.recording import Recording, Stream, save
from twin.replay import differing
from twin.runfolder import write_result


def test_run_score_save_and_open(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(tomli_w.dumps(small_scenario()))
    recording = twin.run(path, seed=3, set={"driver.speed_m_s": 1.0})
    assert (recording.scenario_name, recording.seed, recording.runs) == ("small", 3, (0,))
    # Three seconds of driving at 0.5 m/s^2 lead to 1 m/s, not to the scenario's 2 m/s.
    assert 0.9 < recording.truth.column("speed_m_s").max() < 1.2
    verdict = twin.score(recording)
    assert verdict.verdict == "pass"
    assert verdict.metrics["central.row_speed.mean_abs_error_m_s"] > 0.0

    radar = recording.to_arrow("measurements/radar")
    assert {"t_ns", "t_available_ns", "valid", "speed_m_s"} <= set(radar.column_names)
    central = recording.estimates("central")
    assert central.values.shape == (len(central.t_s), 1, len(central.columns))
    assert central.t_s[-1] == recording.ended_t_s == 4.0
    assert np.isfinite(central.column("row_speed_1_m_s")[-1, 0])

    save(recording, tmp_path / "kept")
    write_result(tmp_path / "kept", verdict.as_json())
    again = twin.open(tmp_path / "kept")
    assert differing(recording, again) == {}
    np.testing.assert_equal(dict(twin.score(again).metrics), dict(verdict.metrics))
    assert differing(recording, twin.run(path, seed=3, run=1, set={"driver.speed_m_s": 1.0})).keys() == {
        "radar_only",
        "central",
    }


def test_a_run_index_below_zero_is_bad_input() -> None:
    with pytest.raises(BadInputError, match="run = -1: expected 0 or more"):
        twin.run("planter_turns", run=-1)


def test_a_stream_that_is_not_there_is_told_from_those_that_are() -> None:
    stream = Stream(columns=(), t_ns=np.zeros(0, dtype=np.int64), values=np.zeros((0, 1, 0)))
    names = ("truth", "measurements/gnss", "measurements/imu", "hidden/gnss", "estimates/ours", "estimates/theirs")
    recording = Recording(
        scenario_toml="", scenario_name="made", seed=0, runs=(0,), streams=dict.fromkeys(names, stream)
    )
    with pytest.raises(KeyError, match=r"no stream 'estimates/our'; did you mean 'estimates/ours'\? \(there are "):
        recording.estimates("our")
    with pytest.raises(KeyError, match=r"'measurements/gnss'\? \(there are measurements/gnss, measurements/imu\)"):
        recording.to_arrow("measurements/gns")
    for ask in (recording.measurements, recording.hidden, recording.to_arrow):
        with pytest.raises(KeyError, match=r"there are .*gnss"):
            ask("nothing")


def test_importing_the_package_is_light() -> None:
    heavy = "{'numpy', 'scipy', 'numba', 'pybullet', 'pyarrow', 'rerun', 'filterpy', 'matplotlib', 'pydantic'}"
    code = f"import sys, twin; sys.exit(' '.join({heavy} & set(sys.modules)) or None)"
    result = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
