"""One vocabulary of faults for all sensors, as users name them.

A fault is a table in a sensor's ``faults`` list::

    faults = [ { kind = "jump", columns = ["position_e_m"], size = 1.0, from_s = 40, to_s = 60 } ]

It acts while its window is open (:mod:`twin.sensors.windows`: by time, by place, or both). Faults act on values in the
order of the list; what a fault does to a sample is its :class:`Effect` (:mod:`twin.sensors.fault_effects`). A fault
that acts inside a sensor (:mod:`twin.sensors.gnss_faults`) has no effect of that kind: its sensor takes it from
:attr:`Faults.inner`, with the time since its window opened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, Strict

from twin.config import Names, NonNegative, Positive, Probability
from twin.errors import BadInputError
from twin.sensors.fault_config import Columns, FaultConfig, FaultContext
from twin.sensors.fault_effects import (
    AddedNoise,
    ClockOffset,
    Delivery,
    Drift,
    Dropouts,
    Duplicate,
    Effect,
    Jump,
    LatencyStep,
    Outage,
    Scale,
    Spike,
    Stuck,
)
from twin.sensors.gnss_faults import AnyReceiverFault
from twin.sensors.windows import Window
from twin.signals import Event, FloatArray, nanoseconds


class OutageFault(FaultConfig):
    """Nothing arrives at all."""

    kind: Literal["outage"]

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102, ARG002
        return Outage()


class DropoutsFault(FaultConfig):
    """Samples are lost at random, in each run independently."""

    kind: Literal["dropouts"]
    probability: Probability
    """Of losing one sample."""

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102
        return Dropouts(probability=self.probability, stream=context.streams.uniform(context.process, 1))


class StuckFault(FaultConfig):
    """Columns repeat the last value before the window."""

    kind: Literal["stuck"]
    columns: Names = ()
    """Without it, all columns."""
    noise: NonNegative = 0.0
    """White noise on what is repeated, 1 sigma in the unit of the columns: last digits that still move."""

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102
        columns = context.indices(self.columns)
        stream = context.streams.normal(context.process, len(columns)) if self.noise > 0.0 else None
        return Stuck(columns=columns, noise=self.noise, stream=stream)


class SpikeFault(FaultConfig):
    """Single samples are off by plus or minus ``size``."""

    kind: Literal["spike"]
    columns: Columns
    size: float
    """In the unit of the columns."""
    probability: Probability
    """Of a spike in one sample."""

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102
        return Spike(
            columns=context.indices(self.columns),
            size=self.size,
            probability=self.probability,
            stream=context.streams.uniform(context.process, 2),
        )


class JumpFault(FaultConfig):
    """Columns are off by ``size``."""

    kind: Literal["jump"]
    columns: Columns
    size: float
    """In the unit of the columns."""

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102
        return Jump(columns=context.indices(self.columns), size=self.size)


class ScaleFault(FaultConfig):
    """Columns are ``factor`` times what they were: a radar that loses every other pulse has 0.5, a dead one 0."""

    kind: Literal["scale"]
    columns: Columns
    factor: NonNegative

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102
        return Scale(columns=context.indices(self.columns), factor=self.factor)


class DriftFault(FaultConfig):
    """Columns run away, by ``rate_per_s`` for every second since the window opened."""

    kind: Literal["drift"]
    columns: Columns
    rate_per_s: float
    """In the unit of the columns, per second."""

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102
        return Drift(columns=context.indices(self.columns), rate_per_s=self.rate_per_s)


class NoiseFactorFault(FaultConfig):
    """The sensor is ``factor`` times as noisy: white noise is added, sqrt(factor^2 - 1) of its own error."""

    kind: Literal["noise_factor"]
    factor: Annotated[float, Field(ge=1.0)]
    columns: Names = ()
    """Without it, all columns."""

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102
        columns = context.indices(self.columns)
        return AddedNoise(
            columns=columns,
            sigma=context.noise_sigma[columns] * float(np.sqrt(self.factor**2 - 1.0)),
            stream=context.streams.normal(context.process, len(columns)),
        )


class DuplicateFault(FaultConfig):
    """A second source repeats every sample: the same information arrives twice."""

    kind: Literal["duplicate"]
    delay_s: NonNegative = 0.0
    """How long after the first the copy arrives."""

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102, ARG002
        return Duplicate(delay_ns=nanoseconds(self.delay_s))


class LatencyStepFault(FaultConfig):
    """Samples arrive ``latency_s`` later than they did."""

    kind: Literal["latency_step"]
    latency_s: Positive

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102, ARG002
        return LatencyStep(latency_ns=nanoseconds(self.latency_s))


class ClockOffsetFault(FaultConfig):
    """The sensor's clock is ahead by ``offset_s`` (behind if negative)."""

    kind: Literal["clock_offset"]
    offset_s: float

    def effect(self, context: FaultContext) -> Effect:  # noqa: D102, ARG002
        return ClockOffset(offset_ns=nanoseconds(self.offset_s))


Fault = Annotated[
    OutageFault
    | DropoutsFault
    | StuckFault
    | SpikeFault
    | JumpFault
    | ScaleFault
    | DriftFault
    | NoiseFactorFault
    | DuplicateFault
    | LatencyStepFault
    | ClockOffsetFault
    | AnyReceiverFault,
    Field(discriminator="kind"),
]
"""Every fault there is; a new one is one class more in this union."""

FaultList = Annotated[tuple[Fault, ...], Strict(strict=False)]
"""A TOML array of faults."""


@dataclass(slots=True, kw_only=True)
class FaultAtWork:
    """One fault of one sensor."""

    fault: Fault
    window: Window
    effect: Effect | None
    key: str
    """Where it stands in the sensor's table."""
    process: str
    """Name of its random stream."""
    since_ns: int | None = None
    """Time since its window opened, at the present sample; None while it is closed."""


class Faults:
    """The faults of one sensor at work.

    Raises:
        BadInputError: a fault names an unknown column, or cannot happen to this sensor.
    """

    def __init__(self, faults: Sequence[Fault], *, context: FaultContext) -> None:
        self._source = f"sensors.{context.sensor}"
        self._faults: list[FaultAtWork] = []
        for index, fault in enumerate(faults):
            own = replace(context, key=f"{context.key}[{index}]", process=f"fault_{index}_{fault.kind}")
            effect = fault.effect(own)
            if effect is None and fault.kind not in context.inner:
                raise BadInputError(f"{own.key}: {fault.kind!r} cannot happen to this kind of sensor")
            self._faults.append(
                FaultAtWork(fault=fault, window=fault.window(), effect=effect, key=own.key, process=own.process)
            )
        self.inner = [at_work for at_work in self._faults if at_work.effect is None]
        """Those that act inside the sensor, in the order of the list."""

    def __bool__(self) -> bool:
        return bool(self._faults)

    def look(self, t_ns: int, position_enu_m: FloatArray) -> tuple[Event, ...]:
        """See which windows are open for the sample taken at ``t_ns``; tell which have opened or closed."""
        events: list[Event] = []
        for at_work in self._faults:
            before = at_work.since_ns
            at_work.since_ns = at_work.window.since(t_ns, position_enu_m)
            if (before is None) != (at_work.since_ns is None):
                text = f"fault {at_work.fault.kind} {'begins' if before is None else 'ends'}"
                events.append(Event(t_ns=t_ns, source=self._source, level="warning", text=text))
        return tuple(events)

    def apply(self, delivery: Delivery) -> None:
        """Let all faults act on the sample that was looked at."""
        for at_work in self._faults:
            if at_work.effect is not None:
                at_work.effect.apply(delivery, at_work.since_ns)
