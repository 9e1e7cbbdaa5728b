"""The members of an ensemble: sensors and estimators of some runs, over one truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from twin.errors import BadInputError
from twin.estimation import EstimatorFactory, build_bank
from twin.jpeg import EncodedPicture
from twin.pictures import Pictures
from twin.recording import Stream, StreamWriter, hidden_stream, measurement_stream
from twin.scenario import Scenario
from twin.sensors import Sample, Sensor, build_sensor
from twin.sensors.gnss import TRUE_FIX
from twin.signals import Capture, Event, Measurement, Need, Said


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
                config,
                name=name,
                mount=mount,
                dt_ns=scenario.dt_ns,
                seed=scenario.seed,
                runs=runs,
                among=scenario.sensors,
            )
        except BadInputError as error:
            raise BadInputError(f"sensors.{name}: {error}") from error
    return sensors


class SensorRack:
    """The sensors of some runs, and when each of them samples."""

    def __init__(self, scenario: Scenario, *, runs: Sequence[int]) -> None:
        self.sensors = build_sensors(scenario, runs=runs)

    @property
    def needs(self) -> Mapping[str, Need]:
        """What each sensor asks the world for."""
        return {name: sensor.need for name, sensor in self.sensors.items()}

    def due(self, tick: int) -> Sequence[str]:
        """Sensors that sample at this tick, in the order of the scenario."""
        return [name for name, sensor in self.sensors.items() if sensor.next_tick == tick]

    def next_tick(self) -> int:
        """Tick of the next sample of any sensor; a tick that never comes where there are none."""
        return min((sensor.next_tick for sensor in self.sensors.values()), default=2**62)


class Members(SensorRack):
    """Sensors and estimators of R runs, shown one truth sample by sample.

    With ``keep_measurements`` false only estimates are collected, and what is hidden of the receiver whose true fixes
    are scored (``scoring.fixes_of``).

    Raises:
        BadInputError: a sensor or estimator of the scenario cannot be built.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        runs: Sequence[int],
        plugins: Mapping[str, EstimatorFactory] | None = None,
        keep_measurements: bool = True,
    ) -> None:
        super().__init__(scenario, runs=runs)
        infos = {name: sensor.info for name, sensor in self.sensors.items()}
        self._bank, self.estimators = build_bank(scenario, infos, runs=len(runs), plugins=plugins)
        kept = self.sensors if keep_measurements else {}
        self._measured = {name: StreamWriter(sensor.columns, len(runs)) for name, sensor in kept.items()}
        self._hidden = {name: StreamWriter(sensor.hidden_columns, len(runs)) for name, sensor in kept.items()}
        self._fixes = self._fix_writer(scenario.scoring.fixes_of, len(runs))
        self._inbox = Inbox(scenario.listens.sensors)
        self._pictures: dict[str, list[EncodedPicture]] = {}
        self.events: list[Event] = []
        """Faults that began or ended."""
        require_columns(scenario, self._bank.columns, {name: sensor.columns for name, sensor in self.sensors.items()})

    def _fix_writer(self, receiver: str | None, runs: int) -> tuple[str, int, StreamWriter] | None:
        """The receiver whose true fixes are scored, which of its hidden columns tells them, and where they go."""
        if receiver is None:
            return None
        hidden = self.sensors[receiver].hidden_columns
        if TRUE_FIX not in hidden:
            raise BadInputError(f"scoring.fixes_of: {receiver!r} does not tell its true fixes ({TRUE_FIX})")
        return receiver, hidden.index(TRUE_FIX), StreamWriter((TRUE_FIX,), runs)

    @property
    def estimate_columns(self) -> dict[str, tuple[str, ...]]:
        """Columns of each estimator's stream."""
        return self._bank.columns

    def observe(self, sensor: str, capture: Capture) -> None:
        """Let a sensor sample, and put what it gives on its way to the estimators."""
        sample = self.sensors[sensor].sample(capture)
        self.events += sample.events
        for measurement in sample.measurements:
            self._bank.deliver(measurement)
            self._inbox.deliver(measurement)
        if sensor in self._hidden:
            self._keep(sensor, capture, sample)
        elif self._fixes is not None and sensor == self._fixes[0]:
            _, column, writer = self._fixes
            writer.append(capture.t_ns, sample.hidden[:, column : column + 1])

    def _keep(self, sensor: str, capture: Capture, sample: Sample) -> None:
        self._hidden[sensor].append(capture.t_ns, sample.hidden)
        if sample.pictures:
            self._pictures.setdefault(sensor, []).extend(sample.pictures)
        for measurement in sample.measurements:
            self._measured[sensor].append(
                measurement.t_ns,
                measurement.values,
                t_available_ns=measurement.t_available_ns,
                valid=measurement.valid,
            )

    def advance(self, t_ns: int) -> None:
        """All samples up to and including ``t_ns`` have been taken: let the estimators speak."""
        self._bank.advance(t_ns)

    def said(self, estimator: str) -> Said | None:
        """Latest estimate of one estimator, in the first run."""
        return self._bank.said(estimator)

    def measured(self, sensor: str, t_ns: int) -> Said | None:
        """Latest sample of one sensor that had arrived by ``t_ns``, in the first run."""
        return self._inbox.latest(sensor, t_ns)

    def finish(self) -> None:
        """The run has ended: let those speak that know better in hindsight."""
        self._bank.finish()

    def drain_estimates(self) -> dict[str, Stream]:
        """What each estimator said since the last time, by its name; it is valid until they speak again."""
        return self._bank.drain()

    def drain_fixes(self) -> Stream | None:
        """Since the last time, when the receiver whose true fixes are scored had one: column ``true_fix``.

        None if no receiver is asked for. Like estimates it is valid until more is observed.
        """
        return None if self._fixes is None else self._fixes[2].drain()

    def pictures(self) -> dict[str, Pictures]:
        """What the cameras of the first member saw, by sensor."""
        return {name: Pictures.of(taken) for name, taken in self._pictures.items()}

    def streams(self) -> dict[str, Stream]:
        """All that was measured, hidden and estimated, by stream name."""
        return {
            **{measurement_stream(name): writer.finish() for name, writer in self._measured.items()},
            **{hidden_stream(name): writer.finish() for name, writer in self._hidden.items()},
            **self._bank.streams(),
        }


class Inbox:
    """Samples of some sensors on their way to the driver and the implement's controller."""

    def __init__(self, sensors: Sequence[str]) -> None:
        self._under_way: dict[str, list[Measurement]] = {name: [] for name in sensors}
        self._latest: dict[str, Said] = {}

    def deliver(self, measurement: Measurement) -> None:
        """Put a measurement on its way, if driver or implement hears its sensor."""
        waiting = self._under_way.get(measurement.sensor)
        if waiting is not None and measurement.valid[0]:
            waiting.append(measurement)

    def latest(self, sensor: str, t_ns: int) -> Said | None:
        """The sample taken last of those that had arrived by ``t_ns``."""
        waiting = self._under_way[sensor]
        for measurement in [each for each in waiting if each.t_available_ns <= t_ns]:
            waiting.remove(measurement)
            before = self._latest.get(sensor)
            if before is None or measurement.t_ns >= before.t_ns:
                values = dict(zip(measurement.columns, measurement.values[0].tolist(), strict=True))
                self._latest[sensor] = Said(t_ns=measurement.t_ns, values=values)
        return self._latest.get(sensor)


def require_columns(
    scenario: Scenario, estimates: Mapping[str, Sequence[str]], measurements: Mapping[str, Sequence[str]]
) -> None:
    """Refuse a driver or a controller whose estimators or sensors do not give what it needs.

    Raises:
        BadInputError: naming the column.
    """
    for section, controller in scenario.controllers.items():
        for name, columns in controller.needed_columns.items():
            given = estimates if name in controller.listens.estimators else measurements
            missing = [column for column in columns if column not in given[name]]
            if missing:
                raise BadInputError(
                    f"{section}: {name!r} gives no {', '.join(missing)}, which kind {controller.kind!r} needs; it gives"
                    f" {', '.join(given[name])}"
                )


class SideBySide:
    """Several groups of members of one scenario, shown the same truth, each by itself as if it were alone.

    The schedules of the sensors belong to the world, so all groups sample at the same ticks.
    """

    def __init__(self, groups: Sequence[Members]) -> None:
        self.groups = groups

    @property
    def needs(self) -> Mapping[str, Need]:
        """What each sensor asks the world for."""
        return self.groups[0].needs

    def due(self, tick: int) -> Sequence[str]:
        """Sensors that sample at this tick, in the order of the scenario."""
        return self.groups[0].due(tick)

    def next_tick(self) -> int:
        """Tick of the next sample of any sensor; a tick that never comes where there are none."""
        return self.groups[0].next_tick()

    def observe(self, sensor: str, capture: Capture) -> None:
        """Show every group what the world shows a sensor."""
        for group in self.groups:
            group.observe(sensor, capture)

    def advance(self, t_ns: int) -> None:
        """All samples up to and including ``t_ns`` have been taken."""
        for group in self.groups:
            group.advance(t_ns)

    def said(self, estimator: str) -> Said | None:
        """Latest estimate of one estimator: whoever goes by it is alone with it."""
        return self._only.said(estimator)

    def measured(self, sensor: str, t_ns: int) -> Said | None:
        """Latest sample of one sensor that had arrived by ``t_ns``."""
        return self._only.measured(sensor, t_ns)

    @property
    def _only(self) -> Members:
        (group,) = self.groups
        return group


class Tape(SensorRack):
    """What the world shows the sensors of one scenario: recorded once, played to as many members as wanted.

    Possible wherever the world does not depend on the estimates (no closed loop).
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario, runs=(0,))
        self._shown: list[tuple[str, Capture]] = []
        self._end_ns = 0

    def observe(self, sensor: str, capture: Capture) -> None:
        """Keep what the world shows a sensor."""
        self._shown.append((sensor, capture))
        self.sensors[sensor].skip()

    def advance(self, t_ns: int) -> None:
        """Note how far the world has come."""
        self._end_ns = t_ns

    def play(self, members: Members, *, pause_ns: int) -> Iterator[int]:
        """Show everything to ``members``; pause now and then and say how far they have come (ns)."""
        pause_at = pause_ns
        for sensor, capture in self._shown:
            while capture.t_ns > pause_at:
                members.advance(pause_at)
                yield pause_at
                pause_at += pause_ns
            members.observe(sensor, capture)
        members.advance(self._end_ns)
        members.finish()
        yield self._end_ns
