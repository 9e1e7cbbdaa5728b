"""A disk that fills up while the recording is written: an error, and nothing half-written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.viz.conftest import Written
from twin.errors import TwinError
from twin.paths import SCENARIOS
from viz import rrd

_SCRIPT = """
import resource, sys
from pathlib import Path
from tests.viz.synthetic_run import make_recording, make_scene
from viz.rrd import write_rrd

folder = Path(sys.argv[1])
recording, scene = make_recording(6.0), make_scene(folder)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    write_rrd(recording, scene, {}, folder / "run.rrd")
except OSError as error:
    print("refused:", error.strerror)
    sys.exit(7)
"""


@pytest.mark.parametrize("existing", [None, b"what was there before"])
def test_a_full_disk_raises_and_leaves_what_was_there(tmp_path: Path, existing: bytes | None) -> None:
    target = tmp_path / "run.rrd"
    if existing is not None:
        target.write_bytes(existing)
    run = subprocess.run(
        [sys.executable, "-c", _SCRIPT, str(tmp_path), "100000"],
        cwd=SCENARIOS.parent,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (run.returncode, run.stdout.strip()) == (7, "refused: File too large"), run.stderr
    assert [path.name for path in tmp_path.glob("*rrd*")] == (["run.rrd"] if existing is not None else [])
    if existing is not None:
        assert target.read_bytes() == existing


@pytest.mark.parametrize("share", [0.0, 0.5, 0.999])
def test_a_file_cut_short_is_noticed(written: Written, tmp_path: Path, share: float) -> None:
    content = written.path.read_bytes()
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(content[: int(share * len(content))])
    with pytest.raises(TwinError, match="cannot be read back"):
        rrd._check_readable(cut, set(), shown=Path("run.rrd"))


def test_a_missing_entity_is_noticed(written: Written) -> None:
    with pytest.raises(TwinError, match="lacks world/nowhere"):
        rrd._check_readable(written.path, {"world/nowhere"}, shown=Path("run.rrd"))


def test_an_unwritable_folder_raises(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        rrd._write_whole(tmp_path / "missing" / "run.rrd", b"", set())
