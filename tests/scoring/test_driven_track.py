"""Distance from the driven track, where geometry says what it is."""

import math

import numpy as np
import pytest

from tests.scoring.lines import driven, guided, part
from twin.recording import Stream
from twin.scoring.driven_track import DrivenTrack


def _track(truth: Stream) -> DrivenTrack:
    track = DrivenTrack()
    track.add(truth)
    return track


def _shifted(truth: Stream, ahead_m: float, left_m: float) -> np.ndarray:
    """Points (T, 1, 2) beside the true ones, in the machine's axes."""
    heading = truth.column("heading_rad")
    east = truth.column("position_e_m") + ahead_m * np.cos(heading) - left_m * np.sin(heading)
    north = truth.column("position_n_m") + ahead_m * np.sin(heading) + left_m * np.cos(heading)
    return np.stack([east, north], axis=-1)


@pytest.mark.parametrize("left_m", [-3.0, -0.02, 0.0, 1.5])
@pytest.mark.parametrize("ahead_m", [-6.0, 0.0, 4.0])
def test_on_a_straight_the_distance_is_what_lies_across(left_m: float, ahead_m: float) -> None:
    truth = driven(guided([{"straight_m": 80.0}]))
    offset, course = _track(truth).offsets(truth.t_ns, _shifted(truth, ahead_m, left_m))
    np.testing.assert_allclose(offset, left_m, atol=1e-9)
    np.testing.assert_allclose(course, 0.0, atol=1e-9)


def test_sparse_poses_are_joined_and_not_taken_for_the_track() -> None:
    """At 1 Hz and 2 m/s the nearest pose is up to 1 m away from a point that lies on the track."""
    truth = driven(guided([{"straight_m": 80.0}]), rate_hz=1.0)
    offset, _ = _track(truth).offsets(truth.t_ns, _shifted(truth, 1.0, 0.05))
    np.testing.assert_allclose(offset, 0.05, atol=1e-9)


@pytest.mark.parametrize(("turn_deg", "side"), [(350.0, 1.0), (-350.0, -1.0)])
@pytest.mark.parametrize("inwards_m", [-6.0, -1.0, 0.5, 2.5])
def test_on_an_arc_the_distance_is_along_the_radius(turn_deg: float, side: float, inwards_m: float) -> None:
    radius = 5.0
    truth = driven(guided([{"turn_deg": turn_deg, "radius_m": radius}]))
    # The point lies behind the machine by 30 degrees of the arc: a receiver that lags in the curve.
    turned = side * (np.arange(len(truth)) / (len(truth)) * math.radians(350.0) - math.radians(30.0))
    away = radius - inwards_m
    points = np.column_stack([away * np.sin(turned) * side, side * (radius - away * np.cos(turned))])
    kept = np.arange(len(truth)) * 350.0 / len(truth) > 35.0
    offset, course = _track(truth).offsets(truth.t_ns, points[:, np.newaxis])
    # chords of 0.04 m leave the arc by 0.04^2 / 8 / 5 m, and their courses its own by half of 0.04 / 5
    np.testing.assert_allclose(offset[kept, 0], side * inwards_m, atol=5e-5)
    np.testing.assert_allclose(np.sin(course[kept, 0] - turned[kept]), 0.0, atol=0.0081)


def test_a_pass_beside_is_not_taken_for_the_one_that_is_driven() -> None:
    """Passes 3 m apart: an estimate 2 m towards the next pass is nearer to that one, but was not driven there."""
    truth = driven(guided())
    # (the chord to the first point of the turn cuts its corner)
    first = np.flatnonzero(truth.column("segment")[:, 0] == 0)[:-5]
    offset, _ = _track(truth).offsets(truth.t_ns, _shifted(truth, 0.0, 2.0))
    np.testing.assert_allclose(offset[first], 2.0, atol=1e-9)


def test_a_track_may_cross_itself() -> None:
    path = [{"straight_m": 40.0}, {"turn_deg": 270.0, "radius_m": 8.0}, {"straight_m": 40.0}]
    truth = driven(guided(path))
    # Where it comes back across the first straight (the last leg runs south, 8 m before the straight's end) ...
    north = truth.column("position_n_m")[:, 0]
    at = (truth.column("segment")[:, 0] == 2) & (np.abs(north) < 0.5)
    assert at.sum() > 10
    offset, course = _track(truth).offsets(truth.t_ns, _shifted(truth, 0.0, 0.3))
    np.testing.assert_allclose(offset[at], 0.3, atol=1e-9)
    np.testing.assert_allclose(course[at], -math.pi / 2.0, atol=1e-9)


def test_who_stands_is_judged_by_the_way_it_came_or_else_goes() -> None:
    path = [{"stop_s": 40.0}, {"straight_m": 20.0}, {"stop_s": 40.0}, {"straight_m": 5.0}]
    truth = driven(guided(path))
    offset, _ = _track(truth).offsets(truth.t_ns, _shifted(truth, 1.0, 0.5))
    np.testing.assert_allclose(offset, 0.5, atol=1e-9)


def test_a_machine_that_never_moves_is_judged_by_its_heading() -> None:
    truth = driven(guided([{"stop_s": 40.0}]))
    offset, course = _track(truth).offsets(truth.t_ns, _shifted(truth, 1.0, 0.5))
    np.testing.assert_allclose(offset, 0.5, atol=1e-12)
    np.testing.assert_allclose(course, 0.0)


def test_an_unknown_point_has_no_distance_and_harms_no_other() -> None:
    truth = driven(guided([{"straight_m": 20.0}]))
    points = np.repeat(_shifted(truth, 0.0, 0.4), 2, axis=1)
    points[100, 0] = math.nan
    offset, _ = _track(truth).offsets(truth.t_ns, points)
    assert np.flatnonzero(np.isnan(offset[:, 0])).tolist() == [100]
    np.testing.assert_allclose(offset[:, 1], 0.4, atol=1e-9)


def test_what_is_covered_does_not_change_when_more_of_the_track_is_known() -> None:
    truth = driven(guided())
    rng = np.random.default_rng(1)
    points = _shifted(truth, 0.0, 0.0) + rng.normal(0.0, 2.0, (len(truth), 3, 2))
    whole = _track(truth).offsets(truth.t_ns, points)[0]
    track = DrivenTrack()
    for until_s in (20.0, 50.0, 71.3):
        track.add(part(truth, 0, round(until_s * 1e9)))
        count = track.covers(truth.t_ns)
        assert count == max(0, round((until_s - 30.0) * 50.0))
        np.testing.assert_array_equal(track.offsets(truth.t_ns[:count], points[:count])[0], whole[:count])


def test_a_swaying_track_does_not_hold_up_the_search() -> None:
    """A slow machine that sways by 5 mm within 0.2 m has a course that swings by 9 degrees.

    A point 6 m beside and 2 m ahead, which is 18 degrees, is 6 m from it, and not the 6.3 m of the place where it was.
    """
    truth = driven(guided([{"straight_m": 40.0}]), speed_m_s=0.25)
    values = truth.values.copy()
    values[:, 0, 1] += 0.005 * np.sin(2.0 * math.pi * values[:, 0, 0] / 0.2)
    swaying = Stream(columns=truth.columns, t_ns=truth.t_ns, values=values)
    points = _shifted(truth, 2.0, 6.0)
    offset, _ = _track(swaying).offsets(truth.t_ns, points)
    np.testing.assert_allclose(offset, 6.0, atol=0.006)
