"""Estimates against another estimate that is taken for the truth, as a paper does that has none.

Paper 000 had no speed truth for its prototype and took its own filter with all sensors for it (section 4.2.1). What the
filters have in common, such as a standstill detector that holds them all while the car drives off, is no error then.
With ``scoring.reference`` naming an estimator, every other one gets ``row_speed.mean_abs_difference_m_s``, the mean
absolute difference of its row speeds (those that count) from the reference's, to be read beside its error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.recording import Stream
from twin.scenario import Scenario
from twin.scoring.measures import row_numbers
from twin.signals import FloatArray, nanoseconds, row_speed

NAME = "row_speed.mean_abs_difference_m_s"


def shared_rows(scenario: Scenario, estimator: str, columns: Mapping[str, Sequence[str]]) -> list[str]:
    """Row-speed columns in which an estimator is compared with the reference: none if it is it, or there is none."""
    reference = scenario.scoring.reference
    if reference is None or reference == estimator or reference not in columns:
        return []
    counted = scenario.scoring.rows
    rows = [row_speed(row) for row in row_numbers(columns[estimator]) if counted is None or row in counted]
    return [row for row in rows if row in columns[reference]]


class DifferenceTally:
    """Mean absolute differences of all estimators from the reference, fed in pieces."""

    def __init__(self, scenario: Scenario, columns: Mapping[str, Sequence[str]]) -> None:
        self._reference = scenario.scoring.reference or ""
        self._from_ns = nanoseconds(scenario.scoring.from_s)
        rows = {name: shared_rows(scenario, name, columns) for name in columns}
        self._rows = {name: shared for name, shared in rows.items() if shared}
        self._sums: dict[str, FloatArray] = {}
        self._counts = dict.fromkeys(self._rows, 0)

    def add(self, estimates: Mapping[str, Stream]) -> None:
        """Take the next piece of every estimator."""
        for name, rows in self._rows.items():
            one, reference = estimates[name], estimates[self._reference]
            shared, at_one, at_reference = np.intersect1d(one.t_ns, reference.t_ns, return_indices=True)
            counts = shared >= self._from_ns
            difference = one.select(rows)[at_one[counts]] - reference.select(rows)[at_reference[counts]]
            total = np.abs(difference).mean(axis=2).sum(axis=0)
            self._sums[name] = self._sums.get(name, np.zeros_like(total)) + total
            self._counts[name] += len(difference)

    def metrics(self, name: str) -> dict[str, FloatArray]:
        """The figure of one estimator, (R,): NaN if there was nothing to compare; none if it is not compared."""
        if name not in self._sums:
            return {}
        with np.errstate(invalid="ignore"):
            return {NAME: self._sums[name] / np.float64(self._counts[name])}
