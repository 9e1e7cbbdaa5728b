from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.viz.conftest import Written
from tests.viz.reading import entities_of, scalars, texts, vectors
from tests.viz.synthetic_run import make_recording, make_result, make_scene
from twin.recording import Recording, covariance_column
from twin.signals import row_speed, sigma_column
from viz import entities
from viz.check import empty_views, shown_entities, stored_views
from viz.layers import LAYERS
from viz.layers.estimates import CHI2_95_2DOF, SMALLEST_M
from viz.rrd import write_rrd
from viz.sheet import PanelKind, Run, Sheet


def column(recording: Recording, stream: str, name: str) -> np.ndarray:
    return recording.streams[stream].column(name)[:, 0]


def test_every_subject_is_drawn_on_the_paths_that_entities_names(written: Written) -> None:
    expected = {
        entities.TERRAIN,
        entities.GRID,
        entities.PLANNED_PATH,
        entities.FOCUS,
        entities.base_pose(),
        *(entities.joint(name) for name in ("hitch", "steer", "wheel")),
        *(entities.true_trail(row) for row in (1, 8)),
        *(entities.estimated_row_trail("central", row) for row in (1, 8)),
        entities.estimated_pose("central"),
        entities.estimated_rows("central"),
        entities.covariance_ellipse("central"),
        entities.measured_points("gnss"),
        *(
            entities.plot(f"row_{row}_speed", series)
            for row in (1, 8)
            for series in ("truth", "central", "radar_only", "radar")
        ),
        *(entities.plot(f"row_{row}_speed_error", name) for row in (1, 8) for name in ("central", "radar_only")),
        *(entities.band(entities.plot(f"row_{row}_speed_error", "central")) for row in (1, 8)),
        *(entities.plot("yaw_rate", series) for series in ("truth", "central")),
        entities.plot("position_error", "central"),
        entities.plot("heading_error", "central"),
        *(entities.lane(name) for name in ("segment", "turning", "standstill_central", "gnss_quality")),
        entities.event_log("driver"),
        entities.event_log("sensors.gnss"),
        entities.PAGE,
    }
    assert expected <= entities_of(written.path)


def test_what_never_changes_comes_before_the_rows(written: Written) -> None:
    static = [chunk.is_static for chunk in RrdReader(written.path).stream()]
    assert static == sorted(static, reverse=True)
    assert any(static)
    assert not all(static)


def test_there_is_one_timeline_and_it_is_not_the_one_that_rrd_compare_skips(written: Written) -> None:
    timelines = {name for chunk in RrdReader(written.path).stream() for name in chunk.timeline_names}
    assert timelines == {"time"}


def test_base_pose_is_the_truth_at_exact_nanoseconds(written: Written) -> None:
    t, translation = vectors(written.path, entities.base_pose(), "Transform3D:translation")
    truth_t = written.recording.truth.t_ns
    assert set(t.tolist()) <= set(truth_t.tolist())
    assert (t[0], t[-1]) == (truth_t[0], truth_t[-1])
    true = np.column_stack([column(written.recording, "truth", f"base_{axis}_m") for axis in "enu"])
    at = np.searchsorted(truth_t, t)
    # the SDK keeps translations as float32
    np.testing.assert_array_equal(translation, true[at].astype(np.float32))
    # Nothing is left out that moves: from one row to the next the machine goes at most 2.5 m/s x 20 ms, or stood.
    assert np.abs(np.diff(translation[:, :2], axis=0)).max() < 0.06


def test_joints_carry_the_true_angle(written: Written) -> None:
    t, quaternion = vectors(written.path, entities.joint("hitch"), "Transform3D:quaternion")
    angle = column(written.recording, "truth", "joint.hitch_rad")[np.searchsorted(written.recording.truth.t_ns, t)]
    # about the z axis: (0, 0, sin(a/2), cos(a/2))
    expected = np.column_stack([0 * angle, 0 * angle, np.sin(angle / 2), np.cos(angle / 2)])
    np.testing.assert_allclose(quaternion, expected, atol=1e-7)


def test_plots_hold_the_columns_bit_for_bit_and_both_ends(written: Written) -> None:
    recording = written.recording
    for name, stream in (("truth", "truth"), ("central", "estimates/central"), ("radar_only", "estimates/radar_only")):
        t, values = scalars(written.path, entities.plot("row_1_speed", name))
        stream_t = recording.streams[stream].t_ns
        assert (t[0], t[-1]) == (stream_t[0], stream_t[-1])
        # 50 Hz thinned to 25 Hz: every second row of 1501, the last one included
        assert len(t) == 751
        at = np.searchsorted(stream_t, t)
        np.testing.assert_array_equal(stream_t[at], t)
        np.testing.assert_array_equal(values, column(recording, stream, row_speed(1))[at])


def test_errors_are_estimate_minus_truth_with_the_claimed_sigma(written: Written) -> None:
    recording = written.recording
    entity = entities.plot("row_8_speed_error", "central")
    t, error = scalars(written.path, entity)
    at = np.searchsorted(recording.truth.t_ns, t)
    expected = column(recording, "estimates/central", row_speed(8)) - column(recording, "truth", row_speed(8))
    np.testing.assert_array_equal(error, expected[at])
    band_t, variance = scalars(written.path, entities.band(entity), "Measurements:variances")
    np.testing.assert_array_equal(band_t, t)
    sigma = column(recording, "estimates/central", sigma_column(row_speed(8)))
    np.testing.assert_allclose(variance, sigma[at] ** 2, rtol=1e-15)


def test_heading_error_is_wrapped_and_in_degrees(written: Written) -> None:
    _, error = scalars(written.path, entities.plot("heading_error", "central"))
    # sigma is 0.01 rad = 0.57 deg; five of them, whatever side of pi the heading lies on in the half circle
    assert np.abs(error).max() < 5 * 0.573
    # 0.57 deg standard deviation of a first-order process with tau 5 s over 30 s: within a factor of three
    assert 0.19 < np.sqrt(np.mean(error**2)) < 1.7


def test_covariance_ellipse_is_the_95_percent_region(written: Written) -> None:
    t, half = vectors(written.path, entities.covariance_ellipse("central"), "Ellipsoids3D:half_sizes")
    _, quaternion = vectors(written.path, entities.covariance_ellipse("central"), "Ellipsoids3D:quaternions")
    stream = written.recording.estimates("central")
    at = np.searchsorted(stream.t_ns, t)
    names = ("position_e_m", "position_n_m")
    covariance = np.array([[stream.column(covariance_column(*sorted((a, b))))[at, 0] for a in names] for b in names])
    eigenvalues, eigenvectors = np.linalg.eigh(np.moveaxis(covariance, -1, 0))
    axes = np.sqrt(CHI2_95_2DOF * eigenvalues[:, ::-1])
    np.testing.assert_allclose(half[:, :2], np.maximum(axes, SMALLEST_M), rtol=1e-5)
    long = np.column_stack([1 - 2 * quaternion[:, 2] ** 2, 2 * quaternion[:, 2] * quaternion[:, 3]])
    along = np.abs(np.sum(long * eigenvectors[:, :, 1], axis=1))
    np.testing.assert_allclose(along, 1.0, atol=1e-5)


def test_gnss_points_are_coloured_by_quality_and_lost_ones_are_left_out(written: Written) -> None:
    stream = written.recording.measurements("gnss")
    t, colours = scalars(written.path, entities.measured_points("gnss"), "Points3D:colors")
    quality = stream.column("quality")[:, 0]
    assert t.tolist() == stream.t_ns[quality > 0].tolist()
    for code in (1, 2, 4, 5):
        red, green, blue = entities.QUALITY_COLOURS[code]
        assert set(colours[quality[quality > 0] == code]) == {red << 24 | green << 16 | blue << 8 | 255}


def test_state_lanes_hold_every_change_and_nothing_else(written: Written) -> None:
    truth = written.recording.truth
    segment = column(written.recording, "truth", "segment")
    starts = [0, *(np.flatnonzero(np.diff(segment)) + 1).tolist()]
    t, states = texts(written.path, entities.lane("segment"), "StateChange:state")
    assert t == truth.t_ns[starts].tolist()
    assert states == ["stand 5 s", "straight 15 m", "turn 180 deg right", "straight to the end"]
    _, quality = texts(written.path, entities.lane("gnss_quality"), "StateChange:state")
    assert quality == ["RTK fixed", "RTK float", "DGPS", "single", "no fix", "RTK fixed"]
    t, standing = texts(written.path, entities.lane("standstill_central"), "StateChange:state")
    stream = written.recording.estimates("central")
    assert standing == ["standstill", "moving"]
    assert t[1] == stream.t_ns[np.flatnonzero(stream.column("standstill")[:, 0] < 0.5)[0]]


def test_a_state_of_a_single_row_is_not_lost(tmp_path: Path) -> None:
    recording = make_recording(6.0)
    yaw_rate = recording.truth.columns.index("yaw_rate_rad_s")
    recording.truth.values[101, 0, yaw_rate] = -0.051
    write_rrd(recording, make_scene(tmp_path), {}, tmp_path / "run.rrd")
    t, states = texts(tmp_path / "run.rrd", entities.lane("turning"), "StateChange:state")
    assert states == ["straight", "turning", "straight"]
    assert t[1:] == recording.truth.t_ns[[101, 102]].tolist()


def test_events_keep_time_level_and_text(written: Written) -> None:
    t, body = texts(written.path, entities.event_log("sensors.gnss"), "TextLog:text")
    _, level = texts(written.path, entities.event_log("sensors.gnss"), "TextLog:level")
    assert list(zip(t, level, body, strict=True)) == [
        (18_000_000_000, "WARN", "18.00 s  sensors.gnss: corrections lost: RTK float"),
        (23_000_000_000, "ERROR", "23.00 s  sensors.gnss: no position"),
    ]


def test_every_view_has_content(written: Written) -> None:
    views = stored_views(written.path)
    assert {view.kind for view in views} == {"3D", "TimeSeries", "StateTimeline", "TextLog", "TextDocument"}
    assert len(views) == 13
    assert empty_views(written.path) == []


def test_the_check_sees_a_view_with_a_misspelt_origin(written: Written) -> None:
    view = next(view for view in stored_views(written.path) if view.origin == "/plots/yaw_rate")
    known = [f"/{entity}" for entity in entities_of(written.path)]
    assert shown_entities(view, known) == [f"/{entities.plot('yaw_rate', name)}" for name in ("central", "truth")] or (
        len(shown_entities(view, known)) == 2
    )
    view.origin = "/plots/yaw_rat"
    assert shown_entities(view, known) == []


def test_layers_skip_what_is_absent(tmp_path: Path) -> None:
    """A real log has no truth; another machine has no rows, no URDF, no radar: still a file with filled views."""
    recording = make_recording(6.0)
    for name in ("truth", "measurements/radar", "estimates/radar_only"):
        del recording.streams[name]
    scene = dataclasses.replace(make_scene(tmp_path), urdf=None, row_count=0, planned_path=np.empty((0, 2)))
    path = tmp_path / "run.rrd"
    write_rrd(recording, scene, {}, path)
    assert empty_views(path) == []
    written = entities_of(path)
    assert entities.measured_points("gnss") in written
    assert entities.estimated_trail("central") in written
    assert not any(entity.startswith(("world/truth", "plots/row_")) for entity in written)


def test_streams_without_rows_are_skipped(tmp_path: Path) -> None:
    recording = make_recording(6.0)
    for name, stream in recording.streams.items():
        recording.streams[name] = dataclasses.replace(
            stream,
            t_ns=stream.t_ns[:0],
            values=stream.values[:0],
            valid=None if stream.valid is None else stream.valid[:0],
        )
    recording.events.clear()
    write_rrd(recording, make_scene(tmp_path), {}, tmp_path / "run.rrd")
    assert empty_views(tmp_path / "run.rrd") == []


def test_another_member_is_drawn_beside_the_shared_truth(tmp_path: Path) -> None:
    recording = make_recording(6.0)
    second = make_recording(6.0, seed=8)
    for name in ("measurements/gnss", "measurements/radar", "estimates/central", "estimates/radar_only"):
        pair = [recording.streams[name], second.streams[name]]
        recording.streams[name] = dataclasses.replace(
            pair[0],
            values=np.concatenate([stream.values for stream in pair], axis=1),
            valid=None if pair[0].valid is None else np.concatenate([s.valid for s in pair], axis=1),  # type: ignore[misc]
        )
    recording.runs = (0, 1)
    path = tmp_path / "run.rrd"
    write_rrd(recording, make_scene(tmp_path), {}, path, member=1)
    t, values = scalars(path, entities.plot("row_1_speed", "central"))
    expected = second.estimates("central").column(row_speed(1))[:, 0]
    np.testing.assert_array_equal(values, expected[np.searchsorted(second.truth.t_ns, t)])


def test_a_layer_of_ones_own_gets_its_panel(tmp_path: Path) -> None:
    def draw_wind(run: Run, sheet: Sheet) -> None:
        import rerun as rr  # noqa: PLC0415

        t_ns = run.recording.truth.t_ns
        sheet.rows("plots/wind/speed", t_ns, rr.Scalars.columns(scalars=np.ones(len(t_ns))))
        sheet.panel(PanelKind.PLOT, "plots/wind", "Wind [m/s]")
        sheet.panel(PanelKind.PLOT, "plots/nothing", "Nothing [m]")

    path = tmp_path / "run.rrd"
    write_rrd(make_recording(6.0), make_scene(tmp_path), {}, path, layers=[*LAYERS, draw_wind])
    names = [view.name for view in stored_views(path)]
    assert "Wind [m/s]" in names
    assert "Nothing [m]" not in names


def test_the_page_says_what_was_run_and_what_came_out(written: Written) -> None:
    chunk = next(
        chunk for chunk in RrdReader(written.path).stream() if chunk.entity_path == f"/{entities.PAGE}"
    ).to_record_batch()
    text = chunk["TextDocument:text"].to_pylist()[0][0]
    assert text.startswith("# Synthetic: a straight and a half circle")
    assert "## Verdict: ✗ FAIL" in text
    assert "| radar_only.row_speed.mean_abs_error_row_1_m_s | 0.61 | 0.57 |" in text
    assert "| radar_only.position.rmse_m | – |  |" in text
    assert "| ✔ | central.row_speed.mean_abs_error_turns_m_s | 0.0213 | at most 0.06 |" in text
    assert "at most 0.2 of radar_only's |" in text


def test_misuse_of_the_sdk_raises_instead_of_dropping_data(tmp_path: Path) -> None:
    import rerun as rr  # noqa: PLC0415

    def draw_wrongly(run: Run, sheet: Sheet) -> None:
        t_ns = run.recording.truth.t_ns
        sheet.rows("plots/wrong/series", t_ns, rr.Scalars.columns(scalars=np.ones(len(t_ns) - 1)))

    rr.set_strict_mode(False)
    try:
        with pytest.raises(ValueError, match="length"):
            write_rrd(make_recording(6.0), make_scene(tmp_path), {}, tmp_path / "run.rrd", layers=[draw_wrongly])
    finally:
        rr.set_strict_mode(True)
    assert not (tmp_path / "run.rrd").exists()


def test_a_result_without_anything_still_gives_a_page(tmp_path: Path) -> None:
    write_rrd(make_recording(6.0), make_scene(tmp_path), {}, tmp_path / "run.rrd")
    assert entities.PAGE in entities_of(tmp_path / "run.rrd")
    assert make_result()["verdict"] == "fail"
