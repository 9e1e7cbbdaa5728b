"""What ``twin replay`` and ``twin score`` do: work on a run folder without running the world."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

import tomli_w

from twin.cli import EXIT_FAILED, EXIT_OK
from twin.cli.own_columns import note_of_run
from twin.cli.report import Reporter
from twin.cli.running import load_plugins
from twin.errors import BadInputError
from twin.recording import Recording
from twin.replay import differing, replay
from twin.runfolder import read_recording
from twin.scenario import LoadedScenario, apply_setting, loads, parse_setting
from twin.scoring import Repetitions, Verdict, score


def _report(recording: Recording, verdict: Verdict, folder: Path, reporter: Reporter, *, as_json: bool) -> None:
    if as_json:
        print(json.dumps([verdict.as_json()], indent=1, allow_nan=False))
        return
    loaded = LoadedScenario(
        name=recording.scenario_name,
        path=folder / "scenario.toml",
        scenario=verdict.scenario,
        toml=recording.scenario_toml,
    )
    reporter.result(loaded, Repetitions([verdict]), [], rrd=False)


def score_folder(folder: Path, *, as_json: bool) -> int:
    """Metrics and checks of a run folder, computed again."""
    recording = read_recording(folder)
    verdict = score(recording)
    _report(recording, verdict, folder, Reporter(quiet=as_json), as_json=as_json)
    return EXIT_OK if verdict.verdict == "pass" else EXIT_FAILED


def replay_folder(folder: Path, *, settings: Sequence[str], estimators: Sequence[str], as_json: bool) -> int:
    """Estimators over the measurements of a run folder; without ``--set`` they must be the run's bit for bit."""
    reporter = Reporter(quiet=as_json)
    recorded = read_recording(folder)
    toml = _changed(recorded, settings) if settings else None
    plugins = load_plugins(estimators)
    replayed = replay(recorded, scenario_toml=toml, plugins=plugins)
    verdict = score(replayed)
    note_of_run(replayed, verdict.scenario, plugins)
    _report(replayed, verdict, folder, reporter, as_json=as_json)
    if settings:
        return EXIT_OK if verdict.verdict == "pass" else EXIT_FAILED
    left_out = [name for name in recorded.names("estimates") if name not in replayed.names("estimates")]
    for name in left_out:
        reporter.line(f"{name} is not in the scenario and was not replayed; name its class with --estimator")
    differences = {name: value for name, value in differing(recorded, replayed).items() if name not in left_out}
    for name, difference in differences.items():
        reporter.line(f"replay differs from the run: {name} by up to {difference:.3g}")
    if not differences:
        reporter.line("replay equals the run bit for bit")
    return EXIT_FAILED if differences or verdict.verdict != "pass" else EXIT_OK


def _changed(recorded: Recording, settings: Sequence[str]) -> str:
    """The recording's scenario with other estimator settings, resolved again.

    Raises:
        BadInputError: a setting is about something that was fixed when the measurements were taken.
    """
    table = tomllib.loads(recorded.scenario_toml)
    for text in settings:
        key, value = parse_setting(text)
        if key.partition(".")[0] not in {"estimators", "seeding", "scoring", "checks"}:
            raise BadInputError(f"--set {key}: a replay can change estimators.*, seeding.*, scoring.* and checks only")
        apply_setting(table, key, value)
    toml = tomli_w.dumps(table)
    loads(toml, where="--set")
    return toml
