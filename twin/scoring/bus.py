"""Metrics of a scenario's buses: ``bus.<name>.<what>_<unit>``. They follow from the scenario alone."""

from __future__ import annotations

import dataclasses

from twin.formats.can import BusLoad
from twin.scenario import Scenario

NAMES = tuple(field.name for field in dataclasses.fields(BusLoad))


def metric_names(scenario: Scenario) -> list[str]:
    """Names of the metrics of all buses."""
    return [f"bus.{bus}.{name}" for bus in scenario.bus for name in NAMES]


def metrics(scenario: Scenario) -> dict[str, float]:
    """Metrics of all buses, by name."""
    return {
        f"bus.{bus}.{name}": value
        for bus, config in scenario.bus.items()
        for name, value in dataclasses.asdict(config.load()).items()
    }
