"""What is measured of an estimate's errors: a list of measures, each one signal over time and one reduction of it.

A measure is named ``<family>.<what>{phase}_<unit>``; the phase is put in where a run has phases. Which measures an
estimator gets follows from its columns alone, so the names are known before a run. A new family is one function here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.signals import (
    HEADING,
    LANE_HEADING,
    LANE_OFFSET,
    POSITION,
    SPEED,
    YAW_RATE,
    FloatArray,
    row_position,
    row_speed,
)

Reduction = Literal["mean", "max", "rms", "last", "time_to"]
Errors = FloatArray
"""(T, R, n) estimate minus truth of the shared columns, angles wrapped."""

_ROW = re.compile(r"row_speed_(\d+)_m_s\Z")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """One figure per run: a reduction over time of a signal (T, R) made from the errors."""

    name: str
    """With ``{phase}`` where the phase goes; without it the measure is of the whole run only."""
    signal: Callable[[Errors], FloatArray]
    reduction: Reduction
    limit: float = 0.0
    """For ``time_to``: the time from the loss until the signal first exceeds this, s (inf: not before its end)."""
    envelope: str = ""
    """Name, with its unit, under which the signal's quantiles over many members are kept at each instant."""


def row_numbers(columns: Sequence[str]) -> list[int]:
    """Row units (counted from 1) whose speed is among these columns."""
    return [int(match[1]) for match in map(_ROW.match, columns) if match]


def measures_of(
    columns: Sequence[str], *, counted_rows: Sequence[int] | None, limits: Mapping[str, float]
) -> list[Measure]:
    """All measures of an estimator whose columns shared with the truth are these.

    Args:
        columns: shared columns, in the order of the errors' last axis.
        counted_rows: row units that count where no row is named; None: all.
        limits: by family, the error whose first excess since a loss is timed.
    """
    measures: list[Measure] = []
    for family in (_row_speed, _row_position, _position):
        measures += family(list(columns), counted_rows, limits)
    measures += _scalar(list(columns), HEADING, "heading", "deg", 180.0 / np.pi)
    measures += _scalar(list(columns), LANE_OFFSET, "lane_offset", "m", 1.0)
    measures += _scalar(list(columns), LANE_HEADING, "lane_heading", "deg", 180.0 / np.pi)
    measures += _scalar(list(columns), SPEED, "speed", "m_s", 1.0)
    measures += _scalar(list(columns), YAW_RATE, "yaw_rate", "rad_s", 1.0)
    return measures


def _time_to(family: str, signal: Callable[[Errors], FloatArray], limits: Mapping[str, float]) -> list[Measure]:
    if family not in limits:
        return []
    return [Measure(name=f"{family}.time_to_limit_s", signal=signal, reduction="time_to", limit=limits[family])]


def _counted(rows: Sequence[int], counted: Sequence[int] | None) -> list[int]:
    return [row for row in rows if counted is None or row in counted]


def _row_speed(columns: list[str], counted: Sequence[int] | None, limits: Mapping[str, float]) -> list[Measure]:
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

        measures.append(Measure(name=f"row_speed.mean_abs_error{scope}{{phase}}_m_s", signal=mean, reduction="mean"))
        envelope = "" if scope else "row_speed_m_s"
        name = f"row_speed.max_abs_error{scope}{{phase}}_m_s"
        measures.append(Measure(name=name, signal=largest, reduction="max", envelope=envelope))
        if not scope:
            measures += _time_to("row_speed", largest, limits)
    return measures


def _row_position(columns: list[str], counted: Sequence[int] | None, limits: Mapping[str, float]) -> list[Measure]:
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
        Measure(name="row_position.rmse{phase}_m", signal=rms, reduction="rms"),
        Measure(name="row_position.max_error{phase}_m", signal=largest, reduction="max", envelope="row_position_m"),
        *_time_to("row_position", largest, limits),
    ]


def _position(columns: list[str], _counted: Sequence[int] | None, limits: Mapping[str, float]) -> list[Measure]:
    if not set(POSITION[:2]) <= set(columns):
        return []
    east, north = columns.index(POSITION[0]), columns.index(POSITION[1])

    def distance(errors: Errors) -> FloatArray:
        return np.hypot(errors[:, :, east], errors[:, :, north])

    return [
        Measure(name="position.rmse{phase}_m", signal=distance, reduction="rms"),
        Measure(name="position.max_error{phase}_m", signal=distance, reduction="max", envelope="position_m"),
        Measure(name="position.final_error_m", signal=distance, reduction="last"),
        *_time_to("position", distance, limits),
    ]


def _scalar(columns: list[str], column: str, family: str, unit: str, factor: float) -> list[Measure]:
    if column not in columns:
        return []
    at = columns.index(column)

    def size(errors: Errors) -> FloatArray:
        return factor * np.abs(errors[:, :, at])

    return [
        Measure(name=f"{family}.mean_abs_error{{phase}}_{unit}", signal=size, reduction="mean"),
        Measure(
            name=f"{family}.max_abs_error{{phase}}_{unit}", signal=size, reduction="max", envelope=f"{family}_{unit}"
        ),
    ]
