"""From the error of a GNSS position to the digits that the receiver tells: steps, its own filter, resolution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.sensors.gnss_config import GnssConfig
from twin.sensors.gnss_geometry import Geometry
from twin.sensors.gnss_internal_filter import ConstantVelocityFilter
from twin.sensors.gnss_jumps import Jumps
from twin.sensors.gnss_states import FixState
from twin.sensors.noise import Quantiser, Streams
from twin.signals import FloatArray, IntArray


class PositionOutput:
    """What R receivers have between the position's error and its digits; without options, digits alone.

    Args:
        config: of the receiver.
        states: its fix states, best first.
        period_s: time between samples.
        name: of the sensor.
        streams: where its random numbers come from.
    """

    def __init__(
        self, config: GnssConfig, states: Sequence[FixState], *, period_s: float, name: str, streams: Streams
    ) -> None:
        own, interval_s, runs = config.internal_filter, config.jump_interval_s, len(streams.runs)
        self._states = len(states)
        self._jumps = (
            None if interval_s is None else Jumps(states, interval_s=interval_s, period_s=period_s, streams=streams)
        )
        self._filter = None if own is None else ConstantVelocityFilter(own, period_s=period_s, runs=runs)
        self._own_velocity = own is not None and own.velocity
        self._geometry = None if config.geometry is None else Geometry(config.geometry, seed=streams.seed, name=name)
        self._digits = Quantiser(lsb=config.resolution_m)

    def dilute(self, dilution: FloatArray, t_ns: int) -> FloatArray:
        """(S,) factors of the states under the geometry of now."""
        return dilution if self._geometry is None else dilution * self._geometry.at(t_ns)

    def offset(self, index: IntArray, dilution: FloatArray) -> FloatArray | None:
        """Advance by one sample: what steps of the satellites add to the errors, (R, 3); None for receivers without."""
        return None if self._jumps is None else self._jumps.step(index, dilution)

    def told(self, position_m: FloatArray, index: IntArray) -> FloatArray:
        """What receivers in the states ``index`` (R,) tell of the raw positions (R, 3), which change in place."""
        if self._filter is not None:
            position_m = self._filter.step(position_m, lost=index >= self._states)
        return self._digits.apply(position_m)

    def put_velocity(self, values: FloatArray, first: int) -> None:
        """Put the filter's speed and course into two columns from ``first`` on, where it gives them."""
        if self._filter is not None and self._own_velocity:
            east, north, _ = self._filter.velocity_m_s.T
            values[:, first], values[:, first + 1] = np.hypot(east, north), np.arctan2(north, east)
