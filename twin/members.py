"""The members of an ensemble: sensors and estimators of some runs, over one truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from twin.errors import BadInputError
from twin.estimation import EstimatorFactory, build_bank
from twin.recording import Stream, StreamWriter, hidden_stream, measurement_stream
from twin.scenario import Scenario
from twin.sensors import Sensor, build_sensor
from twin.signals import Capture, Event, Need


def build_sensors(scenario: Scenario, *, runs: Sequence[int]) -> dict[str, Sensor]:
    """The scenario's sensors by name, in its order.

    Raises:
        BadInputError: a sensor cannot work at this physics rate.
    """
    sensors: dict[str, Sensor] = {}
    for name, config in scenario.sensors.items():
        mount = scenario.machine.resolved_mounts[config.mount]
        try:
            sensors[name] = build_sensor(
                config, name=name, mount=mount, dt_ns=scenario.dt_ns, seed=scenario.seed, runs=runs
            )
        except BadInputError as error:
            raise BadInputError(f"sensors.{name}: {error}") from error
    return sensors


class Members:
    """Sensors and estimators of R runs, shown one truth sample by sample.

    Raises:
        BadInputError: a sensor or estimator of the scenario cannot be built.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        runs: Sequence[int],
        plugins: Mapping[str, EstimatorFactory] | None = None,
    ) -> None:
        self._runs = len(runs)
        self._sensors = build_sensors(scenario, runs=runs)
        infos = {name: sensor.info for name, sensor in self._sensors.items()}
        self._bank, self.estimators = build_bank(scenario, infos, runs=len(runs), plugins=plugins)
        self._measured = {name: StreamWriter(sensor.columns) for name, sensor in self._sensors.items()}
        self._hidden = {name: StreamWriter(sensor.hidden_columns) for name, sensor in self._sensors.items()}
        self.events: list[Event] = [event for sensor in self._sensors.values() for event in sensor.fault_events()]

    @property
    def needs(self) -> Mapping[str, Need]:
        """What each sensor asks the world for."""
        return {name: sensor.need for name, sensor in self._sensors.items()}

    def due(self, tick: int) -> Sequence[str]:
        """Sensors that sample at this tick, in the order of the scenario."""
        return [name for name, sensor in self._sensors.items() if sensor.next_tick == tick]

    def next_tick(self) -> int:
        """Tick of the next sample of any sensor; a tick that never comes where there are none."""
        return min((sensor.next_tick for sensor in self._sensors.values()), default=2**62)

    def observe(self, sensor: str, capture: Capture) -> None:
        """Let a sensor sample, and put what it gives on its way to the estimators."""
        sample = self._sensors[sensor].sample(capture)
        self._hidden[sensor].append(capture.t_ns, sample.hidden)
        for measurement in sample.measurements:
            self._measured[sensor].append(
                measurement.t_ns,
                measurement.values,
                t_available_ns=measurement.t_available_ns,
                valid=measurement.valid,
            )
            self._bank.deliver(measurement)

    def advance(self, t_ns: int) -> None:
        """All samples up to and including ``t_ns`` have been taken: let the estimators speak."""
        self._bank.advance(t_ns)

    def streams(self) -> dict[str, Stream]:
        """All that was measured, hidden and estimated, by stream name."""
        return {
            **{measurement_stream(name): writer.finish(self._runs) for name, writer in self._measured.items()},
            **{hidden_stream(name): writer.finish(self._runs) for name, writer in self._hidden.items()},
            **self._bank.streams(self._runs),
        }
