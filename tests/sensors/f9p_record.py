"""A real record of RTK float: two post-processed solutions of one u-blox F9P drive, one nearly always fixed.

Not part of this repository; where it is absent, tests that need it skip.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "f9p_ppk_rtklib"

_FIX, _FLOAT = 1, 2
"""RTKLIB's code, not NMEA's."""
_GPS_EPOCH = datetime(1980, 1, 6)
_WEEK_S = 604800


@dataclass(frozen=True, kw_only=True)
class Record:
    """Epochs, 1 Hz, at which the reference is fixed."""

    t_s: np.ndarray
    code: np.ndarray
    error_m: np.ndarray
    """(T, 3) east, north, up."""
    sigma_m: np.ndarray
    """(T, 3) as reported."""

    @property
    def float_error_m(self) -> np.ndarray:
        return self.error_m[self.code == _FLOAT]

    @property
    def float_sigma_m(self) -> np.ndarray:
        return self.sigma_m[self.code == _FLOAT]

    def correlation_s(self, axis: int, *, lag_s: int) -> float:
        """1/e time of the float error, from what is left of it after ``lag_s``."""
        both = (self.code[:-lag_s] == _FLOAT) & (self.code[lag_s:] == _FLOAT)
        both &= self.t_s[lag_s:] - self.t_s[:-lag_s] == lag_s
        early, late = self.error_m[:-lag_s, axis][both], self.error_m[lag_s:, axis][both]
        left = np.mean(early * late) / np.mean(np.concatenate([early, late]) ** 2)
        return float(-lag_s / np.log(left))

    def steps_m(self, before: int, after: int) -> np.ndarray:
        """Sizes of the steps of the error (three axes) at transitions between two codes."""
        at = np.flatnonzero((self.code[:-1] == before) & (self.code[1:] == after) & (np.diff(self.t_s) == 1.0))
        return np.linalg.norm(self.error_m[at + 1] - self.error_m[at], axis=1)


def load() -> Record:
    """Read both solutions and take their difference."""
    reference, solution = _read(FOLDER / "demo5_b34f_f.pos"), _read(FOLDER / "py_0315f.pos")
    _, first, second = np.intersect1d(reference[:, 0], solution[:, 0], return_indices=True)
    reference, solution = reference[first], solution[second]
    error = _enu(solution, reference[0]) - _enu(reference, reference[0])
    fixed = reference[:, 4] == _FIX
    return Record(
        t_s=solution[fixed, 0], code=solution[fixed, 4], error_m=error[fixed], sigma_m=solution[fixed][:, [7, 6, 8]]
    )


def _read(path: Path) -> np.ndarray:
    """Time (s), latitude, longitude (deg), height (m), code, satellites, sigma north, east, up (m)."""
    rows = []
    for line in path.read_text().splitlines():
        if not line.startswith("%"):
            day, time, *rest = line.split()
            rows.append([_gps_s(day, time), *map(float, rest[:8])])
    return np.array(rows)


def _gps_s(day: str, time: str) -> float:
    if "/" in day:
        return (datetime.strptime(f"{day} {time}", "%Y/%m/%d %H:%M:%S.%f") - _GPS_EPOCH).total_seconds()
    return int(day) * _WEEK_S + float(time)


def _enu(rows: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Offsets of some kilometres, as far as differences of metres need them (WGS 84 radii of curvature)."""
    latitude, square = np.radians(origin[1]), 6.69437999e-3
    root = 1.0 - square * np.sin(latitude) ** 2
    meridian = 6378137.0 * (1.0 - square) / root**1.5 + origin[3]
    normal = 6378137.0 / np.sqrt(root) + origin[3]
    east = np.radians(rows[:, 2] - origin[2]) * normal * np.cos(latitude)
    north = np.radians(rows[:, 1] - origin[1]) * meridian
    return np.column_stack([east, north, rows[:, 3]])
