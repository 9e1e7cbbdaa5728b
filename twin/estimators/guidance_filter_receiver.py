"""How the guidance filter reads a receiver: what is slow, what steps and what is new of each sample's error.

The kind of solution (fix, float, differential, single) decides: figures are the data sheet's, or those of ordinary
receivers where it is silent. What a receiver reports may widen them, never narrow them: a float solution may claim
11 mm and be 0.23 m off, and a driver that does not fill the field in reports zero. Widening is by how much the reported
sigma, or the dilution of precision, is beyond what is usual for the receiver: what its data sheet says it reports, or
else the class's whole error; the least dilution so far. What a fix is off grows with the age of its corrections, and
what the receiver is expected to report with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin import fix_quality
from twin.estimators.guidance_readers import Fix
from twin.fix_quality import ORDINARY, STATES
from twin.signals import BoolArray, FloatArray, IntArray

SINGLE, DIFFERENTIAL, FLOAT, FIXED = range(4)
"""Classes of solutions, from the worst to the best."""
_CLASSES: IntArray = np.array([SINGLE, SINGLE, DIFFERENTIAL, DIFFERENTIAL, FIXED, FLOAT], dtype=np.int64)
"""By NMEA quality; whatever else there is (dead reckoning, simulated, not told) is taken for the worst."""
_QUALITY_OF = (fix_quality.SINGLE, fix_quality.DIFFERENTIAL, fix_quality.RTK_FLOAT, fix_quality.RTK_FIXED)
_PREFIXES = tuple(f"{STATES[quality]}_" if quality in STATES else "" for quality in _QUALITY_OF)
"""Of their figures on a data sheet."""
_RTK_M = 0.1
"""Reported sigma on a data sheet below which its plain figures are those of a fix."""
_JUMPS_S = 120.0
_AGE_DRIFT_M_S, _AGE_DRIFT_S = 7.4e-4, 100.0
"""Of a fix per second of age, and how long it keeps its direction, where the data sheet is silent: an F9P's."""
_LEAST_WHITE_M = 2e-3
_MOST_WIDER = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FixError:
    """Errors of one sample's position, 1 sigma of one axis, (R,) each."""

    kind: IntArray
    """Class of the solution."""
    slow_m: FloatArray
    slow_s: FloatArray
    """1/e time of the slow part."""
    jump_m: FloatArray
    """Part that steps."""
    white_m: FloatArray
    drift_m: FloatArray
    """What the age of corrections makes of a unit of drift."""
    dilution: FloatArray
    """Dilution of precision against the least so far."""


class FixErrors:
    """Errors of a receiver's samples, by its data sheet and what it reports."""

    def __init__(self, sheet: Mapping[str, float], runs: int, *, tells_age: bool) -> None:
        rtk = sheet.get("position_noise_m", math.inf) < _RTK_M
        self._table = np.array([_figures(sheet, kind, plain_is_fix=rtk) for kind in range(4)])
        usual = sheet.get("position_noise_m")
        best = FIXED if rtk else next((k for k in (FLOAT, DIFFERENTIAL, SINGLE) if _has(sheet, k)), None)
        whole = np.hypot(np.hypot(self._table[:, 0], self._table[:, 2]), self._table[:, 3])
        self._reports = whole.copy()
        if usual is not None and best is not None:
            self._reports[best] = max(usual, whole[best])
        self.jump_s = sheet.get("jump_interval_s", _JUMPS_S)
        """1/e time of the part that steps."""
        self.white_told = any(name.endswith("position_white_sigma_m") for name in sheet)
        """Whether the data sheet tells what is new in a fix."""
        self._drift_m_s = sheet.get("position_age_drift_m_s", _AGE_DRIFT_M_S) if tells_age else 0.0
        self.drift_s = sheet.get("age_drift_correlation_s", _AGE_DRIFT_S)
        """1/e time of what the age of corrections makes of a fix."""
        self.drifts = self._drift_m_s > 0.0
        """Whether that makes anything of it."""
        self.jumps = bool(self._table[:, 3].any())
        """Whether the receiver has such a part."""
        rounding = sheet.get("position_resolution_m", 0.0)
        self.resolution_m = np.array([sheet.get(f"{axis}_resolution_m", rounding) for axis in ("east", "north")])
        """(2,) steps of the output, east and north."""
        self._least_hdop = np.full(runs, np.inf)

    def of(self, fix: Fix) -> FixError:
        """Errors of a sample."""
        usual = (fix.quality >= 0.0) & (fix.quality < len(_CLASSES))  # False for NaN
        kind = _CLASSES[np.where(usual, fix.quality, 0.0).astype(np.int64)]
        slow, correlation_s, white, jump = self._table[kind].T
        known: BoolArray = np.isfinite(fix.hdop) & (fix.hdop > 0.0)
        self._least_hdop = np.where(known & fix.there, np.fmin(fix.hdop, self._least_hdop), self._least_hdop)
        diluted = np.where(known, fix.hdop / self._least_hdop, 1.0)
        reported = np.sqrt(0.5 * np.square(fix.sigma).sum(axis=1))
        ages = (kind == FIXED) & (fix.age_s > 0.0)  # False for NaN
        drift = self._drift_m_s * np.where(ages, fix.age_s, 0.0)
        said = np.where(np.isfinite(reported), reported / np.hypot(self._reports[kind], drift), 1.0)
        wider = np.clip(np.fmax(diluted, said), 1.0, _MOST_WIDER)
        return FixError(
            kind=kind,
            slow_m=slow * wider,
            slow_s=correlation_s,
            jump_m=jump * wider,
            white_m=white * wider,
            drift_m=drift * wider,
            dilution=diluted,
        )


def _has(sheet: Mapping[str, float], kind: int) -> bool:
    return f"{_PREFIXES[kind]}position_correlated_sigma_m" in sheet


def _figures(sheet: Mapping[str, float], kind: int, *, plain_is_fix: bool) -> tuple[float, float, float, float]:
    """Slow sigma, its correlation time, white sigma and jumps of a class."""
    usual = ORDINARY[_QUALITY_OF[kind]]
    if not _has(sheet, kind) or (kind == FIXED and not plain_is_fix):
        return usual.slow_m, usual.slow_s, usual.white_m, 0.0
    prefix = f"{_PREFIXES[kind]}position_"
    return (
        max(sheet[f"{prefix}correlated_sigma_m"], _LEAST_WHITE_M),
        sheet.get(f"{prefix}correlation_s", usual.slow_s),
        max(sheet.get(f"{prefix}white_sigma_m", usual.white_m), _LEAST_WHITE_M),
        sheet.get(f"{prefix}jump_sigma_m", 0.0),
    )
