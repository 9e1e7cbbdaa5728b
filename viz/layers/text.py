"""The event log and the page: what was run, what came out, and the verdict."""

from __future__ import annotations

import numpy as np
import rerun as rr

from twin.signals import NS_PER_S
from viz import entities
from viz.legible import legible
from viz.page import page
from viz.sheet import PanelKind, Run, Sheet


def draw_events(run: Run, sheet: Sheet) -> None:
    """Write the event log, an entity per source."""
    for source in dict.fromkeys(event.source for event in run.recording.events):
        heard = [event for event in run.recording.events if event.source == source]
        sheet.rows(
            entities.event_log(source),
            np.array([event.t_ns for event in heard], dtype=np.int64),
            rr.TextLog.columns(
                # with the time, since the log's own column of it is too narrow to read
                text=[legible(f"{event.t_ns / NS_PER_S:.2f} s  {source}: {event.text}") for event in heard],
                level=[entities.LEVEL_NAMES.get(event.level, event.level.upper()) for event in heard],
            ),
        )
    sheet.panel(PanelKind.LOG, entities.EVENTS, "Events")


def draw_page(run: Run, sheet: Sheet) -> None:
    """Write the page about scenario, metrics, checks and verdict."""
    sheet.static(
        entities.PAGE, rr.TextDocument(legible(page(run.recording, run.result)), media_type=rr.MediaType.MARKDOWN)
    )
    verdict = run.result.get("verdict")
    sheet.panel(PanelKind.PAGE, entities.PAGE, f"Scenario and verdict: {verdict}" if verdict else "Scenario")
