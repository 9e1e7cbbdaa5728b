"""What ``twin list`` prints. Names are there to be copied and searched for, so only what describes them is wrapped."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator
from itertools import takewhile

from rich.table import Table

from twin.cli.report import Reporter
from twin.formats.csv_mapping import MAPPINGS, read_mapping
from twin.scenario import bundled, kinds, read_toml
from twin.sensors.presets import preset_files

_END_OF_SENTENCE = re.compile(r"(?<=\.)\s+(?=[A-Z])")


def print_lists() -> None:
    """Scenarios with their titles, sensor presets with what they are, mappings of logs, the kinds of everything."""
    reporter = Reporter(quiet=False)
    for table in tables():
        reporter.table(table)
    for section, names in kinds().items():
        reporter.line(f"{section}: {', '.join(names)}")


def tables() -> Iterator[Table]:
    """Scenarios, sensor presets and mappings."""
    titles = ((name, str(read_toml(path).get("title", ""))) for name, path in bundled().items())
    yield _table("Scenarios", ("scenario", "title"), titles)
    texts = ((name, path.read_text(encoding="utf-8")) for name, path in preset_files().items())
    presets = ((name, str(tomllib.loads(text).get("kind", "")), first_sentence(text)) for name, text in texts)
    yield _table("Sensor presets", ("preset", "kind", "what it is"), presets)
    mappings = ((path.stem, read_mapping(path).title) for path in sorted(MAPPINGS.glob("*.toml")))
    yield _table("Mappings of CSV logs", ("mapping", "title"), mappings)


def _table(title: str, headings: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> Table:
    """A table of names with, last, what they stand for: only that is wrapped."""
    table = Table(title=title)
    rows = list(rows)
    for index, heading in enumerate(headings[:-1]):
        table.add_column(heading, no_wrap=True, min_width=max(len(row[index]) for row in rows))
    table.add_column(headings[-1], overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def first_sentence(toml: str) -> str:
    """The first sentence of the comment that a file begins with; empty if there is none."""
    lines = takewhile(lambda line: line.startswith("#"), toml.splitlines())
    return _END_OF_SENTENCE.split(" ".join(line.lstrip("# ") for line in lines), maxsplit=1)[0]
