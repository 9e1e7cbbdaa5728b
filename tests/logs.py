"""Logs made up for tests: a receiver on a known track, as the readers of real logs give it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from twin.formats.geodetic import Origin
from twin.signals import NS_PER_S, POSITION, SPEED, Measurement, Mount, SensorInfo

COLUMNS = (*POSITION, SPEED, "course_rad", "sigma_e_m", "sigma_n_m", "sigma_u_m", "quality")
MOUNT = Mount(body="log", xyz_m=(0.0, 0.0, 0.0))
ORIGIN = Origin(latitude_deg=52.0, longitude_deg=13.0, height_m=40.0)
DATA = Path(__file__).parents[2] / "shared" / "data"
"""Real logs, read in place where they lie."""


def receiver(rate_hz: float = 1.0, name: str = "gnss") -> SensorInfo:
    """A receiver at the antenna."""
    return SensorInfo(name=name, kind="gnss", columns=COLUMNS, mount=MOUNT, rate_hz=rate_hz)


def fix(
    t_s: float,
    east_m: float,
    north_m: float,
    *,
    speed_m_s: float = math.nan,
    course_rad: float = math.nan,
    up_m: float = 0.0,
    sigma_m: float = 1.0,
    quality: float = 1.0,
    valid: bool = True,
) -> Measurement:
    """One sample of it."""
    values = [east_m, north_m, up_m, speed_m_s, course_rad, sigma_m, sigma_m, sigma_m, quality]
    t_ns = round(t_s * NS_PER_S)
    return Measurement(
        sensor="gnss",
        t_ns=t_ns,
        t_available_ns=t_ns,
        columns=COLUMNS,
        values=np.array([values]),
        valid=np.array([valid]),
    )


class MadeUpLog:
    """A :class:`twin.formats.log.Log` of given measurements."""

    def __init__(
        self,
        measurements: Iterable[Measurement],
        *,
        sensors: Iterable[SensorInfo] | None = None,
        origin: Origin = ORIGIN,
        start_utc_ns: int | None = 1_600_000_000 * NS_PER_S,
        name: str = "made_up",
    ) -> None:
        self.path = Path(f"{name}.log")
        self.origin = origin
        self.start_utc_ns = start_utc_ns
        self.problems: Counter[str] = Counter()
        self.sensors: Mapping[str, SensorInfo] = {info.name: info for info in sensors or [receiver()]}
        self._measurements = measurements

    def measurements(self) -> Iterator[Measurement]:
        """As given."""
        yield from self._measurements
