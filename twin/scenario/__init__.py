"""A scenario file: what to run, as data. Its sections, how files are read, and what may be written in them."""

from twin.scenario.description import json_schema, kinds
from twin.scenario.files import (
    LoadedScenario,
    Table,
    apply_setting,
    bundled,
    find,
    load,
    loads,
    merge,
    parse_setting,
    read_toml,
    resolve,
)
from twin.scenario.model import RESERVED, Scenario
from twin.scenario.notes import notes
from twin.scenario.sections import Check, LossConfig, RecordingConfig, ScoringConfig, WorldConfig, place_key, unknown

__all__ = [
    "RESERVED",
    "Check",
    "LoadedScenario",
    "LossConfig",
    "RecordingConfig",
    "Scenario",
    "ScoringConfig",
    "Table",
    "WorldConfig",
    "apply_setting",
    "bundled",
    "find",
    "json_schema",
    "kinds",
    "load",
    "loads",
    "merge",
    "notes",
    "parse_setting",
    "place_key",
    "read_toml",
    "resolve",
    "unknown",
]
