"""What a person sees of a run: progress, table, verdict, where the files are."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from twin.cli.tables import bus_table, counts, metrics_table, summary_table, tick, verdict_words
from twin.scenario import LoadedScenario
from twin.scoring import Repetitions

if TYPE_CHECKING:
    from twin.cli.running import Crash

_PLAIN_LINE_EVERY_S = 5.0
_LOG_WIDTH = 160


class Reporter:
    """Prints to standard output; nothing at all where ``quiet`` (for ``--json``)."""

    def __init__(self, *, quiet: bool) -> None:
        terminal = Console().is_terminal
        # Elsewhere there is no width to keep to: a log file should hold whole names and unbroken lines.
        width = None if terminal else _LOG_WIDTH
        self._console = Console(quiet=quiet, highlight=False, markup=False, soft_wrap=not terminal, width=width)

    @contextmanager
    def progress(self, loaded: LoadedScenario) -> Iterator[Callable[[float], None]]:
        """A bar on a terminal, a plain line now and then elsewhere."""
        duration_s = loaded.scenario.duration_s
        if not self._console.is_terminal:
            self._console.print(f"{loaded.name}: {loaded.scenario.title}")
            yield self._now_and_then(lambda t_s: f"{loaded.name}: {t_s} of {duration_s:g} s")
            return
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"))
        with Progress(*columns, TimeRemainingColumn(), console=self._console, transient=True) as bar:
            task = bar.add_task(loaded.name, total=duration_s)
            yield lambda t_s: bar.update(task, completed=t_s)

    def _now_and_then(self, sentence: Callable[[str], str]) -> Callable[[float], None]:
        """A plain line every few seconds about the time (whole seconds) that has been reached, where there is news."""
        last, shown = time.monotonic(), "0"

        def line(t_s: float) -> None:
            nonlocal last, shown
            reached = f"{t_s:.0f}"
            if reached not in {"0", shown} and time.monotonic() - last >= _PLAIN_LINE_EVERY_S:
                last, shown = time.monotonic(), reached
                self._console.print(sentence(reached))

        return line

    def log_progress(self, name: str) -> Callable[[float], None]:
        """A plain line now and then about a log whose length nobody knows."""
        return self._now_and_then(lambda t_s: f"{name}: {t_s} s read")

    def result(self, loaded: LoadedScenario, found: Repetitions, folders: Sequence[Path], *, rrd: bool) -> None:
        """Table, checks, verdict, speed, and where the files are."""
        self._console.print()
        self._console.print(Text(loaded.scenario.title, style="bold"))
        if loaded.scenario.source:
            self._console.print(f"after {loaded.scenario.source}")
        self._console.print(metrics_table(found))
        if loaded.scenario.bus:
            self._console.print(bus_table(loaded.scenario))
        for outcome in found.checks:
            self._console.print(Text.assemble(tick(outcome.ok), " ", outcome.sentence()))
        for line in found.first.drifted:
            self._console.print(Text.assemble(tick(False), " baseline: ", line))
        if loaded.scenario.notes:
            self._console.print(Text(loaded.scenario.notes.strip(), style="dim"))
        self._console.print(self._last_line(found))
        for folder in folders:
            self._console.print(f"files: {folder}")
        if folders and rrd:
            self._console.print(f"look:  twin view {folders[0]}")

    @staticmethod
    def _last_line(found: Repetitions) -> Text:
        line = verdict_words(found.verdict, checked=bool(found.checks) or found.first.baseline_compared)
        early = next((each for each in found.verdicts if each.ended_reason != "duration"), None)
        if early is not None:
            line.append(f" ({early.ended_reason} at {early.ended_t_s:.2f} s)")
        if found.wall_s > 0.0:
            count = len(found.verdicts)
            simulated_s = found.first.timing["simulated_s"]
            each = f"{count} runs of " if count > 1 else ""
            line.append(
                f"   {each}{simulated_s:.0f} s simulated in {found.wall_s:.1f} s: "
                f"{count * simulated_s / found.wall_s:.0f} times real time"
            )
        return line

    def summary(self, finished: Sequence[Repetitions | Crash]) -> None:
        """All scenarios in one table, and how many passed."""
        self._console.print()
        self._console.print(summary_table(finished))
        self._console.print(counts(finished))

    def line(self, text: str | Text) -> None:
        """Print one line."""
        self._console.print(text)

    def table(self, table: Table) -> None:
        """Print a table."""
        self._console.print(table)
