"""What a user can get wrong, through the real command: a clear message, exit code 2, no traceback, nothing written."""

import os
import resource
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.command import command_line, environment, twin, write_scenario
from twin.cli.running import load_all
from twin.errors import BadInputError

RADAR = {"preset": "radar_99ppm", "mount": "radar"}

WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": ({"driver": {"spede_m_s": 2.0}}, "driver.spede_m_s: unknown key; did you mean 'speed_m_s'"),
    "unknown section": ({"terain": {}}, "terain: unknown key; did you mean 'terrain'"),
    "wrong type": ({"duration_s": "four"}, "duration_s: given 'four'"),
    "text for a number": ({"driver": {"speed_m_s": "2.0"}}, "driver.speed_m_s: given '2.0'"),
    "negative": ({"driver": {"speed_m_s": -1.0}}, "driver.speed_m_s: given -1.0"),
    "not a number": ({"driver": {"speed_m_s": float("nan")}}, "driver.speed_m_s: given nan"),
    "rate that does not divide": ({"sensors": {"radar": {"rate_hz": 30.0}}}, "sensors.radar: rate_hz = 30"),
    "step of broken nanoseconds": ({"world": {"physics_hz": 300.0}}, "world.physics_hz: "),
    "unknown kind": ({"terrain": {"kind": "mars"}}, "terrain: unknown kind 'mars'"),
    "unknown machine": (
        {"machine": {"kind": "prototype"}},
        "machine: unknown kind 'prototype'; did you mean 'prototype_car'? (there are planter_f8, prototype_car",
    ),
    "key of another machine": (
        {"machine": {"kind": "prototype_car", "draught_n": 1.0}},
        "machine.draught_n: unknown key",
    ),
    "unknown preset": ({"sensors": {"radar": {"preset": "radar_98ppm"}}}, "did you mean 'radar_99ppm'"),
    "preset that is a path": ({"sensors": {"radar": {"preset": "../../etc/passwd"}}}, "not a path"),
    "sensor with neither preset nor kind": ({"sensors": {"extra": {"mount": "radar"}}}, "sensors.extra: needs a kind"),
    "unknown mount": ({"sensors": {"radar": {"mount": "roof"}}}, "sensors.radar.mount: unknown mount 'roof'"),
    "sensor that is not there": (
        {"estimators": {"radar_only": {"sensors": ["rader"]}}},
        "estimators.radar_only.sensors: unknown sensor 'rader'; did you mean 'radar'",
    ),
    "check on no metric": (
        {"checks": [{"metric": "central.row_sped.mean_abs_error_m_s", "max": 1.0}]},
        "checks.0.metric: unknown metric",
    ),
    "published figure for no metric": ({"published": {"paper.figure": 1.0}}, "published.paper.figure: unknown metric"),
    "check that requires nothing": ({"checks": [{"metric": "central.position.rmse_m"}]}, "checks.0: a check needs"),
    "path that leaves the terrain": (
        {"terrain": {"kind": "flat", "size_m": [30.0, 30.0]}, "driver": {"path": [{"straight_m": 500.0}]}},
        "leaves the terrain",
    ),
    "terrain of absurd size": ({"terrain": {"kind": "flat", "size_m": [1e6, 1e6]}}, "terrain"),
    "duration of absurd memory": ({"duration_s": 36_000.0, "recording": {"truth_hz": 500.0}}, "GB of memory"),
    "duration of less than a step": ({"duration_s": 1e-9}, "duration_s = 1e-09: shorter than one step of the physics"),
    "turn without a radius": ({"driver": {"path": [{"turn_deg": 90.0}]}}, "turn_deg and radius_m go together"),
    "fault window backwards": (
        {"sensors": {"radar": {"faults": [{"kind": "outage", "from_s": 3.0, "to_s": 2.0}]}}},
        "sensors.radar.faults.0",
    ),
    "loss backwards": (
        {"scoring": {"loss": {"from_s": 3.0, "to_s": 2.0}}},
        "scoring.loss: from_s = 3 is not",
    ),
    "loss after the end": (
        {"scoring": {"loss": {"from_s": 5.0, "to_s": 6.0}}},
        "scoring.loss.from_s = 5: the run",
    ),
    "estimator named as a family of metrics": (
        {"estimators": {"bound": {"kind": "height_hold", "sensors": ["radar"]}}},
        "estimators: name 'bound': reserved",
    ),
    "transducer on a hinge": (
        {"sensors": {"lmt": {"preset": "lmt_millay", "mount": "radar", "joint": "hitch_yaw"}}},
        "sensors.lmt: joint 'hitch_yaw' is no slide (there are none)",
    ),
    "implement of a machine without one": (
        {"implement": {"kind": "levelling"}},
        "has no implement",
    ),
    "seeding without a spacing": ({"seeding": {"drop_delay_s": 0.1}}, "seeding.spacing_m: missing"),
    "seeds no further apart than they are wide": ({"seeding": {"spacing_m": 0.0}}, "seeding.spacing_m: given 0.0"),
    "more skips and doubles than cells": (
        {"seeding": {"spacing_m": 0.16, "skip_probability": 0.6, "double_probability": 0.6}},
        "seeding: skip_probability + double_probability: more than 1",
    ),
    "terrain file elsewhere": ({"terrain": {"kind": "file", "path": "../heights.npy"}}, "not a path"),
    "extends a path": ({"extends": "../small"}, "extends"),
    "extends nothing": ({"extends": "other"}, "there is no other.toml beside it"),
}


def _assert_refused(result: subprocess.CompletedProcess[str], message: str) -> None:
    assert result.returncode == 2, result.stdout + result.stderr
    assert message in result.stderr
    assert "Traceback" not in result.stderr + result.stdout


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_scenario_is_refused(case: str, tmp_path: Path) -> None:
    changes, message = WRONG[case]
    path = write_scenario(tmp_path, **changes)
    result = twin("run", path, "--out", tmp_path / "out", cwd=tmp_path)
    _assert_refused(result, message)
    assert str(path) in result.stderr or "sensors." in result.stderr
    assert not list((tmp_path / "out").glob("*/*"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "missing.toml"], "missing.toml: no such scenario file"),
        (["run", "planter_turn"], "unknown scenario 'planter_turn'; did you mean 'planter_turns'"),
        (["run", "broken.toml"], "broken.toml: not valid TOML"),
        (["run", "binary.toml"], "binary.toml: not valid TOML"),
        (["run", "empty"], "no scenario (*.toml) in this folder"),
        (["run", "planter_turns", "--set", "seed"], "expected KEY=VALUE"),
        (["run", "planter_turns", "--set", "title.x=1"], "title is a value, not a table"),
        (["run", "planter_turns", "--seed", "-1"], "--seed"),
        (["run", "planter_turns", "--estimator", "no.such.module:Class"], "no.such.module"),
        (["score", "empty"], "not a run folder"),
        (["replay", "empty"], "not a run folder"),
        (["view", "empty"], "empty"),
        (["dance"], "No such command"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_wrong_command_is_refused(arguments: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "broken.toml").write_text("title = \n")
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)))
    (tmp_path / "empty").mkdir()
    _assert_refused(twin(*arguments, cwd=tmp_path), message)


@pytest.mark.parametrize(
    ("what", "settings", "message"),
    [
        ("scraper_rail_rkt", [], "unknown scenario 'scraper_rail_rkt'; did you mean 'scraper_rail_rtk'?"),
        ("zzz", [], "unknown scenario 'zzz' (twin list names all)"),
        ("small.toml", ["sensors.radar.preset=radar_98ppm"],
         "small.toml: sensors.radar.preset: unknown preset 'radar_98ppm'; did you mean 'radar_99ppm'?"),
        ("small.toml", ["sensors.radar.preset=zzz"],
         "small.toml: sensors.radar.preset: unknown preset 'zzz' (twin list names all)"),
        ("small.toml", ["terain.kind=flat"], "small.toml: terain: unknown key; did you mean 'terrain'?"),
    ],
)  # fmt: skip
def test_an_unknown_name_is_told_the_nearest_and_not_all(
    what: str, settings: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_scenario(tmp_path)
    with pytest.raises(BadInputError) as refused:
        load_all([what], settings)
    assert str(refused.value) == message


def test_a_scenario_that_is_named_twice_is_run_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = write_scenario(tmp_path)
    write_scenario(tmp_path, "other")
    (tmp_path / "alias.toml").symlink_to(path)
    loaded = load_all([str(path), "other.toml", "small.toml", "./small.toml", str(tmp_path)], [])
    assert [item.path for item in loaded] == [path, Path("other.toml"), tmp_path / "alias.toml"]
    # Another of the same name would go to the same folder.
    (tmp_path / "below").mkdir()
    write_scenario(tmp_path / "below")
    with pytest.raises(BadInputError, match="two scenarios of the same name"):
        load_all([str(path), "below/small.toml"], [])


def test_an_output_folder_that_cannot_be_made_is_refused_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    result = twin("run", write_scenario(tmp_path), "--out", tmp_path / "file" / "below", cwd=tmp_path)
    _assert_refused(result, "cannot be written to")
    assert (tmp_path / "file").read_text() == "in the way"


def test_a_folder_that_is_not_a_run_is_left_alone(tmp_path: Path) -> None:
    target = tmp_path / "runs" / "small" / "seed1_run0"
    target.mkdir(parents=True)
    (target / "thesis.txt").write_text("three years of work")
    result = twin("run", write_scenario(tmp_path), cwd=tmp_path)
    _assert_refused(result, "left alone")
    assert (target / "thesis.txt").read_text() == "three years of work"


@pytest.mark.parametrize("rrd", ["--rrd", "--no-rrd"])
def test_a_full_disk_leaves_the_earlier_run_as_it_was(rrd: str, tmp_path: Path) -> None:
    path = write_scenario(tmp_path)
    assert twin("run", path, "--no-rrd", cwd=tmp_path).returncode == 0
    folder = tmp_path / "runs" / "small" / "seed1_run0"
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    limit = 20_000

    result = subprocess.run(
        command_line("run", path, rrd),
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    _assert_refused(result, "cannot be written")
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before
    assert [entry.name for entry in folder.parent.iterdir()] == ["seed1_run0"]


def test_a_terrain_file_must_be_heights(tmp_path: Path) -> None:
    np.save(tmp_path / "bad.npy", np.array([["a", "b"], ["c", "d"]]))
    path = write_scenario(tmp_path, terrain={"kind": "file", "path": "bad.npy", "cell_m": 0.5})
    _assert_refused(twin("run", path, cwd=tmp_path), "bad.npy")


def test_a_terrain_file_cannot_run_code(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, ("exploded",)

    np.save(tmp_path / "bomb.npy", np.array([Bomb()], dtype=object), allow_pickle=True)
    path = write_scenario(tmp_path, terrain={"kind": "file", "path": "bomb.npy", "cell_m": 0.5})
    _assert_refused(twin("run", path, cwd=tmp_path), "bomb.npy")
    assert not (tmp_path / "exploded").exists()
