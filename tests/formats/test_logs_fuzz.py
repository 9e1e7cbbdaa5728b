"""Logs from anywhere: random bytes, splices, absurd numbers, endless lines. No crash, no hang, bounded memory."""

from __future__ import annotations

import itertools
import math
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.formats.sentences import epochs, gga, gst, rmc, vtg
from twin.errors import BadInputError
from twin.formats.logs import open_log
from twin.formats.nmea import framed
from twin.signals import Measurement

HEADER = "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m) age(s)  ratio"
LATEST_NS = 10 * 10**9
MAPPING = {
    "tables": [
        {
            "kind": "gnss",
            "time": {"column": "t", "since": "start"},
            "columns": {"latitude_deg": {"column": "lat"}, "longitude_deg": {"column": "lon"}, "hdop": {"column": "h"}},
        }
    ]
}
SLOW = settings(
    max_examples=60, deadline=5_000, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


def nmea(count: int) -> bytes:
    return "".join(map(framed, epochs(count))).encode()


def pos(count: int) -> bytes:
    rows = (f"2137 {422_922 + s}.000 40.5 -105.25 1500.0 1 11 0.01 0.02 0.03 1.5 3.0" for s in range(count))
    return "\n".join((HEADER, *rows, "")).encode()


def table(count: int) -> bytes:
    return "\n".join(("t,lat,lon,h", *(f"{1_000 + s},10.0,20.0,0.7" for s in range(count)), "")).encode()


WRITERS: dict[str, Callable[[int], bytes]] = {"log.nmea": nmea, "log.pos": pos, "log.csv": table}
NAMES = sorted(WRITERS)


def read(folder: Path, name: str, content: bytes) -> list[Measurement] | None:
    """All of a log and what has to hold of any; None if it is refused."""
    path = folder / name
    path.write_bytes(content)
    mapping = None
    if name.endswith("csv"):
        mapping = folder / "mapping.toml"
        mapping.write_text(tomli_w.dumps(MAPPING))
    try:
        log = open_log(path, mapping=mapping)
    except BadInputError:
        return None
    found = list(log.measurements())
    arrived = [each.t_available_ns for each in found]
    assert arrived == sorted(arrived)
    for each in found:
        assert each.columns == log.sensors[each.sensor].columns
        assert each.values.shape == (1, len(each.columns))
        assert not np.isinf(each.values).any()
        assert each.valid.all()
        assert -LATEST_NS <= each.t_ns - each.t_available_ns <= 0
    for info in log.sensors.values():
        assert math.isfinite(info.rate_hz)
        assert info.rate_hz > 0.0
    assert all(count > 0 for count in log.problems.values())
    return found


@given(name=st.sampled_from(NAMES), content=st.binary(max_size=3_000))
@SLOW
def test_random_bytes(name: str, content: bytes, tmp_path: Path) -> None:
    read(tmp_path, name, content)


@given(name=st.sampled_from(NAMES), noise=st.binary(max_size=200), at=st.integers(0, 3_000), cut=st.integers(0, 300))
@SLOW
def test_a_log_with_a_piece_replaced_keeps_the_rest(name: str, noise: bytes, at: int, cut: int, tmp_path: Path) -> None:
    whole = WRITERS[name](40)
    at = at % len(whole)
    found = read(tmp_path, name, whole[:at] + noise + whole[at + cut :])
    if at > 200 and not (name == "log.csv" and b'"' in noise):  # the header and the first epochs are whole
        assert found is not None
        # so many lines can be hit, and one more at each end
        hit = max(cut, len(noise)) // 20 + 2
        hit += noise.count(b"\n") + noise.count(b"\r") + 2
        assert len(found) >= 40 - hit


@given(
    name=st.sampled_from(NAMES), pieces=st.lists(st.tuples(st.integers(0, 4_000), st.integers(0, 1_500)), max_size=6)
)
@SLOW
def test_spliced_logs(name: str, pieces: list[tuple[int, int]], tmp_path: Path) -> None:
    whole = WRITERS[name](40)
    read(tmp_path, name, b"".join(whole[at % len(whole) :][:length] for at, length in pieces))


ABSURD = st.one_of(
    st.floats().map(repr),
    st.integers(-(10**30), 10**30).map(str),
    st.sampled_from(["", "-0", "1e308", "-1e308", "nan", "inf", "0x10", "1_0", "9" * 300, "1e-400", "\u0661", " 1"]),
    st.text(st.characters(codec="ascii", exclude_characters="*$\r\n,"), max_size=12),
)


@given(data=st.data(), kind=st.sampled_from(["gga", "rmc", "vtg", "gst", "gns", "zda", "gll", "gsa", "panda", "paogi"]))
@SLOW
def test_absurd_fields_of_sentences(data: st.DataObject, kind: str, tmp_path: Path) -> None:
    bodies = {
        "gga": gga("000001.00"),
        "rmc": rmc("000001.00"),
        "vtg": vtg(1.0),
        "gst": gst("000001.00"),
        "gns": "GNGNS,000001.00,4404.13,N,12118.87,W,RF,15,0.6,100.0,20.0,1.5,0000",
        "zda": "GNZDA,000001.00,01,04,2026,00,00",
        "gll": "GNGLL,4404.13,N,12118.87,W,000001.00,A,D",
        "gsa": "GNGSA,A,3,,,,,,,,,,,,,1.39,0.70,1.20",
        "panda": "PANDA,000001.00,4404.13,N,12118.87,W,4,12,0.7,100.0,1.0,3.888,900,10,10,0",
        "paogi": "PAOGI,000001.00,4404.13,N,12118.87,W,4,12,0.7,100.0,1.0,3.888,90.0,1.0,1.0,0.0",
    }
    fields = bodies[kind].split(",")
    for index in data.draw(st.sets(st.integers(1, len(fields) - 1), max_size=4)):
        fields[index] = data.draw(ABSURD)
    text = ",".join(fields).encode("utf-8", "replace").decode("latin-1").encode("ascii", "replace").decode()
    found = read(tmp_path, "log.nmea", (framed(gga("000000.00")) + framed(text) + framed(gga("000002.00"))).encode())
    assert found is not None
    times = {each.t_ns for each in found if each.sensor == "gnss"}
    assert {0, 2 * 10**9} <= times


@given(data=st.data(), name=st.sampled_from(["log.pos", "log.csv"]))
@SLOW
def test_absurd_words_of_rows(data: st.DataObject, name: str, tmp_path: Path) -> None:
    separator = "," if name == "log.csv" else " "
    lines = WRITERS[name](6).decode().splitlines()
    words = lines[4].split(separator)
    for index in data.draw(st.sets(st.integers(0, len(words) - 1), max_size=4)):
        words[index] = data.draw(ABSURD)
    lines[4] = separator.join(words)
    found = read(tmp_path, name, "\n".join(lines).encode())
    assert found is not None
    assert {second * 10**9 for second in (0, 1, 2, 4, 5)} <= {each.t_ns for each in found}


def pieces_of(name: str, ending: bytes) -> Iterator[bytes]:
    """Ten million bytes without an end of line between whole parts of a log."""
    yield WRITERS[name](20)
    yield from itertools.repeat(ending, 10_000_000 // len(ending))
    yield b"\n"
    yield WRITERS[name](30)


@pytest.mark.parametrize("ending", [b"\x00" * 1000, b"$GNGGA,1," * 100, b"1,2 " * 250], ids=["zeros", "heads", "words"])
@pytest.mark.parametrize("name", NAMES)
def test_an_endless_line_takes_neither_memory_nor_time(name: str, ending: bytes, tmp_path: Path) -> None:
    path = tmp_path / name
    with path.open("wb") as file:
        file.writelines(pieces_of(name, ending))
    mapping = tmp_path / "mapping.toml"
    mapping.write_text(tomli_w.dumps(MAPPING))
    started = time.perf_counter()
    tracemalloc.start()
    try:
        log = open_log(path, mapping=mapping if name.endswith("csv") else None)
        count = sum(1 for _ in log.measurements())
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert log.problems["too long"] == 1
    assert count >= 30
    assert peak < 2_000_000  # some chunks of 64 kB, and the head
    assert time.perf_counter() - started < 10.0


@pytest.mark.parametrize("name", NAMES)
def test_memory_does_not_grow_with_the_log(name: str, tmp_path: Path) -> None:
    peaks = []
    few = {"log.nmea": 1_000, "log.pos": 2_000, "log.csv": 5_000}[name]
    for count in (few, 4 * few):
        path = tmp_path / name
        path.write_bytes(WRITERS[name](count))
        mapping = tmp_path / "mapping.toml"
        mapping.write_text(tomli_w.dumps(MAPPING))
        tracemalloc.start()
        try:
            log = open_log(path, mapping=mapping if name.endswith("csv") else None)
            assert sum(1 for _ in log.measurements()) == count
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    # a block of 256 epochs is about 0.3 MB; four times the log would be four times the memory
    assert peaks[1] < peaks[0] * 1.2 + 100_000


@pytest.mark.slow
def test_an_hour_at_ten_hertz_is_read_in_seconds(tmp_path: Path) -> None:
    def bodies() -> Iterator[str]:
        for tenth in range(36_000):
            second, when = tenth // 10, tenth % 10
            stamp = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}.{when}0"
            yield from (gga(stamp), rmc(stamp), vtg(2.0), gst(stamp))

    path = tmp_path / "log.nmea"
    with path.open("w") as file:
        file.writelines(map(framed, bodies()))
    started = time.process_time()
    assert sum(1 for _ in open_log(path).measurements()) == 36_000
    # 1.4 s on a desk's machine; pynmeagps alone takes 7 s to parse the 144 000 sentences
    assert time.process_time() - started < 6.0
