"""When a sensor samples and when its samples arrive: shared by all members of an ensemble."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from twin.errors import BadInputError
from twin.randomness import world_generator
from twin.signals import NS_PER_S

_BLOCK = 256


def period_ticks(rate_hz: float, dt_ns: int, *, key: str) -> int:
    """Ticks between two samples.

    Raises:
        BadInputError: the rate does not divide the physics rate; the message names ``key`` and rates that do.
    """
    physics_hz = NS_PER_S / dt_ns
    ratio = physics_hz / rate_hz
    ticks = round(ratio)
    if ticks >= 1 and abs(ratio - ticks) <= 1e-9 * ratio:
        return ticks
    below, above = math.ceil(ratio), max(1, math.floor(ratio))
    nearest = ", ".join(f"{physics_hz / n:.10g}" for n in sorted({below, above}, reverse=True))
    raise BadInputError(
        f"{key} = {rate_hz:g}: does not divide the physics rate {physics_hz:g} Hz; nearest that do: {nearest}"
    )


class SensorSchedule(Protocol):
    """When one sensor samples and when its samples arrive."""

    tick: int
    """When the sample that is due is really taken."""
    stamp_ns: int
    """When the sensor says it is taken."""
    latency_ns: int
    """From being taken to arriving."""

    def advance(self) -> None:
        """Go on to the next sample."""


class Latencies:
    """How long samples take to arrive: ``latency_s`` plus an exponentially distributed delay of mean ``jitter_s``."""

    def __init__(self, *, latency_s: float, jitter_s: float, generator: np.random.Generator) -> None:
        self._latency_ns = latency_s * NS_PER_S
        self._jitter_ns = jitter_s * NS_PER_S
        self._generator = generator
        self._drawn: list[int] = []

    def draw(self) -> list[int]:
        """Those of a block of samples, ns."""
        delay = self._generator.standard_exponential(_BLOCK) * self._jitter_ns + self._latency_ns
        return [round(value) for value in delay.tolist()]

    def next(self) -> int:
        """That of the next sample, ns; for those who draw nothing else."""
        if not self._drawn:
            self._drawn = self.draw()[::-1]
        return self._drawn.pop()


class Schedule:
    """Sample ticks and latencies of one sensor.

    The sensor's clock counts even periods and stamps each sample with it. The sample is really taken ``time_jitter_s``
    (1 sigma, normal, kept inside +- half a period, rounded to physics ticks) beside that instant. It arrives
    ``latency_s`` later plus an exponentially distributed delay of mean ``latency_jitter_s``, so that a sample can
    overtake an older one. The first sample is due one period after the start.
    """

    def __init__(
        self,
        *,
        period: int,
        dt_ns: int,
        latency_s: float,
        latency_jitter_s: float,
        time_jitter_s: float,
        seed: int,
        name: str,
    ) -> None:
        self._period = period
        self._dt_ns = dt_ns
        self._jitter_ticks = time_jitter_s * NS_PER_S / dt_ns
        self._most_ticks = (period - 1) // 2
        self._generator = world_generator(seed, f"{name}.schedule")
        self._arrivals = Latencies(latency_s=latency_s, jitter_s=latency_jitter_s, generator=self._generator)
        self._offsets: list[int] = []
        self._latencies: list[int] = []
        self._count = 0
        self.tick = 0
        """When the sample that is due is really taken."""
        self.stamp_ns = 0
        """When the sensor says it is taken: its own even clock."""
        self.latency_ns = 0
        """From being taken to arriving."""
        self.advance()

    def advance(self) -> None:
        """Go on to the next sample."""
        position = self._count % _BLOCK
        if position == 0:
            self._draw()
        self._count += 1
        nominal = self._count * self._period
        self.tick = nominal + self._offsets[position]
        self.stamp_ns = nominal * self._dt_ns
        self.latency_ns = self._latencies[position]

    def _draw(self) -> None:
        normal = self._generator.standard_normal(_BLOCK) * self._jitter_ticks
        self._offsets = [max(-self._most_ticks, min(self._most_ticks, round(value))) for value in normal.tolist()]
        self._latencies = self._arrivals.draw()
