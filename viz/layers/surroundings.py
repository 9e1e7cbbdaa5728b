"""What stands and lies in the field: trees, stop signs, magnets and iron."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from twin.geometry import quaternion_from_rpy
from twin.signals import FloatArray, IntArray
from twin.stop_sign import draw_plate
from twin.world.scenery import CROWN_RADII, Mesh, backing_mesh, plate_mesh, together
from viz import entities
from viz.magnetic import FELT_SHARE, STRONG_SHARE, MagneticPieces, reach_m
from viz.sheet import Run, Sheet
from viz.thinning import changes

_BARK, _LEAVES = (104, 78, 54), (74, 118, 52)
_STEEL = (150, 150, 150)
_PLATE_TEXELS = 256
_NORTH_POLE, _SOUTH_POLE, _IRON = (226, 48, 49), (58, 110, 235), (110, 118, 128)
_BAR = np.array([0.5, 0.35, 0.35])
"""Half sizes of each pole of a bar, in radii of the magnet."""
_STEPS = 8
"""Of a magnet's share that are drawn while it comes and goes."""
_AZIMUTHS, _RINGS, _LIFT_M = 72, 8, 0.03
"""Of a disc on the ground, and how far above it, times the scale of the scene."""
_LEAST_SHARE = 0.02
"""A magnet is drawn with at least this share of the machine's size, or a small one could not be seen."""


def draw_surroundings(run: Run, sheet: Sheet) -> None:
    """Draw trees with a crown each, stop signs, magnets as bars (red where the moment points to), iron as balls."""
    _draw_trees(run, sheet)
    _draw_signs(run, sheet)
    pieces, smallest = run.scene.magnetic, _LEAST_SHARE * run.scene.machine_size_m
    if len(pieces.iron):
        half = np.repeat(np.maximum(pieces.iron[:, 3:], smallest), 3, axis=1)
        balls = rr.Ellipsoids3D(centers=pieces.iron[:, :3], half_sizes=half, colors=[_IRON], fill_mode="solid")
        sheet.static(entities.IRON, balls)
    for index in range(len(pieces.magnets)):
        _draw_magnet(sheet, pieces, index, smallest=smallest)
    for index in range(pieces.count):
        _draw_reach(run, sheet, pieces, index)


def presence(pieces: MagneticPieces, index: int) -> tuple[IntArray, FloatArray]:
    """Times (T,) at which a piece is drawn anew, the first being 0, and the share (T,) of its moment from then on."""
    if index >= len(pieces.magnets):
        return np.zeros(1, dtype=np.int64), np.ones(1)
    share = np.round(pieces.shares[:, index] * _STEPS) / _STEPS
    at = changes(share)
    return pieces.share_t_ns[at], share[at]


def _draw_magnet(sheet: Sheet, pieces: MagneticPieces, index: int, *, smallest: float) -> None:
    """Draw a bar of the magnet's size along its moment, smaller while it comes and goes, none while it is away."""
    t_ns, shares = presence(pieces, index)
    place, radius, moment = pieces.magnets[index, :3], pieces.magnets[index, 3], pieces.moments_a_m2[index]
    length = float(np.linalg.norm(moment))
    along = moment / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
    bars = np.array([max(radius, smallest) * share for share in shares if share > 0.0])[:, np.newaxis, np.newaxis]
    centers = place + np.array([[0.5], [-0.5]]) * along * bars
    half = bars * np.tile(_BAR, (2, 1))
    there = len(bars)
    columns = rr.Boxes3D.columns(
        centers=centers.reshape(-1, 3),
        half_sizes=half.reshape(-1, 3),
        quaternions=np.tile(_turn_x_to(along), (2 * there, 1)),
        colors=[_NORTH_POLE, _SOUTH_POLE] * there,
    )
    sheet.rows(entities.magnet(index), t_ns, columns.partition(np.where(shares > 0.0, 2, 0)))


def _turn_x_to(along: FloatArray) -> FloatArray:
    """Quaternion (4,) xyzw that turns the x axis to a unit vector."""
    yaw, pitch = np.arctan2(along[1], along[0]), -np.arcsin(np.clip(along[2], -1.0, 1.0))
    return quaternion_from_rpy(0.0, float(pitch), float(yaw))


def _draw_reach(run: Run, sheet: Sheet, pieces: MagneticPieces, index: int) -> None:
    """Draw on the ground where a piece is felt: a disc for each of two shares of the earth's field."""
    t_ns, shares = presence(pieces, index)
    (east, north, up, radius), moment = pieces.places[index], pieces.moments_a_m2[index]
    height = up - float(run.scene.height_at(np.array(east), np.array(north)))
    azimuths = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS, endpoint=False)
    colour = _NORTH_POLE if index < len(pieces.magnets) else _IRON
    for level, (share_of_earth, alpha) in enumerate(((FELT_SHARE, 60), (STRONG_SHARE, 90))):
        least = share_of_earth * pieces.earth_ut
        if least <= 0.0:
            continue
        discs = [
            reach_m(share * moment, radius_m=radius, height_m=height, least_ut=least, azimuths_rad=azimuths)
            for share in shares
        ]
        if not any(disc.any() for disc in discs):
            continue
        rings = np.stack([_disc(run, (east, north), disc, azimuths, lift=1.0 + level) for disc in discs])
        entity = f"{entities.magnetic_reach(index)}/{round(100 * share_of_earth)}_percent"
        sheet.static(
            entity,
            rr.Mesh3D.from_fields(
                triangle_indices=_fan(),
                albedo_factor=(*colour, alpha),
                vertex_normals=np.tile((0, 0, 1), (len(rings[0]), 1)),
            ),
        )
        positions = rr.Mesh3D.columns(vertex_positions=rings.reshape(-1, 3).astype(np.float32))
        sheet.rows(entity, t_ns, positions.partition([rings.shape[1]] * len(rings)))


def _disc(run: Run, middle: tuple[float, float], reach: FloatArray, azimuths: FloatArray, *, lift: float) -> FloatArray:
    """Vertices (rings x azimuths, 3) of a disc that lies on the ground."""
    share = np.linspace(0.0, 1.0, _RINGS)[:, np.newaxis]
    east, north = middle[0] + share * reach * np.cos(azimuths), middle[1] + share * reach * np.sin(azimuths)
    up = run.scene.height_at(east, north) + lift * _LIFT_M * run.scene.scale
    return np.stack([east, north, up], axis=-1).reshape(-1, 3)


def _fan() -> IntArray:
    """Triangles of a disc's vertices."""
    ring, step = np.meshgrid(np.arange(_RINGS - 1), np.arange(_AZIMUTHS), indexing="ij")
    near, far = ring * _AZIMUTHS + step, (ring + 1) * _AZIMUTHS + step
    onward = (step + 1) % _AZIMUTHS - step
    first = np.stack([near, far, far + onward], axis=-1)
    second = np.stack([near, far + onward, near + onward], axis=-1)
    return np.concatenate([first, second]).reshape(-1, 3)


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
    width = CROWN_RADII * radius
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
