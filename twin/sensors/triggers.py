"""Sensors that sample when another's sentence arrives (``triggered_by``), as all of paper 003 do at ``$GPGGA``.

The trigger is the *schedule* of the other sensor's sentences: sample, latency and its jitter, and nothing else. A
receiver without a fix sends its sentence all the same, and so it triggers. What happens to the sentence in one member
of an ensemble (``dropout_probability``) or by a fault (an outage, a latency step) does not, because all members share
one schedule: the trigger then comes although that sample is lost.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping

from twin.errors import BadInputError
from twin.randomness import world_generator
from twin.sensors.base import SensorConfig, own_schedule
from twin.sensors.schedule import Latencies, SensorSchedule


class TriggeredSchedule:
    """Sample ticks and latencies of a sensor that samples when another's sentences arrive.

    Sentences that overtake one another trigger in the order of arrival, and several that arrive between two ticks
    trigger once. The sensor stamps its sample with the instant at which it takes it.

    Args:
        source: schedule of the other sensor, used by nobody else.
        dt_ns: length of a physics tick.
        latencies: of this sensor's own samples.
    """

    def __init__(self, source: SensorSchedule, *, dt_ns: int, latencies: Latencies) -> None:
        self._source = source
        self._dt_ns = dt_ns
        self._latencies = latencies
        self._arrivals: list[int] = []
        self.tick = 0
        """When the sample that is due is taken."""
        self.stamp_ns = 0
        """The same instant."""
        self.latency_ns = 0
        """From being taken to arriving."""
        self.advance()

    def advance(self) -> None:
        """Go on to the next sample."""
        before = self.tick
        while self.tick <= before:
            self.tick = self._next_arrival()
        self.stamp_ns = self.tick * self._dt_ns
        self.latency_ns = self._latencies.next()

    def _next_arrival(self) -> int:
        """Tick at which the next sentence is there; what is taken later than the first arrival cannot overtake it."""
        source = self._source
        while not self._arrivals or source.tick < self._arrivals[0]:
            arrival_ns = source.tick * self._dt_ns + source.latency_ns
            heapq.heappush(self._arrivals, -(-arrival_ns // self._dt_ns))
            source.advance()
        return heapq.heappop(self._arrivals)


def sources(name: str, sensors: Mapping[str, SensorConfig]) -> list[str]:
    """The sensor that triggers this one, the one that triggers that, and so on.

    Raises:
        BadInputError: a sensor that does not exist, another rate, or sensors that trigger one another.
    """
    chain: list[str] = []
    config = sensors[name]
    while config.triggered_by is not None:
        source = config.triggered_by
        key = f"sensors.{chain[-1] if chain else name}"
        if source not in sensors:
            raise BadInputError(
                f"{key}.triggered_by: unknown sensor {source!r} (there are {', '.join(sorted(sensors))})"
            )
        if source == name or source in chain:
            circle = " by ".join((name, *chain, source))
            raise BadInputError(f"{key}.triggered_by: sensors trigger one another ({circle}); nothing starts them")
        if sensors[source].rate_hz != config.rate_hz:
            raise BadInputError(
                f"{key}.rate_hz = {config.rate_hz:g}: has to be the {sensors[source].rate_hz:g} Hz of {source!r}, which"
                " triggers it"
            )
        chain.append(source)
        config = sensors[source]
    return chain


def schedule_of(name: str, sensors: Mapping[str, SensorConfig], *, dt_ns: int, seed: int) -> SensorSchedule:
    """When this sensor of a world samples, from the first sample on; each call makes a schedule of its own.

    Raises:
        BadInputError: as :func:`sources`, or the rate of the first in the chain does not divide the physics rate.
    """
    *triggered, clocked = name, *sources(name, sensors)
    schedule: SensorSchedule = own_schedule(sensors[clocked], name=clocked, dt_ns=dt_ns, seed=seed)
    for each in reversed(triggered):
        latencies = Latencies(
            latency_s=sensors[each].latency_s,
            jitter_s=sensors[each].latency_jitter_s,
            generator=world_generator(seed, f"sensors.{each}.schedule"),
        )
        schedule = TriggeredSchedule(schedule, dt_ns=dt_ns, latencies=latencies)
    return schedule
