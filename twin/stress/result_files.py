"""Files that keep what came of a stress test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from twin.scoring.ensemble import QUANTILES
from twin.scoring.envelopes import Envelope
from twin.signals import NS_PER_S
from twin.stress.result import StressResult


def write_files(result: StressResult, folder: Path) -> None:
    """Write ``scenario.toml``, ``members.parquet`` (a row per member) and ``envelopes.parquet``."""
    (folder / "scenario.toml").write_text(result.loaded.toml)
    pq.write_table(pa.concat_tables(
            [_members_table(result, index) for index in range(len(result.points))], promote_options="default"
        ),
                   folder / "members.parquet")  # fmt: skip
    pq.write_table(
        pa.concat_tables(
            [
                _envelope_table(index, name, envelope)
                for index, point in enumerate(result.points)
                for name, envelope in point.envelopes.items()
            ]
            or [_envelope_table(0, "", Envelope.at(np.empty(0, dtype=np.int64)))]
        ),
        folder / "envelopes.parquet",
    )


def _members_table(result: StressResult, index: int) -> pa.Table:
    point, plan = result.points[index], result.plan
    worlds, runs = len(plan.seeds), plan.runs
    columns: dict[str, Any] = {"point": np.full(worlds * runs, index)}
    for key, value in point.settings.items():
        columns[key] = pa.array([str(value)] * (worlds * runs))
    columns["seed"] = np.repeat(np.array(plan.seeds, dtype=np.int64), runs)
    columns["run"] = np.tile(np.arange(runs), worlds)
    for name, values in point.table.items():
        columns[name] = values.ravel()
    # What a machine did is a matter of the world at one point and of the member at another where a loop is closed.
    of_members = {name for each in result.points for name in each.table}
    for name, of_worlds in point.motion.items():
        if name in of_members and name not in point.table:
            columns[name] = np.repeat(of_worlds, runs)
    return pa.table(columns)


def _envelope_table(index: int, name: str, envelope: Envelope) -> pa.Table:
    length = len(envelope.t_ns)
    columns: dict[str, Any] = {
        "point": np.full(length, index),
        "name": pa.array([name] * length, type=pa.string()),
        "t_s": envelope.t_ns / NS_PER_S,
    }
    for fraction in QUANTILES:
        columns[f"p{round(100 * fraction):02d}"] = envelope.quantile(fraction)
    return pa.table(columns)
