"""Scenario files: found by name, file or folder, read, merged, and resolved so that a scenario stands alone.

A file is read in this order: the file named by ``extends`` (in the same folder; a name that begins with ``_`` is a
file that is no scenario of its own), the file itself on top of it, the caller's ``--set`` values, and then each
sensor's preset below what the file says of that sensor. Tables are merged key by key; a table of another ``kind``
replaces the inherited one, whose keys belong to the kind it had; an array (``path``, ``checks``) replaces the inherited
one, except that ``[[extra_checks]]`` are put behind the inherited checks.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from twin import paths
from twin.control import DEFAULT_DRIVER
from twin.errors import BadInputError
from twin.scenario.model import Scenario
from twin.scenario.sections import unknown
from twin.sensors.presets import load_preset
from twin.validation import did_you_mean, explain, unknown_listed

_LARGEST_FILE = 1_000_000
_DEEPEST_EXTENDS = 5

Table = dict[str, Any]


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
    raise BadInputError(unknown_listed(what, known, "scenario"))


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
    """Lay ``changes`` over ``base``: tables of one kind are merged key by key, everything else is replaced."""
    if "kind" in base and changes.get("kind", base["kind"]) != base["kind"]:
        return changes
    merged = dict(base)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = merge(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged


def _read_extended(path: Path, above: tuple[Path, ...] = ()) -> Table:
    """Read a file on top of what it extends; ``above`` are the files that extend it."""
    table = read_toml(path)
    parent = table.pop("extends", None)
    if parent is None:
        return _with_extra_checks(_with_drivers_kind(table), path)
    if not isinstance(parent, str):
        raise BadInputError(f"{path}: extends: given {parent!r}, expected the name of a scenario in the same folder")
    if len(above) >= _DEEPEST_EXTENDS:
        raise BadInputError(f"{path}: extends: more than {_DEEPEST_EXTENDS} files deep")
    parent_path = path.parent / f"{paths.plain_name(parent, what=f'{path}: extends:')}.toml"
    way = (*above, path)
    if parent_path in way:
        names = " -> ".join(each.stem for each in (*way[way.index(parent_path) :], parent_path))
        raise BadInputError(f"{path}: extends: {parent!r} extends itself ({names})")
    if not parent_path.is_file():
        hint = did_you_mean(parent, (each.stem for each in path.parent.glob("*.toml") if each not in way))
        raise BadInputError(f"{path}: extends: there is no {parent_path.name} beside it{hint}")
    return _with_extra_checks(merge(_read_extended(parent_path, way), table), path)


def _with_drivers_kind(table: Table) -> Table:
    """Say of what kind a driver is that does not say so itself, for files that change it."""
    driver = table.get("driver")
    return {**table, "driver": {"kind": DEFAULT_DRIVER, **driver}} if isinstance(driver, dict) else table


def _with_extra_checks(table: Table, path: Path) -> Table:
    """Put this file's ``extra_checks`` behind the checks it has or inherits."""
    extra = table.pop("extra_checks", None)
    if extra is None:
        return table
    checks = table.get("checks", [])
    if not isinstance(extra, list) or not isinstance(checks, list):
        raise BadInputError(f"{path}: extra_checks: expected an array of checks, as [[extra_checks]]")
    return {**table, "checks": [*checks, *extra]}


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


def _made_by(settings: Sequence[tuple[str, Any]], table: Table) -> dict[str, str]:
    """Sensors and estimators that only the settings name, with what to say should they not fit: a slip, perhaps."""
    made: dict[str, str] = {}
    for key, _ in settings:
        section, _, rest = key.partition(".")
        name, dot, _ = rest.partition(".")
        known = table.get(section)
        if section in {"sensors", "estimators"} and dot and isinstance(known, dict) and name not in known:
            told = unknown(name, known, section.removesuffix("s"))
            made.setdefault(f"{section}.{name}", f"--set {key}: {told}: it would be a new one")
    return made


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
    made = _made_by(settings, table)
    for key, value in settings:
        apply_setting(table, key, value)
    try:
        scenario = resolve(table, where=str(path))
    except BadInputError as error:
        hints = [hint for entry, hint in made.items() if f"{entry}." in str(error) or f"{entry}:" in str(error)]
        raise BadInputError("\n".join([str(error), *hints])) from None
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
