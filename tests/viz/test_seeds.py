"""Seeds as they are drawn: where they lie, in which colour, and beside which words."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.viz.reading import entities_of, scalars, series
from tests.viz.synthetic_run import make_recording, make_scene
from tests.viz.test_viewer import holds, opened, pixels
from twin.recording import Recording, Stream
from twin.signals import NS_PER_S, row_position
from viz import entities
from viz.check import empty_views, stored_views
from viz.entities import DENSE_COLOUR, SPARSE_COLOUR
from viz.layers.seeds import (
    FULL_COLOUR,
    NEIGHBOURS,
    Planted,
    draw_seeds,
    local_population,
    seed_colours,
    shown_estimators,
)
from viz.rrd import write_rrd
from viz.sheet import Run

X_REF = 0.2


def _seeds_along(recording: Recording, rows: tuple[int, ...], spacing_m: dict[int, float]) -> Stream:
    """Seeds of some rows along their true paths, evenly spaced by row."""
    truth = recording.truth
    found = []
    for row in rows:
        east, north = (truth.column(name)[:, 0] for name in row_position(row))
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(east), np.diff(north)))])
        # the machine stands at first: a time for every place
        moving = np.concatenate([[0], np.flatnonzero(np.diff(along) > 1e-9) + 1])
        at = np.arange(spacing_m[row], along[-1], spacing_m[row])
        t_s = np.interp(at, along[moving], truth.t_s[moving])
        spacing = np.full(len(at), spacing_m[row])
        spacing[0] = np.nan
        place = [np.interp(at, along[moving], values[moving]) for values in (east, north)]
        feed = np.where(np.isnan(spacing), np.nan, 1.0)
        found.append(np.column_stack([t_s, np.full(len(at), float(row)), *place, spacing, feed]))
    rows_in_time = np.concatenate(found)
    rows_in_time = rows_in_time[np.argsort(rows_in_time[:, 0], kind="stable")]
    return Stream(
        columns=("row", "position_e_m", "position_n_m", "spacing_m", "feed_class"),
        t_ns=np.rint(rows_in_time[:, 0] * NS_PER_S).astype(np.int64),
        values=rows_in_time[:, np.newaxis, 1:],
    )


@pytest.fixture(scope="module")
def sown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Path]:
    """Two estimators: one puts row 1 too far apart and row 8 too close, one does well; the file of it."""
    folder = tmp_path_factory.mktemp("seeds")
    recording = make_recording(30.0)
    recording.scenario_toml += f"[seeding]\nspacing_m = {X_REF}\n"
    off = {1: 1.25 * X_REF, 8: X_REF / 1.34}
    recording.streams["seeds/radar_only"] = _seeds_along(recording, (1, 8), off)
    recording.streams["seeds/central"] = _seeds_along(recording, (1, 8), {1: X_REF, 8: X_REF})
    write_rrd(recording, make_scene(folder), {}, folder / "run.rrd")
    return recording, folder / "run.rrd"


def _static(path: Path, entity: str, component: str) -> list[object]:
    for chunk in RrdReader(path).stream().filter(content=f"/{entity}", components=component):
        return list(chunk.to_record_batch()[component].to_pylist()[0])
    raise AssertionError(f"no {component} at {entity}")


def test_seeds_lie_on_the_field_as_they_landed(sown: tuple[Recording, Path]) -> None:
    recording, path = sown
    stream = recording.streams["seeds/central"]
    t, rows = series(path, entities.seeds("central"), "Points3D:positions")
    lengths = [len(row) for row in rows.to_pylist()]
    # One row of the recording holds the seeds of a fifth of a second, shown at its end.
    assert sum(lengths) == len(stream)
    shown_at = np.repeat(t, lengths)
    assert (shown_at >= stream.t_ns).all()
    assert (shown_at - stream.t_ns < NS_PER_S // 5).all()
    points = rows.flatten().flatten().to_numpy().reshape(-1, 3)
    east = stream.column("position_e_m")[:, 0]
    np.testing.assert_allclose(points[:, 0], east, atol=1e-5)


def test_a_map_of_each_says_how_many_the_outer_rows_got(sown: tuple[Recording, Path]) -> None:
    _, path = sown
    words = {
        name: _static(path, f"{entities.seed_map(name)}/rows", "Points2D:labels") for name in ("radar_only", "central")
    }
    assert words["radar_only"] == ["row 1: 20 % too few", "row 8: 34 % too many"]
    assert words["central"] == ["row 1: as wanted", "row 8: as wanted"]
    maps = [view for view in stored_views(path) if view.kind == "2D"]
    assert {view.name for view in maps} == {"Seeds metered by radar only", "Seeds metered by central"}
    assert empty_views(path) == []


def test_the_plot_shows_the_outer_rows_population(sown: tuple[Recording, Path]) -> None:
    _, path = sown
    _, values = scalars(path, entities.plot("row_1_population", "radar_only"))
    np.testing.assert_allclose(values, 80.0, rtol=1e-9)
    _, values = scalars(path, entities.plot("row_1_population", "central"))
    np.testing.assert_allclose(values, 100.0, rtol=1e-9)


def test_colours_go_from_too_many_over_even_to_too_few_and_mark_doubles_and_gaps() -> None:
    count = 30
    spacing = np.repeat([1.0 / (1.0 + FULL_COLOUR), 1.0, 1.0 / (1.0 - FULL_COLOUR)], count)
    feed = np.ones(3 * count)
    spacing[45], feed[45] = 0.01, 0.0
    spacing[50], feed[50] = 3.0, 2.0
    planted = Planted(
        estimator="one", t_ns=np.arange(3 * count), row=np.ones(3 * count, dtype=np.int64),
        points=np.zeros((3 * count, 2)), spacing=spacing, feed_class=feed,
    )  # fmt: skip
    colours = seed_colours(planted)
    for place, colour in ((10, entities.DENSE_COLOUR), (80, entities.SPARSE_COLOUR), (45, entities.DOUBLE_COLOUR),
                          (50, entities.GAP_COLOUR), (44, entities.EVEN_COLOUR),
                          (51, entities.EVEN_COLOUR)):  # fmt: skip
        np.testing.assert_allclose(colours[place], colour, atol=1e-6)


def test_population_is_one_over_the_mean_spacing_around() -> None:
    spacing = np.concatenate([[np.nan], np.full(20, 0.5), np.full(20, 2.0)])
    found = local_population(spacing, NEIGHBOURS)
    assert found[10] == pytest.approx(2.0)
    assert found[30] == pytest.approx(0.5)
    # Four spacings of a half and five of two: 9 / 12.
    assert found[21] == pytest.approx(9.0 / 12.0)
    assert np.isinf(local_population(np.zeros(10), NEIGHBOURS)[5])
    assert np.isnan(local_population(np.array([np.nan]), NEIGHBOURS)[0])


def test_the_first_and_the_last_drawn_estimator_are_shown(tmp_path: Path) -> None:
    recording = make_recording(6.0)
    run = Run(recording=recording, scene=make_scene(tmp_path), result={})
    assert shown_estimators(run) == []
    names = ("radar_only", "central", "better")
    recording.streams |= {f"seeds/{name}": recording.truth for name in names}
    recording.streams |= {f"estimates/{name}": recording.truth for name in names}
    assert shown_estimators(run) == ["radar_only", "better"]
    hiding = dataclasses.replace(run, scene=dataclasses.replace(run.scene, hidden=frozenset({"better"})))
    assert shown_estimators(hiding) == ["radar_only", "central"]


def test_seeds_without_a_wanted_spacing_are_not_drawn(sown: tuple[Recording, Path], tmp_path: Path) -> None:
    recording = dataclasses.replace(sown[0], scenario_toml='title = "A log without a scenario"')
    write_rrd(recording, make_scene(tmp_path), {}, tmp_path / "run.rrd")
    assert not any("seed" in entity for entity in entities_of(tmp_path / "run.rrd"))


def test_a_person_sees_the_turn_in_one_map_and_not_in_the_other(sown: tuple[Recording, Path], tmp_path: Path) -> None:
    write_rrd(sown[0], make_scene(tmp_path), {}, tmp_path / "maps.rrd", layers=[draw_seeds])
    for viewer in opened(tmp_path / "maps.rrd"):
        # The legend, the same on both maps, has each colour once.
        seen = {
            name: [holds(pixels(viewer.screenshot(view)), colour) for colour in (DENSE_COLOUR, SPARSE_COLOUR)]
            for name, view in viewer.views.items()
        }
        assert viewer.complaints == []
        for uneven, even in zip(*(seen[f"Seeds metered by {name}"] for name in ("radar only", "central")), strict=True):
            assert uneven > 2 * even > 0
