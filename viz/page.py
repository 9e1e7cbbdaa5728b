"""A Markdown page about a run: scenario, verdict, checks, and metrics beside the published figures."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from twin.recording import Recording

_MARKS = {"pass": "✔ pass", "fail": "✗ FAIL", "error": "✗ ERROR"}


def page(recording: Recording, result: Mapping[str, Any]) -> str:
    """Return the page; parts that the result does not have are left out.

    It says nothing of wall time: two runs of one scenario give the same recording.
    """
    parts = [*_heading(recording, result), *_seeds(recording), *_checks(result), *_metrics(result)]
    return "\n\n".join(parts) + "\n"


def _heading(recording: Recording, result: Mapping[str, Any]) -> Iterable[str]:
    scenario = tomllib.loads(recording.scenario_toml)
    yield f"# {scenario.get('title', recording.scenario_name)}"
    if "verdict" in result:
        yield f"## Verdict: {_MARKS.get(result['verdict'], result['verdict'])}"
    run = ", ".join(str(index) for index in recording.runs)
    yield f"Scenario `{recording.scenario_name}`, seed {recording.seed}, run {run}."
    ended = result.get("ended", {"reason": recording.ended_reason, "t_s": recording.ended_t_s})
    yield f"Ended after {ended['t_s']:g} s of simulated time; reason: {ended['reason']}."
    for key in ("source", "notes"):
        if scenario.get(key):
            yield f"**{key.capitalize()}:** {scenario[key]}"


def _seeds(recording: Recording) -> Iterable[str]:
    """Say what the seeds' colours mean."""
    shown = recording.names("seeds")
    if not shown:
        return
    compared = f", maps of one turn compare them with those of `{shown[-1]}`" if len(shown) > 1 else ""
    yield (
        "**Seeds:** blue where there are too many, orange where there are too few (full colour: a quarter), pale where"
        " they are as wanted; magenta: a double, red: the first seed behind a gap. On the field lie those that"
        f" `{shown[0]}` metered{compared}."
    )


def _checks(result: Mapping[str, Any]) -> Iterable[str]:
    checks = result.get("checks", [])
    if checks:
        yield "## Checks"
        rows = [
            ("✔" if check.get("ok") else "✗", check["metric"], number(check.get("value")), limit(check))
            for check in checks
        ]
        yield _table(("", "metric", "value", "asked"), rows)


def limit(check: Mapping[str, Any]) -> str:
    """Say what a check asks for, e.g. ``at most 0.06``, or ``at most 0.2 of radar_only's``."""
    words = {"min": "at least", "max": "at most", "max_ratio": "at most", "max_difference": "at most"}
    asked = [f"{word} {number(check[key])}" for key, word in words.items() if check.get(key) is not None]
    text = " and ".join(asked)
    word, other = ("more than", check["difference_to"]) if "difference_to" in check else ("of", check.get("ratio_to"))
    if not other:
        return text
    estimator, _, rest = other.partition(".")
    # the same metric of another estimator need not be spelt out
    return f"{text} {word} {estimator}'s" if check["metric"].endswith(f".{rest}") else f"{text} {word} {other}"


def _metrics(result: Mapping[str, Any]) -> Iterable[str]:
    metrics, published = result.get("metrics", {}), result.get("published", {})
    if not metrics and not published:
        return
    yield "## Metrics"
    names = [*published, *(name for name in metrics if name not in published)]
    rows = [(name, number(metrics.get(name)), number(published[name]) if name in published else "") for name in names]
    yield _table(("metric", "here", "published"), rows)


def number(value: object) -> str:
    """A figure with four significant digits, or a dash where there is none."""
    return f"{value:.4g}" if isinstance(value, int | float) and not isinstance(value, bool) else "–"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
