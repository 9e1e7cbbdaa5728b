"""Places: deviation of an estimated position at each of the stops and along each of the tracks that a scenario names.

These are the figures of paper 004's tables 2 (tracks) and 3 (stops): standard deviation and mean of the deviation east
and north, and the largest and smallest horizontal distance from the truth. A place is all segments of the driver's path
of one name (``scoring.places``); the deviations are those at the estimator's outputs, from ``scoring.from_s`` on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.scenario import Scenario, place_key
from twin.signals import BoolArray, FloatArray

_FIGURES = ("sigma_e", "sigma_n", "mean_e", "mean_n", "largest", "smallest")


def names(places: Sequence[str]) -> list[str]:
    """Names of the metrics of these places."""
    return [f"place.{place_key(place)}.{figure}_m" for place in places for figure in _FIGURES]


def segments_of(scenario: Scenario) -> list[BoolArray]:
    """Which of the driver's segments belong to each place, (segments + 1,): the last value is that it has finished."""
    legs = scenario.planned_legs
    return [np.array([*(leg.name == place for leg in legs), False]) for place in scenario.scoring.places]


class Places:
    """Deviations at the places of a scenario, fed in pieces, for R runs side by side."""

    def __init__(self, scenario: Scenario, runs: int) -> None:
        self._names = names(scenario.scoring.places)
        self._segments = segments_of(scenario)
        self._moments = [_Moments(runs) for _ in self._segments]

    def add(self, segments: FloatArray, errors_m: FloatArray) -> None:
        """Take the next piece: the truth's ``segment`` (T,), and errors east and north (T, R, 2)."""
        for inside, moments in zip(self._segments, self._moments, strict=True):
            at = np.minimum(segments.astype(np.int64), len(inside) - 1)
            moments.add(errors_m[inside[at]])

    def metrics(self) -> dict[str, FloatArray]:
        """Figures by :func:`names`, each of shape (R,); NaN where the machine never came, or a position was unknown."""
        found = [value for moments in self._moments for value in moments.figures()]
        return dict(zip(self._names, found, strict=True))


class _Moments:
    """Mean, spread and extreme distances of errors (T, R, 2)."""

    def __init__(self, runs: int) -> None:
        self._count = 0
        self._mean: FloatArray = np.zeros((runs, 2))
        self._squares: FloatArray = np.zeros((runs, 2))
        """Sum of squared deviations from the mean."""
        self._largest: FloatArray = np.full(runs, -np.inf)
        self._smallest: FloatArray = np.full(runs, np.inf)

    def add(self, errors_m: FloatArray) -> None:
        """Put a piece together with those before (Chan, Golub and LeVeque 1983)."""
        count = len(errors_m)
        if not count:
            return
        mean = errors_m.mean(axis=0)
        off = mean - self._mean
        total = self._count + count
        self._squares += ((errors_m - mean) ** 2).sum(axis=0) + off**2 * (self._count * count / total)
        self._mean += off * (count / total)
        self._count = total
        distance = np.hypot(errors_m[..., 0], errors_m[..., 1])
        # An unknown distance makes its extremes unknown: NaN stays NaN in both.
        self._largest = np.maximum(self._largest, distance.max(axis=0))
        self._smallest = np.minimum(self._smallest, distance.min(axis=0))

    def figures(self) -> list[FloatArray]:
        """In the order of the metrics, each (R,)."""
        if self._count == 0:
            return [np.full(len(self._mean), np.nan) for _ in _FIGURES]
        variance = self._squares / (self._count - 1) if self._count > 1 else np.full_like(self._squares, np.nan)
        return [*np.sqrt(variance).T, *self._mean.T, self._largest, self._smallest]
