"""Generated ground has the statistics it claims."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from twin.errors import BadInputError
from twin.world.spectrum import profile_psd_m3, rough_surface, surface_variance_m2
from twin.world.terrain import (
    FileTerrain,
    FlatTerrain,
    FurrowsTerrain,
    RoughTerrain,
    TerrainConfig,
    build_terrain,
)

EXTENT = (-50.0, -40.0, 50.0, 40.0)
BAND = (0.05, 2.5)


def profile_psd(heights: np.ndarray, cell_m: float, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """One-sided PSD of every profile along ``axis`` of a periodic surface, averaged over the others."""
    count = heights.shape[axis]
    spectrum = np.abs(np.fft.rfft(heights, axis=axis)) ** 2
    return np.fft.rfftfreq(count, cell_m), 2.0 * cell_m / count * spectrum.mean(axis=1 - axis)


@pytest.mark.parametrize("waviness", [1.5, 2.0, 2.5])
def test_profiles_have_the_stated_psd_along_both_axes(waviness: float) -> None:
    # Each wave of the lattice is an independent complex number whose power has a relative deviation of one; a band of
    # the profile's spectrum sums waves of weights S2, so its mean over M surfaces deviates by
    # sqrt(sum S2^2 / M) / sum S2. Four of those are allowed, and 4 % for the waves missing beyond n2 (for nx <= n2 / 4
    # that is 1 - sqrt(1 - 1/16) = 3.2 % with w = 2, 3.7 % with w = 1.5).
    cell, shape, band, surfaces = 0.2, (600, 800), (0.05, 1.25), 8
    drawn = [
        rough_surface(np.random.default_rng(s), shape=shape, cell_m=cell, psd_m3=256e-6, waviness=waviness,
                      band_cycles_m=band) for s in range(surfaces)
    ]  # fmt: skip
    lattice = np.meshgrid(*(np.fft.fftfreq(size, cell) for size in shape), indexing="ij")
    length = np.hypot(*lattice)
    weight = np.where((length >= band[0]) & (length <= band[1]), np.maximum(length, 1e-9) ** -(waviness + 1.0), 0.0)
    for axis in (0, 1):
        n, _ = profile_psd(drawn[0], cell, axis)
        psd = np.mean([profile_psd(heights, cell, axis)[1] for heights in drawn], axis=0)
        for low, high in ((0.05, 0.1), (0.1, 0.2), (0.2, 0.3125)):
            inside = (n > low - 1e-9) & (n < high - 1e-9)
            waves = weight[(lattice[axis] > low - 1e-9) & (lattice[axis] < high - 1e-9)]
            sigma = math.sqrt((waves**2).sum() / surfaces) / waves.sum()
            ratio = psd[inside].sum() / profile_psd_m3(n[inside], psd_m3=256e-6, waviness=waviness).sum()
            assert ratio == pytest.approx(1.0, abs=4.0 * sigma + 0.04)
            assert 4.0 * sigma < 0.25


def test_rms_equals_the_band_integral() -> None:
    # Profile waves between 0.1 and 0.6 cycles/m carry G_d(n0) n0^2 (1/0.1 - 1/0.6), class D; all waves of the surface
    # carry the integral of its two-dimensional spectrum.
    surfaces = [
        rough_surface(np.random.default_rng(s), shape=(800, 800), cell_m=0.1, psd_m3=1024e-6, waviness=2.0,
                      band_cycles_m=BAND) for s in range(6)
    ]  # fmt: skip
    total = np.mean([np.var(h) for h in surfaces])
    # About 6 x pi x 0.05^2 x 6400 = 300 waves in the lowest octave, which carries half the power: 5 % is 1.5 sigma of
    # the variance, 2.5 % of the RMS.
    assert math.sqrt(total / surface_variance_m2(psd_m3=1024e-6, waviness=2.0, band_cycles_m=BAND)) == pytest.approx(
        1.0, abs=0.06
    )
    analytic = 1024e-6 * 0.01 * (1.0 / 0.1 - 1.0 / 0.6)
    for axis in (0, 1):
        power = []
        for heights in surfaces:
            n, psd = profile_psd(heights, 0.1, axis)
            inside = (n > 0.1 - 0.00625) & (n < 0.6)
            power.append(psd[inside].sum() * (n[1] - n[0]))
        assert math.sqrt(np.mean(power) / analytic) == pytest.approx(1.0, abs=0.08)


def test_mean_slope_is_what_is_stated() -> None:
    for slope_percent in (0.0, 5.0):
        config = RoughTerrain(
            kind="rough", iso8608_class="E", slope_percent=slope_percent, slope_direction_deg=30.0, cell_m=0.2
        )
        ground = build_terrain(config, seed=4, extent=EXTENT)
        rows, columns = ground.heights.shape
        x, y = np.meshgrid(np.arange(columns) * 0.2, np.arange(rows) * 0.2)
        design = np.column_stack([np.ones(x.size), x.ravel(), y.ravel()])
        _, east, north = np.linalg.lstsq(design, ground.heights.ravel(), rcond=None)[0]
        wanted = slope_percent / 100.0 * np.array([math.cos(math.radians(30.0)), math.sin(math.radians(30.0))])
        assert np.array([east, north]) == pytest.approx(wanted, abs=1e-9)


def test_same_seed_same_ground_other_seed_other_ground() -> None:
    config = RoughTerrain(kind="rough")
    first, again, other = (build_terrain(config, seed=s, extent=EXTENT).heights for s in (1, 1, 2))
    assert np.array_equal(first, again)
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.2


def test_bilinear_height_and_gradient() -> None:
    ground = build_terrain(RoughTerrain(kind="rough", cell_m=0.25), seed=1, extent=EXTENT)
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-30.0, 30.0, (50, 2)):
        slope_e, slope_n = ground.gradient(x, y)
        step = 1e-6
        assert (ground.height(x + step, y) - ground.height(x - step, y)) / (2 * step) == pytest.approx(
            slope_e, abs=1e-4
        )
        assert (ground.height(x, y + step) - ground.height(x, y - step)) / (2 * step) == pytest.approx(
            slope_n, abs=1e-4
        )
    west, south, east, north = ground.extent
    assert west <= EXTENT[0]
    assert north >= EXTENT[3]
    assert ground.height(east, north) == pytest.approx(ground.heights[-1, -1], rel=1e-12)
    assert ground.height(west, south) == ground.heights[0, 0]
    with pytest.raises(BadInputError):
        ground.height(east + 0.1, north)


def test_furrows_have_their_period_and_depth() -> None:
    config = FurrowsTerrain(kind="furrows", psd_m3=1e-12, furrow_direction_deg=90.0, spacing_m=0.8, depth_m=0.1)
    ground = build_terrain(config, seed=1, extent=EXTENT)
    line = ground.heights[100]
    n = np.fft.rfftfreq(len(line), 0.1)
    assert n[np.argmax(np.abs(np.fft.rfft(line - line.mean())))] == pytest.approx(1.25, abs=0.02)
    assert np.ptp(line) == pytest.approx(0.1, rel=0.01)
    assert np.ptp(ground.heights[:, 100]) < 1e-4


def test_a_file_is_read_and_bad_files_are_bad_input(tmp_path: Path) -> None:
    heights = np.arange(12.0).reshape(3, 4)
    good = tmp_path / "field.npy"
    np.save(good, heights)
    ground = build_terrain(FileTerrain(kind="file", path=str(good), cell_m=1.0), seed=1, extent=EXTENT)
    assert np.array_equal(ground.heights, heights)
    assert ground.extent == (-1.5, -1.0, 1.5, 1.0)
    bad = {
        "nan": np.array([[1.0, np.nan], [0.0, 0.0]]),
        "line": np.zeros(5),
        "words": np.array([["a", "b"], ["c", "d"]]),
        "objects": np.array([[object(), 1], [2, 3]], dtype=object),
        "high": np.full((2, 2), 1e6),
    }
    for name, array in bad.items():
        path = tmp_path / f"{name}.npy"
        np.save(path, array)
        with pytest.raises(BadInputError, match=name):
            build_terrain(FileTerrain(kind="file", path=str(path)), seed=1, extent=EXTENT)
    (tmp_path / "text.npy").write_text("not an array")
    for name in ("text.npy", "missing.npy"):
        with pytest.raises(BadInputError, match=name):
            build_terrain(FileTerrain(kind="file", path=str(tmp_path / name)), seed=1, extent=EXTENT)


def test_absurd_sizes_are_refused_before_memory_is_taken() -> None:
    for size in ((1e9, 1e9), (10_000.0, 10_000.0), (1e300, 1.0)):
        with pytest.raises(BadInputError, match="cell_m"):
            build_terrain(FlatTerrain(kind="flat", size_m=size), seed=1, extent=EXTENT)


@pytest.mark.parametrize(
    "section",
    [
        {"kind": "rough", "iso8608_class": "F"},
        {"kind": "rough", "iso8608_class": "C", "psd_m3": 1e-4},
        {"kind": "rough", "highest_cycles_m": 50.0},
        {"kind": "slope"},
        {"kind": "flat", "cell_m": 0.0},
        {"kind": "flat", "slope_percent": float("nan")},
        {"kind": "hills"},
        {"kind": "furrows", "spacing_m": 0.2},
        {"kind": "flat", "size_m": [-1.0, 5.0]},
    ],
)
def test_impossible_sections_are_refused(section: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(TerrainConfig).validate_python(section)
