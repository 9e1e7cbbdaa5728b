"""Arrivals grouped by the tick of the filter they belong to.

The inertial units share one rate; the filter steps in lock-step with it, on ticks k of time k / rate, counted in
integers. Real arrivals are ragged: units drop out one by one, samples jitter, come late, twice, or out of order.
:class:`TickClock` makes of them one group per tick. Every member of an ensemble shares the arrivals, so all of this is
decided once, on integers.

* A sample belongs to the tick nearest to its time of validity, but never to one before the newest seen: what comes late
  is used as if it were current, as paper 000 does. Its group then says that it is not ``fresh``.
* Only inertial samples open a tick. A sample of another sensor that is ahead of them (they have a latency, or simply
  come after it within the tick) waits for its tick; if the inertial units stay silent for 0.1 s it opens one itself.
* A sensor clock that runs ahead is held at the time of arrival: nothing can be measured after it has arrived.
* A sample that was seen before (same sensor, same time of validity), or is older than ``max_age_s``, is dropped.
* A group is closed by the first sample of a later tick, or when an estimate is asked for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field

from twin.signals import NS_PER_S, Measurement

_PATIENCE_S = 0.1
_REMEMBERED = 64
"""Times of validity remembered per sensor to recognise repeats: more than a second at 50 Hz."""


@dataclass(slots=True)
class Tick:
    """What arrived for one tick."""

    index: int
    steps: int
    """Ticks since the last closed group: 1 in the ordinary case, more after a gap, 0 for samples of a tick closed."""
    samples: list[tuple[Measurement, bool]] = field(default_factory=list)
    """Measurements in order of arrival, each with True if it is fresh: valid at this very tick."""


@dataclass(slots=True)
class _History:
    """Times of validity that a sensor has sent."""

    newest_ns: int
    seen_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))


class TickClock:
    """Groups measurements by tick, as the module's docstring says."""

    def __init__(self, *, rate_hz: float, max_age_s: float, inertial: Collection[str]) -> None:
        self.step_ns = round(NS_PER_S / rate_hz)
        self._max_age_ns = round(max_age_s * NS_PER_S)
        self._patience = max(1, round(_PATIENCE_S * rate_hz))
        self._inertial = frozenset(inertial)
        self._closed: int | None = None
        self._open: Tick | None = None
        self._waiting: list[tuple[int, Measurement]] = []
        self._histories: dict[str, _History] = {}

    def add(self, measurement: Measurement) -> Tick | None:
        """Take a measurement; return the group it closes by being of a later tick, if it does."""
        if self._is_stale(measurement):
            return None
        index = self._index(min(measurement.t_ns, measurement.t_available_ns))
        newest = self._closed if self._open is None else self._open.index
        if measurement.sensor not in self._inertial and newest is not None and 0 < index - newest <= self._patience:
            self._waiting.append((index, measurement))
            return None
        closed = None
        if self._open is not None and index > self._open.index:
            closed = self.close()
        if self._open is None:
            self._open = self._begin(index)
        self._open.samples.append((measurement, index == self._open.index))
        return closed

    def close(self) -> Tick | None:
        """Close the open group, if there is one, and return it."""
        tick, self._open = self._open, None
        if tick is not None:
            self._closed = tick.index
        return tick

    def _begin(self, index: int) -> Tick:
        if self._closed is None:
            return Tick(index, 1)
        tick = Tick(max(index, self._closed), max(index - self._closed, 0))
        if self._waiting:
            tick.samples.extend((sample, due == index) for due, sample in self._waiting if due <= index)
            self._waiting = [(due, sample) for due, sample in self._waiting if due > index]
        return tick

    def _index(self, t_ns: int) -> int:
        return (t_ns + self.step_ns // 2) // self.step_ns

    def _is_stale(self, measurement: Measurement) -> bool:
        t_ns = measurement.t_ns
        if measurement.t_available_ns - t_ns > self._max_age_ns:
            return True
        history = self._histories.get(measurement.sensor)
        if history is None:
            history = self._histories[measurement.sensor] = _History(t_ns)
        elif t_ns > history.newest_ns:
            history.newest_ns = t_ns
        elif t_ns in history.seen_ns:
            return True
        history.seen_ns.append(t_ns)
        return False
