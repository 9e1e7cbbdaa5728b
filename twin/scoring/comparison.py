"""What differs between two runs: their metrics, how they ended, their events and every stream.

One rule says what is the same, that of the baselines (:func:`twin.scoring.baselines.allowed`), value by value:
|second - first| <= tolerance * |first| + 1e-9.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.geometry import wrap_angle
from twin.recording import Stream
from twin.scoring.baselines import Baseline, allowed
from twin.signals import Event, FloatArray, wraps


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Something that is not the same in both."""

    kind: str
    """``run``, ``metric``, ``events`` or ``stream``."""
    name: str
    where: str = ""
    """Of a stream: which column and when, or what else of it."""
    first: str
    second: str
    largest: float = math.inf
    """Largest absolute difference; infinite where not both have a number."""


def compare_words(first: Mapping[str, object], second: Mapping[str, object]) -> list[Difference]:
    """What is said of two runs (verdict, how they ended) and is not equal."""
    return [
        Difference(kind="run", name=name, first=_text(first.get(name)), second=_text(second.get(name)))
        for name in dict.fromkeys([*first, *second])
        if first.get(name) != second.get(name)
    ]


def compare_metrics(
    first: Mapping[str, float | None], second: Mapping[str, float | None], *, tolerance: float
) -> list[Difference]:
    """Metrics beyond the tolerance, and those that only one has; None stands for what is not a (finite) number."""
    found = []
    for name in dict.fromkeys([*first, *second]):
        if name not in first or name not in second:
            found.append(_presence("metric", name, "", name in first, name in second))
            continue
        one, other = (math.nan if value is None else value for value in (first[name], second[name]))
        if not Baseline(one, tolerance).holds(other):
            size = abs(other - one)
            found.append(
                Difference(
                    kind="metric",
                    name=name,
                    first=_text(first[name]),
                    second=_text(second[name]),
                    largest=math.inf if math.isnan(size) else size,
                )
            )
    return found


def compare_events(first: Sequence[Event], second: Sequence[Event]) -> list[Difference]:
    """Events that only one has, counted by source; the first of them is named."""
    only = [Counter(first) - Counter(second), Counter(second) - Counter(first)]
    sources = dict.fromkeys(event.source for events in only for event in sorted(events, key=lambda event: event.t_ns))
    return [
        Difference(kind="events", name=source, first=_events(only[0], source), second=_events(only[1], source))
        for source in sources
    ]


def _events(events: Counter[Event], source: str) -> str:
    own = sorted((event for event in events.elements() if event.source == source), key=lambda event: event.t_ns)
    if not own:
        return "none of its own"
    more = f" and {len(own) - 1} more" if len(own) > 1 else ""
    return f"{own[0].t_ns / 1e9:g} s {own[0].text}{more}"


def compare_streams(
    first: Mapping[str, Stream], second: Mapping[str, Stream], *, tolerance: float | None
) -> list[Difference]:
    """Streams of two recordings, by name: those that only one has, of other times or members, or of other values.

    Of an estimator every column that differs is listed, of other streams the one that differs most. Without a
    tolerance (None) they have to be the same bit for bit.
    """
    found: list[Difference] = []
    for name in dict.fromkeys([*first, *second]):
        if name not in first or name not in second:
            found.append(_presence("stream", name, "", name in first, name in second))
            continue
        one, other = first[name], second[name]
        rows = _other_rows(name, one, other)
        columns = [] if rows is not None else _other_columns(name, one, other, tolerance)
        if columns and not name.startswith("estimates/"):
            columns = [max(columns, key=lambda each: each.largest)]
        found += columns if rows is None else [rows]
    return found


def _presence(kind: str, name: str, where: str, first: bool, second: bool) -> Difference:
    one, other = ("there" if there else "missing" for there in (first, second))
    return Difference(kind=kind, name=name, where=where, first=one, second=other)


def _other_rows(name: str, first: Stream, second: Stream) -> Difference | None:
    """How the rows of two streams differ: their number, times, arrivals or validity; None where they do not."""
    if first.values.shape[:2] != second.values.shape[:2]:
        one, other = (" x ".join(map(str, each.values.shape[:2])) for each in (first, second))
        return Difference(kind="stream", name=name, where="instants x members", first=one, second=other)
    pairs = {
        "times": (first.t_ns, second.t_ns),
        "arrivals": (first.t_available_ns, second.t_available_ns),
        "validity": (first.valid, second.valid),
    }
    for where, (before, after) in pairs.items():
        if before is None or after is None:
            if before is not after:
                return _presence("stream", name, where, before is not None, after is not None)
        elif not np.array_equal(before, after):
            row = int(np.flatnonzero(np.reshape(before != after, (len(first), -1)).any(axis=1))[0])
            one, other = (f"{each[row]}" for each in (before, after))
            return Difference(kind="stream", name=name, where=f"{where}, row {row}", first=one, second=other)
    return None


def _other_columns(name: str, first: Stream, second: Stream, tolerance: float | None) -> list[Difference]:
    found = []
    for column in dict.fromkeys([*first.columns, *second.columns]):
        if not first.has(column) or not second.has(column):
            found.append(_presence("stream", name, column, first.has(column), second.has(column)))
            continue
        one, other = first.column(column), second.column(column)
        short_way = tolerance is not None and wraps(column)
        moved = _moved(one, other, short_way=short_way)
        beyond = moved > (0.0 if tolerance is None else allowed(np.where(np.isfinite(one), one, 0.0), tolerance))
        if beyond.any():
            at = np.unravel_index(int(np.where(beyond, moved, -1.0).argmax()), moved.shape)
            found.append(
                Difference(
                    kind="stream",
                    name=name,
                    where=f"{column} at {first.t_s[at[0]]:g} s",
                    first=_text(float(one[at])),
                    second=_text(float(other[at])),
                    largest=float(moved[at]),
                )
            )
    return found


def _moved(first: FloatArray, second: FloatArray, *, short_way: bool) -> FloatArray:
    """|second - first|, for angles the short way round; infinite where only one of them is known."""
    with np.errstate(invalid="ignore"):
        difference = second - first
    difference = np.abs(wrap_angle(difference) if short_way else difference)
    unknown = np.isnan(difference)
    same = (first == second) | (np.isnan(first) & np.isnan(second))
    moved: FloatArray = np.where(same, 0.0, np.where(unknown, math.inf, difference))
    return moved


def _text(value: object) -> str:
    if value is None:
        return "not a number"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
