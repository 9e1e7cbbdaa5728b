"""Sentences for tests to write down and take apart."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from twin.formats.nmea import framed


def write_log(folder: Path, *bodies: str, name: str = "log.nmea") -> Path:
    """A log of whole sentences, one for each body."""
    path = folder / name
    path.write_bytes("".join(map(framed, bodies)).encode())
    return path


def gga(time: str, *, minutes: str = "04.1300000", quality: int = 4, talker: str = "GN", age: str = "1.0") -> str:
    """A whole GGA at 44 degrees north, 121 west, 120 m above the ellipsoid."""
    if not quality:
        return f"{talker}GGA,{time},,,,,0,03,99.99,,,,,,"
    return f"{talker}GGA,{time},44{minutes},N,12118.8700000,W,{quality},12,0.7,100.0,M,20.0,M,{age},0000"


def rmc(time: str, *, date: str = "010426", knots: str = "3.5", course: str = "45.0", mode: str = "R") -> str:
    """A whole RMC at the same place."""
    return f"GNRMC,{time},A,4404.1300000,N,12118.8700000,W,{knots},{course},{date},,,{mode}"


def vtg(knots: float) -> str:
    """A VTG to the east."""
    return f"GNVTG,90.0,T,,M,{knots:.1f},N,{knots * 1.852:.3f},K,R"


def gst(time: str) -> str:
    """A GST."""
    return f"GNGST,{time},,,,,0.01,0.02,0.03"


GSA = "GNGSA,A,3,,,,,,,,,,,,,1.39,0.70,1.20"


def epochs(count: int, *, first_s: int = 0) -> Iterable[str]:
    """Epochs of GGA, RMC, VTG and GST, once a second after midnight."""
    for second in range(first_s, first_s + count):
        time = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}.00"
        yield from (gga(time), rmc(time), vtg(2.0), gst(time))
