"""``twin run --nmea``: which files are written, and what is left alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import twin, write_scenario
from tests.small_scenario import small_scenario_toml
from twin.cli import EXIT_BAD_INPUT
from twin.cli.sentences import write_sentences
from twin.errors import BadInputError
from twin.formats.logs import open_log
from twin.recording import Recording, Stream, measurement_stream
from twin.runfolder import read_recording
from twin.scenario import loads

RECEIVERS = {
    "gnss": {"preset": "rtk_f9p", "mount": "antenna"},
    "dual": {"preset": "rtk_f9p_dual", "mount": "antenna"},
    "ahrs": {"preset": "ahrs_mti300", "mount": "antenna"},
}


def stream(columns: tuple[str, ...], rows: int, **values: float) -> Stream:
    """Rows ten times a second, the last two of which arrive in the wrong order."""
    t_ns = np.arange(1, rows + 1, dtype=np.int64) * 100_000_000
    arrival = t_ns + 80_000_000
    arrival[-2:] = arrival[-2:][::-1]
    return Stream(
        columns=columns,
        t_ns=t_ns,
        values=np.tile([values.get(column, 1.0) for column in columns], (rows, 1, 1)),
        t_available_ns=arrival,
        valid=np.ones((rows, 1), dtype=np.bool_),
    )


def recording(**changes: object) -> Recording:
    """A recording of the receivers, not run."""
    toml = small_scenario_toml(sensors=RECEIVERS, **changes)
    gnss = (
        "position_e_m", "position_n_m", "position_u_m", "speed_m_s", "course_rad", "sigma_e_m", "sigma_n_m",
        "sigma_u_m", "quality", "satellites", "hdop", "vdop", "age_s",
    )  # fmt: skip
    streams = {
        "gnss": stream(gnss, 20, quality=4.0),
        "dual": stream((*gnss, "heading_rad", "sigma_heading_rad"), 20, quality=5.0),
        "ahrs": stream(("roll_rad", "pitch_rad", "heading_rad"), 40, roll_rad=0.1),
    }
    return Recording(
        scenario_toml=toml,
        scenario_name="small",
        seed=1,
        runs=(3,),
        streams={measurement_stream(name): each for name, each in streams.items()},
    )


def write(found: Recording, folder: Path) -> list[Path]:
    return write_sentences(found, loads(found.scenario_toml, where="test"), folder)


def test_each_receiver_has_its_files_in_a_folder_of_its_scenario(tmp_path: Path) -> None:
    paths = write(recording(), tmp_path)
    assert [path.relative_to(tmp_path).as_posix() for path in paths] == [
        "small/gnss.nmea",
        "small/gnss.panda",
        "small/dual.nmea",
        "small/dual.panda",
        "small/dual.paogi",
    ]
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(paths)
    log = open_log(paths[0])
    found = list(log.measurements())
    assert len(found) == 20
    assert not log.problems
    # sent in order of arrival
    assert [each.t_ns for each in found[-2:]] == [1_900_000_000, 1_800_000_000]
    assert {each.column("quality")[0] for each in open_log(paths[2]).measurements()} == {5.0}
    assert ",0,57," not in paths[1].read_text().splitlines()[1]
    assert paths[1].read_text().splitlines()[1].split(",")[13] == "57"  # 0.1 rad of roll


def test_repetitions_have_their_run_in_the_name(tmp_path: Path) -> None:
    paths = write(recording(repetitions=2), tmp_path)
    assert paths[0].name == "gnss_run3.nmea"


def test_the_scenario_may_say_how_a_receiver_writes(tmp_path: Path) -> None:
    style = {"talker": "GL", "sentences": ["GGA"], "start_utc": "2026-12-31T23:59:59Z"}
    paths = write(recording(nmea={"gnss": style}), tmp_path)
    lines = paths[0].read_text().splitlines()[1:]
    assert {line[:6] for line in lines} == {"$GLGGA"}
    assert [line.split(",")[1] for line in lines[8:11]] == ["235959.90", "000000.00", "000000.10"]


@pytest.mark.parametrize("nmea", [{"ahrs": {}}, {"gnss": {"imu": "gnss"}}, {"nothing": {}}])
def test_a_style_of_what_is_no_receiver_is_refused(nmea: dict[str, object]) -> None:
    with pytest.raises(BadInputError, match=r"nmea\."):
        small_scenario_toml(sensors=RECEIVERS, nmea=nmea)


def test_files_of_ours_are_replaced_and_others_are_left_alone(tmp_path: Path) -> None:
    paths = write(recording(), tmp_path)
    first = [path.read_bytes() for path in paths]
    paths[1].write_bytes(first[1][:40])
    write(recording(), tmp_path)
    assert [path.read_bytes() for path in paths] == first
    paths[0].write_text("$GPGGA of somebody\n")
    with pytest.raises(BadInputError, match=r"gnss\.nmea: holds something that is not ours"):
        write(recording(), tmp_path)
    assert paths[0].read_text() == "$GPGGA of somebody\n"
    assert not list(tmp_path.rglob("*.partial*"))


def test_a_folder_or_a_link_in_the_way_is_left_alone(tmp_path: Path) -> None:
    target = tmp_path / "small" / "gnss.nmea"
    target.mkdir(parents=True)
    with pytest.raises(BadInputError, match="not ours"):
        write(recording(), tmp_path)
    target.rmdir()
    target.symlink_to(tmp_path / "nowhere")
    with pytest.raises(BadInputError, match="not ours"):
        write(recording(), tmp_path)


def test_a_name_with_a_path_in_it_is_refused(tmp_path: Path) -> None:
    found = recording()
    found.scenario_name = "../small"
    with pytest.raises(BadInputError, match="plain name"):
        write(found, tmp_path / "below")
    assert not list(tmp_path.iterdir())


def test_a_run_writes_what_it_measured(tmp_path: Path) -> None:
    write_scenario(tmp_path, duration_s=2.0)
    done = twin("run", "small.toml", "--no-rrd", "--nmea", "sent", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    log = open_log(tmp_path / "sent" / "small" / "gnss.nmea")
    measured = read_recording(tmp_path / "runs" / "small" / "seed1_run0").measurements("gnss")
    found = list(log.measurements())
    assert len(found) == len(measured) == 20
    # seven decimals of minutes are 0.2 mm, and the log's frame begins where the first sample was
    own = measured.select(("position_e_m", "position_n_m"))[:, 0]
    np.testing.assert_allclose(np.array([each.values[0, :2] for each in found]), own - own[0], atol=4e-4)


def test_a_file_in_the_way_is_bad_input(tmp_path: Path) -> None:
    write_scenario(tmp_path, duration_s=1.0)
    (tmp_path / "sent").write_text("a file")
    done = twin("run", "small.toml", "--no-rrd", "--nmea", "sent", cwd=tmp_path)
    assert done.returncode == EXIT_BAD_INPUT
    assert "sent: cannot be written" in done.stderr
    assert not (tmp_path / "runs" / "small").exists()
