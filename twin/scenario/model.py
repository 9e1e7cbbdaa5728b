"""What a scenario is: its sections, and what has to fit together in them."""

from __future__ import annotations

import re
from typing import Annotated, Any, Self

from pydantic import Field, Strict, field_validator, model_validator

from twin.config import Config
from twin.control import DriverConfigUnion, ImplementConfigUnion, PathDriverConfig
from twin.control.planned_legs import PlannedLeg, planned_legs
from twin.control.seed_metering import SeedingConfig
from twin.coverage import CoverageConfig
from twin.estimators import EstimatorConfigUnion
from twin.formats.geodetic import Origin
from twin.formats.nmea_style import NmeaStyle
from twin.formats.planter_bus import BusConfig
from twin.scenario.fitting import RULES
from twin.scenario.sections import Check, RecordingConfig, ScoringConfig, WorldConfig
from twin.sensors import SensorConfigUnion
from twin.signals import Listening
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

RESERVED = ("truth", "bound", "bus")
"""First words of metrics that belong to no estimator."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")


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
    def _fits_together(self) -> Self:
        for rule in RULES:
            rule(self)
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
