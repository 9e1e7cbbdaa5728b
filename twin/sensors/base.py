"""What all sensors share: schedule, latency, dropouts, faults; a sensor adds only its physics.

A sample goes this way: the world's capture at ``next_tick`` -> which fault windows are open -> the sensor's physics
(:meth:`Sensor._measure`) -> dropouts -> faults -> measurements with their time of arrival, and beside them, for the
record only, the true errors and the beginnings and ends of faults.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from pydantic import model_validator

from twin.config import Config, NonNegative, Positive, Probability
from twin.jpeg import EncodedPicture
from twin.sensors import kernels
from twin.sensors.fault_config import FaultContext
from twin.sensors.fault_effects import Delivery
from twin.sensors.faults import FaultList, Faults
from twin.sensors.noise import Streams
from twin.sensors.schedule import Schedule, SensorSchedule, period_ticks
from twin.signals import (
    NS_PER_S,
    BoolArray,
    Capture,
    Event,
    FloatArray,
    Measurement,
    MotionNeed,
    Mount,
    Need,
    SensorInfo,
    wraps,
)

CLOCK_ERROR = "clock_error_s"
"""Hidden column: the instant a sample claims minus the instant it was really taken."""


def error_column(column: str) -> str:
    """Hidden column with the true error of a measured column, faults included."""
    return f"{column}.error"


class SensorConfig(Config):
    """What every sensor has; each kind adds its own."""

    kind: str
    mount: str
    """Name of the mount on the machine."""
    rate_hz: Positive
    """Samples per second; must divide the physics rate."""
    latency_s: NonNegative = 0.0
    """Least delay from sampling to arrival."""
    latency_jitter_s: NonNegative = 0.0
    """Mean of an exponentially distributed delay on top; large ones put samples out of order."""
    time_jitter_s: NonNegative = 0.0
    """Standard deviation of the true sampling instant about the one that is stamped; rounded to physics ticks."""
    dropout_probability: Probability = 0.0
    """Of losing one sample, in each run independently."""
    triggered_by: str | None = None
    """Name of a sensor: this one then samples whenever a sentence of that one arrives, at the instant of arrival, and
    stamps its sample with it (:mod:`twin.sensors.triggers`); both have one rate."""
    faults: FaultList = ()

    @model_validator(mode="after")
    def _check_trigger(self) -> Self:
        if self.triggered_by is not None and self.time_jitter_s > 0.0:
            raise ValueError("time_jitter_s: a sensor with triggered_by has no clock that could jitter")
        return self

    @property
    def recorded_columns(self) -> int:
        """About how many numbers a sample leaves in memory."""
        return 40

    def need(self, mount: Mount) -> Need:
        """What a sensor on this mount asks the world for."""
        return MotionNeed(mount=mount)


def own_schedule(config: SensorConfig, *, name: str, dt_ns: int, seed: int) -> Schedule:
    """When a sensor samples by its own clock.

    Raises:
        BadInputError: the rate does not divide the physics rate.
    """
    return Schedule(
        period=period_ticks(config.rate_hz, dt_ns, key="rate_hz"),
        dt_ns=dt_ns,
        latency_s=config.latency_s,
        latency_jitter_s=config.latency_jitter_s,
        time_jitter_s=config.time_jitter_s,
        seed=seed,
        name=f"sensors.{name}",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """What one sample of a sensor comes to."""

    measurements: tuple[Measurement, ...]
    """None if it was lost in every run, several if copies arrive."""
    hidden: FloatArray
    """(R, m) over ``hidden_columns``."""
    events: tuple[Event, ...] = ()
    """Faults that began or ended since the sample before."""
    pictures: tuple[EncodedPicture, ...] = ()
    """What the first run's camera saw, for the record; dropouts and faults do not touch it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What a sensor's physics makes of one capture."""

    values: FloatArray
    """(R, n), freshly allocated."""
    truth: FloatArray
    """(n,), NaN for columns that have no truth (sigmas, counts) or none now."""
    hidden: FloatArray
    """(R, h) over ``extra_hidden_columns``."""
    pictures: tuple[EncodedPicture, ...] = ()
    """Of the first run, for the record."""


class Sensor(ABC):
    """A sensor of R runs over one truth.

    Args:
        config: its configuration.
        name: its name in the scenario.
        mount: where it sits nominally; captures are in this mount's axes.
        dt_ns: length of a physics tick.
        seed: seed of the world; together with ``name`` it decides the schedule.
        runs: run indices along the ensemble axis; each decides its own values.

    Raises:
        BadInputError: the rate does not divide the physics rate, or a fault names an unknown column.
    """

    columns: tuple[str, ...]
    """What it measures. One kind of sensor has them as a class attribute; where they depend on the configuration they
    are set before ``Sensor.__init__``."""
    extra_hidden_columns: ClassVar[tuple[str, ...]] = ()
    """Hidden columns of this kind, beside the errors of ``error_columns``."""
    error_columns: tuple[str, ...]
    """Measured columns that have a truth; they come first in ``columns``."""
    inner_faults: ClassVar[frozenset[str]] = frozenset()
    """Kinds of faults that act inside this kind of sensor."""

    def __init__(
        self, config: SensorConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        key = f"sensors.{name}"
        period = period_ticks(config.rate_hz, dt_ns, key="rate_hz")
        self.name = name
        self.mount = mount
        self.need: Need = config.need(mount)
        self.period_s = period * dt_ns / NS_PER_S
        self.hidden_columns = (*map(error_column, self.error_columns), *self.extra_hidden_columns, CLOCK_ERROR)
        self._dt_ns = dt_ns
        self._runs = len(runs)
        self._streams = Streams(seed=seed, runs=tuple(runs), name=key)
        self._schedule: SensorSchedule = own_schedule(config, name=name, dt_ns=dt_ns, seed=seed)
        self.next_tick: int = self._schedule.tick
        """Physics tick of the next sample."""
        self._dropout = config.dropout_probability
        self._dropout_stream = self._streams.uniform("dropout", 1) if self._dropout > 0.0 else None
        self._all_valid = np.ones(self._runs, dtype=np.bool_)
        self._all_valid.flags.writeable = False
        self._wrapped = [index for index, column in enumerate(self.columns) if wraps(column)]
        self._wrapped_errors = [index for index in self._wrapped if index < len(self.error_columns)]
        context = FaultContext(
            sensor=name,
            columns=self.columns,
            noise_sigma=self._error_sigma(config),
            streams=self._streams,
            inner=self.inner_faults,
        )
        self._faults = Faults(config.faults, context=context)
        self.info = SensorInfo(
            name=name,
            kind=config.kind,
            columns=self.columns,
            mount=mount,
            rate_hz=config.rate_hz,
            datasheet=self._datasheet(config),
        )

    @abstractmethod
    def _measure(self, capture: Capture) -> Reading:
        """Turn truth into values: the sensor's physics. ``capture`` answers the need of its configuration."""

    @abstractmethod
    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        """What the owner can read in the data sheet; never a drawn error."""

    @abstractmethod
    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        """(n,) standard deviation of one sample's error, what ``noise_factor`` multiplies; zero where none."""

    def sample(self, capture: Capture) -> Sample:
        """Take the sample that is due; ``capture`` answers its need at ``next_tick``, since the last capture."""
        t_ns, stamp_ns, latency_ns = capture.t_ns, self._schedule.stamp_ns, self._schedule.latency_ns
        assert t_ns == self.next_tick * self._dt_ns, "captured at another tick than next_tick"
        events = self._faults.look(t_ns, capture.position_enu_m) if self._faults else ()
        reading = self._measure(capture)
        self.skip()
        if not self._faults and self._dropout_stream is None:
            measurement = self._measurement(reading.values, self._all_valid, stamp_ns, t_ns + latency_ns)
            hidden = self._hidden(reading, stamp_ns - t_ns)
            return Sample(measurements=(measurement,), hidden=hidden, pictures=reading.pictures)
        delivery = Delivery(values=reading.values, valid=self._mask(), stamp_ns=stamp_ns, latency_ns=latency_ns)
        self._faults.apply(delivery)
        self._wrap(delivery.values, self._wrapped)
        # Before lost samples become NaN: the record keeps the errors they would have had.
        hidden = self._hidden(reading, delivery.stamp_ns - t_ns)
        measurements = self._deliver(delivery, t_ns)
        return Sample(measurements=measurements, hidden=hidden, events=events, pictures=reading.pictures)

    def follow(self, schedule: SensorSchedule) -> None:
        """Sample by another schedule than its own clock's, from the first sample on; to be called before that."""
        self._schedule = schedule
        self.next_tick = schedule.tick

    def skip(self) -> None:
        """Let the sample that is due go by: only the schedule moves on (all runs share it)."""
        self._schedule.advance()
        self.next_tick = self._schedule.tick

    def _mask(self) -> BoolArray:
        if self._dropout_stream is None:
            return self._all_valid.copy()
        return self._dropout_stream.next()[:, 0] >= self._dropout

    def _deliver(self, delivery: Delivery, t_ns: int) -> tuple[Measurement, ...]:
        if not delivery.valid.any():
            return ()
        values = delivery.values
        values[~delivery.valid] = np.nan
        arrival_ns = t_ns + delivery.latency_ns
        return tuple(
            self._measurement(values, delivery.valid, delivery.stamp_ns, arrival_ns + delay_ns)
            for delay_ns in (0, *delivery.copy_delays_ns)
        )

    def _measurement(
        self,
        values: FloatArray,
        valid: BoolArray,
        stamp_ns: int,
        arrival_ns: int,
    ) -> Measurement:
        return Measurement(
            sensor=self.name,
            t_ns=stamp_ns,
            # What arrives between two ticks is there at the next one.
            t_available_ns=-(-arrival_ns // self._dt_ns) * self._dt_ns,
            columns=self.columns,
            values=values,
            valid=valid,
        )

    def _hidden(self, reading: Reading, clock_error_ns: int) -> FloatArray:
        hidden = np.empty((self._runs, len(self.hidden_columns)))
        kernels.hidden_row(reading.values, reading.truth, reading.hidden, clock_error_ns / NS_PER_S, hidden)
        self._wrap(hidden, self._wrapped_errors)
        return hidden

    @staticmethod
    def _wrap(values: FloatArray, columns: list[int]) -> None:
        for column in columns:
            kernels.wrap(values, column)
