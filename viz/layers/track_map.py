"""The track of a log on a map in metres, with grid and scale: what receiver, estimators and reference said.

A view of the house's own, since a map of the world needs the network for its tiles. East is to the right, north is up;
beside the whole lies a close-up of the place where there is most to see: where the error against the reference is
largest, or else the surprise of a filter, or the step of the receiver. The track lies as geographic lines in the
recording too, for whoever opens a map view over ``geo`` and has the network.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr

from twin.formats.geodetic import Origin
from twin.recording import Stream
from twin.signals import BoolArray, FloatArray, IntArray
from viz import entities
from viz.layers.measurements import packed
from viz.map_labels import draw_labels, metres, multiples, step_of
from viz.sheet import PanelKind, Run, Sheet
from viz.thinning import thin
from viz.track_window import Window, known_rows, points_of, windows

TAB = "Track and close-up"
REFERENCE = "reference"
_INK, _GRID, _FRAME = (215, 215, 215), (84, 72, 60), (130, 118, 104)
_LINES = 7
"""At most so many grid lines along the longer side."""
_LEFT, _BELOW, _LEGEND_ROW, _DROP = 0.14, 0.17, 0.055, 0.018
"""Room for labels of the grid, height of a line of the legend, and how far below its point the viewer writes a label,
in widths of the map."""
_GAP_STEPS = 6.0
"""A line is broken where the time between rows is so many times the usual."""
_MARKER_HZ = 1.0
_MOST_MARKS = 2000

_Legend = list[tuple[str, entities.Colour]]


def draw_track_map(run: Run, sheet: Sheet) -> None:
    """Draw the map and the close-up; needs a receiver or an estimator with positions."""
    found = windows(run)
    if found is None:
        return
    whole, close = found
    _Map(run, sheet, "whole", whole).draw("Track, north is up [m]")
    if close is not None:
        window, what = close
        _Map(run, sheet, "close", window, whole=False).draw(f"Close-up [m]: {what}")
    _draw_globe(run, sheet)


class _Map:
    """Draws one map: the whole track, or what lies within its window."""

    def __init__(self, run: Run, sheet: Sheet, which: str, window: Window, *, whole: bool = True) -> None:
        self._run, self._sheet, self._window, self._whole = run, sheet, window, whole
        self._root = entities.track_map(which)

    def draw(self, title: str) -> None:
        run, window = self._run, self._window
        self._draw_grid()
        legend: _Legend = []
        reference = run.recording.streams.get(REFERENCE)
        if reference is not None and self._draw_line(REFERENCE, reference, entities.TRUTH_COLOUR, width=1.7, order=1.0):
            legend.append((REFERENCE, entities.TRUTH_COLOUR))
        for name in run.recording.names("measurements"):
            legend += self._draw_receiver(name)
        for name in run.estimators:
            stream, colour = run.recording.estimates(name), run.colours[name]
            if self._draw_line(f"estimates/{name}", stream, colour, width=0.9, order=3.0):
                legend.append((entities.legend_name(name), colour))
            self._draw_marker(name, stream)
        self._draw_legend(legend)
        west, south, east, north = window.edges
        above = (_LEGEND_ROW * (len(legend) + 0.8)) * window.width
        self._sheet.bounds[self._root] = (
            (west - _LEFT * window.width, east + 0.03 * window.width),
            (-north - above, -south + _BELOW * window.width),
        )
        self._sheet.panel(PanelKind.MAP, self._root, title, tab=TAB)

    def _draw_receiver(self, name: str) -> _Legend:
        """Positions as points in the colours of their quality; return what the legend has to tell."""
        run = self._run
        stream = run.recording.measurements(name)
        points = points_of(run, stream)
        if points is None:
            return []
        seen = self._shown(points)
        quality = run.columns(stream, "quality")
        codes = np.full(len(points), math.nan) if quality is None else quality[:, 0]
        colours = np.full(len(points), packed(entities.MEASURED_COLOUR), dtype=np.uint32)
        told: _Legend = []
        for code, colour in entities.QUALITY_COLOURS.items():
            colours[codes == code] = packed(colour)
            if (codes[seen] == code).any():
                told.append((f"{name}: {entities.QUALITY_LABELS[code]}", colour))
        if not seen.any():
            return []
        radii = rr.Radius.ui_points(3.0)
        dots = rr.Points2D(_drawn(points[seen]), colors=colours[seen], radii=radii, draw_order=2.0)
        self._sheet.static(f"{self._root}/measurements/{name}", dots)
        return told or [(name, entities.MEASURED_COLOUR)]

    def _draw_line(self, what: str, stream: Stream, colour: entities.Colour, *, width: float, order: float) -> bool:
        """A track as lines, broken where nothing is known; return whether anything was drawn."""
        points = points_of(self._run, stream)
        if points is None:
            return False
        strips = list(_strips(stream.t_ns, points))
        if not self._whole:
            strips = [_drawn(piece) for strip in strips for piece in self._window.pieces(_drawn(strip))]
        if strips:
            radii = rr.Radius.ui_points(width)
            lines = rr.LineStrips2D(strips, colors=[colour], radii=radii, draw_order=order)
            self._sheet.static(f"{self._root}/{what}", lines)
        return bool(strips)

    def _shown(self, points: FloatArray) -> BoolArray:
        """Which of the points (T, 2) are drawn."""
        return known_rows(points if self._whole else self._window.inside(points))

    def _draw_marker(self, name: str, stream: Stream) -> None:
        """Where an estimator is now."""
        points = points_of(self._run, stream)
        if points is None:
            return
        keep = thin(stream.t_ns, _MARKER_HZ)
        keep = keep[:: max(1, -(-len(keep) // _MOST_MARKS))]
        inside = self._shown(points[keep])
        keep, entity = keep[inside], f"{self._root}/now/{name}"
        if len(keep):
            self._sheet.rows(entity, stream.t_ns[keep], rr.Points2D.columns(positions=_drawn(points[keep])))
            style = rr.Points2D.from_fields(
                colors=[self._run.colours[name]], radii=rr.Radius.ui_points(5.0), draw_order=4.0
            )
            self._sheet.static(entity, style)

    def _draw_grid(self) -> None:
        """Lines every so many metres with their east and north, and the frame."""
        wide = self._window.width
        west, south, east, north = self._window.edges
        step = step_of(max(east - west, north - south), _LINES)
        lines, places, labels = [], [], []
        for value in multiples(step, west, east):
            lines.append([(value, -south), (value, -north)])
            places.append((value, -south + 0.045 * wide))
            labels.append(metres(value))
        for value in multiples(step, south, north):
            lines.append([(west, -value), (east, -value)])
            places.append((west - 0.5 * _LEFT * wide, -value))
            labels.append(metres(value))
        frame = [(west, -south), (east, -south), (east, -north), (west, -north), (west, -south)]
        style = rr.Radius.ui_points(0.5)
        self._sheet.static(f"{self._root}/grid", rr.LineStrips2D(lines, colors=[_GRID], radii=style, draw_order=0.0))
        self._sheet.static(
            f"{self._root}/frame", rr.LineStrips2D([frame], colors=[_FRAME], radii=style, draw_order=0.5)
        )
        places.append((self._window.east_m, -south + 0.105 * wide))
        labels.append(f"east [m], a line every {step:g} m")
        self._draw_labels("labels", places, labels, _INK)

    def _draw_legend(self, legend: _Legend) -> None:
        """What the colours mean, above the map."""
        top = -self._window.edges[3]
        for index, (label, colour) in enumerate(reversed(legend)):
            row = top - (index + 0.8) * _LEGEND_ROW * self._window.width
            self._draw_labels(f"legend/{index}", [(self._window.east_m, row)], [label], colour)

    def _draw_labels(
        self, what: str, places: Sequence[tuple[float, float]], labels: Sequence[str], colour: entities.Colour
    ) -> None:
        drop, entity = _DROP * self._window.width, f"{self._root}/{what}"
        draw_labels(self._sheet, entity, places, labels, colour=colour, drop=drop, order=5.0)


def _strips(t_ns: IntArray, points: FloatArray) -> Iterator[FloatArray]:
    """Pieces of a track (T, 2) between gaps, as drawn."""
    known = known_rows(points)
    if known.sum() < 2:
        return
    steps = np.diff(t_ns)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    broken = ~(known[1:] & known[:-1]) | (steps > _GAP_STEPS * max(usual, 1.0))
    for piece in np.split(np.arange(len(points)), np.flatnonzero(broken) + 1):
        if len(piece) > 1:
            yield _drawn(points[piece])


def _drawn(points: FloatArray) -> FloatArray:
    """East and north (T, 2) to the right and downwards."""
    return points * (1.0, -1.0)


def _draw_globe(run: Run, sheet: Sheet) -> None:
    """The receivers' tracks as latitude and longitude; in no panel, for whoever wants a map of the world."""
    told = run.result.get("log", {}).get("origin")
    if told is None:
        return
    origin = Origin(**{key: float(value) for key, value in told.items()})
    for name in run.recording.names("measurements"):
        stream = run.recording.measurements(name)
        points = points_of(run, stream)
        if points is None:
            continue
        strips = [_drawn(strip) for strip in _strips(stream.t_ns, points)]
        lines = [origin.geodetic(np.column_stack([strip, np.zeros(len(strip))]))[:, :2] for strip in strips]
        if lines:
            sheet.static(entities.globe_track(name), rr.GeoLineStrings(lat_lon=lines, colors=[entities.PLANNED_COLOUR]))
