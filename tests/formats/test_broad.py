"""Trials of BROAD: what is read, and that files from anywhere are refused with a clear word."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from twin.errors import BadInputError
from twin.formats import broad
from twin.formats.broad import read_broad

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "broad"


def contents(samples: int = 20, **changes: Any) -> dict[str, Any]:
    quaternion = np.tile([0.6, 0.0, 0.0, 0.8], (samples, 1))
    quaternion[3] = np.nan
    whole = {
        "imu_acc": np.tile([0.1, 0.2, 9.8], (samples, 1)),
        "imu_gyr": np.full((samples, 3), 0.01),
        "imu_mag": np.tile([20.0, 0.0, -40.0], (samples, 1)),
        "opt_quat": quaternion,
        "movement": (np.arange(samples) >= 10).astype(np.uint8)[:, np.newaxis],
        "sampling_rate": np.array([[2000.0 / 7.0]]),
    }
    return {name: value for name, value in (whole | changes).items() if value is not None}


def write(folder: Path, *, compressed: bool = False, **changes: Any) -> Path:
    path = folder / "trial.mat"
    savemat(path, contents(**changes), do_compression=compressed)
    return path


@pytest.mark.parametrize("compressed", [False, True])
def test_a_trial_is_read_with_whole_nanoseconds_and_scalar_last_quaternions(compressed: bool, tmp_path: Path) -> None:
    trial = read_broad(write(tmp_path, compressed=compressed, info="text", cell=np.array([[1, "a"]], dtype=object)))
    assert trial.step_ns == 3_500_000
    assert trial.rate_hz == pytest.approx(285.714, abs=1e-3)
    np.testing.assert_allclose(trial.orientation[0], [0.0, 0.0, 0.8, 0.6])
    assert np.isnan(trial.orientation[3]).all()
    np.testing.assert_array_equal(trial.movement, np.arange(20) >= 10)
    np.testing.assert_allclose(trial.force_m_s2[0], [0.1, 0.2, 9.8])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"imu_mag": None}, "no numbers called imu_mag; found: imu_acc"),
        ({"imu_gyr": np.zeros((19, 3))}, r"imu_gyr has the shape \(19, 3\); allowed: \(20, 3\)"),
        ({"opt_quat": np.ones((20, 4))}, "no unit quaternions"),
        ({"imu_acc": np.full((20, 3), np.nan)}, "imu_acc holds values that are not numbers"),
        ({"imu_gyr": np.full((20, 3), 1e200)}, r"imu_gyr = 1e\+200; allowed: up to 1000"),
        ({"sampling_rate": np.array([[0.0]])}, "sampling_rate = 0 Hz; allowed: 1 to 10000"),
        ({"sampling_rate": np.array([[np.nan]])}, "sampling_rate = nan"),
        ({"movement": np.array([["a"]] * 20, dtype=object)}, "no numbers called movement"),
    ],
)
def test_what_is_no_trial_is_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=message):
        read_broad(write(tmp_path, **changes))


def test_other_versions_and_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.mat"
    for head, message in (
        (b"MATLAB 7.3 MAT-file", "version 7.3; save it with -v7"),
        (b"\x89HDF\r\n", "version 7.3"),
        (b"PK\x03\x04", "not a MATLAB file"),
        (b"", "not a MATLAB file"),
    ):
        path.write_bytes(head)
        with pytest.raises(BadInputError, match=message):
            read_broad(path)
    with pytest.raises(BadInputError, match="cannot be read"):
        read_broad(tmp_path / "none.mat")


@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_file_is_refused_wherever_it_is_cut_or_flipped(compressed: bool, tmp_path: Path) -> None:
    whole = write(tmp_path, compressed=compressed).read_bytes()
    damaged = tmp_path / "damaged.mat"
    rng = np.random.default_rng(1)
    for cut in rng.integers(128, len(whole) - 1, 30):
        damaged.write_bytes(whole[:cut])
        with pytest.raises(BadInputError):
            read_broad(damaged)
    for place in rng.integers(0, len(whole), 400):
        flipped = bytearray(whole)
        flipped[place] ^= 0xFF
        damaged.write_bytes(flipped)
        try:  # a flipped digit of a number may pass; nothing but a BadInputError may come out
            read_broad(damaged)
        except BadInputError:
            continue


def test_a_trial_of_one_sample_is_none(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="1 samples; allowed: 2 to"):
        read_broad(write(tmp_path, **{name: value[:1] for name, value in contents().items()}))


def test_size_is_looked_at_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path)
    monkeypatch.setattr(broad, "LARGEST_SAMPLES", 19)
    with pytest.raises(BadInputError, match="opt_quat has 80 elements; allowed: up to 76"):
        read_broad(path)
    monkeypatch.setattr(broad, "LARGEST_FILE_BYTES", 100)
    with pytest.raises(BadInputError, match="bytes; allowed: up to 100"):
        read_broad(path)


def test_nothing_is_unpacked_beyond_what_a_matrix_says_it_holds(tmp_path: Path) -> None:
    """A megabyte of zeros packed into a kilobyte behind the head of a small matrix is left packed."""
    whole = bytearray(write(tmp_path).read_bytes())
    kind, size = struct.unpack_from("<II", whole, 128)
    assert kind == 14
    matrix = bytes(whole[128 : 136 + size])
    packed = zlib.compress(matrix + bytes(10_000_000))
    bomb = tmp_path / "bomb.mat"
    rest = bytes(whole[136 + size :])
    bomb.write_bytes(bytes(whole[:128]) + struct.pack("<II", 15, len(packed)) + packed + rest)
    tracemalloc.start()
    trial = read_broad(bomb)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(trial.movement) == 20
    assert most < 1_000_000


@pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no recordings in {FOLDER}")
def test_scipy_reads_the_same_numbers_from_a_real_trial() -> None:
    path = next(iter(sorted(FOLDER.glob("*.mat"))))
    theirs, ours = loadmat(path), read_broad(path)
    np.testing.assert_array_equal(ours.force_m_s2, theirs["imu_acc"])
    np.testing.assert_array_equal(ours.field_ut, theirs["imu_mag"])
    np.testing.assert_array_equal(ours.movement, theirs["movement"][:, 0] != 0)
