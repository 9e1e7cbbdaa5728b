"""Where replays of logs go: never in the place of another log's, or of a run's; and what one does with them."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
import tomli_w

import twin as agtwin
from tests.cli.command import twin
from tests.cli.test_replay_log import write_nmea
from twin.cli.comparing import compare_folders
from twin.cli.log_folder import folder_of_log
from twin.cli.replaying import replay_folder, score_folder
from twin.cli.replaying_log import LogOptions, replay_any
from twin.errors import BadInputError
from twin.logreplay.identity import name_of
from twin.runfolder import read_result, replacing, write_result


def replay(path: Path, out: Path, **options: object) -> None:
    given = {"estimators": ("guidance_gps",), "out": out, "as_json": True, "rrd": False, **options}
    assert replay_any(path, LogOptions(**given)) == 0


def files_below(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def write_run(folder: Path, **changes: object) -> None:
    folder.mkdir(parents=True)
    write_result(folder, {"schema": 1, "scenario": "log", "seed": 1, "run": 0, "ended": {}, "timing": {}, **changes})


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("gps.nmea", "gps_nmea"),
        ("gps.pos", "gps_pos"),
        ("my drive.2.log", "my_drive_2_log"),
        ("gps", "gps"),
        ("\u00e4\u00f6.txt", "txt"),
        ("..", "log"),
    ],
)
def test_a_log_is_called_by_stem_and_suffix(file: str, name: str) -> None:
    assert name_of(Path(file)).strip("_") == name


def test_logs_of_one_stem_and_runs_of_that_name_stay_beside_one_another(tmp_path: Path) -> None:
    out = tmp_path / "runs"
    write_run(out / "log" / "seed1_run0")
    before = files_below(out)
    for index, suffix in enumerate(("nmea", "txt")):
        replay(write_nmea(tmp_path / f"log.{suffix}", 30 + index), out)
    results = [read_result(out / "logs" / f"log_{suffix}") for suffix in ("nmea", "txt")]
    assert [result["log"]["file"] for result in results] == ["log.nmea", "log.txt"]
    assert [result["log"]["size_bytes"] for result in results] == [
        (tmp_path / f"log.{suffix}").stat().st_size for suffix in ("nmea", "txt")
    ]
    assert before.items() <= files_below(out).items()


def test_another_log_of_the_same_name_is_numbered_and_the_same_takes_its_own_place(tmp_path: Path) -> None:
    out = tmp_path / "runs"
    for where, count in (("monday", 30), ("tuesday", 40), ("wednesday", 50)):
        (tmp_path / where).mkdir()
        replay(write_nmea(tmp_path / where / "log.nmea", count), out)
    replay(tmp_path / "tuesday" / "log.nmea", out, estimators=("guidance_pv",))
    folders = [out / "logs" / name for name in ("log_nmea", "log_nmea_2", "log_nmea_3")]
    assert sorted((out / "logs").iterdir()) == folders
    assert [read_result(each)["log"]["measurements"]["gnss"] for each in folders] == [30, 40, 50]
    assert [list(read_result(each)["log"]["estimators"]) for each in folders] == [
        ["guidance_gps"],
        ["guidance_pv"],
        ["guidance_gps"],
    ]


def test_a_run_in_the_place_of_a_log_is_left_alone(tmp_path: Path) -> None:
    path = write_nmea(tmp_path / "seed1_run0", 30)
    write_run(tmp_path / "logs" / "seed1_run0")
    assert folder_of_log(tmp_path, path) == tmp_path / "logs" / "seed1_run0_2"


@pytest.mark.parametrize("below", ["seed1_run0", "a/b"])
def test_a_folder_with_results_below_its_own_is_not_replaced(below: str, tmp_path: Path) -> None:
    write_run(tmp_path / "target")
    write_run(tmp_path / "target" / below)
    before = files_below(tmp_path)
    with pytest.raises(BadInputError, match=f"holds other results.*{below}"), replacing(tmp_path / "target"):
        pass
    assert files_below(tmp_path) == before


def test_replayed_logs_can_be_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replay(write_nmea(tmp_path / "log.nmea", 60), tmp_path / "one")
    replay(tmp_path / "log.nmea", tmp_path / "two")
    replay(write_nmea(tmp_path / "log.nmea", 60, speed_m_s=3.5), tmp_path / "two")
    replay(write_nmea(tmp_path / "log.nmea", 60), tmp_path / "three", estimators=("gps=guidance_gps",))
    one, two, other = (tmp_path / each / "logs" for each in ("one", "two", "three"))
    capsys.readouterr()

    def compared(first: Path, second: Path) -> tuple[int, dict]:
        code = compare_folders(first, second, tolerance=None, as_json=True)
        return code, json.loads(capsys.readouterr().out)

    code, told = compared(one / "log_nmea", two / "log_nmea")
    assert (code, told["same"], told["notes"]) == (0, True, [])
    code, told = compared(one / "log_nmea", two / "log_nmea_2")
    assert code == 1
    assert told["notes"] == ["another log: log.nmea and log.nmea"]
    assert {each["name"] for each in told["differences"]} >= {"measurements/gnss", "estimates/guidance_gps"}
    _, told = compared(one / "log_nmea", other / "log_nmea")
    streams = [each for each in told["differences"] if each["kind"] == "stream"]
    assert [(each["name"], each["first"]) for each in streams] == [
        ("estimates/guidance_gps", "there"),
        ("estimates/gps", "missing"),
    ]
    write_run(tmp_path / "run")
    with pytest.raises(BadInputError, match=r"is a log, .* a run"):
        compare_folders(one / "log_nmea", tmp_path / "run", tolerance=None, as_json=True)


def test_a_replayed_log_is_no_run(tmp_path: Path) -> None:
    replay(write_nmea(tmp_path / "log.nmea", 30), tmp_path)
    folder = tmp_path / "logs" / "log_nmea"
    message = "log_nmea: a replayed log; look at it with twin view"
    with pytest.raises(BadInputError, match=message):
        score_folder(folder, as_json=True)
    with pytest.raises(BadInputError, match=message):
        replay_folder(folder, settings=(), estimators=(), as_json=True)
    with pytest.raises(BadInputError, match=message):
        agtwin.open(folder)


def test_a_reference_may_have_a_mapping_of_its_own(tmp_path: Path) -> None:
    log = write_nmea(tmp_path / "log.nmea", 60)
    began = 1_746_057_600  # 1 May 2025
    with (tmp_path / "truth.csv").open("w") as file:
        rows = csv.writer(file)
        rows.writerow(("t", "lat", "lon"))
        rows.writerows((began + 0.1 * k, 52.0 + 0.3 * k / 111_267.0, 13.0) for k in range(60))
    columns = {"latitude_deg": {"column": "lat"}, "longitude_deg": {"column": "lon"}}
    table = {"kind": "gnss", "time": {"column": "t"}, "columns": columns}
    (tmp_path / "truth.toml").write_text(tomli_w.dumps({"tables": [table]}))
    done = twin(
        "replay", log.name, "--reference", "truth.csv", "--reference-mapping", "truth.toml", "--no-rrd", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    metrics = read_result(tmp_path / "runs" / "logs" / "log_nmea")["metrics"]
    assert metrics["gnss.reference.epochs"] >= 59.0
    # Digits of the sentences: 1e-7 of a minute.
    assert metrics["gnss.reference.max_m"] < 1e-3


def test_help_and_lists_tell_what_there_is_for_logs(tmp_path: Path) -> None:
    told = " ".join(twin("replay", "--help", cwd=tmp_path).stdout.split())
    for word in ("vehicle.antenna_xyz_m", "estimators.NAME.KEY", "--reference-mapping"):
        assert word in told
    listed = twin("list", cwd=tmp_path).stdout
    assert "Clearpath Husky" in listed
    assert "combine" in listed
