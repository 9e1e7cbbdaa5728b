"""The layout of the window, stored in the file: field left, lanes and a camera's pictures below, plots right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from twin.signals import NS_PER_S
from viz import entities
from viz.sheet import Curve, Panel, PanelKind, Sheet

_CELLS = 50
_LEGEND_WIDTH = 0.33
_LEGEND_ENTRY = 0.14
"""Share of a plot's width that a legend takes, and of its height that one entry takes, in a window of 1600 x 900."""
_LEGEND_MOST, _LEGEND_HIDES = 4, 0.05
"""A legend of more entries, or one that hides a larger share of the curves, is left out where another panel lists the
same names."""
_LEAST_RANGE = 2e-3
"""Of a plot, in whatever unit it has."""
_SKY = (184, 205, 224)
_NIGHT = (13, 16, 17)
_LANES_HEAD, _LANE = 0.07, 0.048
"""Share of the window's height that the title and the times above lanes take, and each lane."""
_PICTURE_SHARE = 1.5
"""Height of a row with a picture where the field\'s is 3."""
_WIDE = 1.2
"""Width of a map, in its heights, from which on two do better below one another."""
_DIAL_SHARE = 1.5
"""Height of a dial, in rows of plots."""


def layout(sheet: Sheet, duration_ns: int) -> rrb.Blueprint:
    """Arrange the panels that the layers have filled."""
    by_kind = {kind: [panel for panel in sheet.panels if panel.kind is kind] for kind in PanelKind}
    field = [_field_view(panel, sheet) for panel in by_kind[PanelKind.FIELD]]
    pages = [rrb.TextDocumentView(origin=_root(panel), name=panel.title) for panel in by_kind[PanelKind.PAGE]]
    lanes = [
        rrb.StateTimelineView(origin=_root(p), name=p.title, time_view=_whole(sheet.begin_ns, duration_ns))
        for p in by_kind[PanelKind.LANES]
    ]
    logs = [_log_view(panel) for panel in by_kind[PanelKind.LOG]]
    plots = [_plot_view(panel, sheet, duration_ns) for panel in by_kind[PanelKind.PLOT]]
    maps = _maps(by_kind[PanelKind.MAP], sheet)
    dials = [_map_view(panel, sheet, _NIGHT) for panel in by_kind[PanelKind.DIAL]]
    pictures = [rrb.Spatial2DView(origin=_root(p), name=p.title) for p in by_kind[PanelKind.PICTURE]]
    below = _beside(_tabs([*lanes, *logs]), _tabs(pictures))
    lower = max(_lanes_share(sheet), _PICTURE_SHARE) if pictures else _lanes_share(sheet)
    left = _column([_tabs([*field, *maps, *pages]), below], shares=(3.0, lower))
    right = _column([*dials, _grid(plots)], shares=[*[_DIAL_SHARE] * len(dials), max(1.0, -(-len(plots) // 2))])
    parts = [part for part in (left, right) if part is not None]
    return rrb.Blueprint(
        rrb.Horizontal(*parts, column_shares=[1.0, 1.0][: len(parts)]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=entities.TIME, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def _maps(panels: Sequence[Panel], sheet: Sheet) -> list[rrb.View | rrb.Container]:
    """A tab for all maps that share its name: side by side, or wide ones below one another."""
    tabs: list[rrb.View | rrb.Container] = []
    for tab in dict.fromkeys(panel.tab for panel in panels):
        shared = [panel for panel in panels if panel.tab == tab]
        views = [_map_view(panel, sheet, entities.MAP_COLOUR) for panel in shared]
        (left, right), (top, bottom) = sheet.bounds[shared[0].origin]
        beside = rrb.Horizontal if right - left < _WIDE * (bottom - top) else rrb.Vertical
        tabs.append(beside(*views, name=tab) if len(views) > 1 else views[0])
    return tabs


def _lanes_share(sheet: Sheet) -> float:
    """Height of the lanes where the field's is 3: four lanes fit in 1, and eight in 2.5."""
    lanes = sum(entity.startswith(f"{entities.STATE}/") for entity in sheet.entities)
    taken = _LANES_HEAD + _LANE * lanes
    return min(max(1.0, 3.0 * taken / max(1.0 - taken, 0.1)), 2.5)


def _root(panel: Panel) -> str:
    return f"/{panel.origin}"


def _whole(begin_ns: int, duration_ns: int) -> rrb.TimeAxis:
    """Show all from ``begin_ns`` to the end of the run, wherever the cursor is."""
    boundary = rrb.TimeRangeBoundary.absolute
    begin, end = begin_ns / NS_PER_S, max(duration_ns, 1) / NS_PER_S
    # a little more, for the label of the last tick
    end += 0.04 * (end - begin)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=boundary(seconds=begin), end=boundary(seconds=end)))


def _field_view(panel: Panel, sheet: Sheet) -> rrb.Spatial3DView:
    boundary = rrb.TimeRangeBoundary
    past = rrb.VisibleTimeRanges(
        timeline=entities.TIME, start=boundary.infinite(), end=boundary.cursor_relative(seconds=0.0)
    )
    eye = None
    if sheet.eye is not None:
        position, target = sheet.eye
        follow = f"/{sheet.follow}" if sheet.follow else None
        eye = rrb.EyeControls3D(position=position, look_target=target, eye_up=(0.0, 0.0, 1.0), tracking_entity=follow)
    return rrb.Spatial3DView(
        origin=_root(panel),
        name=panel.title,
        background=_SKY,
        line_grid=False,
        eye_controls=eye,
        # URDF primitives are see-through otherwise
        defaults=[rr.Boxes3D.from_fields(fill_mode="solid"), rr.Cylinders3D.from_fields(fill_mode="solid")],
        overrides={
            **{f"/{entity}": past for entity in sheet.past},
            **{f"/{entity}": rrb.EntityBehavior(visible=False) for entity in sheet.hidden},
        },
    )


def _map_view(panel: Panel, sheet: Sheet, background: entities.Colour) -> rrb.Spatial2DView:
    x_range, y_range = sheet.bounds[panel.origin]
    return rrb.Spatial2DView(
        origin=_root(panel),
        name=panel.title,
        background=background,
        visual_bounds=rrb.VisualBounds2D(x_range=x_range, y_range=y_range),
    )


def _plot_view(panel: Panel, sheet: Sheet, duration_ns: int) -> rrb.TimeSeriesView:
    curves = [later for curve in sheet.curves.get(panel.origin, []) if len((later := curve.since(sheet.begin_ns)).t_ns)]
    low, high = _range(curves)
    names = {curve.name for curve in curves}
    corner, hidden = emptiest_corner(curves, duration_ns, begin_ns=sheet.begin_ns)
    # What another panel lists with its colours need not be told again where that would cover curves.
    known = names <= sheet.listed or panel.origin in sheet.told_beside
    told = known and (len(names) > _LEGEND_MOST or hidden > _LEGEND_HIDES)
    return rrb.TimeSeriesView(
        origin=_root(panel),
        name=panel.title,
        axis_x=_whole(sheet.begin_ns, duration_ns),
        # The viewer's own choice of range leaves bands out and lets lines touch the frame.
        axis_y=rrb.ScalarAxis(range=(low, high)) if curves else None,
        plot_legend=rrb.PlotLegend(corner, visible=not told),
    )


def _range(curves: Sequence[Curve]) -> tuple[float, float]:
    """Range of a plot that holds its curves with a margin; what stands still is not blown up."""
    low = min((float(curve.values.min()) for curve in curves), default=0.0)
    high = max((float(curve.values.max()) for curve in curves), default=0.0)
    margin = max(0.06 * (high - low), 0.5 * (_LEAST_RANGE - (high - low)), 1e-6 * abs(high))
    return low - margin, high + margin


def emptiest_corner(curves: Sequence[Curve], duration_ns: int, *, begin_ns: int = 0) -> tuple[rrb.Corner2D, float]:
    """Corner of a plot, from ``begin_ns`` to ``duration_ns``, where a legend covers least of its curves; and how much.

    That is the share of all the area's cells through which curves go.
    """
    if not curves:
        return rrb.Corner2D.LeftTop, 0.0
    low, high = _range(curves)
    x = (np.concatenate([curve.t_ns for curve in curves]) - begin_ns) / max(duration_ns - begin_ns, 1)
    y = (np.concatenate([curve.values for curve in curves]) - low) / (high - low)
    # Area counts, not samples: a line that stands still covers little, however long.
    covered = np.zeros((_CELLS, _CELLS), dtype=bool)
    covered[np.clip(x * _CELLS, 0, _CELLS - 1).astype(int), np.clip(y * _CELLS, 0, _CELLS - 1).astype(int)] = True
    width = round(_LEGEND_WIDTH * _CELLS)
    height = round(min(1.0, _LEGEND_ENTRY * (len({curve.name for curve in curves}) + 0.5)) * _CELLS)
    columns = {"Left": slice(0, width), "Right": slice(_CELLS - width, _CELLS)}
    lines = {"Top": slice(_CELLS - height, _CELLS), "Bottom": slice(0, height)}
    counts = {
        f"{side}{end}": int(covered[across, along].sum())
        for end, along in lines.items()
        for side, across in columns.items()
    }
    best = min(counts, key=lambda corner: counts[corner])
    return rrb.Corner2D[best], counts[best] / int(covered.sum())


def _log_view(panel: Panel) -> rrb.TextLogView:
    return rrb.TextLogView(
        origin=_root(panel),
        name=panel.title,
        columns=rrb.TextLogColumns(timeline_columns=[entities.TIME], text_log_columns=["loglevel", "body"]),
    )


def _tabs(views: Sequence[rrb.View | rrb.Container]) -> rrb.View | rrb.Container | None:
    if len(views) < 2:
        return views[0] if views else None
    return rrb.Tabs(*views, active_tab=0)


def _column(parts: Sequence[rrb.View | rrb.Container | None], shares: Sequence[float]) -> rrb.Container | None:
    kept = [(part, share) for part, share in zip(parts, shares, strict=True) if part is not None]
    if not kept:
        return None
    return rrb.Vertical(*(part for part, _ in kept), row_shares=[share for _, share in kept])


def _beside(
    wide: rrb.View | rrb.Container | None, narrow: rrb.View | rrb.Container | None
) -> rrb.View | rrb.Container | None:
    if wide is None or narrow is None:
        return wide or narrow
    return rrb.Horizontal(wide, narrow, column_shares=[1.0, 1.0])


def _grid(plots: Sequence[rrb.View]) -> rrb.Container | None:
    """Two plots side by side, as the layers gave them; an odd last one has a line to itself."""
    if not plots:
        return None
    pairs = [plots[index : index + 2] for index in range(0, len(plots), 2)]
    return rrb.Vertical(*(rrb.Horizontal(*pair) if len(pair) == 2 else pair[0] for pair in pairs))
