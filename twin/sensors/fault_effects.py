"""What each fault does to a sample on its way from the sensor to the estimators.

:mod:`twin.sensors.faults` has the vocabulary and the windows; here is one class per effect. An effect is called for
every sample, with the time since its window opened or None while the window is closed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from twin.randomness import NormalStream, UniformStream
from twin.signals import BoolArray, FloatArray, IntArray, seconds


@dataclass(slots=True, kw_only=True)
class Delivery:
    """A sample on its way; effects change it in place."""

    values: FloatArray
    """(R, n)."""
    valid: BoolArray
    """(R,)."""
    stamp_ns: int
    latency_ns: int
    copy_delays_ns: list[int] = field(default_factory=list)
    """One entry per further copy: how long after the first it arrives."""


class Effect(Protocol):
    """One fault at work."""

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Change ``delivery`` if the window is open (``since_ns`` is not None)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outage:
    """Nothing arrives in any run."""

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Mark the sample lost."""
        if since_ns is not None:
            delivery.valid[:] = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropouts:
    """Samples are lost at random, in each run independently."""

    probability: float
    stream: UniformStream

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Mark the sample lost in some runs."""
        if since_ns is not None:
            delivery.valid &= self.stream.next()[:, 0] >= self.probability


class Stuck:
    """Columns repeat the last value given before the window; the first one inside it if there was none before.

    With a ``stream``, white ``noise`` (1 sigma) is on what they repeat.
    """

    def __init__(self, *, columns: IntArray, noise: float = 0.0, stream: NormalStream | None = None) -> None:
        self._columns = columns
        self._noise, self._stream = noise, stream
        self._held: FloatArray | None = None

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Repeat the held values, or remember these."""
        if since_ns is None or self._held is None:
            self._held = delivery.values[:, self._columns]
        else:
            delivery.values[:, self._columns] = self._held
            if self._stream is not None:
                delivery.values[:, self._columns] += self._noise * self._stream.next()


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """Columns are off by a constant."""

    columns: IntArray
    size: float

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Add the size."""
        if since_ns is not None:
            delivery.values[:, self.columns] += self.size


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Columns are a multiple of what they were."""

    columns: IntArray
    factor: float

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Multiply by the factor."""
        if since_ns is not None:
            delivery.values[:, self.columns] *= self.factor


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Columns run away at a constant rate from the opening of the window."""

    columns: IntArray
    rate_per_s: float

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Add rate times time."""
        if since_ns is not None:
            delivery.values[:, self.columns] += self.rate_per_s * seconds(since_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spike:
    """Single samples are off by plus or minus a size, at random in each run; all columns of a sample together."""

    columns: IntArray
    size: float
    probability: float
    stream: UniformStream

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Add the spike in some runs."""
        if since_ns is not None:
            hit, side = self.stream.next().T
            spike = np.where(hit < self.probability, np.where(side < 0.5, -self.size, self.size), 0.0)
            delivery.values[:, self.columns] += spike[:, np.newaxis]


@dataclass(frozen=True, slots=True, kw_only=True)
class AddedNoise:
    """White noise on top of the sensor's own: ``sigma`` has one value per column."""

    columns: IntArray
    sigma: FloatArray
    stream: NormalStream

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Add noise."""
        if since_ns is not None:
            delivery.values[:, self.columns] += self.stream.next() * self.sigma


@dataclass(frozen=True, slots=True, kw_only=True)
class Duplicate:
    """Every sample arrives a second time."""

    delay_ns: int

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Ask for one more copy."""
        if since_ns is not None:
            delivery.copy_delays_ns.append(self.delay_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class LatencyStep:
    """Samples arrive later."""

    latency_ns: int

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Add latency."""
        if since_ns is not None:
            delivery.latency_ns += self.latency_ns


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockOffset:
    """The sensor's clock is wrong: samples arrive as ever, with a wrong time of validity."""

    offset_ns: int

    def apply(self, delivery: Delivery, since_ns: int | None) -> None:
        """Shift the stamp."""
        if since_ns is not None:
            delivery.stamp_ns += self.offset_ns
