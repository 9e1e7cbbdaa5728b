"""The hand on a bench: strokes within the travel, at hand-like speeds, drawn by the world's seed."""

from __future__ import annotations

import numpy as np
import pytest

from twin.control import ReciprocationConfig, build_driver
from twin.signals import HEIGHT, STROKE, FloatArray, Knowledge, Said

_STEP_S = 0.02


def _moved(seed: int, seconds: float = 600.0, **keys: float) -> tuple[FloatArray, FloatArray]:
    """Heights and speeds of a plate that does at once what is asked of it."""
    driver = build_driver(
        ReciprocationConfig(kind="reciprocation", **keys), start_e_n_heading=(0.0, 0.0, 0.0), wheelbase_m=0.0, seed=seed
    )
    height, heights, speeds = 0.0, [], []
    for step in range(round(seconds / _STEP_S)):
        t_ns = round(step * _STEP_S * 1e9)
        seen = Said(t_ns=t_ns, values={HEIGHT: height + 1.0, STROKE: height})
        speed = driver.command(Knowledge(t_ns=t_ns, implement=seen), _STEP_S).lift_m_s
        heights.append(height)
        speeds.append(speed)
        height += speed * _STEP_S
    return np.array(heights), np.array(speeds)


def test_the_stops_are_avoided_and_most_of_the_travel_is_used() -> None:
    heights, _ = _moved(seed=1)
    assert np.abs(heights).max() < 0.2
    assert heights.max() > 0.14
    assert heights.min() < -0.14


def test_the_speed_reaches_but_hardly_passes_what_the_paper_says() -> None:
    _, speeds = _moved(seed=2)
    # what the hand corrects comes on top: an Euler step of its own profile, a few per cent
    assert 0.35 < np.abs(speeds).max() < 0.42


def test_it_stands_first_and_then_hardly_ever() -> None:
    heights, speeds = _moved(seed=3, stand_s=5.0)
    assert not heights[: round(5.0 / _STEP_S)].any()
    assert np.mean(np.abs(speeds[round(5.0 / _STEP_S) :]) > 0.02) > 0.6


def test_the_seed_decides() -> None:
    assert np.array_equal(_moved(4, 20.0)[0], _moved(4, 20.0)[0])
    assert not np.array_equal(_moved(4, 20.0)[0], _moved(5, 20.0)[0])


def test_turning_points_are_spread_over_the_travel() -> None:
    heights, _ = _moved(seed=6, seconds=2000.0, rest_probability=0.0)
    turns = heights[1:-1][np.diff(np.sign(np.diff(heights))) != 0]
    share = [np.mean((turns >= low) & (turns < low + 0.09)) for low in (-0.18, -0.09, 0.0, 0.09)]
    assert min(share) > 0.1
    assert abs(np.mean(turns)) < 0.02
    with pytest.raises(ValueError, match="reach_m"):
        ReciprocationConfig(kind="reciprocation", reach_m=0.25)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"shortest_m": 0.15, "reach_m": 0.1}, "shortest_m = 0.15 is more than reach_m = 0.1"),
        ({"slowest_m_s": 0.3, "fastest_m_s": 0.2}, "slowest_m_s = 0.3 is more than fastest_m_s = 0.2"),
    ],
)
def test_strokes_that_cannot_be_are_refused(keys: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ReciprocationConfig(kind="reciprocation", **keys)


def test_no_stroke_is_a_blow() -> None:
    _, speeds = _moved(seed=7, rest_probability=0.0, hardest_m_s2=1.0)
    # what the hand corrects and the step of 20 ms add some per cent
    assert 0.8 < np.abs(np.diff(speeds) / _STEP_S)[300:].max() < 1.15
