"""What is said of columns of a user's own estimator that look as if they were meant to be scored, and are not."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence

from twin.estimators import PluginConfig
from twin.families import FAMILIES
from twin.recording import Recording
from twin.scenario import Scenario
from twin.signals import HEADING, POSITION, SPEED, sigma_column
from twin.validation import did_you_mean

OF_A_LOG = (*POSITION[:2], SPEED, HEADING)
"""What figures about a log are made of."""
_OF_FAMILIES = tuple(family.column for family in FAMILIES if family.column)
"""What is scored somewhere; a misspelt name may be one that this run has no truth of."""
_ALIKE = 0.8
"""So near a misspelt name is; that of a state is farther from the column it is about (``height_bias_m``)."""


def note_of_run(recording: Recording, scenario: Scenario, plugins: Iterable[str]) -> None:
    """Note misspelt columns of the user's own estimators in a run: those of the command line and of the scenario."""
    own = [*plugins, *(name for name, each in scenario.estimators.items() if isinstance(each, PluginConfig))]
    note_misspelt({name: recording.estimates(name).columns for name in own}, recording.truth.columns)


def note_misspelt(streams: Mapping[str, Sequence[str]], scored: Sequence[str]) -> None:
    """Print a line for each column that is near to one scored here or elsewhere which its estimator does not give.

    Other columns are the user's own affair, unless there are no others.

    Args:
        streams: columns of estimators' streams.
        scored: columns that are.
    """
    for name, stream in streams.items():
        given = [column for column in stream if sigma_column(column) in stream]
        missing = [column for column in (*scored, *_OF_FAMILIES) if column not in given]
        hints = {column: did_you_mean(column, missing, alike=_ALIKE) for column in given if column not in scored}
        told = [f"column {column!r} is not one that is scored{hint}" for column, hint in hints.items() if hint]
        if not told and len(hints) == len(given):
            told = [f"none of its columns is one that is scored ({', '.join(given)})"]
        for line in told:
            print(f"note: estimator {name}: {line}", file=sys.stderr)
