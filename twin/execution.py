"""Walks the one way through the house once: scenario, world, sensors, estimators, recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np

from twin.control import CONTROL_HZ, Driver, LaneDriverConfig, build_driver, build_implement, is_blind
from twin.control.blade_sight import BladeSight
from twin.errors import BadInputError, WorldEndedError
from twin.estimation import EstimatorFactory
from twin.geometry import wrap_angle_scalar
from twin.groundlog import GroundLog, GroundLogWriter
from twin.members import Members, SideBySide
from twin.recording import TRUTH, Recording, Stream, StreamWriter
from twin.scenario import LoadedScenario, Scenario
from twin.scoring.checks import require_known
from twin.scoring.metrics import metric_names
from twin.scoring.planting import seed_streams
from twin.signals import (
    COLLISION,
    LANE_HEADING,
    LANE_OFFSET,
    NS_PER_S,
    Capture,
    Command,
    Event,
    FloatArray,
    Knowledge,
    Listening,
    Need,
    Said,
    nanoseconds,
)
from twin.world.simulation import World, build_world
from twin.world.terrain import AnyTerrain, FileTerrain

Progress = Callable[[float], None]
"""Called with the simulated time now and then."""

_PROGRESS_PERIOD_NS = NS_PER_S // 2
_SIGHT = "driver.sight"
"""Who says that the driver is blind: events of ``driver`` itself name segments."""
_GROUND_HZ = 5.0
"""How often changed ground is written down."""


class Observer(Protocol):
    """Whoever watches the world: the sensors and estimators of some runs, or a tape for them."""

    @property
    def needs(self) -> Mapping[str, Need]:
        """What each sensor asks the world for."""

    def due(self, tick: int) -> Sequence[str]:
        """Sensors that sample at this tick, in the order of the scenario."""

    def next_tick(self) -> int:
        """Tick of the next sample of any sensor."""

    def observe(self, sensor: str, capture: Capture) -> None:
        """Take what the world shows a sensor now."""

    def advance(self, t_ns: int) -> None:
        """All samples up to and including ``t_ns`` have been taken."""


class Confidant(Observer, Protocol):
    """An observer that driver and implement can ask."""

    def said(self, estimator: str) -> Said | None:
        """Latest estimate of one estimator."""

    def measured(self, sensor: str, t_ns: int) -> Said | None:
        """Latest sample of one sensor that had arrived by ``t_ns``."""


def execute(
    loaded: LoadedScenario,
    *,
    runs: Sequence[int] = (0,),
    full_rate: bool = False,
    plugins: Mapping[str, EstimatorFactory] | None = None,
    progress: Progress | None = None,
) -> Recording:
    """Run a scenario: one world, the noise of every run index in ``runs`` side by side.

    Raises:
        BadInputError: something in the scenario cannot be built, or a check names a metric that will not exist, or
            several runs are wanted of a scenario whose driver or implement goes by what is measured.
    """
    if len(runs) > 1 and loaded.scenario.listens.closes_loop:
        who = " and ".join(loaded.scenario.loop_closers)
        raise BadInputError(
            f"{loaded.path}: the commands of {who} depend on what is measured, so that every run moves its own way: one"
            " run at a time"
        )
    return _execute(loaded, groups=[runs], full_rate=full_rate, plugins=plugins, progress=progress)[0]


def execute_each(
    loaded: LoadedScenario,
    *,
    runs: Sequence[int],
    full_rate: bool = False,
    plugins: Mapping[str, EstimatorFactory] | None = None,
    progress: Progress | None = None,
) -> list[Recording]:
    """Run a scenario in one world for several run indices, each a recording of its own.

    Each is the ordinary run of its index to the last bit (members stepped together, as :func:`execute` does with
    several ``runs``, equal it to 1e-9 only), so that a replay of it finds the same. In ``timing`` the time is shared
    out equally.

    Raises:
        BadInputError: as :func:`execute`.
    """
    groups = [(run,) for run in runs]
    shared = [groups] if not loaded.scenario.listens.closes_loop else [[group] for group in groups]
    options: dict[str, Any] = {"full_rate": full_rate, "plugins": plugins, "progress": progress}
    return [recording for each in shared for recording in _execute(loaded, groups=each, **options)]


def _execute(
    loaded: LoadedScenario,
    *,
    groups: Sequence[Sequence[int]],
    full_rate: bool,
    plugins: Mapping[str, EstimatorFactory] | None,
    progress: Progress | None,
) -> list[Recording]:
    scenario = loaded.scenario
    started = time.perf_counter()
    everybody = SideBySide([open_members(loaded, runs=runs, plugins=plugins) for runs in groups])
    with open_world(loaded) as world:
        journey = Journey(scenario, world, everybody, full_rate=full_rate)
        names = metric_names(scenario, journey.truth_columns, everybody.groups[0].estimate_columns)
        require_known(scenario, names, where=str(loaded.path))
        reason = journey.go(progress)
        for members in everybody.groups:
            members.finish()
        wall_s = (time.perf_counter() - started) / len(groups)
        simulated_s = world.tick * world.dt_ns / NS_PER_S
        timing = {
            "simulated_s": simulated_s,
            "wall_s": wall_s,
            "real_time_factor": simulated_s / wall_s,
            "world_us_per_step": journey.world_s / max(1, world.tick) * 1e6,
            "bare_step_us": world.bare_step_us(),
        }
    truth = journey.truth_stream()
    recordings = [
        Recording(
            scenario_toml=loaded.toml,
            scenario_name=loaded.name,
            seed=scenario.seed,
            runs=tuple(runs),
            streams={TRUTH: truth, **members.streams()},
            pictures=members.pictures(),
            events=sorted([*journey.events, *members.events], key=lambda event: event.t_ns),
            terrain=world.first_terrain,
            ground=journey.ground_log(),
            ended_reason=reason,
            ended_t_s=simulated_s,
            timing=dict(timing),
        )
        for runs, members in zip(groups, everybody.groups, strict=True)
    ]
    for recording in recordings:
        recording.streams |= seed_streams(scenario, recording)
    return recordings


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the scenario file's name before what is said about it."""
    try:
        yield
    except BadInputError as error:
        raise error.within(str(path)) from error


def open_members(
    loaded: LoadedScenario,
    *,
    runs: Sequence[int],
    plugins: Mapping[str, EstimatorFactory] | None = None,
    keep_measurements: bool = True,
) -> Members:
    """Build sensors and estimators of a scenario for some runs.

    Raises:
        BadInputError: one of them cannot be built; the message names the file.
    """
    with _naming(loaded.path):
        return Members(loaded.scenario, runs=runs, plugins=plugins, keep_measurements=keep_measurements)


def open_world(loaded: LoadedScenario) -> World:
    """Build the world of a scenario, settled and ready to go.

    Raises:
        BadInputError: terrain or machine cannot be built, or the planned path leaves the terrain.
    """
    scenario = loaded.scenario
    with _naming(loaded.path):
        return build_world(
            _beside(scenario.terrain, loaded.path),
            scenario.soil,
            scenario.machine,
            seed=scenario.seed,
            dt_ns=scenario.dt_ns,
            path=_driver(scenario).path.polyline(),
            orchard=scenario.orchard,
            signs=scenario.signs,
            magnetics=scenario.magnetics,
            light=scenario.light,
            levelling=scenario.levelling,
        )


def _beside(terrain: AnyTerrain, scenario_file: Path) -> AnyTerrain:
    """A terrain file lies beside its scenario."""
    if isinstance(terrain, FileTerrain):
        return terrain.model_copy(update={"path": str(scenario_file.parent / terrain.path)})
    return terrain


def _driver(scenario: Scenario) -> Driver:
    machine = scenario.machine
    return build_driver(
        scenario.driver,
        start_e_n_heading=machine.vehicle_start,
        wheelbase_m=machine.wheelbase_m,
        seed=scenario.seed,
        reference_x_m=machine.reference_x_m,
    )


class Journey:
    """The loop over time: the driver commands, the world moves, the observer is shown what it asked for."""

    def __init__(
        self, scenario: Scenario, world: World, observer: Observer | Confidant, *, full_rate: bool = False
    ) -> None:
        self.events: list[Event] = []
        self.world_s = 0.0
        """Wall time spent in the world's own loop."""
        self._world = world
        self._observer = observer
        self._driver = _driver(scenario)
        self._implement = None if scenario.implement is None else build_implement(scenario.implement)
        self._lifts = scenario.machine.lift is not None
        self._sight = BladeSight(interval_s=1.0 / CONTROL_HZ)
        self._ticks = nanoseconds(scenario.duration_s) // world.dt_ns
        self._truth_every = 1 if full_rate else _period_ticks(scenario.recording.truth_hz, world.dt_ns)
        self._control_every = _period_ticks(CONTROL_HZ, world.dt_ns)
        self._listens = {section: controller.listens for section, controller in scenario.controllers.items()}
        self._keeps_lane = isinstance(scenario.driver, LaneDriverConfig)
        columns = (*world.truth_columns, "segment", *((LANE_OFFSET, LANE_HEADING) if self._keeps_lane else ()))
        self._truth = StreamWriter(columns, 1)
        self._ground = GroundLogWriter() if world.moves_soil else None
        self._ground_every = _period_ticks(_GROUND_HZ, world.dt_ns)
        self._last_segment = -1
        self._blind = False
        for name, need in observer.needs.items():
            world.watch(name, need)

    def go(self, progress: Progress | None = None) -> str:
        """Run to the end; return why it ended."""
        world, observer = self._world, self._observer
        next_truth = next_control = next_progress_ns = 0
        while True:
            tick = world.tick
            t_ns = tick * world.dt_ns
            for name in observer.due(tick):
                observer.observe(name, world.capture(name))
            collided = tick == next_control and world.touching
            if tick == next_truth or collided:
                self._note_truth(t_ns)
                next_truth = tick + self._truth_every
            if self._ground is not None and (tick % self._ground_every == 0 or tick >= self._ticks):
                self._ground.append(t_ns, *world.drain_ground())
            observer.advance(t_ns)
            if collided:
                self.events.append(Event(t_ns=t_ns, source="world", level="error", text="the machine touched a tree"))
                return COLLISION
            if tick == next_control:
                world.command(self._decide(t_ns))
                self._note_driver(t_ns)
                next_control += self._control_every
            if progress is not None and t_ns >= next_progress_ns:
                progress(t_ns / NS_PER_S)
                next_progress_ns += _PROGRESS_PERIOD_NS
            if tick >= self._ticks:
                return "duration"
            reason = self._move(min(self._ticks, next_truth, next_control, observer.next_tick()))
            if reason is not None:
                return reason

    def _note_truth(self, t_ns: int) -> None:
        """Write down what is true now."""
        row = self._world.truth()
        beside: FloatArray = np.array([float(self._driver.segment), *(self._in_lane() if self._keeps_lane else ())])
        self._truth.append(t_ns, row[np.newaxis, :], beside[np.newaxis, :])

    def _in_lane(self) -> tuple[float, float]:
        """Offset (m) and heading (rad) against the planned axis."""
        vehicle = self._world.vehicle()
        station_m, offset_m = self._driver.path.project(vehicle.east_m, vehicle.north_m)
        axis_rad = self._driver.path.pose(station_m).heading_rad
        return offset_m, wrap_angle_scalar(vehicle.heading_rad - axis_rad)

    def _decide(self, t_ns: int) -> Command:
        """What the driver, and after it whoever holds the implement, ask of the machine now."""
        interval_s = self._control_every * self._world.dt_ns / NS_PER_S
        command = self._driver.command(self._knowledge(t_ns, self._listens["driver"]), interval_s)
        if self._implement is None:
            return command
        knowledge = self._knowledge(t_ns, self._listens["implement"])
        seen = self._sight.look(self._world.load_share)
        return self._implement.amend(command, replace(knowledge, load_share=seen))

    def _knowledge(self, t_ns: int, listens: Listening) -> Knowledge:
        """What one of them goes by now, of whom it listens to."""
        confidant = cast("Confidant", self._observer)
        said = {name: confidant.said(name) for name in listens.estimators}
        measured = {name: confidant.measured(name, t_ns) for name in listens.sensors}
        return Knowledge(
            t_ns=t_ns,
            vehicle=self._world.vehicle() if listens.truth else None,
            implement=self._world.implement() if listens.truth and self._lifts else None,
            said={name: each for name, each in said.items() if each is not None},
            measured={name: each for name, each in measured.items() if each is not None},
        )

    def _move(self, to_tick: int) -> str | None:
        entered = time.perf_counter()
        try:
            self._world.advance(to_tick)
        except WorldEndedError as error:
            t_ns = self._world.tick * self._world.dt_ns
            self.events.append(Event(t_ns=t_ns, source="world", level="error", text=error.reason))
            return error.reason
        finally:
            self.world_s += time.perf_counter() - entered
        return None

    def _note_driver(self, t_ns: int) -> None:
        """Write down what the driver is at now, and since when it has nothing to go by, where that is new."""
        if is_blind(self._driver) != self._blind:
            self._blind = not self._blind
            level, text = ("warning", "nothing to go by") if self._blind else ("info", "sees again")
            self.events.append(Event(t_ns=t_ns, source=_SIGHT, level=level, text=text))
        if self._driver.segment != self._last_segment:
            self._last_segment = self._driver.segment
            name = self._driver.segment_names[self._driver.segment]
            self.events.append(Event(t_ns=t_ns, source="driver", level="info", text=name))

    @property
    def truth_columns(self) -> tuple[str, ...]:
        """Columns of the truth."""
        return self._truth.columns

    def ground_log(self) -> GroundLog | None:
        """How the ground changed until now; None where no machine moves soil."""
        return None if self._ground is None else self._ground.finish()

    def truth_stream(self) -> Stream:
        """What really happened until now (R = 1)."""
        return self._truth.finish()


def _period_ticks(rate_hz: float, dt_ns: int) -> int:
    return max(1, round(NS_PER_S / rate_hz / dt_ns))
