"""Logs of sentences: what is read from them, put together, put in time, and passed over."""

from __future__ import annotations

import datetime as dt
import itertools
import math
import random
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pynmeagps import NMEAReader

from tests.formats.sentences import GSA, gga, gst, rmc, vtg, write_log
from tests.sensors.motions import preset, sensor
from twin.errors import BadInputError
from twin.formats.geodetic import Origin
from twin.formats.gnss_fixes import COLUMNS
from twin.formats.log_head import neutral_sheet
from twin.formats.logs import open_log
from twin.formats.nmea import KNOT_M_S, framed
from twin.signals import Measurement

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "gpsd_nmea"
REAL = ["foretrex-201", "garmin-10x", "mt3339", "rst39", "skytraq-dgps", "skytraq-fix"]
PLACING = {"GGA", "RMC", "GNS", "GLL"}


def read(path: Path) -> tuple[list[Measurement], Counter[str]]:
    log = open_log(path)
    return list(log.measurements()), log.problems


def column(found: list[Measurement], name: str) -> list[float]:
    return [float(each.column(name)[0]) for each in found]


# --- real receivers --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", REAL)
def test_a_real_log_says_what_pynmeagps_reads_in_it(name: str) -> None:
    path = FOLDER / f"{name}.log"
    if not path.is_file():
        pytest.skip(f"the log {path} is not here")
    log = open_log(path)
    found = list(log.measurements())
    lines = [line for line in path.read_bytes().replace(b"\r", b"").split(b"\n") if line]
    parsed = [NMEAReader.parse(line + b"\r\n") for line in lines if line.startswith(b"$")]
    places = {m.time: m for m in reversed(parsed) if m.msgID in PLACING and m.time != ""}
    places |= {m.time: m for m in reversed(parsed) if m.msgID == "GGA" and m.time != ""}
    speeds = {m.time: m for m in parsed if m.msgID == "RMC" and m.time != "" and m.status == "A"}
    sigmas = {m.time: m for m in parsed if m.msgID == "GST" and m.time != ""}
    times = list(dict.fromkeys(m.time for m in parsed if m.msgID in PLACING and m.time != ""))
    assert len(found) == len(times) > 0
    for each, time in zip(found, times, strict=True):
        sentence = places[time]
        if sentence.msgID == "GGA":
            assert each.column("quality")[0] == sentence.quality
            assert each.column("satellites")[0] == sentence.numSV
            if sentence.quality:
                place = log.origin.geodetic(each.values[0, :3])
                np.testing.assert_allclose(place[:2], [sentence.lat, sentence.lon], atol=1e-9)
                assert place[2] == pytest.approx(sentence.alt + (sentence.sep or 0.0), abs=1e-5)
        if time in speeds:
            assert each.column("speed_m_s")[0] == pytest.approx(float(speeds[time].spd) * KNOT_M_S)
            if speeds[time].cog == "":
                assert math.isnan(each.column("course_rad")[0])
            else:
                north = math.sin(each.column("course_rad")[0])
                assert north == pytest.approx(math.cos(math.radians(float(speeds[time].cog))))
        if time in sigmas and sigmas[time].stdLat != "":
            told = sigmas[time]
            assert each.values[0, 5:8].tolist() == [told.stdLong, told.stdLat, told.stdAlt]
    start = next(m for m in parsed if m.msgID == "RMC" and m.date != "" and m.time != "")
    assert log.start_utc_ns is not None
    assert np.datetime64(log.start_utc_ns, "ns") == np.datetime64(f"{start.date}T{start.time}")
    timeless = [m for m in parsed if m.msgID in PLACING | {"GST", "ZDA"} and m.time == ""]
    others = sum(not line.startswith(b"$") for line in lines)
    assert log.problems == Counter({"not NMEA": others, "missing fields": len(timeless)}) - Counter()


def test_columns_are_those_of_a_simulated_receiver() -> None:
    assert sensor(preset("single_point")).columns == COLUMNS


# --- one epoch -------------------------------------------------------------------------------------------------------


def test_an_epoch_has_what_its_sentences_say(tmp_path: Path) -> None:
    path = write_log(tmp_path, gga("120000.00"), rmc("120000.00"), vtg(9.0), gst("120000.00"), GSA)
    (found,), problems = read(path)
    assert found.columns == COLUMNS
    assert not problems
    expected = [0.0, 0.0, 0.0, 3.5 * KNOT_M_S, math.pi / 4, 0.02, 0.01, 0.03, 4.0, 12.0, 0.7, 1.2, 1.0]
    np.testing.assert_allclose(found.values, [expected], atol=1e-9)
    assert (found.t_ns, found.t_available_ns, found.sensor) == (0, 0, "gnss")


@pytest.mark.parametrize("order", list(itertools.permutations(range(5))))
def test_the_order_of_an_epochs_sentences_does_not_matter(order: tuple[int, ...], tmp_path: Path) -> None:
    bodies: list[str] = []
    for second in range(4):
        time = f"12000{second}.00"
        epoch = [gga(time), rmc(time, knots=f"{second}.0"), vtg(second), gst(time), GSA.replace("1.20", f"{second}.00")]
        bodies += [epoch[index] for index in order]
    found, problems = read(write_log(tmp_path, *bodies))
    assert not problems
    assert [each.t_ns for each in found] == [0, 10**9, 2 * 10**9, 3 * 10**9]
    np.testing.assert_allclose(column(found, "speed_m_s"), KNOT_M_S * np.arange(4), rtol=1e-3)
    assert column(found, "vdop") == [0.0, 1.0, 2.0, 3.0]
    assert column(found, "sigma_e_m") == [0.02] * 4


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_sentences_may_be_missing(data: st.DataObject, tmp_path: Path) -> None:
    bodies: list[str] = []
    expected: list[tuple[int, bool, bool]] = []
    for second in range(5):
        time = f"12000{second}.00"
        there = data.draw(st.tuples(*[st.booleans()] * 4))
        epoch = (gga(time), rmc(time, knots=f"{second}.5"), vtg(second + 0.5), gst(time))
        bodies += [body for body, kept in zip(epoch, there, strict=True) if kept]
        if there[0] or there[1]:
            expected.append((second, there[1], there[3]))
    path = write_log(tmp_path, *bodies)
    if not expected:
        with pytest.raises(BadInputError):
            open_log(path)
        return
    found, _ = read(path)
    assert [each.t_ns // 10**9 + expected[0][0] for each in found] == [second for second, _, _ in expected]
    for each, (second, has_rmc, has_gst) in zip(found, expected, strict=True):
        if has_rmc:
            assert each.column("speed_m_s")[0] == pytest.approx((second + 0.5) * KNOT_M_S)
        assert math.isnan(each.column("sigma_e_m")[0]) != has_gst


def test_a_vtg_ahead_of_its_gga_stays_with_it_when_one_is_lost(tmp_path: Path) -> None:
    bodies = [vtg(0), gga("120000.00"), vtg(1), gga("120001.00"), gga("120002.00"), vtg(3), gga("120003.00")]
    found, _ = read(write_log(tmp_path, *bodies))
    np.testing.assert_allclose(
        column(found, "speed_m_s"), np.array([0.0, 1.0, np.nan, 3.0]) * KNOT_M_S, rtol=1e-3, equal_nan=True
    )


def test_talkers_are_mixed_and_the_second_of_a_type_is_passed_over(tmp_path: Path) -> None:
    glonass = GSA.replace("1.20", "7.70")
    path = write_log(
        tmp_path, gga("120000.00", talker="GP"), rmc("120000.00"), GSA, glonass, gga("120000.00", minutes="05.0000000")
    )
    (found,), problems = read(path)
    assert problems == {"repeated": 1}
    assert found.column("vdop")[0] == 1.2
    assert found.column("position_n_m")[0] == pytest.approx(0.0, abs=1e-6)


def test_without_rmc_speed_and_course_are_those_of_vtg_and_quality_that_of_rmc_without_gga(tmp_path: Path) -> None:
    path = write_log(tmp_path, gga("120000.00"), vtg(2.0), rmc("120001.00", mode="F"), rmc("120002.00", mode=""))
    found, _ = read(path)
    assert found[0].column("speed_m_s")[0] == pytest.approx(2.0 * KNOT_M_S, rel=1e-3)
    assert found[0].column("course_rad")[0] == pytest.approx(0.0, abs=1e-12)
    assert column(found, "quality") == [4.0, 5.0, 1.0]
    assert np.isnan(column(found, "position_u_m")).tolist() == [False, True, True]
    np.testing.assert_allclose(column(found, "position_n_m"), 0.0, atol=1e-6)


def test_gns_gll_and_zda_count_too(tmp_path: Path) -> None:
    path = write_log(
        tmp_path,
        "GNZDA,120000.00,01,04,2026,00,00",
        "GNGNS,120000.00,4404.1300000,N,12118.8700000,W,RF,15,0.6,100.0,20.0,1.5,0000",
        "GNGLL,4404.1300000,N,12118.8700000,W,120001.00,A,D",
    )
    log = open_log(path)
    found = list(log.measurements())
    assert column(found, "quality") == [4.0, 2.0]
    assert column(found, "satellites")[0] == 15.0
    assert column(found, "age_s")[0] == 1.5
    assert log.origin.height_m == 120.0
    assert np.datetime64(log.start_utc_ns or 0, "ns") == np.datetime64("2026-04-01T12:00:00")
    assert not log.problems


def test_without_a_position_there_are_quality_zero_and_satellites_alone(tmp_path: Path) -> None:
    path = write_log(tmp_path, gga("120000.00"), gga("120001.00", quality=0), gga("120002.00", quality=5))
    found, problems = read(path)
    assert not problems
    assert column(found, "quality") == [4.0, 0.0, 5.0]
    rest = found[1].values[0].tolist()
    assert [rest.pop(9), rest.pop(8)] == [3.0, 0.0]
    assert np.isnan(rest).all()


@pytest.mark.parametrize("untold", [{1}, {0}, {0, 1, 2}, {2, 3}, set()])
def test_heights_stay_where_the_separation_is_left_out(untold: set[int], tmp_path: Path) -> None:
    bodies = [gga(f"12000{second}.00") for second in range(4)]
    bodies = [body.replace(",20.0,M,", ",,,") if second in untold else body for second, body in enumerate(bodies)]
    log = open_log(write_log(tmp_path, *bodies))
    assert log.origin.height_m == 120.0
    assert log.origin.geoid_height_m == 20.0
    assert column(list(log.measurements()), "position_u_m") == pytest.approx([0.0] * 4, abs=1e-6)
    assert not log.problems


def test_the_separation_told_last_counts_and_that_of_another_sentence_of_the_epoch(tmp_path: Path) -> None:
    bodies = [
        gga("120000.00"),
        gga("120001.00").replace(",20.0,M,", ",25.0,M,"),
        gga("120002.00").replace(",20.0,M,", ",,,"),
        "GNGNS,120003.00,4404.1300000,N,12118.8700000,W,RF,15,0.6,100.0,30.0,1.5,0000",
        gga("120003.00").replace(",20.0,M,", ",,,"),
        "PANDA,120004.00,4404.13,N,12118.87,W,4,12,0.7,100.0,1.0,3.888,65535,0,0,0",
    ]
    found, _ = read(write_log(tmp_path, *bodies))
    assert column(found, "position_u_m") == pytest.approx([0.0, 5.0, 5.0, 10.0, 10.0], abs=1e-6)


def test_heights_of_a_log_without_any_separation_are_those_above_the_sea(tmp_path: Path) -> None:
    log = open_log(write_log(tmp_path, *(gga(f"12000{s}.00").replace(",20.0,M,", ",,,") for s in range(3))))
    assert (log.origin.height_m, log.origin.geoid_height_m) == (100.0, 0.0)
    assert column(list(log.measurements()), "position_u_m") == pytest.approx([0.0] * 3, abs=1e-6)


# --- time ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dated", [False, True])
def test_time_goes_on_over_midnight(dated: bool, tmp_path: Path) -> None:
    bodies: list[str] = []
    for index in range(4):
        time = ("235958.50", "235959.50", "000000.50", "000001.50")[index]
        bodies.append(gga(time))
        if dated:
            bodies.append(rmc(time, date="311226" if index < 2 else "010127"))
    log = open_log(write_log(tmp_path, *bodies))
    assert [each.t_ns for each in log.measurements()] == [index * 10**9 for index in range(4)]
    assert not log.problems
    start = None if not dated else np.datetime64("2026-12-31T23:59:58.5", "ns").astype(np.int64)
    assert log.start_utc_ns == start


def test_a_date_that_comes_late_still_dates_the_log(tmp_path: Path) -> None:
    path = write_log(tmp_path, gga("235959.00"), gga("000000.00"), rmc("000000.00", date="010426"))
    log = open_log(path)
    assert [each.t_ns for each in log.measurements()] == [0, 10**9]
    assert np.datetime64(log.start_utc_ns or 0, "ns") == np.datetime64("2026-03-31T23:59:59")


def test_late_epochs_keep_their_time_and_arrive_when_they_arrive(tmp_path: Path) -> None:
    path = write_log(tmp_path, *(gga(f"12000{second}.00") for second in (0, 2, 1, 3)))
    found, problems = read(path)
    assert [each.t_ns // 10**9 for each in found] == [0, 2, 1, 3]
    assert [each.t_available_ns // 10**9 for each in found] == [0, 2, 2, 3]
    assert not problems


@pytest.mark.parametrize("far", ["060000", "120500", "200000", "235959"])
def test_one_epoch_far_off_is_passed_over(far: str, tmp_path: Path) -> None:
    path = write_log(tmp_path, *(gga(f"{time}.00") for time in ("120000", "120001", far, "120002", "120003")))
    found, problems = read(path)
    assert [each.t_ns // 10**9 for each in found] == [0, 1, 2, 3]
    assert problems == {"time jumps": 1}


def test_gaps_stay_and_nothing_behind_them_is_lost(tmp_path: Path) -> None:
    times = ("120000", "120001", "120100", "120101", "130000", "130001", "133000")
    found, problems = read(write_log(tmp_path, *(gga(f"{time}.00") for time in times)))
    assert [each.t_ns // 10**9 for each in found] == [0, 1, 60, 61, 3600, 3601, 5400]
    assert not problems


def test_a_log_with_an_epoch_a_minute_is_read_whole(tmp_path: Path) -> None:
    found, problems = read(write_log(tmp_path, *(gga(f"12{minute:02d}00.00") for minute in range(30))))
    assert [each.t_ns // 10**9 for each in found] == [60 * minute for minute in range(30)]
    assert not problems


def test_a_log_of_long_gaps_claims_thirty_days_at_most(tmp_path: Path) -> None:
    # Pairs every two hours: half a year of them.
    hours = [2 * index for index in range(12 * 180)]
    bodies = [gga(f"{hour % 24:02d}000{second}.00") for hour in hours for second in range(2)]
    found, problems = read(write_log(tmp_path, *bodies))
    assert found[-1].t_ns == found[-1].t_available_ns == 30 * 86_400 * 10**9
    assert len(found) == 2 * 12 * 30 + 1
    assert problems == {"more than 30 days after the beginning": 2 * 12 * 150 - 1}


@pytest.mark.parametrize("dated", [False, True])
def test_joined_logs_go_on_one_second_after_the_first(dated: bool, tmp_path: Path) -> None:
    times = ("120000", "120001", "080000", "080001", "080002", "200000", "200001", "200002")
    bodies = [body for time in times for body in ((gga(f"{time}.00"), rmc(f"{time}.00"))[: 1 + dated])]
    found, problems = read(write_log(tmp_path, *bodies))
    assert [each.t_ns // 10**9 for each in found] == [0, 1, 2, 3, 4, 5, 6, 7]
    assert problems == {"clock set anew": 2}


def test_a_clock_that_finds_the_time_dates_the_log(tmp_path: Path) -> None:
    early = [rmc(f"00000{second}.00", date="060180") for second in range(3)]
    right = [rmc(f"12000{second}.00", date="010426") for second in range(6)]
    log = open_log(write_log(tmp_path, *early, *right))
    assert [each.t_ns // 10**9 for each in log.measurements()] == list(range(9))
    assert log.problems == {"clock set anew": 1}
    # the first that is right is 3 s after time zero
    assert np.datetime64(log.start_utc_ns or 0, "ns") == np.datetime64("2026-04-01T11:59:57")


def void(time: str, *, date: str) -> str:
    """An RMC without a position."""
    return f"GNRMC,{time},V,,,,,,,{date},,,N"


BEFORE = {
    "void RMC": lambda time, date: [gga(time, quality=0), void(time, date=date)],
    "void RMC beside a fix": lambda time, date: [gga(time, quality=1), void(time, date=date)],
    "void RMC alone": lambda time, date: [void(time, date=date)],
    "ZDA without a fix": lambda time, date: [
        gga(time, quality=0),
        f"GNZDA,{time},{date[:2]},{date[2:4]},{1980 if date[4:] == '80' else 2006},00,00",
    ],
}


@pytest.mark.parametrize("date", ["060180", "160806"])
@pytest.mark.parametrize("kind", BEFORE)
@pytest.mark.parametrize("count", [1, 3, 5, 60])
def test_what_is_said_of_the_date_without_a_position_dates_nothing(
    count: int, kind: str, date: str, tmp_path: Path
) -> None:
    times = [f"12{second // 60:02d}{second % 60:02d}.00" for second in range(count + 35)]
    bodies = [body for time in times[:count] for body in BEFORE[kind](time, date)]
    bodies += [body for time in times[count:] for body in (gga(time), rmc(time, date="010426"))]
    log = open_log(write_log(tmp_path, *bodies))
    assert len(list(log.measurements())) == count + 35
    assert np.datetime64(log.start_utc_ns or 0, "ns") == np.datetime64("2026-04-01T12:00:00")
    assert not log.problems


@pytest.mark.parametrize("first_s", [10, 86_390])
@pytest.mark.parametrize(
    ("dates", "day", "wrong"),
    [
        ("a" * 5 + "b" * 35, "b", 5),
        ("a" * 5 + "bb" + "a" * 10, "a", 2),
        ("a" * 5 + "bb", "a", 2),
        ("a" * 5 + "bbcc" + "bbb", "b", 5 + 4),
        ("a" * 5 + "-" * 5 + "b-b-b--", "b", 5),
        ("a" * 80 + "bbbb", "a", 80),  # behind the head, it is only counted
    ],
)
def test_later_dates_that_agree_on_another_day_date_the_log(
    dates: str, day: str, wrong: int, first_s: int, tmp_path: Path
) -> None:
    days = {"a": dt.date(1980, 1, 6), "b": dt.date(2026, 4, 1), "c": dt.date(2026, 3, 1)}
    bodies: list[str] = []
    for index, letter in enumerate(dates):
        after, second = divmod(first_s + index, 86_400)
        time = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}.00"
        bodies.append(gga(time))
        if letter != "-":
            bodies.append(rmc(time, date=(days[letter] + dt.timedelta(after)).strftime("%d%m%y")))
    log = open_log(write_log(tmp_path, *bodies))
    assert [each.t_ns for each in log.measurements()] == [index * 10**9 for index in range(len(dates))]
    assert np.datetime64(log.start_utc_ns or 0, "ns") == np.datetime64(days[day]) + np.timedelta64(first_s, "s")
    assert log.problems == {"wrong date": wrong}


# --- bad lines -------------------------------------------------------------------------------------------------------


def damaged(body: str) -> bytes:
    whole = bytearray(framed(body).encode())
    whole[12] ^= 1
    return bytes(whole)


@pytest.mark.parametrize(
    ("bad", "kind"),
    [
        (damaged(gga("120001.00")), "checksum"),
        (framed(gga("120001.00")).encode()[:40] + b"\n", "no checksum"),
        (b"\x00\xff\xd3\x00\x13binary\n", "not NMEA"),
        (b"# a comment\r\n", "not NMEA"),
        (framed("GNGGA,120001.00,4404.13,N,12118.87,W,4").encode(), "missing fields"),
        (framed("GNGGA,120001.00,,N,12118.87,W,4,12,0.7,100.0,M,20.0,M,1.0,0000").encode(), "missing fields"),
        (framed("GNGGA,,4404.13,N,12118.87,W,4,12,0.7,100.0,M,20.0,M,1.0,0000").encode(), "missing fields"),
        (framed("GNGGA").encode(), "missing fields"),
        (framed(gga("250000.00")).encode(), "out of range"),
        (framed(gga("12x000.00")).encode(), "not a number"),
        (framed(gga("120001.00", minutes="60.0000000")).encode(), "out of range"),
        (framed(gga("120001.00", minutes="nan")).encode(), "not a number"),
        (framed(gga("120001.00", age="nan")).encode(), "out of range"),
        (framed(gga("120001.00", minutes="1_0.0000")).encode(), "not a number"),
        (framed(gga("120001.00", age="1_0")).encode(), "not a number"),
        (framed(gga("120001.00", age="1e999")).encode(), "out of range"),
        (framed(rmc("120001.00", date="310226")).encode(), "out of range"),
        (framed(rmc("120001.00", date="3102")).encode(), "not a number"),
        (framed(rmc("120001.00", course="-1e9")).encode(), "out of range"),
        (framed("GNZDA,120001.00,01,04,9999,00,00").encode(), "out of range"),
        (framed("GNZDA,120001.00,31,12,1979,00,00").encode(), "out of range"),
        (framed("GNVTG,90.0,T").encode(), "missing fields"),
        (b"$GNGGA," + b"1" * 5000 + b"\n", "too long"),
        (b"$" * 100_000 + b"\n", "too long"),
    ],
)
def test_a_bad_line_is_counted_by_kind_and_the_good_ones_around_it_are_kept(
    bad: bytes, kind: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.nmea"
    path.write_bytes(framed(gga("120000.00")).encode() + bad + framed(gga("120002.00")).encode())
    found, problems = read(path)
    assert [each.t_ns for each in found] == [0, 2 * 10**9]
    assert problems == {kind: 1}


@pytest.mark.parametrize(
    ("angles", "kind"),
    [
        ("4404.13,,12118.87,W", "missing fields"),
        ("4404.13,N,12118.87,", "missing fields"),
        (",,,", "missing fields"),
        ("4475.0,N,12118.87,W", "out of range"),
        ("-4404.13,N,12118.87,W", "out of range"),
        ("4404.13,N,-12118.87,W", "out of range"),
        ("4404.13,W,12118.87,N", "out of range"),
        ("9100.00,N,12118.87,W", "out of range"),
        ("4404.13,N,18100.00,W", "out of range"),
    ],
)
@pytest.mark.parametrize(
    "body",
    [
        "GNGNS,120001.00,{},RF,15,0.6,100.0,20.0,1.5,0000",
        "GNGLL,{},120001.00,A,D",
        "GNRMC,120001.00,A,{},3.5,45.0,010426,,,R",
        "GNGGA,120001.00,{},4,12,0.7,100.0,M,20.0,M,1.0,0000",
    ],
)
def test_every_sentence_has_whole_angles_or_no_place(body: str, angles: str, kind: str, tmp_path: Path) -> None:
    found, problems = read(write_log(tmp_path, gga("120000.00"), body.format(angles), gga("120002.00")))
    assert [each.t_ns for each in found] == [0, 2 * 10**9]
    assert problems == {kind: 1}


def test_sentences_are_found_between_other_bytes_and_other_sentences_are_no_problem(tmp_path: Path) -> None:
    path = tmp_path / "log.nmea"
    path.write_bytes(
        b"1617.2 \xb5b\x01"
        + framed(gga("120000.00")).encode().rstrip()
        + framed(rmc("120000.00")).encode()
        + framed("PUBX,00,1,2,3").encode()
        + framed("GPGSV,1,1,00").encode()
        + framed("GNTXT,01,01,02,hello").encode()
        + b"$GNGG"
        + framed(gga("120001.00")).encode().rstrip(b"\r\n")
    )
    found, problems = read(path)
    assert len(found) == 2
    assert problems == {"no checksum": 1}


# --- the whole -------------------------------------------------------------------------------------------------------


def test_the_origin_is_the_first_position_unless_told(tmp_path: Path) -> None:
    path = write_log(tmp_path, gga("120000.00", quality=0), gga("120001.00"), gga("120002.00", minutes="04.6300000"))
    assert open_log(path).origin == Origin(
        latitude_deg=44.0 + 4.13 / 60.0,
        longitude_deg=-(121.0 + 18.87 / 60.0),
        height_m=120.0,
        geoid_height_m=20.0,
    )
    told = Origin(latitude_deg=44.0, longitude_deg=-121.0)
    log = open_log(path, origin=told)
    assert log.origin == told
    last = list(log.measurements())[-1]
    np.testing.assert_allclose(told.geodetic(last.values[0, :3])[:2], [44.0 + 4.63 / 60.0, -121.3145], atol=1e-9)


def test_a_receiver_is_known_by_its_rate_and_its_best_quality(tmp_path: Path) -> None:
    bodies = [gga(f"1200{tenth // 10:02d}.{tenth % 10}0", quality=4 if tenth > 20 else 5) for tenth in range(40)]
    fixed = open_log(write_log(tmp_path, *bodies)).sensors["gnss"]
    single = open_log(write_log(tmp_path, gga("120000.00", quality=1))).sensors["gnss"]
    assert fixed.rate_hz == pytest.approx(10.0)
    assert (fixed.kind, fixed.columns) == ("gnss", COLUMNS)
    assert fixed.datasheet["position_noise_m"] < 0.05
    assert single.datasheet["position_noise_m"] > 1.0


def test_a_fix_that_comes_after_minutes_still_tells_what_the_receiver_can(tmp_path: Path) -> None:
    bodies = [
        gga(f"12{second // 60:02d}{second % 60:02d}.00", quality=4 if second > 400 else 1) for second in range(410)
    ]
    assert open_log(write_log(tmp_path, *bodies)).sensors["gnss"].datasheet == neutral_sheet(4)


def test_a_joined_log_does_not_date_the_first(tmp_path: Path) -> None:
    bodies = [rmc(f"12{second // 60:02d}{second % 60:02d}.00", date="010426") for second in range(70)]
    bodies += [rmc(f"0900{second:02d}.00", date="050426") for second in range(9)]
    log = open_log(write_log(tmp_path, *bodies))
    assert np.datetime64(log.start_utc_ns or 0, "ns") == np.datetime64("2026-04-01T12:00:00")


@pytest.mark.parametrize("quality", [4, 5, 2, 1])
def test_a_neutral_data_sheet_has_names_that_simulated_ones_have(quality: int) -> None:
    simulated = sensor(preset("rtk_f9p")).info.datasheet
    neutral = neutral_sheet(quality)
    assert set(neutral) <= set(simulated)
    name = {4: "", 5: "float_", 2: "differential_", 1: "single_"}[quality]
    assert neutral["position_correlated_sigma_m"] == neutral[f"{name}position_correlated_sigma_m"]
    # the presets are of the same sources, a mean over the axes here and there
    key = f"{name}position_correlated_sigma_m"
    assert neutral[key] == pytest.approx(simulated[key], rel=0.6)


@pytest.mark.parametrize("content", [b"", b"nothing\n" * 10, framed(gga("120000.00", quality=0)).encode(), b"\x00" * 9])
def test_a_file_with_nothing_usable_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.nmea"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=r"log\.nmea"):
        open_log(path)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing.nmea", Path("/dev/zero")):
        with pytest.raises(BadInputError):
            open_log(path)


def test_chunks_do_not_show(tmp_path: Path) -> None:
    rng = random.Random(1)
    bodies = [gga(f"{s // 3600:02d}{s // 60 % 60:02d}{s % 60:02d}.00") for s in range(3000)]
    path = tmp_path / "log.nmea"
    path.write_bytes(
        b"".join(framed(body).encode().replace(b"\r\n", rng.choice([b"\r", b"\n", b"\r\n"])) for body in bodies)
    )
    found, problems = read(path)
    assert [each.t_ns // 10**9 for each in found] == list(range(3000))
    assert not problems
