"""Plots of a stress test: error envelopes over time, distributions over members, trends over a varied value."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin.errors import TwinError
from twin.families import FAMILIES
from twin.scoring.ensemble import QUANTILES, quantiles
from twin.signals import NS_PER_S
from twin.stress import Point, StressResult, headline_metrics
from viz import entities
from viz.height_plots import FAMILY, draw_heights, physical_limit

_TITLES = {f"{family.name}_{family.unit}": family.title for family in FAMILIES if family.title}
"""By the envelope's name."""
_SMALLEST_SHOWN = 1e-3
_MOST_PLOTS = 10
_STYLE: Any = {
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "font.size": 9,
}


def draw_stress(result: StressResult, folder: Path) -> list[Path]:
    """Draw the plots of a stress test into a folder; return the files.

    Raises:
        TwinError: a file cannot be written whole.
        OSError: the disk refuses.
    """
    files: list[Path] = []
    with mpl.rc_context(_STYLE):
        for index, point in enumerate(result.points):
            suffix = f"_{index}" if len(result.points) > 1 else ""
            files += _save(_envelopes(result, point), folder / f"envelopes{suffix}.png")
            colours = _colours(list(point.envelopes))
            limit = physical_limit(result.plan.load(index, 0).scenario)
            heights = draw_heights(result, point, colours, _title(result, point), limit=limit)
            files += _save(heights, folder / f"heights{suffix}.png")
            files += _save(_distributions(result, point), folder / f"distributions{suffix}.png")
        if len(result.points) > 1:
            files += _save(_trends(result), folder / "trends.png")
    return files


def _save(figure: Figure | None, path: Path) -> list[Path]:
    if figure is None:
        return []
    # No creation software or date in the file: equal plots are equal bytes.
    figure.savefig(path, dpi=130, metadata={"Software": None})
    if path.stat().st_size == 0:
        raise TwinError(f"{path}: could not be written")
    return [path]


def _colours(names: Sequence[str]) -> dict[str, Any]:
    chosen = entities.estimator_colours(sorted({name.partition(".")[0] for name in names}))
    return {name: tuple(part / 255 for part in colour) for name, colour in chosen.items()}


def _grid(count: int, title: str) -> tuple[Figure, list[Axes]]:
    columns = 2 if count > 1 else 1
    rows = -(-count // columns)
    figure = Figure(figsize=(5.6 * columns, 0.5 + 2.9 * rows), layout="constrained")
    figure.suptitle(title, fontsize=11)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel().tolist()
    for unused in axes[count:]:
        unused.set_visible(False)
    return figure, axes[:count]


def _title(result: StressResult, point: Point) -> str:
    plan = result.plan
    worlds = f"{len(plan.seeds)} world{'s' * (len(plan.seeds) > 1)}"
    told = f"{result.loaded.scenario.title}\n{plan.runs} noise realisations in {worlds}"
    return f"{told}, {point.label}" if point.label else told


def _envelopes(result: StressResult, point: Point) -> Figure | None:
    families = [name for name in _TITLES if any(key.partition(".")[2] == name for key in point.envelopes)]
    if not families:
        return None
    window = result.loaded.scenario.loss_window_s
    begin = window[0] if window is not None else 0.0
    colours = _colours(list(point.envelopes))
    figure, axes = _grid(len(families), f"{_title(result, point)}: median and 5 to 95 %")
    for axis, family in zip(axes, families, strict=True):
        lowest: list[float] = []
        for key, envelope in point.envelopes.items():
            estimator, _, name = key.partition(".")
            if name != family:
                continue
            t_s = envelope.t_ns / NS_PER_S - begin
            low, middle, high = (np.maximum(envelope.quantile(q), _SMALLEST_SHOWN) for q in QUANTILES)
            lowest.append(float(np.nanpercentile(low[t_s >= 0.0], 10)) if (t_s >= 0.0).any() else _SMALLEST_SHOWN)
            axis.fill_between(t_s, low, high, color=colours[estimator], alpha=0.25, linewidth=0)
            axis.plot(t_s, middle, color=colours[estimator], linewidth=1.4, label=estimator.replace("_", " "))
        if window is not None:
            axis.axvspan(0.0, window[1] - begin, color="0.5", alpha=0.12, linewidth=0, label="fault")
        axis.set_yscale("log")
        axis.set_title(_TITLES[family], fontsize=10)
        axis.set_xlabel("time since the fault began [s]" if window is not None else "time [s]")
        axis.set_xlim(max(-20.0, result.loaded.scenario.scoring.from_s - begin), None)
        axis.set_ylim(bottom=max(_SMALLEST_SHOWN, 0.5 * min(lowest, default=_SMALLEST_SHOWN)))
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
    return figure


def _unit(metric: str) -> str:
    for suffix, unit in (
        ("_m_s", "m/s"),
        ("_rad_s", "rad/s"),
        ("_deg", "deg"),
        ("_mm", "mm"),
        ("_m", "m"),
        ("_s", "s"),
        ("_percent", "%"),
    ):
        if metric.endswith(suffix):
            return unit
    return ""


def _in_words(metric: str) -> str:
    words = re.sub(r"_(m_s|rad_s|deg|mm|m|s|percent)\Z", "", metric).replace("_", " ").replace(".", ": ")
    return f"{words} [{_unit(metric)}]"


def _distributions(result: StressResult, point: Point) -> Figure | None:
    # the times until the tolerance is exceeded have a plot of their own
    shown = [
        name
        for name in headline_metrics(result.loaded, list(point.table))
        if "consistency" not in name and not name.endswith(FAMILY.time_to_tolerance)
    ]
    metrics = list(dict.fromkeys(name.partition(".")[2] for name in shown))[:_MOST_PLOTS]
    if not metrics:
        return None
    colours = _colours(shown)
    figure, axes = _grid(len(metrics), f"{_title(result, point)}: share of runs up to a value")
    for axis, metric in zip(axes, metrics, strict=True):
        for estimator, colour in colours.items():
            values = point.table.get(f"{estimator}.{metric}")
            if values is None:
                continue
            ordered = np.sort(values[~np.isnan(values)])
            share = np.arange(1, len(ordered) + 1) / max(1, len(ordered))
            finite = np.isfinite(ordered)
            axis.step(ordered[finite], 100 * share[finite], where="post", color=colour, label=estimator)
        for check in result.loaded.scenario.checks:
            if check.metric.partition(".")[2] == metric and check.max is not None:
                axis.axvline(check.max, color="tab:red", linestyle="--", linewidth=1.0)
        axis.set_xlabel(_in_words(metric))
        axis.set_ylabel("runs [%]")
        axis.set_ylim(0, 101)
    axes[0].legend(fontsize=8)
    return figure


def _trends(result: StressResult) -> Figure | None:
    first = result.points[0]
    shown = [name for name in headline_metrics(result.loaded, list(first.table)) if "time_to" not in name]
    metrics = list(dict.fromkeys(name.partition(".")[2] for name in shown))[:_MOST_PLOTS]
    if not metrics:
        return None
    colours = _colours(shown)
    labels = [", ".join(str(value) for value in point.settings.values()) for point in result.points]
    figure, axes = _grid(len(metrics), f"{result.loaded.scenario.title}: median and 5 to 95 %")
    places = np.arange(len(labels))
    for axis, metric in zip(axes, metrics, strict=True):
        for offset, (estimator, colour) in enumerate(colours.items()):
            name = f"{estimator}.{metric}"
            if name not in first.table:
                continue
            spread = np.array([quantiles(point.table[name]) for point in result.points])
            spread[~np.isfinite(spread)] = np.nan  # what never happened has no place on the axis
            reach = np.abs(spread[:, [0, 2]] - spread[:, [1]]).T
            x = places + 0.08 * (offset - (len(colours) - 1) / 2)
            axis.errorbar(x, spread[:, 1], yerr=reach, color=colour, marker="o", capsize=3, label=estimator)
        axis.set_xticks(places, labels, rotation=30 if max(map(len, labels)) > 8 else 0)
        axis.set_xlabel(", ".join(first.settings))
        axis.set_ylabel(_in_words(metric))
    axes[0].legend(fontsize=8)
    return figure
