"""What ``twin stress`` does."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table
from rich.text import Text

from twin import scenario as scenario_files
from twin.cli import EXIT_FAILED, EXIT_OK
from twin.cli.notes import tell_notes
from twin.cli.report import Reporter
from twin.cli.tables import COLOURS, figure, tick, verdict_words
from twin.errors import BadInputError
from twin.runfolder import replacing, require_writable, write_result
from twin.scenario import LoadedScenario
from twin.scoring.ensemble import quantiles
from twin.signals import FloatArray
from twin.stress import (
    Parts,
    Plan,
    Point,
    StressResult,
    TaskResult,
    headline_metrics,
    make_plan,
    merge_in_order,
    run_tasks,
    write_files,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class StressOptions:
    """Options of ``twin stress``."""

    runs: int
    worlds: int
    vary: tuple[str, ...]
    seed: int | None
    settings: tuple[str, ...]
    workers: int
    out: Path
    resume: bool
    singles: int
    as_json: bool


def run_stress(name: str, options: StressOptions) -> int:
    """Plan, run, merge, judge, draw; return the exit code."""
    reporter = Reporter(quiet=options.as_json)
    files = scenario_files.find(name)
    if len(files) != 1:
        raise BadInputError(f"{name}: {len(files)} scenarios; a stress test takes one")
    settings = [scenario_files.parse_setting(text) for text in options.settings]
    plan = make_plan(
        files[0], runs=options.runs, worlds=options.worlds, settings=settings, vary=options.vary, seed=options.seed
    )
    loaded = plan.load(0, 0)
    require_writable(options.out)
    tell_notes(plan.load(point, 0) for point in range(len(plan.points)))
    reporter.line(f"{loaded.name}: {loaded.scenario.title}")
    started = time.perf_counter()
    parts = Parts(options.out / loaded.name, plan, loaded)
    timing: dict[str, float] = dict.fromkeys(("wall_s", "world_s", "members_s"), 0.0)
    merged = merge_in_order(loaded, plan, _results(plan, parts, options, reporter, timing))
    timing["wall_s"] = time.perf_counter() - started
    timing["member_s"] = timing["members_s"] / (options.runs * options.worlds * len(plan.points))
    if options.singles:
        timing |= _compare_singles(loaded, plan, merged.points[0].table, options.singles, reporter)
    merged.timing = timing
    changed = f"_{parts.digest[:8]}" if options.settings or options.vary else ""
    name = f"stress_seed{plan.seeds[0]}_worlds{options.worlds}_runs{options.runs}{changed}"
    folder = options.out / loaded.name / name
    pictures = _write(merged, folder)
    parts.remove()
    if options.as_json:
        print(json.dumps([merged.as_json()], indent=1, allow_nan=False))
    else:
        _report(merged, folder, pictures, reporter)
    return EXIT_OK if merged.verdict == "pass" else EXIT_FAILED


def _results(
    plan: Plan, parts: Parts, options: StressOptions, reporter: Reporter, timing: dict[str, float]
) -> Iterator[TaskResult]:
    """Results of all tasks in their order: read where they were kept, run and kept where not; times are added up."""
    finished = parts.finished() if options.resume else set()
    tasks = plan.tasks()
    with closing(run_tasks(plan, workers=options.workers, done=finished, tell=reporter.line)) as running:
        for task in tasks:
            if task in finished:
                result = parts.read(task)
            else:
                _, result = next(running)
                if len(tasks) > 1:
                    parts.write(task, result)
            for key in ("world", "members"):
                timing[f"{key}_s"] += result.wall_s[key]
            yield result


def _write(merged: StressResult, folder: Path) -> list[str]:
    from viz.plots import draw_stress  # noqa: PLC0415

    with replacing(folder) as building:
        write_files(merged, building)
        pictures = [path.name for path in draw_stress(merged, building)]
        write_result(building, merged.as_json())
    return pictures


def _compare_singles(
    loaded: LoadedScenario, plan: Plan, table: Mapping[str, FloatArray], count: int, reporter: Reporter
) -> dict[str, float]:
    """Run some members alone, in this process and without .rrd: the same numbers, and how much slower.

    They are those of the first world of ``table``, (W, R) by metric.
    """
    import numpy as np  # noqa: PLC0415

    from twin.execution import execute  # noqa: PLC0415
    from twin.scoring import score  # noqa: PLC0415

    count = min(count, plan.runs)
    worst = 0.0
    started = time.perf_counter()
    for run in range(count):
        found = score(execute(loaded, runs=(run,))).metrics
        for name, values in table.items():
            one, many = found[name], float(values[0, run])
            if one == many or (np.isnan(one) and np.isnan(many)):
                continue
            worst = max(worst, abs(one - many) / (1.0 + abs(one)))
    each = (time.perf_counter() - started) / count
    reporter.line(f"{count} members run alone: {each:.2f} s each; metrics differ by at most {worst:.1e}")
    return {"single_s": each, "singles_largest_difference": worst}


# --- what a person sees ----------------------------------------------------------------------------------------------


def _report(merged: StressResult, folder: Path, pictures: list[str], reporter: Reporter) -> None:
    several = merged.plan.runs * len(merged.plan.seeds) > 1
    for point in merged.points:
        reporter.line("")
        if point.label:
            reporter.line(Text(point.label, style="bold"))
        reporter.table(_distribution(merged, point))
        if point.pooled:
            reporter.table(_honesty(point))
        if point.consistency:
            reporter.table(_consistency(point))
        for outcome in point.outcomes:
            of_members = several or outcome.check.confidence is not None
            reporter.line(Text.assemble(tick(outcome.ok), " ", outcome.sentence(of_members=of_members)))
        for worst in point.worst:
            reporter.line(f"worst {worst.estimator}: {worst.metric} = {figure(worst.value)}: {worst.command}")
    for line in merged.ended:
        reporter.line(Text(line, style=COLOURS["error"]))
    timing = merged.timing
    last = verdict_words(merged.verdict, checked=any(point.outcomes for point in merged.points))
    last.append(f"   {merged.plan.runs} members in each of {len(merged.plan.seeds)} worlds in {timing['wall_s']:.1f} s")
    if "single_s" in timing:
        share = timing["wall_s"] / (merged.plan.runs * len(merged.plan.seeds) * len(merged.points))
        last.append(f": {timing['single_s'] / share:.0f} times faster per member than alone")
    reporter.line(last)
    reporter.line(f"files: {folder} ({', '.join(pictures)}, members.parquet, envelopes.parquet)")


def _honesty(point: Point) -> Table:
    """A line per estimator, a column per pooled figure."""
    lines: dict[str, dict[str, float]] = {}
    for name, value in point.pooled.items():
        estimator, _, metric = name.partition(".")
        lines.setdefault(estimator, {})[metric.partition(".")[2].replace("_", " ")] = value
    headings = list(dict.fromkeys(heading for line in lines.values() for heading in line))
    table = Table("estimator", title="Honesty, all members of all worlds together")
    for heading in headings:
        table.add_column(heading, justify="right")
    for estimator, line in lines.items():
        table.add_row(estimator, *(figure(line.get(heading)) for heading in headings))
    return table


def _consistency(point: Point) -> Table:
    table = Table("estimator", "statistic", title="Consistency over worlds (one member of each)")
    for heading in ("mean", "expected", "95 % bounds", "inside"):
        table.add_column(heading, justify="right")
    for name, found in point.consistency.items():
        for each in found:
            inside = f"{100 * each.inside:.0f} %"
            bounds = f"{each.low:.3g} to {each.high:.3g}"
            table.add_row(name, each.statistic, figure(each.mean), str(each.degrees), bounds, inside)
    return table


def _distribution(merged: StressResult, point: Point) -> Table:
    table = Table("estimator", "metric")
    for heading in ("5 %", "50 %", "95 %", "published"):
        table.add_column(heading, justify="right")
    last = ""
    for name in headline_metrics(merged.loaded, list(point.table)):
        estimator, _, metric = name.partition(".")
        cells = [figure(float(value)) for value in quantiles(point.table[name])]
        shown = estimator if estimator != last else ""
        table.add_row(shown, metric, *cells, figure(merged.loaded.scenario.published.get(name)))
        last = estimator
    return table
