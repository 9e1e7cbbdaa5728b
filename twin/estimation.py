"""Feeds measurements to estimators in order of arrival and collects what they say.

A run and a replay use this same bank, so a replay of recorded measurements reproduces a run's estimates bit for bit.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from twin.control.path_following import PathDriverConfig, planned_path
from twin.errors import BadInputError
from twin.estimators import build_estimator
from twin.geometry import Path
from twin.recording import Stream, StreamWriter, covariance_column, estimate_stream
from twin.scenario import RESERVED, Scenario
from twin.signals import (
    NS_PER_S,
    Estimate,
    Estimator,
    EstimatorSetup,
    FloatArray,
    IntArray,
    Measurement,
    Said,
    SensorInfo,
    Smoother,
    sigma_column,
)

EstimatorFactory = Callable[[EstimatorSetup], Estimator]

_PLUGIN_RATE_HZ = 50.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Listener:
    """An estimator, the sensors it hears and how often it is asked."""

    estimator: Estimator
    sensors: frozenset[str]
    period_ns: int


def period_ns(rate_hz: float) -> int:
    """Output period of an estimator, a whole number of nanoseconds."""
    return round(NS_PER_S / rate_hz)


class EstimatorBank:
    """Estimators side by side over one set of measurements.

    Arrivals at the same instant are handed over in the order of the scenario's sensors, and those of one sensor in
    the order in which they were sampled.
    """

    def __init__(self, listeners: Mapping[str, Listener], sensors: Sequence[str], *, runs: int) -> None:
        self._listeners = dict(listeners)
        self._order = {name: index for index, name in enumerate(sensors)}
        self._count = 0
        self._waiting: list[tuple[int, int, int, Measurement]] = []
        self._due = {name: listener.period_ns for name, listener in self._listeners.items()}
        self._next_due = min(self._due.values(), default=None)
        self._writers = {
            name: StreamWriter(stream_columns(listener.estimator), runs) for name, listener in self._listeners.items()
        }
        self._latest: dict[str, Estimate] = {}
        self._later = {
            name: listener.estimator
            for name, listener in self._listeners.items()
            if isinstance(listener.estimator, Smoother) and listener.estimator.says_in_hindsight
        }

    def deliver(self, measurement: Measurement) -> None:
        """Put a measurement in the queue; it is handed over when its time of arrival has come."""
        key = (measurement.t_available_ns, self._order[measurement.sensor], self._count)
        self._count += 1
        heapq.heappush(self._waiting, (*key, measurement))

    def advance(self, t_ns: int) -> None:
        """Hand over what has arrived and ask for the estimates due, up to and including ``t_ns``."""
        while self._next_due is not None and self._next_due <= t_ns:
            now = self._next_due
            self._process_until(now)
            for name, due in self._due.items():
                if due == now:
                    listener = self._listeners[name]
                    estimate = self._latest[name] = listener.estimator.estimate(now)
                    if name not in self._later:
                        self._writers[name].append(now, *stream_parts(estimate))
                    self._due[name] = now + listener.period_ns
            self._next_due = min(self._due.values())

    def said(self, name: str) -> Said | None:
        """Latest estimate of one estimator in the first run; None before its first."""
        estimate = self._latest.get(name)
        if estimate is None:
            return None
        columns = self._listeners[name].estimator.columns
        values = dict(zip(columns, estimate.values[0].tolist(), strict=True))
        sigmas = zip(map(sigma_column, columns), estimate.sigmas[0].tolist(), strict=True)
        return Said(t_ns=estimate.t_ns, values=values | dict(sigmas))

    def finish(self) -> None:
        """The run has ended: smoothers say what they know in hindsight."""
        for name, estimator in self._later.items():
            for estimate in estimator.hindsight():
                self._writers[name].append(estimate.t_ns, *stream_parts(estimate))
        self._later = {}

    def _process_until(self, t_ns: int) -> None:
        while self._waiting and self._waiting[0][0] <= t_ns:
            measurement = heapq.heappop(self._waiting)[3]
            if measurement.valid.any():
                for listener in self._listeners.values():
                    if measurement.sensor in listener.sensors:
                        listener.estimator.process(measurement)

    @property
    def columns(self) -> dict[str, tuple[str, ...]]:
        """Columns of each estimator's stream."""
        return {name: writer.columns for name, writer in self._writers.items()}

    def drain(self) -> dict[str, Stream]:
        """What each estimator said since the last time, by its name; it is not kept any longer."""
        return {name: writer.drain() for name, writer in self._writers.items()}

    def streams(self) -> dict[str, Stream]:
        """What the estimators said, by stream name."""
        return {estimate_stream(name): writer.finish() for name, writer in self._writers.items()}


def stream_columns(estimator: Estimator) -> tuple[str, ...]:
    """Columns of an estimator's stream: its own, their sigmas, and the upper triangle of the state's covariance."""
    state = estimator.state_columns
    pairs = zip(*np.triu_indices(len(state)), strict=True) if state else ()
    return (
        *estimator.columns,
        *(sigma_column(column) for column in estimator.columns),
        *(covariance_column(state[first], state[second]) for first, second in pairs),
    )


def stream_parts(estimate: Estimate) -> tuple[FloatArray, ...]:
    """Parts of a row of that stream, side by side, each (R, k)."""
    if estimate.covariance is None:
        return estimate.values, estimate.sigmas
    rows, columns = _upper_triangle(estimate.covariance.shape[1])
    return estimate.values, estimate.sigmas, estimate.covariance[:, rows, columns]


@cache
def _upper_triangle(size: int) -> tuple[IntArray, IntArray]:
    return np.triu_indices(size)


def estimator_setup(
    name: str, scenario: Scenario, sensors: Mapping[str, SensorInfo], listens: Sequence[str], runs: int
) -> EstimatorSetup:
    """What the owner of the machine could tell an estimator."""
    return EstimatorSetup(
        name=name,
        runs=runs,
        sensors={sensor: sensors[sensor] for sensor in listens},
        reference=scenario.machine.reference,
        rows_y_m=scenario.machine.rows_y_m,
        start_e_n_heading=scenario.machine.reference_start,
        earth_field=scenario.magnetics.earth_field,
        design_height_m=scenario.levelling.design_height_m,
        wheelbase_m=scenario.machine.wheelbase_m,
        wheel_radius_m=scenario.machine.wheel_radius_m,
        track_m=scenario.machine.track_m,
        reference_x_m=scenario.machine.reference_x_m,
        planned_path=_planned_path(scenario),
    )


def _planned_path(scenario: Scenario) -> Path | None:
    """What a driver who follows a path means to drive."""
    if not isinstance(scenario.driver, PathDriverConfig):
        return None
    return planned_path(scenario.driver, scenario.machine.vehicle_start)


def build_bank(
    scenario: Scenario,
    sensors: Mapping[str, SensorInfo],
    *,
    runs: int,
    plugins: Mapping[str, EstimatorFactory] | None = None,
) -> tuple[EstimatorBank, dict[str, Estimator]]:
    """The scenario's estimators (and plug-ins, which hear every sensor), ready to be fed.

    Raises:
        BadInputError: an estimator cannot work with these sensors.
    """
    estimators: dict[str, Estimator] = {}
    listeners: dict[str, Listener] = {}
    for name, config in scenario.estimators.items():
        setup = estimator_setup(name, scenario, sensors, config.sensors, runs)
        estimators[name] = build_estimator(config, setup)
        listeners[name] = Listener(
            estimator=estimators[name], sensors=frozenset(config.sensors), period_ns=period_ns(config.rate_hz)
        )
    for name, factory in (plugins or {}).items():
        if name in estimators or name in RESERVED:
            raise BadInputError(f"--estimator {name}: the scenario or its metrics have something of that name")
        estimators[name] = factory(estimator_setup(name, scenario, sensors, tuple(sensors), runs))
        listeners[name] = Listener(
            estimator=estimators[name], sensors=frozenset(sensors), period_ns=period_ns(_PLUGIN_RATE_HZ)
        )
    return EstimatorBank(listeners, list(sensors), runs=runs), estimators


def in_order_sampled(streams: Mapping[str, Stream]) -> Iterable[Measurement]:
    """Measurements of recorded streams (by sensor name), each sensor's in the order it was sampled."""
    for sensor, stream in streams.items():
        arrived = stream.t_available_ns if stream.t_available_ns is not None else stream.t_ns
        for index in range(len(stream)):
            runs = stream.values.shape[1]
            yield Measurement(
                sensor=sensor,
                t_ns=int(stream.t_ns[index]),
                t_available_ns=int(arrived[index]),
                columns=stream.columns,
                values=stream.values[index],
                valid=stream.valid[index] if stream.valid is not None else np.ones(runs, dtype=np.bool_),
            )
