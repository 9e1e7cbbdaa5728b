"""Logs of receivers' sentences (NMEA 0183), as one writes them from a serial line."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from twin.errors import BadInputError
from twin.formats.geodetic import Origin
from twin.formats.gnss_fixes import UNKNOWN_MOUNT, Fix, measurements
from twin.formats.lines import lines_of
from twin.formats.log_clock import LogClock, Placed
from twin.formats.log_head import HEAD_EPOCHS, LogHead, origin_of, rate_hz, receiver_info
from twin.formats.nmea_epoch import Epoch
from twin.formats.nmea_epochs import epochs
from twin.signals import HEADING, YAW_RATE, Measurement, SensorInfo

AHRS, YAW_GYRO = "ahrs", "yaw_gyro"
AHRS_COLUMNS = (
    "roll_rad",
    "pitch_rad",
    HEADING,
    "free_accel_e_m_s2",
    "free_accel_n_m_s2",
    "free_accel_u_m_s2",
)
"""Those of :class:`twin.sensors.ahrs.Ahrs`; a board's sentences have no accelerations."""

NOT_ANNOUNCED = "attitude not announced"
"""Of a board whose IMU first speaks when the log's sensors have been told already."""

Attitude = tuple[float, float, float, float]
Spoken = tuple[Fix, Attitude | None]


class NmeaLog:
    """A log of sentences of any talkers, ``$PANDA`` and ``$PAOGI`` among them; see :class:`twin.formats.log.Log`.

    Sensors are ``gnss`` and, where a board's IMU speaks in what is looked at of the log, ``ahrs`` and ``yaw_gyro``.
    Dates come from RMC and ZDA, in epochs with a position: without one, a receiver may say the right time of day and a
    wrong date. Later dates that agree on another day date the log within its head (``HEAD_EPOCHS``); behind that, its
    date has been told, and those before are only counted. An epoch arrives when it is measured: sentences do not say
    when they were sent.

    Heights are above the ellipsoid, by the separation from the sea that was told last. Before the first, it is the
    first that the head of the log has; zero if it has none: heights are then those above the sea.

    Args:
        path: the file, which has to be there.
        origin: of the local frame; the first position if None.

    Raises:
        BadInputError: no sentence in it has a position with a time, or it begins far from ``origin``.
    """

    def __init__(self, path: Path, *, origin: Origin | None = None) -> None:
        self.path = path
        self.problems: Counter[str] = Counter()
        self.start_utc_ns: int | None = None
        self._separation_m = 0.0
        head, turned_ns = self._look()
        if math.isnan(head.fixes[0].geoid_m) and (later := _first_separation(head)):
            self._separation_m = later
            head, turned_ns = self._look()
        self.origin = origin_of(head.fixes, origin, path=path)
        self.sensors: Mapping[str, SensorInfo] = {info.name: info for info in _infos(head, turned_ns)}

    def _look(self) -> tuple[LogHead, list[int]]:
        """The head of the log, and when the IMU spoke at first; finds the log's date on the way."""
        unused: Counter[str] = Counter()
        clock: LogClock[Epoch] = LogClock(unused)
        head, turned_ns = LogHead(), list[int]()
        for fix, attitude in _placed(self._epochs(unused), clock):
            head.take(fix)
            if attitude is not None and len(turned_ns) < HEAD_EPOCHS:
                turned_ns.append(fix.t_ns)
            # Behind the head a clock that is set anew is another log's, which has been joined.
            if not head.whole or self.start_utc_ns is None:
                self.start_utc_ns = clock.start_utc_ns
            if head.looked_far or (head.whole and head.best_there_is and len(turned_ns) == HEAD_EPOCHS):
                break
        if not head.fixes:
            kinds = ", ".join(f"{count} {kind}" for kind, count in unused.most_common(5))
            raise BadInputError(f"{self.path}: no sentence has a position with a time ({kinds or 'nothing at all'})")
        return head, turned_ns

    def _epochs(self, problems: Counter[str]) -> Iterator[Epoch]:
        return epochs(lines_of(self.path, problems), problems, separation_m=self._separation_m)

    def measurements(self) -> Iterator[Measurement]:
        """Measurements in order of arrival; once."""
        return measurements(self._items(LogClock(self.problems)), self.origin)

    def _items(self, clock: LogClock[Epoch]) -> Iterator[Fix | Measurement]:
        for fix, attitude in _placed(self._epochs(self.problems), clock):
            yield fix
            if attitude is None:
                continue
            if AHRS in self.sensors:
                yield from _imu(fix, attitude)
            else:
                self.problems[NOT_ANNOUNCED] += 1


def _first_separation(head: LogHead) -> float:
    return next((fix.geoid_m for fix in head.fixes if not math.isnan(fix.geoid_m)), 0.0)


def _placed(found: Iterator[Epoch], clock: LogClock[Epoch]) -> Iterator[Spoken]:
    for epoch in found:
        for placed in clock.put(epoch, epoch.time_of_day_ns, epoch.day if epoch.quality else None):
            yield _fix(placed), placed.item.attitude
    for placed in clock.finish():
        yield _fix(placed), placed.item.attitude


def _fix(placed: Placed[Epoch]) -> Fix:
    epoch = placed.item
    return Fix(
        placed.t_ns,
        placed.t_available_ns,
        epoch.latitude_deg,
        epoch.longitude_deg,
        epoch.height_m,
        epoch.speed_m_s,
        epoch.course_deg,
        epoch.sigma_e_m,
        epoch.sigma_n_m,
        epoch.sigma_u_m,
        epoch.quality,
        epoch.satellites,
        epoch.hdop,
        epoch.vdop,
        epoch.age_s,
        epoch.geoid_m,
    )


def _imu(fix: Fix, attitude: Attitude) -> Iterator[Measurement]:
    roll, pitch, heading, yaw_rate = attitude
    told = {AHRS: (AHRS_COLUMNS, [roll, pitch, heading, *[math.nan] * 3]), YAW_GYRO: ((YAW_RATE,), [yaw_rate])}
    for sensor, (columns, values) in told.items():
        yield Measurement(
            sensor=sensor,
            t_ns=fix.t_ns,
            t_available_ns=fix.t_available_ns,
            columns=columns,
            values=np.array([values]),
            valid=np.ones(1, dtype=np.bool_),
        )


def _infos(head: LogHead, turned_ns: list[int]) -> Iterator[SensorInfo]:
    yield receiver_info([fix.t_ns for fix in head.fixes], head.best)
    if turned_ns:
        rate = rate_hz(turned_ns)
        for name, columns in ((AHRS, AHRS_COLUMNS), (YAW_GYRO, (YAW_RATE,))):
            yield SensorInfo(name=name, kind=name, columns=columns, mount=UNKNOWN_MOUNT, rate_hz=rate)
