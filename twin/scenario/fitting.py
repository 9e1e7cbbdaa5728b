"""What has to fit together in a scenario: names that exist, a machine that can do what is asked, enough memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from twin import paths
from twin.control import PathDriverConfig, ReciprocationConfig
from twin.control.path_plan import Segment, tightest_m
from twin.errors import BadInputError
from twin.scenario.sections import unknown
from twin.sensors.triggers import sources
from twin.signals import NS_PER_S, JointNeed, nanoseconds
from twin.world.terrain import FileTerrain

if TYPE_CHECKING:
    from twin.scenario.model import Scenario

_LARGEST_RECORDING_BYTES = 4e9
_TIGHTEST_STEERED_M = 1.0


def _names_exist(scenario: Scenario) -> None:
    for name, sensor in scenario.sensors.items():
        if sensor.mount not in scenario.machine.mounts:
            raise ValueError(f"sensors.{name}.mount: {unknown(sensor.mount, scenario.machine.mounts, 'mount')}")
        need = sensor.need(scenario.machine.mounts[sensor.mount].mount())
        if isinstance(need, JointNeed):
            _require_joints(scenario, need, f"sensors.{name}")
    for name, estimator in scenario.estimators.items():
        for sensor_name in estimator.sensors:
            if sensor_name not in scenario.sensors:
                raise ValueError(f"estimators.{name}.sensors: {unknown(sensor_name, scenario.sensors, 'sensor')}")


def _triggers_exist(scenario: Scenario) -> None:
    for name in scenario.sensors:
        try:
            sources(name, scenario.sensors)
        except BadInputError as error:
            raise ValueError(str(error)) from None


def _require_joints(scenario: Scenario, need: JointNeed, key: str) -> None:
    joints, wanted = scenario.machine.joints, "slide" if need.slides else "hinge"
    for joint in need.joints:
        if joint not in joints:
            raise ValueError(f"{key}: {unknown(joint, joints, 'joint')}")
        if joints[joint] != need.slides:
            fitting = ", ".join(name for name, slides in joints.items() if slides == need.slides) or "none"
            raise ValueError(f"{key}: joint {joint!r} is no {wanted} (there are {fitting})")


def _scored_and_drawn_exist(scenario: Scenario) -> None:
    named = {f"recording.drawn.{index}": name for index, name in enumerate(scenario.recording.drawn)}
    bounds = ("causal_bound_of", "height_bound_of", "pass_to_pass_bound_of")
    named |= {f"scoring.{key}": getattr(scenario.scoring, key) for key in ("reference", *bounds)}
    for key, name in named.items():
        if name is not None and name not in scenario.estimators:
            raise ValueError(f"{key}: {unknown(name, scenario.estimators, 'estimator')}")
    receivers = [name for name, sensor in scenario.sensors.items() if sensor.kind == "gnss"]
    if scenario.scoring.fixes_of is not None and scenario.scoring.fixes_of not in receivers:
        raise ValueError(f"scoring.fixes_of: {unknown(scenario.scoring.fixes_of, receivers, 'GNSS receiver')}")
    loss = scenario.scoring.loss
    if loss is not None and loss.from_s >= scenario.duration_s:
        raise ValueError(f"scoring.loss.from_s = {loss.from_s:g}: the run ends at {scenario.duration_s:g} s")


def _receivers_write(scenario: Scenario) -> None:
    for name, style in scenario.nmea.items():
        for key, sensor, kind, what in (
            (f"nmea.{name}", name, "gnss", "GNSS receiver"),
            (f"nmea.{name}.imu", style.imu, "ahrs", "attitude reference"),
        ):
            fitting = [each for each, config in scenario.sensors.items() if config.kind == kind]
            if sensor is not None and sensor not in fitting:
                raise ValueError(f"{key}: {unknown(sensor, fitting, what)}")


def _controllers_hear(scenario: Scenario) -> None:
    for section, controller in scenario.controllers.items():
        listens = controller.listens
        keys = {value: key for key, value in controller if isinstance(value, str) and key != "kind"}
        heard: tuple[tuple[str, Mapping[str, Any], tuple[str, ...]], ...] = (
            ("estimator", scenario.estimators, listens.estimators),
            ("sensor", scenario.sensors, listens.sensors),
        )
        for what, known, names in heard:
            for name in names:
                if name not in known:
                    key = f"{section}.{keys[name]}" if name in keys else section
                    raise ValueError(f"{key}: {unknown(name, known, what)}")


def _machine_can(scenario: Scenario) -> None:
    wants_rows = {"seeding": scenario.seeding, "scoring.causal_bound_of": scenario.scoring.causal_bound_of}
    for key, value in wants_rows.items():
        if value is not None and not scenario.machine.rows_y_m:
            raise ValueError(f"{key}: machine {scenario.machine.kind} has no rows")
    if scenario.scoring.smallest_ramp_m_s is not None and not isinstance(scenario.driver, PathDriverConfig):
        raise ValueError("scoring.smallest_ramp_m_s: only the speed of a driver of kind 'path' is known beforehand")
    if scenario.implement is not None and scenario.machine.lift is None:
        raise ValueError(f"implement: a {scenario.machine.kind} has no implement that could be lifted")
    if scenario.implement is not None and scenario.machine.fixed:
        raise ValueError(f"implement: the hand that is the driver of a {scenario.machine.kind} moves it")


def _path_is_known(scenario: Scenario) -> None:
    wants_path = {
        "coverage": scenario.coverage is not None,
        "scoring.places": bool(scenario.scoring.places),
        "scoring.transition_s": scenario.scoring.transition_s is not None,
    }
    for key, wanted in wants_path.items():
        if wanted and not isinstance(scenario.driver, PathDriverConfig):
            raise ValueError(f"{key}: only a driver of kind 'path' has segments; this one is {scenario.driver.kind!r}")
    known = {leg.name: None for leg in scenario.planned_legs}
    for place in scenario.scoring.places:
        if place not in known:
            raise ValueError(f"scoring.places: {unknown(place, known, 'segment')}")


def _driver_can(scenario: Scenario) -> None:
    if scenario.machine.fixed != isinstance(scenario.driver, ReciprocationConfig):
        wants = "is a bench: its driver is of kind 'reciprocation'" if scenario.machine.fixed else "is no bench"
        raise ValueError(f"driver.kind: a {scenario.machine.kind} {wants}; given was {scenario.driver.kind!r}")
    if scenario.machine.turns_on_the_spot or scenario.machine.fixed:
        return
    if not isinstance(scenario.driver, PathDriverConfig):
        kind = scenario.driver.kind
        raise ValueError(f"driver.kind: {kind!r} turns on the spot, which a {scenario.machine.kind} cannot")  # noqa: TRY004
    if scenario.driver.listens.closes_loop and scenario.machine.reference_swings:
        body, root = scenario.machine.reference.body, scenario.machine.root
        raise ValueError(
            f"driver.follows: estimates are of a frame on {body!r}, which swings about the machine that is to be"
            f" steered; put machine.bar on {root!r}, or follow 'truth'"
        )
    for entry in scenario.driver.path:
        if isinstance(entry, Segment) and entry.spin_deg is not None:
            raise ValueError(f"driver.path: spin_deg: a {scenario.machine.kind} cannot turn on the spot; use turn_deg")
        radius_m, key = tightest_m(entry), "radius_m" if isinstance(entry, Segment) else "turn_radius_m"
        if radius_m is not None and radius_m < _TIGHTEST_STEERED_M:
            raise ValueError(
                f"driver.path: {key} = {radius_m:g}: a {scenario.machine.kind} turns on {_TIGHTEST_STEERED_M:g} m or"
                " more"
            )


def _rates_divide(scenario: Scenario) -> None:
    rates = {"recording.truth_hz": scenario.recording.truth_hz}
    rates |= {f"estimators.{name}.rate_hz": estimator.rate_hz for name, estimator in scenario.estimators.items()}
    for key, rate_hz in rates.items():
        if not (scenario.world.physics_hz / rate_hz).is_integer():
            raise ValueError(f"{key} = {rate_hz:g} does not divide the physics rate {scenario.world.physics_hz:g} Hz")


def _lasts_a_step(scenario: Scenario) -> None:
    if nanoseconds(scenario.duration_s) < scenario.dt_ns:
        step_s = scenario.dt_ns / NS_PER_S
        raise ValueError(f"duration_s = {scenario.duration_s:g}: shorter than one step of the physics, {step_s:g} s")


def _files_beside(scenario: Scenario) -> None:
    if isinstance(scenario.terrain, FileTerrain):
        try:
            paths.plain_name(scenario.terrain.path, what="terrain.path")
        except BadInputError as error:
            raise ValueError(str(error)) from None


def _bounded_memory(scenario: Scenario) -> None:
    rates = [s.rate_hz * s.recorded_columns for s in scenario.sensors.values()]
    rates += [estimator.rate_hz * 80 for estimator in scenario.estimators.values()]
    if scenario.seeding is not None:
        rates += [scenario.seeding.largest_rate_hz * len(scenario.machine.rows_y_m) * 6] * len(scenario.estimators)
    needed = 8.0 * scenario.duration_s * (scenario.recording.truth_hz * 100 + scenario.repetitions * sum(rates))
    if needed > _LARGEST_RECORDING_BYTES:
        raise ValueError(
            f"duration_s = {scenario.duration_s:g} with these rates would need about {needed / 1e9:.0f} GB of memory;"
            f" at most {_LARGEST_RECORDING_BYTES / 1e9:.0f} GB are allowed"
        )


RULES: tuple[Callable[[Scenario], None], ...] = (
    _names_exist,
    _triggers_exist,
    _scored_and_drawn_exist,
    _receivers_write,
    _controllers_hear,
    _machine_can,
    _path_is_known,
    _driver_can,
    _rates_divide,
    _lasts_a_step,
    _files_beside,
    _bounded_memory,
)
"""In order; each raises ValueError, which names the key, where the scenario breaks it."""
