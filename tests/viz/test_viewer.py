"""The real viewer, without a display: what a person would see is there, and nothing it says is a complaint."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Iterator
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from tests.viz.conftest import Written
from tests.viz.synthetic_run import make_recording, make_scene
from twin.errors import BadInputError, TwinError
from twin.signals import Event
from viz import viewer
from viz.legible import LEGIBLE
from viz.rrd import write_rrd
from viz.screenshot import main
from viz.viewer import HeadlessViewer, headless_viewer

# Straight, before the turn of the synthetic run
T_S = 10.0


def opened(path: Path) -> Iterator[HeadlessViewer]:
    try:
        with headless_viewer(path, size="1600x900") as opened_viewer:
            yield opened_viewer
    except TwinError as error:
        if "Vulkan" in str(error):
            pytest.skip(str(error))
        raise


@pytest.fixture(scope="module")
def shown(written: Written) -> Iterator[HeadlessViewer]:
    yield from opened(written.path)


def pixels(png: bytes) -> np.ndarray:
    """(h, w, 3) of 0 to 255."""
    image = matplotlib.image.imread(io.BytesIO(png), format="png")
    return (image[..., :3] * 255).round().astype(np.int64)


def distinct_colours(image: np.ndarray) -> int:
    return len(np.unique(image @ np.array([1, 256, 65536])))


def coloured(image: np.ndarray) -> int:
    """Number of pixels that are not grey: the viewer's own titles, axes and grids are, what is drawn is not."""
    return int((image.max(axis=-1) - image.min(axis=-1) > 60).sum())


def holds(image: np.ndarray, colour: tuple[int, int, int], *, within: int = 40) -> int:
    """Number of pixels near a colour."""
    return int((np.abs(image - np.array(colour)).max(axis=-1) <= within).sum())


def test_every_view_shows_something_and_the_viewer_does_not_complain(shown: HeadlessViewer) -> None:
    shown.seek(T_S)
    shown.screenshot()
    pictured = {}
    for name, view_id in shown.views.items():
        if shown.is_visible(view_id):
            pictured[name] = pixels(shown.screenshot(view_id, equal_in_a_row=2))
    # thirteen views, two of them in hidden tabs (page, events)
    assert len(pictured) == 11
    for name, image in pictured.items():
        assert coloured(image) > 100, name
    field = next(image for name, image in pictured.items() if name.startswith("Field"))
    assert distinct_colours(field) > 3000
    # the red toolbar of the synthetic planter and its green hood, neither of which is in the soil or the sky
    assert holds(field, (200, 70, 70)) > 500
    assert shown.complaints == []


def test_an_empty_view_would_be_noticed(tmp_path: Path) -> None:
    """The measure of the test above, on views whose origin is misspelt."""
    stream = rr.RecordingStream("empty", send_properties=False)
    memory = stream.memory_recording()
    stamps = np.arange(3).astype("timedelta64[s]").astype("timedelta64[ns]")
    stream.send_columns("a", [rr.TimeColumn("time", duration=stamps)], rr.Scalars.columns(scalars=[1.0, 2.0, 3.0]))
    plot = rrb.TimeSeriesView(origin="/b", name="Speed of row 1, with claimed ±1σ [m/s]")
    stream.send_blueprint(rrb.Blueprint(rrb.Vertical(plot, rrb.StateTimelineView(origin="/b", name="States"))))
    path = tmp_path / "empty.rrd"
    path.write_bytes(memory.drain_as_bytes())
    for empty in opened(path):
        counts = [coloured(pixels(empty.screenshot(view, equal_in_a_row=2))) for view in empty.views.values()]
        assert len(counts) == 2
        assert max(counts) < 20


def test_the_machine_moves_and_the_camera_follows(shown: HeadlessViewer) -> None:
    field = next(view_id for name, view_id in shown.views.items() if name.startswith("Field"))
    pictures = []
    for t_s in (0.0, T_S):
        shown.seek(t_s)
        pictures.append(pixels(shown.screenshot(field, equal_in_a_row=3)))
    # The ground has gone by ...
    assert (np.abs(pictures[0] - pictures[1]).max(axis=-1) > 12).mean() > 0.2
    # ... while the machine, on a straight, has stayed where it was in the picture.
    red = [np.argwhere(np.abs(image - (200, 70, 70)).max(axis=-1) <= 40).mean(axis=0) for image in pictures]
    assert np.abs(red[0] - red[1]).max() < 25


def test_text_that_the_viewer_s_font_lacks_does_not_end_it(tmp_path: Path) -> None:
    recording = make_recording(6.0)
    every = "".join(sorted(LEGIBLE - set("\n\"\\'")))
    title = f"中文 ✘ \U0001f69c {every}"
    recording.scenario_toml = f'title = "{title}"\nnotes = "`{title}`"'
    recording.events.append(Event(t_ns=0, source="測試", level="info", text=title))
    scene = dataclasses.replace(make_scene(tmp_path), segment_labels=(title,))
    path = tmp_path / "run.rrd"
    write_rrd(recording, scene, {}, path)
    for first in opened(path):
        assert distinct_colours(pixels(first.screenshot(equal_in_a_row=2))) > 3000


def test_screenshot_command_writes_pictures(
    written: Written, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main([str(written.path), str(tmp_path / "pictures"), "--at", "3", "--size", "800x450"])
    output = capsys.readouterr()
    if code == 2 and "Vulkan" in output.err:
        pytest.skip(output.err)
    assert code == 0, output.err
    picture = tmp_path / "pictures" / "whole_0003.00.png"
    assert output.out.split() == [str(picture)]
    assert pixels(picture.read_bytes()).shape == (450, 800, 3)


def test_what_is_not_there_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"missing\.rrd: no such recording"):
        viewer.open_recording(tmp_path / "missing.rrd")
    with pytest.raises(BadInputError, match="--no-rrd"):
        viewer.open_recording(tmp_path)


def test_without_a_display_the_viewer_says_so(written: Written, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(TwinError, match=r"viewer ended with code \d+: .*DISPLAY"):
        viewer.open_recording(written.path)


def test_without_a_driver_the_headless_viewer_says_so(written: Written, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):
        monkeypatch.setenv(name, "/nonexistent")
    with pytest.raises(TwinError, match="Vulkan driver"), headless_viewer(written.path):
        pass


def test_a_binary_that_is_not_there_is_a_clear_error(written: Written, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "BINARY", Path("/nonexistent/rerun"))
    with pytest.raises(TwinError, match="cannot start"):
        viewer.open_recording(written.path)
