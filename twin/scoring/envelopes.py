"""Quantiles of an error over many members, at each instant, in memory that does not grow with the members.

Errors are counted in logarithmic bins, fifty to a decade from 1e-7 to 1e5: a quantile read from them, interpolated
within its bin, is within one bin (4.7 %) of the exact one. Counts of different members, worlds and workers simply add
up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.signals import FloatArray, IntArray

_LOWEST_DECADE, _HIGHEST_DECADE, _PER_DECADE = -7, 5, 50
_BINS = (_HIGHEST_DECADE - _LOWEST_DECADE) * _PER_DECADE


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
        return Envelope(t_ns=t_ns, counts=np.zeros((len(t_ns), _BINS), dtype=np.int64))

    def add(self, t_ns: IntArray, values: FloatArray) -> None:
        """Count errors (T', R) at instants that the envelope has; other instants and NaN are passed over."""
        place = np.searchsorted(self.t_ns, t_ns)
        wanted = (place < len(self.t_ns)) & (self.t_ns[np.minimum(place, len(self.t_ns) - 1)] == t_ns)
        chosen = values[wanted]
        with np.errstate(divide="ignore"):
            bins = np.floor((np.log10(np.abs(chosen)) - _LOWEST_DECADE) * _PER_DECADE)
        bins = np.clip(np.nan_to_num(bins, nan=-1.0, neginf=0.0, posinf=_BINS - 1), -1, _BINS - 1).astype(np.int64)
        bins = np.where(np.isnan(chosen), -1, np.maximum(bins, 0))
        rows = np.broadcast_to(place[wanted][:, np.newaxis], bins.shape)
        flat = (rows * _BINS + bins)[bins >= 0]
        self.counts += np.bincount(flat, minlength=self.counts.size).reshape(self.counts.shape)

    def merge(self, other: Envelope) -> None:
        """Add the counts of another envelope over the same instants."""
        self.counts += other.counts

    def quantile(self, fraction: float) -> FloatArray:
        """Error that this fraction of the members keeps within, at each instant, shape (T,); NaN without members."""
        cumulative = np.cumsum(self.counts, axis=1)
        total = cumulative[:, -1]
        target = fraction * total
        bins = np.minimum((cumulative < target[:, np.newaxis]).sum(axis=1), _BINS - 1)
        rows = np.arange(len(bins))
        inside = self.counts[rows, bins]
        below = cumulative[rows, bins] - inside
        part = np.divide(target - below, inside, out=np.full(len(bins), 0.5), where=inside > 0)
        value: FloatArray = 10.0 ** (_LOWEST_DECADE + (bins + np.clip(part, 0.0, 1.0)) / _PER_DECADE)
        return np.where(total > 0, value, np.nan)
