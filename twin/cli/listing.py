"""What ``twin list`` prints."""

from __future__ import annotations

import tomllib

from rich.console import Console
from rich.table import Table

from twin.formats.csv_mapping import MAPPINGS, read_mapping
from twin.scenario import bundled, kinds, read_toml
from twin.sensors.presets import preset_files


def print_lists() -> None:
    """Scenarios with their titles, sensor presets with what they are, mappings of logs, the kinds of everything."""
    console = Console(highlight=False, markup=False)
    scenarios = Table("scenario", "title", title="Scenarios")
    for name, path in bundled().items():
        table = read_toml(path)
        scenarios.add_row(name, str(table.get("title", "")))
    console.print(scenarios)
    sensors = Table("preset", "kind", "what it is", title="Sensor presets")
    for name, path in preset_files().items():
        text = path.read_text(encoding="utf-8")
        table = tomllib.loads(text)
        first = text.partition("\n")[0]
        sensors.add_row(name, str(table.get("kind", "")), first.lstrip("# ") if first.startswith("#") else "")
    console.print(sensors)
    mappings = Table("mapping", "title", title="Mappings of CSV logs")
    for path in sorted(MAPPINGS.glob("*.toml")):
        mappings.add_row(path.stem, read_mapping(path).title)
    console.print(mappings)
    for section, names in kinds().items():
        console.print(f"{section}: {', '.join(names)}")
