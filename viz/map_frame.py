"""Frame of a map seen from above: where metres lie in the picture's cells, ticks with metres, and an area's outline.

A map's own coordinates are cells of the picture: the viewer scales pictures no other way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr

from viz.map_labels import draw_labels, metres, multiples, step_of
from viz.sheet import Sheet

LABEL, GAP = 0.07, 0.03
"""Room for labels of ticks, and gaps, in longer sides of the map."""
_DROP = 0.022
"""How far below its point the viewer writes a label in a window of 1600 x 900, likewise."""
_INK = (225, 225, 225)
_TICKS = 6
"""At most about so many along the longer side."""

Area = tuple[float, float, float, float]
"""West, south, east and north limit, m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapFrame:
    """Where things lie on a map, in cells to the right and downwards."""

    area_m: Area
    """What the picture's cells fill."""
    shape: tuple[int, int]
    """Rows and columns of the picture."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height."""
        return float(self.shape[1]), float(self.shape[0])

    @property
    def unit(self) -> float:
        """The longer side."""
        return max(self.size)

    def right(self, east_m: float) -> float:
        """How far to the right a place is."""
        west, _, east, _ = self.area_m
        return (east_m - west) / (east - west) * self.shape[1]

    def down(self, north_m: float) -> float:
        """How far down a place is."""
        _, south, _, north = self.area_m
        return (north - north_m) / (north - south) * self.shape[0]

    def draw_axes(self, sheet: Sheet, root: str, outlined_m: Area) -> None:
        """Draw ticks with metres of east and north, and the outline of an area."""
        width, height = self.size
        west, south, east, north = self.area_m
        span_m = max(east - west, north - south)
        step = step_of(span_m, _TICKS)
        tick = 0.3 * GAP * self.unit
        lines, places, labels = [], [], []
        for at_m in multiples(step, west, east):
            x = self.right(at_m)
            lines.append([(x, height), (x, height + tick)])
            places.append((x, height + tick + _DROP * self.unit))
            labels.append(metres(at_m))
        for at_m in multiples(step, south, north):
            y = self.down(at_m)
            lines.append([(0.0, y), (-tick, y)])
            places.append((-tick - 0.45 * LABEL * self.unit, y))
            labels.append(metres(at_m))
        places += [(0.5 * width, height + (LABEL + 0.3 * GAP) * self.unit), (0.0, -1.2 * LABEL * self.unit)]
        labels += ["east [m]", "north [m]"]
        style = rr.Radius.ui_points(0.7)
        sheet.static(f"{root}/ticks", rr.LineStrips2D(lines, colors=[_INK], radii=style, draw_order=1.0))
        self.draw_labels(sheet, f"{root}/labels", places, labels)
        west, south, east, north = outlined_m
        corners = [(west, south), (east, south), (east, north), (west, north), (west, south)]
        strip = [(self.right(x), self.down(y)) for x, y in corners]
        style = rr.Radius.ui_points(1.2)
        sheet.static(f"{root}/area", rr.LineStrips2D([strip], colors=[(0, 0, 0)], radii=style, draw_order=2.0))

    def draw_labels(
        self, sheet: Sheet, entity: str, places: Sequence[tuple[float, float]], labels: Sequence[str]
    ) -> None:
        """Write labels at places, in cells to the right and downwards."""
        draw_labels(sheet, entity, places, labels, colour=_INK, drop=_DROP * self.unit)

    def bound(self, sheet: Sheet, root: str, *, beside: float, least: float = 0.0) -> None:
        """Let the map be seen with its labels at first, with some room to its right, in longer sides.

        What stands there reaches ``least`` longer sides down.
        """
        width, height = self.size
        margin = (LABEL + 2.0 * GAP) * self.unit
        sheet.bounds[root] = (
            (-margin, width + beside * self.unit),
            (-margin, max(height + margin, (least + GAP) * self.unit)),
        )
