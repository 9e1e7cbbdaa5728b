"""Windows by time and by place: open exactly there, and told when they open and close."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, circle, constant, drive, sensor
from tests.sensors.test_gnss import PERFECT
from twin.sensors.windows import distance_m

JUMP = {"kind": "jump", "columns": ["position_u_m"], "size": 1.0}
SPEED = 1.5


def shifted(window: dict[str, Any], motion: Any = None, duration_s: float = 6.0) -> tuple[np.ndarray, list[Any]]:
    """Times at which the jump acts, and the events."""
    log = drive(sensor(PERFECT | {"faults": [JUMP | window]}), motion or constant(SPEED), duration_s)
    hit = log.values("position_u_m")[:, 0] > 0.5
    return np.round(log.t_s[hit], 9), [(e.t_ns, e.text) for sample in log.samples for e in sample.events]


def test_a_box_acts_while_the_mount_is_in_it() -> None:
    # East = 1.5 t, so the box is entered after 1.96 s and left after 3.96 s.
    times, events = shifted({"inside": {"east_m": [2.95, 5.95], "north_m": [-1.0, 1.0]}})
    assert times.tolist() == [round(2.0 + k / 10, 9) for k in range(20)]
    assert events == [(2_000_000_000, "fault jump begins"), (4_000_000_000, "fault jump ends")]


def test_a_box_beside_the_track_does_nothing() -> None:
    times, events = shifted({"inside": {"east_m": [2.95, 5.95], "north_m": [1.0, 2.0]}})
    assert times.size == 0
    assert events == []


def test_time_and_place_must_both_hold_and_a_place_may_be_entered_again() -> None:
    # A circle of 10 m about (0, 10) in 31.4 s: east > 5 between angles of 30 and 150 degrees, every turn again.
    times, events = shifted({"inside": {"east_m": [5.0, 99.0]}, "from_s": 20.0}, circle(2.0, 10.0), 60.0)
    turn = 2.0 * math.pi / 0.2
    first, last = turn + math.radians(30.0) / 0.2, turn + math.radians(150.0) / 0.2
    assert times.min() == pytest.approx(first, abs=0.1)
    assert times.max() == pytest.approx(last, abs=0.1)
    assert len(events) == 2
    _, events = shifted({"inside": {"east_m": [5.0, 99.0]}}, circle(2.0, 10.0), 60.0)
    assert [text for _, text in events] == ["fault jump begins", "fault jump ends"] * 2


def test_near_a_line_means_its_distance_not_that_of_its_points() -> None:
    # Driving along the x axis past a tree line that begins at east 4 and runs 3 m beside the track.
    times, _ = shifted({"near": {"line": [[4.0, 3.0], [50.0, 3.0]], "within_m": 5.0}})
    # Within 5 m of the first tree from east 4 - sqrt(25 - 9) = 0 on; then all the way.
    assert len(times) == 60
    times, _ = shifted({"near": {"line": [[4.0, 3.0]], "within_m": 3.5}})
    half = math.sqrt(3.5**2 - 9.0)
    assert times.min() == pytest.approx((4.0 - half) / SPEED, abs=0.1)
    assert times.max() == pytest.approx((4.0 + half) / SPEED, abs=0.1)


def test_distance_to_a_broken_line() -> None:
    line = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)]
    assert distance_m(line, 5.0, 2.0) == pytest.approx(2.0)
    assert distance_m(line, 13.0, 5.0) == pytest.approx(3.0)
    assert distance_m(line, -3.0, -4.0) == pytest.approx(5.0)
    assert distance_m([(1.0, 1.0), (1.0, 1.0)], 4.0, 5.0) == pytest.approx(5.0)


def test_a_drift_counts_from_where_the_place_begins() -> None:
    fault = {"kind": "drift", "columns": ["position_u_m"], "rate_per_s": 1.0, "inside": {"east_m": [2.95, 99.0]}}
    log = drive(sensor(PERFECT | {"faults": [fault]}), constant(SPEED), 4.0)
    np.testing.assert_allclose(log.values("position_u_m")[:, 0], np.maximum(0.0, log.t_s - 2.0), atol=1e-9)


@pytest.mark.parametrize(
    ("window", "message"),
    [
        ({"inside": {}}, "needs east_m"),
        ({"inside": {"east_m": [3.0, 1.0]}}, "the first number must be the smaller one"),
        ({"near": {"line": [], "within_m": 1.0}}, "at least 1 item"),
        ({"near": {"line": [[0.0, 0.0]], "within_m": 0.0}}, "greater than 0"),
    ],
)
def test_impossible_places_are_refused(window: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        CONFIGS.validate_python(PERFECT | {"mount": "m", "faults": [JUMP | window]})
