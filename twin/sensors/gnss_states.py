"""Which fix state a GNSS receiver is in: a ladder of states, and what lets it climb and makes it fall.

The states of a receiver stand in its table from the best to the worst (RTK fixed, float, differential, single). Each
demands a number of satellites and, if it lives on corrections, that these are younger than ``until_age_s``. Losing a
condition costs the state at that very sample: the receiver falls to the best state that is ready. Getting the
conditions back does not give the state back at once: it takes ``acquire_s`` (log-normal about this median, drawn for
each run and each time), meanwhile the receiver is in a lesser state. So corrections that come back after a long time
give single -> float -> fixed if float is quicker to acquire, and a receiver whose float and fixed solution share one
time-out falls from fixed straight to differential. Below all states there is one more: no position, quality 0.

All decisions compare integers (nanoseconds, counts). At the start the receiver has settled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from twin.config import Config, NonNegative, Positive, Probability, Vector3
from twin.sensors.gnss_kernels import NEVER, fix_states
from twin.sensors.noise import OccasionalNormals, Streams
from twin.signals import FloatArray, IntArray, nanoseconds

OPEN_SKY = 2**31
"""More satellites than there are."""
_FEWEST = 4
"""Satellites that a position takes."""


class FixState(Config):
    """One state of a receiver. Errors are one standard deviation; triples are east, north, up."""

    quality: Annotated[int, Field(ge=1, le=8)]
    """NMEA GGA field 6: 4 RTK fixed, 5 RTK float, 2 differential, 1 autonomous."""
    correlated_sigma_m: Vector3
    """True error, time-correlated part."""
    correlation_s: Vector3
    """Its 1/e time."""
    white_sigma_m: Vector3
    """True error, part that is new in every sample."""
    reported_sigma_m: Vector3
    """What the receiver claims."""
    velocity_noise_m_s: NonNegative
    """White error of the east and of the north velocity at standstill, under an open sky."""
    velocity_noise_ratio: NonNegative = 0.0
    """Further white error per m/s of speed, added in quadrature."""
    satellites: Annotated[int, Field(ge=_FEWEST)]
    """In use under an open sky."""
    hdop: Positive
    vdop: Positive
    satellites_needed: Annotated[int, Field(ge=0)] = _FEWEST
    """With fewer, the state is lost."""
    until_age_s: Positive | None = None
    """The state is lost when the corrections reach this age; without it, it needs none."""
    acquire_s: NonNegative = 0.0
    """Median time from when its conditions hold again until the receiver is in it."""
    acquire_spread: NonNegative = 0.0
    """Standard deviation of that time's natural logarithm."""
    entry_ratio: Probability = 1.0
    """Part of the correlated error that is there on falling into this state from a better one."""
    growth_s: Positive = 1.0
    """Time constant with which that part becomes the whole."""
    settling_s: Positive = 1.0
    """Time constant with which it is reached again while a better state is being acquired."""
    age_drift_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Further correlated error per second of age of the corrections, added in quadrature."""
    reported_age_drift_m_s: Vector3 = (0.0, 0.0, 0.0)
    """The same in what the receiver claims."""
    jump_sigma_m: Vector3 = (0.0, 0.0, 0.0)
    """True error, part that steps when other satellites are used (:mod:`twin.sensors.gnss_jumps`)."""

    @model_validator(mode="after")
    def _check_satellites(self) -> Self:
        if self.satellites_needed > self.satellites:
            raise ValueError(
                f"satellites_needed = {self.satellites_needed}: more than the {self.satellites} satellites in use"
            )
        return self

    def total_sigma_m(self) -> FloatArray:
        """(3,) true standard deviation of one sample with fresh corrections, under an open sky."""
        total: FloatArray = np.sqrt(
            np.square(self.correlated_sigma_m) + np.square(self.white_sigma_m) + np.square(self.jump_sigma_m)
        )
        return total


def dilution(states: Sequence[FixState], satellites: int) -> FloatArray:
    """(S,) factor on errors and DOP where only ``satellites`` are in view.

    A choice: the square root of the ratio of satellites beyond three. Four clocks and coordinates leave that many
    observations to average over, plus one.
    """
    in_use = [max(_FEWEST, min(state.satellites, satellites)) for state in states]
    return np.array([math.sqrt((s.satellites - 3) / (n - 3)) for s, n in zip(states, in_use, strict=True)])


class FixStates:
    """The state of R receivers.

    Args:
        states: the ladder, best first.
        pinned: name of a state that is never left, whatever happens.
        streams: where acquisition times come from.
    """

    def __init__(self, states: Mapping[str, FixState], *, pinned: str | None, streams: Streams) -> None:
        table = list(states.values())
        runs = len(streams.runs)
        start = 0 if pinned is None else list(states).index(pinned)
        self.index: IntArray = np.full(runs, start, dtype=np.int64)
        """(R,) position of the state in the ladder; S for no position. Changes in place."""
        self.allowed: IntArray = self.index.copy()
        """(R,) the best state whose conditions hold: if better than the present one, it is being acquired. Changes in
        place."""
        self._pinned = pinned is not None
        self._until_ns = np.array(
            [np.iinfo(np.int64).max if s.until_age_s is None else nanoseconds(s.until_age_s) for s in table]
        )
        self._needed = np.array([state.satellites_needed for state in table])
        self._acquire_ns = np.array([state.acquire_s * 1e9 for state in table])
        self._spread = np.array([state.acquire_spread for state in table])
        self._ready_ns = np.full((runs, len(table)), -NEVER, dtype=np.int64)
        self._normals = OccasionalNormals(streams=streams, process="acquisition", least=len(table))

    def update(self, t_ns: int, reference_ns: IntArray, satellites: int) -> None:
        """Go on to ``t_ns``, with corrections of the epochs ``reference_ns`` (R,) and so many satellites in view."""
        if self._pinned:
            return
        used = fix_states(
            t_ns,
            reference_ns,
            satellites,
            self._until_ns,
            self._needed,
            self._acquire_ns,
            self._spread,
            self._ready_ns,
            self._normals.values,
            self._normals.used,
            self.index,
            self.allowed,
        )
        self._normals.top_up(used)
