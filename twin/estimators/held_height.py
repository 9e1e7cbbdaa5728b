"""The height a GNSS receiver told last, held until it tells another (paper 002, section 3.1: each output five times).

    height = position_u - (antenna above the reference frame, the machine level) - design height

It counts as current from when it arrives, however late that is. In RTK the machine's tilt is not taken out: an antenna
h above the frame is h (1 - cos d) too low at a tilt of d, 3 mm for 2 m and 3 degrees.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import Config, Names, Positive
from twin.errors import BadInputError
from twin.estimators.roles import column_places, mount_arm, pick_sensors, usable
from twin.signals import BoolArray, EstimatorSetup, FloatArray, IntArray, Measurement, SensorInfo

AHRS = "ahrs"
FREE_ACCELERATION_UP = "free_accel_u_m_s2"
GNSS_COLUMNS = ("position_u_m", "sigma_u_m", "quality", "age_s")

_NEVER = np.iinfo(np.int64).min


class HeightConfig(Config):
    """What the published height estimators are told."""

    sensors: Names
    """The GNSS receiver, and the AHRS where the estimator uses one."""
    rate_hz: Positive = 50.0
    """Output rate."""
    zero: Literal["design", "start"] = "design"
    """Where GNSS heights are counted from: the design plane, or as in the paper the first height told, at which the
    reference frame is said to be ``start_height_m``. The first height's error then stands in all that follow."""
    start_height_m: float = 0.0
    """Height above the design plane at the start, where heights are counted from it."""


def the_sensors(setup: EstimatorSetup, kinds: tuple[str, ...], *, estimator: str) -> dict[str, SensorInfo]:
    """The one sensor of each kind.

    Raises:
        BadInputError: none or two of a kind, or a sensor of another kind.
    """
    picked = pick_sensors(setup, kinds, estimator=estimator)
    for kind, infos in picked.items():
        if len(infos) != 1:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors = {list(setup.sensors)}: {estimator} needs exactly one sensor of "
                f"kind {kind!r}"
            )
    return {kind: infos[0] for kind, infos in picked.items()}


class HeldHeight:
    """The newest height and what the receiver said of it, for R runs.

    A sample older than the one held (it overtook on the way) is ignored. Without a position (quality 0) the height is
    held and the quality taken; without any sample everything is held.

    Raises:
        BadInputError: the receiver lacks a column, or its antenna sits on another body than the reference frame.
    """

    def __init__(self, info: SensorInfo, setup: EstimatorSetup, config: HeightConfig) -> None:
        self.sensor = info.name
        self._places = column_places(info, GNSS_COLUMNS, setup=setup)
        below_m = mount_arm(info, setup)[2] + setup.design_height_m
        runs = setup.runs
        self._from_start = config.zero == "start"
        self._start_height_m = config.start_height_m
        self._zero: FloatArray = np.full(runs, below_m)
        self._newest_ns: IntArray = np.full(runs, _NEVER, dtype=np.int64)
        self.known: BoolArray = np.zeros(runs, dtype=np.bool_)
        """(R,) whether there was a height yet."""
        self.height: FloatArray = np.full(runs, np.nan)
        """(R,) above the design plane, m."""
        self.sigma: FloatArray = np.full(runs, np.nan)
        """(R,) its standard deviation as the receiver tells it, m."""
        self.quality: FloatArray = np.zeros(runs)
        """(R,) NMEA quality."""
        self.age: FloatArray = np.full(runs, np.nan)
        """(R,) age of the corrections in the newest sample, s; NaN where the receiver tells none."""

    def take(self, measurement: Measurement) -> None:
        """Take a sample of the receiver."""
        values = measurement.values[:, self._places]
        told = measurement.valid & (measurement.t_ns > self._newest_ns)
        self._newest_ns = np.where(told, measurement.t_ns, self._newest_ns)
        there = told & usable(measurement, values[:, :1])
        if self._from_start:
            first = there & ~self.known
            self._zero = np.where(first, values[:, 0] - self._start_height_m, self._zero)
        self.height = np.where(there, values[:, 0] - self._zero, self.height)
        self.sigma = np.where(there, values[:, 1], self.sigma)
        self.quality = np.where(told, values[:, 2], self.quality)
        self.age = np.where(told, values[:, 3], self.age)
        self.known = self.known | there
