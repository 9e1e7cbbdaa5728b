"""Today's practice: every row unit gets the radar's speed (paper 000, sections 2.1 and 4.2.2; kind ``radar_only``)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import Config, Names, Positive
from twin.errors import BadInputError
from twin.estimators.roles import RADAR, SPEED_COLUMN, column_places, pick_sensors, usable
from twin.signals import SPEED, Estimate, EstimatorSetup, Measurement, row_speed

KIND = "radar_only"


class RadarOnlyConfig(Config):
    """Options of :class:`RadarOnly`."""

    kind: Literal["radar_only"]
    sensors: Names
    """The name of the one radar."""
    rate_hz: Positive = 50.0
    """Output rate."""


class RadarOnly:
    """Holds the newest radar reading, 0 before the first, and gives it to the machine and to every row unit.

    Columns: ``speed_m_s`` and the row speeds; position and heading are not estimated. Sigmas are NaN: a seed meter
    driven by the radar has no notion of its error, and the radar's data sheet says nothing about a row unit in a turn.
    A sample older than the one held (late, out of order) is ignored.

    Raises:
        BadInputError: not exactly one sensor, one that is not a radar, or one without a speed.
    """

    state_columns: tuple[str, ...] = ()

    def __init__(self, config: RadarOnlyConfig, setup: EstimatorSetup) -> None:
        radars = pick_sensors(setup, (RADAR,), estimator=KIND)[RADAR]
        if len(radars) != 1:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors = {list(config.sensors)}: {KIND} needs exactly one radar"
            )
        self._places = column_places(radars[0], (SPEED_COLUMN,), setup=setup)
        self._radar = radars[0].name
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
        if measurement.sensor != self._radar or stale:
            return
        self._newest_ns = measurement.t_ns
        speed = measurement.values[:, self._places]
        self._speed = np.where(usable(measurement, speed)[:, np.newaxis], speed, self._speed)

    def estimate(self, t_ns: int) -> Estimate:
        """Return the held speed for the machine and every row unit."""
        return Estimate(t_ns=t_ns, values=np.repeat(self._speed, len(self.columns), axis=1), sigmas=self._sigmas)
