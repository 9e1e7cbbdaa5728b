"""Height as the GNSS receiver tells it, held between its samples (kind ``height_hold``): what paper 002 compares with.

Today's practice of GNSS levelling. At a vertical speed v the height is v times its age wrong, and with 10 Hz and a
latency of 80 ms its age runs from 80 to 180 ms: 32 to 72 mm at the 0.4 m/s of the paper's plate.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.estimators.held_height import HeightConfig, HeldHeight, the_sensors
from twin.estimators.roles import GNSS
from twin.signals import HEIGHT, Estimate, EstimatorSetup, Measurement

KIND = "height_hold"


class HeightHoldConfig(HeightConfig):
    """Options of :class:`HeightHold`."""

    kind: Literal["height_hold"]


class HeightHold:
    """Estimator of :class:`HeightHoldConfig`.

    Column: ``height_m``, with the receiver's own sigma; NaN before the first height.

    Raises:
        BadInputError: not exactly one GNSS receiver, another sensor beside it, or an antenna on another body than the
            reference frame.
    """

    columns: tuple[str, ...] = (HEIGHT,)
    state_columns: tuple[str, ...] = ()

    def __init__(self, config: HeightHoldConfig, setup: EstimatorSetup) -> None:
        self._held = HeldHeight(the_sensors(setup, (GNSS,), estimator=KIND)[GNSS], setup, config)

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        if measurement.sensor == self._held.sensor:
            self._held.take(measurement)

    def estimate(self, t_ns: int) -> Estimate:
        """Return the held height."""
        values, sigmas = self._held.height[:, np.newaxis], self._held.sigma[:, np.newaxis]
        return Estimate(t_ns=t_ns, values=values, sigmas=sigmas)
