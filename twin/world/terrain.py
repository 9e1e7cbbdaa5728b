"""Ground: one height array, and the ways to make one.

Between the grid's nodes the height is bilinear. Cells of 0.1 m carry waves down to 0.4 m well, which is about the
length of a tractor tyre's contact patch; shorter ones the tyre swallows anyway (``twin.world.tyres``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, Strict, model_validator

from twin.config import Config, Positive
from twin.errors import BadInputError
from twin.randomness import world_generator
from twin.signals import FloatArray
from twin.world.spectrum import rough_surface

LARGEST_CELLS = 8_000_000
"""At most 64 MB of heights (and about four times that while a rough surface is being drawn)."""
HIGHEST_M = 1_000.0
MARGIN_M = 5.0
"""Ground around what the machine needs, where no size is configured."""
DEFAULT_LOWEST_CYCLES_M = 0.05
"""Lower limit of off-road roughness after the notes to ISO 8608: a wave of 20 m."""
CELLS_PER_SHORTEST_WAVE = 4.0

Iso8608Class = Literal["A", "B", "C", "D", "E"]
ISO8608_PSD_M3: dict[Iso8608Class, float] = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}
"""Geometric means of G_d(0.1 cycles/m), m^3 (ISO 8608)."""

Extent = tuple[float, float, float, float]
"""West, south, east and north limit, m."""
Pair = Annotated[tuple[float, float], Strict(strict=False)]


@dataclass(slots=True)
class Terrain:
    """Heights on a grid: ``heights[j, i]`` lies at east ``west_m + i cell_m``, north ``south_m + j cell_m``.

    The array belongs to this object and may be changed in place (a blade cuts soil): everything that touches the
    ground reads it directly.
    """

    heights: FloatArray
    west_m: float
    south_m: float
    cell_m: float

    @property
    def extent(self) -> Extent:
        """West, south, east and north limit, m."""
        rows, columns = self.heights.shape
        east = self.west_m + (columns - 1) * self.cell_m
        return self.west_m, self.south_m, east, self.south_m + (rows - 1) * self.cell_m

    def contains(self, east_m: float, north_m: float) -> bool:
        """Tell whether a point lies on the terrain."""
        west, south, east, north = self.extent
        return west <= east_m <= east and south <= north_m <= north

    def height(self, east_m: float, north_m: float) -> float:
        """Bilinear height of a point, m.

        Raises:
            BadInputError: the point is off the terrain.
        """
        return self._cell(east_m, north_m)[0]

    def gradient(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Slope towards east and north at a point (rise per run).

        Raises:
            BadInputError: the point is off the terrain.
        """
        return self._cell(east_m, north_m)[1:]

    def _cell(self, east_m: float, north_m: float) -> tuple[float, float, float]:
        if not self.contains(east_m, north_m):
            raise BadInputError(f"({east_m:.1f}, {north_m:.1f}) m is off the terrain, which is {self.extent}")
        rows, columns = self.heights.shape
        x = (east_m - self.west_m) / self.cell_m
        y = (north_m - self.south_m) / self.cell_m
        i, j = min(int(x), columns - 2), min(int(y), rows - 2)
        u, v = x - i, y - j
        (a, b), (c, d) = self.heights[j : j + 2, i : i + 2].tolist()
        south, north = a + u * (b - a), c + u * (d - c)
        slope_east = ((b - a) * (1.0 - v) + (d - c) * v) / self.cell_m
        return south + v * (north - south), slope_east, (north - south) / self.cell_m


class _Ground(Config):
    cell_m: Annotated[float, Field(ge=0.01, le=5.0)] = 0.1
    """Grid pitch."""
    size_m: Annotated[tuple[Positive, Positive], Strict(strict=False)] | None = None
    """Size towards east and north; if not given, what the planned path needs."""
    centre_m: Pair = (0.0, 0.0)
    """East and north of the middle, when a size is given."""
    slope_percent: Annotated[float, Field(ge=0.0, le=200.0)] = 0.0
    """Mean slope: rise per run."""
    slope_direction_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0
    """Which way is uphill, counter-clockwise from east."""

    def extent(self, wanted: Extent) -> Extent:
        """Limits of the terrain: its own size if it has one, else what is wanted."""
        if self.size_m is None:
            return wanted
        (east, north), (width, depth) = self.centre_m, self.size_m
        return east - width / 2.0, north - depth / 2.0, east + width / 2.0, north + depth / 2.0


class FlatTerrain(_Ground):
    """A plane (level unless ``slope_percent`` is given)."""

    kind: Literal["flat"]


class SlopeTerrain(_Ground):
    """A plane that rises one way."""

    kind: Literal["slope"]
    slope_percent: Annotated[float, Field(gt=0.0, le=200.0)]
    """Mean slope: rise per run."""


class _Rough(_Ground):
    iso8608_class: Iso8608Class | None = None
    """Roughness class, a road or field's G_d(0.1 cycles/m) with w = 2; class C if nothing is given."""
    psd_m3: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """One-sided profile PSD at 0.1 cycles/m, instead of a class."""
    psd_slope: Annotated[float, Field(gt=1.0, lt=4.0)] = 2.0
    """Waviness w: the PSD falls with n to the power -w."""
    lowest_cycles_m: Annotated[float, Field(ge=0.005, le=5.0)] = DEFAULT_LOWEST_CYCLES_M
    """Lower band limit."""
    highest_cycles_m: Positive | None = None
    """Upper band limit; if not given, what the grid carries (a wave of four cells)."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.iso8608_class is not None and self.psd_m3 is not None:
            raise ValueError("give iso8608_class or psd_m3, not both")
        low, high = self.band_cycles_m
        if high > 0.5 / self.cell_m:
            raise ValueError(f"highest_cycles_m = {high:g} is more than cells of {self.cell_m:g} m carry")
        if low >= high:
            raise ValueError(f"lowest_cycles_m = {low:g} has to be less than highest_cycles_m = {high:g}")
        return self

    @property
    def band_cycles_m(self) -> tuple[float, float]:
        """Band limits of the surface's waves, cycles/m."""
        high = self.highest_cycles_m
        return self.lowest_cycles_m, 1.0 / (CELLS_PER_SHORTEST_WAVE * self.cell_m) if high is None else high

    @property
    def profile_psd_m3(self) -> float:
        """G_d(0.1 cycles/m), m^3."""
        return self.psd_m3 if self.psd_m3 is not None else ISO8608_PSD_M3[self.iso8608_class or "C"]


class RoughTerrain(_Rough):
    """Random ground of a given roughness; its mean plane is what ``slope_percent`` says."""

    kind: Literal["rough"]


class FurrowsTerrain(_Rough):
    """Tilled ground: parallel furrows, and random roughness on top (class B if nothing is given)."""

    kind: Literal["furrows"]
    spacing_m: Annotated[float, Field(gt=0.0, le=20.0)] = 0.75
    """Distance from furrow to furrow."""
    depth_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.06
    """From ridge to furrow."""
    furrow_direction_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0
    """Which way the furrows run, counter-clockwise from east."""

    @model_validator(mode="after")
    def _resolved(self) -> Self:
        if self.spacing_m < CELLS_PER_SHORTEST_WAVE * self.cell_m:
            raise ValueError(f"spacing_m = {self.spacing_m:g} needs at least four cells of cell_m = {self.cell_m:g}")
        return self

    @property
    def profile_psd_m3(self) -> float:
        """G_d(0.1 cycles/m), m^3."""
        return self.psd_m3 if self.psd_m3 is not None else ISO8608_PSD_M3[self.iso8608_class or "B"]


class FileTerrain(Config):
    """Heights from a .npy file: a two-dimensional array of numbers, rows from south to north, metres."""

    kind: Literal["file"]
    path: str
    """The .npy file, beside the scenario file."""
    cell_m: Annotated[float, Field(ge=0.01, le=5.0)] = 0.1
    """Grid pitch of the array."""
    centre_m: Pair = (0.0, 0.0)
    """East and north of the array's middle."""


TerrainConfig = Annotated[
    FlatTerrain | SlopeTerrain | RoughTerrain | FurrowsTerrain | FileTerrain, Field(discriminator="kind")
]
AnyTerrain = FlatTerrain | SlopeTerrain | RoughTerrain | FurrowsTerrain | FileTerrain


def wanted_extent(path: FloatArray, reach_m: float) -> Extent:
    """Limits that hold a machine, no part of which is farther than ``reach_m`` from its path (N, 2), with a margin."""
    west, south = path[:, :2].min(axis=0) - reach_m - MARGIN_M
    east, north = path[:, :2].max(axis=0) + reach_m + MARGIN_M
    return float(west), float(south), float(east), float(north)


def build_terrain(config: AnyTerrain, *, seed: int, extent: Extent) -> Terrain:
    """Make the ground: ``extent`` (west, south, east, north) is what has to be covered if no size is configured.

    Raises:
        BadInputError: the terrain would need absurd memory, or its file cannot be used.
    """
    if isinstance(config, FileTerrain):
        return _from_file(config)
    west, south, east, north = config.extent(extent)
    columns, rows = (_nodes(span, config.cell_m) for span in (east - west, north - south))
    if rows * columns > LARGEST_CELLS:
        raise BadInputError(
            f"terrain of {east - west:.0f} m x {north - south:.0f} m with cell_m = {config.cell_m:g} has"
            f" {rows * columns:.3g} cells; at most {LARGEST_CELLS:.3g} are allowed: choose a larger cell_m"
        )
    x: FloatArray = west + config.cell_m * np.arange(columns, dtype=np.float64) - 0.5 * (west + east)
    y: FloatArray = south + config.cell_m * np.arange(rows, dtype=np.float64) - 0.5 * (south + north)
    heights = _plane(x, y, config.slope_percent, config.slope_direction_deg)
    if isinstance(config, _Rough):
        heights += _roughness(config, seed, (rows, columns), x, y)
    if isinstance(config, FurrowsTerrain):
        angle = math.radians(config.furrow_direction_deg)
        across = math.cos(angle) * y[:, np.newaxis] - math.sin(angle) * x[np.newaxis, :]
        heights += 0.5 * config.depth_m * np.cos(2.0 * math.pi / config.spacing_m * across)
    return Terrain(heights, west, south, config.cell_m)


def _nodes(span_m: float, cell_m: float) -> int:
    cells = span_m / cell_m
    if not math.isfinite(cells) or cells > LARGEST_CELLS:
        raise BadInputError(f"terrain {span_m:.3g} m long with cell_m = {cell_m:g} is larger than memory allows")
    return max(1, math.ceil(cells - 1e-9)) + 1


def _plane(x: FloatArray, y: FloatArray, slope_percent: float, direction_deg: float) -> FloatArray:
    slope, angle = slope_percent / 100.0, math.radians(direction_deg)
    plane: FloatArray = slope * (math.cos(angle) * x[np.newaxis, :] + math.sin(angle) * y[:, np.newaxis])
    return plane


def _roughness(config: _Rough, seed: int, shape: tuple[int, int], x: FloatArray, y: FloatArray) -> FloatArray:
    surface = rough_surface(
        world_generator(seed, "terrain"),
        shape=shape,
        cell_m=config.cell_m,
        psd_m3=config.profile_psd_m3,
        waviness=config.psd_slope,
        band_cycles_m=config.band_cycles_m,
    )
    # Least-squares plane of a full grid: the coordinates are uncorrelated, so each slope stands alone.
    x, y = np.subtract(x, x.mean()), np.subtract(y, y.mean())
    surface -= surface.mean()
    surface -= (surface.mean(axis=0) @ x) / (x @ x) * x[np.newaxis, :]
    surface -= ((surface.mean(axis=1) @ y) / (y @ y) * y)[:, np.newaxis]
    return surface


def _from_file(config: FileTerrain) -> Terrain:
    path = Path(config.path)
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise BadInputError(f"terrain.path {path}: cannot be read as a .npy array ({error})") from error
    if not isinstance(array, np.ndarray) or array.ndim != 2 or min(array.shape) < 2 or array.dtype.kind not in "iuf":
        raise BadInputError(f"terrain.path {path}: expected a two-dimensional array of numbers, at least 2 x 2")
    if array.size > LARGEST_CELLS:
        raise BadInputError(f"terrain.path {path}: {array.size:.3g} cells; at most {LARGEST_CELLS:.3g} are allowed")
    heights = np.array(array, dtype=np.float64, order="C")
    if not np.all(np.abs(heights) <= HIGHEST_M):
        raise BadInputError(f"terrain.path {path}: heights have to be finite and within {HIGHEST_M:g} m")
    rows, columns = heights.shape
    west = config.centre_m[0] - 0.5 * (columns - 1) * config.cell_m
    return Terrain(heights, west, config.centre_m[1] - 0.5 * (rows - 1) * config.cell_m, config.cell_m)
