"""CSV files read by a mapping: the real ones, units and words, bad rows, and mappings that cannot be."""

from __future__ import annotations

import csv
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from tests.sensors.motions import preset, sensor
from twin.errors import BadInputError
from twin.formats.csv_log import CsvLog
from twin.formats.csv_mapping import COLUMNS, MAPPINGS, read_mapping
from twin.formats.geodetic import Origin
from twin.formats.logs import open_log
from twin.signals import Measurement

DATA = Path(__file__).parents[3] / "shared" / "data"
HUSKY = DATA / "husky_jackal_bags"
COMBINE = DATA / "combine_gartner_agridat" / "gartner.corn.csv"
GNSS: dict[str, Any] = {
    "kind": "gnss",
    "time": {"column": "t", "since": "start"},
    "columns": {"latitude_deg": {"column": "lat"}, "longitude_deg": {"column": "lon"}},
}
GYRO: dict[str, Any] = {
    "kind": "yaw_gyro",
    "time": {"column": "t", "since": "start"},
    "columns": {"yaw_rate_rad_s": {"column": "w"}},
}
DATED = {"column": "t"}


def gnss(**changes: Any) -> dict[str, Any]:
    columns = GNSS["columns"] | changes.pop("columns", {})
    return GNSS | changes | {"columns": columns}


def mapping(folder: Path, *tables: dict[str, Any]) -> Path:
    path = folder / "mapping.toml"
    path.write_text(tomli_w.dumps({"tables": list(tables)}))
    return path


def table(folder: Path, text: str, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def by_sensor(found: list[Measurement]) -> dict[str, list[Measurement]]:
    return {name: [each for each in found if each.sensor == name] for name in {each.sensor for each in found}}


# --- real files ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", ["folder", "file"])
def test_a_robots_receiver_wheels_and_imu_are_read_side_by_side(where: str) -> None:
    if not (HUSKY / "husky_imu.csv").is_file():
        pytest.skip(f"the files are not in {HUSKY}")
    log = open_log(HUSKY if where == "folder" else HUSKY / "husky_odom.csv", mapping=Path("husky"))
    found = list(log.measurements())
    assert not log.problems
    arrived = [each.t_available_ns for each in found]
    assert arrived == sorted(arrived)
    sensors = by_sensor(found)
    counts = {name: len(rows_of(HUSKY / f"husky_{file}.csv")) for name, file in
              (("gnss", "fix"), ("odometry", "odom"), ("imu", "imu"))}  # fmt: skip
    assert {name: len(each) for name, each in sensors.items()} == counts
    assert {name: round(info.rate_hz, 1) for name, info in log.sensors.items()} == {
        "gnss": 2.5,
        "odometry": 10.1,
        "imu": 30.0,
    }
    first = rows_of(HUSKY / "husky_imu.csv")[0]
    assert log.start_utc_ns == int(first["t"].replace(".", ""))
    np.testing.assert_array_equal(
        sensors["imu"][0].values[0],
        [-float(first["az"]), -float(first["ax"]), float(first["ay"]), -float(first["gz"]), -float(first["gx"]),
         float(first["gy"])],
    )  # fmt: skip
    assert sensors["gnss"][0].values[0, 5:9].tolist() == pytest.approx([0.9, 0.9, 1.8, 2.0])


def test_the_robots_imu_is_turned_the_right_way_up() -> None:
    if not (HUSKY / "husky_imu.csv").is_file():
        pytest.skip(f"the files are not in {HUSKY}")
    sensors = by_sensor(list(open_log(HUSKY, mapping=Path("husky")).measurements()))
    imu = np.array([[each.t, *each.values[0]] for each in sensors["imu"]])
    wheels = np.array([[each.t, *each.values[0]] for each in sensors["odometry"]])
    # it stands level but for the ground: gravity is on z
    np.testing.assert_allclose(imu[:, 1:4].mean(axis=0), [0.0, 0.0, 9.81], atol=0.35)
    speed, yaw_rate = (np.interp(imu[:, 0], wheels[:, 0], wheels[:, column]) for column in (1, 2))
    assert np.polyfit(yaw_rate, imu[:, 6], 1)[0] == pytest.approx(1.0, abs=0.1)
    # turning left at speed is an acceleration to the left
    assert np.polyfit(speed * yaw_rate, imu[:, 2], 1)[0] == pytest.approx(1.0, abs=0.3)


def test_a_combines_passes_are_read() -> None:
    if not COMBINE.is_file():
        pytest.skip(f"the file {COMBINE} is not here")
    log = open_log(COMBINE, mapping=Path("combine"))
    sensors = by_sensor(list(log.measurements()))
    rows = rows_of(COMBINE)
    assert {name: len(each) for name, each in sensors.items()} == {"gnss": len(rows), "odometry": len(rows)}
    assert not log.problems
    assert [each.t_ns // 10**9 for each in sensors["gnss"]] == [int(row["Time"]) - int(rows[0]["Time"]) for row in rows]
    speeds = np.array([each.column("speed_m_s")[0] for each in sensors["odometry"]])
    np.testing.assert_allclose(speeds, [float(row["Distance"]) * 0.0254 / float(row["Cycles"]) for row in rows])
    place = log.origin.geodetic(sensors["gnss"][-1].values[0, :3])
    np.testing.assert_allclose(place[:2], [float(rows[-1]["Latitude"]), float(rows[-1]["Longitude"])], atol=1e-9)
    assert place[2] == pytest.approx(float(rows[-1]["Altitude"]) * 0.3048, abs=1e-6)
    # what the shaft counted is what the receiver went
    positions = np.array([each.values[0, :2] for each in sensors["gnss"]])
    steps = np.hypot(*np.diff(positions, axis=0).T)
    distances = speeds[1:] * [float(row["Cycles"]) for row in rows[1:]]
    assert np.median(steps / np.maximum(distances, 0.1)) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("path", sorted(MAPPINGS.glob("*.toml")), ids=lambda path: path.stem)
def test_mappings_of_the_package_can_be_read(path: Path) -> None:
    assert read_mapping(Path(path.stem)) == read_mapping(path)


def test_columns_are_those_of_simulated_sensors() -> None:
    assert sensor(preset("imu_bno085")).columns == COLUMNS["imu"]


# --- units, words, time ----------------------------------------------------------------------------------------------


def test_units_words_and_constants(tmp_path: Path) -> None:
    columns = {
        "height_m": {"column": "h", "unit": "ft"},
        "speed_m_s": {"column": "v", "unit": "km/h"},
        "course_deg": {"column": "c", "unit": "rad"},
        "sigma_e_m": {"column": "var", "unit": "m2"},
        "quality": {"column": "fix", "values": {"rtk": 4, "2": 5, "none": 0}},
        "satellites": {"constant": 9.0},
        "age_s": {"column": "age", "unit": "ms"},
    }
    path = table(
        tmp_path,
        "t, lat ,lon,h,v,c,var,fix,age\n"
        "100.5,10,20,100,3.6,0,0.04,rtk,1500\n"
        '101.5,10,20,100,"7.2",0,,2.0,\n'
        "102.5,10,20,100,7.2,0,0.04,none,1500\n",
    )
    log = open_log(path, mapping=mapping(tmp_path, gnss(columns=columns)))
    first, second, third = log.measurements()
    assert not log.problems
    assert log.origin.height_m == pytest.approx(30.48)
    with pytest.raises(BadInputError, match="from the origin 30,120; a level plane"):
        open_log(path, mapping=mapping(tmp_path, gnss(columns=columns)), origin=Origin())
    nan = math.nan
    expected = [0.0, 0.0, 0.0, 1.0, math.pi / 2, 0.2, nan, nan, 4.0, 9.0, nan, nan, 1.5]
    np.testing.assert_allclose(first.values[0], expected, atol=1e-9)
    np.testing.assert_allclose(second.values[0, [3, 5, 8, 12]], [2.0, nan, 5.0, nan])
    assert third.column("quality")[0] == 0.0
    assert np.isnan(third.values[0, :3]).all()
    assert [each.t_ns for each in (first, second, third)] == [0, 10**9, 2 * 10**9]


def test_other_separators_and_divided_columns(tmp_path: Path) -> None:
    wheels = {
        "kind": "odometry",
        "separator": ";",
        "time": {"column": "t", "since": "start"},
        "columns": {
            "speed_m_s": {"column": "way", "unit": "cm", "over": "span", "scale": 2.0},
            "yaw_rate_rad_s": {"column": "turn", "unit": "deg", "over": "span", "scale": -1.0},
        },
        "xyz_m": [1.0, 0.0, 0.5],
        "datasheet": {"speed_noise_m_s": 0.1},
    }
    path = table(tmp_path, "t;way;turn;span\n1;50;90;0.5\n2;50;90;0\n")
    log = open_log(path, mapping=mapping(tmp_path, wheels))
    first, second = log.measurements()
    np.testing.assert_allclose(first.values, [[2.0, -math.pi]])
    assert np.isnan(second.values).all()
    info = log.sensors["odometry"]
    assert (info.mount.xyz_m, dict(info.datasheet), info.columns) == (
        (1.0, 0.0, 0.5),
        {"speed_noise_m_s": 0.1},
        COLUMNS["odometry"],
    )
    assert log.start_utc_ns is None


@pytest.mark.parametrize(
    ("text", "unit", "since", "expected"),
    [
        ("1432235498.039089918", "s", "unix", 1_432_235_498_039_089_918),
        ("1.432235498e9", "s", "unix", 1_432_235_498 * 10**9),
        ("1432235498039", "ms", "unix", 1_432_235_498_039 * 10**6),
        ("1432235498039089", "us", "unix", 1_432_235_498_039_089 * 10**3),
        ("1432235498039089918", "ns", "unix", 1_432_235_498_039_089_918),
        ("1292880522.25", "s", "gps", int(np.datetime64("2020-12-24T21:28:24.250", "ns").astype(int))),
    ],
)
def test_no_digit_of_a_time_is_lost(text: str, unit: str, since: str, expected: int, tmp_path: Path) -> None:
    path = table(tmp_path, f"t,lat,lon\n{text},10,20\n")
    log = open_log(path, mapping=mapping(tmp_path, gnss(time={"column": "t", "unit": unit, "since": since})))
    assert log.start_utc_ns == expected


def test_files_that_begin_at_different_times_stay_in_time(tmp_path: Path) -> None:
    table(tmp_path, "t,lat,lon\n1000.0,10,20\n1001.0,10,20\n", "fix.csv")
    table(tmp_path, "t,w\n999.5,1\n1000.5,2\n1001.5,3\n", "gyro.csv")
    log = open_log(tmp_path, mapping=mapping(tmp_path, gnss(file="fix.csv"), GYRO | {"file": "gyro.csv"}))
    assert [(each.sensor, each.t) for each in log.measurements()] == [
        ("yaw_gyro", 0.0),
        ("gnss", 0.5),
        ("yaw_gyro", 1.0),
        ("gnss", 1.5),
        ("yaw_gyro", 2.0),
    ]


def test_tables_keep_their_common_clock_whatever_the_gaps(tmp_path: Path) -> None:
    hours = 3600.0
    # The gyroscope begins three hours after the receiver, and both pause for days, at other times.
    fixes = [0.0, 1.0, 3.0 * hours, 3.0 * hours + 1.0, 80.0 * hours, 160.0 * hours]
    turns = [3.0 * hours, 3.0 * hours + 0.5, 159.0 * hours, 160.0 * hours]
    table(tmp_path, "t,lat,lon\n" + "".join(f"{7.0 + t},10,20\n" for t in fixes), "fix.csv")
    table(tmp_path, "t,w\n" + "".join(f"{7.0 + t},1\n" for t in turns), "gyro.csv")
    log = open_log(tmp_path, mapping=mapping(tmp_path, gnss(file="fix.csv"), GYRO | {"file": "gyro.csv"}))
    sensors = by_sensor(list(log.measurements()))
    assert [each.t for each in sensors["gnss"]] == fixes
    assert [each.t for each in sensors["yaw_gyro"]] == turns
    assert not log.problems


def test_what_goes_back_or_far_ahead_and_back_again_is_passed_over(tmp_path: Path) -> None:
    times = [100, 101, 50, 51, 52, 53, 102, 90_000, 103, 95, 104, 200_000]
    path = table(tmp_path, "t,lat,lon\n" + "".join(f"{t},10,20\n" for t in times))
    log = open_log(path, mapping=mapping(tmp_path, gnss()))
    found = list(log.measurements())
    assert [each.t + 100.0 for each in found] == [100, 101, 102, 103, 95, 104, 200_000]
    assert found[4].t_available_ns == found[3].t_ns
    assert log.problems == {"time jumps": 5}


def test_a_log_claims_thirty_days_at_most(tmp_path: Path) -> None:
    days = [0.0, 29.9, 30.0, 30.1, 400.0, 9_000.0]
    path = table(tmp_path, "t,lat,lon\n" + "".join(f"{86_400 * day + k},10,20\n" for day in days for k in range(2)))
    log = open_log(path, mapping=mapping(tmp_path, gnss()))
    assert [round(each.t / 86_400, 1) for each in log.measurements()] == [0.0, 0.0, 29.9, 29.9, 30.0]
    assert log.problems == {"more than 30 days after the beginning": 7}


@pytest.mark.parametrize(("text", "usable"), [("315532800", True), ("315532799", False), ("3471292799", True),
                                              ("3471292800", False)])  # fmt: skip
def test_dates_are_those_from_1980_to_2079(text: str, usable: bool, tmp_path: Path) -> None:
    path = table(tmp_path, f"t,lat,lon\n{text},10,20\n")
    opening = mapping(tmp_path, gnss(time=DATED))
    if usable:
        assert len(list(open_log(path, mapping=opening).measurements())) == 1
    else:
        with pytest.raises(BadInputError, match=r"no row of it can be used \(1 out of range\)"):
            open_log(path, mapping=opening)


def test_a_first_row_far_off_does_not_move_the_others(tmp_path: Path) -> None:
    path = table(tmp_path, "t,lat,lon\n400000000,10,20\n1500000000,10,20\n1500000001,10,20\n")
    log = open_log(path, mapping=mapping(tmp_path, gnss(time=DATED)))
    assert [each.t for each in log.measurements()] == [0.0, 1.0]
    assert log.problems == {"time jumps": 1}
    assert log.start_utc_ns == 1_500_000_000 * 10**9


# --- bad rows --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bad", "kind"),
    [
        ("101,10", "missing fields"),
        (",10,20", "missing fields"),
        ("101,10,20,30", "missing fields"),
        ("soon,10,20", "not a number"),
        ("101,ten,20", "not a number"),
        ("101,1_0,20", "not a number"),
        ("1_01,10,20", "not a number"),
        ("\u0661,10,20", "not a number"),
        ("101,1e999,20", "out of range"),
        ("101,91,20", "out of range"),
        ("1e400,10,20", "out of range"),
        ("1e999999999,10,20", "out of range"),
        ("-101,10,20", "out of range"),
        ("nan,10,20", "out of range"),
        ('101,"10,20', "missing fields"),
        ("1" * 9000, "too long"),
    ],
)
def test_a_bad_row_is_counted_by_kind_and_the_good_ones_around_it_are_kept(bad: str, kind: str, tmp_path: Path) -> None:
    path = table(tmp_path, f"t,lat,lon\n100,10,20\n{bad}\n102,10,20\n")
    log = open_log(path, mapping=mapping(tmp_path, gnss()))
    assert [each.t for each in log.measurements()] == [0.0, 2.0]
    assert log.problems == Counter({kind: 1})


@pytest.mark.parametrize("text", ["t,lat,lon\n", "t,lat,lon\nx,y,z\n", "t,lat\n1,2\n", "", "\x00\xff\n\n"])
def test_a_file_with_nothing_usable_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"log\.csv"):
        open_log(table(tmp_path, text), mapping=mapping(tmp_path, gnss()))


def test_a_csv_without_a_mapping_is_refused_with_a_hint(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="--mapping"):
        open_log(table(tmp_path, "t,lat,lon\n1,10,20\n"))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"other\.csv: no such file"):
        open_log(table(tmp_path, "t,lat,lon\n1,10,20\n"), mapping=mapping(tmp_path, gnss(file="other.csv")))


# --- bad mappings ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"file": "../secret.csv"}, "plain name"),
        ({"file": "/etc/passwd"}, "plain name"),
        ({"kind": "lidar"}, "kind"),
        ({"columns": {"latitude": {"column": "lat"}}}, "did you mean 'latitude_deg'"),
        ({"columns": {"height_m": {"column": "h", "unit": "deg"}}}, "unit = 'deg'; allowed: m, km"),
        ({"columns": {"height_m": {"column": "h", "unit": "m2"}}}, "unit = 'm2'; allowed"),
        ({"columns": {"height_m": {"column": "h", "over": "t", "unit": "m"}}}, "allowed: none"),
        ({"columns": {"height_m": {"constant": 1.0, "scale": 2.0}}}, "a constant has no unit"),
        ({"columns": {"height_m": {}}}, "either column or constant"),
        ({"columns": {"height_m": {"column": "h", "code": "eval"}}}, "unknown key"),
        ({"time": {"column": "t", "unit": "years"}}, "unit"),
        ({"separator": "::"}, "separator"),
        ({"columns": {"height_m": {"column": "h", "scale": math.inf}}}, "scale"),
    ],
)
def test_a_mapping_that_cannot_be_is_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=message):
        read_mapping(mapping(tmp_path, gnss(**changes)))


def test_two_sensors_of_a_kind_and_mixed_starts_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="two of the kind 'gnss'"):
        read_mapping(mapping(tmp_path, gnss(), gnss()))
    with pytest.raises(BadInputError, match="cannot be put beside"):
        read_mapping(mapping(tmp_path, gnss(time=DATED), GYRO))


def test_a_receiver_needs_a_position(tmp_path: Path) -> None:
    speed = {"kind": "gnss", "time": {"column": "t"}, "columns": {"speed_m_s": {"column": "v"}}}
    with pytest.raises(BadInputError, match="latitude_deg and longitude_deg"):
        read_mapping(mapping(tmp_path, speed))


@pytest.mark.parametrize("content", [b"tables = 3", b"no toml", b"\xff\xfe", b"tables = []", b"[" * 50_000])
def test_a_mapping_that_is_none_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "mapping.toml"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=r"mapping\.toml"):
        read_mapping(path)


def test_an_unknown_mapping_is_refused_with_those_there_are() -> None:
    with pytest.raises(BadInputError, match=r"nowhere: no such mapping \(with the package come: combine, husky\)"):
        read_mapping(Path("nowhere"))


def test_what_a_log_holds_is_one_reader_for_each_table(tmp_path: Path) -> None:
    path = table(tmp_path, "t,lat,lon\n1,10,20\n")
    log = open_log(path, mapping=mapping(tmp_path, gnss()))
    assert isinstance(log, CsvLog)
    assert log.sensors["gnss"].rate_hz == 1.0
