"""Reads trials of BROAD, the Berlin Robust Orientation Estimation Assessment Dataset (Laidig et al. 2021, CC BY 4.0).

A trial is a MATLAB file of version 5 (``scipy.io``) with the readings of one inertial unit and magnetometer and the
orientation by optical motion capture: ``imu_acc`` (m/s^2), ``imu_gyr`` (rad/s) and ``imu_mag`` (microtesla), (N, 3)
each; ``opt_quat`` (N, 4), w first, body to ENU, NaN where the markers were hidden; ``movement`` (N, 1), true where
errors are scored; ``sampling_rate`` (Hz).

A file comes from anywhere: names, shapes and sizes are looked at before anything is read, and only these variables are.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin.errors import BadInputError
from twin.signals import NS_PER_S, BoolArray, FloatArray

LARGEST_FILE_BYTES = 100_000_000
LARGEST_SAMPLES = 2_000_000
_COLUMNS = {"imu_acc": 3, "imu_gyr": 3, "imu_mag": 3, "opt_quat": 4, "movement": 1}
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
    _check_file(path)
    samples = _check_contents(path)
    found = _load(path)
    arrays = {name: _array(path, found, name, (samples, width)) for name, width in _COLUMNS.items()}
    rate_hz = float(_array(path, found, _RATE, (1, 1))[0, 0])
    if not _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]:
        raise BadInputError(f"{path}: {_RATE} = {rate_hz:g} Hz; allowed: {_RATES_HZ[0]:g} to {_RATES_HZ[1]:g}")
    for name in ("imu_acc", "imu_gyr", "imu_mag", "movement"):
        if not np.isfinite(arrays[name]).all():
            raise BadInputError(f"{path}: {name} holds values that are not numbers")
    return BroadTrial(
        name=path.stem,
        step_ns=round(NS_PER_S / rate_hz),
        force_m_s2=arrays["imu_acc"],
        rate_rad_s=arrays["imu_gyr"],
        field_ut=arrays["imu_mag"],
        orientation=_unit(path, np.roll(arrays["opt_quat"], -1, axis=1)),
        movement=arrays["movement"][:, 0] != 0.0,
    )


def _check_file(path: Path) -> None:
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(128)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if size > LARGEST_FILE_BYTES:
        raise BadInputError(f"{path}: {size} bytes; allowed: up to {LARGEST_FILE_BYTES}")
    if head.startswith(b"MATLAB 7.3") or head.startswith(b"\x89HDF"):
        raise BadInputError(f"{path}: a MATLAB file of version 7.3; save it with -v7, as BROAD's are")
    if not head.startswith(b"MATLAB 5.0"):
        raise BadInputError(f"{path}: not a MATLAB file of version 5")


def _check_contents(path: Path) -> int:
    """Number of samples, after a look at names and shapes only."""
    from scipy.io import whosmat  # noqa: PLC0415  (scipy takes half a second)

    shapes = {name: tuple(shape) for name, shape, _ in _guarded(path, lambda: whosmat(str(path)))}
    missing = [name for name in (*_COLUMNS, _RATE) if name not in shapes]
    if missing:
        raise BadInputError(f"{path}: no trial of BROAD: {', '.join(missing)} missing; there are: {_list(shapes)}")
    samples = shapes["imu_acc"][0] if shapes["imu_acc"] else 0
    if not 2 <= samples <= LARGEST_SAMPLES:
        raise BadInputError(f"{path}: {samples} samples; allowed: 2 to {LARGEST_SAMPLES}")
    for name, wanted in [(name, (samples, width)) for name, width in _COLUMNS.items()] + [(_RATE, (1, 1))]:
        if shapes[name] != wanted:
            raise BadInputError(f"{path}: {name} has the shape {shapes[name]}; allowed: {wanted}")
    return int(samples)


def _load(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat  # noqa: PLC0415

    found: dict[str, Any] = _guarded(path, lambda: loadmat(str(path), variable_names=[*_COLUMNS, _RATE]))
    return found


def _guarded(path: Path, read: Any) -> Any:
    """What ``read`` gives; everything that scipy is known to raise at a damaged file becomes one clear error."""
    from scipy.io.matlab import MatReadError  # noqa: PLC0415

    damaged = (
        MatReadError, ValueError, TypeError, KeyError, IndexError, OSError, OverflowError, MemoryError, EOFError,
        NotImplementedError, AttributeError, zlib.error, struct.error,
    )  # fmt: skip
    try:
        return read()
    except damaged as error:
        raise BadInputError(f"{path}: the MATLAB file is damaged: {type(error).__name__}: {error}") from error


def _array(path: Path, found: dict[str, Any], name: str, shape: tuple[int, int]) -> FloatArray:
    value = found.get(name)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf" or value.shape != shape:
        raise BadInputError(f"{path}: {name} is no array of numbers of the shape {shape}")
    return np.ascontiguousarray(value, dtype=np.float64)


def _unit(path: Path, quaternions: FloatArray) -> FloatArray:
    """Normalised; NaN where a component is.

    Raises:
        BadInputError: one is far from a unit quaternion.
    """
    known = np.isfinite(quaternions).all(axis=1)
    length = np.sqrt(np.square(quaternions).sum(axis=1))
    if not known.any() or np.abs(length[known] - 1.0).max() > 0.01:
        raise BadInputError(f"{path}: opt_quat holds no unit quaternions")
    return np.where(known[:, np.newaxis], quaternions / length[:, np.newaxis], np.nan)


def _list(names: dict[str, Any]) -> str:
    return ", ".join(sorted(names)[:20]) or "none"
