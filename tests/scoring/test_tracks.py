"""Smoothness of tracks and jumps at changes of quality, by hand and in pieces."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from twin.scoring.tracks import SmoothnessTally, Track
from twin.scoring.transitions import TransitionTally
from twin.signals import NS_PER_S, FloatArray


def track(t_s: FloatArray, east: FloatArray, north: FloatArray, speed: float = math.nan, course: float = 0.0) -> Track:
    return Track(
        t_ns=np.round(t_s * NS_PER_S).astype(np.int64),
        east_m=east,
        north_m=north,
        speed_m_s=np.full(len(t_s), speed),
        course_rad=np.full(len(t_s), course),
    )


def smoothness(whole: Track, size: int, gap_s: float = 2.5) -> dict[str, float]:
    tally = SmoothnessTally(gap_s)
    for begin in range(0, len(whole), size):
        tally.add(whole.rows(slice(begin, begin + size)))
    return tally.figures()


def test_a_known_acceleration_and_jerk() -> None:
    # Differences are exact for a cubic: e = t^3 / 6 has the jerk 1; a parabola north, 2 t^2, the acceleration 4.
    t = np.arange(0.0, 10.0, 0.5)
    cubic = smoothness(track(t, t**3 / 6.0, 0.0 * t), 4)
    assert cubic["smoothness.rms_jerk_m_s3"] == pytest.approx(1.0, rel=1e-9)
    parabola = smoothness(track(t, 0.0 * t, 2.0 * t**2), 4)
    assert parabola["smoothness.rms_acceleration_m_s2"] == pytest.approx(4.0, rel=1e-9)
    assert parabola["smoothness.rms_jerk_m_s3"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("size", [1, 2, 3, 5, 100])
def test_pieces_give_what_the_whole_gives(size: int) -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.5, 1.5, 60))
    t[30:] += 20.0  # a gap
    east, north = rng.standard_normal((2, 60))
    east[[10, 44]] = math.nan
    whole = track(t, east, north, speed=0.3)
    assert smoothness(whole, size) == pytest.approx(smoothness(whole, 60), rel=1e-9)


def test_the_step_beyond_motion_is_the_jump_of_a_moving_receiver() -> None:
    t = np.arange(20.0)
    east = 2.0 * t
    east[12:] += 0.7
    found = smoothness(track(t, east, 0.0 * t, speed=2.0), 6)
    assert found["smoothness.largest_step_beyond_m"] == pytest.approx(0.7)
    # No step is taken across a gap, and a repeated row is none.
    gap = np.where(t < 12.0, t, t + 30.0)
    assert smoothness(track(gap, east, 0.0 * t, speed=2.0), 6)["smoothness.largest_step_beyond_m"] < 1e-9
    doubled = track(np.repeat(t, 2), np.repeat(east, 2), np.zeros(40), speed=2.0)
    assert smoothness(doubled, 5) == pytest.approx(found, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("size", [1, 3, 12])
def test_transitions_by_hand(size: int) -> None:
    # Fixed for 4 s, float for 5 s, fixed again for 2 s (the last row lasts no time that is known).
    quality = np.array([4.0] * 4 + [5.0] * 5 + [4.0] * 3)
    t = np.arange(12.0)
    north = 1.5 * t
    jumped = north + np.where(quality == 5.0, 0.4, 0.0)
    tracks = {
        "gnss": track(t, 0.0 * t, jumped, speed=1.5, course=math.pi / 2.0),
        "smooth": track(t, 0.0 * t, north, speed=1.5, course=math.pi / 2.0),
        "silent": track(t, 0.0 * t, jumped),  # its speed is that of the step before
    }
    tally = TransitionTally(2.5)
    for begin in range(0, 12, size):
        piece = slice(begin, begin + size)
        tally.add(quality[piece], {name: each.rows(piece) for name, each in tracks.items()})
    figures = tally.receiver_figures()
    assert figures["quality.fixed_s"] == pytest.approx(6.0)
    assert figures["quality.float_s"] == pytest.approx(5.0)
    assert figures["quality.float_percent"] == pytest.approx(100.0 * 5.0 / 11.0)
    assert figures["quality.fixed_to_float_count"] == figures["quality.float_to_fixed_count"] == 1.0
    for name in ("gnss", "silent"):
        assert tally.track_figures(name)["quality.fixed_to_float_max_jump_m"] == pytest.approx(0.4)
        assert tally.track_figures(name)["quality.float_to_fixed_mean_jump_m"] == pytest.approx(0.4)
    assert tally.track_figures("smooth")["quality.float_to_fixed_max_jump_m"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("along", [1.0, 0.0, -1.0])
def test_a_jump_is_the_same_whoever_tells_the_speed(along: float) -> None:
    # Northwards at 1.5 m/s, and by 2.88 m aside, ahead or back where the quality changes.
    t = np.arange(8.0)
    quality = np.where(t < 5.0, 4.0, 5.0)
    size = np.where(t < 5.0, 0.0, 2.88)
    east, north = size * math.sqrt(1.0 - along**2), 1.5 * t + size * along
    told = track(t, east, north, speed=1.5, course=math.pi / 2.0)
    way = np.diff(east, prepend=0.0), np.diff(north, prepend=-1.5)
    derived = replace(told, speed_m_s=np.hypot(*way), course_rad=np.arctan2(way[1], way[0]))
    tally = TransitionTally(2.5)
    tally.add(quality, {"doppler": told, "derived": derived, "silent": track(t, east, north)})
    for name in ("doppler", "derived", "silent"):
        assert tally.track_figures(name)["quality.fixed_to_float_max_jump_m"] == pytest.approx(2.88), name


def test_silence_is_no_quality_and_a_lost_position_no_jump() -> None:
    tally = TransitionTally(2.5)
    quality = np.array([4.0, 4.0, 0.0, 4.0, math.nan])
    t = np.array([0.0, 1.0, 2.0, 10.0, 11.0])
    east = np.array([0.0, 0.0, math.nan, 5.0, 5.0])
    tally.add(quality, {"gnss": track(t, east, 0.0 * t, speed=0.0)})
    figures = tally.receiver_figures()
    assert figures["quality.none_s"] == pytest.approx(2.5)  # and not the 8 s until it spoke again
    assert figures["quality.fixed_s"] == pytest.approx(3.0)
    assert figures["quality.fixed_to_none_count"] == figures["quality.fixed_to_unknown_count"] == 1.0
    assert tally.track_figures("gnss") == pytest.approx(
        {"quality.fixed_to_unknown_mean_jump_m": 0.0, "quality.fixed_to_unknown_max_jump_m": 0.0}
    )
