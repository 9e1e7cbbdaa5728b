"""Solutions of RTKLIB: times, positions in three ways, qualities, and lines that cannot be used."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pymap3d
import pytest

from twin.errors import BadInputError
from twin.formats.geodetic import Origin
from twin.formats.gps_time import leap_seconds
from twin.formats.logs import open_log
from twin.formats.rtklib_pos import QUALITIES, RtklibLog

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "f9p_ppk_rtklib"
DEGREES = (
    "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)"
    "  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio"
)
SEXAGESIMAL = DEGREES.replace("(deg)", "(d'\")")
ECEF = "%  GPST  x-ecef(m)  y-ecef(m)  z-ecef(m)  Q  ns  sdx(m)  sdy(m)  sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s)  ratio"
REST = "1  11  0.01  0.02  0.03  0.0  0.0  0.0  1.5  3.0"
WHEN = "2137 422922.000"


def write(folder: Path, *lines: str) -> Path:
    path = folder / "log.pos"
    path.write_text("\n".join(("% program   : RTKPOST", *lines)) + "\n")
    return path


def row(second: int, *, q: int = 1, place: str = "40.5 -105.25 1500.0") -> str:
    return f"2137 {422922 + second}.000 {place} {q}  11  0.01  0.02  0.03  0.0  0.0  0.0  1.5  3.0"


@pytest.mark.parametrize(("name", "fixed", "float_"), [("demo5_b34f_f", 4449, 72), ("py_0315f", 1649, 2872)])
def test_a_real_drive_has_its_epochs_and_qualities(name: str, fixed: int, float_: int) -> None:
    path = FOLDER / f"{name}.pos"
    if not path.is_file():
        pytest.skip(f"the solution {path} is not here")
    log = open_log(path)
    found = list(log.measurements())
    assert isinstance(log, RtklibLog)
    assert not log.problems
    values = np.array([each.values[0] for each in found])
    assert (values[:, 8] == 4.0).sum() == fixed
    assert (values[:, 8] == 5.0).sum() == float_
    assert np.datetime64(log.start_utc_ns or 0, "ns") == np.datetime64("2020-12-24T21:28:24")  # 18 s behind GPS time
    rows = np.loadtxt(path, comments="%", usecols=range(2, 15))
    clocks = [line.split()[1] for line in path.read_text().splitlines() if not line.startswith("%")]
    told_s = [
        sum(float(part) * unit for part, unit in zip(clock.split(":")[::-1], (1, 60, 3600), strict=False))
        for clock in clocks
    ]
    milliseconds = np.round((np.array(told_s) - told_s[0]) * 1e3).astype(int)
    assert [each.t_ns for each in found] == (milliseconds * 10**6).tolist()
    place = log.origin.geodetic(values[:, :3])
    np.testing.assert_allclose(place[:, :2], rows[:, :2], atol=1e-9)
    np.testing.assert_allclose(place[:, 2], rows[:, 2], atol=1e-4)
    np.testing.assert_array_equal(values[:, [6, 5, 7]], rows[:, 5:8])
    np.testing.assert_array_equal(values[:, 12], np.abs(rows[:, 11]))


def test_the_two_solutions_of_a_drive_lie_side_by_side_in_one_frame() -> None:
    paths = [FOLDER / "demo5_b34f_f.pos", FOLDER / "py_0315f.pos"]
    if not all(path.is_file() for path in paths):
        pytest.skip(f"the solutions are not in {FOLDER}")
    first = open_log(paths[0])
    second = open_log(paths[1], origin=first.origin)
    assert first.start_utc_ns == second.start_utc_ns
    apart = np.array(
        [a.values[0, :2] - b.values[0, :2] for a, b in zip(first.measurements(), second.measurements(), strict=True)]
    )
    # float errors of some decimetres, nowhere near what a wrong time (18 s at 10 m/s) or frame would give
    assert np.median(np.hypot(*apart.T)) < 1.0


@pytest.mark.parametrize(
    ("header", "place"),
    [
        (DEGREES, "40.5 -105.25 1500.0"),
        (SEXAGESIMAL, "40 30 0.0 -105 15 0.0 1500.0"),
        (ECEF, " ".join(f"{value:.4f}" for value in pymap3d.geodetic2ecef(40.5, -105.25, 1500.0))),
        (DEGREES.replace(" latitude", ",latitude").replace(" longitude", ",longitude"), "40.5,-105.25,1500.0"),
    ],
)
def test_positions_are_told_in_three_ways(header: str, place: str, tmp_path: Path) -> None:
    log = open_log(write(tmp_path, header, f"{WHEN} {place} {REST}"))
    (found,) = log.measurements()
    assert log.origin.latitude_deg == pytest.approx(40.5, abs=1e-8)
    assert log.origin.longitude_deg == pytest.approx(-105.25, abs=1e-8)
    assert log.origin.height_m == pytest.approx(1500.0, abs=1e-3)
    expected = [0.0, 0.0, 0.0, math.nan, math.nan, 0.02, 0.01, 0.03, 4.0, 11.0, math.nan, math.nan, 1.5]
    if header is ECEF:  # its sigmas are of other axes
        expected[5:8] = [math.nan] * 3
    np.testing.assert_allclose(found.values[0], expected, atol=1e-9)


def test_a_log_far_from_the_origin_told_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, DEGREES, f"{WHEN} 40.5 -105.25 1500.0 {REST}")
    near = Origin(latitude_deg=41.3, longitude_deg=-105.25)
    (found,) = open_log(path, origin=near).measurements()
    assert found.values[0, 1] == pytest.approx(-88_850.0, abs=50.0)
    far = Origin(latitude_deg=41.5, longitude_deg=-105.25)
    with pytest.raises(
        BadInputError, match=r"begins at 40.5000,-105.2500, 111 km from the origin 41.5,-105.25; a level"
    ):
        open_log(path, origin=far)


def test_south_and_west_of_zero_degrees_keep_their_sign(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, SEXAGESIMAL, f"{WHEN} -0 30 0.0 -0 15 36.0 10.0 {REST}"))
    assert (log.origin.latitude_deg, log.origin.longitude_deg) == (-0.5, pytest.approx(-0.26))


@pytest.mark.parametrize(
    ("system", "when", "utc"),
    [
        ("GPST", "2020/12/24 21:28:42.250", "2020-12-24T21:28:24.250"),
        ("UTC", "2020/12/24 21:28:42.250", "2020-12-24T21:28:42.250"),
        ("JST", "2020/12/24 21:28:42.250", "2020-12-24T12:28:42.250"),
        ("GPST", "2137 422922.250", "2020-12-24T21:28:24.250"),
        ("GPST", "2012/07/01 00:00:15.000", "2012-07-01T00:00:00"),  # the leap second
        ("GPST", "2012/07/01 00:00:16.000", "2012-07-01T00:00:00"),
        ("GPST", "1980/01/06 00:00:00.000", "1980-01-06T00:00:00"),
    ],
)
def test_time_is_brought_to_utc(system: str, when: str, utc: str, tmp_path: Path) -> None:
    log = open_log(write(tmp_path, DEGREES.replace("GPST", system), f"{when} 40.5 -105.25 1500.0 {REST}"))
    assert np.datetime64(log.start_utc_ns or 0, "ns") == np.datetime64(utc)


def test_leap_seconds_are_eighteen_since_2017() -> None:
    assert [leap_seconds(day) for day in (0.0, 1_483_228_816.0, 1_483_228_818.0, 1.9e9)] == [0, 17, 18, 18]


def test_qualities_become_those_of_nmea(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, DEGREES, *(row(q, q=q) for q in range(8))))
    found = list(log.measurements())
    assert [each.column("quality")[0] for each in found] == [0.0, 4.0, 5.0, 2.0, 2.0, 1.0, 3.0, 6.0]
    assert set(QUALITIES) == set(range(8))
    assert np.isnan(found[0].column("position_e_m")[0])


def test_velocities_give_speed_and_course(tmp_path: Path) -> None:
    header = f"{DEGREES} vn(m/s) ve(m/s) vu(m/s) sdvn sdve sdvu sdvne sdveu sdvun"
    (found,) = open_log(write(tmp_path, header, row(0) + " 3.0 4.0 0.1 0 0 0 0 0 0")).measurements()
    assert found.column("speed_m_s")[0] == pytest.approx(5.0)
    assert found.column("course_rad")[0] == pytest.approx(math.atan2(3.0, 4.0))


@pytest.mark.parametrize(
    ("bad", "kind"),
    [
        ("2137 422923.000 40.5", "missing fields"),
        ("2137 422923.000 forty -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "not a number"),
        ("2137 422923.000 nan -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "out of range"),
        ("2137 422923.000 95.0 -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "out of range"),
        ("2137 422923.000 40.5 -105.25 1e300 1 11 0 0 0 0 0 0 0 0", "out of range"),
        ("2137 422923.000 40.5 -105.25 1500.0 9 11 0 0 0 0 0 0 0 0", "out of range"),
        ("2137 422923.000 40.5 -105.25 1500.0 1 11 -1 0 0 0 0 0 0 0", "out of range"),
        ("week 422923.000 40.5 -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "not a number"),
        ("99999999999999 422923.000 40.5 -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "out of range"),
        ("2020/13/24 21:28:42.0 40.5 -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "out of range"),
        ("1979/12/24 21:28:42.0 40.5 -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "out of range"),
        ("2080/12/24 21:28:42.0 40.5 -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "out of range"),
        ("2020/12/24 21:2_8:42.0 40.5 -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "not a number"),
        ("2020/12/24 21:28:99.0 40.5 -105.25 1500.0 1 11 0 0 0 0 0 0 0 0", "out of range"),
        ("1" * 9000, "too long"),
    ],
)
def test_a_bad_line_is_counted_by_kind_and_the_good_ones_around_it_are_kept(
    bad: str, kind: str, tmp_path: Path
) -> None:
    log = open_log(write(tmp_path, DEGREES, row(0), bad, row(2)))
    assert [each.t_ns for each in log.measurements()] == [0, 2 * 10**9]
    assert log.problems == {kind: 1}


@pytest.mark.parametrize("word", ["nan", "-nan(ind)", "1.#IND", "inf", "****"])
def test_columns_of_which_no_use_is_made_may_hold_anything(word: str, tmp_path: Path) -> None:
    words = row(1).split()
    # covariances and the ratio
    log = open_log(write(tmp_path, DEGREES, row(0), " ".join([*words[:10], *[word] * 3, words[13], word]), row(2)))
    found = list(log.measurements())
    assert [each.t_ns for each in found] == [0, 10**9, 2 * 10**9]
    np.testing.assert_array_equal(found[1].values, found[0].values)
    assert not log.problems


@pytest.mark.parametrize(("heights", "told"), [("WGS84/ellipsoidal", 0), ("WGS84/geodetic", 1), ("Tokyo/geodetic", 1)])
def test_heights_above_a_geoid_that_nobody_tells_are_said_to_be(heights: str, told: int, tmp_path: Path) -> None:
    header = f"% (lat/lon/height={heights},Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)"
    log = open_log(write(tmp_path, "% inp file  : C:\\wgs84/geodetic\\rover.obs", header, DEGREES, row(0), row(1)))
    assert len(list(log.measurements())) == 2
    assert log.origin.height_m == 1500.0
    assert log.problems == ({"heights above an unknown geoid": told} if told else {})


def test_lines_before_the_header_cannot_be_read(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, row(0), DEGREES, row(1)))
    assert len(list(log.measurements())) == 1
    assert log.problems == {"no header": 1}


@pytest.mark.parametrize(
    "lines", [(DEGREES,), (DEGREES, row(0, q=0)), (DEGREES.replace("latitude(deg)", "e-baseline(m)"), row(0))]
)
def test_a_solution_with_nothing_usable_is_refused(lines: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"log\.pos: no epoch has a position"):
        open_log(write(tmp_path, *lines))
