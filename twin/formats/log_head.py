"""What the beginning of a log tells of it: where its local frame lies, its receiver's rate and quality."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twin.errors import BadInputError
from twin.fix_quality import ORDINARY, SINGLE, STATES
from twin.formats.geodetic import Origin
from twin.formats.gnss_fixes import COLUMNS, GNSS, UNKNOWN_MOUNT, Fix
from twin.signals import NS_PER_S, SensorInfo

HEAD_EPOCHS = 50
"""So many epochs from a log's first position on tell its rate and origin."""
LOOKED_AT = 3_000
"""So many epochs from there on, at most, are looked at for the best quality and for sensors that speak late: five
minutes at 10 Hz, half a second's work."""
_FARTHEST_M = 100_000.0
"""From an origin; there the earth has fallen 780 m below the plane, and ways in the plane are 0.01 % too short."""
_HEIGHTS, _GEOID = (-1_000.0, 9_000.0), (-110.0, 90.0)
"""What :class:`Origin` allows."""


class FarFromOriginError(BadInputError):
    """The log is good, and the origin told is not for it."""


class LogHead:
    """The beginning of a log, taken in epoch by epoch; of its epochs the first ``HEAD_EPOCHS`` are kept."""

    def __init__(self) -> None:
        self.fixes: list[Fix] = []
        """From the first position on."""
        self._qualities: set[float] = set()
        self._seen = 0

    def take(self, fix: Fix) -> None:
        """Take the next epoch."""
        self._qualities.add(fix.quality)
        if not (self.fixes or fix.placed):
            return
        self._seen += 1
        if len(self.fixes) < HEAD_EPOCHS:
            self.fixes.append(fix)

    @property
    def whole(self) -> bool:
        """Whether rate and origin are known."""
        return len(self.fixes) >= HEAD_EPOCHS

    @property
    def best(self) -> int:
        """The best quality until now, of those a neutral data sheet knows; a single-point one if there was none."""
        return next((quality for quality in ORDINARY if quality in self._qualities), SINGLE)

    @property
    def best_there_is(self) -> bool:
        """Whether no better quality can come."""
        return self.best == next(iter(ORDINARY))

    @property
    def looked_far(self) -> bool:
        """Whether one has looked as far as one looks."""
        return self._seen >= LOOKED_AT


def origin_of(head: Sequence[Fix], told: Origin | None, *, path: Path) -> Origin:
    """The local frame of a log: as told, or that which begins at its head's first position, at the first height in it.

    One of the fixes has to be ``placed``.

    Raises:
        FarFromOriginError: the log at ``path`` is too far from the origin told for a level plane to be its map.
    """
    placed = [fix for fix in head if fix.placed]
    first = placed[0]
    if told is not None:
        globe = np.array([(fix.latitude_deg, fix.longitude_deg, told.height_m) for fix in placed])
        away_m = float(np.linalg.norm(told.enu(globe), axis=1).min())
        if away_m > _FARTHEST_M:
            raise FarFromOriginError(
                f"{path}: begins at {first.latitude_deg:.4f},{first.longitude_deg:.4f}, {away_m / 1e3:.0f} km from the"
                f" origin {told.latitude_deg:g},{told.longitude_deg:g}; a level plane is a map for"
                f" {_FARTHEST_M / 1e3:.0f} km at most"
            )
        return told
    return Origin(
        latitude_deg=first.latitude_deg,
        longitude_deg=first.longitude_deg,
        height_m=_first([fix.height_m for fix in head], _HEIGHTS),
        geoid_height_m=_first([fix.geoid_m for fix in head], _GEOID),
    )


def _first(values: Sequence[float], limits: tuple[float, float]) -> float:
    known = next((value for value in values if not math.isnan(value)), 0.0)
    return min(max(known, limits[0]), limits[1])


_VELOCITY = {"speed_noise_m_s": 0.05, "speed_noise_ratio": 0.03, "velocity_lag_s": 0.0, "latency_s": 0.0}
"""A choice: Doppler speed of any receiver, digits included, and direction within 1.6 degrees."""


def neutral_sheet(best: int) -> dict[str, float]:
    """Data sheet of a receiver nobody knows, by the best quality it has, with the names of simulated receivers'.

    What is new in every fix nobody can tell of it; it shows in the log, and is for estimators to find.
    """
    claims = ORDINARY[best]
    sheet = {"position_noise_m": claims.reported_m, "height_noise_m": claims.reported_height_m, **_VELOCITY}
    for quality, errors in ORDINARY.items():
        prefixes = [f"{STATES[quality]}_"] if quality in STATES else []
        for prefix in [*prefixes, ""] if quality == best else prefixes:
            sheet |= {
                f"{prefix}position_correlated_sigma_m": errors.slow_m,
                f"{prefix}position_correlation_s": errors.slow_s,
            }
    return sheet


def receiver_info(times_ns: Sequence[int], best: int) -> SensorInfo:
    """What can be told of a receiver from the beginning of its log: its rate, and a neutral data sheet.

    Which of the neutral receivers is taken goes by the best quality in it. Nobody knows its latency and its antenna's
    place: both are zero.
    """
    return SensorInfo(
        name=GNSS,
        kind=GNSS,
        columns=COLUMNS,
        mount=UNKNOWN_MOUNT,
        rate_hz=rate_hz(times_ns),
        datasheet=neutral_sheet(best),
    )


def rate_hz(times_ns: Sequence[int]) -> float:
    """Rate of a sensor by the median of the steps that go ahead; one a second where there are none."""
    steps = np.diff(np.array(times_ns, dtype=np.int64))
    ahead = steps[steps > 0]
    return NS_PER_S / float(np.median(ahead)) if len(ahead) else 1.0
