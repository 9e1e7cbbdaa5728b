"""What is worth a line before a run, on standard error: nothing of it is a mistake."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from twin.scenario import LoadedScenario, notes


def tell_notes(scenarios: Iterable[LoadedScenario]) -> None:
    """Print the notes of scenarios that are about to be run, each once."""
    told = dict.fromkeys(f"note: {loaded.path}: {note}" for loaded in scenarios for note in notes(loaded.scenario))
    for line in told:
        print(line, file=sys.stderr)
