"""The laser receiver's levels, one by one, and what bends or misses its beam."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import Log, Motion, constant, drive, preset, sensor
from twin.geometry import rotation_from_rpy
from twin.sensors.laser_receiver import level
from twin.signals import FloatArray, MountMotion

TABLE_1 = [
    (0, -1.5, 1.5),
    (3, 1.5, 4.5),
    (6, 4.5, 7.5),
    (9, 7.5, 10.5),
    (12, 10.5, 13.5),
    (15, 13.5, 16.5),
    (18, 16.5, 19.5),
    (21, 19.5, 32.5),
    (33, 32.5, 33.5),
    (45, 33.5, 62.5),
    (63, 62.5, 63.5),
    (81, 63.5, 84.5),
]
"""Paper 002, table 1: level, from, to (mm)."""


def at(height_m: float, *, roll_rad: float = 0.0) -> Motion:
    """A mast that stands at one height."""
    still = constant(0.0)

    def motion(t0: float, t1: float) -> MountMotion:
        capture = still(t0, t1)
        object.__setattr__(capture, "position_enu_m", np.array([0.0, 0.0, height_m]))
        object.__setattr__(capture, "rotation", rotation_from_rpy(roll_rad, 0.0, 0.0))
        return capture

    return motion


def log_at(height_m: float, *, runs: int = 1, until_s: float = 0.1, roll_rad: float = 0.0, **more: Any) -> Log:
    config = {"kind": "laser_receiver", "rate_hz": 10.0} | more
    return drive(sensor(config, runs=range(runs)), at(height_m, roll_rad=roll_rad), until_s)


def said(height_m: float, **more: Any) -> float:
    return float(log_at(height_m, **more).values("height_level_m")[0, 0])


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("name", "begin", "end"), TABLE_1)
def test_every_level_has_its_range(name: int, begin: float, end: float, side: int) -> None:
    for height_mm in (begin + 1e-6, 0.5 * (begin + end), end - 1e-6):
        assert said(side * 1e-3 * height_mm) == pytest.approx(side * 1e-3 * name, abs=1e-12)


def test_there_are_23_levels_and_no_others() -> None:
    heights: FloatArray = np.linspace(-0.0845, 0.0845, 16901)
    given = level(heights, outermost=False)
    assert np.isfinite(given).all()
    expected = sorted({side * name for name, _, _ in TABLE_1 for side in (-1, 1)})
    np.testing.assert_allclose(np.unique(given) * 1e3, expected, atol=1e-9)
    assert len(expected) == 23
    assert not np.signbit(level(np.array([-0.001]), outermost=False))[0]


def test_beyond_its_cells_it_says_nothing_or_the_outermost_level() -> None:
    for height in (0.0846, 3.0, -0.0846, -3.0):
        assert np.isnan(said(height))
        assert said(height, beyond_range="outermost") == pytest.approx(np.copysign(0.081, height))


def test_height_is_above_the_plane() -> None:
    assert said(12.309, plane_height_m=12.3) == pytest.approx(0.009)
    assert said(12.291, plane_height_m=12.3) == pytest.approx(-0.009)
    log = log_at(12.31, plane_height_m=12.3)
    assert log.hidden("height_level_m.error")[0, 0] == pytest.approx(0.009 - 0.010)


def test_a_leaning_mast_stretches_the_height() -> None:
    # 32 mm has level 21; along cells that lean by 0.25 rad it is 33.03 mm: level 33.
    assert said(0.032) == pytest.approx(0.021)
    assert said(0.032, roll_rad=0.25) == pytest.approx(0.033)
    for beyond in ("none", "outermost"):
        assert np.isnan(said(0.032, roll_rad=3.0, beyond_range=beyond))


def test_the_plane_is_off_by_its_sigma_and_the_beam_wanders() -> None:
    log = log_at(0.0, runs=2000, plane_sigma_m=0.002)
    # 2000 runs: 1.6 %. A plane that is too high makes the receiver seem too low.
    assert np.std(log.hidden("height_level_m.bias")) == pytest.approx(0.002, rel=4 * 0.016)
    # Right at a limit, a symmetric error gives either side half of the times: 2000 samples, 1.1 %.
    log = log_at(0.0015, runs=100, until_s=2.0, noise_m=0.0005)
    given = log.values("height_level_m")
    assert np.mean(given > 0.0015) == pytest.approx(0.5, abs=4 * 0.011)
    assert set(np.unique(np.round(given * 1e3))) == {0.0, 3.0}


def test_the_owner_knows_plane_and_table() -> None:
    sheet = sensor(preset("laser_lr4009") | {"plane_height_m": 4.2}).info.datasheet
    assert sheet["plane_height_m"] == 4.2
    told = [(sheet[f"level_{k}_m"] * 1e3, sheet[f"level_{k}_to_m"] * 1e3) for k in range(12)]
    np.testing.assert_allclose(told, [(name, end) for name, _, end in TABLE_1], atol=1e-9)
    assert sheet["range_m"] == pytest.approx(0.0845)
