"""Scene, terrain mesh, thinning, labels, joints, legend corners, text: pieces with closed-form answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from tests.viz.synthetic_run import make_recording, make_scene
from twin.signals import NS_PER_S
from viz import entities
from viz.blueprint import emptiest_corner
from viz.layers.estimates import ellipse_axes
from viz.layers.machine import _seen_from_behind, joint_transform, sets_off_ns
from viz.layers.plots import true_values
from viz.layers.states import segment_labels
from viz.legible import legible
from viz.scene import Scene
from viz.sheet import Curve, Run
from viz.terrain import MAX_TEXELS, Window, grid_lines, terrain_mesh, window_around
from viz.thinning import changes, spaced, steps, thin


def plane_scene(slope_e: float = 0.1, slope_n: float = -0.05, **keys: Any) -> Scene:
    e, n = np.meshgrid(np.arange(201) * 0.5 - 30.0, np.arange(161) * 0.5 - 20.0)
    return Scene(
        urdf=None,
        heights=3.0 + slope_e * e + slope_n * n,
        origin_m=(-30.0, -20.0),
        cell_m=0.5,
        planned_path=np.empty((0, 2)),
        **keys,
    )


PLANTER, CAR = ((-4.6, -2.625), (2.79, 2.625)), ((0.0, -1.2), (2.65, 1.2))
ROBOT = (0.0, -0.0525), (0.11, 0.0525)
FIGURES = [(PLANTER, 1.0, 0.8), (CAR, 1.0, 0.8), (ROBOT, 0.05, 0.033)]
"""Footprint, how far bodywork reaches beyond it, height of the hubs."""


@pytest.mark.parametrize(("footprint", "beyond", "height"), FIGURES, ids=["planter", "car", "robot"])
def test_a_camera_sees_all_of_a_machine_and_little_else(footprint: Any, beyond: float, height: float) -> None:
    # The field's view is about as wide as high and some 55 degrees across: all corners of the bodywork lie within half
    # of that of its middle, and the machine fills at least a third of it.
    run = Run(recording=make_recording(1.0), scene=plane_scene(footprint_m=footprint), result={})
    eye, target = _seen_from_behind(run, np.array([5.0, 3.0, height]), np.array([0.0, 0.0, np.sin(0.5), np.cos(0.5)]))
    look = (target - eye) / np.linalg.norm(target - eye)
    (back, right), (front, left) = footprint
    turn = np.array([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]])
    angles = []
    for x in (back - beyond, front + beyond):
        for y in (right - 0.5 * beyond, left + 0.5 * beyond):
            corner = np.array([*(turn @ (x, y) + (5.0, 3.0)), height]) - eye
            angles.append(np.degrees(np.arccos(corner @ look / np.linalg.norm(corner))))
    assert max(angles) < 27.5
    assert max(angles) > 27.5 / 3.0


def test_between_rows_of_trees_the_camera_sees_robot_and_both_rows() -> None:
    # Turned by 57 degrees; trees 0.8 m apart along the lane, rows 0.4 m to either side.
    turn = np.array([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]])
    local = np.array([(0.8 * k, side * 0.4) for k in range(4) for side in (-1.0, 1.0)])
    trunks = np.column_stack([local @ turn.T + (5.0, 3.0), np.tile((0.04, -0.2, 0.6), (8, 1))])
    run = Run(recording=make_recording(1.0), scene=plane_scene(footprint_m=ROBOT, trunks=trunks), result={})
    place = np.array([5.0, 3.0, 0.033])
    eye, target = _seen_from_behind(run, place, np.array([0.0, 0.0, np.sin(0.5), np.cos(0.5)]))
    look = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(look, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    above = np.cross(right, look)

    def across_and_up(point: np.ndarray) -> tuple[float, float]:
        x, y, z = (point - eye) @ right, (point - eye) @ above, (point - eye) @ look
        return float(np.degrees(np.arctan2(x, z))), float(np.degrees(np.arctan2(y, z)))

    # The view is 55 degrees high and a third wider than high: 34.7 degrees to either side.
    assert all(abs(angle) < 20.0 for angle in across_and_up(place))
    feet = np.column_stack([trunks[2:, :2], np.zeros(6)])
    sides = [across_and_up(foot) for foot in feet]
    assert all(abs(across) < 34.7 and abs(up) < 27.5 for across, up in sides)
    assert [np.sign(across) for across, _ in sides] == [1.0, -1.0] * 3  # right, left
    # The horizon is in the picture, in its upper half.
    assert 0.0 < np.degrees(np.arcsin(-look[2])) < 27.5
    # The robot, 0.11 m, is not lost in it.
    assert np.degrees(0.11 / np.linalg.norm(place - eye)) > 5.0


def test_plots_begin_shortly_before_a_machine_sets_off_that_stood_for_long() -> None:
    t_ns = np.arange(101) * NS_PER_S
    place = np.zeros((101, 3))
    place[71:, 0] = np.arange(1, 31) * 0.5
    # 29 s of drive; a tenth of it before 71 s
    assert sets_off_ns(t_ns, place) == 71 * NS_PER_S - 29 * NS_PER_S // 10
    assert sets_off_ns(t_ns[:101], np.roll(place, -30, axis=0) * (t_ns[:, np.newaxis] < 70 * NS_PER_S)) == 0
    assert sets_off_ns(t_ns, np.zeros((101, 3))) == 0


def test_asphalt_is_grey_and_soil_is_not() -> None:
    colours = {}
    for paved in (True, False):
        scene = plane_scene(paved=paved)
        texture = terrain_mesh(scene, Window(rows=(0, 161), columns=(0, 201))).texture.astype(float)
        colours[paved] = texture.reshape(-1, 3).mean(axis=0)
    assert np.ptp(colours[True]) < 10.0
    assert np.ptp(colours[False]) > 30.0


def test_height_is_bilinear_exact_on_a_plane_and_held_at_the_edge() -> None:
    scene = plane_scene()
    e, n = np.array([0.0, 12.34, -30.0, 70.0]), np.array([0.0, 3.21, -20.0, 60.0])
    np.testing.assert_allclose(scene.height_at(e, n), 3.0 + 0.1 * e - 0.05 * n, atol=1e-12)
    np.testing.assert_allclose(scene.height_at(np.array([1e3]), np.array([0.0])), 3.0 + 0.1 * 70.0)
    assert np.isnan(scene.height_at(np.array([np.nan]), np.array([0.0]))).all()


def test_scene_refuses_what_is_no_ground() -> None:
    with pytest.raises(ValueError, match="heights"):
        Scene(urdf=None, heights=np.zeros(5), origin_m=(0, 0), cell_m=1.0, planned_path=np.empty((0, 2)))
    with pytest.raises(ValueError, match="cell_m"):
        Scene(urdf=None, heights=np.zeros((5, 5)), origin_m=(0, 0), cell_m=0.0, planned_path=np.empty((0, 2)))


@pytest.mark.parametrize("budget", [500, 40_000])
def test_terrain_mesh_lies_on_the_ground_and_faces_up(budget: int) -> None:
    scene = plane_scene()
    mesh = terrain_mesh(scene, Window(rows=(10, 150), columns=(20, 180)), max_vertices=budget)
    assert len(mesh.vertices) <= budget
    e, n, u = mesh.vertices.astype(float).T
    np.testing.assert_allclose(u, 3.0 + 0.1 * e - 0.05 * n, atol=1e-4)
    normal = np.array([-0.1, 0.05, 1.0]) / np.linalg.norm([-0.1, 0.05, 1.0])
    np.testing.assert_allclose(mesh.normals, np.tile(normal, (len(mesh.normals), 1)), atol=1e-3)
    corner = mesh.vertices[mesh.triangles].astype(float)
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (area[:, 2] > 0).all()
    # the triangles cover the window once: 159 x 139 cells of 0.5 m
    assert area[:, 2].sum() / 2 == pytest.approx(159 * 139 * 0.25, rel=1e-6)
    assert mesh.texture.shape[0] * mesh.texture.shape[1] <= MAX_TEXELS
    assert mesh.texture.std() > 3.0


def test_soil_pattern_is_fixed_to_the_ground() -> None:
    """Seen through another window, the same place has the same pattern, or motion would be drawn wrongly."""
    scene = plane_scene(0.0, 0.0)
    first = terrain_mesh(scene, Window(rows=(0, 100), columns=(0, 100))).texture
    second = terrain_mesh(scene, Window(rows=(0, 100), columns=(10, 110))).texture
    fine = first.shape[1] // 100
    np.testing.assert_array_equal(first[:, 10 * fine :], second[:, : -10 * fine])


def test_window_holds_points_and_margin_and_stays_inside() -> None:
    scene = plane_scene()
    window = window_around(scene, np.array([[0.0, 0.0], [10.0, 5.0], [np.nan, 0.0]]), margin_m=4.0)
    # east -4 to 14 is columns 52 to 88, north -4 to 9 is rows 32 to 58; half-open
    assert window == Window(rows=(32, 59), columns=(52, 89))
    far = window_around(scene, np.array([[1e4, 1e4]]))
    assert far.rows[1] <= 161
    assert far.columns[1] <= 201
    assert far.rows[1] - far.rows[0] >= 2


def test_grid_lines_are_ten_metres_apart() -> None:
    scene = plane_scene()
    lines = grid_lines(scene, Window(rows=(0, 161), columns=(0, 201)))
    # east -30 to 70 has 11 tens, north -20 to 60 has 9
    assert len(lines) == 20
    assert sorted({float(line[0, 0]) for line in lines[:11]}) == [10.0 * k for k in range(-3, 8)]


def test_thinning_keeps_both_ends_and_the_rate() -> None:
    t_ns = np.arange(1000) * 2_000_000
    keep = thin(t_ns, 50.0)
    assert keep.tolist() == [*range(0, 1000, 10), 999]
    assert thin(t_ns, 500.0).tolist() == list(range(1000))
    assert thin(t_ns[:1], 50.0).tolist() == [0]
    assert thin(t_ns[:0], 50.0).tolist() == []


def test_changes_and_steps() -> None:
    assert changes(np.array([4.0, 4.0, 5.0, np.nan, np.nan, 5.0])).tolist() == [0, 2, 3, 5]
    assert steps(np.array([[0.0], [1e-6], [2e-6], [0.01], [0.01], [0.01]]), 1e-4).tolist() == [0, 3, 5]
    assert steps(np.array([[1.0]]), 1e-4).tolist() == [0]


def test_spaced_points_ignore_standstill_and_nan() -> None:
    points = np.array([[0, 0], [0.1, 0], [0.1, 0], [0.5, 0], [np.nan, 0], [0.9, 0], [1.0, 0]], dtype=float)
    assert spaced(points, 0.4).tolist() == [0, 3, 5]


def test_ellipse_axes_are_eigenvalues() -> None:
    matrix = np.array([[0.5, 0.2], [0.2, 0.1]])
    values, vectors = np.linalg.eigh(matrix)
    long, short, angle = ellipse_axes(*(np.array([v]) for v in (0.5, 0.2, 0.1)))
    np.testing.assert_allclose([short[0] ** 2, long[0] ** 2], values)
    assert abs(vectors[:, 1] @ [np.cos(angle[0]), np.sin(angle[0])]) == pytest.approx(1.0)


@pytest.mark.parametrize(("kind", "rpy"), [("continuous", "0.3 -0.2 1.1"), ("prismatic", "0.3 -0.2 1.1")])
def test_joint_transforms_are_the_sdk_s(tmp_path: Path, kind: str, rpy: str) -> None:
    limit = '<limit lower="-3" upper="3" effort="1" velocity="1"/>' if kind == "prismatic" else ""
    urdf = tmp_path / "joint.urdf"
    urdf.write_text(
        f'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="{kind}"><parent link="a"/>'
        f'<child link="b"/><origin xyz="1 2 3" rpy="{rpy}"/><axis xyz="0 0.6 0.8"/>{limit}</joint></robot>'
    )
    joint = rr.urdf.UrdfTree.from_file_path(urdf).get_joint_by_name("j")
    assert joint is not None
    value = np.array([-2.0, 0.0, 0.4, 2.9])
    translation, quaternion = joint_transform(joint, value)
    for index, angle in enumerate(value):
        expected = joint.compute_transform(angle, clamp=False)
        assert expected.translation is not None
        assert expected.quaternion is not None
        np.testing.assert_allclose(translation[index], expected.translation.as_arrow_array().flatten(), atol=1e-6)
        theirs = expected.quaternion.as_arrow_array().flatten().to_numpy()
        assert abs(theirs @ quaternion[index]) == pytest.approx(1.0, abs=1e-6)


def test_segments_are_named_by_the_scene_then_by_the_driver_then_by_number(tmp_path: Path) -> None:
    recording = make_recording(30.0)
    run = Run(recording=recording, scene=make_scene(tmp_path), result={})
    segment = recording.truth.column("segment")[:, 0]
    t_ns = recording.truth.t_ns
    assert list(segment_labels(run, t_ns, segment).values())[:2] == ["stand 5 s", "straight 15 m"]
    recording.events.clear()
    assert list(segment_labels(run, t_ns, segment).values())[:2] == ["segment 0", "segment 1"]


def test_truth_between_rows_is_interpolated_the_short_way_round(tmp_path: Path) -> None:
    recording = make_recording(6.0)
    heading = recording.truth.columns.index("heading_rad")
    recording.truth.values[:, 0, heading] = np.where(recording.truth.t_ns >= NS_PER_S, -3.1, 3.1)
    run = Run(recording=recording, scene=make_scene(tmp_path), result={})
    between = true_values(run, "heading_rad", np.array([990_000_000]))
    assert between is not None
    # half way from 3.1 to -3.1 + 2 pi
    assert between[0] == pytest.approx(np.pi, abs=1e-9)


def corner_of(*lines: np.ndarray) -> rrb.Corner2D:
    t_ns = np.arange(100) * NS_PER_S
    curves = [Curve(name=str(index), t_ns=t_ns, values=values) for index, values in enumerate(lines)]
    return emptiest_corner(curves, 99 * NS_PER_S)[0]


def test_the_legend_goes_where_the_curves_are_not() -> None:
    rising = np.linspace(0.0, 1.0, 100)
    assert corner_of(rising) in {rrb.Corner2D.LeftTop, rrb.Corner2D.RightBottom}
    assert corner_of(rising[::-1]) in {rrb.Corner2D.RightTop, rrb.Corner2D.LeftBottom}
    # a long standstill at zero in the middle, then a wild end: only the left corners are free
    wild = np.where(rising < 0.6, 0.0, np.sin(60 * rising))
    assert corner_of(wild) in {rrb.Corner2D.LeftTop, rrb.Corner2D.LeftBottom}
    # standing at zero, then going: the four entries fit above the zero line
    assert corner_of(*(k * np.where(rising < 0.5, 0.0, 1.0) for k in (0.7, 0.8, 0.9, 1.0))) == rrb.Corner2D.LeftTop
    assert emptiest_corner([], 0) == (rrb.Corner2D.LeftTop, 0.0)


def test_what_a_legend_hides_is_counted_within_the_time_that_is_shown() -> None:
    t_ns = np.arange(100) * NS_PER_S
    # Stands at zero for 80 s, then fills the plot from top to bottom: no corner is free of what is shown.
    values = np.where(t_ns < 80 * NS_PER_S, 0.0, (-1.0) ** np.arange(100))
    dense = Curve(name="a", t_ns=np.repeat(t_ns, 50), values=(values[:, np.newaxis] * np.linspace(0, 1, 50)).ravel())
    _, all_of_it = emptiest_corner([dense], 99 * NS_PER_S)
    _, the_end = emptiest_corner([dense.since(80 * NS_PER_S)], 99 * NS_PER_S, begin_ns=80 * NS_PER_S)
    assert all_of_it == 0.0
    assert the_end > 0.02


def test_text_is_kept_to_what_the_viewer_can_draw() -> None:
    assert legible("Kurve 90° links, ±1σ ≤ 3 m – Übung") == "Kurve 90° links, ±1σ ≤ 3 m – Übung"
    assert legible("ﬁx ① 中 \U0001f69c\t.") == "fix 1 ? ? ."


def test_every_estimator_keeps_its_colour() -> None:
    names = list("abcdefghijk")
    colours = entities.estimator_colours(names)
    assert len({colours[name] for name in names[:10]}) == 10
    assert colours["k"] == colours["a"]
    assert entities.TRUTH_COLOUR not in colours.values()


def cielab(colour: entities.Colour) -> np.ndarray:
    """sRGB (IEC 61966-2-1, white D65) in CIE L*a*b*."""
    share = np.array(colour) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    to_xyz = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    x, y, z = np.cbrt(np.array(to_xyz) @ linear / (0.95047, 1.0, 1.08883))  # none is as dark as 6/29
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def test_ten_colours_are_told_apart_from_one_another_and_from_a_dark_plot() -> None:
    colours = [*entities.estimator_colours(list("abcdefghij")).values(), entities.TRUTH_COLOUR]
    colours.append(entities.MEASURED_COLOUR)
    # A difference of 2.3 is just noticeable (Mahy et al. 1994); ten times that is seen in a thin line.
    for index, first in enumerate(colours):
        for second in colours[index + 1 :]:
            assert np.linalg.norm(cielab(first) - cielab(second)) > 23.0
        # WCAG 2.1, 1.4.11: graphics need a contrast of 3 to 1; against black plots (Y 0.006) that is Y 0.118, L* 41.
        assert cielab(first)[0] > 41.0
