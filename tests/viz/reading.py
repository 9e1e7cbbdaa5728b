"""Reads series back from a .rrd, by the SDK's reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader

from twin.signals import IntArray


def entities_of(path: Path) -> set[str]:
    """Entities of the recording, without leading slash."""
    return {entity.lstrip("/") for entity in RrdReader(path).store().schema().entity_paths()}


def series(path: Path, entity: str, component: str) -> tuple[IntArray, pa.Array]:
    """Times (T,) ns on the timeline ``time`` and the component's rows, in order of time."""
    times, values = [], []
    for chunk in RrdReader(path).stream().filter(content=f"/{entity}", components=component, has_timeline="time"):
        batch = chunk.to_record_batch()
        times.append(batch["time"].cast(pa.int64()).to_numpy())
        values.append(batch[component])
    t = np.concatenate(times)
    order = np.argsort(t, kind="stable")
    return t[order], pa.concat_arrays(values).take(pa.array(order))


def scalars(path: Path, entity: str, component: str = "Scalars:scalars") -> tuple[IntArray, Any]:
    """Times (T,) ns and one number per row (T,)."""
    t, rows = series(path, entity, component)
    return t, rows.flatten().to_numpy()


def vectors(path: Path, entity: str, component: str) -> tuple[IntArray, Any]:
    """Times (T,) ns and one vector per row (T, n)."""
    t, rows = series(path, entity, component)
    flat = rows.flatten()
    return t, flat.flatten().to_numpy().reshape(len(t), -1)


def texts(path: Path, entity: str, component: str) -> tuple[list[int], list[str]]:
    """Times ns and one text per row."""
    t, rows = series(path, entity, component)
    return t.tolist(), [row[0] for row in rows.to_pylist()]
