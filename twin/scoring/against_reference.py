"""Positions against those of another log of the same drive: how wrong they are, and whether they say so.

Of the horizontal error e, with the covariance P that is claimed of it plus the variance the reference claims of itself:

* ``reference.rmse_m``, ``p95_m``, ``max_m``, ``mean_e_m``, ``mean_n_m``, ``epochs``;
* ``reference.mean_nees``: mean of e' P^-1 e, which is 2 if P is as large as the errors are;
* ``reference.error_over_sigma``: its root per number, sqrt(mean / 2): so many times larger are errors than claimed;
* ``reference.inside_percent``: share of errors within the ellipse that ought to hold 95 % of them.

Of heights the same, with one number instead of two: ``reference.height_rmse_m``, ``height_mean_m``.

Each of them over all, and again by the quality that the replayed log's receiver told (``rmse_float_m``). Nothing is
averaged out of sight by thousands of epochs that are all wrong alike: errors of positions are correlated over minutes,
and no bound for the mean is given. Where the reference has fixes of RTK, only those count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import stats

from twin.scoring.log_bins import LogBins
from twin.scoring.transitions import quality_name
from twin.signals import BoolArray, FloatArray

_BINS = LogBins(lowest_decade=-4, highest_decade=7, per_decade=100)
"""A percentile is within one bin, 2.3 %, of the exact one."""
_SMALLEST_DETERMINANT = 1e-18
"""Of a covariance of positions, m^4: a sigma of 30 micrometres both ways."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Differences:
    """Rows (T,) of positions less the reference's; NaN where either is not known, or no covariance is claimed."""

    NUMBERS: ClassVar[int] = 2
    PREFIX: ClassVar[str] = "reference."
    """Of the metrics' names."""

    east_m: FloatArray
    north_m: FloatArray
    var_e_m2: FloatArray
    cov_en_m2: FloatArray
    var_n_m2: FloatArray

    @property
    def size(self) -> FloatArray:
        """(T,) the horizontal error, m."""
        size: FloatArray = np.hypot(self.east_m, self.north_m)
        return size

    @property
    def parts(self) -> Mapping[str, FloatArray]:
        """What means are told of, by name."""
        return {"mean_e": self.east_m, "mean_n": self.north_m}

    @property
    def nees(self) -> FloatArray:
        """(T,) e' P^-1 e."""
        determinant = self.var_e_m2 * self.var_n_m2 - self.cov_en_m2**2
        known = (determinant > _SMALLEST_DETERMINANT) & (self.var_e_m2 > 0.0)
        weighed = (
            self.var_n_m2 * self.east_m**2
            - 2.0 * self.cov_en_m2 * self.east_m * self.north_m
            + self.var_e_m2 * self.north_m**2
        )
        value: FloatArray = np.where(known, weighed / np.where(known, determinant, 1.0), math.nan)
        return value


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightDifferences:
    """Rows (T,) of heights less the reference's; NaN as in :class:`Differences`."""

    NUMBERS: ClassVar[int] = 1
    PREFIX: ClassVar[str] = "reference.height_"

    up_m: FloatArray
    var_u_m2: FloatArray

    @property
    def size(self) -> FloatArray:
        """(T,) the error without its sign, m."""
        return np.abs(self.up_m)

    @property
    def parts(self) -> Mapping[str, FloatArray]:
        """What means are told of, by name."""
        return {"mean": self.up_m}

    @property
    def nees(self) -> FloatArray:
        """(T,) e^2 / P."""
        known = self.var_u_m2 > 0.0
        value: FloatArray = np.where(known, self.up_m**2 / np.where(known, self.var_u_m2, 1.0), math.nan)
        return value


AnyDifferences = Differences | HeightDifferences


class ReferenceTally:
    """Figures of one track against a reference, fed in pieces; of positions or of heights.

    Args:
        of: which.
    """

    def __init__(self, of: type[AnyDifferences] = Differences) -> None:
        self._all = _Figures(of)
        self._fixed = _Figures(of)

    def add(self, differences: AnyDifferences, quality: FloatArray, fixed: BoolArray) -> None:
        """Take a piece of T rows, with the replayed log's quality and whether the reference has a fix of RTK."""
        self._all.add(differences, quality, np.ones(len(quality), dtype=np.bool_))
        self._fixed.add(differences, quality, fixed)

    def figures(self) -> dict[str, float]:
        """Metrics by name; of heights none where there are none."""
        return (self._fixed if self._fixed.epochs else self._all).named()


class _Figures:
    """Sums over all rows, and over those of each quality."""

    def __init__(self, of: type[AnyDifferences]) -> None:
        self._of = of
        self._whole = _Sums(of)
        self._by_quality: dict[str, _Sums] = {}

    @property
    def epochs(self) -> int:
        return self._whole.count

    def add(self, differences: AnyDifferences, quality: FloatArray, counted: BoolArray) -> None:
        size = differences.size
        known = counted & np.isfinite(size)
        if not known.any():
            return
        nees = differences.nees
        self._whole.add(differences, size, nees, known)
        for code in np.unique(quality[known]):
            same = np.isnan(quality) if np.isnan(code) else quality == code
            self._by_quality.setdefault(quality_name(code), _Sums(self._of)).add(differences, size, nees, known & same)

    def named(self) -> dict[str, float]:
        if self._of is HeightDifferences and not self.epochs:
            return {}
        found = self._whole.named("")
        if len(self._by_quality) > 1:
            for name, sums in sorted(self._by_quality.items()):
                found |= sums.named(f"_{name}")
        return found


class _Sums:
    def __init__(self, of: type[AnyDifferences]) -> None:
        self._of, self._within = of, float(stats.chi2.ppf(0.95, of.NUMBERS))
        self.count = 0
        self._parts: dict[str, float] = {}
        self._squares = self._largest = 0.0
        self._sizes = np.zeros((1, len(_BINS)), dtype=np.int64)
        self._claimed, self._nees, self._inside = 0, 0.0, 0

    def add(self, differences: AnyDifferences, size: FloatArray, nees: FloatArray, rows: BoolArray) -> None:
        size, nees = size[rows], nees[rows]
        self.count += len(size)
        for name, part in differences.parts.items():
            self._parts[name] = self._parts.get(name, 0.0) + float(part[rows].sum())
        self._squares += float((size**2).sum())
        self._largest = max(self._largest, float(size.max(initial=0.0)))
        self._sizes[0] += np.bincount(_BINS.place(size), minlength=len(_BINS))
        told = nees[np.isfinite(nees)]
        self._claimed += len(told)
        self._nees += float(told.sum())
        self._inside += int((told <= self._within).sum())

    def named(self, suffix: str) -> dict[str, float]:
        count, claimed = self.count, self._claimed
        nees = self._nees / claimed if claimed else math.nan
        prefix, names = self._of.PREFIX, tuple(self._parts) or ("mean_e", "mean_n")
        return {
            f"{prefix}epochs{suffix}": float(count),
            f"{prefix}rmse{suffix}_m": math.sqrt(self._squares / count) if count else math.nan,
            f"{prefix}p95{suffix}_m": float(_BINS.quantile(self._sizes, 0.95)[0]),
            f"{prefix}max{suffix}_m": self._largest if count else math.nan,
            **{f"{prefix}{name}{suffix}_m": self._parts[name] / count if count else math.nan for name in names},
            f"{prefix}mean_nees{suffix}": nees,
            f"{prefix}error_over_sigma{suffix}": math.sqrt(nees / self._of.NUMBERS),
            f"{prefix}inside{suffix}_percent": 100.0 * self._inside / claimed if claimed else math.nan,
        }
