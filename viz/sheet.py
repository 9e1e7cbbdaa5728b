"""What layers draw on: columns for the recording, and panels for the layout."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Protocol

import numpy as np
import rerun as rr

from twin.recording import Recording, Stream
from twin.signals import HEIGHT, LANE_OFFSET, FloatArray, IntArray
from viz import entities
from viz.scene import Scene


class PanelKind(Enum):
    """What a panel shows; the layout gives each kind its place."""

    FIELD = auto()
    MAP = auto()
    PICTURE = auto()
    DIAL = auto()
    PLOT = auto()
    LANES = auto()
    LOG = auto()
    PAGE = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """A part of the window that a layer has filled."""

    kind: PanelKind
    origin: str
    """Entity path; the panel shows it and everything below."""
    title: str
    """With the unit in brackets."""
    tab: str = ""
    """Name of the tab that maps share, side by side."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A line in a plot, or the edge of a band; of the same name is what shares an entry in the legend."""

    name: str
    t_ns: IntArray
    """(T,), T > 0."""
    values: FloatArray
    """(T,) finite."""

    def since(self, begin_ns: int) -> Curve:
        """The part from ``begin_ns`` on; may be empty."""
        kept = self.t_ns >= begin_ns
        return Curve(name=self.name, t_ns=self.t_ns[kept], values=self.values[kept])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """What is to be drawn: one member of a recording, its score and its surroundings."""

    recording: Recording
    scene: Scene
    result: dict[str, Any]
    """In the shape of ``result.json``; parts that are missing are left out of the page."""
    member: int = 0
    """Place on the ensemble axis."""

    @property
    def duration_ns(self) -> int:
        """Last time in any stream, ns."""
        return max((int(stream.t_ns[-1]) for stream in self.recording.streams.values() if len(stream)), default=0)

    @property
    def truth(self) -> Stream | None:
        """The truth, or ``None`` where there is none (a real log)."""
        return self.recording.streams.get("truth")

    @property
    def keeps_lane(self) -> bool:
        """Whether the machine's driver keeps to a lane."""
        return self.truth is not None and self.truth.has(LANE_OFFSET)

    @property
    def levels(self) -> bool:
        """Whether the height of the machine's implement is what it is about."""
        return self.truth is not None and self.truth.has(HEIGHT)

    @property
    def estimators(self) -> list[str]:
        """Names of the estimators that are drawn."""
        return [name for name in self.recording.names("estimates") if name not in self.scene.hidden]

    @property
    def colours(self) -> dict[str, entities.Colour]:
        """Colour of each estimator; by name, so that a recording has the same in memory and read from disk."""
        return entities.estimator_colours(sorted(self.estimators))

    def column(self, stream: Stream, name: str) -> FloatArray:
        """One column of this member, (T,); the truth is shared by all members."""
        values = stream.column(name)
        return values[:, min(self.member, values.shape[1] - 1)]

    def columns(self, stream: Stream, *names: str) -> FloatArray | None:
        """Several columns side by side, (T, len(names)), or ``None`` unless the stream has them all and has rows."""
        if not len(stream) or not all(stream.has(name) for name in names):
            return None
        values = stream.select(names)
        return values[:, min(self.member, values.shape[1] - 1)]


class Layer(Protocol):
    """Draws one subject; draws nothing where the streams or columns it needs are absent."""

    def __call__(self, run: Run, sheet: Sheet) -> None:
        """Draw ``run`` on ``sheet``."""


class Sheet:
    """Sends columns to a recording stream and remembers what the layout has to know."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self.stream = stream
        self._rows: list[tuple[str, rr.TimeColumn, Iterable[rr.ComponentColumn]]] = []
        self.entities: set[str] = set()
        """Every entity drawn through this sheet, without leading slash."""
        self.panels: list[Panel] = []
        self.past: list[str] = []
        """Spatial entities of which everything up to the cursor is shown, not only the latest."""
        self.hidden: list[str] = []
        self.curves: dict[str, list[Curve]] = {}
        """What each plot holds, for its range and for a legend that covers little."""
        self.bounds: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {}
        """What a map shows at first: range to the right and range downwards, by its origin."""
        self.listed: set[str] = set()
        """Names of series that a panel other than the plots lists with their colours."""
        self.told_beside: set[str] = set()
        """Plots that need no legend where it would cover curves, since the plot beside has the same names."""
        self.begin_ns = 0
        """Where the plots begin: later than the run, if the machine stands for most of it."""
        self.follow: str | None = None
        """Entity that the camera follows."""
        self.eye: tuple[FloatArray, FloatArray] | None = None
        """Where the camera stands at the start, and what it looks at."""

    def static(self, entity: str, archetype: rr.AsComponents) -> None:
        """Draw something that never changes."""
        self.entities.add(entity)
        self.stream.log(entity, archetype, static=True, strict=True)

    def rows(self, entity: str, t_ns: IntArray, columns: Iterable[rr.ComponentColumn]) -> None:
        """Draw rows in time: one row of every column at each of ``t_ns`` (T,), exact to the nanosecond."""
        if not len(t_ns):
            return
        self.entities.add(entity)
        # Not floats: the SDK truncates float seconds here and rounds them elsewhere, so that rows would not join.
        time = rr.TimeColumn(entities.TIME, duration=t_ns.astype("timedelta64[ns]"))
        self._rows.append((entity, time, columns))

    def finish(self) -> None:
        """Send the rows, behind all that never changes.

        A viewer draws while it reads: a mesh whose corners come before its triangles is an error to it.
        """
        self.stream.flush()
        for entity, time, columns in self._rows:
            self.stream.send_columns(entity, [time], columns, strict=True)
        self._rows.clear()

    def curve(self, entity: str, name: str, t_ns: IntArray, values: FloatArray) -> None:
        """Remember what a series looks like; its plot is the entity above."""
        if len(t_ns):
            self.curves.setdefault(entity.rpartition("/")[0], []).append(Curve(name=name, t_ns=t_ns, values=values))

    def line(
        self,
        entity: str,
        t_ns: IntArray,
        values: FloatArray,
        colour: entities.Colour,
        *,
        width: float = 1.5,
        name: str = "",
        within: tuple[float, float] = (-math.inf, math.inf),
        broken: bool = False,
    ) -> None:
        """Draw one line of a plot, named after the entity's last part unless told; gaps (NaN) are left out.

        The line goes straight over a gap, unless it is to be ``broken`` there. What lies outside of ``within`` does not
        widen the plot's range.
        """
        known, name = np.isfinite(values), name or entities.legend_name(entity.rpartition("/")[2])
        sent = known.copy()
        if broken:
            sent[1:] |= known[:-1]
        self.rows(entity, t_ns[sent], rr.Scalars.columns(scalars=values[sent]))
        self.curve(entity, name, t_ns[known], np.clip(values[known], *within))
        if known.any():
            self.static(entity, rr.SeriesLines(colors=[colour], names=[name], widths=[width]))

    def band(
        self,
        entity: str,
        t_ns: IntArray,
        middle: FloatArray,
        sigma: FloatArray,
        colour: entities.Colour,
    ) -> None:
        """Draw one claimed standard deviation to either side of ``middle`` beside the line of ``entity``.

        It has that line's name, so that both share an entry in the legend.
        """
        known, name = np.isfinite(middle) & np.isfinite(sigma), entities.legend_name(entity.rpartition("/")[2])
        columns = rr.Measurements.columns(values=middle[known], variances=sigma[known] ** 2)
        self.rows(entities.band(entity), t_ns[known], columns)
        if known.any():
            style = rr.Measurements.from_fields(colors=[colour], names=[name], widths=[0.5])
            self.static(entities.band(entity), style)

    def panel(self, kind: PanelKind, origin: str, title: str, *, tab: str = "") -> None:
        """Ask for a panel, once something was drawn at or below ``origin``; asking again changes nothing."""
        drawn = any(entity == origin or entity.startswith(origin + "/") for entity in self.entities)
        if drawn and all(panel.origin != origin for panel in self.panels):
            self.panels.append(Panel(kind=kind, origin=origin, title=title, tab=tab))
