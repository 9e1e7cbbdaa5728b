"""What ``twin run`` does."""

from __future__ import annotations

import json
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from twin import scenario as scenario_files
from twin.cli import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_INTERNAL, EXIT_OK, complain
from twin.cli.junit import write_junit
from twin.cli.notes import tell_notes
from twin.cli.own_columns import note_of_run
from twin.cli.report import Reporter
from twin.cli.sentences import write_sentences
from twin.errors import BadInputError
from twin.estimation import EstimatorFactory
from twin.recording import Recording, save
from twin.runfolder import folder_of, replacing, require_writable, write_result
from twin.scenario import LoadedScenario
from twin.scoring import Repetitions, Verdict, baselines, score, traces
from twin.scoring.baselines import Baseline
from twin.scoring.verdict import ending


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options of ``twin run``."""

    seed: int | None
    run: int
    settings: tuple[str, ...]
    out: Path
    rrd: bool
    junit: Path | None
    nmea: Path | None
    estimators: tuple[str, ...]
    update_baselines: bool
    full_rate: bool
    as_json: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Crash:
    """A scenario that could not be run."""

    scenario: str
    trace: str
    bad_input: bool = False
    """Something the user gave cannot be used (found only when it was built or written)."""


def load_all(names: Sequence[str], settings: Sequence[str], *, seed: int | None = None) -> list[LoadedScenario]:
    """Load every scenario asked for before the first is run; one that is asked for twice is loaded once.

    Raises:
        BadInputError: one of them is wrong, or two would write to the same folder.
    """
    changes = [scenario_files.parse_setting(text) for text in settings]
    if seed is not None:
        changes.append(("seed", seed))
    files: dict[tuple[Path, str], Path] = {}
    for path in (path for name in names for path in scenario_files.find(name)):
        files.setdefault((path.resolve(), path.stem), path)
    loaded = [scenario_files.load(path, settings=changes) for path in files.values()]
    seen: dict[str, Path] = {}
    for item in loaded:
        if item.name in seen:
            raise BadInputError(f"{seen[item.name]} and {item.path}: two scenarios of the same name in one command")
        seen[item.name] = item.path
    return loaded


def run_scenarios(names: Sequence[str], options: RunOptions) -> int:
    """Run scenarios one after the other; return the exit code."""
    reporter = Reporter(quiet=options.as_json)
    loaded = load_all(names, options.settings, seed=options.seed)
    plugins = load_plugins(options.estimators)
    require_writable(options.out)
    if options.junit is not None:
        require_writable(options.junit.parent)
    if options.nmea is not None:
        require_writable(options.nmea)
    tell_notes(loaded)
    finished: list[Repetitions | Crash] = []
    for item in loaded:
        try:
            finished.append(_run_one(item, options, plugins, reporter))
        except BadInputError as error:
            complain(error)
            finished.append(Crash(scenario=item.name, trace=f"{error.trace}{error}", bad_input=True))
        except Exception:
            crash = Crash(scenario=item.name, trace=traceback.format_exc())
            print(crash.trace, file=sys.stderr)
            finished.append(crash)
    if options.junit is not None:
        write_junit(options.junit, finished)
    verdicts = [verdict for entry in finished if isinstance(entry, Repetitions) for verdict in entry.verdicts]
    if options.as_json:
        print(json.dumps([verdict.as_json() for verdict in verdicts], indent=1, allow_nan=False))
    elif len(loaded) > 1:
        reporter.summary(finished)
    crashes = [entry for entry in finished if isinstance(entry, Crash)]
    if crashes:
        return EXIT_BAD_INPUT if all(crash.bad_input for crash in crashes) else EXIT_INTERNAL
    return EXIT_OK if all(verdict.verdict == "pass" for verdict in verdicts) else EXIT_FAILED


def load_plugins(names: Sequence[str]) -> dict[str, EstimatorFactory]:
    """Factories of the user's own estimators, by the last part of their names.

    Raises:
        BadInputError: one cannot be found.
    """
    from twin.estimators import AdaptedEstimator, load_class, load_entry_point  # noqa: PLC0415

    if any(":" in name for name in names):
        sys.path.insert(0, str(Path.cwd()))  # a module beside the user, which an installed command does not see
    plugins: dict[str, EstimatorFactory] = {}
    for name in names:
        found = load_class(name) if ":" in name else load_entry_point(name)
        short = name.rpartition(":")[2]
        if short in plugins:
            raise BadInputError(f"--estimator {name}: there is already one called {short!r}")
        plugins[short] = partial(AdaptedEstimator, found)
    return plugins


def _run_one(
    loaded: LoadedScenario, options: RunOptions, plugins: dict[str, EstimatorFactory], reporter: Reporter
) -> Repetitions:
    """Run a scenario's repetitions in one world; judge and save each. Only the first is written for the viewer.

    Raises:
        BadInputError: it cannot be built, or a folder holds something else.
    """
    from twin.execution import execute_each  # noqa: PLC0415  (the physics is not needed to refuse bad input)

    runs = range(options.run, options.run + loaded.scenario.repetitions)
    with reporter.progress(loaded) as progress:
        recordings = execute_each(loaded, runs=runs, full_rate=options.full_rate, plugins=plugins, progress=progress)
    verdicts = [score(recording) for recording in recordings]
    note_of_run(recordings[0], loaded.scenario, plugins)
    _compare_baseline(loaded, options, recordings[0], verdicts[0])
    folders = [folder_of(options.out, verdict) for verdict in verdicts]
    for recording, verdict, folder in zip(recordings, verdicts, folders, strict=True):
        with replacing(folder) as building:
            save(recording, building)
            if options.rrd and recording is recordings[0]:
                verdict.timing["rrd_s"] = _write_rrd(recording, verdict, building / "run.rrd")
            write_result(building, verdict.as_json())
        if options.nmea is not None:
            write_sentences(recording, verdict.scenario, options.nmea)
    found = Repetitions(verdicts)
    reporter.result(loaded, found, folders, rrd=options.rrd)
    return found


def _write_rrd(recording: Recording, verdict: Verdict, path: Path) -> float:
    """Write the recording for the viewer; return how long it took, without the import of rerun (half a second)."""
    from viz import scene_of, write_rrd  # noqa: PLC0415

    started = time.perf_counter()
    write_rrd(recording, scene_of(recording), verdict.as_json(), path)
    return time.perf_counter() - started


def _compare_baseline(loaded: LoadedScenario, options: RunOptions, recording: Recording, verdict: Verdict) -> None:
    """Compare with the committed baselines, where this is the run that they were made from.

    Raises:
        BadInputError: a baseline cannot be read, or an update of it cannot be written.
    """
    committed = not options.settings and options.run == 0 and not options.estimators and not options.full_rate
    if not committed or (options.seed is not None and options.seed != scenario_files.load(loaded.path).scenario.seed):
        return
    path, trace_path = baselines.baseline_path(loaded.path), traces.trace_path(loaded.path)
    known, known_trace = baselines.read(path), traces.read(trace_path)
    said = traces.trace(recording) if known_trace or loaded.scenario.recording.baseline_trace else {}
    if options.update_baselines and ending(verdict.ended_reason, verdict.scenario) == "pass":
        known, known_trace = _update(path, known, verdict.metrics), _update_trace(trace_path, known_trace, said)
    if known:
        verdict.baseline_compared = True
        verdict.drifted = baselines.drifted(known, verdict.metrics)
    if known_trace:
        verdict.drifted += traces.drifted(known_trace, said)


def _update(path: Path, known: dict[str, Baseline], metrics: dict[str, float]) -> dict[str, Baseline]:
    new = baselines.updated(known, metrics)
    if new != known:
        try:
            baselines.write(path, new)
        except OSError as error:
            raise BadInputError(f"{path}: cannot be written ({error.strerror})") from error
    return new


def _update_trace(path: Path, known: traces.Trace, said: traces.Trace) -> traces.Trace:
    if not said or not traces.drifted(known, said):
        return known
    try:
        traces.write(path, said)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written ({error.strerror})") from error
    return said
