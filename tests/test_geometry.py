"""Frames, rotations and paths."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from twin import geometry
from twin.geometry import Path

angles = st.floats(-50.0, 50.0)


@given(angles)
def test_wrapped_angles_lie_in_the_half_open_circle_and_mean_the_same(angle: float) -> None:
    wrapped = float(geometry.wrap_angle(angle))
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)
    assert geometry.wrap_angle_scalar(angle) == wrapped


def test_wrapping_keeps_pi_and_turns_minus_pi_into_pi() -> None:
    assert geometry.wrap_angle([math.pi, -math.pi]).tolist() == [math.pi, math.pi]


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_rotations_agree_with_scipy(roll: float, pitch: float, yaw: float) -> None:
    oracle = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    np.testing.assert_allclose(geometry.rotation_from_rpy(roll, pitch, yaw), oracle.as_matrix(), atol=1e-12)
    quaternion = geometry.quaternion_from_rpy(roll, pitch, yaw)
    np.testing.assert_allclose(geometry.rotation_from_quaternion(quaternion), oracle.as_matrix(), atol=1e-12)
    back = geometry.rpy_from_rotation(oracle.as_matrix())
    np.testing.assert_allclose(back, (roll, pitch, yaw), atol=1e-7)


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), angles)
def test_level_vectors_turn_as_rotations_do(forward: float, left: float, heading: float) -> None:
    east, north = geometry.turned(forward, left, heading)
    oracle = geometry.rotation_from_rpy(0.0, 0.0, heading) @ (forward, left, 0.0)
    np.testing.assert_allclose((east, north), oracle[:2], atol=1e-12)
    by_heading = np.subtract(
        geometry.turned(forward, left, heading + 1e-6), geometry.turned(forward, left, heading - 1e-6)
    )
    np.testing.assert_allclose(by_heading / 2e-6, (-north, east), atol=1e-6)


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.3, -0.2, 0.5), (0.0, 3.0, -1.0)])
def test_rotation_about_an_axis_agrees_with_scipy(vector: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(geometry.rotation_about(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)


def test_positive_pitch_puts_the_nose_down() -> None:
    nose = geometry.rotation_from_rpy(0.0, 0.1, 0.0) @ [1.0, 0.0, 0.0]
    assert nose[2] == pytest.approx(-math.sin(0.1))


@pytest.fixture
def route() -> Path:
    """30 m east, a half circle to the right of radius 10 m, 20 m west, a quarter to the left."""
    pieces = [(30.0, 0.0), (10.0 * math.pi, -0.1), (20.0, 0.0), (5.0 * math.pi, 0.1)]
    return Path(east_m=0.0, north_m=0.0, heading_rad=0.0, pieces=pieces)


def test_a_path_goes_where_its_pieces_lead(route: Path) -> None:
    top = route.pose(30.0 + 5.0 * math.pi)
    assert (top.east_m, top.north_m) == pytest.approx((40.0, -10.0))
    assert top.heading_rad == pytest.approx(-math.pi / 2)
    back = route.pose(30.0 + 10.0 * math.pi + 20.0)
    assert (back.east_m, back.north_m) == pytest.approx((10.0, -20.0))
    end = route.pose(route.length_m)
    assert (end.east_m, end.north_m) == pytest.approx((0.0, -30.0))
    assert end.heading_rad == pytest.approx(-math.pi / 2)


@given(st.floats(0.0, 97.0), st.floats(-3.0, 3.0))
def test_projecting_a_point_beside_the_path_gives_back_station_and_offset(station: float, offset: float) -> None:
    pieces = [(30.0, 0.0), (10.0 * math.pi, -0.1), (20.0, 0.0), (5.0 * math.pi, 0.1)]
    route = Path(east_m=3.0, north_m=-2.0, heading_rad=0.7, pieces=pieces)
    at = route.pose(station)
    east = at.east_m - offset * math.sin(at.heading_rad)
    north = at.north_m + offset * math.cos(at.heading_rad)
    found_station, found_offset = route.project(east, north, near_m=station, window_m=5.0)
    assert found_station == pytest.approx(station, abs=1e-6)
    assert found_offset == pytest.approx(offset, abs=1e-6)


def test_offset_is_measured_to_the_path_not_to_its_samples(route: Path) -> None:
    assert route.project(17.0 + 1e-4, 0.5)[1] == pytest.approx(0.5, abs=1e-12)


def test_mean_curvature_ahead_is_the_heading_change_by_distance(route: Path) -> None:
    assert route.curvature_ahead(29.0, 2.0) == pytest.approx(-0.05)
    assert route.curvature_ahead(0.0, route.length_m) == pytest.approx((-math.pi + math.pi / 2) / route.length_m)


def test_beyond_its_end_a_path_goes_on_straight(route: Path) -> None:
    beyond = route.pose(route.length_m + 5.0)
    assert (beyond.east_m, beyond.north_m) == pytest.approx((0.0, -35.0))
    before = route.pose(-5.0)
    assert (before.east_m, before.north_m) == pytest.approx((-5.0, 0.0))


def test_polyline_points_lie_on_the_path(route: Path) -> None:
    points = route.polyline(0.5)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= 0.5 + 1e-9
    offsets = [route.project(east, north)[1] for east, north in points]
    assert np.abs(offsets).max() < 1e-9


def test_a_path_may_turn_back_on_itself_at_a_corner() -> None:
    path = Path(east_m=0.0, north_m=0.0, heading_rad=0.0, pieces=[(2.0, 0.0), (0.0, math.pi), (2.0, 0.0)])
    assert path.length_m == 4.0
    assert path.pose(4.0).east_m == pytest.approx(0.0, abs=1e-12)
    # A little short of the corner: on the way there the station is 1.9 m, on the way back (from 2 m on) 2.1 m.
    assert path.project(1.9, 0.1)[0] == pytest.approx(1.9)
    station, offset = path.project(1.9, 0.1, near_m=2.0, from_m=2.0)
    assert station == pytest.approx(2.1)
    assert offset == pytest.approx(-0.1)
