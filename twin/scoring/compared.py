"""Errors: estimate minus truth at the times that both have, matched by column name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.geometry import wrap_angle
from twin.recording import Stream
from twin.scoring import consistency
from twin.signals import FloatArray, IntArray, sigma_column, wraps

Rows = IntArray | slice


def shared_columns(truth: Sequence[str], estimate: Sequence[str]) -> list[str]:
    """Columns of an estimate that the truth has too: what is scored."""
    return [column for column in estimate if column in truth]


def as_rows(at: IntArray) -> Rows:
    """Rows in rising order as a slice where they follow one another, so that taking them copies nothing."""
    if len(at) and at[-1] - at[0] == len(at) - 1:
        return slice(int(at[0]), int(at[-1]) + 1)
    return at


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """Estimate minus truth at common times."""

    t_ns: IntArray
    """(T,)."""
    errors: FloatArray
    """(T, R, n), angles wrapped."""
    at_truth: IntArray
    """(T,) rows of the truth."""
    at_estimate: IntArray
    """(T,) rows of the estimate."""


def compare(truth: Stream, estimate: Stream, columns: Sequence[str], *, from_ns: int = 0) -> Compared:
    """Errors of some columns at the times that truth and estimate share, from ``from_ns`` on."""
    shared, at_truth, at_estimate = np.intersect1d(truth.t_ns, estimate.t_ns, return_indices=True)
    counts = shared >= from_ns
    at_truth, at_estimate = at_truth[counts], at_estimate[counts]
    of_truth = [truth.columns.index(column) for column in columns]
    of_estimate = [estimate.columns.index(column) for column in columns]
    errors = estimate.values[as_rows(at_estimate)][:, :, of_estimate]
    errors -= truth.values[as_rows(at_truth)][:, :, of_truth]
    for index, column in enumerate(columns):
        if wraps(column):
            errors[:, :, index] = wrap_angle(errors[:, :, index])
    return Compared(t_ns=shared[counts], errors=errors, at_truth=at_truth, at_estimate=at_estimate)


def claimed_sigma(estimate: Stream, column: str, compared: Compared) -> FloatArray:
    """Standard deviation that an estimate claims of a column, (T, R); NaN where it claims none."""
    if not estimate.has(sigma_column(column)):
        return np.full(compared.errors.shape[:2], np.nan)
    return estimate.column(sigma_column(column))[as_rows(compared.at_estimate)]


def sampled_nees(truth: Stream, estimate: Stream, compared: Compared) -> tuple[IntArray, FloatArray]:
    """NEES of an estimate's joint state once a second: times (T,), ns, and values (T, R)."""
    once_a_second = compared.t_ns % consistency.NEES_PERIOD_NS == 0
    rows = compared.at_truth[once_a_second], compared.at_estimate[once_a_second]
    states = consistency.state_columns(estimate.columns)
    return compared.t_ns[once_a_second], consistency.nees(truth, estimate, states, *rows)
