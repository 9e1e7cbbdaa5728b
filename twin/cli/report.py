"""What a person sees of a run: progress, table, verdict, where the files are."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from twin.scenario import LoadedScenario
from twin.scoring import Verdict

if TYPE_CHECKING:
    from twin.cli.running import Crash

COLOURS = {"pass": "bold green", "fail": "bold red", "error": "bold magenta"}
_HEADLINES = (
    "seeds.mean_abs_population_error_turns_percent",
    "seeds.quality_of_feed_percent",
    "seeds.precision_percent",
    "row_speed.mean_abs_error_m_s",
    "row_speed.mean_abs_error_turns_m_s",
    "position.rmse_m",
    "heading.mean_abs_error_deg",
)
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
            yield self._plain(loaded.name, duration_s)
            return
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"))
        with Progress(*columns, TimeRemainingColumn(), console=self._console, transient=True) as bar:
            task = bar.add_task(loaded.name, total=duration_s)
            yield lambda t_s: bar.update(task, completed=t_s)

    def _plain(self, name: str, duration_s: float) -> Callable[[float], None]:
        last = time.monotonic()

        def line(t_s: float) -> None:
            nonlocal last
            if time.monotonic() - last >= _PLAIN_LINE_EVERY_S:
                last = time.monotonic()
                self._console.print(f"{name}: {t_s:.0f} of {duration_s:g} s")

        return line

    def result(self, loaded: LoadedScenario, verdict: Verdict, folder: Path | None, *, rrd: bool) -> None:
        """Table, checks, verdict, speed, and where the files are."""
        self._console.print()
        self._console.print(Text(loaded.scenario.title, style="bold"))
        if loaded.scenario.source:
            self._console.print(f"after {loaded.scenario.source}")
        self._console.print(metrics_table(verdict))
        for outcome in verdict.checks:
            self._console.print(Text.assemble(tick(outcome.ok), " ", outcome.sentence()))
        for line in verdict.drifted:
            self._console.print(Text.assemble(tick(False), " baseline: ", line))
        if loaded.scenario.notes:
            self._console.print(Text(loaded.scenario.notes.strip(), style="dim"))
        self._console.print(self._last_line(verdict))
        if folder is not None:
            self._console.print(f"files: {folder}")
            if rrd:
                self._console.print(f"look:  twin view {folder}")

    @staticmethod
    def _last_line(verdict: Verdict) -> Text:
        timing = verdict.timing
        line = Text.assemble("verdict: ", (verdict.verdict, COLOURS[verdict.verdict]))
        if verdict.ended_reason != "duration":
            line.append(f" ({verdict.ended_reason} at {verdict.ended_t_s:.2f} s)")
        if "wall_s" in timing:
            line.append(
                f"   {timing['simulated_s']:.0f} s simulated in {timing['wall_s']:.1f} s: "
                f"{timing['real_time_factor']:.0f} times real time"
            )
        return line

    def summary(self, finished: Sequence[Verdict | Crash]) -> None:
        """One line per scenario after several."""
        table = Table(title="All scenarios")
        for heading in ("scenario", "verdict", "checks", "metric", "ours", "published"):
            table.add_column(heading, justify="right" if heading in {"ours", "published"} else "left")
        for entry in finished:
            if not isinstance(entry, Verdict):
                table.add_row(entry.scenario, Text("crashed", style="bold magenta"), "", "", "", "")
                continue
            held = f"{sum(outcome.ok for outcome in entry.checks)} of {len(entry.checks)}"
            first: list[str | Text] = [entry.scenario_name, Text(entry.verdict, style=COLOURS[entry.verdict]), held]
            rows = [
                (metric, entry.metrics.get(metric, math.nan), paper)
                for metric, paper in entry.scenario.published.items()
            ]
            if not rows:
                table.add_row(*first, "", "", "")
            for index, (metric, ours, paper) in enumerate(rows):
                table.add_row(*(first if index == 0 else ["", "", ""]), metric, figure(ours), figure(paper))
        self._console.print(table)

    def line(self, text: str | Text) -> None:
        """Print one line."""
        self._console.print(text)

    def table(self, table: Table) -> None:
        """Print a table."""
        self._console.print(table)


def metrics_table(verdict: Verdict) -> Table:
    """Headline, published and checked metrics of each estimator, beside the published figure where there is one."""
    published = verdict.scenario.published
    asked = {*published, *(outcome.check.metric for outcome in verdict.checks)}
    table = Table()
    table.add_column("estimator")
    table.add_column("metric")
    table.add_column("ours", justify="right")
    table.add_column("published", justify="right")
    last = ""
    for name, value in verdict.metrics.items():
        estimator, _, metric = name.partition(".")
        if name not in asked and (metric not in _HEADLINES or not math.isfinite(value)):
            continue
        table.add_row(
            estimator if estimator != last else "",
            metric,
            figure(value),
            figure(published.get(name)),
        )
        last = estimator
    return table


def figure(value: float | None) -> str:
    """Three digits; ``never`` for an infinite time, a dash for what is not a number."""
    if value is None:
        return ""
    if math.isinf(value):
        return "never"
    return f"{value:.3g}" if math.isfinite(value) else "-"


def tick(ok: bool) -> tuple[str, str]:
    """Text and colour of a check's outcome."""
    return ("ok  ", "green") if ok else ("FAIL", "bold red")
