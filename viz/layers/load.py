"""The soil in front of a blade: a wedge at the angle of repose that holds what the blade carries."""

from __future__ import annotations

import math

import numpy as np
import rerun as rr

from twin.signals import FloatArray
from twin.world.blade_spec import BladeSpec
from viz import entities
from viz.sheet import Run, Sheet
from viz.thinning import steps, thin

LOAD_HZ = 10.0
LOAD = "blade_load_m3"
_SOIL = (150, 112, 70)
_LEAST_STEP = 0.01
"""Of the blade's capacity: smaller changes are not drawn."""


def draw_load(run: Run, sheet: Sheet) -> None:
    """Draw the carried soil in the frame of the blade's link; needs the truth's load, and a URDF with that link.

    The load's spread along the blade is not recorded: it is drawn as if even.
    """
    truth, blade = run.truth, run.scene.blade
    if truth is None or blade is None or run.scene.urdf is None:
        return
    load = run.columns(truth, LOAD)
    if load is None:
        return
    keep = thin(truth.t_ns, LOAD_HZ)
    keep = keep[steps(load[keep], _LEAST_STEP * blade.capacity_m3)]
    wedges = wedge(blade, load[keep, 0])
    sheet.static(entities.LOAD, rr.CoordinateFrame(blade.body))
    sheet.static(
        entities.LOAD,
        rr.Mesh3D.from_fields(
            triangle_indices=_TRIANGLES, vertex_normals=_normals(blade.repose_rad), albedo_factor=_SOIL
        ),
    )
    columns = rr.Mesh3D.columns(vertex_positions=wedges.reshape(-1, 3).astype(np.float32))
    sheet.rows(entities.LOAD, truth.t_ns[keep], columns.partition([len(_CORNERS)] * len(keep)))


_FOOT, _TOP, _TOE = 0, 1, 2
_RIGHT, _LEFT = -0.5, 0.5
_CORNERS = (
    *((_TOE, _RIGHT), (_TOE, _LEFT), (_TOP, _LEFT), (_TOP, _RIGHT)),
    *((_FOOT, _RIGHT), (_TOE, _RIGHT), (_TOP, _RIGHT)),
    *((_TOE, _LEFT), (_FOOT, _LEFT), (_TOP, _LEFT)),
)
"""Of the slope and both ends, counter-clockwise from outside: corner of the triangle, and place along the edge in
widths. The blade hides the back."""
_TRIANGLES = ((0, 1, 2), (0, 2, 3), (4, 5, 6), (7, 8, 9))


def wedge(blade: BladeSpec, load_m3: FloatArray) -> FloatArray:
    """Vertices (T, V, 3) of wedges of these volumes (T,) in the frame of the blade's link, forward of the edge."""
    height = np.sqrt(2.0 * np.maximum(load_m3, 0.0) / blade.width_m * math.tan(blade.repose_rad))
    reach = height / math.tan(blade.repose_rad)
    zero = np.zeros_like(height)
    profile = np.stack([np.stack([zero, zero], -1), np.stack([zero, height], -1), np.stack([reach, zero], -1)], axis=1)
    corner, along = (np.array(part) for part in zip(*_CORNERS, strict=True))
    vertices = np.empty((len(height), len(_CORNERS), 3))
    vertices[:, :, [0, 2]] = profile[:, corner]
    vertices[:, :, 1] = along * blade.width_m
    moved: FloatArray = vertices + np.asarray(blade.middle_m)
    return moved


def _normals(repose_rad: float) -> list[tuple[float, float, float]]:
    slope = (math.sin(repose_rad), 0.0, math.cos(repose_rad))
    return [slope] * 4 + [(0.0, -1.0, 0.0)] * 3 + [(0.0, 1.0, 0.0)] * 3
