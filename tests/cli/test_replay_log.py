"""``twin replay`` of logs of real receivers: the contract of the command line, and every real log there is."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.cli.command import interrupted, twin
from tests.logs import DATA
from twin.cli.replaying_log import LogOptions, replay_any
from twin.errors import BadInputError
from twin.formats.nmea import framed
from twin.recording import Stream
from twin.runfolder import read_result

GPSD = ("foretrex-201", "garmin-10x", "mt3339", "rst39", "skytraq-dgps", "skytraq-fix")
KINDS = (
    "guidance_gps",
    "guidance_pv",
    "cv=guidance_kinematic:model=constant_velocity",
    "ca=guidance_kinematic:model=constant_acceleration",
    "guidance_imm",
)


def needs(folder: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(not (DATA / folder).is_dir(), reason=f"no real logs in {DATA / folder}")


def write_nmea(path: Path, count: int, *, rate_hz: float = 10.0, speed_m_s: float = 3.0) -> Path:
    """Northwards at a steady speed, with a fix of RTK that floats for the middle third."""
    lines = []
    for k in range(count):
        t = k / rate_hz
        clock = f"{int(t // 3600):02d}{int(t % 3600 // 60):02d}{t % 60:05.2f}"
        minutes = 60.0 * (speed_m_s * t / 111_267.0)  # of a degree of latitude at 52 deg
        place = f"52{minutes:010.7f},N,01300.0000000,E"
        quality, mode = (5, "F") if count // 3 <= k < 2 * count // 3 else (4, "R")
        lines.append(framed(f"GNGGA,{clock},{place},{quality},18,0.7,40.0,M,45.0,M,1.0,0001"))
        lines.append(framed(f"GNRMC,{clock},A,{place},{speed_m_s * 3600 / 1852:.3f},0.00,010525,,,{mode}"))
        lines.append(framed(f"GNGST,{clock},0.02,,,,0.010,0.010,0.020"))
    path.write_bytes("".join(lines).encode())
    return path


def replayed(capsys: pytest.CaptureFixture[str], path: Path, out: Path, **options: object) -> dict:
    """The result that ``--json`` prints, with the estimators' kinds unless told."""
    given = {"estimators": KINDS, "out": out, "as_json": True, "rrd": False, **options}
    assert replay_any(path, LogOptions(**given)) == 0
    (result,) = json.loads(capsys.readouterr().out)
    return result


# --- the contract ----------------------------------------------------------------------------------------------------


def test_a_log_becomes_a_folder_and_a_table(tmp_path: Path) -> None:
    write_nmea(tmp_path / "my drive.nmea", 300)
    with (tmp_path / "my drive.nmea").open("ab") as file:
        file.write(b"$GPGGA,garbage*00\r\nnoise\r\n")
    done = twin("replay", "my drive.nmea", "--estimator", "guidance_gps", "--out", "found", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert re.search(r"float to fixed\W+1\b", done.stdout)
    assert "passed over: 1 x checksum" in done.stdout
    folder = tmp_path / "found" / "logs" / "my_drive_nmea"
    written = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert written == {"result.json", "run.rrd", "measurements/gnss.parquet", "estimates/guidance_gps.parquet"}
    result = read_result(folder)
    assert (result["kind"], result["scenario"], result["verdict"]) == ("log", "my_drive_nmea", None)
    assert result["log"]["start_utc"] == "2025-05-01T00:00:00.000Z"
    assert result["problems"]["checksum"] == 1
    assert result["metrics"]["gnss.quality.fixed_to_float_count"] == 1.0
    assert result["metrics"]["gnss.smoothness.largest_step_beyond_m"] == pytest.approx(0.0, abs=0.01)
    # Ours: so another replay takes its place, but nothing else's.
    assert twin("replay", "my drive.nmea", "--no-rrd", "--out", "found", cwd=tmp_path).returncode == 0
    assert not (folder / "run.rrd").exists()
    assert [path.name for path in folder.parent.iterdir()] == ["my_drive_nmea"]
    thesis = tmp_path / "mine" / "logs" / "my_drive_nmea" / "thesis.txt"
    thesis.parent.mkdir(parents=True)
    thesis.write_text("do not delete")
    refused = twin("replay", "my drive.nmea", "--no-rrd", "--out", "mine", cwd=tmp_path)
    assert refused.returncode == 2
    assert thesis.exists()


def test_json_prints_json_and_nothing_else(tmp_path: Path) -> None:
    write_nmea(tmp_path / "log.nmea", 100)
    done = twin("replay", "log.nmea", "--estimator", "guidance_pv", "--json", "--no-rrd", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    (result,) = json.loads(done.stdout)
    assert result == read_result(tmp_path / "runs" / "logs" / "log_nmea")
    assert {"schema", "kind", "metrics", "timing", "versions", "verdict", "problems"} <= set(result)


@pytest.mark.parametrize(
    ("log", "options", "message"),
    [
        ("missing.nmea", {}, "missing.nmea"),
        ("junk.nmea", {}, "junk.nmea"),
        ("empty.nmea", {}, "empty.nmea"),
        ("log.nmea", {"estimators": ("guidance_gsp",)}, "guidance_gsp"),
        ("log.nmea", {"estimators": ("no_such_module:Filter",)}, "no_such_module"),
        ("log.nmea", {"origin": "north"}, "--origin north: expected LAT,LON"),
        ("log.nmea", {"origin": "95,0"}, "--origin 95,0: expected LAT,LON"),
        (
            "log.nmea",
            {"origin": "0,0"},
            "log.nmea: begins at 52.0000,13.0000, 5682 km from the origin 0,0; a level plane is a map for 100 km",
        ),
        ("log.nmea", {"reference": Path("missing.pos")}, "missing.pos"),
        ("log.nmea", {"reference": Path("undated.nmea")}, "tells no date"),
        ("log.nmea", {"settings": ("driver.speed_m_s=3.0",)}, "driver: unknown key"),
        ("trial.mat", {"reference": Path("log.nmea")}, "--reference: is for logs"),
        (".", {"origin": "1,2"}, "--origin: is for logs"),
        (".", {"reference_mapping": Path("husky")}, "--reference-mapping: is for logs"),
        (".", {"rrd": False}, "--no-rrd: is for logs"),
        ("tables", {}, "tables: not a run folder; a log of CSV files needs --mapping"),
        ("tables", {"reference": Path("log.nmea")}, "tables: not a run folder; a log of CSV files needs --mapping"),
        ("trial.mat", {"rrd": False}, "--no-rrd: is for logs"),
        ("log.nmea", {"reference_mapping": Path("husky")}, "there is no --reference"),
        ("log.nmea", {"reference": Path("far.nmea")}, "begins 53.6 years away"),
        (".", {}, "not a run folder"),
    ],
)
def test_wrong_input_is_told(
    log: str, options: dict, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_nmea(tmp_path / "log.nmea", 20)
    (tmp_path / "junk.nmea").write_bytes(bytes(range(256)) * 40)
    (tmp_path / "empty.nmea").touch()
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "fix.csv").touch()
    place = "5200.0,N,01300.0,E"
    undated = "".join(framed(f"GPGGA,00000{s},{place},1,8,1.0,40.0,M,45.0,M,,") for s in range(9))
    (tmp_path / "undated.nmea").write_text(undated)
    dated = framed("GPZDA,000008,01,12,2078,00,00") + framed("GPZDA,000008,01,12,9999,00,00")
    (tmp_path / "far.nmea").write_text(undated + dated)
    (tmp_path / "trial.mat").touch()
    with pytest.raises(BadInputError, match=re.escape(message)):
        replay_any(Path(log), LogOptions(**options))
    runs = tmp_path / "runs"
    assert not runs.exists() or [path for path in runs.rglob("*") if path.name != "logs"] == []


def test_wrong_input_is_one_clear_line_and_exit_code_2(tmp_path: Path) -> None:
    (tmp_path / "junk.nmea").write_bytes(bytes(range(256)) * 40)
    done = twin("replay", "junk.nmea", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1


def test_the_frame_may_lie_elsewhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_nmea(tmp_path / "log.nmea", 20)
    result = replayed(capsys, tmp_path / "log.nmea", tmp_path, origin="51.999,13.001")
    assert result["log"]["origin"]["latitude_deg"] == 51.999
    east, north, _ = result["log"]["start_e_n_heading"]
    assert (east, north) == pytest.approx((-68.7, 111.3), abs=0.1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_replay_leaves_no_half_folder(number: signal.Signals, tmp_path: Path) -> None:
    write_nmea(tmp_path / "log.nmea", 30_000)
    code, errors = interrupted(
        "replay",
        "log.nmea",
        "--estimator",
        KINDS[2],
        "--no-rrd",
        cwd=tmp_path,
        number=number,
        begins_with="log.nmea: gnss",
    )
    assert (code, errors) == (130, "interrupted\n")
    assert [path for path in (tmp_path / "runs").rglob("*") if path.name != "logs"] == []


# --- real logs -------------------------------------------------------------------------------------------------------


def _usable(result: dict) -> None:
    """Every estimator has told a track; those that need no standstill or movement first have heard of it."""
    metrics = result["metrics"]
    for name in result["log"]["estimators"]:
        assert metrics[f"{name}.smoothness.rms_acceleration_m_s2"] is not None
    assert metrics["guidance_pv.consistency.nis_position_updates"] > 0.0


@needs("gpsd_nmea")
@pytest.mark.parametrize("name", GPSD)
def test_real_receivers(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = replayed(capsys, DATA / "gpsd_nmea" / f"{name}.log", tmp_path, rrd=True)
    _usable(result)
    # The lines of comment at the head of gpsd's logs.
    assert result["problems"]["not NMEA"] >= 5
    if name == "skytraq-dgps":
        assert result["metrics"]["gnss.quality.dgps_percent"] == 100.0
        assert result["log"]["measurements"]["gnss"] == 96  # as its README counts


@needs("f9p_ppk_rtklib")
def test_a_mostly_floating_drive_against_the_fixed_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = DATA / "f9p_ppk_rtklib"
    reference = folder / "demo5_b34f_f.pos"
    result = replayed(capsys, folder / "py_0315f.pos", tmp_path, reference=reference, estimators=(*KINDS[:1], KINDS[3]))
    found = result["metrics"]
    # As the data's README counts and measures, over the epochs in which the reference is fixed.
    assert found["gnss.reference.epochs"] == 4449.0
    assert found["gnss.quality.fixed_percent"] == pytest.approx(100.0 * 1649 / 4521, abs=0.1)
    assert found["gnss.reference.rmse_float_m"] == pytest.approx(0.23, abs=0.02)
    assert found["gnss.reference.rmse_fixed_m"] < 0.03
    # Whoever takes the receiver's sigma for its own is misled by it; paper 004's R comes from HDOP and is not.
    assert found["gnss.reference.error_over_sigma_float"] > 5.0
    assert found["guidance_gps.reference.error_over_sigma_float"] == pytest.approx(
        found["gnss.reference.error_over_sigma_float"], rel=1e-6
    )
    assert found["ca.reference.error_over_sigma_float"] < 1.0
    # Heights are worse, by about what satellites that are all above make of them (two to three times).
    assert 1.0 < found["gnss.reference.height_rmse_fixed_m"] / found["gnss.reference.rmse_fixed_m"] < 3.0
    assert found["gnss.reference.height_rmse_float_m"] > found["gnss.reference.rmse_float_m"]
    assert "guidance_gps.reference.height_rmse_m" not in found


@needs("f9p_ppk_rtklib")
def test_heights_of_a_machine_are_compared_where_its_antenna_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = DATA / "f9p_ppk_rtklib"
    found = replayed(
        capsys,
        folder / "py_0315f.pos",
        tmp_path,
        reference=folder / "demo5_b34f_f.pos",
        estimators=("height_hold",),
        settings=("vehicle.antenna_xyz_m=[1.0, 0.0, 2.5]",),
    )["metrics"]
    # Who holds the last height holds the receiver's error.
    for figure in ("rmse_m", "max_m", "rmse_fixed_m", "error_over_sigma"):
        told = found[f"gnss.reference.height_{figure}"]
        assert found[f"height_hold.reference.height_{figure}"] == pytest.approx(told, rel=1e-6)


@needs("f9p_ppk_rtklib")
def test_gps_time_of_a_solution_is_matched_with_utc_of_sentences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # One drive twice: as RTKLIB's file in GPS time, and the same positions as sentences, 18 s earlier by their clock.
    solution = DATA / "f9p_ppk_rtklib" / "demo5_b34f_f.pos"
    rows = [line.split() for line in solution.read_text().splitlines() if not line.startswith("%")][2600:2900]
    sentences = []
    for row in rows:
        hours, minutes, seconds = (float(part) for part in row[1].split(":"))
        clock = (3600.0 * hours + 60.0 * minutes + seconds - 18.0) % 86_400.0
        stamp = f"{int(clock // 3600):02d}{int(clock % 3600 // 60):02d}{clock % 60:06.3f}"
        lat, lon = float(row[2]), -float(row[3])
        place = f"{int(lat):02d}{60 * (lat % 1):011.8f},N,{int(lon):03d}{60 * (lon % 1):011.8f},W"
        sentences += [
            framed(f"GNGGA,{stamp},{place},4,11,0.8,{float(row[4]):.3f},M,0.0,M,1.0,0000"),
            framed(f"GNRMC,{stamp},A,{place},,,241220,,,R"),
        ]
    log = tmp_path / "sentences.nmea"
    log.write_text("".join(sentences))
    found = replayed(capsys, log, tmp_path, reference=solution, estimators=())["metrics"]
    assert found["gnss.reference.epochs"] >= 290.0
    # Digits of the two files: 1e-9 deg and 1e-8 min; a second off would be metres.
    assert found["gnss.reference.max_m"] < 1e-3


@needs("husky_jackal_bags")
def test_a_field_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = replayed(capsys, DATA / "husky_jackal_bags", tmp_path, mapping=Path("husky"))
    _usable(result)
    assert result["log"]["measurements"] == {"gnss": 989, "odometry": 3952, "imu": 11865}
    assert set(result["log"]["estimators"]["guidance_pv"]) >= {"gnss", "odometry"}
    # 359 m in 395 s, as its README says.
    estimates = _estimates(tmp_path / "logs" / "husky_jackal_bags", "guidance_imm")
    speed = estimates.column("speed_m_s")[:, 0]
    assert float(speed.mean()) == pytest.approx(359.0 / 395.0, rel=0.15)


@needs("combine_gartner_agridat")
def test_a_combine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = DATA / "combine_gartner_agridat" / "gartner.corn.csv"
    result = replayed(capsys, path, tmp_path, mapping=Path("combine"), estimators=KINDS[:2])
    _usable(result)
    assert result["log"]["measurements"]["gnss"] == 4949
    # A combine does not jump: between neighbours 3 s apart there is nothing but its motion and the digits of the file.
    assert result["metrics"]["gnss.smoothness.rms_acceleration_m_s2"] < 0.5


def _estimates(folder: Path, name: str) -> Stream:
    return Stream.from_arrow(pq.read_table(folder / "estimates" / f"{name}.parquet"))
