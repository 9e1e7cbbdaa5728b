"""What a camera sees of the field: meshes and textures of ground, trees and signs.

All of it is for the eye. The shapes stand where the world has them (trunks, plates); crowns, colours and patterns are
choices, and nothing else knows of them. Patterns are fixed, not a part of the simulated world.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.signals import FloatArray, IntArray
from twin.stop_sign import octagon
from twin.world.orchard import BOTTOM, EAST, NORTH, RADIUS, TOP
from twin.world.signs import PLATE_E, PLATE_HEADING, PLATE_N, PLATE_SIZE, PLATE_U, POST_BOTTOM
from twin.world.terrain import Terrain

Rgb = tuple[float, float, float]
"""Display values of a colour, 0 to 255."""
Texture = NDArray[np.uint8]
"""(h, w, 3) RGB."""

SOIL: Rgb = (136.0, 106.0, 74.0)
GRASS: Rgb = (98.0, 122.0, 58.0)
GROUND_TILE_M = 2.0
"""The ground's texture repeats itself."""

_MOST_GROUND_VERTICES = 6_000
_TRUNK_SIDES = 10
CROWN_RADII = 8.0
"""Half width of a crown in radii of its trunk, as in the viewer's picture."""
_CROWN_RINGS, _CROWN_SIDES = 7, 10
_POST_RADIUS_SHARE = 0.05
"""Radius of a post, as a share of its plate."""
_PLATE_THICKNESS_SHARE = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Triangles, counter-clockwise from outside: the renderer does not draw their backs."""

    vertices: FloatArray
    """(V, 3) m."""
    normals: FloatArray
    """(V, 3) unit."""
    places: FloatArray
    """(V, 2) in the texture, which repeats itself: right and up in units of its size, not negative."""
    triangles: IntArray
    """(F, 3)."""


def together(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of several."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        normals=np.concatenate([mesh.normals for mesh in meshes]),
        places=np.concatenate([mesh.places for mesh in meshes]),
        triangles=np.concatenate([mesh.triangles + at for mesh, at in zip(meshes, first[:-1], strict=True)]),
    )


def ground_mesh(terrain: Terrain) -> Mesh:
    """The ground, as coarse as the number of vertices asks for."""
    rows, columns = terrain.heights.shape
    every = max(1, math.ceil(math.sqrt(rows * columns / _MOST_GROUND_VERTICES)))
    j = np.unique(np.append(np.arange(0, rows, every), rows - 1))
    i = np.unique(np.append(np.arange(0, columns, every), columns - 1))
    heights = terrain.heights[np.ix_(j, i)]
    east, north = terrain.west_m + i * terrain.cell_m, terrain.south_m + j * terrain.cell_m
    slope_n, slope_e = np.gradient(heights, north, east)
    x, y = np.meshgrid(east, north)
    normals = _unit(np.stack([-slope_e, -slope_n, np.ones_like(heights)], axis=-1).reshape(-1, 3))
    vertices = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    places = (vertices[:, :2] - [terrain.west_m, terrain.south_m]) / GROUND_TILE_M
    return Mesh(vertices=vertices, normals=normals, places=places, triangles=_grid(len(j), len(i)))


def trunk_mesh(trunk: FloatArray) -> Mesh:
    """The bark of a tree (TRUNK_COLUMNS,), open at both ends."""
    return _cylinder(trunk[EAST], trunk[NORTH], trunk[RADIUS], trunk[BOTTOM], trunk[TOP])


def crown_mesh(trunk: FloatArray, number: int) -> Mesh:
    """The leaves of a tree: an uneven ball on its trunk, of a shape that its number decides."""
    around = np.linspace(0.0, 2.0 * math.pi, _CROWN_SIDES + 1)
    up = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _CROWN_RINGS)
    level, lift = np.cos(up)[:, np.newaxis], np.sin(up)[:, np.newaxis]
    ball = np.stack([level * np.cos(around), level * np.sin(around), np.broadcast_to(lift, (len(up), len(around)))], -1)
    uneven = 1.0 + 0.12 * np.sin(3.0 * around + number) * level + 0.08 * np.sin(5.0 * up + 2.0 * number)[:, np.newaxis]
    half = CROWN_RADII * trunk[RADIUS]
    middle = np.array([trunk[EAST], trunk[NORTH], trunk[TOP] + 0.5 * half])
    vertices = middle + (ball * uneven[..., np.newaxis] * [half, half, 0.8 * half]).reshape(-1, 3)
    u, v = np.meshgrid(2.0 * around / math.pi + 0.37 * (number % 7), up + 0.5 * math.pi)
    places = np.stack([u, v], axis=-1).reshape(-1, 2)
    normals = _unit(ball.reshape(-1, 3))
    return Mesh(vertices=vertices, normals=normals, places=places, triangles=_grid(len(up), len(around)))


def plate_mesh(sign: FloatArray) -> Mesh:
    """Front of a sign's plate (SIGN_COLUMNS,), to carry the whole of :func:`twin.stop_sign.draw_plate`."""
    return _octagon(sign, forward_m=0.0, faces=1.0)


def backing_mesh(sign: FloatArray) -> Mesh:
    """What carries the front of a plate: its back, and the post below and behind it."""
    size, heading = sign[PLATE_SIZE], sign[PLATE_HEADING]
    radius, thickness = _POST_RADIUS_SHARE * size, _PLATE_THICKNESS_SHARE * size
    behind = radius + thickness
    east, north = sign[PLATE_E] - behind * math.cos(heading), sign[PLATE_N] - behind * math.sin(heading)
    post = _cylinder(east, north, radius, sign[POST_BOTTOM], sign[PLATE_U] + 0.4 * size)
    return together([_octagon(sign, forward_m=-thickness, faces=-1.0), post])


def _octagon(sign: FloatArray, *, forward_m: float, faces: float) -> Mesh:
    """An octagon parallel to the plate that is seen from the front (``faces`` 1) or the back (-1)."""
    size, heading = sign[PLATE_SIZE], sign[PLATE_HEADING]
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
    # To the right of who reads the plate, and up.
    right, up = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
    corners = octagon(size)
    middle = np.array([sign[PLATE_E], sign[PLATE_N], sign[PLATE_U]]) + forward_m * ahead
    order = np.array([[0, k, k + 1] for k in range(1, 7)])
    return Mesh(
        vertices=middle + corners[:, :1] * right + corners[:, 1:] * up,
        normals=np.tile(faces * ahead, (8, 1)),
        # Strictly inside: a place of 1 would be the other edge.
        places=0.5 + 0.998 * corners / size,
        triangles=order if faces > 0.0 else order[:, ::-1],
    )


def _cylinder(east: float, north: float, radius: float, bottom: float, top: float) -> Mesh:
    around = np.linspace(0.0, 2.0 * math.pi, _TRUNK_SIDES + 1)
    circle = np.column_stack([np.cos(around), np.sin(around), np.zeros_like(around)])
    heights = np.array([bottom, top])
    vertices = np.array([east, north, 0.0]) + np.concatenate([radius * circle + [0.0, 0.0, z] for z in heights])
    u, v = np.meshgrid(around / math.pi, (heights - bottom) / (4.0 * math.pi * radius))
    places = np.stack([u, v], axis=-1).reshape(-1, 2)
    normals = np.concatenate([circle, circle])
    return Mesh(vertices=vertices, normals=normals, places=places, triangles=_grid(2, len(around)))


def _grid(rows: int, columns: int) -> IntArray:
    """Triangles (F, 3) of a grid of vertices, counter-clockwise where columns go right and rows go up."""
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def _unit(vectors: FloatArray) -> FloatArray:
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


# --- textures --------------------------------------------------------------------------------------------------------


def ground_texture(soil: Rgb = SOIL, grass: Rgb = GRASS) -> Texture:
    """Soil with clods and patches of grass."""
    clods, patches = _clouds(1, 512, 0.7), _clouds(2, 512, 1.6)
    cover = np.clip(0.5 + 1.2 * patches + 0.5 * clods, 0.0, 1.0)[..., np.newaxis]
    return _texture((np.array(soil) * (1.0 - cover) + np.array(grass) * cover) * (1.0 + 0.22 * clods[..., np.newaxis]))


def bark_texture() -> Texture:
    """Brown, streaked upwards."""
    streaks = _clouds(3, 128, 0.8, stretch=6.0)
    return _texture(np.array([100.0, 76.0, 54.0]) * (1.0 + 0.35 * streaks[..., np.newaxis]))


def leaf_texture() -> Texture:
    """Greens, dark where one sees into the crown."""
    leaves = _clouds(4, 256, 0.6)[..., np.newaxis]
    return _texture(np.array([82.0, 122.0, 54.0]) * (1.0 + 0.45 * leaves))


def metal_texture() -> Texture:
    """Galvanised steel."""
    return _texture(np.full((8, 8, 3), 150.0))


def _clouds(number: int, size: int, falls: float, stretch: float = 1.0) -> FloatArray:
    """Noise (size, size) whose spectrum falls with frequency to a power, that repeats itself; mostly within +-1."""
    white = np.random.default_rng(number).standard_normal((size, size))
    upwards, across = np.fft.fftfreq(size)[:, np.newaxis] * stretch, np.fft.rfftfreq(size)[np.newaxis, :]
    frequency = np.hypot(upwards, across)
    frequency[0, 0] = np.inf
    tile = np.fft.irfft2(np.fft.rfft2(white) / frequency**falls, s=(size, size))
    clouds: FloatArray = np.clip(tile / (2.0 * tile.std()), -1.0, 1.0)
    return clouds


def _texture(values: FloatArray) -> Texture:
    return np.clip(np.round(values), 0.0, 255.0).astype(np.uint8)
