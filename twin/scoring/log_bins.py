"""Counts by size in logarithmic bins: quantiles of any number of values in memory that does not grow with them.

A quantile read from the counts, interpolated within its bin, is within one bin of the exact one. Counts of different
pieces, members, worlds and workers simply add up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.signals import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class LogBins:
    """Bins of equal width in the logarithm; what lies beyond either end is counted in the last bin there."""

    lowest_decade: int
    highest_decade: int
    per_decade: int

    def __len__(self) -> int:
        return (self.highest_decade - self.lowest_decade) * self.per_decade

    def place(self, sizes: FloatArray) -> IntArray:
        """Bin of each of these sizes, of any shape; -1 for NaN."""
        last = len(self) - 1
        with np.errstate(divide="ignore"):
            bins = np.log10(np.abs(sizes))
        bins -= self.lowest_decade
        bins *= self.per_decade
        np.floor(bins, out=bins)
        unknown = np.isnan(bins)
        np.clip(bins, 0.0, last, out=bins)
        bins[unknown] = -1.0
        return bins.astype(np.int64)

    def quantile(self, counts: IntArray, fraction: float) -> FloatArray:
        """Size that this fraction of the values keeps within, by row of counts (N, bins), shape (N,); NaN of none."""
        cumulative = np.cumsum(counts, axis=1)
        total = cumulative[:, -1]
        target = fraction * total
        bins = np.minimum((cumulative < target[:, np.newaxis]).sum(axis=1), len(self) - 1)
        rows = np.arange(len(bins))
        inside = counts[rows, bins]
        below = cumulative[rows, bins] - inside
        part = np.divide(target - below, inside, out=np.full(len(bins), 0.5), where=inside > 0)
        value: FloatArray = 10.0 ** (self.lowest_decade + (bins + np.clip(part, 0.0, 1.0)) / self.per_decade)
        return np.where(total > 0, value, np.nan)
