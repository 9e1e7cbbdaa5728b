"""Tables about a replayed log: the receiver's qualities, innovations, tracks, and errors against a reference."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence

from rich.table import Table

from twin.cli.tables import figure
from twin.scoring.transitions import QUALITIES

Metrics = Mapping[str, float]

_COUNT = re.compile(r"quality\.(\w+)_to_(\w+)_count\Z")
_MOST_PAIRS = 8
_UPDATES = re.compile(r"consistency\.(nis_\w+)_updates\Z")


def _of(metrics: Metrics, name: str | None) -> dict[str, float]:
    """Metrics of one estimator or sensor, without its name."""
    return {key.removeprefix(f"{name}."): value for key, value in metrics.items() if key.startswith(f"{name}.")}


def quality_table(metrics: Metrics, receiver: str | None) -> Table | None:
    """How long the receiver told each quality, and what its changes did to its own position."""
    mine = _of(metrics, receiver)
    if not mine:
        return None
    table = Table(title=f"Quality told by {receiver}")
    table.add_column("quality, or change")
    for heading in ("time s", "time %", "times", "mean jump m", "largest jump m"):
        table.add_column(heading, justify="right")
    for name in (*QUALITIES.values(), "unknown"):
        if f"quality.{name}_s" in mine:
            table.add_row(name, figure(mine[f"quality.{name}_s"]), figure(mine[f"quality.{name}_percent"]))
    pairs = sorted(((value, match) for key, value in mine.items() if (match := _COUNT.match(key))), key=_most_first)
    for count, match in pairs[:_MOST_PAIRS]:
        jumps = [mine.get(f"quality.{match[1]}_to_{match[2]}_{which}_jump_m", math.nan) for which in ("mean", "max")]
        table.add_row(f"{match[1]} to {match[2]}", "", "", f"{count:.0f}", *map(figure, jumps))
    return table


def _most_first(pair: tuple[float, re.Match[str]]) -> tuple[float, str]:
    return -pair[0], pair[1][0]


def innovation_table(metrics: Metrics, estimators: Sequence[str]) -> Table | None:
    """Whether innovations are as large as the filter expects, and white."""
    table = Table(title="Innovations: is the filter as surprised as it expects to be?")
    for heading in ("estimator", "of"):
        table.add_column(heading)
    for heading in ("updates", "mean NIS", "95 % if consistent", "% inside", "lag 1", "white within"):
        table.add_column(heading, justify="right")
    for name in estimators:
        mine = _of(metrics, name)
        aids = [match[1] for key, value in mine.items() if (match := _UPDATES.match(key)) and value > 0.0]
        for aid in aids:
            told = {
                key: mine[f"consistency.{aid}{key}"] for key in ("", "_low", "_high", "_inside_percent", "_updates")
            }
            bounds = f"{figure(told['_low'])} .. {figure(told['_high'])}"
            first = aid == aids[0]
            table.add_row(
                name if first else "",
                aid.removeprefix("nis_"),
                f"{told['_updates']:.0f}",
                figure(told[""]),
                bounds,
                figure(told["_inside_percent"]),
                *(_whiteness(mine) if aid == "nis_position" else ("", "")),
            )
    return table if table.row_count else None


def _whiteness(mine: Metrics) -> tuple[str, str]:
    """Lag-1 autocorrelation of the innovations by direction, and what white noise would keep within."""
    names = [key.removeprefix("innovation.lag1_") for key in mine if key.startswith("innovation.lag1_")]
    names = [name for name in names if not name.startswith("bound_")]
    if not names:
        return "", ""
    told = ", ".join(f"{name} {mine[f'innovation.lag1_{name}']:.2f}" for name in names)
    return told, f"±{mine[f'innovation.lag1_bound_{names[0]}']:.2g}"


def track_table(metrics: Metrics, receiver: str | None, estimators: Sequence[str]) -> Table | None:
    """How smooth the tracks are, and the largest jump of each where the receiver's quality changes."""
    table = Table(title="Tracks")
    table.add_column("track")
    for heading in ("RMS acceleration m/s2", "RMS jerk m/s3", "step beyond motion m", "jump at change of quality m"):
        table.add_column(heading, justify="right")
    for name in [receiver, *estimators]:
        mine = _of(metrics, name)
        told = [
            mine.get(f"smoothness.{key}") for key in ("rms_acceleration_m_s2", "rms_jerk_m_s3", "largest_step_beyond_m")
        ]
        if all(value is None for value in told):
            continue
        jumps = [value for key, value in mine.items() if key.endswith("_max_jump_m")]
        table.add_row(name, *map(figure, told), figure(max(jumps, default=None)))
    return table if table.row_count else None


def reference_tables(metrics: Metrics, receiver: str | None, estimators: Sequence[str]) -> Iterator[Table]:
    """Errors in the plane and of heights against the reference, over all and by the receiver's quality."""
    for title, prefix in (("Against the reference, in the plane", ""), ("Against the reference, heights", "height_")):
        table = _reference_table(metrics, [receiver, *estimators], title, f"reference.{prefix}")
        if table.row_count:
            yield table


def _reference_table(metrics: Metrics, names: Sequence[str | None], title: str, prefix: str) -> Table:
    table = Table(title=title)
    for heading in ("track", "quality"):
        table.add_column(heading)
    for heading in ("epochs", "RMSE m", "95 % m", "max m", "error / sigma", "% inside 95 %"):
        table.add_column(heading, justify="right")
    for name in names:
        mine = _of(metrics, name)
        suffixes = [key.removeprefix(f"{prefix}epochs") for key in mine if key.startswith(f"{prefix}epochs")]
        for suffix in suffixes:
            table.add_row(
                name if not suffix else "",
                suffix.lstrip("_") or "all",
                f"{mine[f'{prefix}epochs{suffix}']:.0f}",
                *(figure(mine[f"{prefix}{key}{suffix}_m"]) for key in ("rmse", "p95", "max")),
                figure(mine[f"{prefix}error_over_sigma{suffix}"]),
                figure(mine[f"{prefix}inside{suffix}_percent"]),
            )
    return table
