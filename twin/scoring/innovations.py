"""Is a filter as surprised as it expects to be? Innovations and their normalised squares, without any truth.

A consistent filter's normalised innovation squared nu' S^-1 nu is chi-square with as many degrees of freedom n as the
measurement has numbers, and its innovations are white (Bar-Shalom, Li and Kirubarajan 2001, section 5.4). Over N
updates

* N * mean NIS is chi-square with N n degrees, which bounds the mean; a share of 95 % of them lies below the 95 %
  quantile of one;
* the lag-1 autocorrelation of each innovation is within 1.96 / sqrt(N) of zero 95 times of 100.

Both may hold of a filter that is wrong: an error that wanders slowly (multipath, a bias of metres) moves filter and
receiver alike and does not show in their difference. Read from the columns ``nis_<aid>``, ``innovation_<what>_<unit>``
and ``gated...`` of estimates, which are NaN where nothing new was heard since the row before. Sums only are kept: a log
may be of any length.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
from scipy import stats

from twin.recording import Stream
from twin.scoring.consistency import nis_columns, nis_degrees
from twin.signals import FloatArray

INNOVATION_PREFIX = "innovation_"
GATED_PREFIX = "gated"
_CONFIDENCE = 0.95
_TWO_SIDED = 1.96
"""Standard deviations that hold 95 % of a normal law."""
_UNIT = re.compile(r"_(m_s|rad_s|m|rad|deg)\Z")


def innovation_columns(columns: Sequence[str]) -> list[str]:
    """Columns with an innovation."""
    return [column for column in columns if column.startswith(INNOVATION_PREFIX) and "." not in column]


def gated_columns(columns: Sequence[str]) -> list[str]:
    """Columns that are 1 where an update was refused."""
    return [column for column in columns if column.startswith(GATED_PREFIX) and "." not in column]


class Whiteness:
    """Mean, root mean square and lag-1 autocorrelation of a sequence (T,) that is fed in pieces.

    What is not known (NaN) is passed over: the sequence is that of the updates. The autocorrelation is
    sum (v_k - m) (v_k+1 - m) / sum (v_k - m)^2 with the mean m of the whole.
    """

    def __init__(self) -> None:
        self.count = 0
        self._sum = self._squares = self._products = 0.0
        self._first = self._last = math.nan
        self._shift = 0.0

    def add(self, values: FloatArray) -> None:
        """Take a piece."""
        known = values[np.isfinite(values)]
        if not len(known):
            return
        if not self.count:
            # About any value near the mean, squares lose no digits to a mean that is large beside the spread.
            self._shift = float(known[0])
            self._first = 0.0
        shifted = known - self._shift
        if self.count:
            self._products += self._last * float(shifted[0])
        self.count += len(shifted)
        self._sum += float(shifted.sum())
        self._squares += float(shifted @ shifted)
        self._products += float(shifted[1:] @ shifted[:-1])
        self._last = float(shifted[-1])

    @property
    def mean(self) -> float:
        """Mean; NaN of nothing."""
        return self._shift + self._sum / self.count if self.count else math.nan

    @property
    def rms(self) -> float:
        """Root mean square about zero; NaN of nothing."""
        if not self.count:
            return math.nan
        about = self._squares + 2.0 * self._shift * self._sum + self.count * self._shift**2
        return math.sqrt(max(about, 0.0) / self.count)

    @property
    def lag1(self) -> float:
        """Autocorrelation at lag 1; NaN of fewer than three values, or where they are all the same."""
        if self.count < 3:
            return math.nan
        mean = self._sum / self.count
        spread = self._squares - self.count * mean**2
        if spread <= 1e-12 * self._squares or spread <= 0.0:
            return math.nan
        ends = 2.0 * self._sum - self._first - self._last
        return (self._products - mean * ends + (self.count - 1) * mean**2) / spread

    @property
    def bound(self) -> float:
        """Within which the autocorrelation of white noise is, 95 times of 100."""
        return _TWO_SIDED / math.sqrt(self.count) if self.count else math.nan


class NisTally:
    """Normalised innovations squared (T,) with ``degrees`` degrees of freedom, fed in pieces."""

    def __init__(self, degrees: int) -> None:
        self._degrees = degrees
        self._limit = float(stats.chi2.ppf(_CONFIDENCE, degrees))
        self._sum = 0.0
        self._inside = 0
        self.count = 0

    def add(self, values: FloatArray) -> None:
        """Take a piece; NaN is passed over."""
        known = values[~np.isnan(values)]
        self.count += len(known)
        self._sum += float(known.sum())
        self._inside += int((known <= self._limit).sum())

    def figures(self, name: str) -> dict[str, float]:
        """Mean NIS, the bounds a consistent filter keeps it in, the share inside 95 %, and how many there were."""
        count, degrees = self.count, self._degrees
        tail = 0.5 * (1.0 - _CONFIDENCE)
        low, high = (
            (float(stats.chi2.ppf(share, count * degrees)) / count for share in (tail, 1.0 - tail))
            if count
            else (math.nan, math.nan)
        )
        return {
            name: self._sum / count if count else math.nan,
            f"{name}_low": low,
            f"{name}_high": high,
            f"{name}_inside_percent": 100.0 * self._inside / count if count else math.nan,
            f"{name}_updates": float(count),
        }


class InnovationTally:
    """All that the innovations of one estimator tell, fed in pieces of its stream (R = 1).

    ``consistency.nis_<aid>`` with ``_low``, ``_high``, ``_inside_percent`` and ``_updates``;
    ``innovation.mean_<what>_<unit>``, ``innovation.rms_<what>_<unit>``, ``innovation.lag1_<what>`` and
    ``innovation.lag1_bound_<what>``; ``innovation.<gated...>_updates``.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        self._nis = {column: NisTally(nis_degrees(column)) for column in nis_columns(columns)}
        self._white = {column: Whiteness() for column in innovation_columns(columns)}
        self._gated = dict.fromkeys(gated_columns(columns), 0)

    def add(self, estimate: Stream) -> None:
        """Take a piece."""
        for column, nis in self._nis.items():
            nis.add(estimate.column(column)[:, 0])
        for column, white in self._white.items():
            white.add(estimate.column(column)[:, 0])
        for column in self._gated:
            self._gated[column] += int((estimate.column(column)[:, 0] > 0.5).sum())

    def figures(self) -> dict[str, float]:
        """Metrics by name, without the estimator's."""
        found: dict[str, float] = {}
        for column, nis in self._nis.items():
            found |= nis.figures(f"consistency.{column}")
        for column, white in self._white.items():
            what = column.removeprefix(INNOVATION_PREFIX)
            bare = _UNIT.sub("", what)
            found |= {
                f"innovation.mean_{what}": white.mean,
                f"innovation.rms_{what}": white.rms,
                f"innovation.lag1_{bare}": white.lag1,
                f"innovation.lag1_bound_{bare}": white.bound,
            }
        return found | {f"innovation.{column}_updates": float(count) for column, count in self._gated.items()}
