"""What a recorded log of the outside world is to the rest of the house: sensors, and measurements in order of arrival.

A log is read once, from its beginning to its end, in memory that does not grow with it. What cannot be used is passed
over and counted, and what is good around it is kept.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Protocol

from twin.formats.geodetic import Origin
from twin.signals import Measurement, SensorInfo


class Log(Protocol):
    """A log that has been opened and whose beginning has been looked at."""

    @property
    def path(self) -> Path:
        """The file it is read from."""

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """What the log has measurements of, with the columns of the simulated sensors of the same kind."""

    @property
    def origin(self) -> Origin:
        """Of the local frame; the log's first position, unless told."""

    @property
    def start_utc_ns(self) -> int | None:
        """Time zero of the measurements, ns since 1970 (UTC); None where the log does not know its date."""

    @property
    def problems(self) -> Counter[str]:
        """How many lines were passed over until now, by kind of trouble."""

    def measurements(self) -> Iterator[Measurement]:
        """Measurements of one run (R = 1) in order of arrival; times are ns since the log's first epoch.

        May be called once. Never raises for what the log holds.
        """
