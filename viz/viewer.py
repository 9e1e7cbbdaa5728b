"""Opens recordings in the Rerun viewer: in a window, or without a display for pictures."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import IO

from rerun.experimental import ViewerClient

from twin.errors import BadInputError, TwinError
from viz import entities

LOOPBACK = "127.0.0.1"
# The `rerun` command is a wrapper: ending it would leave the viewer running. This is the viewer itself.
_SPEC = find_spec("rerun_cli")
BINARY = Path(_SPEC.origin if _SPEC is not None and _SPEC.origin is not None else "").with_name("rerun")

_START_LIMIT_S = 30.0
_SETTLE_LIMIT_S = 40.0
_POLL_S = 0.05
_SEEK_S = 0.15
_DYING_S = 2.0
_NOTICES_S = 6.0
"""So long after the start the viewer's notices (about slow rendering) may cover a corner of the window."""


def recording_file(what: Path) -> Path:
    """Return the .rrd meant by ``what``: itself, or ``run.rrd`` in a run folder.

    Raises:
        BadInputError: there is no such file.
    """
    path = what / "run.rrd" if what.is_dir() else what
    if not path.is_file():
        hint = " (a run folder without run.rrd: was it run with --no-rrd?)" if what.is_dir() else ""
        raise BadInputError(f"{path}: no such recording{hint}")
    return path.resolve()


def open_recording(what: Path) -> int:
    """Open a run folder or a .rrd in a viewer window and wait until it is closed; return 0.

    The viewer listens on the loopback address only.

    Raises:
        BadInputError: there is no such recording.
        TwinError: the viewer cannot start, e.g. without a display.
    """
    path = recording_file(what)
    # a port of its own, or a viewer that is already open somewhere else on this machine would take the file
    command = [str(BINARY), str(path), "--bind", LOOPBACK, "--port", str(_free_port())]
    with tempfile.TemporaryFile() as complaints, _started(command, os.environ.copy(), complaints) as viewer:
        code = viewer.wait()
        if code != 0:
            raise TwinError(f"the Rerun viewer ended with code {code}: {_last_words(complaints)}")
    return 0


class HeadlessViewer:
    """A viewer without a display, with one recording open; see :func:`headless_viewer`."""

    def __init__(self, client: ViewerClient, viewer: subprocess.Popen[bytes], complaints: IO[bytes]) -> None:
        self._client = client
        self._viewer = viewer
        self._complaints = complaints
        self._clear_at = time.monotonic() + _NOTICES_S

    @property
    def views(self) -> dict[str, str]:
        """Id of each view by its name."""
        return {view.name: view.view_id for view in self._client.get_state().views}

    @property
    def complaints(self) -> list[str]:
        """What the viewer has against the recording: e.g. a missing transform, a broken mesh."""
        views = self._client.get_state().views
        reports = [f"{view.name}: {report.summary}" for view in views for report in view.reports]
        beside = ("rasterizer", "Docker", "poor performance", "not found for screenshot")
        return reports + [
            line.message
            for line in self._client.get_logs()
            if line.level in {"WARN", "ERROR"} and not any(word in line.message for word in beside)
        ]

    def seek(self, t_s: float) -> None:
        """Put the time cursor."""
        self._client.set_time(entities.TIME, duration=t_s, play_state="paused")
        time.sleep(_SEEK_S)

    def is_visible(self, view_id: str) -> bool:
        """Tell whether a view can be photographed, that is, is not in a hidden tab."""
        try:
            self._client.take_screenshot(view_id)
        except ConnectionError as error:
            if "not found" in str(error):
                return False
            raise TwinError(f"the viewer gave no picture: {self._reason(error)}") from error
        return True

    def _reason(self, error: Exception) -> str:
        """What the viewer said in dying, or else the error."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._viewer.wait(_DYING_S)
            return _last_words(self._complaints)
        return str(error).splitlines()[0]

    def screenshot(self, view_id: str | None = None, *, equal_in_a_row: int = 3) -> bytes:
        """Take a PNG of one view, or of the whole window, once it has stopped changing.

        Data load after a seek without saying so: only equal pictures in a row tell that they have arrived.

        Raises:
            TwinError: the picture of the view keeps changing, or the view is not visible (in a hidden tab).
        """
        time.sleep(max(0.0, self._clear_at - time.monotonic()))
        deadline = time.monotonic() + _SETTLE_LIMIT_S
        last, equal = b"", 1
        while equal < equal_in_a_row:
            try:
                picture = self._client.take_screenshot(view_id)
            except ConnectionError as error:
                raise TwinError(f"the viewer gave no picture: {self._reason(error)}") from error
            equal = equal + 1 if picture == last else 1
            last = picture
            if time.monotonic() > deadline:
                if view_id is None:
                    return last  # the window's own bars (what is loaded, notices) may never come to rest
                raise TwinError("the viewer's picture does not come to rest")
            time.sleep(_POLL_S)
        return last


@contextlib.contextmanager
def headless_viewer(path: Path, *, size: str = "1600x900") -> Iterator[HeadlessViewer]:
    """Open a .rrd in a viewer without a display; needs a Vulkan driver (Mesa's software driver will do).

    Nothing outside this machine is asked: no analytics, no update check, no map tiles.

    Raises:
        BadInputError: there is no such file.
        TwinError: the viewer cannot start, e.g. for lack of a Vulkan driver.
    """
    path = recording_file(path)
    port = _free_port()
    command = [str(BINARY), "--headless", "--bind", LOOPBACK, "--port", str(port), "--hide-welcome-screen"]
    command += ["--window-size", size]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as complaints:
        # A proxy that does not exist keeps the viewer from the network, CI=1 from its analytics.
        hermetic = {"CI": "1", "https_proxy": f"http://{LOOPBACK}:9", "XDG_RUNTIME_DIR": folder}
        with _started(command, os.environ | hermetic, complaints) as viewer:
            yield HeadlessViewer(_opened(path, port, viewer, complaints), viewer, complaints)


@contextlib.contextmanager
def _started(
    command: list[str], environment: dict[str, str], complaints: IO[bytes]
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a viewer; end it in the end."""
    try:
        viewer = subprocess.Popen(  # noqa: S603  (the binary that came with rerun-sdk, no shell)
            command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=complaints
        )
    except OSError as error:
        raise TwinError(f"the Rerun viewer cannot start: {error}") from error
    try:
        yield viewer
    finally:
        viewer.terminate()
        try:
            viewer.wait(10)
        except subprocess.TimeoutExpired:
            viewer.kill()
            viewer.wait()


def _opened(path: Path, port: int, viewer: subprocess.Popen[bytes], complaints: IO[bytes]) -> ViewerClient:
    """Connect, open the file and wait until it is laid out; the viewer may fail at any step of it."""
    deadline = time.monotonic() + _START_LIMIT_S
    asked = False
    while True:
        try:
            client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            if not asked:
                client.get_state()
                client.open(str(path))
                asked = True
            state = client.get_state()
            if state.views and not state.loading:
                return client
            failure = "it does not finish loading"
        except (ConnectionError, RuntimeError, OSError) as error:
            failure = str(error)
        if viewer.poll() is not None:
            raise TwinError(
                f"the Rerun viewer cannot start without a display: {_last_words(complaints)}"
                " (it needs a Vulkan driver, e.g. the package mesa-vulkan-drivers)"
            )
        if time.monotonic() > deadline:
            raise TwinError(f"{path}: the Rerun viewer does not show it: {failure}")
        time.sleep(_POLL_S)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        port: int = probe.getsockname()[1]
        return port


def _last_words(complaints: IO[bytes]) -> str:
    """The line of the viewer's output that says why it ended."""
    complaints.seek(0)
    text = re.sub(r"\x1b\[[0-9;]*m", "", complaints.read().decode(errors="replace"))
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    telling = [line for line in lines if line.startswith("Error") or "panicked at" in line]
    words = (telling or lines or ["it said nothing"])[-1]
    return re.sub(r"(os error at )?\S+\.rs:\d+:? ?", "", words)
