"""Change indicators: each scenario's metrics, committed beside it as ``baselines/NAME.csv``.

A metric has drifted when |now - then| > ``tolerance`` * |then| + 1e-9. Runs of one machine are bit-identical; the
tolerance is for other processors, whose last bits may differ. An update rewrites only the lines that moved.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from twin.errors import BadInputError
from twin.signals import FloatArray

DEFAULT_TOLERANCE = 1e-3
"""Relative tolerance written for a new metric."""
_ABSOLUTE = 1e-9
_HEADER = ["metric", "value", "tolerance"]

Value = TypeVar("Value", float, FloatArray)


def allowed(then: Value, tolerance: float) -> Value:
    """How far a value may have moved from what it was: the one rule for baselines and comparisons."""
    return tolerance * abs(then) + _ABSOLUTE


@dataclass(frozen=True, slots=True)
class Baseline:
    """The committed value of one metric; NaN where the metric was not a number."""

    value: float
    tolerance: float = DEFAULT_TOLERANCE

    def holds(self, value: float) -> bool:
        """Tell whether ``value`` is the committed one, within tolerance."""
        if math.isnan(self.value) or math.isnan(value):
            return math.isnan(self.value) and math.isnan(value)
        if math.isinf(self.value) or math.isinf(value):
            return value == self.value
        return bool(abs(value - self.value) <= allowed(self.value, self.tolerance))


def baseline_path(scenario_path: Path) -> Path:
    """Where the baseline of a scenario file lies."""
    return scenario_path.parent / "baselines" / f"{scenario_path.stem}.csv"


def read(path: Path) -> dict[str, Baseline]:
    """Read a baseline file; empty where there is none.

    Raises:
        BadInputError: the file is not a baseline.
    """
    if not path.is_file():
        return {}
    try:
        with path.open(newline="") as file:
            return {
                row["metric"]: Baseline(float(row["value"]), float(row["tolerance"])) for row in csv.DictReader(file)
            }
    except (OSError, UnicodeDecodeError, csv.Error, KeyError, TypeError, ValueError) as error:
        raise BadInputError(f"{path}: not a baseline (columns {', '.join(_HEADER)} expected): {error}") from error


def drifted(baselines: Mapping[str, Baseline], metrics: Mapping[str, float]) -> list[str]:
    """One sentence per metric that moved, came or went."""
    lines = []
    for name, baseline in baselines.items():
        if name not in metrics:
            lines.append(f"{name}: gone (was {baseline.value:.6g})")
        elif not baseline.holds(metrics[name]):
            lines.append(f"{name}: {baseline.value:.6g} -> {metrics[name]:.6g} (tolerance {baseline.tolerance:g})")
    lines += [f"{name}: new ({value:.6g})" for name, value in metrics.items() if name not in baselines]
    return lines


def updated(baselines: Mapping[str, Baseline], metrics: Mapping[str, float]) -> dict[str, Baseline]:
    """Baselines for these metrics, keeping the committed line wherever it still holds."""
    new: dict[str, Baseline] = {}
    for name, value in metrics.items():
        old = baselines.get(name)
        if old is None:
            new[name] = Baseline(value)
        else:
            new[name] = old if old.holds(value) else Baseline(value, old.tolerance)
    return new


def write(path: Path, baselines: Mapping[str, Baseline]) -> None:
    """Write a baseline file in one go."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEADER)
    for name, baseline in baselines.items():
        writer.writerow([name, f"{baseline.value:.9g}", f"{baseline.tolerance:g}"])
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(text.getvalue())
    partial.replace(path)
