"""Reductions over time, fed in pieces, for R runs side by side."""

from __future__ import annotations

import math

import numpy as np

from twin.scoring.log_bins import LogBins
from twin.scoring.measures import Measure
from twin.signals import NS_PER_S, FloatArray, IntArray

_BINS = LogBins(lowest_decade=-4, highest_decade=5, per_decade=100)
"""A percentile is within one bin, 2.3 %, of the exact one."""


class MeanOfKnown:
    """Mean over time of values (T, R) that may be unknown (NaN) now and then."""

    def __init__(self) -> None:
        self._sum: FloatArray = np.zeros(1)
        self._count: FloatArray = np.zeros(1)

    def add(self, values: FloatArray) -> None:
        """Take a piece."""
        known = ~np.isnan(values)
        self._sum = self._sum + np.where(known, values, 0.0).sum(axis=0)
        self._count = self._count + known.sum(axis=0)

    def value(self) -> FloatArray:
        """The mean (R,); NaN where nothing was known."""
        mean: FloatArray = np.full(len(self._sum), math.nan)
        return np.divide(self._sum, self._count, out=mean, where=self._count > 0)


class Tally:
    """One reduction over time, for R runs, fed in pieces of shape (T, R)."""

    def __init__(self, measure: Measure, runs: int, loss_ns: tuple[int, int]) -> None:
        self._reduction = measure.reduction
        self._limit = measure.limit
        self._loss_ns = loss_ns
        self._count = 0
        start = {"max": -math.inf, "time_to": math.inf, "last": math.nan}.get(measure.reduction, 0.0)
        self._held: FloatArray = np.full(runs, start)
        self._by_size: IntArray = np.zeros((runs, len(_BINS) if measure.reduction == "p95" else 0), dtype=np.int32)

    def add(self, values: FloatArray, t_ns: IntArray) -> None:
        """Take a piece: values (T, R) at times (T,), ns."""
        if not len(values):
            return
        self._count += len(values)
        match self._reduction:
            case "mean":
                self._held += values.sum(axis=0)
            case "rms":
                self._held += (values**2).sum(axis=0)
            case "max":
                self._held = np.maximum(self._held, values.max(axis=0))
            case "last":
                self._held = values[-1].copy()
            case "p95":
                self._count_sizes(values)
            case "time_to":
                self._time_first_excess(values, t_ns)

    def _count_sizes(self, values: FloatArray) -> None:
        bins = _BINS.place(values)
        # An error that is not known makes the percentile unknown.
        self._held[(bins < 0).any(axis=0)] = math.nan
        flat = (bins + len(_BINS) * np.arange(bins.shape[1]))[bins >= 0]
        self._by_size += np.bincount(flat, minlength=self._by_size.size).reshape(self._by_size.shape)

    def _time_first_excess(self, values: FloatArray, t_ns: IntArray) -> None:
        begin, end = self._loss_ns
        since = (t_ns >= begin) & (t_ns < end)
        # An error that is not known before the first excess makes its time unknown (NaN stays NaN in a minimum).
        stops = ~(values[since] <= self._limit)
        if len(stops):
            at = stops.argmax(axis=0)
            first = (t_ns[since][at] - begin) / NS_PER_S
            first[np.isnan(values[since][at, np.arange(len(at))])] = math.nan
            found = np.where(stops.any(axis=0), first, math.inf)
            self._held = np.where(np.isinf(self._held), found, self._held)

    def value(self) -> FloatArray:
        """The reduction (R,); NaN where nothing was added."""
        if self._count == 0:
            return np.full_like(self._held, math.nan)
        if self._reduction == "mean":
            return self._held / self._count
        if self._reduction == "p95":
            return self._held + _BINS.quantile(self._by_size, 0.95)
        return np.sqrt(self._held / self._count) if self._reduction == "rms" else self._held
