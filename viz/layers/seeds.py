"""The seeds in the ground: on the field, on a map of one turn, and as a plot of the outer row's population.

Drawn of two estimators, the first (today's practice) and the last of those whose seeds were recorded: on the field
one after the other, since their seeds lie in the same rows, on maps of the same turn side by side. A seed's colour
says how many seeds there are around it, for what a turn does (a quarter too many or too few) cannot be seen from one
spacing among seeds that scatter by a tenth; doubles and gaps have colours of their own.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from twin.recording import Stream, seed_stream_name
from twin.signals import NS_PER_S, YAW_RATE, FloatArray, IntArray, row_position
from viz import entities
from viz.legible import legible
from viz.sheet import PanelKind, Run, Sheet

NEIGHBOURS = 9
"""Spacings over which the population around a seed is taken for its colour: 1.4 m of maize."""
PLOT_NEIGHBOURS = 25
"""The same for the plot, where doubles and gaps count: 4 m of maize."""
FULL_COLOUR = 0.25
"""Population error at which the colour is full."""
MAP_M = 13.0
"""Side of a map."""
_BATCH_NS = NS_PER_S // 5
_RADIUS_M = 0.05
_FIELD_RADIUS_M = 0.07
_LIFT_M = 0.1
"""On the field seeds lie on top of the rows' trails, which would cover them."""
_MULTIPLE, _FEED, _MISS = 0, 1, 2
_MOST_PERCENT = 150.0
"""To which a plot reaches at first: seeds piled at a standstill must not flatten it."""
_LEGEND_M = (4.0, 3.8)
_TURNING_RAD_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planted:
    """The seeds of one estimator, in order of landing."""

    estimator: str
    t_ns: IntArray
    """(N,) when they came to rest."""
    row: IntArray
    """(N,) row unit, counted from 1."""
    points: FloatArray
    """(N, 2) east and north."""
    spacing: FloatArray
    """(N,) in units of the wanted one; NaN for a row's first seed."""
    feed_class: FloatArray
    """(N,)."""


def draw_seeds(run: Run, sheet: Sheet) -> None:
    """Draw the seeds of the first and the last estimator that metered some."""
    shown = [planted for planted in (planted_by(run, name) for name in shown_estimators(run)) if planted]
    bounds = _turn_bounds(run)
    for place, planted in enumerate(shown):
        _draw_on_field(run, sheet, planted, hidden=place > 0)
        if bounds is not None:
            _draw_map(run, sheet, planted, bounds)


def draw_population_plot(run: Run, sheet: Sheet) -> None:
    """Plot the population of the leftmost row, of every estimator that metered seeds."""
    if not run.scene.outer_rows:
        return
    row = run.scene.outer_rows[0]
    panel = f"row_{row}_population"
    for name in _seeding(run):
        planted = planted_by(run, name)
        if planted is None:
            continue
        own = planted.row == row
        percent = 100.0 * local_population(planted.spacing[own], PLOT_NEIGHBOURS)
        seen = np.isfinite(percent)
        t_ns, values = planted.t_ns[own][seen], percent[seen]
        entity, label = entities.plot(panel, name), entities.legend_name(name)
        sheet.rows(entity, t_ns, rr.Scalars.columns(scalars=values))
        sheet.curve(entity, label, t_ns, np.minimum(values, _MOST_PERCENT))
        if len(t_ns):
            sheet.static(entity, rr.SeriesLines(colors=[run.colours[name]], names=[label], widths=[1.5]))
    sheet.panel(PanelKind.PLOT, entities.plot(panel), f"Seeds in row {row}, of those wanted [%]")


def _seeding(run: Run) -> list[str]:
    """Estimators whose seeds were recorded and that are drawn."""
    return [name for name in run.recording.names("seeds") if name in run.estimators]


def shown_estimators(run: Run) -> list[str]:
    """The first and the last of them."""
    names = _seeding(run)
    return list(dict.fromkeys([*names[:1], *names[-1:]]))


def planted_by(run: Run, estimator: str) -> Planted | None:
    """The seeds of one estimator, or None where there is nothing to draw."""
    stream: Stream = run.recording.streams[seed_stream_name(estimator)]
    values = run.columns(stream, "row", "position_e_m", "position_n_m", "spacing_m", "feed_class")
    wanted_m = tomllib.loads(run.recording.scenario_toml).get("seeding", {}).get("spacing_m")
    if values is None or not wanted_m:
        return None
    return Planted(
        estimator=estimator,
        t_ns=stream.t_ns,
        row=values[:, 0].astype(np.int64),
        points=values[:, 1:3],
        spacing=values[:, 3] / wanted_m,
        feed_class=values[:, 4],
    )


def local_population(spacing: FloatArray, neighbours: int) -> FloatArray:
    """Population around each seed of one row (N,): one over the mean of the spacings (N,) around it.

    Spacings that are NaN do not count. NaN where none is known, infinite where all seeds around lie on one spot.
    """
    window, half = np.ones(neighbours), neighbours // 2

    def summed(values: FloatArray) -> FloatArray:
        whole: FloatArray = np.convolve(values, window)[half : half + len(values)]
        return whole

    known = np.isfinite(spacing)
    metres = np.maximum(summed(np.where(known, spacing, 0.0)), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        population: FloatArray = summed(known.astype(np.float64)) / metres
    return population


def seed_colours(planted: Planted) -> FloatArray:
    """Colours (N, 3), 0 to 255: from too many over even to too few; doubles and seeds behind a gap in their own.

    The population is that of the singulated seeds around: a double or a gap does not colour its neighbours.
    """
    population = np.full(len(planted.row), np.nan)
    for row in np.unique(planted.row):
        own = planted.row == row
        singulated = np.where(planted.feed_class[own] == _FEED, planted.spacing[own], np.nan)
        population[own] = local_population(singulated, NEIGHBOURS)
    share = np.clip(np.nan_to_num((population - 1.0) / FULL_COLOUR, posinf=1.0), -1.0, 1.0)[:, np.newaxis]
    even, dense, sparse = (
        np.array(colour, dtype=np.float64)
        for colour in (entities.EVEN_COLOUR, entities.DENSE_COLOUR, entities.SPARSE_COLOUR)
    )
    colours: FloatArray = even + np.abs(share) * (np.where(share > 0.0, dense, sparse) - even)
    colours[planted.feed_class == _MULTIPLE] = entities.DOUBLE_COLOUR
    colours[planted.feed_class == _MISS] = entities.GAP_COLOUR
    return colours


def _packed(colours: FloatArray) -> NDArray[np.uint32]:
    """Colours (N, 3) as 0xRRGGBBAA."""
    opaque = np.column_stack([np.rint(colours), np.full(len(colours), 255.0)]).astype(np.uint32)
    packed: NDArray[np.uint32] = (opaque << np.array([24, 16, 8, 0], dtype=np.uint32)).sum(axis=1, dtype=np.uint32)
    return packed


def _draw_on_field(run: Run, sheet: Sheet, planted: Planted, *, hidden: bool) -> None:
    """Draw all seeds where they lie, growing with the cursor."""
    entity = entities.seeds(planted.estimator)
    height = run.scene.height_at(planted.points[:, 0], planted.points[:, 1]) + _LIFT_M
    places = np.column_stack([planted.points, height]).astype(np.float32)
    batch, lengths = np.unique(-(-planted.t_ns // _BATCH_NS), return_counts=True)
    colours = _packed(seed_colours(planted))
    columns = rr.Points3D.columns(positions=places, colors=colours).partition(lengths)
    sheet.rows(entity, batch * _BATCH_NS, columns)
    sheet.static(entity, rr.Points3D.from_fields(radii=_FIELD_RADIUS_M))
    sheet.past.append(entity)
    if hidden:
        sheet.hidden.append(entity)


# --- map of one turn -------------------------------------------------------------------------------------------------


def _turn_bounds(run: Run) -> tuple[FloatArray, FloatArray] | None:
    """South-western and north-eastern corner of a square around the middle of the longest turn; None without rows."""
    rows = run.scene.outer_rows
    truth = run.truth
    if truth is None or not rows:
        return None
    places = run.columns(truth, *row_position(rows[0]), *row_position(rows[-1]))
    yaw_rate = run.columns(truth, YAW_RATE)
    if places is None or yaw_rate is None:
        return None
    middle = _middle_of_longest_turn(yaw_rate[:, 0])
    centre = (places[middle, :2] + places[middle, 2:]) / 2.0
    return centre - MAP_M / 2.0, centre + MAP_M / 2.0


def _middle_of_longest_turn(yaw_rate: FloatArray) -> int:
    """Index at which half of the greatest turn to one side (T,) has passed; the middle of the run without any."""
    side = np.where(np.abs(yaw_rate) > _TURNING_RAD_S, np.sign(yaw_rate), 0.0)
    stretch = np.cumsum(np.diff(side, prepend=side[:1]) != 0.0)
    turned = np.bincount(stretch, yaw_rate * side)
    if not turned.any():
        return len(yaw_rate) // 2
    inside = np.flatnonzero(stretch == np.argmax(turned))
    passed = np.cumsum(np.abs(yaw_rate[inside]))
    return int(inside[np.searchsorted(passed, passed[-1] / 2.0)])


def _draw_map(run: Run, sheet: Sheet, planted: Planted, bounds: tuple[FloatArray, FloatArray]) -> None:
    """Draw all seeds on a map with north up, whatever the cursor says, and what the outer rows' population is."""
    root = entities.seed_map(planted.estimator)
    flat = planted.points * (1.0, -1.0)
    sheet.static(
        f"{root}/seeds",
        rr.Points2D(
            flat.astype(np.float32),
            colors=_packed(seed_colours(planted)),
            radii=_RADIUS_M,
        ),
    )
    low, high = bounds
    inside = ((planted.points > low + 1.0) & (planted.points < high - 1.0)).all(axis=1)
    middle = planted.points[inside].mean(axis=0) if inside.any() else low
    labels, places = [], []
    for row in run.scene.outer_rows:
        own = inside & (planted.row == row) & np.isfinite(planted.spacing)
        if own.any():
            labels.append(_in_words(row, 1.0 / float(planted.spacing[own].mean()) - 1.0))
            at = planted.points[own][int(own.sum()) // 2]
            away = (at - middle) / max(1e-9, float(np.hypot(*(at - middle))))
            places.append((at + 1.6 * away) * (1.0, -1.0))
    if labels:
        sheet.static(
            f"{root}/rows",
            rr.Points2D(places, labels=labels, show_labels=True, radii=0.0, colors=[entities.TRUTH_COLOUR]),
        )
    _draw_legend(sheet, f"{root}/legend", flat, bounds)
    sheet.bounds[root] = ((float(low[0]), float(high[0])), (float(-high[1]), float(-low[1])))
    title = f"Seeds metered by {entities.legend_name(planted.estimator)}"
    sheet.panel(PanelKind.MAP, root, title, tab="Seeds in a turn")


def _draw_legend(sheet: Sheet, entity: str, flat: FloatArray, bounds: tuple[FloatArray, FloatArray]) -> None:
    """Draw the meaning of the colours in that corner of a map where it covers fewest seeds (N, 2)."""
    (west, south), (east, north) = bounds
    wide, tall = _LEGEND_M
    corners = [np.array([x, y]) for x in (west, east - wide) for y in (-north, -south - tall)]
    covered = [int(((flat > corner) & (flat < corner + _LEGEND_M)).all(axis=1).sum()) for corner in corners]
    corner = corners[int(np.argmin(covered))]
    below = np.outer(np.arange(len(entities.SEED_LEGEND)), (0.0, tall / len(entities.SEED_LEGEND)))
    sheet.static(
        entity,
        rr.Points2D(
            corner + np.array([wide / 2.0, 0.4]) + below,
            labels=[text for text, _ in entities.SEED_LEGEND],
            colors=[colour for _, colour in entities.SEED_LEGEND],
            show_labels=True,
            radii=0.1,
        ),
    )


def _in_words(row: int, error: float) -> str:
    percent = round(100.0 * abs(error))
    told = "as wanted" if percent < 1 else f"{percent} % too {'many' if error > 0.0 else 'few'}"
    return legible(f"row {row}: {told}")
