"""One speed sensor and nothing else: every row unit gets the speed it last gave.

Kind ``radar_only`` is today's practice (paper 000, sections 2.1 and 4.2.2). Kind ``gnss_speed_only`` is the same with a
GNSS receiver's speed, to be seen beside it (section 4.6.3).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import Config, Names, Positive
from twin.errors import BadInputError
from twin.estimators.roles import GNSS, RADAR, SPEED_COLUMN, column_places, pick_sensors, usable
from twin.signals import SPEED, Estimate, EstimatorSetup, Measurement, row_speed


class RadarOnlyConfig(Config):
    """Options of :class:`SpeedOnly` with a radar."""

    kind: Literal["radar_only"]
    sensors: Names
    """The name of the one radar."""
    rate_hz: Positive = 50.0
    """Output rate."""


class GnssSpeedOnlyConfig(Config):
    """Options of :class:`SpeedOnly` with a GNSS receiver."""

    kind: Literal["gnss_speed_only"]
    sensors: Names
    """The name of the one receiver."""
    rate_hz: Positive = 50.0
    """Output rate."""


_SENSOR_KINDS = {"radar_only": RADAR, "gnss_speed_only": GNSS}


class SpeedOnly:
    """Holds the newest reading, 0 before the first, and gives it to the machine and to every row unit.

    Columns: ``speed_m_s`` and the row speeds; position and heading are not estimated. Sigmas are NaN: a seed meter
    driven by a speed sensor has no notion of its error, and the data sheet says nothing about a row unit in a turn.
    A sample older than the one held (late, out of order) is ignored.

    Raises:
        BadInputError: not exactly one sensor, one of another kind, or one without a speed.
    """

    state_columns: tuple[str, ...] = ()

    def __init__(self, config: RadarOnlyConfig | GnssSpeedOnlyConfig, setup: EstimatorSetup) -> None:
        wanted = _SENSOR_KINDS[config.kind]
        sensors = pick_sensors(setup, (wanted,), estimator=config.kind)[wanted]
        if len(sensors) != 1:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors = {list(config.sensors)}: {config.kind} needs exactly one {wanted}"
            )
        self._places = column_places(sensors[0], (SPEED_COLUMN,), setup=setup)
        self._sensor = sensors[0].name
        self._newest_ns: int | None = None
        self._speed = np.zeros((setup.runs, 1))
        self.columns: tuple[str, ...] = (
            SPEED,
            *(row_speed(number) for number in range(1, len(setup.rows_y_m) + 1)),
        )
        self._sigmas = np.full((setup.runs, len(self.columns)), np.nan)

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        stale = self._newest_ns is not None and measurement.t_ns <= self._newest_ns
        if measurement.sensor != self._sensor or stale:
            return
        self._newest_ns = measurement.t_ns
        speed = measurement.values[:, self._places]
        self._speed = np.where(usable(measurement, speed)[:, np.newaxis], speed, self._speed)

    def estimate(self, t_ns: int) -> Estimate:
        """Return the held speed for the machine and every row unit."""
        return Estimate(t_ns=t_ns, values=np.repeat(self._speed, len(self.columns), axis=1), sigmas=self._sigmas)
