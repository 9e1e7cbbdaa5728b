"""``result.json`` of a replayed log, in the shape of a run's as far as that applies."""

from __future__ import annotations

import datetime as dt
import math
from typing import Any

from twin.formats.log import Log
from twin.logreplay.identity import identity_of, name_of
from twin.logreplay.replaying import LogReplay
from twin.scoring.verdict import LOG, SCHEMA, versions
from twin.signals import NS_PER_S


def result_of(found: LogReplay) -> dict[str, Any]:
    """Content of result.json; what is not a number is null.

    A log has no seed, no run and no checks, and nothing is judged (``verdict`` is null): ``log`` says what it is, and
    ``problems`` what was passed over.
    """
    return {
        "schema": SCHEMA,
        "kind": LOG,
        "scenario": name_of(found.log.path),
        "verdict": None,
        "ended": {"reason": "end of log", "t_s": found.ended_t_s},
        "log": {
            **_described(found.log),
            "measurements": found.counts,
            "start_e_n_heading": list(found.start),
            "estimators": {name: list(sensors) for name, sensors in found.heard.items()},
        },
        "reference": None if found.reference is None else _described(found.reference),
        "problems": dict(found.problems.most_common()),
        "metrics": {name: _number(value) for name, value in found.metrics.items()},
        "timing": {name: _number(value) for name, value in found.timing.items()},
        "versions": versions(),
    }


def _described(log: Log) -> dict[str, Any]:
    origin = log.origin
    return {
        **identity_of(log.path),
        "start_utc": None if log.start_utc_ns is None else utc_text(log.start_utc_ns),
        "origin": {
            "latitude_deg": origin.latitude_deg,
            "longitude_deg": origin.longitude_deg,
            "height_m": origin.height_m,
        },
        "sensors": {
            name: {"kind": info.kind, "rate_hz": info.rate_hz, "columns": list(info.columns)}
            for name, info in log.sensors.items()
        },
    }


def utc_text(t_ns: int) -> str:
    """Time since 1970 as ISO 8601, to the millisecond."""
    whole, rest = divmod(t_ns, NS_PER_S)
    told = dt.datetime(1970, 1, 1, tzinfo=dt.UTC) + dt.timedelta(seconds=whole)
    return f"{told:%Y-%m-%dT%H:%M:%S}.{rest // 1_000_000:03d}Z"


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
