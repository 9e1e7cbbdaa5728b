"""Solution files of RTKLIB (``.pos``): an epoch a line, in columns that the last line of the header names.

Time is GPST, UTC or JST, as week and seconds or as a date; a position is latitude and longitude (degrees, or degrees,
minutes and seconds) with the ellipsoidal height, or x, y, z. GPS time is ahead of UTC by the leap seconds since 1980.
Baselines (east, north, up) have no place on the globe and are not read.

Heights may be above the sea ("geodetic" in the header) instead of above the ellipsoid. The geoid is not in the file:
such heights are taken for the ellipsoid's, as those of sentences without a separation are, and ``ABOVE_SEA`` is
counted once for each header that says so. In the plane, 10 m of geoid are 1.6 mm a kilometre.

RTKLIB's Q is not NMEA's quality: 1 fixed is 4, 2 float is 5, 3 SBAS and 4 differential are 2, 5 single is 1, 6 PPP is 3
(NMEA's "precise"), 7 dead reckoning is 6, 0 none is 0. Its age is that of the corrections; of ratio and covariances
no use is made, nor of the sigmas and velocities of x, y, z.

Source: RTKLIB manual, version 2.4.2, appendix B.1; the header's words for heights: its solution.c.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import pymap3d

from twin.errors import BadInputError
from twin.formats.bad_lines import MISSING, NO_HEADER, NOT_A_NUMBER, OUT_OF_RANGE, BadLineError, number, whole
from twin.formats.dates import day_of, require_dated
from twin.formats.geodetic import Origin
from twin.formats.gnss_fixes import Fix, at, measurements
from twin.formats.gps_time import UNIX_OF_GPS_S, leap_seconds
from twin.formats.lines import lines_of
from twin.formats.log_clock import LogClock
from twin.formats.log_head import LogHead, origin_of, receiver_info
from twin.signals import NS_PER_S, Measurement, SensorInfo

QUALITIES = {0: 0, 1: 4, 2: 5, 3: 2, 4: 2, 5: 1, 6: 3, 7: 6}
ABOVE_SEA = "heights above an unknown geoid"
_WEEK_S = 604_800
_GEODETIC = (b"lat/lon/height=", b"/geodetic")
"""Of the header's line that says that heights are above the sea: its begin, and what tells so."""
_PLACES = {
    ("latitude(deg)", "longitude(deg)", "height(m)"): (3, "degrees"),
    ("latitude(d'\")", "longitude(d'\")", "height(m)"): (7, "sexagesimal"),
    ("x-ecef(m)", "y-ecef(m)", "z-ecef(m)"): (3, "ecef"),
}
"""Names of the position's columns: how many numbers, and of what sort."""
_REST = ("q", "ns", "sdn(m)", "sde(m)", "sdu(m)", "age(s)", "vn(m/s)", "ve(m/s)")

Place = tuple[float, float, float]


def _names(header: str) -> list[str]:
    """Words of a header's line, whatever separates them."""
    return header.lstrip("%").replace(",", " ").replace(";", " ").lower().split()


class _Layout:
    """What the columns of a file are, by its header."""

    def __init__(self, header: str) -> None:
        names = _names(header)
        self.ahead_s = {"utc": 0, "jst": 9 * 3600}.get(names[0])
        for columns, (count, sort) in _PLACES.items():
            if tuple(names[1:4]) == columns:
                self.count, self.sort = count, sort
                break
        else:
            raise BadLineError(NO_HEADER)
        rest = names[4:]
        self.index = {name: 2 + self.count + rest.index(name) for name in _REST if name in rest}
        if "q" not in self.index:
            raise BadLineError(NO_HEADER)
        self.least = self.index["q"] + 1
        self.place = _READERS[self.sort]


def _checked(latitude: float, longitude: float, height: float) -> Place:
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 360.0 and abs(height) <= 1e5):
        raise BadLineError(OUT_OF_RANGE)
    return latitude, longitude, height


def _degrees(numbers: Sequence[float]) -> Place:
    return _checked(numbers[0], numbers[1], numbers[2])


def _sexagesimal(numbers: Sequence[float]) -> Place:
    angles = []
    for degrees, minutes, seconds in (numbers[:3], numbers[3:6]):
        if not (0.0 <= minutes < 60.0 and 0.0 <= seconds <= 60.0):
            raise BadLineError(OUT_OF_RANGE)
        angles.append(math.copysign(abs(degrees) + minutes / 60.0 + seconds / 3600.0, degrees))
    return _checked(angles[0], angles[1], numbers[6])


def _ecef(numbers: Sequence[float]) -> Place:
    if not 6.3e6 <= math.hypot(*numbers) <= 6.5e6:
        raise BadLineError(OUT_OF_RANGE)
    latitude, longitude, height = pymap3d.ecef2geodetic(*numbers)
    return _checked(float(latitude), float(longitude), float(height))


_READERS: dict[str, Callable[[Sequence[float]], Place]] = {
    "degrees": _degrees,
    "sexagesimal": _sexagesimal,
    "ecef": _ecef,
}


def _time_ns(first: bytes, second: bytes, ahead_s: int | None) -> int:
    """UTC, ns since 1970, of the two words of time; ``ahead_s`` is by how much they are ahead of UTC, None for GPST."""
    if b"/" in first:
        date, (clock, _, fraction) = first.split(b"/"), second.partition(b".")
        parts = clock.split(b":")
        if len(date) != 3 or len(parts) != 3:
            raise BadLineError(NOT_A_NUMBER)
        hours, minutes, seconds = map(whole, parts)
        if hours > 23 or minutes > 59 or seconds > 60:
            raise BadLineError(OUT_OF_RANGE)
        told_s = 86_400 * day_of(*map(whole, date)) + 3_600 * hours + 60 * minutes + seconds
    else:
        seconds_text, _, fraction = second.partition(b".")
        told_s = UNIX_OF_GPS_S + whole(first) * _WEEK_S + whole(seconds_text)
    part = whole(fraction.ljust(9, b"0")[:9]) if fraction else 0
    require_dated(told_s * NS_PER_S)
    return (told_s - (leap_seconds(told_s) if ahead_s is None else ahead_s)) * NS_PER_S + part


class _Row:
    """One epoch's line, read by a layout."""

    def __init__(self, line: bytes, layout: _Layout) -> None:
        words = line.replace(b",", b" ").replace(b";", b" ").split()
        if len(words) < layout.least:
            raise BadLineError(MISSING)
        self.utc_ns = _time_ns(words[0], words[1], layout.ahead_s)
        self._words = words
        self._index = layout.index
        place = layout.place([number(word) for word in words[2 : 2 + layout.count]])
        quality = QUALITIES.get(int(self._told("q", -1.0, 99.0)))
        if quality is None:
            raise BadLineError(OUT_OF_RANGE)
        north, east = self._told("vn(m/s)", -1e3, 1e3), self._told("ve(m/s)", -1e3, 1e3)
        self.fix = Fix(
            0,
            0,
            *(place if quality else (math.nan, math.nan, math.nan)),
            speed_m_s=math.hypot(north, east),
            course_deg=math.degrees(math.atan2(east, north)) % 360.0,
            sigma_e_m=self._told("sde(m)", 0.0, 1e7),
            sigma_n_m=self._told("sdn(m)", 0.0, 1e7),
            sigma_u_m=self._told("sdu(m)", 0.0, 1e7),
            quality=quality,
            satellites=self._told("ns", 0, 999),
            age_s=abs(self._told("age(s)", -1e6, 1e6)),
        )

    def _told(self, name: str, low: float, high: float) -> float:
        """A column; NaN where the file has none."""
        index = self._index.get(name)
        if index is None or index >= len(self._words):
            return math.nan
        return number(self._words[index], low, high)


class RtklibLog:
    """A solution of RTKLIB; see :class:`twin.formats.log.Log`. Its one sensor is ``gnss``.

    Dilutions of precision are not told (NaN), nor is a speed unless the solution has velocities. An epoch arrives when
    it is measured.

    Args:
        path: the file, which has to be there.
        origin: of the local frame; the first position if None.

    Raises:
        BadInputError: there is no epoch with a position in it, or it begins far from ``origin``.
    """

    def __init__(self, path: Path, *, origin: Origin | None = None) -> None:
        self.path = path
        self.problems: Counter[str] = Counter()
        unused: Counter[str] = Counter()
        clock: LogClock[Fix] = LogClock(unused)
        self.start_utc_ns: int | None = None
        head = LogHead()
        for fix in self._fixes(clock, unused):
            head.take(fix)
            if not head.whole:
                self.start_utc_ns = clock.start_utc_ns
            if head.looked_far or (head.whole and head.best_there_is):
                break
        if not head.fixes:
            kinds = ", ".join(f"{count} {kind}" for kind, count in unused.most_common(5))
            raise BadInputError(f"{path}: no epoch has a position ({kinds or 'nothing at all'})")
        self.origin = origin_of(head.fixes, origin, path=path)
        info = receiver_info([fix.t_ns for fix in head.fixes], head.best)
        self.sensors: Mapping[str, SensorInfo] = {info.name: info}

    def measurements(self) -> Iterator[Measurement]:
        """Measurements in order of arrival; once."""
        return measurements(self._fixes(LogClock(self.problems), self.problems), self.origin)

    def _fixes(self, clock: LogClock[Fix], problems: Counter[str]) -> Iterator[Fix]:
        layout: _Layout | None = None
        for line in lines_of(self.path, problems):
            try:
                if line.startswith(b"%"):
                    if _tells_geodetic(line):
                        problems[ABOVE_SEA] += 1
                    layout = _layout(line) or layout
                    continue
                row = _row(line, layout)
            except BadLineError as error:
                problems[error.kind] += 1
                continue
            for placed in clock.put_absolute(row.fix, row.utc_ns):
                yield at(placed)
        for placed in clock.finish():
            yield at(placed)


def _row(line: bytes, layout: _Layout | None) -> _Row:
    if layout is None:
        raise BadLineError(NO_HEADER)
    return _Row(line, layout)


def _tells_geodetic(line: bytes) -> bool:
    """Whether a header's line says that heights are above the sea."""
    begin, end = _GEODETIC
    return line.lstrip(b"% (").startswith(begin) and end in line


def _layout(line: bytes) -> _Layout | None:
    """The layout that a header's line tells; None for its other lines."""
    header = line.decode("ascii", "replace")
    names = _names(header)
    return _Layout(header) if len(names) > 4 and names[0] in {"gpst", "utc", "jst"} else None
