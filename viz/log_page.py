"""A Markdown page about a replayed log: what it is, what was passed over, and the metrics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from viz.page import number


def log_page(result: Mapping[str, Any]) -> str:
    """Return the page; it says nothing of wall time."""
    log = result["log"]
    parts = [f"# {result['scenario']}", _sentence(log, result["ended"]["t_s"])]
    if result.get("reference"):
        parts.append(f"**Reference:** {result['reference']['file']}")
    heard = log.get("estimators", {})
    if heard:
        parts.append(_table(("estimator", "hears"), ((name, ", ".join(sensors)) for name, sensors in heard.items())))
    if result["problems"]:
        parts.append("## Passed over")
        parts.append(_table(("lines", "why"), ((str(count), kind) for kind, count in result["problems"].items())))
    parts.append("## Metrics")
    parts.append(_table(("metric", "value"), ((name, number(value)) for name, value in result["metrics"].items())))
    return "\n\n".join(parts) + "\n"


def _sentence(log: Mapping[str, Any], ended_t_s: float) -> str:
    origin = log["origin"]
    sensors = ", ".join(f"{name} ({info['rate_hz']:.3g} Hz)" for name, info in log["sensors"].items())
    began = f" from {log['start_utc']}" if log["start_utc"] else ""
    place = f"{origin['latitude_deg']:.6f}, {origin['longitude_deg']:.6f}"
    return f"{log['file']}: {sensors}; {ended_t_s:.0f} s{began}. Zero of the map is at {place} (latitude, longitude)."


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
