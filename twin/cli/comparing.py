"""What ``twin compare`` does: two run folders, two stress tests or two replays of logs, side by side."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from twin.cli import EXIT_FAILED, EXIT_OK
from twin.cli.report import Reporter
from twin.cli.tables import figure
from twin.errors import BadInputError
from twin.logreplay.identity import IDENTITY
from twin.recording import load_streams
from twin.runfolder import read_recording, read_result
from twin.scenario import read_toml
from twin.scoring.baselines import DEFAULT_TOLERANCE
from twin.scoring.comparison import Difference, compare_events, compare_metrics, compare_streams, compare_words
from twin.scoring.verdict import LOG, STRESS

_ABOUT = ("scenario", "seed", "run", "worlds", "runs")
"""Keys of result.json that say what was run: another value is worth a note, but is no difference of its own."""


@dataclass(frozen=True, slots=True)
class _Folder:
    """A folder of results."""

    path: Path
    result: dict[str, Any]
    """Its result.json."""

    @property
    def kind(self) -> str:
        """``run``, ``stress`` or ``log``."""
        return str(self.result.get("kind", "run"))


def compare_folders(first: Path, second: Path, *, tolerance: float | None, as_json: bool) -> int:
    """Print what differs beyond the tolerance; return the exit code.

    Raises:
        BadInputError: one of them is not a folder of ours, they are of different kinds, or the tolerance is negative.
    """
    tolerance = DEFAULT_TOLERANCE if tolerance is None else tolerance
    if not math.isfinite(tolerance) or tolerance < 0.0:
        raise BadInputError(f"--tolerance {tolerance}: expected a number that is not negative, as 0.001")
    one, other = (_Folder(path, read_result(path)) for path in (first, second))
    if one.kind != other.kind:
        raise BadInputError(f"{first} is a {one.kind}, {second} a {other.kind}: only two of one kind can be compared")
    notes = _notes(one, other)
    compare = {STRESS: _compare_stress, LOG: _compare_logs}.get(one.kind, _compare_runs)
    found = [*_compare_ends(one.result, other.result), *compare(one, other, tolerance)]
    if as_json:
        print(json.dumps(_as_json(found, notes, tolerance), indent=1, allow_nan=False))
    else:
        _report(one, other, found, notes, tolerance)
    return EXIT_FAILED if found else EXIT_OK


def _notes(first: _Folder, second: _Folder) -> list[str]:
    results = first.result, second.result
    notes = []
    for key in _ABOUT:
        one, other = (result.get(key) for result in results)
        if one != other:
            notes.append(f"another {key}: {one} and {other}")
    if results[0].get("scenario") == results[1].get("scenario") and _another_scenario(first, second):
        notes.append("the scenario of that name is another one (scenario.toml differs)")
    one, other = (
        {key: result["log"].get(key) for key in IDENTITY} if isinstance(result.get("log"), dict) else None
        for result in results
    )
    if one is not None and other is not None and one != other:
        notes.append(f"another log: {one['file']} and {other['file']}")
    return notes


def _another_scenario(first: _Folder, second: _Folder) -> bool:
    """Whether the scenarios differ, apart from the seed, which has a note of its own."""
    if first.result.get("scenario_sha256") == second.result.get("scenario_sha256"):
        return False
    one, other = ({**read_toml(each.path / "scenario.toml"), "seed": None} for each in (first, second))
    return one != other


def _compare_runs(first: _Folder, second: _Folder, tolerance: float) -> list[Difference]:
    one, other = read_recording(first.path), read_recording(second.path)
    return [
        *_compare_metrics(first, second, tolerance),
        *compare_events(one.events, other.events),
        *compare_streams(one.streams, other.streams, tolerance=tolerance),
    ]


def _compare_logs(first: _Folder, second: _Folder, tolerance: float) -> list[Difference]:
    one, other = (load_streams(each.path, with_truth=False) for each in (first, second))
    return [
        *_compare_metrics(first, second, tolerance),
        *compare_streams(one, other, tolerance=tolerance),
    ]


def _compare_metrics(first: _Folder, second: _Folder, tolerance: float) -> list[Difference]:
    before, after = (_numbers(each.result.get("metrics"), each.path) for each in (first, second))
    return compare_metrics(before, after, tolerance=tolerance)


def _compare_stress(first: _Folder, second: _Folder, tolerance: float) -> list[Difference]:
    """Quantiles of every metric, and every pooled figure, at every point of ``--vary``."""
    return compare_metrics(_quantiles(first), _quantiles(second), tolerance=tolerance)


def _compare_ends(first: dict[str, Any], second: dict[str, Any]) -> list[Difference]:
    """Verdict, and why and when the runs ended."""
    said = []
    for result in (first, second):
        ended = result["ended"] if isinstance(result["ended"], dict) else {}
        said.append({
            "verdict": result.get("verdict"), "ended": ended.get("reason"), "ended at [s]": ended.get("t_s"),
        })  # fmt: skip
    return compare_words(said[0], said[1])


def _quantiles(folder: _Folder) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    try:
        for point in folder.result["points"]:
            varied = "".join(f" at {key} = {value}" for key, value in point["settings"].items())
            for name, values in point["metrics"].items():
                for quantile, value in _numbers(values, folder.path).items():
                    found[f"{name} {quantile}{varied}"] = value
            for name, value in _numbers(point.get("pooled", {}), folder.path).items():
                found[f"{name}{varied}"] = value
    except (KeyError, TypeError, AttributeError) as error:
        raise BadInputError(f"{folder.path}/result.json: not a result of a stress test ({error!r})") from error
    return found


def _numbers(values: object, folder: Path) -> dict[str, float | None]:
    """Numbers by name, as result.json has them.

    Raises:
        BadInputError: something else stands there.
    """
    if not isinstance(values, dict):
        raise BadInputError(f"{folder}/result.json: metrics: given {values!r}, expected numbers by name")
    numbers: dict[str, float | None] = {}
    for name, value in values.items():
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise BadInputError(f"{folder}/result.json: {name}: given {value!r}, expected a number or null")
        numbers[str(name)] = None if value is None else float(value)
    return numbers


# --- telling ---------------------------------------------------------------------------------------------------------


def _as_json(found: list[Difference], notes: list[str], tolerance: float) -> dict[str, object]:
    return {
        "same": not found,
        "tolerance": tolerance,
        "notes": notes,
        "differences": [
            {
                "kind": each.kind,
                "name": each.name,
                "where": each.where,
                "first": each.first,
                "second": each.second,
                "largest": each.largest if math.isfinite(each.largest) else None,
            }
            for each in found
        ],
    }


def _report(first: _Folder, second: _Folder, found: list[Difference], notes: list[str], tolerance: float) -> None:
    reporter = Reporter(quiet=False)
    reporter.line(f"first:  {first.path}")
    reporter.line(f"second: {second.path}")
    for note in notes:
        reporter.line(Text(f"note: {note}", style="yellow"))
    if not found:
        reporter.line(f"the same within {tolerance:g} of each value")
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in ("kind", "what", "where"):
        table.add_column(heading, overflow="fold")
    for heading in ("first", "second", "largest"):
        table.add_column(heading, justify="right", overflow="fold")
    for each in found:
        largest = figure(each.largest) if math.isfinite(each.largest) else ""
        table.add_row(each.kind, each.name, each.where, each.first, each.second, largest)
    reporter.table(table)
    reporter.line(f"{len(found)} differences beyond {tolerance:g} of each value")
