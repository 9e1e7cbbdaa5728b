"""What ``twin replay`` does with a log of real receivers: estimators over it, tables, files."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin.cli import EXIT_OK
from twin.cli.log_folder import folder_of_log
from twin.cli.log_tables import innovation_table, quality_table, reference_tables, track_table
from twin.cli.own_columns import OF_A_LOG, note_misspelt
from twin.cli.report import Reporter
from twin.cli.running import load_plugins
from twin.errors import BadInputError
from twin.formats.geodetic import Origin
from twin.formats.log import Log
from twin.formats.logs import open_log
from twin.logreplay import LogReplay, ReplaySettings, choose, is_built_in, read_settings, replay_log
from twin.logreplay.result import result_of, utc_text
from twin.runfolder import RESULT, replacing, require_writable, write_result

_OUT = Path("runs")


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """Options of ``twin replay``; all but ``settings``, ``estimators`` and ``as_json`` are for logs."""

    settings: tuple[str, ...] = ()
    estimators: tuple[str, ...] = ()
    reference: Path | None = None
    mapping: Path | None = None
    reference_mapping: Path | None = None
    origin: str | None = None
    out: Path | None = None
    rrd: bool = True
    as_json: bool = False


def replay_any(what: Path, options: LogOptions) -> int:
    """Replay a run folder, a trial of BROAD, or a log.

    Raises:
        BadInputError: it is none of these, or an option is for a log only.
    """
    trial = what.suffix == ".mat"
    if not what.exists():
        raise BadInputError(f"{what}: no such file or folder")
    if not trial and (options.mapping is not None or not what.is_dir()):
        return _replay_file(what, options)
    if not trial and not (what / RESULT).exists() and any(path.suffix.lower() == ".csv" for path in what.iterdir()):
        raise BadInputError(
            f"{what}: not a run folder; a log of CSV files needs --mapping, which says what their columns are"
        )
    for name in ("reference", "mapping", "reference_mapping", "origin", "out"):
        if getattr(options, name) is not None:
            raise BadInputError(f"--{name.replace('_', '-')}: is for logs, and {what} is none")
    if not options.rrd:
        raise BadInputError(f"--no-rrd: is for logs, and {what} is none: no run.rrd is written of it")
    if trial:
        from twin.cli.replaying_trial import replay_file  # noqa: PLC0415

        return replay_file(what, settings=options.settings, estimators=options.estimators, as_json=options.as_json)
    from twin.cli.replaying import replay_folder  # noqa: PLC0415

    return replay_folder(what, settings=options.settings, estimators=options.estimators, as_json=options.as_json)


def _replay_file(path: Path, options: LogOptions) -> int:
    reporter = Reporter(quiet=options.as_json)
    settings = read_settings(options.settings)
    built_in = [text for text in options.estimators if is_built_in(text)]
    own = [text for text in options.estimators if text not in built_in]
    plugins = load_plugins(own)
    choices = choose(built_in, plugins=plugins, options=settings.estimators)
    log = open_log(path, mapping=options.mapping, origin=_origin(options.origin))
    reference = _open_reference(options, settings)
    out = options.out or _OUT
    require_writable(out)
    folder = folder_of_log(out, path)
    _introduce(log, reporter)
    with replacing(folder) as building:
        found = replay_log(
            log,
            choices,
            reference=reference,
            folder=building,
            settings=settings,
            progress=reporter.log_progress(log.path.name),
        )
        result = result_of(found)
        if options.rrd:
            result["timing"]["rrd_s"] = _write_rrd(found, result, building / "run.rrd")
        write_result(building, result)
    note_misspelt({name: found.columns[name] for name in plugins}, OF_A_LOG)
    if options.as_json:
        print(json.dumps([result], indent=1, allow_nan=False))
    else:
        _report(found, folder, reporter, rrd=options.rrd)
    return EXIT_OK


def _open_reference(options: LogOptions, settings: ReplaySettings) -> Log | None:
    """The other log, if there is one, read by the mapping of an option or else of a setting.

    Raises:
        BadInputError: it cannot be read, or there is a mapping and no other log.
    """
    told, path = settings.reference.mapping, options.reference
    mapping = options.reference_mapping or (None if told is None else Path(told))
    if path is not None:
        return open_log(path, mapping=mapping)
    if mapping is not None:
        raise BadInputError(f"--reference-mapping {mapping}: there is no --reference that it could be for")
    return None


def _origin(text: str | None) -> Origin | None:
    """Origin of ``LAT,LON``.

    Raises:
        BadInputError: it is none.
    """
    if text is None:
        return None
    try:
        latitude, longitude = (float(part) for part in text.split(","))
        return Origin(latitude_deg=latitude, longitude_deg=longitude, height_m=0.0, geoid_height_m=0.0)
    except ValueError:
        raise BadInputError(
            f"--origin {text}: expected LAT,LON in degrees, -89 to 89 and -180 to 180, as 52.52,13.40"
        ) from None


def _write_rrd(found: LogReplay, result: Mapping[str, Any], path: Path) -> float:
    """Write the replay for the viewer; return how long it took, without the import of rerun."""
    from viz.log_rrd import write_log_rrd  # noqa: PLC0415

    started = time.perf_counter()
    write_log_rrd(found.sketch, dict(result), path)
    return time.perf_counter() - started


# --- what a person sees ----------------------------------------------------------------------------------------------


def _introduce(log: Log, reporter: Reporter) -> None:
    sensors = ", ".join(f"{name} ({info.rate_hz:.3g} Hz)" for name, info in log.sensors.items())
    began = "" if log.start_utc_ns is None else f", from {utc_text(log.start_utc_ns)}"
    reporter.line(f"{log.path.name}: {sensors}{began}")


def _report(found: LogReplay, folder: Path, reporter: Reporter, *, rrd: bool) -> None:
    estimators = list(found.heard)
    for name, sensors in found.heard.items():
        reporter.line(f"{name} hears {', '.join(sensors)}")
    for table in (
        quality_table(found.metrics, found.receiver),
        innovation_table(found.metrics, estimators),
        track_table(found.metrics, found.receiver, estimators),
        *reference_tables(found.metrics, found.receiver, estimators),
    ):
        if table is not None:
            reporter.table(table)
    for kind, count in found.problems.most_common():
        reporter.line(f"passed over: {count} x {kind}")
    speed, wall_s = found.timing["real_time_factor"], found.timing["wall_s"]
    reporter.line(f"{found.ended_t_s:.0f} s of log in {wall_s:.1f} s: {speed:.0f} times real time")
    reporter.line(f"files: {folder} ({RESULT}, estimates, measurements)")
    if rrd:
        reporter.line(f"look:  twin view {folder}")
