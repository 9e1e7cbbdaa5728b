"""What a simulated receiver would have sent, and that it reads back as what it measured, to its digits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from pynmeagps import NMEAReader
from pynmeagps.nmeahelpers import calc_checksum

from tests.sensors.motions import circle, drive, preset, sensor
from twin.formats.geodetic import Origin
from twin.formats.gnss_fixes import COLUMNS
from twin.formats.logs import open_log
from twin.formats.nmea import KNOT_M_S
from twin.formats.nmea_out import nmea_sentences
from twin.formats.nmea_style import NmeaStyle, usual_style
from twin.signals import FloatArray, Measurement

ORIGIN = Origin(latitude_deg=52.0, longitude_deg=-0.0005, height_m=80.0, geoid_height_m=45.4)
"""Its field lies on both sides of the meridian of Greenwich."""
USUAL = {
    "position_e_m": 12.345,
    "position_n_m": -6.789,
    "position_u_m": 1.234,
    "speed_m_s": 2.0,
    "course_rad": 0.3,
    "sigma_e_m": 0.012,
    "sigma_n_m": 0.014,
    "sigma_u_m": 0.026,
    "quality": 4.0,
    "satellites": 17.0,
    "hdop": 0.71,
    "vdop": 1.22,
    "age_s": 1.2,
}
LOST: dict[str, float] = dict.fromkeys(COLUMNS, math.nan) | {"quality": 0.0, "satellites": 3.0}


def measurement(t_ns: int = 0, *, valid: bool = True, **changes: float) -> Measurement:
    values = USUAL | changes
    return Measurement(
        sensor="gnss",
        t_ns=t_ns,
        t_available_ns=t_ns + 80_000_000,
        columns=COLUMNS,
        values=np.array([[values[column] for column in COLUMNS]]),
        valid=np.array([valid]),
    )


def style(**changes: Any) -> NmeaStyle:
    return NmeaStyle.model_validate(changes)


def sent(measurements: list[Measurement], **changes: Any) -> list[str]:
    return list(nmea_sentences(measurements, style(**changes), ORIGIN))


def bounds(how: NmeaStyle, distance_m: float) -> dict[str, float]:
    """Half a digit of each column; the plane is tilted against the ellipsoid, the more the farther from the origin."""
    minute, height = 0.5 * 10.0**-how.minute_decimals, 0.5 * 10.0**-how.height_decimals
    along = minute * 1862.0  # a minute of latitude is longest at the poles, 1861.6 m
    up = 2.0 * height  # of the height above the sea and of the sea's
    tilt = 1.5 * distance_m / 6.36e6
    return {
        "position_e_m": along * 1.002 + up * tilt + 1e-5,
        "position_n_m": along * 1.002 + up * tilt + 1e-5,
        "position_u_m": up + along * tilt + 1e-5,
        "speed_m_s": 0.5 * 10.0**-how.speed_decimals * KNOT_M_S + 1e-9,
        "course_rad": math.radians(0.5 * 10.0**-how.course_decimals) + 1e-9,
        **{f"sigma_{axis}_m": 0.5 * 10.0**-how.sigma_decimals + 1e-9 for axis in "enu"},
        "quality": 0.0,
        "satellites": 0.0,
        "hdop": 0.5 * 10.0**-how.dop_decimals + 1e-9,
        "vdop": 0.5 * 10.0**-how.dop_decimals + 1e-9,
        "age_s": 0.5 * 10.0**-how.age_decimals + 1e-9,
    }


def assert_same(found: FloatArray, given_values: FloatArray, how: NmeaStyle) -> None:
    np.testing.assert_array_equal(np.isnan(found), np.isnan(given_values))
    distance_m = float(np.nanmax(np.hypot(given_values[:, 0], given_values[:, 1])))
    for index, (column, bound) in enumerate(bounds(how, distance_m).items()):
        difference = found[:, index] - given_values[:, index]
        if column == "course_rad":
            difference = np.remainder(difference + np.pi, 2.0 * np.pi) - np.pi
        assert np.nanmax(np.abs(difference), initial=0.0) <= bound, column


def read_back(measurements: list[Measurement], how: NmeaStyle, folder: Path) -> list[Measurement]:
    path = folder / "log.nmea"
    path.write_text("".join(nmea_sentences(measurements, how, ORIGIN)), newline="")
    log = open_log(path, origin=ORIGIN)
    found = list(log.measurements())
    assert not log.problems
    assert log.start_utc_ns == how.start_utc_ns + measurements[0].t_ns
    return found


# --- round trips -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rtk_f9p", "single_point", "lea_5s", "rtk_navcom_sf3050"])
def test_a_simulated_receiver_reads_back_as_it_measured_to_its_digits(name: str, tmp_path: Path) -> None:
    values = preset(name)
    values["faults"] = [{"kind": "satellites_masked", "satellites": 2, "from_s": 70.0, "to_s": 75.0}]
    if name.startswith("rtk"):
        values["faults"].append({"kind": "corrections_lost", "from_s": 5.0, "to_s": 68.0})
    drawn = drive(sensor(values), circle(2.0, 10.0), 90.0)
    measurements = sorted(
        (each for sample in drawn.samples for each in sample.measurements), key=lambda each: each.t_available_ns
    )
    qualities = [state["quality"] for state in values["states"].values()]
    usual = usual_style(resolution_m=values.get("position_resolution_m", 0.0), qualities=qualities)
    how = usual.model_copy(update={"start_utc": "2026-12-31T23:59:30Z", "time_decimals": 3})
    found = read_back(measurements, how, tmp_path)
    assert [each.t_ns for each in found] == [each.t_ns - measurements[0].t_ns for each in measurements]
    first = len(COLUMNS) - 8
    picked = [*range(5), *range(len(measurements[0].columns) - 8, len(measurements[0].columns))]
    given_values = np.array([each.values[0, picked] for each in measurements])
    assert {0.0} < set(given_values[:, first + 3])
    assert_same(np.array([each.values[0] for each in found]), given_values, how)


@pytest.mark.parametrize(
    ("resolution_m", "decimals"),
    [(0.0185, 5), (0.01852, 5), (0.1, 5), (0.186, 4), (0.01, 6), (0.001, 7), (1.852, 3), (30.0, 2), (0.0, 7)],
)
def test_the_fewest_decimals_that_show_the_resolution(resolution_m: float, decimals: int) -> None:
    # the last digit of a minute is 1852 m over a power of ten: no coarser than the output, but for rounded figures
    style = usual_style(resolution_m=resolution_m, qualities=[1])
    assert style.minute_decimals == decimals


@given(
    values=st.fixed_dictionaries(
        {
            "position_e_m": st.floats(-5e3, 5e3),
            "position_n_m": st.floats(-5e3, 5e3),
            "position_u_m": st.floats(-50.0, 50.0),
            "speed_m_s": st.floats(0.0, 15.0),
            "course_rad": st.floats(-math.pi, math.pi),
            "quality": st.integers(1, 8).map(float),
        }
    ),
    minute_decimals=st.integers(2, 8),
    digits=st.integers(0, 6),
    t_ns=st.integers(0, 40_000).map(lambda hundredths: hundredths * 10_000_000),
)
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_sample_reads_back_to_its_digits(
    values: dict[str, float], minute_decimals: int, digits: int, t_ns: int, tmp_path: Path
) -> None:
    how = style(
        minute_decimals=minute_decimals,
        speed_decimals=digits,
        course_decimals=digits,
        height_decimals=max(digits, 1),
        sentences=["GGA", "RMC", "VTG", "GST", "GSA"],
        start_utc="2028-02-28T23:59:00Z",
    )
    one = measurement(t_ns, **values)
    (found,) = read_back([one], how, tmp_path)
    assert_same(found.values, one.values, how)


# --- single sentences ------------------------------------------------------------------------------------------------


def sums_are_right(lines: list[str]) -> list[str]:
    """Bodies of sentences whose frame is right."""
    for line in lines:
        body, told = line.removeprefix("$").removesuffix("\r\n").split("*")
        assert line == f"${body}*{told}\r\n"
        assert told == calc_checksum(body)
    return [line[1:-5] for line in lines]


def test_sentences_are_those_of_a_receiver() -> None:
    here = measurement(1_500_000_000, position_e_m=0.0, position_n_m=0.0)
    assert sums_are_right(sent([here])) == [
        "GNRMC,080001.50,A,5200.0000000,N,00000.0300000,W,3.888,72.81,010426,,,R",
        "GNVTG,72.81,T,,M,3.888,N,7.200,K,R",
        "GNGGA,080001.50,5200.0000000,N,00000.0300000,W,4,17,0.71,35.834,M,45.400,M,1.2,0000",
        "GNGSA,A,3,,,,,,,,,,,,,1.41,0.71,1.22",
        "GNGST,080001.50,,,,,0.014,0.012,0.026",
    ]


def test_pynmeagps_reads_in_them_what_was_measured() -> None:
    parsed = {
        m.msgID: m
        for m in (
            NMEAReader.parse(line.encode())
            for line in sent(
                [
                    measurement(),
                ]
            )
        )
    }
    place = ORIGIN.geodetic(np.array([12.345, -6.789, 1.234]))
    for kind in ("GGA", "RMC"):
        np.testing.assert_allclose([parsed[kind].lat, parsed[kind].lon], place[:2], atol=1e-9)
    assert parsed["GGA"].alt + parsed["GGA"].sep == pytest.approx(place[2], abs=1e-3)
    assert (parsed["GGA"].quality, parsed["GGA"].numSV, parsed["GGA"].diffAge) == (4, 17, 1.2)
    assert parsed["RMC"].spd == parsed["VTG"].sogn == pytest.approx(2.0 / KNOT_M_S, abs=5e-4)
    assert parsed["VTG"].sogk == pytest.approx(7.2, abs=5e-4)
    assert parsed["VTG"].cogt == pytest.approx(90.0 - math.degrees(0.3), abs=5e-3)
    assert (parsed["GST"].stdLat, parsed["GST"].stdLong, parsed["GST"].stdAlt) == (0.014, 0.012, 0.026)
    assert (parsed["GSA"].navMode, parsed["GSA"].VDOP) == (3, 1.22)
    assert str(parsed["RMC"].date) == "2026-04-01"


def test_without_a_position_fields_are_empty() -> None:
    lines = sent([measurement(**LOST)], talker="GP", sentences=["GGA", "RMC", "VTG", "GSA", "GST"])
    assert sums_are_right(lines) == [
        "GPGGA,080000.00,,,,,0,03,99.99,,,,,,",
        "GPRMC,080000.00,V,,,,,,,010426,,,N",
        "GPVTG,,T,,M,,N,,K,N",
        "GPGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99",
        "GPGST,080000.00,,,,,,,",
    ]


def test_a_lost_sample_leaves_nothing() -> None:
    assert sent([measurement(valid=False)]) == []


def test_only_the_run_that_is_asked_for_is_written() -> None:
    one = measurement()
    both = Measurement(
        sensor="gnss",
        t_ns=0,
        t_available_ns=0,
        columns=COLUMNS,
        values=np.concatenate([one.values, measurement(quality=5.0).values]),
        valid=np.array([False, True]),
    )
    assert list(nmea_sentences([both], style(), ORIGIN, run=1)) == sent([measurement(quality=5.0)])
    assert list(nmea_sentences([both], style(), ORIGIN, run=0)) == []


@pytest.mark.parametrize(
    ("quality", "modes", "old"),
    [(0, "N", "N"), (1, "A", "A"), (2, "D", "D"), (4, "R", "D"), (5, "F", "D"), (6, "E", "E")],
)
def test_modes_follow_the_quality_and_old_receivers_do_not_know_rtk(quality: int, modes: str, old: str) -> None:
    changes = LOST if quality == 0 else {"quality": float(quality)}
    for rtk_modes, letter in ((True, modes), (False, old)):
        rmc, vtg = sent([measurement(**changes)], sentences=["RMC", "VTG"], rtk_modes=rtk_modes)
        assert rmc[-6] == vtg[-6] == letter


def test_what_rounds_up_carries_over() -> None:
    up_to_the_next = ORIGIN.enu(np.array([52.99999999999, 0.99999999999, 80.0]))
    values = dict(zip(("position_e_m", "position_n_m", "position_u_m"), up_to_the_next.tolist(), strict=True))
    (rmc,) = sent(
        [measurement(59_999_999_999, course_rad=math.radians(90.001), **values)],
        sentences=["RMC"],
        minute_decimals=4,
        start_utc="2026-12-31T23:59:00Z",
    )
    assert rmc.split(",")[1:10] == ["000000.00", "A", "5300.0000", "N", "00100.0000", "E", "3.888", "0.00", "010127"]


def test_digits_are_the_styles() -> None:
    (gga,) = sent(
        [measurement(satellites=17.0)],
        sentences=["GGA"],
        minute_decimals=4,
        time_decimals=0,
        height_decimals=1,
        dop_decimals=1,
        age_decimals=0,
        most_satellites=12,
        station=138,
    )
    assert gga.startswith("$GNGGA,080000,5159.9963,N,00000.0192,W,4,12,0.7,35.8,M,45.4,M,1,0138*")


def test_the_course_at_standstill_is_the_receivers_own_garbage() -> None:
    device = sensor({**preset("rtk_f9p"), "state": "fix"})
    standing = drive(device, circle(1e-9, 10.0), 20.0)
    measurements = [each for sample in standing.samples for each in sample.measurements]
    courses = [float(line.split(",")[1]) for line in sent(measurements, sentences=["VTG"])]
    # a random direction each time: in all four quadrants, but with odds of 4 (3/4)^200
    assert {int(course // 90.0) for course in courses} == {0, 1, 2, 3}


# --- styles ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("resolution_m", "decimals"), [(0.0, 7), (0.0185, 5), (0.185, 4), (1.85, 3), (100.0, 2), (1e-9, 8)]
)
def test_a_receiver_prints_as_many_decimals_as_its_position_has(resolution_m: float, decimals: int) -> None:
    assert usual_style(resolution_m=resolution_m, qualities=[4, 1]).minute_decimals == decimals


def test_a_simple_receiver_is_told_from_one_with_rtk() -> None:
    simple, rtk = usual_style(resolution_m=0.0, qualities=[1]), usual_style(resolution_m=0.0, qualities=[5, 1])
    assert (simple.talker, simple.height_decimals, simple.sigma_decimals) == ("GP", 1, 1)
    assert (rtk.talker, rtk.height_decimals, rtk.sigma_decimals) == ("GN", 3, 3)


@pytest.mark.parametrize(
    "bad",
    [
        {"start_utc": "2026-04-01T08:00:00"},
        {"start_utc": "2026-04-01T08:00:00+02:00"},
        {"start_utc": "1970-01-01T00:00:00Z"},
        {"start_utc": "yesterday"},
        {"talker": "gp"},
        {"talker": "GP\n"},
        {"sentences": []},
        {"sentences": ["XXX"]},
        {"minute_decimals": 9},
    ],
)
def test_a_style_that_no_receiver_has_is_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        NmeaStyle.model_validate(bad)
