"""A scenario file: what to run, as data. Found, merged, checked, and resolved so that it stands alone.

A file is read in this order: the file named by ``extends`` (in the same folder; a name that begins with ``_`` is a
file that is no scenario of its own), the file itself on top of it, the
caller's ``--set`` values, and then each sensor's preset below what the file says of that sensor.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

import tomli_w
from pydantic import Field, Strict, ValidationError, field_validator, model_validator

from twin import paths
from twin.config import Config, NonNegative, Positive, Probability
from twin.control.driver import DriverConfig
from twin.errors import BadInputError
from twin.estimators import EstimatorConfigUnion
from twin.sensors import SensorConfigUnion
from twin.sensors.presets import load_preset, preset_files
from twin.validation import did_you_mean, explain, models_of
from twin.world import MachineConfig, SoilConfig, TerrainConfig
from twin.world.terrain import FileTerrain

_LARGEST_FILE = 1_000_000
_DEEPEST_EXTENDS = 5
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_LARGEST_RECORDING_BYTES = 4e9

Table = dict[str, Any]


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
    """A requirement on one metric, or on its ratio to another."""

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
        if self.confidence is not None and self.percentile is None:
            raise ValueError("confidence goes with a percentile")
        if self.min is None and self.max is None and self.ratio_to is None:
            raise ValueError("a check needs min, max, or ratio_to with min_ratio or max_ratio")
        return self


class LossConfig(Config):
    """When something is missing."""

    from_s: NonNegative
    """Begin of the loss."""
    to_s: Positive
    """End of the loss."""


class ScoringConfig(Config):
    """Which part of the run counts."""

    from_s: NonNegative = 0.0
    """Errors before this time (calibration, start-up) do not count."""
    rows: Annotated[tuple[int, ...], Strict(strict=False)] | None = None
    """Row units that count where no row is named; all if not given."""
    turning_rad_s: Annotated[float, Field(gt=0.0)] = 0.05
    """True yaw rate beyond which the machine is said to be turning."""
    loss: LossConfig | None = None
    """Phases ``loss`` and ``after``; by default all of the faults' time windows."""
    limits: dict[Literal["row_speed", "row_position", "position"], Positive] = Field(default_factory=dict)
    """Error (m/s, m) whose first excess since a loss is timed, by family: ``<family>.time_to_limit_s``."""
    smallest_ramp_m_s: Positive | None = None
    """Change of speed from which on reaction time and lag are measured, ``speed.reaction_accelerating_s`` and others;
    without it they are not."""
    reference: str | None = None
    """Estimator from which the others' difference is measured too, ``row_speed.mean_abs_difference_m_s``: what a paper
    without a truth took for it."""


class RecordingConfig(Config):
    """What is kept."""

    truth_hz: Annotated[float, Field(gt=0.0)] = 50.0
    """Rate of the truth stream."""
    baseline_trace: bool = False
    """Keep what the estimators said once a second beside the baseline of the metrics."""


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
    duration_s: Annotated[float, Field(gt=0.0, le=36_000.0)]
    """Simulated time."""
    world: WorldConfig = WorldConfig()
    terrain: TerrainConfig
    soil: SoilConfig
    machine: MachineConfig
    driver: DriverConfig
    sensors: dict[str, SensorConfigUnion] = Field(default_factory=dict)
    """Sensors by name; each names a preset, or a kind with all its values."""
    estimators: dict[str, EstimatorConfigUnion] = Field(default_factory=dict)
    """Estimators by name."""
    scoring: ScoringConfig = ScoringConfig()
    recording: RecordingConfig = RecordingConfig()
    published: dict[str, float] = Field(default_factory=dict)
    """Published figures by metric, printed beside ours."""
    checks: Annotated[tuple[Check, ...], Strict(strict=False)] = ()

    @field_validator("sensors", "estimators")
    @classmethod
    def _plain_names(cls, value: dict[str, Any]) -> dict[str, Any]:
        for name in value:
            if not _NAME.match(name) or name == "truth":
                raise ValueError(f"name {name!r}: expected letters, digits and '_' (and not 'truth')")
        return value

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        for name, sensor in self.sensors.items():
            if sensor.mount not in self.machine.mounts:
                raise ValueError(f"sensors.{name}.mount: {unknown(sensor.mount, self.machine.mounts, 'mount')}")
        for name, estimator in self.estimators.items():
            for sensor_name in estimator.sensors:
                if sensor_name not in self.sensors:
                    raise ValueError(f"estimators.{name}.sensors: {unknown(sensor_name, self.sensors, 'sensor')}")
        if self.scoring.reference is not None and self.scoring.reference not in self.estimators:
            raise ValueError(f"scoring.reference: {unknown(self.scoring.reference, self.estimators, 'estimator')}")
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
        rates = [self.recording.truth_hz * 100, *(s.rate_hz * 40 for s in self.sensors.values())]
        rates += [estimator.rate_hz * 80 for estimator in self.estimators.values()]
        needed = 8.0 * self.duration_s * sum(rates)
        if needed > _LARGEST_RECORDING_BYTES:
            raise ValueError(
                f"duration_s = {self.duration_s:g} with these rates would need about {needed / 1e9:.0f} GB of memory;"
                f" at most {_LARGEST_RECORDING_BYTES / 1e9:.0f} GB are allowed"
            )
        return self

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


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedScenario:
    """A scenario with where it came from."""

    name: str
    path: Path
    scenario: Scenario
    toml: str
    """The resolved scenario as TOML: reading it gives the same scenario again."""

    @property
    def bundled(self) -> bool:
        """Whether it comes with the package, so that its name is enough to find it."""
        return bundled().get(self.name) == self.path

    @property
    def sha256(self) -> str:
        """Fingerprint of the resolved scenario."""
        return hashlib.sha256(self.toml.encode()).hexdigest()


def unknown(given: str, allowed: Sequence[str] | Mapping[str, Any], what: str) -> str:
    """Say that a name is not known, with the nearest one and all that are."""
    return f"unknown {what} {given!r}{did_you_mean(given, allowed)} (there are {', '.join(sorted(allowed)) or 'none'})"


# --- finding ---------------------------------------------------------------------------------------------------------


def bundled() -> dict[str, Path]:
    """Scenarios that come with the package, by name."""
    return {path.stem: path for path in _scenarios_below(paths.SCENARIOS)}


def _scenarios_below(folder: Path) -> list[Path]:
    """Scenario files of a folder; a name that begins with ``_`` is only there to be extended."""
    return [path for path in sorted(folder.rglob("*.toml")) if not path.stem.startswith("_")]


def find(what: str) -> list[Path]:
    """Return the scenario files that a name, file or folder stands for.

    Raises:
        BadInputError: there is no such file, folder or bundled scenario.
    """
    path = Path(what)
    if path.is_dir():
        files = _scenarios_below(path)
        if not files:
            raise BadInputError(f"{path}: no scenario (*.toml) in this folder")
        return files
    if path.is_file():
        return [path]
    known = bundled()
    if what in known:
        return [known[what]]
    if path.suffix or len(path.parts) > 1:
        raise BadInputError(f"{path}: no such scenario file")
    raise BadInputError(unknown(what, known, "scenario"))


# --- reading ---------------------------------------------------------------------------------------------------------


def read_toml(path: Path) -> Table:
    """Read a TOML file of bounded size.

    Raises:
        BadInputError: not readable, too large, not UTF-8 or not TOML.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise BadInputError(f"{path}: larger than {_LARGEST_FILE} bytes: not a scenario")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BadInputError(f"{path}: not valid TOML ({error})") from error
    except RecursionError as error:
        raise BadInputError(f"{path}: nested too deeply") from error


def merge(base: Table, changes: Table) -> Table:
    """Lay ``changes`` over ``base``: tables are merged key by key, everything else is replaced."""
    merged = dict(base)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = merge(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged


def _read_extended(path: Path, depth: int = 0) -> Table:
    table = read_toml(path)
    parent = table.pop("extends", None)
    if parent is None:
        return table
    if not isinstance(parent, str):
        raise BadInputError(f"{path}: extends: given {parent!r}, expected the name of a scenario in the same folder")
    if depth >= _DEEPEST_EXTENDS:
        raise BadInputError(f"{path}: extends: more than {_DEEPEST_EXTENDS} files deep")
    parent_path = path.parent / f"{paths.plain_name(parent, what=f'{path}: extends:')}.toml"
    if not parent_path.is_file():
        raise BadInputError(f"{path}: extends: there is no {parent_path.name} beside it")
    return merge(_read_extended(parent_path, depth + 1), table)


def parse_setting(text: str) -> tuple[str, Any]:
    """Split ``KEY=VALUE`` of ``--set``; the value is read as TOML, and as plain text where it is not TOML.

    Raises:
        BadInputError: there is no ``=``.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise BadInputError(f"--set {text!r}: expected KEY=VALUE, as driver.speed_m_s=3.0")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def apply_setting(table: Table, key: str, value: Any) -> None:
    """Set a dotted key (``sensors.gnss.faults.0.to_s``) in a nested table; tables on the way are made.

    Raises:
        BadInputError: the key leads through something that is neither a table nor an array.
    """
    parts = key.split(".")
    at: Any = table
    for index, part in enumerate(parts):
        last = index == len(parts) - 1
        if isinstance(at, list):
            if not part.isdigit() or int(part) >= len(at):
                raise BadInputError(f"--set {key}: {'.'.join(parts[:index])} has {len(at)} entries, not {part!r}")
            if last:
                at[int(part)] = value
            at = at[int(part)]
        elif isinstance(at, dict):
            if last:
                at[part] = value
            at = at.setdefault(part, {})
        else:
            raise BadInputError(f"--set {key}: {'.'.join(parts[:index])} is a value, not a table")


def _with_preset(table: Any, where: str) -> Any:
    if not isinstance(table, dict) or "preset" not in table:
        return table
    name = table["preset"]
    if not isinstance(name, str):
        raise BadInputError(f"{where}.preset: given {name!r}, expected the name of a preset")
    try:
        values = load_preset(name)
    except BadInputError as error:
        raise BadInputError(f"{where}.preset: {error}") from error
    return merge(values, {key: value for key, value in table.items() if key != "preset"})


def resolve(table: Table, *, where: str) -> Scenario:
    """Put presets in and check everything.

    Raises:
        BadInputError: naming file (``where``), key, what was given and what is allowed.
    """
    sensors = table.get("sensors")
    if isinstance(sensors, dict):
        resolved = {name: _with_preset(value, f"{where}: sensors.{name}") for name, value in sensors.items()}
        table = {**table, "sensors": resolved}
    try:
        return Scenario.model_validate(table)
    except ValidationError as error:
        raise BadInputError(explain(error, Scenario, where)) from None


def _dump(scenario: Scenario) -> str:
    return tomli_w.dumps(scenario.model_dump(mode="json", exclude_none=True))


def load(path: Path, *, settings: Sequence[tuple[str, Any]] = ()) -> LoadedScenario:
    """Read, merge and check a scenario file.

    Raises:
        BadInputError: anything is wrong with the file or the settings.
    """
    name = paths.plain_name(path.stem, what=f"{path}: file name")
    table = _read_extended(path)
    for key, value in settings:
        apply_setting(table, key, value)
    scenario = resolve(table, where=str(path))
    return LoadedScenario(name=name, path=path, scenario=scenario, toml=_dump(scenario))


def loads(toml: str, *, where: str) -> Scenario:
    """Read a resolved scenario back from its text.

    Raises:
        BadInputError: it is not a scenario.
    """
    try:
        return resolve(tomllib.loads(toml), where=where)
    except tomllib.TOMLDecodeError as error:
        raise BadInputError(f"{where}: not valid TOML ({error})") from error


# --- describing ------------------------------------------------------------------------------------------------------


def kinds() -> dict[str, list[str]]:
    """Which kinds of terrain, machine, sensor and estimator there are."""
    sections = ("terrain", "machine", "sensors", "estimators")
    return {
        section: [
            get_args(model.model_fields["kind"].annotation)[0]
            for model in models_of(Scenario.model_fields[section].annotation)
        ]
        for section in sections
    }


def json_schema() -> Table:
    """JSON Schema of scenario files as people write them (with ``extends`` and ``preset``)."""
    schema = Scenario.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["properties"]["extends"] = {
        "type": "string",
        "description": "Name of a scenario in the same folder that this one changes.",
    }
    sensors = schema["properties"]["sensors"]
    preset = {
        "type": "object",
        "required": ["preset"],
        "properties": {"preset": {"enum": sorted(preset_files()), "description": "Preset that the other keys change."}},
    }
    sensors["additionalProperties"] = {"anyOf": [preset, sensors["additionalProperties"]]}
    return schema
