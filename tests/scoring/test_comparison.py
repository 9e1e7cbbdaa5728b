"""What counts as a difference between two runs."""

import dataclasses
import math

import numpy as np
import pytest

from twin.recording import Recording, Stream
from twin.scoring.comparison import Difference, compare_events, compare_metrics, compare_streams, compare_words
from twin.signals import Event, FloatArray, IntArray

T_NS = np.arange(4, dtype=np.int64) * 10**9


def _stream(columns: tuple[str, ...], values: FloatArray, t_ns: IntArray = T_NS) -> Stream:
    return Stream(columns=columns, t_ns=t_ns, values=values[:, np.newaxis, :])


def _recording(**streams: Stream) -> Recording:
    named = {name.replace("__", "/"): stream for name, stream in streams.items()}
    return Recording(scenario_toml="", scenario_name="made_up", seed=1, runs=(0,), streams=named)


def _estimate(values: FloatArray, columns: tuple[str, ...] = ("speed_m_s", "heading_rad")) -> Recording:
    return _recording(estimates__central=_stream(columns, values))


VALUES = np.column_stack([np.full(4, 2.0), np.zeros(4)])


def _changed(row: int, column: int, value: float) -> Recording:
    values = VALUES.copy()
    values[row, column] = value
    return _estimate(values)


def _found(first: Recording, second: Recording, tolerance: float | None = 1e-3) -> list[tuple[str, str, float]]:
    return [
        (each.name, each.where, each.largest)
        for each in compare_streams(first.streams, second.streams, tolerance=tolerance)
    ]


def test_a_column_differs_beyond_its_relative_tolerance_and_says_when() -> None:
    assert _found(_estimate(VALUES), _changed(2, 0, 2.0 * 1.0009)) == []
    ((name, where, largest),) = _found(_estimate(VALUES), _changed(2, 0, 2.0 * 1.0011))
    assert (name, where) == ("estimates/central", "speed_m_s at 2 s")
    assert largest == pytest.approx(0.0022)


def test_without_a_tolerance_the_last_bit_counts() -> None:
    nearly = _changed(1, 0, float(np.nextafter(2.0, 3.0)))
    assert _found(_estimate(VALUES), nearly, 0.0) == []
    assert len(_found(_estimate(VALUES), nearly, None)) == 1
    assert _found(_estimate(VALUES), _estimate(VALUES.copy()), None) == []


def test_angles_are_compared_the_short_way_round() -> None:
    near_pi, beyond = _changed(3, 1, math.pi - 1e-6), _changed(3, 1, -math.pi + 1e-6)
    assert _found(near_pi, beyond) == []
    ((_, where, largest),) = _found(near_pi, _changed(3, 1, -math.pi + 0.1))
    assert where == "heading_rad at 3 s"
    assert largest == pytest.approx(0.1 + 1e-6)


def test_what_is_unknown_has_to_be_unknown_in_both() -> None:
    gap = _changed(1, 0, math.nan)
    assert _found(gap, gap) == []
    for one, other in ((gap, _estimate(VALUES)), (_estimate(VALUES), gap)):
        assert _found(one, other) == [("estimates/central", "speed_m_s at 1 s", math.inf)]
    never = _changed(1, 0, math.inf)
    assert _found(never, never) == []
    assert _found(never, _estimate(VALUES)) == [("estimates/central", "speed_m_s at 1 s", math.inf)]


def test_every_column_of_an_estimator_and_the_worst_of_other_streams() -> None:
    both = VALUES + np.array([0.5, 0.25])
    assert [where for _, where, _ in _found(_estimate(VALUES), _estimate(both))] == [
        "speed_m_s at 0 s",
        "heading_rad at 0 s",
    ]
    columns = ("a_m", "b_m")
    one, other = (_recording(truth=_stream(columns, values)) for values in (VALUES, VALUES + np.array([0.5, 0.75])))
    assert _found(one, other) == [("truth", "b_m at 0 s", pytest.approx(0.75))]


def test_missing_streams_columns_and_rows_are_differences() -> None:
    nothing = _recording()
    (missing,) = compare_streams(_estimate(VALUES).streams, nothing.streams, tolerance=1.0)
    assert (missing.first, missing.second) == ("there", "missing")
    (column,) = compare_streams(
        _estimate(VALUES).streams, _estimate(VALUES[:, :1], ("speed_m_s",)).streams, tolerance=1.0
    )
    assert (column.where, column.first, column.second) == ("heading_rad", "there", "missing")
    shorter = _recording(estimates__central=_stream(("speed_m_s", "heading_rad"), VALUES[:3], T_NS[:3]))
    (rows,) = compare_streams(_estimate(VALUES).streams, shorter.streams, tolerance=1.0)
    assert (rows.first, rows.second) == ("4 x 1", "3 x 1")
    later = _recording(
        estimates__central=_stream(("speed_m_s", "heading_rad"), VALUES, T_NS + np.array([0, 0, 7, 7], dtype=np.int64))
    )
    (times,) = compare_streams(_estimate(VALUES).streams, later.streams, tolerance=1.0)
    assert (times.where, times.first, times.second) == ("times, row 2", "2000000000", "2000000007")


def test_validity_and_arrival_of_measurements_count() -> None:
    stream = dataclasses.replace(
        _stream(("speed_m_s",), VALUES[:, :1]), t_available_ns=T_NS + 5, valid=np.ones((4, 1), dtype=np.bool_)
    )
    invalid = dataclasses.replace(stream, valid=np.array([[True], [True], [False], [True]]))
    late = dataclasses.replace(stream, t_available_ns=T_NS + np.array([5, 6, 5, 5]))
    base = _recording(measurements__radar=stream)
    assert _found(base, base) == []
    assert [where for _, where, _ in _found(base, _recording(measurements__radar=invalid))] == ["validity, row 2"]
    assert [where for _, where, _ in _found(base, _recording(measurements__radar=late))] == ["arrivals, row 1"]


def test_metrics_follow_the_rule_of_the_baselines() -> None:
    first = {"a": 1.0, "b": 1.0, "gone": 1.0, "unknown": None, "lost": 1.0}
    second = {"a": 1.0009, "b": 1.0011, "new": 2.0, "unknown": None, "lost": None}
    found = {each.name: each for each in compare_metrics(first, second, tolerance=1e-3)}
    assert found.keys() == {"b", "gone", "new", "lost"}
    assert found["b"].largest == pytest.approx(0.0011)
    assert (found["gone"].second, found["new"].first) == ("missing", "missing")
    assert (found["lost"].second, found["lost"].largest) == ("not a number", math.inf)


def test_events_that_only_one_has_are_counted_by_source() -> None:
    def event(t_s: float, source: str, text: str) -> Event:
        return Event(t_ns=round(t_s * 1e9), source=source, level="info", text=text)

    shared = event(0.0, "driver", "straight")
    first = [shared, event(2.0, "sensors.gnss", "lost"), event(3.0, "sensors.gnss", "back")]
    assert compare_events(first, list(reversed(first))) == []
    assert compare_events(first, [shared, event(1.0, "driver", "turn")]) == [
        Difference(kind="events", name="sensors.gnss", first="2 s lost and 1 more", second="none of its own"),
        Difference(kind="events", name="driver", first="none of its own", second="1 s turn"),
    ]


def test_words_that_differ() -> None:
    (found,) = compare_words({"verdict": "pass", "ended": "duration"}, {"verdict": "fail", "ended": "duration"})
    assert (found.name, found.first, found.second) == ("verdict", "pass", "fail")
