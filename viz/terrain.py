"""The ground as a mesh that shows its shape and the machine's motion over it.

The mesh is as coarse as the eye allows; what is finer (roughness, clods) is painted: a texture with relief shading,
baked at a fixed sun with the heights exaggerated, since the slopes of farm land are a few per cent, and a mottled soil
whose pattern is fixed to the ground, so that driving over it can be seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.signals import FloatArray
from viz.scene import Scene

MARGIN_M = 25.0
MAX_VERTICES = 40_000
MAX_TEXELS = 900_000
TEXEL_M = 0.11
GRID_M = 10.0

_EXAGGERATION = 5.0
_SUN = np.array([-0.55, 0.45, 0.70])
_TILE = 256
_SUNK_M = 1.0
"""How much deeper the mesh lies in a hole: below all that a blade cuts."""
_SOIL = (np.array([112.0, 88.0, 60.0]), np.array([150.0, 122.0, 84.0]), np.array([104.0, 122.0, 58.0]))
_ASPHALT = (np.array([92.0, 93.0, 96.0]), np.array([116.0, 117.0, 119.0]), np.array([100.0, 101.0, 104.0]))
"""Colours of what lies low (damp), of what lies high (dry), and of what grows, or has been mended, in patches."""

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TerrainMesh:
    """A textured triangle mesh."""

    vertices: NDArray[np.float32]
    """(V, 3) m."""
    normals: NDArray[np.float32]
    """(V, 3) unit."""
    texture_coordinates: NDArray[np.float32]
    """(V, 2) in [0, 1]."""
    triangles: NDArray[np.uint32]
    """(F, 3), counter-clockwise from above."""
    texture: Image
    """(h, w, 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Part of the height array: half-open ranges of rows and columns."""

    rows: tuple[int, int]
    columns: tuple[int, int]


def window_around(scene: Scene, points: FloatArray, margin_m: float = MARGIN_M) -> Window:
    """Part of the ground that holds the points (N, 2) and a margin; all of it if there are no finite points."""
    ny, nx = scene.heights.shape
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return Window(rows=(0, ny), columns=(0, nx))
    low = (points.min(axis=0) - margin_m - scene.origin_m) / scene.cell_m
    high = (points.max(axis=0) + margin_m - scene.origin_m) / scene.cell_m

    def clip(first: float, last: float, count: int) -> tuple[int, int]:
        start = min(max(math.floor(first), 0), count - 2)
        return start, max(min(math.ceil(last) + 1, count), start + 2)

    return Window(rows=clip(low[1], high[1], ny), columns=clip(low[0], high[0], nx))


def terrain_mesh(
    scene: Scene, window: Window, *, hole: Window | None = None, max_vertices: int = MAX_VERTICES
) -> TerrainMesh:
    """Build the mesh of a part of the ground, of about ``max_vertices`` vertices at most.

    In the hole, whose edges are edges of the mesh, it lies deeper: there something else is drawn.
    """
    rows, columns = _every(window.rows, window.columns, max_vertices)
    if hole is not None:
        rows, columns = _with_ends(rows, hole.rows), _with_ends(columns, hole.columns)
    heights = scene.heights[np.ix_(rows, columns)]
    if hole is not None:
        inside = [(nodes > first) & (nodes < end - 1) for nodes, (first, end) in
                  ((rows, hole.rows), (columns, hole.columns))]  # fmt: skip
        heights = heights - _SUNK_M * np.outer(*inside)
    east, north = _places(scene, rows, columns)
    slope_n, slope_e = np.gradient(heights, north, east)
    ny, nx = heights.shape
    shape = (ny, nx)
    vertices = np.stack([np.broadcast_to(east, shape), np.broadcast_to(north[:, np.newaxis], shape), heights], axis=-1)
    normals = _unit(np.stack([-slope_e, -slope_n, np.ones(shape)], axis=-1))
    u = (columns - columns[0]) / (columns[-1] - columns[0])
    v = (rows - rows[0]) / (rows[-1] - rows[0])
    coordinates = np.stack([np.broadcast_to(u, shape), np.broadcast_to(v[:, np.newaxis], shape)], axis=-1)
    return TerrainMesh(
        vertices=vertices.reshape(-1, 3).astype(np.float32),
        normals=normals.reshape(-1, 3).astype(np.float32),
        texture_coordinates=coordinates.reshape(-1, 2).astype(np.float32),
        triangles=_triangles(ny, nx),
        texture=_texture(scene, window),
    )


def grid_spacing_m(scene: Scene) -> float:
    """Distance of grid lines that suits the machine: ten metres, or one for a bench or a machine of less than two."""
    return GRID_M if scene.scale > 1.0 / 3.0 and not scene.bench else GRID_M / 10.0


def grid_lines(scene: Scene, window: Window, spacing_m: float = GRID_M) -> list[FloatArray]:
    """Lines every ``spacing_m`` of east and north, draped on the ground: a scale for the eye. Each (K, 3)."""
    (r0, r1), (c0, c1) = window.rows, window.columns
    step = max(1, round(1.0 / scene.cell_m))
    east, north = _places(scene, np.arange(r0, r1, step), np.arange(c0, c1, step))

    def draped(e: FloatArray, n: FloatArray) -> FloatArray:
        return np.stack([e, n, scene.height_at(e, n) + 0.02], axis=-1)

    def whole(values: FloatArray) -> FloatArray:
        return np.arange(math.ceil(values[0] / spacing_m), math.floor(values[-1] / spacing_m) + 1) * spacing_m

    lines = [draped(np.full_like(north, e), north) for e in whole(east)]
    return lines + [draped(east, np.full_like(east, n)) for n in whole(north)]


def _places(scene: Scene, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """East of columns and north of rows, m."""
    east: FloatArray = np.asarray(scene.origin_m[0] + columns * scene.cell_m, dtype=np.float64)
    north: FloatArray = np.asarray(scene.origin_m[1] + rows * scene.cell_m, dtype=np.float64)
    return east, north


def _every(rows: tuple[int, int], columns: tuple[int, int], budget: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pick rows and columns of the window, evenly, so that their product keeps within ``budget``; ends included."""
    count = (rows[1] - rows[0]) * (columns[1] - columns[0])
    share = min(1.0, math.sqrt(budget / count))
    picked = []
    for first, last in (rows, columns):
        n = max(2, math.floor((last - first) * share))
        picked.append(np.linspace(first, last - 1, n).round().astype(np.int64))
    return picked[0], picked[1]


def _with_ends(picked: NDArray[np.int64], span: tuple[int, int]) -> NDArray[np.int64]:
    """Picked rows or columns, with both ends of a half-open range that lie among them."""
    ends = np.array([end for end in (span[0], span[1] - 1) if picked[0] <= end <= picked[-1]], dtype=np.int64)
    return np.union1d(picked, ends)


def _triangles(ny: int, nx: int) -> NDArray[np.uint32]:
    corner = np.arange(ny * nx, dtype=np.uint32).reshape(ny, nx)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    return np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)


def _unit(vectors: FloatArray) -> FloatArray:
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def _texture(scene: Scene, window: Window) -> Image:
    """Paint the ground: colour by height and slope, relief, and mottling finer than the height array."""
    rows, columns = _every(window.rows, window.columns, MAX_TEXELS)
    heights = scene.heights[np.ix_(rows, columns)].astype(np.float32)
    east, north = _places(scene, rows, columns)
    slope_n, slope_e = np.gradient(heights, north.astype(np.float32), east.astype(np.float32))
    texel_m = TEXEL_M * scene.scale
    fine = _refinement(heights.shape, (east[-1] - east[0]) / len(east), texel_m)
    mottle = _mottle(_between(north, fine), _between(east, fine), texel_m)

    def refined(values: Any) -> Any:
        return values.repeat(fine, axis=0).repeat(fine, axis=1)

    low, high = np.percentile(heights[::8, ::8], [5.0, 95.0])
    dry = np.clip((heights - low) / max(high - low, 0.2), 0.0, 1.0)
    green = np.clip(0.35 + 0.8 * mottle + refined(2.0 * np.hypot(slope_e, slope_n)), 0.0, 1.0)
    shade = refined(_relief(slope_e, slope_n)) * (1.0 + 0.3 * mottle)
    low_colour, high_colour, patches = _ASPHALT if scene.paved else _SOIL
    image = np.empty((*mottle.shape, 3), dtype=np.uint8)
    for channel in range(3):
        soil = refined(low_colour[channel] + (high_colour[channel] - low_colour[channel]) * dry)
        soil += (patches[channel] - soil) * (0.55 * green)
        image[..., channel] = np.clip(soil * shade, 0.0, 255.0)
    return image


def _relief(slope_e: Any, slope_n: Any) -> Any:
    """Light on the ground relative to level ground, with the slopes exaggerated."""
    sun = (_SUN / np.linalg.norm(_SUN)).tolist()
    up = np.sqrt(1.0 + _EXAGGERATION**2 * (slope_e**2 + slope_n**2))
    return np.clip((sun[2] - _EXAGGERATION * (sun[0] * slope_e + sun[1] * slope_n)) / up / sun[2], 0.55, 1.35)


def _refinement(shape: tuple[int, ...], cell_m: float, texel_m: float) -> int:
    """Texels per height in each direction: to ``texel_m`` if the budget allows."""
    wanted = round(cell_m / texel_m)
    return max(1, min(wanted, int(math.sqrt(MAX_TEXELS / (shape[0] * shape[1])))))


def _between(places: FloatArray, fine: int) -> FloatArray:
    """Centres of the ``fine`` texels around each place."""
    step = (places[-1] - places[0]) / (len(places) - 1)
    offsets = ((np.arange(fine) + 0.5) / fine - 0.5) * step
    between: FloatArray = (places[:, np.newaxis] + offsets).ravel()
    return between


def _mottle(north: FloatArray, east: FloatArray, texel_m: float) -> Any:
    """Clods and patches, about -1 to 1: one tile of 1/f noise laid at two scales, fixed to the ground."""
    frequency = np.hypot(np.fft.fftfreq(_TILE)[:, np.newaxis], np.fft.rfftfreq(_TILE)[np.newaxis, :])
    frequency[0, 0] = np.inf
    white = np.random.default_rng(1).standard_normal((_TILE, _TILE))  # a pattern, not a part of the simulated world
    tile = np.fft.irfft2(np.fft.rfft2(white) / frequency**0.8, s=(_TILE, _TILE))
    tile = (tile / (2.5 * tile.std())).astype(np.float32)
    pattern = np.float32(0.0)
    for size_m, weight in ((texel_m, 0.6), (9.0 * texel_m, 0.4)):
        rows = (north / size_m).round().astype(np.int64) % _TILE
        columns = (east / size_m).round().astype(np.int64) % _TILE
        pattern = pattern + np.float32(weight) * tile[np.ix_(rows, columns)]
    return pattern
