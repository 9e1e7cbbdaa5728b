"""Logs of sentences: what is read from them, put together, put in time, and passed over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pynmeagps import NMEAReader

from twin.formats.logs import open_log
from twin.formats.nmea import KNOT_M_S, framed

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "gpsd_nmea"
REAL = ["foretrex-201", "garmin-10x", "mt3339", "rst39", "skytraq-dgps", "skytraq-fix"]
KNOWN = {"GGA", "RMC", "GST", "VTG", "GSA", "GLL", "ZDA", "GNS"}


def log_of(folder: Path, *bodies: str, raw: bytes = b"") -> Path:
    path = folder / "log.nmea"
    path.write_bytes("".join(framed(body) for body in bodies).encode() + raw)
    return path


def gga(
    time: str, *, latitude: str = "4404.1300000", quality: int = 4, rest: str = "12,0.7,100.0,M,20.0,M,1.0,0000"
) -> str:
    return f"GNGGA,{time},{latitude},N,12118.8700000,W,{quality},{rest}"


@pytest.mark.parametrize("name", REAL)
def test_a_real_log_says_what_pynmeagps_reads_in_it(name: str) -> None:
    path = FOLDER / f"{name}.log"
    if not path.is_file():
        pytest.skip(f"the log {path} is not here")
    log = open_log(path)
    found = list(log.measurements())
    parsed = [
        NMEAReader.parse(line + b"\r\n")
        for line in path.read_bytes().replace(b"\r", b"").split(b"\n")
        if line.startswith(b"$")
    ]
    ggas = {m.time: m for m in parsed if m.msgID == "GGA" and m.time != ""}
    placing = [m.time for m in parsed if m.msgID in {"GGA", "RMC", "GNS", "GLL"} and m.time != ""]
    assert len(found) == len(set(placing))
    for each, time in zip(found, dict.fromkeys(placing), strict=True):
        if time in ggas:
            sentence = ggas[time]
            assert each.column("quality")[0] == sentence.quality
            assert each.column("satellites")[0] == sentence.numSV
            if sentence.quality:
                place = log.origin.geodetic(each.values[0, :3])
                np.testing.assert_allclose(place[:2], [sentence.lat, sentence.lon], atol=1e-9)
                assert place[2] == pytest.approx(sentence.alt + (sentence.sep or 0.0), abs=1e-5)
    assert log.problems["checksum"] == 0
    start = min((m for m in parsed if m.msgID == "RMC" and m.date != "" and m.time != ""), key=lambda m: m.time)
    assert np.datetime64(log.start_utc_ns, "ns") == np.datetime64(f"{start.date}T{start.time}")


def test_speeds_and_courses_are_those_of_rmc(tmp_path: Path) -> None:
    path = log_of(
        tmp_path,
        gga("120000.00"),
        "GNRMC,120000.00,A,4404.13,N,12118.87,W,3.5,45.0,010426,,,R",
        "GNVTG,90.0,T,,M,7.0,N,12.9,K,D",
    )
    (found,) = open_log(path).measurements()
    assert found.column("speed_m_s")[0] == pytest.approx(3.5 * KNOT_M_S)
    assert found.column("course_rad")[0] == pytest.approx(np.pi / 4)
