"""Writes a recording as a .rrd file for the Rerun viewer, from columns, with its layout inside."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rerun as rr
from rerun.chunk import RrdReader

from twin.errors import TwinError
from twin.recording import Recording
from viz import entities
from viz.blueprint import layout
from viz.layers import LAYERS
from viz.legible import legible
from viz.scene import Scene
from viz.sheet import Layer, Run, Sheet


def write_rrd(
    recording: Recording,
    scene: Scene,
    result: dict[str, Any],
    path: Path,
    *,
    member: int = 0,
    layers: Sequence[Layer] = LAYERS,
    title: str | None = None,
) -> None:
    """Write one member of a recording to ``path``, whole or not at all.

    Args:
        recording: The streams; layers whose streams are absent draw nothing.
        scene: Ground, machine and planned path.
        result: The score, in the shape of ``result.json``; may be empty.
        path: The file; replaced if it exists. Its folder must exist.
        member: Place on the ensemble axis of what is drawn.
        layers: What is drawn, in the order of the panels.
        title: Name of the recording in the viewer; by default scenario, seed and run.

    Raises:
        OSError: the file cannot be written (no space, no right).
        TwinError: what was written cannot be read back.
    """
    run = Run(recording=recording, scene=scene, result=result, member=member)
    name = re.sub(r"[^A-Za-z0-9_ -]", "_", recording.scenario_name)[:100]
    with _strict():
        # The id is random: two files opened side by side in a viewer must not flow into one another.
        stream = rr.RecordingStream(f"{entities.APPLICATION_ID} {name}", send_properties=False)
        memory = stream.memory_recording()
        stream.set_log_time_enabled(False)
        shown = title or f"{recording.scenario_name}, seed {recording.seed}, run {recording.runs[member]}"
        stream.send_recording_name(legible(shown))
        sheet = Sheet(stream)
        for layer in layers:
            layer(run, sheet)
        sheet.finish()
        stream.send_blueprint(layout(sheet, run.duration_ns))
        # Through memory, because the SDK's own file sink reports a full disk to nobody.
        content = memory.drain_as_bytes()
    _write_whole(path, content, sheet.entities)


@contextmanager
def _strict() -> Iterator[None]:
    """Let misuse of the SDK raise; otherwise it only warns and drops the data."""
    before = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)


def _write_whole(path: Path, content: bytes, expected: set[str]) -> None:
    """Write beside ``path``, read back, then move there."""
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        Path(temporary).chmod(0o666 & ~_umask())
        _check_readable(Path(temporary), expected, shown=path)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _umask() -> int:
    """The permissions this process takes from new files."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _check_readable(path: Path, expected: set[str], *, shown: Path) -> None:
    """Read the footer back.

    Raises:
        TwinError: no footer, or an entity is missing.
    """
    try:
        written = {entity.lstrip("/") for entity in RrdReader(path).store().schema().entity_paths()}
    except Exception as error:  # the SDK raises several unrelated kinds
        raise TwinError(f"{shown}: the recording just written cannot be read back ({error})") from error
    missing = sorted(expected - written)
    if missing:
        raise TwinError(f"{shown}: the recording just written lacks {', '.join(missing)}")
