"""Writes what the receivers of a run would have sent: ``twin run --nmea``.

Below the folder asked for, a folder for each scenario holds ``<sensor>.nmea`` and, for AgOpenGPS, ``<sensor>.panda``
(``<sensor>.paogi`` too for a receiver with two antennas); a scenario with repetitions has ``<sensor>_run<index>``. The
first sentence of each file is a TXT that says whose it is, as receivers send when they are switched on: by it a file
of ours is known, and only such a file is replaced.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from twin.errors import BadInputError
from twin.estimation import in_order_sampled
from twin.formats.nmea import framed
from twin.formats.nmea_out import nmea_sentences
from twin.formats.nmea_style import NmeaStyle, usual_style
from twin.formats.panda_out import panda_sentences, paogi_sentences
from twin.paths import plain_name
from twin.recording import Recording
from twin.scenario import Scenario
from twin.sensors.gnss_config import GnssConfig
from twin.signals import HEADING, Measurement

_OURS = "TXT,01,01,02,agtwin"


def write_sentences(recording: Recording, scenario: Scenario, folder: Path) -> list[Path]:
    """Write the sentences of every receiver of a run of one member; return the files.

    Raises:
        BadInputError: the disk refuses, or a file of another kind is in the way.
    """
    below = folder / plain_name(recording.scenario_name, what="scenario")
    run = f"_run{recording.runs[0]}" if scenario.repetitions > 1 else ""
    written: list[Path] = []
    for name, config in scenario.sensors.items():
        if isinstance(config, GnssConfig):
            for suffix, lines in _files(recording, scenario, name, config):
                path = below / f"{plain_name(name, what='sensor')}{run}.{suffix}"
                _write(path, lines)
                written.append(path)
    return written


def style_of(scenario: Scenario, name: str, config: GnssConfig) -> NmeaStyle:
    """The scenario's style of a receiver, or the usual one of its kind."""
    if name in scenario.nmea:
        return scenario.nmea[name]
    steps = [step for step in config.resolution_m[:2] if step > 0.0]
    qualities = [state.quality for state in config.states.values()]
    return usual_style(resolution_m=min(steps, default=0.0), qualities=qualities)


def _files(
    recording: Recording, scenario: Scenario, name: str, config: GnssConfig
) -> Iterator[tuple[str, Iterator[str]]]:
    style, origin = style_of(scenario, name, config), scenario.origin
    references = [each for each, sensor in scenario.sensors.items() if sensor.kind == "ahrs"]
    imu = style.imu or next(iter(references), None)
    receiver = _arrived(recording, name)
    attitude = [] if imu is None else _arrived(recording, imu)
    yield "nmea", nmea_sentences(receiver, style, origin)
    yield "panda", panda_sentences(receiver, attitude, style, origin)
    if HEADING in recording.measurements(name).columns:
        yield "paogi", paogi_sentences(receiver, attitude, style, origin)


def _arrived(recording: Recording, sensor: str) -> list[Measurement]:
    """What a sensor gave, in order of arrival."""
    return sorted(in_order_sampled({sensor: recording.measurements(sensor)}), key=lambda each: each.t_available_ns)


def _write(path: Path, lines: Iterable[str]) -> None:
    """Write a file whole or not at all."""
    _require_ours(path)
    partial = path.parent / f".{path.name}.partial-{os.getpid()}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("w", encoding="ascii", newline="") as file:
            file.write(framed(f"GN{_OURS}"))
            file.writelines(lines)
        partial.replace(path)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        partial.unlink(missing_ok=True)


def _require_ours(path: Path) -> None:
    ours = framed(f"GN{_OURS}").encode("ascii")
    try:
        if not path.exists() and not path.is_symlink():
            return
        if path.is_file():
            with path.open("rb") as file:
                if file.read(len(ours)) == ours:
                    return
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror or error})") from error
    raise BadInputError(f"{path}: holds something that is not ours; it is left alone (choose another --nmea)")
