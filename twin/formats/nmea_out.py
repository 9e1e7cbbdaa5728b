"""What a simulated receiver would have sent: NMEA 0183 sentences of its samples, in order of arrival.

Digits are rounded as a receiver rounds: a time, an angle or a minute that rounds up to the next whole carries over, so
that nothing ever reads 60.00 s, 60.0000000 minutes or 360.00 degrees. What a receiver does not know is an empty field.
Without a position all but time, quality, satellites and HDOP (99.99) are empty. The course at standstill is as much
garbage as the receiver's own.

pynmeagps is no help in writing them: it fills in the present time, leaves units out, and has no choice of digits but
two of the position.
"""

from __future__ import annotations

import datetime as dt
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from twin.fix_quality import RTK_FIXED, RTK_FLOAT, WITH_CORRECTIONS
from twin.formats.geodetic import Origin, compass_deg
from twin.formats.nmea import KMH_M_S, KNOT_M_S, framed
from twin.formats.nmea_style import NmeaStyle
from twin.signals import NS_PER_S, POSITION, FloatArray, Measurement

_BLOCK = 1024
_LETTERS = {0: "N", 1: "A", 2: "D", 3: "P", 4: "R", 5: "F", 6: "E", 7: "M", 8: "S"}
_DAY_S = 86_400


class Sample(NamedTuple):
    """One sample of a receiver, in the outside world's terms; NaN for what it does not know."""

    time: str
    """hhmmss.ss"""
    date: str
    """ddmmyy"""
    quality: int
    latitude: tuple[str, str]
    """ddmm.mmmm and its side; empty without a position."""
    longitude: tuple[str, str]
    values: Mapping[str, float]
    """By column of the simulated receiver."""
    above_sea_m: float
    geoid_m: float
    compass_deg: float
    t_available_ns: int


def samples(measurements: Iterable[Measurement], style: NmeaStyle, origin: Origin, *, run: int = 0) -> Iterator[Sample]:
    """Samples of a receiver that arrived, in one run, in the order they are given in; lost ones leave nothing."""
    stream = (each for each in measurements if each.valid[run])
    while block := list(itertools.islice(stream, _BLOCK)):
        rows = np.array([each.values[run] for each in block])
        places = [block[0].columns.index(column) for column in POSITION]
        geodetic = origin.geodetic(rows[:, places])
        for each, row, place in zip(block, rows, geodetic, strict=True):
            yield _sample(each, row, place, style, origin)


def _sample(measurement: Measurement, row: FloatArray, place: FloatArray, style: NmeaStyle, origin: Origin) -> Sample:
    values = dict(zip(measurement.columns, row.tolist(), strict=True))
    time, date = _time(measurement.t_ns + style.start_utc_ns, style.time_decimals)
    latitude, longitude, height = place.tolist()
    quality = 0 if math.isnan(latitude) or math.isnan(values["quality"]) else round(values["quality"])
    return Sample(
        time=time,
        date=date,
        quality=quality,
        latitude=_angle(latitude, "NS", 2, style.minute_decimals) if quality else ("", ""),
        longitude=_angle(longitude, "EW", 3, style.minute_decimals) if quality else ("", ""),
        values=values,
        above_sea_m=height - origin.geoid_height_m,
        geoid_m=origin.geoid_height_m,
        compass_deg=compass_deg(values["course_rad"]),
        t_available_ns=measurement.t_available_ns,
    )


def _time(utc_ns: int, decimals: int) -> tuple[str, str]:
    step = NS_PER_S // 10**decimals
    ticks = (utc_ns + step // 2) // step
    seconds, fraction = divmod(ticks, 10**decimals)
    days, second = divmod(seconds, _DAY_S)
    clock = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}"
    date = dt.date(1970, 1, 1) + dt.timedelta(days=days)
    return clock + (f".{fraction:0{decimals}d}" if decimals else ""), f"{date:%d%m%y}"


def _angle(degrees: float, sides: str, whole: int, decimals: int) -> tuple[str, str]:
    per_minute = 10**decimals
    minutes, fraction = divmod(round(abs(degrees) * 60.0 * per_minute), per_minute)
    text = f"{minutes // 60:0{whole}d}{minutes % 60:02d}.{fraction:0{decimals}d}"
    return text, sides[1] if degrees < 0.0 else sides[0]


def decimal(value: float, decimals: int) -> str:
    """A number with so many decimals; empty if unknown."""
    return "" if math.isnan(value) else f"{value:.{decimals}f}"


def turn(degrees: float, decimals: int) -> str:
    """An angle from zero to less than a turn, also when rounded."""
    if math.isnan(degrees):
        return ""
    scale = 10**decimals
    return f"{round(degrees * scale) % (360 * scale) / scale:.{decimals}f}"


def _mode(sample: Sample, style: NmeaStyle) -> str:
    if sample.quality in {RTK_FIXED, RTK_FLOAT} and not style.rtk_modes:
        return "D"
    return _LETTERS[sample.quality]


def satellites(sample: Sample, style: NmeaStyle) -> str:
    """How many are in use, two digits."""
    count = sample.values["satellites"]
    return "" if math.isnan(count) else f"{min(round(count), style.most_satellites):02d}"


def age(sample: Sample, style: NmeaStyle) -> str:
    """Age of the corrections."""
    return decimal(sample.values["age_s"], style.age_decimals) if sample.quality else ""


def _gga(sample: Sample, style: NmeaStyle) -> str:
    place = (sample.time, *sample.latitude, *sample.longitude, str(sample.quality), satellites(sample, style))
    if not sample.quality:
        return ",".join(("GGA", *place, "99.99", "", "", "", "", "", ""))
    height = decimal(sample.above_sea_m, style.height_decimals)
    geoid = decimal(sample.geoid_m, style.height_decimals)
    station = f"{style.station:04d}" if sample.quality in WITH_CORRECTIONS else ""
    hdop = decimal(sample.values["hdop"], style.dop_decimals)
    return ",".join(("GGA", *place, hdop, height, "M", geoid, "M", age(sample, style), station))


def speed_and_course(sample: Sample, style: NmeaStyle) -> tuple[str, str, str]:
    """Speed in knots, speed in km/h, course; empty without a position."""
    if not sample.quality:
        return "", "", ""
    speed = sample.values["speed_m_s"]
    return (
        decimal(speed / KNOT_M_S, style.speed_decimals),
        decimal(speed / KMH_M_S, style.speed_decimals),
        turn(sample.compass_deg, style.course_decimals),
    )


def _rmc(sample: Sample, style: NmeaStyle) -> str:
    knots, _, course = speed_and_course(sample, style)
    status = "A" if sample.quality else "V"
    place = (*sample.latitude, *sample.longitude)
    return ",".join(("RMC", sample.time, status, *place, knots, course, sample.date, "", "", _mode(sample, style)))


def _vtg(sample: Sample, style: NmeaStyle) -> str:
    knots, kmh, course = speed_and_course(sample, style)
    return ",".join(("VTG", course, "T", "", "M", knots, "N", kmh, "K", _mode(sample, style)))


def _gst(sample: Sample, style: NmeaStyle) -> str:
    sigmas = (sample.values[f"sigma_{axis}_m"] if sample.quality else math.nan for axis in "neu")
    return ",".join(("GST", sample.time, "", "", "", "", *(decimal(sigma, style.sigma_decimals) for sigma in sigmas)))


def _gsa(sample: Sample, style: NmeaStyle) -> str:
    numbers = ("",) * 12
    if not sample.quality:
        return ",".join(("GSA", "A", "1", *numbers, "99.99", "99.99", "99.99"))
    hdop, vdop = sample.values["hdop"], sample.values["vdop"]
    dops = (decimal(dop, style.dop_decimals) for dop in (math.hypot(hdop, vdop), hdop, vdop))
    return ",".join(("GSA", "A", "3", *numbers, *dops))


_BODIES: Mapping[str, Callable[[Sample, NmeaStyle], str]] = {
    "GGA": _gga,
    "RMC": _rmc,
    "VTG": _vtg,
    "GST": _gst,
    "GSA": _gsa,
}


def nmea_sentences(
    measurements: Iterable[Measurement], style: NmeaStyle, origin: Origin, *, run: int = 0
) -> Iterator[str]:
    """Sentences, with their ends of line, of a receiver's measurements.

    Args:
        measurements: of one simulated receiver, in order of arrival.
        style: which sentences, and their digits.
        origin: of the local frame.
        run: which of the runs of an ensemble.
    """
    for sample in samples(measurements, style, origin, run=run):
        for kind in style.sentences:
            yield framed(style.talker + _BODIES[kind](sample, style))
