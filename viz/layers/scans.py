"""What turning lidars measured, as points around the machine."""

from __future__ import annotations

import re

import numpy as np
import rerun as rr

from twin.geometry import rotation_from_quaternion
from twin.recording import Stream
from twin.signals import FloatArray, IntArray
from viz import entities
from viz.sheet import PanelKind, Run, Sheet

_RANGE = re.compile(r"range_\d+_m\Z")
_BASE = ("base_e_m", "base_n_m", "base_u_m", "base_qx", "base_qy", "base_qz", "base_qw")
_NEAR, _FAR = np.array([255.0, 120.0, 40.0]), np.array([60.0, 200.0, 255.0])
_POINT_RADIUS = 0.016
"""Of a point, as a share of the machine's size."""


def draw_scans(run: Run, sheet: Sheet) -> None:
    """Draw the latest turn of every lidar, from near (orange) to far (blue), and plot how many beams came back.

    Each beam is drawn from where the machine truly was when it was sent; needs the truth's base pose.
    """
    for sensor in run.recording.names("measurements"):
        stream = run.recording.measurements(sensor)
        columns = [column for column in stream.columns if _RANGE.match(column)]
        ranges = run.columns(stream, *columns) if columns else None
        if ranges is None:
            continue
        if sensor in run.scene.scanners:
            _draw_points(run, sheet, sensor, stream, ranges)
        entity = entities.plot("returns", sensor)
        share = 100.0 * np.isfinite(ranges).mean(axis=1)
        sheet.rows(entity, stream.t_ns, rr.Scalars.columns(scalars=share))
        sheet.curve(entity, sensor, stream.t_ns, share)
        name = entities.legend_name(sensor)
        sheet.static(entity, rr.SeriesLines(colors=[entities.MEASURED_COLOUR], names=[name], widths=[1.5]))
    sheet.panel(PanelKind.PLOT, entities.plot("returns"), "Beams that came back [%]")


def _draw_points(run: Run, sheet: Sheet, sensor: str, stream: Stream, ranges: FloatArray) -> None:
    pose = None if run.truth is None else run.columns(run.truth, *_BASE)
    if run.truth is None or pose is None or len(stream) < 2:
        return
    beams, period = ranges.shape[1], int(np.median(np.diff(stream.t_ns)))
    back = (period * (1.0 - np.arange(1, beams + 1) / beams)).astype(np.int64)
    seen = np.isfinite(ranges)
    when = (stream.t_ns[:, np.newaxis] - back)[seen]
    bearing = np.broadcast_to(2.0 * np.pi * np.arange(beams) / beams, ranges.shape)[seen]
    position, rotation = _poses(run.truth.t_ns, pose, when)
    reach = ranges[seen]
    local = np.column_stack([reach * np.cos(bearing), reach * np.sin(bearing), np.zeros(len(reach))])
    points = position + np.einsum("nij,nj->ni", rotation, local + np.array(run.scene.scanners[sensor]))
    far = np.clip(reach / max(float(reach.max(initial=0.0)), 1e-9), 0.0, 1.0)[:, np.newaxis]
    colours = np.column_stack([_NEAR + far * (_FAR - _NEAR), np.full(len(far), 255.0)]).astype(np.uint8)
    entity = entities.scan(sensor)
    columns = rr.Points3D.columns(positions=points.astype(np.float32), colors=colours)
    sheet.rows(entity, stream.t_ns, columns.partition(seen.sum(axis=1)))
    sheet.static(entity, rr.Points3D.from_fields(radii=_POINT_RADIUS * run.scene.machine_size_m))


def _poses(t_ns: IntArray, pose: FloatArray, when: IntArray) -> tuple[FloatArray, FloatArray]:
    """Positions (N, 3) and rotations (N, 3, 3) at times between the rows of the truth."""
    start = t_ns[0]
    known, wanted = (t_ns - start).astype(float), (when - start).astype(float)
    quaternion = pose[:, 3:].copy()
    # Neighbours on the same side, so that what lies between them is between them.
    flips = np.cumprod(np.where((quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    quaternion[1:] *= flips[:, np.newaxis]
    mixed = np.column_stack([np.interp(wanted, known, column) for column in quaternion.T])
    position = np.column_stack([np.interp(wanted, known, column) for column in pose[:, :3].T])
    unit = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    return position, np.array([rotation_from_quaternion(q) for q in unit]).reshape(-1, 3, 3)
