"""What AgOpenGPS's boards would have sent for a simulated receiver: ``$PANDA``, and ``$PAOGI`` for two antennas.

The sentences and their traps are told in :mod:`twin.formats.panda`. A board takes what its attitude reference said last
when the receiver's sentence arrives; its yaw rate is the change of heading between the last two of those.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from twin.formats.geodetic import Origin, compass_deg
from twin.formats.nmea import framed
from twin.formats.nmea_out import Sample, age, decimal, samples, satellites, speed_and_course, turn
from twin.formats.nmea_style import NmeaStyle
from twin.formats.panda import NO_IMU
from twin.signals import HEADING, NS_PER_S, Measurement

_LARGEST_TENTHS = 32_767
"""AgOpenGPS reads 16 bits."""


class _Board:
    """What an attitude reference said until now, in degrees of the outside world's convention."""

    def __init__(self, measurements: Iterable[Measurement], run: int) -> None:
        self._coming = (each for each in measurements if each.valid[run])
        self._run = run
        self._next = next(self._coming, None)
        self._last: Measurement | None = None
        self.heading = self.roll = self.pitch = math.nan
        self.yaw_rate = 0.0

    def hear(self, until_ns: int) -> None:
        """Take what has arrived by then."""
        while self._next is not None and self._next.t_available_ns <= until_ns:
            self._take(self._next)
            self._next = next(self._coming, None)

    def _take(self, measurement: Measurement) -> None:
        roll, pitch, heading = (
            float(measurement.column(name)[self._run]) for name in ("roll_rad", "pitch_rad", HEADING)
        )
        clockwise = compass_deg(heading)
        if self._last is not None and measurement.t_ns > self._last.t_ns:
            turned = math.remainder(clockwise - self.heading, 360.0)
            self.yaw_rate = turned * NS_PER_S / (measurement.t_ns - self._last.t_ns)
        self.heading, self.roll, self.pitch = clockwise, math.degrees(roll), -math.degrees(pitch)
        self._last = measurement


def _tenths(degrees: float) -> str:
    return "0" if math.isnan(degrees) else str(max(-_LARGEST_TENTHS, min(_LARGEST_TENTHS, round(10.0 * degrees))))


def _head(kind: str, sample: Sample, style: NmeaStyle) -> tuple[str, ...]:
    quality = sample.quality
    hdop = decimal(sample.values["hdop"], style.dop_decimals) if quality else "99.99"
    height = decimal(sample.above_sea_m, style.height_decimals) if quality else ""
    knots, _, _ = speed_and_course(sample, style)
    place = (*sample.latitude, *sample.longitude, str(quality), satellites(sample, style))
    return kind, sample.time, *place, hdop, height, age(sample, style), knots


def panda_sentences(
    receiver: Iterable[Measurement],
    attitude: Iterable[Measurement],
    style: NmeaStyle,
    origin: Origin,
    *,
    run: int = 0,
) -> Iterator[str]:
    """``$PANDA`` of a receiver's measurements, with their ends of line.

    Args:
        receiver: measurements of one simulated receiver, in order of arrival.
        attitude: those of an attitude reference (roll, pitch, heading), in order of arrival; empty without one.
        style: digits of position, speed and the rest, and the date.
        origin: of the local frame.
        run: which of the runs of an ensemble.
    """
    board = _Board(attitude, run)
    for sample in samples(receiver, style, origin, run=run):
        board.hear(sample.t_available_ns)
        if math.isnan(board.heading):
            imu = (str(NO_IMU), "0", "0", "0")
        else:
            heading = str(round(10.0 * board.heading) % 3600)
            imu = (heading, _tenths(board.roll), _tenths(board.pitch), _tenths(board.yaw_rate))
        yield framed(",".join((*_head("PANDA", sample, style), *imu)))


def paogi_sentences(
    receiver: Iterable[Measurement],
    attitude: Iterable[Measurement],
    style: NmeaStyle,
    origin: Origin,
    *,
    run: int = 0,
) -> Iterator[str]:
    """``$PAOGI`` of a receiver with two antennas; arguments as for :func:`panda_sentences`.

    Heading is that of the antennas, and empty where they have none; roll, pitch and yaw rate are the attitude
    reference's, zero without one.
    """
    board = _Board(attitude, run)
    for sample in samples(receiver, style, origin, run=run):
        board.hear(sample.t_available_ns)
        heading = turn(compass_deg(sample.values[HEADING]), 2)
        rest = ("0.00" if math.isnan(value) else f"{value:.2f}" for value in (board.roll, board.pitch, board.yaw_rate))
        yield framed(",".join((*_head("PAOGI", sample, style), heading, *rest)))
