"""AgOpenGPS's sentences: what the boards would have sent, and the traps in reading them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.formats.sentences import gga, write_log
from twin.formats.geodetic import Origin
from twin.formats.gnss_fixes import COLUMNS
from twin.formats.log_head import LOOKED_AT
from twin.formats.logs import open_log
from twin.formats.nmea import KNOT_M_S, framed
from twin.formats.nmea_log import AHRS_COLUMNS
from twin.formats.nmea_style import NmeaStyle
from twin.formats.panda_out import panda_sentences, paogi_sentences
from twin.sensors.ahrs import Ahrs
from twin.signals import HEADING, Measurement

ORIGIN = Origin()
STYLE = NmeaStyle()
RECEIVER = [0.0, 0.0, 3.0, 2.0, 0.0, 0.01, 0.01, 0.02, 4.0, 12.0, 0.7, 1.2, 1.0]


def receiver(t_ns: int = 0, *, heading: float | None = None) -> Measurement:
    columns = COLUMNS if heading is None else (*COLUMNS, HEADING)
    values = RECEIVER if heading is None else [*RECEIVER, heading]
    return Measurement(
        sensor="gnss",
        t_ns=t_ns,
        t_available_ns=t_ns,
        columns=columns,
        values=np.array([values]),
        valid=np.array([True]),
    )


def attitude(
    roll_deg: float, pitch_deg: float, compass: float, *, t_ns: int = 0, late_ns: int = 0, valid: bool = True
) -> Measurement:
    """Roll right side down, pitch nose up, heading of the compass."""
    values = [math.radians(roll_deg), -math.radians(pitch_deg), math.radians(90.0 - compass), 0.0, 0.0, 0.0]
    return Measurement(
        sensor="ahrs",
        t_ns=t_ns,
        t_available_ns=t_ns + late_ns,
        columns=AHRS_COLUMNS,
        values=np.array([values]),
        valid=np.array([valid]),
    )


def imu_of(line: str) -> list[str]:
    return line[: line.index("*")].split(",")[12:]


def panda(*said: Measurement, at_ns: int = 0) -> list[str]:
    (line,) = panda_sentences([receiver(at_ns)], said, STYLE, ORIGIN)
    return imu_of(line)


def panda_body(*imu: str, time: str = "120000.00", kind: str = "PANDA", knots: str = "3.888") -> str:
    return f"{kind},{time},4404.13,N,12118.87,W,4,12,0.7,100.0,1.0,{knots},{','.join(imu)}"


def test_columns_are_those_of_a_simulated_reference() -> None:
    assert Ahrs.columns == AHRS_COLUMNS


# --- out -------------------------------------------------------------------------------------------------------------


def test_a_sentence_has_its_sixteen_fields_and_speed_in_knots() -> None:
    (line,) = panda_sentences([receiver(250_000_000)], [attitude(1.0, 2.0, 45.0)], STYLE, ORIGIN)
    fields = line[: line.index("*")].split(",")
    assert fields[:12] == [
        "$PANDA", "080000.25", "3000.0000000", "N", "12000.0000000", "E", "4", "12", "0.70", "3.000", "1.0", "3.888",
    ]  # fmt: skip
    assert len(fields) == 16


def test_angles_are_whole_tenths_with_their_sign() -> None:
    assert panda(attitude(-0.5, 3.26, 123.44)) == ["1234", "-5", "33", "0"]


def test_without_an_imu_the_heading_is_the_sentinel_and_the_rest_zero() -> None:
    assert panda() == ["65535", "0", "0", "0"]
    assert panda(attitude(1.0, 1.0, 10.0, valid=False)) == ["65535", "0", "0", "0"]
    assert panda(attitude(1.0, 1.0, 10.0, late_ns=1), at_ns=0) == ["65535", "0", "0", "0"]


@pytest.mark.parametrize(
    ("compass", "tenths"), [(0.0, "0"), (359.94, "3599"), (359.96, "0"), (360.0, "0"), (0.05, "0")]
)
def test_the_heading_wraps_at_the_circle(compass: float, tenths: str) -> None:
    assert panda(attitude(0.0, 0.0, compass))[0] == tenths


def test_the_yaw_rate_is_clockwise_and_does_not_jump_at_north() -> None:
    said = [attitude(0.0, 0.0, 359.5, t_ns=0), attitude(0.0, 0.0, 0.5, t_ns=100_000_000)]
    assert panda(*said, at_ns=100_000_000) == ["5", "0", "0", "100"]  # a degree in 0.1 s, in tenths per second


def test_the_latest_that_has_arrived_counts() -> None:
    said = [attitude(0.0, 0.0, 10.0), attitude(0.0, 0.0, 10.0, t_ns=500), attitude(0.0, 0.0, 90.0, t_ns=1500)]
    assert panda(*said, at_ns=1000)[0] == "100"


def test_two_antennas_have_degrees_with_decimals_and_their_own_heading() -> None:
    (line,) = paogi_sentences([receiver(heading=math.pi)], [attitude(-0.567, 1.0, 30.0)], STYLE, ORIGIN)
    assert imu_of(line) == ["270.00", "-0.57", "1.00", "0.00"]
    (line,) = paogi_sentences([receiver(heading=math.nan)], [], STYLE, ORIGIN)
    assert imu_of(line) == ["", "0.00", "0.00", "0.00"]


# --- in --------------------------------------------------------------------------------------------------------------


def test_tenths_are_read_as_tenths_and_degrees_as_degrees(tmp_path: Path) -> None:
    for imu, kind in ((("2700", "-15", "20", "-30"), "PANDA"), (("270.0", "-1.5", "2.0", "-3.0"), "PAOGI")):
        log = open_log(write_log(tmp_path, panda_body(*imu, kind=kind)))
        assert list(log.sensors) == ["gnss", "ahrs", "yaw_gyro"]
        gnss, ahrs, gyro = log.measurements()
        np.testing.assert_allclose(
            ahrs.values[0], [-math.radians(1.5), -math.radians(2.0), math.pi, *[math.nan] * 3], atol=1e-12
        )
        assert gyro.column("yaw_rate_rad_s")[0] == pytest.approx(math.radians(3.0))
        assert gnss.column("speed_m_s")[0] == pytest.approx(2.0, abs=5e-4)
        assert np.isnan(gnss.column("course_rad")[0])
        assert gnss.column("quality")[0] == 4.0
        assert not log.problems


def test_the_sentinel_is_no_heading(tmp_path: Path) -> None:
    log = open_log(write_log(tmp_path, panda_body("65535", "0", "0", "0")))
    assert list(log.sensors) == ["gnss"]
    assert len(list(log.measurements())) == 1
    assert not log.problems


def board_log(folder: Path, silent: int, speaking: int) -> Path:
    """A board at 1 Hz whose IMU is silent at first."""
    path = folder / "board.log"
    with path.open("w") as file:
        for second in range(silent + speaking):
            clock = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}.00"
            imu = "65535,0,0,0" if second < silent else "900,10,10,0"
            file.write(framed(f"PANDA,{clock},4404.13,N,12118.87,W,4,12,0.7,100.0,1.0,3.888,{imu}"))
    return path


def test_an_imu_that_speaks_after_a_minute_is_heard(tmp_path: Path) -> None:
    log = open_log(board_log(tmp_path, 60, 30))
    assert sum(each.sensor == "ahrs" for each in log.measurements()) == 30
    assert not log.problems
    assert log.sensors["yaw_gyro"].rate_hz == 1.0


def test_an_imu_that_speaks_later_than_one_looks_is_counted(tmp_path: Path) -> None:
    log = open_log(board_log(tmp_path, LOOKED_AT, 7))
    assert {each.sensor for each in log.measurements()} == set(log.sensors) == {"gnss"}
    assert log.problems == {"attitude not announced": 7}


@pytest.mark.parametrize("imu", [("90.5", "0", "0", "0"), ("1e3", "0", "0", "0"), ("900", "1.5", "0", "0")])
def test_decimals_in_tenths_are_an_error(imu: tuple[str, ...], tmp_path: Path) -> None:
    log = open_log(write_log(tmp_path, gga("120000.00"), panda_body(*imu, time="120001.00")))
    assert len(list(log.measurements())) == 1
    assert log.problems == {"not a number": 1}


@pytest.mark.parametrize("imu", [("3601", "0", "0", "0"), ("65534", "0", "0", "0"), ("900", "40000", "0", "0")])
def test_angles_beyond_the_circle_are_an_error(imu: tuple[str, ...], tmp_path: Path) -> None:
    log = open_log(write_log(tmp_path, gga("120000.00"), panda_body(*imu, time="120001.00")))
    assert len(list(log.measurements())) == 1
    assert log.problems == {"out of range": 1}


@given(
    roll=st.floats(-80.0, 80.0),
    pitch=st.floats(-80.0, 80.0),
    compass=st.floats(0.0, 360.0, exclude_max=True),
    two_antennas=st.booleans(),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_sent_reads_back_to_its_digits(
    roll: float, pitch: float, compass: float, two_antennas: bool, tmp_path: Path
) -> None:
    said = attitude(roll, pitch, compass)
    heading = float(said.column(HEADING)[0])
    if two_antennas:
        lines = paogi_sentences([receiver(heading=heading)], [said], STYLE, ORIGIN)
    else:
        lines = panda_sentences([receiver()], [said], STYLE, ORIGIN)
    path = tmp_path / "log.panda"
    path.write_text("".join(lines), newline="")
    gnss, ahrs, _ = open_log(path, origin=ORIGIN).measurements()
    half_digit = math.radians(0.005 if two_antennas else 0.05) + 1e-12
    for column, value in (("roll_rad", said.values[0, 0]), ("pitch_rad", said.values[0, 1]), (HEADING, heading)):
        assert abs(math.remainder(ahrs.column(column)[0] - value, 2.0 * math.pi)) <= half_digit
    # heights are above the sea, and nobody says where that is
    assert gnss.column("position_u_m")[0] == pytest.approx(3.0 - ORIGIN.geoid_height_m, abs=1e-3)
    assert gnss.column("speed_m_s")[0] == pytest.approx(2.0, abs=0.5e-3 * KNOT_M_S)
