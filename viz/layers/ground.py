"""The ground, a grid for scale, and the path that was asked for."""

from __future__ import annotations

import numpy as np
import rerun as rr

from twin.signals import FloatArray
from viz import entities
from viz.levelled import levelled_field
from viz.sheet import PanelKind, Run, Sheet
from viz.terrain import Window, grid_lines, grid_spacing_m, terrain_mesh, window_around

_LIFT_M = 0.05


def draw_ground(run: Run, sheet: Sheet) -> None:
    """Draw the ground around the driven and the planned path, and the planned path on it."""
    scene = run.scene
    window = window_around(scene, _visited(run))
    field = levelled_field(scene)
    hole = None
    if field is not None:
        ends = [(int(nodes[0]), int(nodes[-1]) + 1) for nodes in (field.rows, field.columns)]
        hole = Window(rows=ends[0], columns=ends[1])
    mesh = terrain_mesh(scene, window, hole=hole)
    sheet.static(entities.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    sheet.static(
        entities.TERRAIN,
        rr.Mesh3D(
            vertex_positions=mesh.vertices,
            vertex_normals=mesh.normals,
            vertex_texcoords=mesh.texture_coordinates,
            triangle_indices=mesh.triangles,
            albedo_texture=mesh.texture,
        ),
    )
    spacing_m = grid_spacing_m(scene)
    lines = grid_lines(scene, window, spacing_m)
    if lines:
        sheet.static(entities.GRID, rr.LineStrips3D(lines, colors=[(70, 58, 42)], radii=rr.Radius.ui_points(0.5)))
    if len(scene.planned_path) > 1:
        path = scene.planned_path
        height = scene.height_at(path[:, 0], path[:, 1]) + _LIFT_M * scene.scale
        strip = np.column_stack([path, height])
        sheet.static(
            entities.PLANNED_PATH,
            rr.LineStrips3D([strip], colors=[entities.PLANNED_COLOUR], radii=rr.Radius.ui_points(1.0)),
        )
    scans = set(scene.scanners) & set(run.recording.names("measurements"))
    legend = "; lidar near orange, far blue, lost red, wrong magenta" if scans else ""
    if field is not None:
        legend += "; colour: height above the design plane"
    sheet.panel(PanelKind.FIELD, entities.WORLD, f"Field, grid of {spacing_m:g} m{legend}")


def _visited(run: Run) -> FloatArray:
    """Points (N, 2) that the ground has to hold: the planned path, and where the machine truly was."""
    points = [np.asarray(run.scene.planned_path, dtype=np.float64).reshape(-1, 2)]
    if run.truth is not None:
        for pair in (("position_e_m", "position_n_m"), ("base_e_m", "base_n_m")):
            driven = run.columns(run.truth, *pair)
            if driven is not None:
                points.append(driven[::10])
    return np.concatenate(points)
