"""Plots of a stress test of heights: error envelope since a loss, and when 30 mm are first exceeded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin.families import family_named
from twin.scenario import Scenario
from twin.scoring.height_bound import scenario_bound
from twin.signals import NS_PER_S, FloatArray
from twin.stress import Point, StressResult
from viz import entities

FAMILY = family_named("height")
_SHARE = 0.95
_SMALLEST_MM, _LARGEST_MM = 1.0, 3000.0
_BEFORE_S = 10.0
"""Shown before the loss."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhysicalLimit:
    """The least error that any filter could have, over time since the loss: a Riccati solution with the truth."""

    since_loss_s: FloatArray
    """(T,)."""
    error_mm: FloatArray
    """(T,) within which 95 % of the errors lie."""


def physical_limit(scenario: Scenario) -> PhysicalLimit | None:
    """The limit through a scenario's loss; None where it is not asked for (``scoring.height_bound_of``)."""
    estimator = scenario.scoring.height_bound_of
    if estimator is None or scenario.loss_window_s is None:
        return None
    bound = scenario_bound(scenario, scenario.estimators[estimator].sensors)
    if bound is None:
        return None
    widen = FAMILY.factor * NormalDist().inv_cdf(0.5 + 0.5 * _SHARE)
    return PhysicalLimit(since_loss_s=bound.t_s, error_mm=widen * bound.sigma_m)


def draw_heights(
    result: StressResult, point: Point, colours: Mapping[str, Any], title: str, *, limit: PhysicalLimit | None = None
) -> Figure | None:
    """Draw both, or only the envelope where nothing is lost; None for a scenario without heights."""
    envelopes = {key.partition(".")[0]: envelope for key, envelope in point.envelopes.items() if _is_height(key)}
    if not envelopes:
        return None
    window = result.loaded.scenario.loss_window_s
    times = {name: point.table.get(f"{name}.{FAMILY.time_to_tolerance}") for name in envelopes}
    timed = {name: values for name, values in times.items() if window is not None and values is not None}
    figure = Figure(figsize=(12.0 if timed else 7.0, 4.6), layout="constrained")
    figure.suptitle(title, fontsize=11)
    axes: Sequence[Axes] = figure.subplots(1, 2 if timed else 1, squeeze=False).ravel().tolist()
    begin = 0.0 if window is None else window[0]
    for name, envelope in envelopes.items():
        since = envelope.t_ns / NS_PER_S - begin
        error = np.maximum(envelope.quantile(_SHARE), _SMALLEST_MM)
        axes[0].plot(since, error, color=colours[name], linewidth=1.5, label=entities.legend_name(name))
    _finish_envelope(axes[0], result, limit, begin=begin)
    if timed and window is not None:
        _draw_times(axes[1], timed, colours, lasts_s=min(window[1], result.loaded.scenario.duration_s) - begin)
        _draw_published(axes[1], result, colours)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6), fontsize=9)
    return figure


def _is_height(key: str) -> bool:
    return key.partition(".")[2] == f"{FAMILY.name}_{FAMILY.unit}"


def _finish_envelope(axis: Axes, result: StressResult, limit: PhysicalLimit | None, *, begin: float) -> None:
    """Limit of damage, physical limit, span of the fault, axes."""
    assert FAMILY.tolerance is not None
    scenario = result.loaded.scenario
    window = scenario.loss_window_s
    allowed = FAMILY.tolerance.error
    axis.axhline(allowed, color="tab:red", linestyle="--", linewidth=1.0, label=f"{allowed:g} {FAMILY.unit}")
    if limit is not None:
        axis.plot(limit.since_loss_s, limit.error_mm, "k:", linewidth=2.0, label="physical limit")
    if window is not None:
        axis.axvspan(0.0, window[1] - begin, color="0.5", alpha=0.12, linewidth=0, label="fault")
    axis.set_yscale("log")
    axis.set_ylim(_SMALLEST_MM, _LARGEST_MM)
    axis.yaxis.set_major_formatter("{x:g}")
    axis.set_ylabel("95 % of height errors are within [mm]")
    axis.set_xlabel("time [s]" if window is None else "time since the fault began [s]")
    axis.set_xlim(max(-_BEFORE_S, scenario.scoring.from_s - begin) if window is not None else scenario.scoring.from_s,
                  scenario.duration_s - begin)  # fmt: skip


def _draw_times(axis: Axes, times: Mapping[str, FloatArray], colours: Mapping[str, Any], *, lasts_s: float) -> None:
    """Draw which share of the runs has exceeded the tolerance by a time, up to the end of the loss."""
    assert FAMILY.tolerance is not None
    for name, values in times.items():
        known = np.sort(values[~np.isnan(values)])
        came = known[np.isfinite(known)]
        share = 100.0 * np.arange(len(came) + 1) / max(1, len(known))
        axis.step([0.0, *came, lasts_s], [*share, share[-1]], where="post", color=colours[name], linewidth=1.5)
    axis.set_xlim(0.0, lasts_s)
    axis.set_ylim(0.0, 101.0)
    axis.set_xlabel("time since the fault began [s]")
    axis.set_ylabel(f"runs that have been wrong by {FAMILY.tolerance.error:g} {FAMILY.unit} [%]")


def _draw_published(axis: Axes, result: StressResult, colours: Mapping[str, Any]) -> None:
    """Mark the published figures of these times."""
    for metric, value in result.loaded.scenario.published.items():
        name, _, figure = metric.partition(".")
        if figure == FAMILY.time_to_tolerance and name in colours:
            axis.axvline(value, color="0.35", linestyle=":", linewidth=1.2)
            told = f" {entities.legend_name(name)}, published: {value:g} s"
            axis.annotate(told, (value, 2.0), color="0.25", fontsize=8, rotation=90, va="bottom", ha="right")
