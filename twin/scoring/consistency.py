"""Consistency: is an estimator as wrong as it says? NEES of its state and NIS of its innovations.

NEES is e' P^-1 e of the state error e with the claimed covariance P; its mean is the number of states n if the filter
is consistent. Members over one truth share terrain, slip and driver, so they test sensor noise only: bounds are for
means over independent worlds (Bar-Shalom, Li and Kirubarajan 2001, section 5.4): M worlds give
M * mean ~ chi2(M n).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from twin.geometry import wrap_angle
from twin.recording import Stream, covariance_column
from twin.signals import NS_PER_S, FloatArray, IntArray, wraps

NIS_PREFIX = "nis_"
NEES_PERIOD_NS = NS_PER_S
"""NEES is taken once a second: neighbouring epochs say the same thing twice."""
_SMALLEST_VARIANCE = 1e-12
_SMALLEST_DETERMINANT = 1e-9
"""Of the correlation matrix."""

_VARIANCE = re.compile(r"cov\(([^,]+),\1\)\Z")


def state_columns(columns: Sequence[str]) -> list[str]:
    """Columns an estimate stream has a joint covariance of."""
    return [match[1] for match in map(_VARIANCE.match, columns) if match]


def nis_columns(columns: Sequence[str]) -> list[str]:
    """Columns with the normalised innovation squared of a kind of update."""
    return [column for column in columns if column.startswith(NIS_PREFIX) and "." not in column]


def nis_degrees(column: str) -> int:
    """Degrees of freedom of a NIS column: positions and velocities are east and north together, all else one number."""
    return 2 if column.endswith(("position", "velocity")) else 1


def covariances(estimate: Stream, states: Sequence[str], rows: IntArray) -> FloatArray:
    """Joint covariance of the states at some rows, shape (T, R, n, n)."""
    size = len(states)
    joint = np.empty((len(rows), estimate.values.shape[1], size, size))
    for first in range(size):
        for second in range(first, size):
            values = estimate.column(covariance_column(states[first], states[second]))[rows]
            joint[:, :, first, second] = joint[:, :, second, first] = values
    return joint


def nees(
    truth: Stream, estimate: Stream, states: Sequence[str], at_truth: IntArray, at_estimate: IntArray
) -> FloatArray:
    """Normalised estimation error squared at matching rows, shape (T, R).

    NaN where the filter claims to know a state, or a combination of states, exactly (a standstill update with R = 0):
    no ratio can be formed.
    """
    errors = estimate.select(states)[at_estimate] - truth.select(states)[at_truth]
    for index, column in enumerate(states):
        if wraps(column):
            errors[:, :, index] = wrap_angle(errors[:, :, index])
    joint = covariances(estimate, states, at_estimate)
    variances = np.diagonal(joint, axis1=2, axis2=3)
    known = variances.min(axis=2) > _SMALLEST_VARIANCE
    joint[~known] = np.eye(len(states))
    scale = np.sqrt(np.where(known[..., np.newaxis], variances, 1.0))
    correlation = joint / (scale[..., np.newaxis] * scale[..., np.newaxis, :])
    known &= np.linalg.det(correlation) > _SMALLEST_DETERMINANT
    joint[~known] = np.eye(len(states))
    solved = np.linalg.solve(joint, errors[..., np.newaxis])[..., 0]
    value: FloatArray = np.where(known, np.einsum("tri,tri->tr", errors, solved), np.nan)
    return value
