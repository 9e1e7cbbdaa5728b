"""The picture of fields before and after, for a report."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.viz import levelling_run as made
from tests.viz.test_viewer import holds, pixels
from twin.errors import BadInputError
from twin.recording import Recording
from viz import field_picture
from viz.relief import height_colours
from viz.scene import Scene


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scene:
    """The made-up run's scene, whatever its scenario says."""
    found = made.make_scene(tmp_path)
    monkeypatch.setattr(field_picture, "scene_of", lambda _: found)
    return found


def recording_that_follows(whom: str) -> Recording:
    recording = made.make_recording()
    recording.scenario_toml += f'[implement]\nkind = "levelling"\nfollows = "{whom}"\n'
    return recording


def test_the_picture_shows_the_lane_in_the_maps_after_only(scene: Scene, tmp_path: Path) -> None:
    lane = tuple(height_colours(np.array(made.FINISHED_M)).tolist())
    counts = []
    for runs in (1, 2):
        path = tmp_path / f"{runs}.png"
        field_picture.draw_fields([recording_that_follows("truth")] * runs, path)
        image = pixels(path.read_bytes())
        counts.append(holds(image, lane, within=1))
    # twice as many maps of the finished field; the maps of two and of three have not quite the same size
    assert counts[0] > 5000
    assert counts[1] == pytest.approx(2 * counts[0], rel=0.4)
    assert scene.levelling.area_m == made.AREA_M


def test_what_cannot_be_compared_is_bad_input(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    still = recording_that_follows("truth")
    still.ground = None
    with pytest.raises(BadInputError, match="no soil is moved"):
        field_picture.draw_fields([still], tmp_path / "a.png")
    other = dataclasses.replace(scene, heights=scene.heights + 0.01)
    scenes = iter([scene, other])
    monkeypatch.setattr(field_picture, "scene_of", lambda _: next(scenes))
    with pytest.raises(BadInputError, match="another field"):
        field_picture.draw_fields([recording_that_follows("truth"), recording_that_follows("ours")], tmp_path / "b.png")
    assert not list(tmp_path.glob("*.png"))


def test_the_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert field_picture.main([str(tmp_path / "a.png"), str(tmp_path)]) == 2
    assert capsys.readouterr().err
