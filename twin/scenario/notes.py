"""What a scenario asks for and will not get: no mistake, since a run may be shortened on purpose, but worth a line."""

from __future__ import annotations

from twin.scenario.model import Scenario
from twin.signals import nanoseconds


def notes(scenario: Scenario) -> list[str]:
    """A sentence, with the keys it is about, for each thing that has no effect."""
    end_ns = nanoseconds(scenario.duration_s)
    return [
        f"sensors.{name}.faults.{index}.from_s = {fault.from_s:g}: has no effect, the run ends at"
        f" duration_s = {scenario.duration_s:g}"
        for name, sensor in scenario.sensors.items()
        for index, fault in enumerate(sensor.faults)
        if nanoseconds(fault.from_s) >= end_ns
    ]
