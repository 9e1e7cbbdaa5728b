"""What a scenario is: its sections, and what has to fit together in them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Self

from pydantic import Field, Strict, field_validator, model_validator

from twin import paths
from twin.config import Config, Names, NonNegative, Positive, Probability
from twin.control import DriverConfigUnion, ImplementConfigUnion, PathDriverConfig, ReciprocationConfig
from twin.control.path_plan import Segment, tightest_m
from twin.control.planned_legs import PlannedLeg, planned_legs
from twin.control.seed_metering import SeedingConfig
from twin.coverage import CoverageConfig
from twin.errors import BadInputError
from twin.estimators import EstimatorConfigUnion
from twin.families import LIMITED
from twin.formats.geodetic import Origin
from twin.formats.nmea_style import NmeaStyle
from twin.formats.planter_bus import BusConfig
from twin.sensors import SensorConfigUnion
from twin.sensors.triggers import sources
from twin.signals import JointNeed, Listening
from twin.validation import did_you_mean
from twin.world import (
    LevellingConfig,
    LightConfig,
    MachineConfig,
    MagneticsConfig,
    OrchardConfig,
    SignsConfig,
    SoilConfig,
    TerrainConfig,
)
from twin.world.terrain import FileTerrain

RESERVED = ("truth", "bound", "bus")
"""First words of metrics that belong to no estimator."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_LARGEST_RECORDING_BYTES = 4e9
_TIGHTEST_STEERED_M = 1.0


class WorldConfig(Config):
    """The clock of the physics."""

    physics_hz: Annotated[float, Field(ge=50.0, le=10_000.0)] = 500.0
    """Physics steps per second."""

    @field_validator("physics_hz")
    @classmethod
    def _whole_nanoseconds(cls, value: float) -> float:
        if not (1e9 / value).is_integer():
            raise ValueError("the step 1 / physics_hz has to be a whole number of nanoseconds, as 250, 500, 1000 Hz")
        return value


class Check(Config):
    """A requirement on one metric, on its ratio to another, or on its difference from another."""

    metric: str
    """Name of the metric, as in result.json."""
    min: float | None = None
    """Smallest value allowed."""
    max: float | None = None
    """Largest value allowed."""
    ratio_to: str | None = None
    """Another metric to divide by; under stress member by member."""
    min_ratio: float | None = None
    """Smallest ratio allowed."""
    max_ratio: float | None = None
    """Largest ratio allowed."""
    difference_to: str | None = None
    """Another metric to subtract; under stress member by member."""
    max_difference: float | None = None
    """Largest difference allowed: with 0.2, the metric is at most 0.2 above the other."""
    percentile: Annotated[float, Field(ge=0.0, le=100.0)] | None = None
    """Under stress: this share of the members has to keep it (in a single run the run itself)."""
    confidence: Probability | None = None
    """Under stress: with this confidence."""
    stress_only: bool = False
    """Judge only under stress: for statements about a distribution that a single run need not keep."""

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if (self.ratio_to is None) != (self.min_ratio is None and self.max_ratio is None):
            raise ValueError("ratio_to goes with min_ratio or max_ratio")
        if (self.difference_to is None) != (self.max_difference is None):
            raise ValueError("difference_to goes with max_difference")
        if self.ratio_to is not None and self.difference_to is not None:
            raise ValueError("a check has ratio_to or difference_to, not both")
        if self.confidence is not None and self.percentile is None:
            raise ValueError("confidence goes with a percentile")
        if self.min is None and self.max is None and self.ratio_to is None and self.difference_to is None:
            raise ValueError(
                "a check needs min, max, ratio_to with min_ratio or max_ratio, or difference_to with max_difference"
            )
        return self


class LossConfig(Config):
    """When something is missing."""

    from_s: NonNegative
    """Begin of the loss."""
    to_s: Positive
    """End of the loss."""

    @model_validator(mode="after")
    def _forwards(self) -> Self:
        if self.from_s >= self.to_s:
            raise ValueError(f"from_s = {self.from_s:g} is not before to_s = {self.to_s:g}")
        return self


class ScoringConfig(Config):
    """Which part of the run counts."""

    from_s: NonNegative = 0.0
    """Errors before this time (calibration, start-up) do not count."""
    rows: Annotated[tuple[int, ...], Strict(strict=False)] | None = None
    """Row units that count where no row is named; all if not given."""
    turning_rad_s: Annotated[float, Field(gt=0.0)] = 0.05
    """True yaw rate beyond which the machine is said to be turning."""
    transition_s: Positive | None = None
    """Phase ``transitions``: so many seconds or less before or after a place where the path begins or ceases to bend;
    the rest of turns and straights are the phases ``steady_turns`` and ``steady_straights``. Without it there are none
    of the three."""
    loss: LossConfig | None = None
    """Phases ``loss`` and ``after``; by default all of the faults' time windows."""
    causal_bound_of: str | None = None
    """Name of an estimator: also give the least row-speed error any causal filter with its sensors could have."""
    height_bound_of: str | None = None
    """Name of an estimator: also give the least error of the height any causal filter with its sensors could have."""
    pass_to_pass_bound_of: str | None = None
    """Name of an estimator: also give the least pass-to-pass error any causal filter with its receiver, wheels and gyro
    could have."""
    limits: Annotated[dict[str, Positive], Field(json_schema_extra={"propertyNames": {"enum": list(LIMITED)}})] = Field(
        default_factory=dict
    )
    """Error (m/s, m) whose first excess since a loss is timed, by family: ``<family>.time_to_limit_s``."""
    fixes_of: str | None = None
    """GNSS receiver whose first true fix after the loss begins the time of recovery: ``height.recovery_s`` and others;
    without it they are not told."""
    smallest_ramp_m_s: Positive | None = None
    """Change of speed from which on reaction time and lag are measured, ``speed.reaction_accelerating_s`` and others;
    without it they are not."""
    reference: str | None = None
    """Estimator from which the others' difference is measured too, ``row_speed.mean_abs_difference_m_s``: what a paper
    without a truth took for it."""
    guidance: bool | None = None
    """Whether also to measure what guidance along lines is judged by: ``cross_track.rmse_m``, ``pass_to_pass.p95_m``,
    ``step.smallest_e_m`` and others. By default where there is a ``[coverage]``, or an estimator of a ``guidance_``
    kind."""
    places: Names = ()
    """Names of segments of the driver's path (their ``label``, if they have one) for each of which the deviation of
    every estimated position is told: ``place.<name>.sigma_e_m`` and others."""

    @field_validator("places")
    @classmethod
    def _places_with_names_of_their_own(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        told: dict[str, str] = {}
        for place in value:
            key = place_key(place)
            if not key:
                raise ValueError(f"places: {place!r} has no letter or digit to name metrics by")
            if key in told:
                raise ValueError(f"places: {told[key]!r} and {place!r} would both be {key!r} in metrics")
            told[key] = place
        return value

    @field_validator("limits")
    @classmethod
    def _families_that_may_be_limited(cls, value: dict[str, float]) -> dict[str, float]:
        for name in value:
            if name not in LIMITED:
                raise ValueError(unknown(name, LIMITED, "family"))
        return value


def place_key(place: str) -> str:
    """How metrics name a place: in small letters and digits."""
    return re.sub(r"[^a-z0-9]+", "_", place.lower()).strip("_")


class RecordingConfig(Config):
    """What is kept."""

    truth_hz: Annotated[float, Field(gt=0.0)] = 50.0
    """Rate of the truth stream."""
    baseline_trace: bool = False
    """Keep what the estimators said once a second beside the baseline of the metrics."""
    drawn: Names = ()
    """Estimators drawn in the recording for the viewer, where there are too many for one picture; all if none is
    named. The streams hold all of them either way."""


class Scenario(Config):
    """A resolved scenario: everything a run needs, and nothing that is not data."""

    title: str
    """One line for people."""
    source: str = ""
    """Where the experiment comes from, e.g. a paper and its section."""
    notes: str = ""
    """What to know when reading the results."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    """World seed: terrain, driver, sensor schedules."""
    repetitions: Annotated[int, Field(ge=1, le=20)] = 1
    """Runs that ``twin run`` makes in the same world: its run index and those that follow. Every check has to hold in
    each of them; the baseline is compared with the first, and only that is written for the viewer. Stress tests and
    Python have their own number of runs."""
    duration_s: Annotated[float, Field(gt=0.0, le=36_000.0)]
    """Simulated time."""
    world: WorldConfig = WorldConfig()
    origin: Origin = Origin()
    """Where on the globe the local frame lies: only receivers' sentences and maps know."""
    terrain: TerrainConfig
    soil: SoilConfig
    orchard: OrchardConfig = OrchardConfig()
    """Trees; without them there are none."""
    signs: SignsConfig = ()
    """Stop signs."""
    light: LightConfig = LightConfig()
    """How bright it is."""
    magnetics: MagneticsConfig = MagneticsConfig()
    """The earth's magnetic field, and magnets and iron in the field."""
    levelling: LevellingConfig = LevellingConfig()
    """The design plane, above which heights are told, and the area whose flatness counts."""
    machine: MachineConfig
    driver: DriverConfigUnion
    implement: ImplementConfigUnion | None = None
    """Who holds the implement; without it, it stays where it is."""
    sensors: dict[str, SensorConfigUnion] = Field(default_factory=dict)
    """Sensors by name; each names a preset, or a kind with all its values."""
    estimators: dict[str, EstimatorConfigUnion] = Field(default_factory=dict)
    """Estimators by name."""
    coverage: CoverageConfig | None = None
    """The area to be worked once everywhere, and how wide; without it no overlap and no skip is counted."""
    seeding: SeedingConfig | None = None
    """What the row units plant; without it no seed is metered."""
    bus: dict[str, BusConfig] = Field(default_factory=dict)
    """CAN buses whose load is worked out, by name; they have no effect on the run."""
    nmea: dict[str, NmeaStyle] = Field(default_factory=dict)
    """How receivers write their sentences, by sensor; of the others position_resolution_m and the states decide."""
    scoring: ScoringConfig = ScoringConfig()
    recording: RecordingConfig = RecordingConfig()
    published: dict[str, float] = Field(default_factory=dict)
    """Published figures by metric, printed beside ours."""
    checks: Annotated[tuple[Check, ...], Strict(strict=False)] = ()

    @field_validator("sensors", "estimators", "bus")
    @classmethod
    def _plain_names(cls, value: dict[str, Any]) -> dict[str, Any]:
        for name in value:
            if not _NAME.match(name) or name == "truth":
                raise ValueError(f"name {name!r}: expected letters, digits and '_' (and not 'truth')")
        return value

    @field_validator("estimators")
    @classmethod
    def _names_of_their_own(cls, value: dict[str, Any]) -> dict[str, Any]:
        for name in value:
            if name in RESERVED:
                raise ValueError(f"name {name!r}: reserved, as {', '.join(RESERVED)} are, for metrics of no estimator")
        return value

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        for name, sensor in self.sensors.items():
            if sensor.mount not in self.machine.mounts:
                raise ValueError(f"sensors.{name}.mount: {unknown(sensor.mount, self.machine.mounts, 'mount')}")
            need = sensor.need(self.machine.mounts[sensor.mount].mount())
            if isinstance(need, JointNeed):
                self._require_joints(need, f"sensors.{name}")
        for name, estimator in self.estimators.items():
            for sensor_name in estimator.sensors:
                if sensor_name not in self.sensors:
                    raise ValueError(f"estimators.{name}.sensors: {unknown(sensor_name, self.sensors, 'sensor')}")
        return self

    @model_validator(mode="after")
    def _triggers_exist(self) -> Self:
        for name in self.sensors:
            try:
                sources(name, self.sensors)
            except BadInputError as error:
                raise ValueError(str(error)) from None
        return self

    def _require_joints(self, need: JointNeed, key: str) -> None:
        joints, wanted = self.machine.joints, "slide" if need.slides else "hinge"
        for joint in need.joints:
            if joint not in joints:
                raise ValueError(f"{key}: {unknown(joint, joints, 'joint')}")
            if joints[joint] != need.slides:
                fitting = ", ".join(name for name, slides in joints.items() if slides == need.slides) or "none"
                raise ValueError(f"{key}: joint {joint!r} is no {wanted} (there are {fitting})")

    @model_validator(mode="after")
    def _scored_and_drawn_exist(self) -> Self:
        named = {f"recording.drawn.{index}": name for index, name in enumerate(self.recording.drawn)}
        bounds = ("causal_bound_of", "height_bound_of", "pass_to_pass_bound_of")
        named |= {f"scoring.{key}": getattr(self.scoring, key) for key in ("reference", *bounds)}
        for key, name in named.items():
            if name is not None and name not in self.estimators:
                raise ValueError(f"{key}: {unknown(name, self.estimators, 'estimator')}")
        receivers = [name for name, sensor in self.sensors.items() if sensor.kind == "gnss"]
        if self.scoring.fixes_of is not None and self.scoring.fixes_of not in receivers:
            raise ValueError(f"scoring.fixes_of: {unknown(self.scoring.fixes_of, receivers, 'GNSS receiver')}")
        loss = self.scoring.loss
        if loss is not None and loss.from_s >= self.duration_s:
            raise ValueError(f"scoring.loss.from_s = {loss.from_s:g}: the run ends at {self.duration_s:g} s")
        return self

    @model_validator(mode="after")
    def _receivers_write(self) -> Self:
        for name, style in self.nmea.items():
            for key, sensor, kind, what in (
                (f"nmea.{name}", name, "gnss", "GNSS receiver"),
                (f"nmea.{name}.imu", style.imu, "ahrs", "attitude reference"),
            ):
                fitting = [each for each, config in self.sensors.items() if config.kind == kind]
                if sensor is not None and sensor not in fitting:
                    raise ValueError(f"{key}: {unknown(sensor, fitting, what)}")
        return self

    @model_validator(mode="after")
    def _controllers_hear(self) -> Self:
        for section, controller in self.controllers.items():
            listens = controller.listens
            keys = {value: key for key, value in controller if isinstance(value, str) and key != "kind"}
            heard: tuple[tuple[str, Mapping[str, Any], tuple[str, ...]], ...] = (
                ("estimator", self.estimators, listens.estimators),
                ("sensor", self.sensors, listens.sensors),
            )
            for what, known, names in heard:
                for name in names:
                    if name not in known:
                        key = f"{section}.{keys[name]}" if name in keys else section
                        raise ValueError(f"{key}: {unknown(name, known, what)}")
        return self

    @property
    def controllers(self) -> dict[str, DriverConfigUnion | ImplementConfigUnion]:
        """Who commands the machine, by the name of the section."""
        return {"driver": self.driver} | ({} if self.implement is None else {"implement": self.implement})

    @property
    def loop_closers(self) -> list[str]:
        """Those of :attr:`controllers` that go by what is measured."""
        return [section for section, controller in self.controllers.items() if controller.listens.closes_loop]

    @property
    def listens(self) -> Listening:
        """Whom driver and implement listen to together."""
        return self.driver.listens if self.implement is None else self.driver.listens | self.implement.listens

    @model_validator(mode="after")
    def _machine_can(self) -> Self:
        wants_rows = {"seeding": self.seeding, "scoring.causal_bound_of": self.scoring.causal_bound_of}
        for key, value in wants_rows.items():
            if value is not None and not self.machine.rows_y_m:
                raise ValueError(f"{key}: machine {self.machine.kind} has no rows")
        if self.scoring.smallest_ramp_m_s is not None and not isinstance(self.driver, PathDriverConfig):
            raise ValueError("scoring.smallest_ramp_m_s: only the speed of a driver of kind 'path' is known beforehand")
        if self.implement is not None and self.machine.lift is None:
            raise ValueError(f"implement: a {self.machine.kind} has no implement that could be lifted")
        if self.implement is not None and self.machine.fixed:
            raise ValueError(f"implement: the hand that is the driver of a {self.machine.kind} moves it")
        return self

    @model_validator(mode="after")
    def _path_is_known(self) -> Self:
        wants_path = {
            "coverage": self.coverage is not None,
            "scoring.places": bool(self.scoring.places),
            "scoring.transition_s": self.scoring.transition_s is not None,
        }
        for key, wanted in wants_path.items():
            if wanted and not isinstance(self.driver, PathDriverConfig):
                raise ValueError(f"{key}: only a driver of kind 'path' has segments; this one is {self.driver.kind!r}")
        known = {leg.name: None for leg in self.planned_legs}
        for place in self.scoring.places:
            if place not in known:
                raise ValueError(f"scoring.places: {unknown(place, known, 'segment')}")
        return self

    @model_validator(mode="after")
    def _driver_can(self) -> Self:
        if self.machine.fixed != isinstance(self.driver, ReciprocationConfig):
            wants = "is a bench: its driver is of kind 'reciprocation'" if self.machine.fixed else "is no bench"
            raise ValueError(f"driver.kind: a {self.machine.kind} {wants}; given was {self.driver.kind!r}")
        if self.machine.turns_on_the_spot or self.machine.fixed:
            return self
        if not isinstance(self.driver, PathDriverConfig):
            kind = self.driver.kind
            raise ValueError(f"driver.kind: {kind!r} turns on the spot, which a {self.machine.kind} cannot")  # noqa: TRY004
        if self.driver.listens.closes_loop and self.machine.reference_swings:
            body, root = self.machine.reference.body, self.machine.root
            raise ValueError(
                f"driver.follows: estimates are of a frame on {body!r}, which swings about the machine that is to be"
                f" steered; put machine.bar on {root!r}, or follow 'truth'"
            )
        for entry in self.driver.path:
            if isinstance(entry, Segment) and entry.spin_deg is not None:
                raise ValueError(f"driver.path: spin_deg: a {self.machine.kind} cannot turn on the spot; use turn_deg")
            radius_m, key = tightest_m(entry), "radius_m" if isinstance(entry, Segment) else "turn_radius_m"
            if radius_m is not None and radius_m < _TIGHTEST_STEERED_M:
                raise ValueError(
                    f"driver.path: {key} = {radius_m:g}: a {self.machine.kind} turns on {_TIGHTEST_STEERED_M:g} m or"
                    " more"
                )
        return self

    @model_validator(mode="after")
    def _rates_divide(self) -> Self:
        rates = {"recording.truth_hz": self.recording.truth_hz}
        rates |= {f"estimators.{name}.rate_hz": estimator.rate_hz for name, estimator in self.estimators.items()}
        for key, rate_hz in rates.items():
            if not (self.world.physics_hz / rate_hz).is_integer():
                raise ValueError(f"{key} = {rate_hz:g} does not divide the physics rate {self.world.physics_hz:g} Hz")
        return self

    @model_validator(mode="after")
    def _files_beside(self) -> Self:
        if isinstance(self.terrain, FileTerrain):
            try:
                paths.plain_name(self.terrain.path, what="terrain.path")
            except BadInputError as error:
                raise ValueError(str(error)) from None
        return self

    @model_validator(mode="after")
    def _bounded_memory(self) -> Self:
        rates = [s.rate_hz * s.recorded_columns for s in self.sensors.values()]
        rates += [estimator.rate_hz * 80 for estimator in self.estimators.values()]
        if self.seeding is not None:
            rates += [self.seeding.largest_rate_hz * len(self.machine.rows_y_m) * 6] * len(self.estimators)
        needed = 8.0 * self.duration_s * (self.recording.truth_hz * 100 + self.repetitions * sum(rates))
        if needed > _LARGEST_RECORDING_BYTES:
            raise ValueError(
                f"duration_s = {self.duration_s:g} with these rates would need about {needed / 1e9:.0f} GB of memory;"
                f" at most {_LARGEST_RECORDING_BYTES / 1e9:.0f} GB are allowed"
            )
        return self

    @property
    def judges_guidance(self) -> bool:
        """Whether errors across the track and between passes are measured."""
        if self.scoring.guidance is not None:
            return self.scoring.guidance
        return self.coverage is not None or any(each.kind.startswith("guidance_") for each in self.estimators.values())

    @property
    def planned_legs(self) -> list[PlannedLeg]:
        """What a path driver does, by the truth's column ``segment``; nothing of other drivers."""
        if not isinstance(self.driver, PathDriverConfig):
            return []
        return planned_legs(self.driver, self.machine.vehicle_start)

    @property
    def loss_window_s(self) -> tuple[float, float] | None:
        """From when until when the sensors' faults act (the first beginning, the last end), s; None without any."""
        if self.scoring.loss is not None:
            return self.scoring.loss.from_s, self.scoring.loss.to_s
        windows = [
            (fault.from_s, self.duration_s if fault.to_s is None else fault.to_s)
            for sensor in self.sensors.values()
            for fault in sensor.faults
            if fault.inside is None and fault.near is None
        ]
        return (min(begin for begin, _ in windows), max(end for _, end in windows)) if windows else None

    @property
    def dt_ns(self) -> int:
        """Physics step, ns."""
        return round(1e9 / self.world.physics_hz)


def unknown(given: str, allowed: Sequence[str] | Mapping[str, Any], what: str) -> str:
    """Say that a name is not known, with the nearest one and all that are."""
    return f"unknown {what} {given!r}{did_you_mean(given, allowed)} (there are {', '.join(sorted(allowed)) or 'none'})"
