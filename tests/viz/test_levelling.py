"""The recording of a levelling blade: the field in colours, the soil it carries, maps, height plots and lanes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.viz import levelling_run as made
from tests.viz.reading import entities_of, scalars, series, texts, vectors
from tests.viz.test_viewer import coloured, holds, opened, pixels
from twin.recording import Recording
from twin.signals import HEIGHT, LEVEL_WITHIN_M, NS_PER_S
from twin.world.survey import FieldSurvey
from twin.world.terrain import Terrain
from viz import entities
from viz.check import empty_views, stored_views
from viz.layers.load import wedge
from viz.levelled import STEP_NS, flatness, highest_ground, levelled_field
from viz.relief import FULL_M, height_colours, packed_colours
from viz.rrd import write_rrd
from viz.scene import Scene
from viz.terrain import Window, terrain_mesh


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Scene, Path]:
    """The run, its scene, and the file that it was written to."""
    folder: Path = tmp_path_factory.mktemp("levelling")
    recording, scene = made.make_recording(), made.make_scene(folder)
    path = folder / "run.rrd"
    write_rrd(recording, scene, {}, path)
    return recording, scene, path


def test_colours_show_the_limit_as_a_step_and_tell_high_from_low() -> None:
    within = height_colours(np.linspace(-LEVEL_WITHIN_M, LEVEL_WITHIN_M, 61)).astype(int)
    assert within.min() > 190  # pale, all of it, both ends included
    low, high = height_colours(np.array([-LEVEL_WITHIN_M - 1e-6, LEVEL_WITHIN_M + 1e-6])).astype(int)
    assert np.abs(low - within[0]).max() > 60
    assert np.abs(high - within[-1]).max() > 60
    assert low[2] > low[0] + 60  # blue
    assert high[0] > high[2] + 60  # red
    np.testing.assert_array_equal(height_colours(np.array([FULL_M, -FULL_M])), height_colours(np.array([9.0, -9.0])))
    assert packed_colours(np.array([[0.0]])).shape == (1, 1)
    red, green, blue = height_colours(np.array(0.07)).tolist()
    assert int(packed_colours(np.array(0.07))) == red << 24 | green << 16 | blue << 8 | 0xFF


def test_the_tiles_put_together_are_the_ground_at_every_step(drawn: tuple[Recording, Scene, Path]) -> None:
    recording, scene, _ = drawn
    field = levelled_field(scene)
    assert field is not None
    assert recording.ground is not None
    changes = field.changes(recording.ground, scene.heights.shape[1], recording.truth.t_ns[-1])
    first = field.picked(scene.heights)
    states = [(tile, list(changes.of(tile, first))) for tile in field.tiles()]
    for t_ns in (0, STEP_NS, 3 * NS_PER_S, 7 * NS_PER_S + STEP_NS, 24 * NS_PER_S):
        whole = np.full(first.shape, np.nan)
        for tile, history in states:
            whole[tile.rows, tile.columns] = [heights for at, heights in history if at <= t_ns][-1]
        # what changed at 0 is drawn a step later
        expected = recording.ground.heights_at(scene.heights, t_ns or -1)
        np.testing.assert_array_equal(whole, field.picked(expected))
    # A tile that nothing changes is sent once; one on the lane while the blade passes its 2.5 m, and not for ever.
    counts = [len(history) for _, history in states]
    assert min(counts) == 1
    assert 4 <= max(counts) <= 8
    assert field.pitch_m == pytest.approx(0.2)  # the least multiple of 0.1 m that is at least 0.15 m


def test_tiles_hold_heights_and_their_colours(drawn: tuple[Recording, Scene, Path]) -> None:
    recording, scene, path = drawn
    field = levelled_field(scene)
    assert field is not None
    assert recording.ground is not None
    final = field.picked(recording.ground.heights_at(scene.heights, recording.truth.t_ns[-1]))
    lane = 0
    for index, tile in enumerate(field.tiles()):
        entity = entities.surface_tile(index)
        t_ns, rows = series(path, entity, "Mesh3D:vertex_positions")
        vertices = np.array(rows[-1].as_py())
        expected = final[tile.rows, tile.columns].ravel()
        np.testing.assert_allclose(vertices[:, 2], expected, atol=1e-6)
        _, colours = series(path, entity, "Mesh3D:vertex_colors")
        assert colours[-1].as_py() == packed_colours(expected - made.DESIGN_M).tolist()
        lane += len(t_ns) > 1
    # the lane, 2 m of the 10 m that are drawn, lies in one or two of the four strips of tiles
    assert 0 < lane < 0.6 * len(field.tiles())


def test_a_recording_of_a_field_stays_small(drawn: tuple[Recording, Scene, Path]) -> None:
    # 16 bytes a vertex; 300 s of a blade that is always at work have to leave room for the rest of 30 MB.
    _, scene, path = drawn
    field = levelled_field(scene)
    assert field is not None
    sent = 0
    for index in range(len(field.tiles())):
        _, rows = series(path, entities.surface_tile(index), "Mesh3D:vertex_colors")
        sent += sum(len(row) for row in rows[1:].to_pylist())
    lane_s = 16.0
    assert 16 * sent / lane_s * 300.0 < 15e6


def test_the_static_ground_makes_room_for_the_field(drawn: tuple[Recording, Scene, Path]) -> None:
    scene = drawn[1]
    window, hole = Window(rows=(0, 201), columns=(0, 401)), Window(rows=(50, 151), columns=(80, 281))
    mesh = terrain_mesh(scene, window, hole=hole, max_vertices=2000)
    low_n, high_n = made.SOUTH_M + 0.1 * 50, made.SOUTH_M + 0.1 * 150
    low_e, high_e = made.WEST_M + 0.1 * 80, made.WEST_M + 0.1 * 280
    east, north, up = mesh.vertices.T.astype(float)
    inside = (east > low_e + 1e-4) & (east < high_e - 1e-4) & (north > low_n + 1e-4) & (north < high_n - 1e-4)
    depth = scene.height_at(east, north) - up
    np.testing.assert_allclose(depth[~inside], 0.0, atol=1e-5)
    np.testing.assert_allclose(depth[inside], 1.0, atol=1e-5)
    for places, edges in ((east, (low_e, high_e)), (north, (low_n, high_n))):
        assert all(np.isclose(places, edge, atol=1e-4).any() for edge in edges)


def test_lines_lie_on_the_highest_ground_there_ever_is() -> None:
    first, log = made.first_ground(), made.ground_log()
    highest = highest_ground(first, log)
    last = log.heights_at(first, 10**15)
    np.testing.assert_array_equal(highest, np.maximum(first, last))
    np.testing.assert_array_equal(highest_ground(first, None), first)


def test_the_wedge_has_the_load_s_volume_and_stands_at_the_angle_of_repose() -> None:
    loads = np.array([0.0, 0.05, made.BLADE.capacity_m3])
    vertices = wedge(made.BLADE, loads) - made.BLADE.middle_m
    reach, height, width = (
        vertices[:, :, 0].max(axis=1),
        vertices[:, :, 2].max(axis=1),
        np.ptp(vertices[:, :, 1], axis=1),
    )
    np.testing.assert_allclose(0.5 * reach * height * width, loads, atol=1e-12)
    np.testing.assert_allclose(height[1:] / reach[1:], math.tan(made.BLADE.repose_rad))
    assert height[-1] == pytest.approx(made.BLADE.height_m)


def test_the_load_is_drawn_in_the_frame_of_the_blade_as_it_grows(drawn: tuple[Recording, Scene, Path]) -> None:
    recording, _, path = drawn
    chunks = RrdReader(path).stream().filter(content=f"/{entities.LOAD}", components="CoordinateFrame:frame")
    assert [chunk.to_record_batch()["CoordinateFrame:frame"].to_pylist() for chunk in chunks] == [[["scraper"]]]
    t_ns, rows = series(path, entities.LOAD, "Mesh3D:vertex_positions")
    volumes = []
    for row in rows.to_pylist():
        corners = np.array(row)
        volumes.append(0.5 * np.prod(np.ptp(corners, axis=0)))
    load = recording.truth.column("blade_load_m3")[np.searchsorted(recording.truth.t_ns, t_ns), 0]
    np.testing.assert_allclose(volumes, load, atol=1e-6)
    assert len(t_ns) > 50


def test_the_lift_s_slide_moves_the_blade(drawn: tuple[Recording, Scene, Path]) -> None:
    recording, _, path = drawn
    t_ns, translation = vectors(path, entities.joint("lift"), "Transform3D:translation")
    stroke = recording.truth.column("joint.lift_m")[np.searchsorted(recording.truth.t_ns, t_ns), 0]
    np.testing.assert_allclose(translation, np.column_stack([0 * stroke - 1.0, 0 * stroke, stroke - 0.5]), atol=1e-6)
    assert stroke.max() == pytest.approx(0.3)


def test_receiver_heights_are_taken_down_by_the_true_attitude(drawn: tuple[Recording, Scene, Path]) -> None:
    recording, _, path = drawn
    for code, error_mm in ((4, 1000.0 * made.RECEIVER_ERROR_M), (2, 2000.0)):
        t_ns, values = scalars(path, entities.plot("height", f"gnss_{code}"))
        at = np.searchsorted(recording.truth.t_ns, t_ns)
        np.testing.assert_allclose(values, 1000.0 * recording.truth.column(HEIGHT)[at, 0] + error_mm, atol=1e-6)
        quality = recording.measurements("gnss").column("quality")[:, 0]
        assert len(t_ns) == (quality == code).sum()


def test_heights_and_errors_are_in_mm_with_the_limit_and_the_band_of_ours(
    drawn: tuple[Recording, Scene, Path],
) -> None:
    _, _, path = drawn
    _, ours = scalars(path, entities.plot("height_error", "ours"))
    np.testing.assert_allclose(ours, 1000.0 * made.OURS_ERROR_M, atol=1e-9)
    _, vpkf = scalars(path, entities.plot("height_error", "vpkf"))
    assert set(np.round(vpkf)) == {15.0, 1500.0}
    known = entities_of(path)
    for panel in ("height", "height_error"):
        band = entities.band(entities.plot(panel, "ours"))
        _, variance = scalars(path, band, "Measurements:variances")
        np.testing.assert_allclose(variance, (1000.0 * made.OURS_SIGMA_M) ** 2)
        assert entities.band(entities.plot(panel, "vpkf")) not in known
        for side, value in (("above", 30.0), ("below", -30.0)):
            t_ns, line = scalars(path, entities.plot(panel, f"limit_{side}"))
            assert line.tolist() == [value, value]
            assert t_ns.tolist() == [0, round(made.DURATION_S * NS_PER_S)]


def test_on_a_bench_the_limit_is_for_errors_only(tmp_path: Path) -> None:
    recording, scene = made.make_recording(), made.without_area(made.make_scene(tmp_path))
    truth = recording.truth
    gone = ("blade_load_m3", "blade_draught_n", "field_sd_m", "field_within_30mm", "field_within_50mm")
    left = [name for name in truth.columns if name not in gone]
    recording.streams["truth"] = made.table(truth.t_ns, {name: truth.column(name)[:, 0] for name in left})
    recording.ground = None
    path = tmp_path / "run.rrd"
    write_rrd(recording, scene, {}, path)
    known = entities_of(path)
    assert entities.plot("height_error", "limit_above") in known
    assert entities.plot("height", "limit_above") not in known
    gone_with_it = (
        entities.SURFACE,
        entities.AREA,
        entities.HEIGHT_LEGEND,
        entities.LOAD,
        "height_map",
        "plots/flatness",
    )
    assert not any(entity.startswith(gone_with_it) for entity in known)
    assert empty_views(path) == []


def test_lanes_tell_the_blade_the_link_and_what_filters_do(drawn: tuple[Recording, Scene, Path]) -> None:
    _, _, path = drawn
    told = {
        "blade": ["at work", "raised"],
        "gnss_quality": ["RTK fixed", "DGPS", "RTK fixed"],
        "gnss_corrections": ["corrections arrive", "none", "corrections arrive"],
        "gnss_faults": ["no fault", "corrections lost", "no fault"],
        "ours_mode": ["tracking", "coasting", "tracking"],
        "vpkf_mode": ["trusts GNSS (Q1)", "distrusts GNSS (Q2)", "trusts GNSS (Q1)"],
    }
    for lane, expected in told.items():
        t_ns, states = texts(path, entities.lane(lane), "StateChange:state")
        assert states == expected, lane
        if lane.endswith("mode"):
            assert t_ns == [0, *(round(at * NS_PER_S) for at in made.LOST_S)]
    assert entities.lane("turning") not in entities_of(path)


def test_receivers_show_the_height_s_error_and_soil_its_figures(drawn: tuple[Recording, Scene, Path]) -> None:
    recording, _, path = drawn
    _, error = scalars(path, entities.plot("gnss_error", "true_error"))
    assert set(error) == {1000.0 * made.RECEIVER_ERROR_M, 2000.0}
    t_ns, spread = scalars(path, entities.plot("flatness", "S_d"))
    np.testing.assert_allclose(spread, 30.0 - 0.5 * np.floor(t_ns / NS_PER_S))
    t_ns, draught = scalars(path, entities.plot("blade_draught", "draught"))
    load = recording.truth.column("blade_load_m3")[np.searchsorted(recording.truth.t_ns, t_ns), 0]
    np.testing.assert_allclose(draught, 8.0 * load)
    titles = [view.name for view in stored_views(path) if view.kind == "TimeSeries"]
    assert all(title.endswith("]") for title in titles)


def test_maps_show_the_field_before_and_after_with_north_up(drawn: tuple[Recording, Scene, Path]) -> None:
    recording, scene, path = drawn
    field = levelled_field(scene)
    assert field is not None
    assert recording.ground is not None
    after = recording.ground.heights_at(scene.heights, recording.truth.t_ns[-1])
    for which, heights in (("before", scene.heights), ("after", after)):
        chunk = next(
            chunk.to_record_batch()
            for chunk in RrdReader(path).stream()
            if chunk.entity_path == f"/{entities.height_map(which)}/heights"
        )
        shape = len(field.rows), -1, 3
        image = np.array(chunk["Image:buffer"].to_pylist()[0][0], dtype=np.uint8).reshape(shape)
        shown = image[:, : len(field.columns)]
        np.testing.assert_array_equal(shown[0], height_colours(field.picked(heights)[-1] - made.DESIGN_M))
        np.testing.assert_array_equal(shown[-1], height_colours(field.picked(heights)[0] - made.DESIGN_M))
        spread, share = flatness(scene, heights)
        assert f"S_d {1000 * spread:.1f} mm, {100 * share:.0f} % within 30 mm" in "".join(
            view.name for view in stored_views(path) if view.name.lower().startswith(which)
        )


def test_flatness_is_what_the_survey_of_the_world_measures(drawn: tuple[Recording, Scene, Path]) -> None:
    scene = drawn[1]
    terrain = Terrain(heights=scene.heights, west_m=made.WEST_M, south_m=made.SOUTH_M, cell_m=made.CELL_M)
    spread, _, share, _ = FieldSurvey(terrain, made.AREA_M, design_height_m=made.DESIGN_M).measure()
    assert flatness(scene, scene.heights) == pytest.approx((spread, share), rel=1e-12)


def test_every_view_of_a_leveller_has_content(drawn: tuple[Recording, Scene, Path]) -> None:
    assert empty_views(drawn[2]) == []


def test_the_viewer_shows_the_field_and_its_legend_without_a_complaint(drawn: tuple[Recording, Scene, Path]) -> None:
    _, _, path = drawn
    for viewer in opened(path):
        field = next(view for name, view in viewer.views.items() if name.startswith("Field,"))
        pictures = {}
        for t_s in (1.0, 14.0):
            viewer.seek(t_s)
            viewer.screenshot()
            pictures[t_s] = pixels(viewer.screenshot(field, equal_in_a_row=3))
        for image in pictures.values():
            # not shaded: the colours are those of the legend
            assert holds(image, tuple(height_colours(np.array(made.FINISHED_M)).tolist()), within=12) > 2000
            full = tuple(height_colours(np.array(0.95 * FULL_M)).tolist())
            assert holds(image, full, within=12) > 50  # the legend alone: the field reaches 60 mm
        # The legend stays where it is while machine and camera go on by 13 m.
        width = pictures[1.0].shape[1] // 8
        places = [
            np.argwhere(np.abs(image[:, :width] - np.array(full)).max(axis=-1) <= 12) for image in pictures.values()
        ]
        assert np.abs(places[0].mean(axis=0) - places[1].mean(axis=0)).max() < 6.0
        for name, view in viewer.views.items():
            if viewer.is_visible(view):
                assert coloured(pixels(viewer.screenshot(view, equal_in_a_row=2))) > 100, name
        assert viewer.complaints == []
