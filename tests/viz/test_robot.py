"""The recording of a robot among trees shows what stands there and what its sensors saw of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.viz.reading import entities_of, scalars, series
from twin.execution import execute
from twin.recording import Recording
from twin.scenario import load
from viz import entities
from viz.check import empty_views, shown_entities, stored_views
from viz.compose import scene_of
from viz.rrd import write_rrd

SCENARIO = """
title = "A robot among trees"
duration_s = 4.0
[terrain]
kind = "flat"
[soil]
preset = "firm"
[machine]
kind = "orchard_robot"
[driver]
speed_m_s = 0.4
steering_bandwidth_1_m = 3.0
preview_s = 0.2
path = [ { stop_s = 1.0 }, { straight_m = 1.0 }, { spin_deg = 30.0 } ]
[orchard]
trees = [ { east_m = 1.0, north_m = 0.5, radius_m = 0.05 }, { east_m = 0.4, north_m = -0.6, radius_m = 0.05 } ]
[magnetics]
magnets = [ { east_m = 0.5, north_m = 0.3, height_m = 0.02, moment_a_m2 = [0.0, 0.0, 1.0] } ]
iron = [ { east_m = 0.5, north_m = -0.3, height_m = 0.1, radius_m = 0.05 } ]
[sensors.lidar]
preset = "lidar_lds01"
mount = "lidar"
near_noise_m = 0.0
near_bias_m = 0.0
far_noise_ratio = 0.0
far_bias_ratio = 0.0
[[signs]]
east_m = 2.2
north_m = 0.0
heading_deg = 180.0
[sensors.camera]
preset = "camera_pi_v2"
mount = "camera"
[sensors.compass]
preset = "mag_qmc5883l"
mount = "magnetometer"
"""
TRUNKS = np.array([[1.0, 0.5], [0.4, -0.6]])


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Path]:
    """The run, and the file that it was written to."""
    folder: Path = tmp_path_factory.mktemp("robot")
    (folder / "robot.toml").write_text(SCENARIO, encoding="utf-8")
    recording = execute(load(folder / "robot.toml"))
    write_rrd(recording, scene_of(recording), {}, folder / "run.rrd")
    return recording, folder / "run.rrd"


def test_trees_magnets_and_iron_are_drawn_where_they_are(drawn: tuple[Recording, Path]) -> None:
    recording, path = drawn
    assert {entities.TRUNKS, entities.CROWNS, entities.MAGNETS, entities.IRON} <= entities_of(path)
    scene = scene_of(recording)
    np.testing.assert_allclose(scene.trunks[:, :3], [[1.0, 0.5, 0.05], [0.4, -0.6, 0.05]])
    np.testing.assert_allclose(scene.magnets, [[0.5, 0.3, 0.02, 0.01]])
    np.testing.assert_allclose(scene.iron, [[0.5, -0.3, 0.1, 0.05]])
    # Nothing of a tree hovers: trunks begin below the ground.
    assert np.all(scene.trunks[:, 3] < 0.0)


def test_points_of_a_perfect_scan_lie_on_the_bark_also_while_driving_and_turning(drawn: tuple[Recording, Path]) -> None:
    recording, path = drawn
    lidar = recording.measurements("lidar")
    t_ns, rows = series(path, entities.scan("lidar"), "Points3D:positions")
    np.testing.assert_array_equal(t_ns, lidar.t_ns)
    counts = np.isfinite(lidar.values[:, 0]).sum(axis=1)
    assert [len(row) for row in rows.to_pylist()] == counts.tolist()
    assert counts.min() > 0
    points = np.array([point for row in rows.to_pylist() for point in row])
    gap = np.linalg.norm(points[:, np.newaxis, :2] - TRUNKS, axis=2).min(axis=1)
    # Whole millimetres; within a turn of 0.2 s at up to 0.5 m/s^2 the way differs by 1/8 a t^2 = 2.5 mm from a straight
    # line in time, and half as much again where the robot begins to turn.
    assert np.abs(gap - 0.05).max() < 0.006
    assert points[:, 2] == pytest.approx(0.033 + 2.3 * 0.042, abs=2e-3)


def test_plots_hold_field_strength_wheel_speeds_and_beams(drawn: tuple[Recording, Path]) -> None:
    recording, path = drawn
    t_ns, strength = scalars(path, entities.plot("field_strength", "compass"))
    compass = recording.measurements("compass")
    at = np.searchsorted(compass.t_ns, t_ns)
    np.testing.assert_allclose(strength, np.linalg.norm(compass.values[at, 0], axis=1))
    _, share = scalars(path, entities.plot("returns", "lidar"))
    lidar = recording.measurements("lidar").values[:, 0]
    np.testing.assert_allclose(share, 100.0 * np.isfinite(lidar).mean(axis=1))
    t_ns, left = scalars(path, entities.plot("wheel_speed", "left"))
    _, wanted = scalars(path, entities.plot("wheel_speed", "left_wanted"))
    steady = (t_ns > 2.2e9) & (t_ns < 2.8e9)
    assert left[steady] == pytest.approx(0.4 / 0.033, rel=0.02)
    assert wanted[steady] == pytest.approx(0.4 / 0.033, rel=0.02)


def test_a_sign_is_drawn_where_it_stands_with_its_word_upright(drawn: tuple[Recording, Path]) -> None:
    recording, path = drawn
    assert {entities.PLATES, entities.POSTS} <= entities_of(path)
    scene = scene_of(recording)
    np.testing.assert_allclose(scene.signs, [[2.2, 0.0, 0.25, np.pi, 0.15, -0.2]])
    for chunk in RrdReader(path).stream().filter(content=f"/{entities.PLATES}"):
        batch = chunk.to_record_batch()
        corners = np.array(batch["Mesh3D:vertex_positions"].to_pylist()[0])
        places = np.array(batch["Mesh3D:vertex_texcoords"].to_pylist()[0])
    # Read by who looks east: the top of the picture is up, its left is north.
    assert np.corrcoef(corners[:, 2], places[:, 1])[0, 1] == pytest.approx(-1.0)
    assert np.corrcoef(corners[:, 1], places[:, 0])[0, 1] == pytest.approx(-1.0)


def test_pictures_and_boxes_are_those_of_the_run(drawn: tuple[Recording, Path]) -> None:
    recording, path = drawn
    pictures, camera = recording.pictures["camera"], recording.measurements("camera")
    t_ns, blobs = series(path, entities.picture("camera"), "EncodedImage:blob")
    np.testing.assert_array_equal(t_ns, pictures.t_ns)
    assert bytes(blobs.to_pylist()[3][0]) == pictures.jpeg[3]
    t_ns, centres = series(path, entities.sign_box("camera"), "Boxes2D:centers")
    np.testing.assert_array_equal(t_ns, camera.t_ns)
    seen = camera.column("sign_seen")[:, 0]
    assert [len(row) for row in centres.to_pylist()] == seen.tolist()
    # On the way it is seen; at the end the robot has turned away by 30 degrees of the 31 there are.
    assert seen.sum() > 5
    first = int(np.flatnonzero(seen)[0])
    left, top, width, height = camera.values[first, 0, 3:]
    np.testing.assert_allclose(centres.to_pylist()[first][0], [left + width / 2.0, top + height / 2.0])


def test_the_layout_has_a_view_of_the_pictures(drawn: tuple[Recording, Path]) -> None:
    _, path = drawn
    (view,) = [view for view in stored_views(path) if view.kind == "2D"]
    assert view.origin == f"/{entities.picture('camera')}"
    assert {f"/{entities.picture('camera')}", f"/{entities.sign_box('camera')}"} <= set(
        shown_entities(view, [f"/{entity}" for entity in entities_of(path)])
    )
    assert not empty_views(path)
