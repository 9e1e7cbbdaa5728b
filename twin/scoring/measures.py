"""What is measured of an estimate's errors: a list of measures, each one signal over time and one reduction of it.

A measure is named ``<family>.<what>{phase}_<unit>``; the phase is put in where a run has phases. Which measures an
estimator gets follows from its columns alone, so the names are known before a run. Families are stated in
:mod:`twin.families`; only those whose error is made of several columns have a function here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from twin.families import CROSS_TRACK, FAMILIES, Family, family_named
from twin.signals import POSITION, FloatArray, row_position, row_speed

Reduction = Literal["mean", "max", "rms", "p95", "last", "time_to"]
Errors = FloatArray
"""(T, R, n) estimate minus truth of the shared columns, angles wrapped."""
Signal = Callable[[Errors], FloatArray]
"""Makes (T, R) of the errors. Measures of one family share their signals, so that each is made once."""

_ROW = re.compile(r"row_speed_(\d+)_m_s\Z")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """One figure per run: a reduction over time of a signal (T, R) made from the errors."""

    name: str
    """With ``{phase}`` where the phase goes; without it the measure is of the whole run only."""
    signal: Signal
    reduction: Reduction
    limit: float = 0.0
    """For ``time_to``: the time from the loss until the signal first exceeds this, s (inf: not before its end)."""
    across: bool = False
    """Made of the offset across the driven track alone, (T, R, 1), which is known later than other errors."""
    envelope: str = ""
    """Name, with its unit, under which the signal's quantiles over many members are kept at each instant."""


def row_numbers(columns: Sequence[str]) -> list[int]:
    """Row units (counted from 1) whose speed is among these columns."""
    return [int(match[1]) for match in map(_ROW.match, columns) if match]


def measures_of(
    columns: Sequence[str], *, counted_rows: Sequence[int] | None, limits: Mapping[str, float], lossy: bool = False
) -> list[Measure]:
    """All measures of an estimator whose columns shared with the truth are these.

    Args:
        columns: shared columns, in the order of the errors' last axis.
        counted_rows: row units that count where no row is named; None: all.
        limits: by family, the error (SI) whose first excess since a loss is timed.
        lossy: whether there is a loss since which an excess could be timed.
    """
    measures: list[Measure] = []
    for each in FAMILIES:
        if each.column:
            measures += _of_one_column(list(columns), each, limits, lossy)
        else:
            measures += _OF_SEVERAL[each.name](list(columns), counted_rows, limits)
    return measures


def _time_to(family: Family, signal: Signal, limits: Mapping[str, float]) -> list[Measure]:
    if family.name not in limits:
        return []
    limit = family.factor * limits[family.name]
    return [Measure(name=family.time_to_limit, signal=signal, reduction="time_to", limit=limit)]


def _counted(rows: Sequence[int], counted: Sequence[int] | None) -> list[int]:
    return [row for row in rows if counted is None or row in counted]


def _row_speed(columns: list[str], counted: Sequence[int] | None, limits: Mapping[str, float]) -> list[Measure]:
    this = family_named("row_speed")
    rows = row_numbers(columns)
    scopes = {"": _counted(rows, counted), **{f"_row_{row}": [row] for row in rows}}
    measures: list[Measure] = []
    for scope, members in scopes.items():
        if not members:
            continue
        at = [columns.index(row_speed(row)) for row in members]

        def mean(errors: Errors, at: list[int] = at) -> FloatArray:
            mean_of_rows: FloatArray = np.abs(errors[:, :, at]).mean(axis=2)
            return mean_of_rows

        def largest(errors: Errors, at: list[int] = at) -> FloatArray:
            largest_of_rows: FloatArray = np.abs(errors[:, :, at]).max(axis=2)
            return largest_of_rows

        measures.append(Measure(name=this.metric(f"mean_abs_error{scope}"), signal=mean, reduction="mean"))
        envelope = "" if scope else "row_speed_m_s"
        name = this.metric(f"max_abs_error{scope}")
        measures.append(Measure(name=name, signal=largest, reduction="max", envelope=envelope))
        if not scope:
            measures += _time_to(this, largest, limits)
    return measures


def _row_position(columns: list[str], counted: Sequence[int] | None, limits: Mapping[str, float]) -> list[Measure]:
    this = family_named("row_position")
    rows = [row for row in row_numbers(columns) if set(row_position(row)) <= set(columns)]
    east = [columns.index(row_position(row)[0]) for row in _counted(rows, counted)]
    north = [columns.index(row_position(row)[1]) for row in _counted(rows, counted)]
    if not east:
        return []

    def rms(errors: Errors) -> FloatArray:
        rms_of_rows: FloatArray = np.sqrt((errors[:, :, east] ** 2 + errors[:, :, north] ** 2).mean(axis=2))
        return rms_of_rows

    def largest(errors: Errors) -> FloatArray:
        farthest: FloatArray = np.hypot(errors[:, :, east], errors[:, :, north]).max(axis=2)
        return farthest

    return [
        Measure(name=this.metric("rmse"), signal=rms, reduction="rms"),
        Measure(name=this.metric("max_error"), signal=largest, reduction="max", envelope="row_position_m"),
        *_time_to(this, largest, limits),
    ]


def _position(columns: list[str], _counted: Sequence[int] | None, limits: Mapping[str, float]) -> list[Measure]:
    this = family_named("position")
    if not set(POSITION[:2]) <= set(columns):
        return []
    east, north = columns.index(POSITION[0]), columns.index(POSITION[1])

    def distance(errors: Errors) -> FloatArray:
        return np.hypot(errors[:, :, east], errors[:, :, north])

    return [
        Measure(name=this.metric("rmse"), signal=distance, reduction="rms"),
        Measure(name=this.metric("max_error"), signal=distance, reduction="max", envelope="position_m"),
        Measure(name=this.metric("final_error", phase=""), signal=distance, reduction="last"),
        *_time_to(this, distance, limits),
    ]


_OF_SEVERAL = {"row_speed": _row_speed, "row_position": _row_position, "position": _position}
"""Families whose error is made of several columns."""


# --- errors of one column --------------------------------------------------------------------------------------------


def signed_signal(column: int, factor: float) -> Signal:
    """Error of one column, with its sign."""

    def signed(errors: Errors) -> FloatArray:
        return factor * errors[:, :, column]

    return signed


def _of_one_column(columns: list[str], family: Family, limits: Mapping[str, float], lossy: bool) -> list[Measure]:
    if family.column not in columns:
        return []
    across = family.column == CROSS_TRACK
    at, factor = 0 if across else columns.index(family.column), family.factor
    signed = signed_signal(at, factor)

    def size(errors: Errors) -> FloatArray:
        return factor * np.abs(errors[:, :, at])

    kinds: dict[str, tuple[Signal, Reduction]] = {
        "mean_abs_error": (size, "mean"),
        "max_abs_error": (size, "max"),
        "p95_abs_error": (size, "p95"),
        "rmse": (signed, "rms"),
        "mean_error": (signed, "mean"),
    }
    measures = []
    for figure in family.figures:
        signal, reduction = kinds[figure]
        envelope = f"{family.name}_{family.unit}" if figure == "max_abs_error" else ""
        measures.append(Measure(name=family.metric(figure), signal=signal, reduction=reduction, envelope=envelope))
    if family.tolerance is not None and lossy:
        limit = family.tolerance.error
        measures.append(Measure(name=family.time_to_tolerance, signal=size, reduction="time_to", limit=limit))
    return [replace(measure, across=across) for measure in [*measures, *_time_to(family, size, limits)]]
