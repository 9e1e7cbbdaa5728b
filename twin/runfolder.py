"""The folder of a run: built under a temporary name beside its place, then swapped in whole."""

from __future__ import annotations

import json
import os
import shutil
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from twin.errors import BadInputError
from twin.groundlog import load_ground
from twin.paths import plain_name
from twin.pictures import load_pictures
from twin.recording import TRUTH, Recording, Stream, load_events, load_streams
from twin.scoring import Verdict
from twin.scoring.verdict import LOG, STRESS

RESULT = "result.json"
_LARGEST_RESULT = 50_000_000
_LONGEST_RUN_S = 36_000.0


def folder_of(out: Path, verdict: Verdict) -> Path:
    """Where the run of a verdict goes below the output folder."""
    return out / verdict.scenario_name / f"seed{verdict.seed}_run{verdict.run}"


def require_writable(out: Path) -> None:
    """Find out before a long run whether its results could be written.

    Raises:
        BadInputError: the folder cannot be made or written to.
    """
    probe = out / f".writable-{os.getpid()}"
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BadInputError(f"{out}: cannot be written to ({error.strerror})") from error


@contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """Yield a temporary folder that takes ``target``'s place if all goes well, and vanishes if not.

    Raises:
        BadInputError: ``target`` holds something that is not a run of ours, or other runs below its own, or the disk
            refuses.
    """
    _require_ours(target)
    partial = target.parent / f".{target.name}.partial-{os.getpid()}"
    previous = target.parent / f".{target.name}.previous-{os.getpid()}"
    try:
        try:
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True)
            yield partial
            if target.exists():
                target.rename(previous)
            partial.rename(target)
        except OSError as error:
            raise BadInputError(f"{target}: cannot be written ({error.strerror or error})") from error
    finally:
        if previous.exists() and not target.exists():
            previous.rename(target)
        shutil.rmtree(partial, ignore_errors=True)
        shutil.rmtree(previous, ignore_errors=True)


def _require_ours(target: Path) -> None:
    if not target.exists() or (target.is_dir() and not any(target.iterdir())):
        return
    try:
        ours = "schema" in read_result(target)
    except BadInputError:
        ours = False
    if not ours:
        raise BadInputError(f"{target}: holds something that is not a run; it is left alone (choose another --out)")
    below = next((path.parent for path in target.glob(f"*/**/{RESULT}")), None)
    if below is not None:
        raise BadInputError(f"{target}: holds other results ({below}); it is left alone (choose another --out)")


def write_result(folder: Path, result: dict[str, Any]) -> None:
    """Write ``result.json``."""
    (folder / RESULT).write_text(json.dumps(result, indent=1, allow_nan=False) + "\n")


def read_result(folder: Path) -> dict[str, Any]:
    """Read ``result.json`` of a run folder.

    Raises:
        BadInputError: there is none, or it is not one of ours.
    """
    path = folder / RESULT
    try:
        if path.stat().st_size > _LARGEST_RESULT:
            raise BadInputError(f"{path}: larger than {_LARGEST_RESULT} bytes: not a result of ours")
        result = json.loads(path.read_text())
    except OSError as error:
        raise BadInputError(f"{folder}: not a run folder ({RESULT}: {error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path}: not valid JSON ({error})") from error
    if not isinstance(result, dict) or not _needed(result) <= set(result):
        raise BadInputError(f"{path}: not a result of a run")
    return result


def _needed(result: dict[str, Any]) -> set[str]:
    """Keys that a result of its kind has."""
    always = {"schema", "scenario", "ended", "timing"}
    return always if result.get("kind") == LOG else always | {"seed", "run"}


def read_recording(folder: Path) -> Recording:
    """Read a run folder back as a recording.

    Raises:
        BadInputError: something is missing or cannot be read, or it is a replayed log, which has no scenario, or the
            folder of a stress test, which keeps no streams.
    """
    result = read_result(folder)
    if result.get("kind") == STRESS:
        raise BadInputError(
            f"{folder}: the folder of a stress test, and no run; compare it with twin compare, or run a member alone"
            f" ({RESULT} has the commands of the worst)"
        )
    if result.get("kind") == LOG:
        raise BadInputError(f"{folder}: a replayed log; look at it with twin view, or compare it with twin compare")
    try:
        path = folder / "scenario.toml"
        if path.stat().st_size > _LARGEST_RESULT:
            raise BadInputError(f"{path}: larger than {_LARGEST_RESULT} bytes: not a scenario of ours")
        toml = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"{folder / 'scenario.toml'}: cannot be read ({error})") from error
    try:
        return Recording(
            scenario_toml=toml,
            scenario_name=plain_name(str(result["scenario"]), what="scenario"),
            seed=int(result["seed"]),
            runs=(int(result["run"]),),
            streams=_in_scenario_order(load_streams(folder), tomllib.loads(toml)),
            events=load_events(folder),
            pictures=load_pictures(folder),
            ground=load_ground(folder),
            ended_reason=str(result["ended"]["reason"]),
            ended_t_s=_ended_t_s(result),
            timing={name: float(value) for name, value in result["timing"].items() if value is not None},
        )
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise BadInputError(f"{folder / RESULT}: not a result of a run ({error})") from error


def _ended_t_s(result: dict[str, Any]) -> float:
    t_s = float(result["ended"]["t_s"])
    if not 0.0 <= t_s <= _LONGEST_RUN_S:
        raise ValueError(f"ended.t_s = {t_s}")
    return t_s


def _in_scenario_order(streams: dict[str, Stream], scenario: dict[str, Any]) -> dict[str, Stream]:
    """Put the streams in the order in which the scenario names sensors and estimators."""
    names = [TRUTH]
    for prefix, section in (
        ("measurements", "sensors"),
        ("hidden", "sensors"),
        ("estimates", "estimators"),
        ("seeds", "estimators"),
    ):
        names += [f"{prefix}/{name}" for name in scenario.get(section, {})]
    names += [name for name in streams if name not in names]
    return {name: streams[name] for name in names if name in streams}
