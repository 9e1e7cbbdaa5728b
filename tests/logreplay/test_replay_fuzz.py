"""Logs from anywhere through the whole replay, as the log and as its reference: a result that is JSON, or bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.formats.sentences import gga, gst, rmc
from twin.errors import BadInputError
from twin.formats.logs import open_log
from twin.formats.nmea import framed
from twin.logreplay import choose, replay_log
from twin.logreplay.result import result_of

SLOW = settings(
    max_examples=60, deadline=5_000, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
NUMBERS = st.one_of(
    st.sampled_from(["", "0", "00", "1", "31", "12", "1969", "1979", "1980", "2079", "2080", "9999", "10000", "-1"]),
    st.integers(-(10**20), 10**20).map(str),
)
CLOCKS = st.one_of(
    st.integers(0, 240_000).map(lambda clock: f"{clock:06d}.00"), st.sampled_from(["120005.00", "235959.99", "", "x"])
)
DATED = st.builds("GNZDA,{},{},{},{},00,00".format, CLOCKS, NUMBERS, NUMBERS, NUMBERS)
SENTENCES = st.one_of(
    DATED,
    st.builds(lambda clock, date: rmc(clock, date=date), CLOCKS, st.integers(0, 999_999).map("{:06d}".format)),
    st.builds(lambda clock, quality: gga(clock, quality=quality), CLOCKS, st.integers(0, 9)),
    st.builds(gst, CLOCKS),
)


def write(path: Path, bodies: list[str]) -> Path:
    """Ten seconds of a good log, with other sentences behind the fifth."""
    clocks = [f"12000{second}.00" for second in range(10)]
    good = [body for clock in clocks for body in (gga(clock), rmc(clock))]
    path.write_bytes("".join(map(framed, [*good[:10], *bodies, *good[10:]])).encode("ascii", "replace"))
    return path


def replayed(path: Path, reference: Path) -> dict | None:
    """The result as JSON, or None if it was refused with a message."""
    try:
        found = replay_log(open_log(path), choose(["guidance_gps"]), reference=open_log(reference))
    except BadInputError:
        return None
    return json.loads(json.dumps(result_of(found), allow_nan=False))


@given(log=st.lists(SENTENCES, max_size=8), reference=st.lists(SENTENCES, max_size=8))
@SLOW
def test_any_dates_and_times_in_the_log_and_in_its_reference(
    log: list[str], reference: list[str], tmp_path: Path
) -> None:
    result = replayed(write(tmp_path / "log.nmea", log), write(tmp_path / "reference.nmea", reference))
    if result is not None:
        assert 0.0 <= result["ended"]["t_s"] <= 30 * 86_400
        for told in (result["log"], result["reference"]):
            assert "1975" < told["start_utc"] < "2085"


@given(date=st.tuples(NUMBERS, NUMBERS, NUMBERS))
@SLOW
def test_a_date_alone_in_the_reference(date: tuple[str, str, str], tmp_path: Path) -> None:
    path = tmp_path / "reference.nmea"
    day, month, year = date
    bodies = [gga("120000.00"), f"GNZDA,120000.00,{day},{month},{year},00,00", gga("120001.00")]
    path.write_bytes("".join(map(framed, bodies)).encode())
    began = open_log(path).start_utc_ns
    if began is not None:
        assert np.datetime64("1980") <= np.datetime64(began, "ns") < np.datetime64("2080")
    result = replayed(write(tmp_path / "log.nmea", []), path)
    assert result is None or abs(int(result["reference"]["start_utc"][:4]) - 2026) <= 1


@given(content=st.binary(max_size=2_000))
@SLOW
def test_random_bytes_as_reference(content: bytes, tmp_path: Path) -> None:
    path = write(tmp_path / "reference.nmea", [])
    whole = path.read_bytes()
    path.write_bytes(whole[:700] + content + whole[700:])
    result = replayed(write(tmp_path / "log.nmea", []), path)
    assert result is not None
    assert result["metrics"]["gnss.reference.epochs"] > 0
