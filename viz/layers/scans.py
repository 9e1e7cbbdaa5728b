"""What turning lidars measured, as points around the machine."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import rerun as rr

from twin.recording import hidden_stream
from twin.signals import BoolArray, FloatArray, IntArray
from viz import entities
from viz.sheet import PanelKind, Run, Sheet

_RANGE = re.compile(r"range_\d+_m\Z")
_BASE = ("base_e_m", "base_n_m", "base_u_m", "base_qx", "base_qy", "base_qz", "base_qw")
_WRONG_M, _WRONG_SHARE = 0.05, 0.15
"""A range is wrong that is off by more than this and by more than this share of it: several sigma of such sensors."""
_SURE_SHARE, _EDGE = 0.9, 0.1
"""A beam surely meets a trunk within this share of its radius, and surely is in range so far (share) from its ends."""
_Style = tuple[str, entities.Colour]
_POINT_RADIUS = 0.02
"""Of a point, as a share of the machine's size."""


def draw_scans(run: Run, sheet: Sheet) -> None:
    """Draw the latest turn of every lidar, and plot how many of its beams came back, were lost or gave a wrong range.

    Points go from near (orange) to far (blue). A beam is lost that met a trunk and gave nothing: it is drawn on the
    bark (red). One that gave a range which its true error shows to mean nothing is wrong (magenta). Each beam is drawn
    from where the machine truly was when it was sent; needs the truth's base pose.
    """
    for sensor in run.recording.names("measurements"):
        stream = run.recording.measurements(sensor)
        columns = [column for column in stream.columns if _RANGE.match(column)]
        ranges = run.columns(stream, *columns) if columns else None
        if ranges is None:
            continue
        _plot_share(sheet, sensor, stream.t_ns, np.isfinite(ranges), entities.SCAN_FAR_COLOUR)
        wrong = _wrong(run, sensor, columns, ranges)
        if wrong.any():
            _plot_share(sheet, f"{sensor}_wrong", stream.t_ns, wrong, entities.SCAN_WRONG_COLOUR)
        pose = None if run.truth is None else run.columns(run.truth, *_BASE)
        scanner = run.scene.scanners.get(sensor)
        if scanner is None or run.truth is None or pose is None or len(stream) < 2:
            continue
        turns = Turns.of(stream.t_ns, ranges.shape[1], _Motion(run.truth.t_ns, pose), scanner.xyz_m)
        _draw_hits(run, sheet, sensor, turns, np.where(wrong, np.nan, ranges))
        if wrong.any():
            style = entities.wrong_beams(sensor), entities.SCAN_WRONG_COLOUR
            _draw_points(run, sheet, turns, np.where(wrong, ranges, np.nan), style=style)
        lost = np.where(np.isfinite(ranges), np.nan, turns.to_bark(run.scene.trunks, ~np.isfinite(ranges)))
        least, most = scanner.range_m
        lost[(lost < least * (1.0 + _EDGE)) | (lost > most * (1.0 - _EDGE))] = np.nan
        if np.isfinite(lost).any():
            _draw_points(run, sheet, turns, lost, style=(entities.lost_beams(sensor), entities.SCAN_LOST_COLOUR))
            _plot_share(sheet, f"{sensor}_lost", stream.t_ns, np.isfinite(lost), entities.SCAN_LOST_COLOUR)
    sheet.panel(PanelKind.PLOT, entities.plot("returns"), "Lidar beams: back, lost, wrong [%]")


def _plot_share(sheet: Sheet, series: str, t_ns: IntArray, which: BoolArray, colour: entities.Colour) -> None:
    sheet.line(entities.plot("returns", series), t_ns, 100.0 * which.mean(axis=1), colour)


def _wrong(run: Run, sensor: str, columns: list[str], ranges: FloatArray) -> BoolArray:
    """Which ranges (T, n) mean nothing, by their hidden true errors; none where nobody knows these."""
    hidden = run.recording.streams.get(hidden_stream(sensor))
    error = None if hidden is None else run.columns(hidden, *(f"{column}.error" for column in columns))
    if error is None or error.shape != ranges.shape:
        return np.zeros(ranges.shape, dtype=np.bool_)
    # No error: there was nothing to be met.
    far_off = ~(np.abs(error) <= np.maximum(_WRONG_M, _WRONG_SHARE * ranges))
    wrong: BoolArray = np.isfinite(ranges) & far_off
    return wrong


@dataclass(frozen=True, slots=True)
class _Motion:
    t_ns: IntArray
    pose: FloatArray
    """(T, 7) place and quaternion of the root link."""


@dataclass(frozen=True, slots=True)
class Turns:
    """From where and whereto the beams of T turns were sent: n a turn."""

    t_ns: IntArray
    """(T,) ends of the turns."""
    origins: FloatArray
    """(T, n, 3) m."""
    directions: FloatArray
    """(T, n, 3) unit vectors."""

    @staticmethod
    def of(t_ns: IntArray, beams: int, motion: _Motion, mount_m: tuple[float, float, float]) -> Turns:
        """Beams of turns that end at ``t_ns``, sent one after the other by a lidar on a moving machine.

        As in the world, it moves and turns evenly from the end of one turn to the end of the next.
        """
        period = int(np.median(np.diff(t_ns)))
        ends = np.append(t_ns[0] - period, t_ns)
        motion = _Motion(ends, np.hstack(_poses(motion, ends)))
        back = (period * (1.0 - np.arange(1, beams + 1) / beams)).astype(np.int64)
        position, quaternion = _poses(motion, (t_ns[:, np.newaxis] - back).ravel())
        bearing = np.tile(2.0 * np.pi * np.arange(beams) / beams, len(t_ns))
        local = np.column_stack([np.cos(bearing), np.sin(bearing), np.zeros(len(bearing))])
        mount = np.broadcast_to(np.array(mount_m), local.shape)
        shape = (len(t_ns), beams, 3)
        origins = (position + _turned(quaternion, mount)).reshape(shape)
        return Turns(t_ns, origins, _turned(quaternion, local).reshape(shape))

    def points(self, ranges: FloatArray) -> FloatArray:
        """Ends (T, n, 3) of beams of lengths (T, n)."""
        ends: FloatArray = self.origins + ranges[..., np.newaxis] * self.directions
        return ends

    def to_bark(self, trunks: FloatArray, wanted: BoolArray) -> FloatArray:
        """Ranges (T, n) of the ``wanted`` beams (T, n) to the first of the trunks (N, 5) met; NaN for the others."""
        ranges = np.full(wanted.shape, np.inf)
        for turn in np.flatnonzero(wanted.any(axis=1)):
            beams = wanted[turn]
            origin, ray = self.origins[turn, beams], self.directions[turn, beams]
            level = np.hypot(ray[:, 0], ray[:, 1])
            across = ray[:, :2] / level[:, np.newaxis]
            to_axis = trunks[:, np.newaxis, :2] - origin[:, :2]
            along = np.einsum("kni,ni->kn", to_axis, across)
            beside = to_axis[..., 0] * across[:, 1] - to_axis[..., 1] * across[:, 0]
            radius = trunks[:, 2, np.newaxis]
            # One that only grazes the bark may pass it: where a beam truly went is known to a millimetre or so.
            met = (np.abs(beside) < _SURE_SHARE * radius) & (along > 0.0)
            reach = (along - np.sqrt(np.maximum(radius**2 - beside**2, 0.0))) / level
            height = origin[:, 2] + reach * ray[:, 2]
            met &= (height >= trunks[:, 3, np.newaxis]) & (height <= trunks[:, 4, np.newaxis])
            ranges[turn, beams] = np.where(met, reach, np.inf).min(axis=0, initial=np.inf)
        return np.where(np.isfinite(ranges), ranges, np.nan)


def _draw_hits(run: Run, sheet: Sheet, sensor: str, turns: Turns, ranges: FloatArray) -> None:
    seen = np.isfinite(ranges)
    reach = ranges[seen]
    far = np.clip(reach / max(float(reach.max(initial=0.0)), 1e-9), 0.0, 1.0)[:, np.newaxis]
    near_colour, far_colour = np.array(entities.SCAN_NEAR_COLOUR), np.array(entities.SCAN_FAR_COLOUR)
    colours = np.column_stack([near_colour + far * (far_colour - near_colour), np.full(len(far), 255.0)])
    columns = rr.Points3D.columns(
        positions=turns.points(ranges)[seen].astype(np.float32), colors=colours.astype(np.uint8)
    )
    sheet.rows(entities.scan(sensor), turns.t_ns, columns.partition(seen.sum(axis=1)))
    sheet.static(entities.scan(sensor), rr.Points3D.from_fields(radii=_POINT_RADIUS * run.scene.machine_size_m))


def _draw_points(run: Run, sheet: Sheet, turns: Turns, ranges: FloatArray, *, style: _Style) -> None:
    """Draw the ends of beams (T, n) that have a range, all in one colour."""
    entity, colour = style
    seen = np.isfinite(ranges)
    columns = rr.Points3D.columns(positions=turns.points(ranges)[seen].astype(np.float32))
    sheet.rows(entity, turns.t_ns, columns.partition(seen.sum(axis=1)))
    radii = _POINT_RADIUS * run.scene.machine_size_m
    sheet.static(entity, rr.Points3D.from_fields(radii=radii, colors=[colour]))


def _poses(motion: _Motion, when: IntArray) -> tuple[FloatArray, FloatArray]:
    """Positions (N, 3) and quaternions (N, 4) at times (N,) between the rows of the truth."""
    start = motion.t_ns[0]
    known, wanted = (motion.t_ns - start).astype(float), (when - start).astype(float)
    quaternion = motion.pose[:, 3:].copy()
    # Neighbours on the same side, so that what lies between them is between them.
    flips = np.cumprod(np.where((quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    quaternion[1:] *= flips[:, np.newaxis]
    mixed = np.column_stack([np.interp(wanted, known, column) for column in quaternion.T])
    position = np.column_stack([np.interp(wanted, known, column) for column in motion.pose[:, :3].T])
    return position, mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def _turned(quaternion: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors (N, 3) turned by quaternions (N, 4), xyzw."""
    axis, w = quaternion[:, :3], quaternion[:, 3:]
    twice = 2.0 * np.cross(axis, vectors)
    turned: FloatArray = vectors + w * twice + np.cross(axis, twice)
    return turned
