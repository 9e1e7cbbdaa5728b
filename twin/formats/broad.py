"""Reads trials of BROAD, the Berlin Robust Orientation Estimation Assessment Dataset (Laidig et al. 2021, CC BY 4.0).

A trial is a MATLAB file of version 5 (:mod:`twin.formats.mat5`) with the readings of one inertial unit and
magnetometer and the orientation by optical motion capture: ``imu_acc`` (m/s^2), ``imu_gyr`` (rad/s) and ``imu_mag``
(microtesla), (N, 3) each; ``opt_quat`` (N, 4), w first, body to ENU, NaN where the markers were hidden; ``movement``
(N, 1), true where errors are scored; ``sampling_rate`` (Hz).

A file comes from anywhere: names, shapes, sizes and values are looked at before anything is made of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.errors import BadInputError
from twin.formats.mat5 import read_arrays
from twin.signals import NS_PER_S, BoolArray, FloatArray

LARGEST_FILE_BYTES = 100_000_000
LARGEST_SAMPLES = 2_000_000
_COLUMNS = {"imu_acc": 3, "imu_gyr": 3, "imu_mag": 3, "opt_quat": 4, "movement": 1}
_LARGEST = {"imu_acc": 1e4, "imu_gyr": 1e3, "imu_mag": 1e6, "movement": 1.0}
"""Beyond any such instrument, in the units of the file."""
_RATE = "sampling_rate"
_RATES_HZ = (1.0, 10_000.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class BroadTrial:
    """One trial of N samples."""

    name: str
    step_ns: int
    """Time between samples, the nearest whole nanosecond (3 500 000 for BROAD's 285.714 Hz)."""
    force_m_s2: FloatArray
    """(N, 3) specific force, body axes."""
    rate_rad_s: FloatArray
    """(N, 3) angular rate, body axes."""
    field_ut: FloatArray
    """(N, 3) magnetic flux density, body axes."""
    orientation: FloatArray
    """(N, 4) optical orientation, body to ENU, (x, y, z, w); NaN where unknown."""
    movement: BoolArray
    """(N,) where errors are scored."""

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        return NS_PER_S / self.step_ns

    @property
    def step_s(self) -> float:
        """Time between samples, s."""
        return self.step_ns / NS_PER_S


def read_broad(path: Path) -> BroadTrial:
    """Read a trial.

    Raises:
        BadInputError: the file cannot be read, is too large, is of another version, or is no trial of BROAD.
    """
    arrays = _arrays(path)
    rate_hz = float(arrays[_RATE][0, 0])
    if not _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]:
        raise BadInputError(f"{path}: {_RATE} = {rate_hz:g} Hz; allowed: {_RATES_HZ[0]:g} to {_RATES_HZ[1]:g}")
    for name, largest in _LARGEST.items():
        if not np.isfinite(arrays[name]).all():
            raise BadInputError(f"{path}: {name} holds values that are not numbers")
        if np.abs(arrays[name]).max() > largest:
            raise BadInputError(f"{path}: {name} = {np.abs(arrays[name]).max():g}; allowed: up to {largest:g}")
    return BroadTrial(
        name=path.stem,
        step_ns=round(NS_PER_S / rate_hz),
        force_m_s2=arrays["imu_acc"],
        rate_rad_s=arrays["imu_gyr"],
        field_ut=arrays["imu_mag"],
        orientation=_unit(path, np.roll(arrays["opt_quat"], -1, axis=1)),
        movement=arrays["movement"][:, 0] != 0.0,
    )


def _arrays(path: Path) -> dict[str, FloatArray]:
    """The variables of a trial, of the shapes they should have."""
    wanted = [*_COLUMNS, _RATE]
    found = read_arrays(
        path, wanted, largest_file_bytes=LARGEST_FILE_BYTES, largest_elements=LARGEST_SAMPLES * max(_COLUMNS.values())
    )
    missing = [name for name in wanted if name not in found]
    if missing:
        there = ", ".join(sorted(found)) or "none"
        raise BadInputError(f"{path}: no trial of BROAD: no numbers called {', '.join(missing)}; found: {there}")
    samples = found["imu_acc"].shape[0]
    if not 2 <= samples <= LARGEST_SAMPLES:
        raise BadInputError(f"{path}: {samples} samples; allowed: 2 to {LARGEST_SAMPLES}")
    for name, shape in [(name, (samples, width)) for name, width in _COLUMNS.items()] + [(_RATE, (1, 1))]:
        if found[name].shape != shape:
            raise BadInputError(f"{path}: {name} has the shape {found[name].shape}; allowed: {shape}")
    return found


def _unit(path: Path, quaternions: FloatArray) -> FloatArray:
    """Normalised; NaN where a component is.

    Raises:
        BadInputError: one is far from a unit quaternion.
    """
    known = np.logical_and.reduce(np.isfinite(quaternions), axis=1)
    given = quaternions[known]
    length = np.sqrt(np.square(np.clip(given, -2.0, 2.0)).sum(axis=1))
    if len(given) == 0 or np.abs(length - 1.0).max() > 0.01:
        raise BadInputError(f"{path}: opt_quat holds no unit quaternions")
    unit: FloatArray = np.full(quaternions.shape, np.nan)
    unit[known] = given / length[:, np.newaxis]
    return unit
