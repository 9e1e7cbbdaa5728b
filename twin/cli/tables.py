"""The tables and lines that say what came of runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table
from rich.text import Text

from twin.families import FAMILIES
from twin.formats.can import BusLoad
from twin.scenario import Scenario
from twin.scoring import Repetitions
from twin.scoring.guidance import HEADLINES as GUIDANCE_HEADLINES
from twin.scoring.repetitions import Spread

if TYPE_CHECKING:
    from twin.cli.running import Crash

COLOURS = {"pass": "bold green", "fail": "bold red", "error": "bold magenta"}
_SEEDS = (
    "seeds.mean_abs_population_error_turns_percent",
    "seeds.quality_of_feed_percent",
    "seeds.precision_percent",
)
_HEADLINES = {
    *_SEEDS,
    *GUIDANCE_HEADLINES,
    *(family.metric(figure, "") for family in FAMILIES for figure in family.shown),
}
_SUMMARY = tuple(
    family.metric(figure, "")
    for family in sorted(FAMILIES, key=lambda family: family.summary_rank)
    for figure in family.summary
)
"""What an estimator without a published figure is summed up by: the first of these that it has."""
_CROP = "seeds.mean_abs_population_error_turns_percent"
_CRASHED = "crashed"
_THREE_DIGITS, _A_MILLION = 999.5, 999_999.5


def metrics_table(found: Repetitions) -> Table:
    """Headline, published and checked metrics of each estimator, beside the published figure where there is one.

    Of several repetitions the mean, and from where to where they reach.
    """
    published = found.scenario.published
    asked = {*published, *(outcome.metric for outcome in found.checks)}
    repeated = len(found.verdicts) > 1
    table = Table()
    table.add_column("estimator")
    table.add_column("metric")
    for heading in ("mean", "range", "published") if repeated else ("twin", "published"):
        table.add_column(heading, justify="right")
    last = ""
    for name, spread in found.metrics().items():
        estimator, _, metric = name.partition(".")
        if name not in asked and (metric not in _HEADLINES or not math.isfinite(spread.mean)):
            continue
        reach = [_range(spread)] if repeated else []
        shown = estimator if estimator != last else ""
        table.add_row(shown, metric, figure(spread.mean), *reach, figure(published.get(name)))
        last = estimator
    return table


def _range(spread: Spread) -> str:
    low, high = figure(spread.low), figure(spread.high)
    return low if low == high else f"{low} .. {high}"


def bus_table(scenario: Scenario) -> Table:
    """What each bus of a scenario has to carry, and whether it can."""
    table = Table(title="Bus load (CAN 2.0B, 29-bit identifiers)")
    for heading in ("bus", "architecture"):
        table.add_column(heading)
    for heading in ("Hz", "kB/s", "frames/s", "nominal %", "worst %"):
        table.add_column(heading, justify="right")
    table.add_column("possible")
    for name, config in scenario.bus.items():
        load = config.load()
        central = f"central, {config.senders} to {config.receivers}"
        table.add_row(
            name,
            central if config.architecture == "central" else config.architecture,
            f"{config.rate_hz:g}",
            figure(load.payload_kb_s),
            f"{load.frames_per_s:g}",
            figure(load.load_nominal_percent),
            figure(load.load_worst_percent),
            _possible(load),
        )
    return table


def _possible(load: BusLoad) -> str:
    if load.load_worst_percent <= 100.0:
        return "yes"
    return "no" if load.load_nominal_percent > 100.0 else "not at worst"


# --- after several scenarios -----------------------------------------------------------------------------------------


def summary_table(finished: Sequence[Repetitions | Crash]) -> Table:
    """Of each scenario a line per published metric, and one per estimator that has none."""
    table = Table(title="All scenarios", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in ("scenario", "estimator", "metric"):
        table.add_column(heading, overflow="fold")
    for heading in ("twin", "published", "ratio", "seeds %"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for entry in finished:
        if not isinstance(entry, Repetitions):
            table.add_row(entry.scenario, *[""] * 6, Text(_CRASHED, style=COLOURS["error"]))
            continue
        verdict = Text(entry.verdict, style=COLOURS[entry.verdict])
        rows = _summary_rows(entry) or [[""] * 6]
        for index, row in enumerate(rows):
            first = index == 0
            table.add_row(entry.scenario_name if first else "", *row, verdict if first else "")
    return table


def _summary_rows(found: Repetitions) -> list[list[str]]:
    """Estimator, metric, our mean, the published figure, their ratio, and how many seeds are too many or too few."""
    metrics = found.metrics()
    rows, last = [], ""
    for name in _summarised(found, metrics):
        estimator, _, metric = name.partition(".")
        ours, paper = metrics[name].mean, found.scenario.published.get(name)
        ratio = ours / paper if paper else None
        first = estimator != last
        crop = metrics.get(f"{estimator}.{_CROP}") if first else None
        cells = [figure(ours), figure(paper), figure(ratio), figure(None if crop is None else crop.mean)]
        rows.append([estimator if first else "", metric, *cells])
        last = estimator
    return rows


def _summarised(found: Repetitions, metrics: dict[str, Spread]) -> list[str]:
    """Published metrics, and the headline of every estimator without one; else what the first check is about."""
    names = list(found.scenario.published)
    known = [name for name, spread in metrics.items() if math.isfinite(spread.mean)]
    for estimator in found.scenario.estimators:
        if not any(name.startswith(f"{estimator}.") for name in names):
            mine = [f"{estimator}.{headline}" for headline in _SUMMARY]
            names += [name for name in mine if name in known][:1]
    return names or [outcome.metric for outcome in found.checks[:1]]


def counts(finished: Sequence[Repetitions | Crash]) -> Text:
    """How many scenarios passed, failed and so on, and how many checks hold."""
    verdicts = [entry.verdict if isinstance(entry, Repetitions) else _CRASHED for entry in finished]
    checks = [outcome.ok for entry in finished if isinstance(entry, Repetitions) for outcome in entry.checks]
    line = Text(f"{len(finished)} scenarios:")
    for kind in ("pass", "fail", "error", _CRASHED):
        if kind in verdicts:
            line.append(" ")
            line.append(f"{verdicts.count(kind)} {kind}", style=COLOURS.get(kind, COLOURS["error"]))
    return line.append(f"; {sum(checks)} of {len(checks)} checks hold")


def verdict_words(verdict: str, *, checked: bool) -> Text:
    """``verdict: pass``, and where nothing was checked that it was not."""
    line = Text.assemble("verdict: ", (verdict, COLOURS[verdict]))
    return line if checked or verdict != "pass" else line.append(" (no checks)")


# --- figures ---------------------------------------------------------------------------------------------------------


def figure(value: float | None) -> str:
    """Three digits, or all before the point up to a million; ``never`` for an infinite time, a dash for no number."""
    if value is None:
        return ""
    if math.isinf(value):
        return "never"
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if _THREE_DIGITS <= abs(value) < _A_MILLION else f"{value:.3g}"


def tick(ok: bool) -> tuple[str, str]:
    """Text and colour of a check's outcome."""
    return ("ok  ", "green") if ok else ("FAIL", "bold red")
