from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import rerun as rr

from tests.viz.synthetic_run import make_recording, make_result, make_scene
from twin.recording import Recording
from viz.rrd import write_rrd
from viz.scene import Scene

DURATION_S = 30.0


@dataclass(frozen=True)
class Written:
    """A run, and the file that it was written to."""

    recording: Recording
    scene: Scene
    result: dict[str, Any]
    path: Path


@pytest.fixture(scope="session", autouse=True)
def _strict() -> Iterator[None]:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("rrd")
    recording, scene, result = make_recording(DURATION_S), make_scene(folder), make_result(DURATION_S)
    path = folder / "run.rrd"
    write_rrd(recording, scene, result, path)
    return Written(recording, scene, result, path)
