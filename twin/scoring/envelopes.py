"""Quantiles of an error over many members, at each instant, in memory that does not grow with the members.

Errors are counted in logarithmic bins, fifty to a decade from 1e-7 to 1e5: a quantile read from them, interpolated
within its bin, is within one bin (4.7 %) of the exact one. Counts of different members, worlds and workers simply add
up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.scoring.log_bins import LogBins
from twin.signals import FloatArray, IntArray

BINS = LogBins(lowest_decade=-7, highest_decade=5, per_decade=50)


@dataclass(kw_only=True)
class Envelope:
    """Counts of |error| by instant and size."""

    t_ns: IntArray
    """(T,) instants."""
    counts: IntArray
    """(T, bins)."""

    @staticmethod
    def at(t_ns: IntArray) -> Envelope:
        """Return an empty envelope over these instants."""
        return Envelope(t_ns=t_ns, counts=np.zeros((len(t_ns), len(BINS)), dtype=np.int64))

    def add(self, t_ns: IntArray, values: FloatArray) -> None:
        """Count errors (T', R) at instants that the envelope has; other instants and NaN are passed over."""
        place = np.searchsorted(self.t_ns, t_ns)
        wanted = (place < len(self.t_ns)) & (self.t_ns[np.minimum(place, len(self.t_ns) - 1)] == t_ns)
        bins = BINS.place(values[wanted])
        rows = np.broadcast_to(place[wanted][:, np.newaxis], bins.shape)
        flat = (rows * len(BINS) + bins)[bins >= 0]
        self.counts += np.bincount(flat, minlength=self.counts.size).reshape(self.counts.shape)

    def merge(self, other: Envelope) -> None:
        """Add the counts of another envelope over the same instants."""
        self.counts += other.counts

    def quantile(self, fraction: float) -> FloatArray:
        """Error that this fraction of the members keeps within, at each instant, shape (T,); NaN without members."""
        return BINS.quantile(self.counts, fraction)
