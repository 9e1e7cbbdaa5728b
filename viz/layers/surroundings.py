"""What stands and lies in the field: trees, stop signs, magnets and iron."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from twin.stop_sign import draw_plate
from twin.world.scenery import Mesh, backing_mesh, plate_mesh, together
from viz import entities
from viz.sheet import Run, Sheet

_BARK, _LEAVES = (104, 78, 54), (74, 118, 52)
_MAGNET, _IRON = (214, 48, 49), (110, 118, 128)
_STEEL = (150, 150, 150)
_PLATE_TEXELS = 256
_CROWN_RADII = 8.0
"""Half width of a crown in radii of its trunk; crowns are for the eye alone, nothing else knows of them."""
_LEAST_SHARE = 0.02
"""A magnet is drawn with at least this share of the machine's size, or a small one could not be seen."""


def draw_surroundings(run: Run, sheet: Sheet) -> None:
    """Draw trees with a crown each, stop signs, and magnets (red) and iron (grey) as balls."""
    _draw_trees(run, sheet)
    _draw_signs(run, sheet)
    smallest = _LEAST_SHARE * run.scene.machine_size_m
    for entity, pieces, colour in (
        (entities.MAGNETS, run.scene.magnets, _MAGNET),
        (entities.IRON, run.scene.iron, _IRON),
    ):
        if len(pieces):
            radii = np.maximum(pieces[:, 3], smallest)
            half = np.repeat(radii[:, np.newaxis], 3, axis=1)
            balls = rr.Ellipsoids3D(centers=pieces[:, :3], half_sizes=half, colors=[colour], fill_mode="solid")
            sheet.static(entity, balls)


def _draw_trees(run: Run, sheet: Sheet) -> None:
    trunks = run.scene.trunks
    if not len(trunks):
        return
    place, radius, bottom, top = trunks[:, :2], trunks[:, 2], trunks[:, 3], trunks[:, 4]
    sheet.static(
        entities.TRUNKS,
        rr.Cylinders3D(
            lengths=top - bottom,
            radii=radius,
            centers=np.column_stack([place, 0.5 * (top + bottom)]),
            colors=[_BARK],
            fill_mode="solid",
        ),
    )
    width = _CROWN_RADII * radius
    sheet.static(
        entities.CROWNS,
        rr.Ellipsoids3D(
            centers=np.column_stack([place, top + 0.5 * width]),
            half_sizes=np.column_stack([width, width, 0.8 * width]),
            colors=[_LEAVES],
            fill_mode="solid",
        ),
    )


def _draw_signs(run: Run, sheet: Sheet) -> None:
    signs = run.scene.signs
    if not len(signs):
        return
    sheet.static(entities.PLATES, _mesh(together([plate_mesh(sign) for sign in signs]), draw_plate(_PLATE_TEXELS)))
    sheet.static(entities.POSTS, _mesh(together([backing_mesh(sign) for sign in signs]), None))


def _mesh(mesh: Mesh, texture: NDArray[np.uint8] | None) -> rr.Mesh3D:
    # The viewer counts places in a texture from its top.
    places = mesh.places * [1.0, -1.0] + [0.0, 1.0]
    return rr.Mesh3D(
        vertex_positions=mesh.vertices.astype(np.float32),
        vertex_normals=mesh.normals.astype(np.float32),
        triangle_indices=mesh.triangles.astype(np.uint32),
        vertex_texcoords=None if texture is None else places.astype(np.float32),
        albedo_texture=texture,
        albedo_factor=_STEEL if texture is None else None,
    )
