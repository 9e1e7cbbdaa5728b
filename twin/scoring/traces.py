"""Baseline traces: what the estimators said once a second, committed as ``baselines/NAME_trace.csv``.

Metrics say that something moved; the trace says when. One line per estimator and second, so that a change of the
filter is a readable diff. A value has drifted when it moved by more than ``TOLERANCE`` in its own unit.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np

from twin.errors import BadInputError
from twin.recording import Recording
from twin.signals import HEADING, NS_PER_S, POSITION, SPEED, YAW_RATE

COLUMNS = (*POSITION, HEADING, SPEED, YAW_RATE)
TOLERANCE = 1e-3
_HEADER = ["estimator", "t_s", *COLUMNS]

Trace = dict[tuple[str, str], list[str]]
"""Values as written, by estimator and second; empty where an estimator has no such column."""


def trace_path(scenario_path: Path) -> Path:
    """Where the trace of a scenario file lies."""
    return scenario_path.parent / "baselines" / f"{scenario_path.stem}_trace.csv"


def trace(recording: Recording) -> Trace:
    """What each estimator of a recording said once a second."""
    said: Trace = {}
    for name in recording.names("estimates"):
        stream = recording.estimates(name)
        for row in np.flatnonzero(stream.t_ns % NS_PER_S == 0).tolist():
            values = [f"{stream.column(c)[row, 0]:.4f}" if stream.has(c) else "" for c in COLUMNS]
            said[name, str(int(stream.t_ns[row]) // NS_PER_S)] = values
    return said


def read(path: Path) -> Trace:
    """Read a trace; empty where there is none.

    Raises:
        BadInputError: the file is not a trace.
    """
    if not path.is_file():
        return {}
    try:
        with path.open(newline="") as file:
            header, *lines = csv.reader(file)
    except (OSError, UnicodeDecodeError, csv.Error, ValueError) as error:
        raise BadInputError(f"{path}: not a baseline trace: {error}") from error
    if header != _HEADER or any(len(line) != len(_HEADER) for line in lines):
        raise BadInputError(f"{path}: not a baseline trace (columns {', '.join(_HEADER)} expected)")
    return {(line[0], line[1]): line[2:] for line in lines}


def drifted(then: Trace, now: Trace) -> list[str]:
    """One sentence for the first second at which each estimator says something else."""
    sentences: dict[str, str] = {}
    for key in dict.fromkeys([*then, *now]):
        estimator, t_s = key
        if estimator in sentences:
            continue
        if key not in then or key not in now:
            sentences[estimator] = f"trace of {estimator} has other seconds, from {t_s} s on"
            continue
        for column, before, after in zip(COLUMNS, then[key], now[key], strict=True):
            if not _same(before, after):
                sentences[estimator] = f"trace of {estimator} from {t_s} s on: {column} {before} -> {after}"
                break
    return list(sentences.values())


def _same(before: str, after: str) -> bool:
    if not before or not after:
        return before == after
    try:
        one, other = float(before), float(after)
    except ValueError:
        return False
    return (math.isnan(one) and math.isnan(other)) or abs(one - other) <= TOLERANCE


def write(path: Path, said: Trace) -> None:
    """Write a trace in one go."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEADER)
    for (estimator, t_s), values in said.items():
        writer.writerow([estimator, t_s, *values])
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(text.getvalue())
    partial.replace(path)
