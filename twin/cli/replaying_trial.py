"""What ``twin replay FILE.mat`` does: heading filters over a recorded motion with optical truth, in a table."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from twin.cli import EXIT_OK
from twin.cli.report import Reporter
from twin.cli.running import load_plugins
from twin.cli.tables import figure
from twin.errors import BadInputError
from twin.formats.broad import read_broad
from twin.trial import NEEDS_WHEELS, TrialResult, replay_trial, vqf_result


def replay_file(path: Path, *, settings: Sequence[str], estimators: Sequence[str], as_json: bool) -> int:
    """Run the heading filters, and the user's own estimators, over a trial of BROAD.

    Raises:
        BadInputError: the file is no such trial, a setting was given (there is no scenario to set), or an estimator
            cannot work with it.
    """
    if settings:
        raise BadInputError(f"--set {settings[0]}: {path} is a recording without a scenario; there is nothing to set")
    reporter = Reporter(quiet=as_json)
    trial = read_broad(path)
    reporter.line(f"{trial.name}: {len(trial.movement) * trial.step_s:.0f} s at {trial.rate_hz:.0f} Hz")
    results = list(replay_trial(trial, plugins=load_plugins(estimators)))
    reference = vqf_result(trial)
    if reference is not None:
        results.append(reference)
    if as_json:
        print(json.dumps([{"trial": trial.name, "estimators": {each.name: _json(each) for each in results}}], indent=1))
        return EXIT_OK
    reporter.table(_table(results))
    reporter.line(f"{', '.join(NEEDS_WHEELS)}: need wheel encoders, which the recording has not")
    return EXIT_OK


def _json(result: TrialResult) -> dict[str, float | int | None]:
    errors = result.errors
    values = {
        "heading_rmse_deg": errors.heading_deg,
        "relative_heading_rmse_deg": errors.relative_heading_deg,
        "inclination_rmse_deg": errors.inclination_deg,
        "total_rmse_deg": errors.total_deg,
        "heading_sigma_deg": result.mean_sigma_deg,
    }
    return {key: value if math.isfinite(value) else None for key, value in values.items()} | {"samples": errors.samples}


def _table(results: Sequence[TrialResult]) -> Table:
    """RMSE in degrees over the moving samples, as the data set's authors score; a dash where a filter does not say."""
    table = Table(title="RMSE while moving, deg")
    table.add_column("estimator")
    for heading in ("heading", "heading, mean off", "inclination", "total", "own heading sigma"):
        table.add_column(heading, justify="right")
    for each in results:
        errors = each.errors
        parts = (errors.heading_deg, errors.relative_heading_deg, errors.inclination_deg, errors.total_deg)
        table.add_row(each.name, *(figure(part) for part in (*parts, each.mean_sigma_deg)))
    return table
