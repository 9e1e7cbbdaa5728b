"""How the height filter reads a GNSS receiver: what its data sheet says of each fix state, and what a sample says.

A sigma that the receiver reports may widen what the data sheet says, never narrow it: a float solution may claim 11 mm
and be 0.4 m off, and a driver that does not fill the field in reports zero. A value that repeats the one before exactly
is no news (a stuck output, a held sample): it is not used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.estimators.roles import column_places, usable
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

FIXED = 4
"""NMEA quality of an RTK fix."""

_COLUMNS = ("position_u_m", "sigma_u_m", "quality", "age_s")
_VERTICAL_SPEED = "vertical_speed_m_s"
_PREFIXES: Mapping[int, str] = {5: "float", 2: "differential", 3: "differential", 1: "single"}
_COARSE: Mapping[str, tuple[float, float]] = {
    "float": (0.37, 170.0),
    "differential": (0.76, 100.0),
    "single": (1.52, 160.0),
}
"""Sigma (m) and correlation time (s) where the data sheet is silent: those of ordinary receivers."""
_WHITE_RATIO = 0.2
"""White part of a coarse position against the correlated one; ordinary receivers have 0.03 to 0.2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FixSheet:
    """Height of a fix, 1 sigma."""

    correlated_m: float
    correlation_s: float
    white_m: float
    age_drift_m_s: float
    """Further correlated error per second of age of the corrections."""
    age_drift_correlation_s: float

    @classmethod
    def of(cls, sheet: Mapping[str, float]) -> FixSheet:
        """Read a data sheet; what it does not say is split as usual receivers have it."""
        total = sheet.get("height_noise_m", 0.015)
        return cls(
            correlated_m=sheet.get("height_correlated_sigma_m", 0.93 * total),
            correlation_s=sheet.get("height_correlation_s", 100.0),
            white_m=max(sheet.get("height_white_sigma_m", 0.36 * total), 1e-4),
            age_drift_m_s=sheet.get("height_age_drift_m_s", 0.0014),
            age_drift_correlation_s=sheet.get("age_drift_correlation_s", 100.0),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedSheet:
    """Vertical speed, 1 sigma."""

    white_m_s: float
    correlated_m_s: float
    correlation_s: float
    lag_s: float
    """Of the receiver's own first-order filter."""

    @classmethod
    def of(cls, sheet: Mapping[str, float]) -> SpeedSheet:
        """Read a data sheet."""
        white = sheet.get("vertical_speed_noise_m_s", 0.02)
        return cls(
            white_m_s=max(white, 1e-4),
            correlated_m_s=sheet.get("vertical_speed_correlated_m_s", 0.1 * white),
            correlation_s=sheet.get("vertical_speed_correlation_s", 60.0),
            lag_s=sheet.get("velocity_lag_s", 0.0),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class FixReading:
    """One sample of R members."""

    t_ns: int
    height_m: FloatArray
    """(R,) of the antenna above the design plane."""
    fixed: BoolArray
    """(R,) an RTK fix with news."""
    coarse: BoolArray
    """(R,) any other position with news."""
    quality: FloatArray
    """(R,) of the fix; NaN where nothing was heard."""
    wider: FloatArray
    """(R,) by how much errors are larger than the data sheet says, at least 1."""
    drift_m: FloatArray
    """(R,) standard deviation that the corrections' age adds."""
    coarse_sigma_m: FloatArray
    """(R,)."""
    coarse_s: FloatArray
    """(R,) correlation time of that."""
    speed_m_s: FloatArray
    """(R,) vertical speed."""
    speed_known: BoolArray
    """(R,) with news."""


class HeightReceiver:
    """Reads the samples of one receiver, in order of arrival.

    Raises:
        BadInputError: the receiver lacks a column.
    """

    def __init__(self, info: SensorInfo, setup: EstimatorSetup, *, vertical_speed: bool) -> None:
        sheet = info.datasheet
        self.name = info.name
        self.fix = FixSheet.of(sheet)
        self.speed = SpeedSheet.of(sheet) if vertical_speed and _VERTICAL_SPEED in info.columns else None
        column_places(info, _COLUMNS, setup=setup)
        self._places = {column: info.columns.index(column) for column in (*_COLUMNS, _VERTICAL_SPEED) if column in info.columns}
        self._latency_ns = round(sheet.get("latency_s", 0.0) * NS_PER_S)
        self._design_m = setup.design_height_m
        self._table: dict[int, tuple[float, float]] = {}
        for quality, prefix in _PREFIXES.items():
            sigma, correlation_s = _COARSE[prefix]
            self._table[quality] = (
                sheet.get(f"{prefix}_height_sigma_m", sigma),
                sheet.get(f"{prefix}_height_correlation_s", correlation_s),
            )
        none = np.full(setup.runs, np.nan)
        self._last_height, self._last_speed = none, none

    def read(self, measurement: Measurement) -> FixReading:
        """What a sample says."""
        column = {name: measurement.values[:, place] for name, place in self._places.items()}
        height = column["position_u_m"]
        quality = np.where(measurement.valid, column["quality"], np.nan)
        known = usable(measurement, height[:, np.newaxis]) & (quality > 0.0)
        news = known & (height != self._last_height)
        self._last_height = np.where(known, height, self._last_height)
        fixed = quality == FIXED
        sigma, correlation_s = self._coarse(quality)
        age = np.where(fixed & np.isfinite(column["age_s"]), column["age_s"], 0.0)
        drift = self.fix.age_drift_m_s * np.maximum(age, 0.0)
        total = np.hypot(np.hypot(self.fix.correlated_m, self.fix.white_m), drift)
        said = np.where(np.isfinite(column["sigma_u_m"]), column["sigma_u_m"], 0.0)
        wider = np.maximum(said / np.where(fixed, total, sigma), 1.0)
        speed = column.get(_VERTICAL_SPEED, np.full(len(height), np.nan)) if self.speed is not None else None
        speed_news = np.zeros(len(height), dtype=np.bool_)
        if speed is not None:
            speed_known = usable(measurement, speed[:, np.newaxis])
            speed_news = speed_known & (speed != self._last_speed)
            self._last_speed = np.where(speed_known, speed, self._last_speed)
        return FixReading(
            t_ns=self._time_ns(measurement),
            height_m=np.where(known, height - self._design_m, 0.0),
            fixed=news & fixed,
            coarse=news & ~fixed,
            quality=quality,
            wider=wider,
            drift_m=drift,
            coarse_sigma_m=sigma,
            coarse_s=correlation_s,
            speed_m_s=np.zeros(len(height)) if speed is None else np.where(speed_news, speed, 0.0),
            speed_known=speed_news,
        )

    def _time_ns(self, measurement: Measurement) -> int:
        """When it was true; a clock that runs ahead of the arrival is not believed."""
        if measurement.t_ns > measurement.t_available_ns:
            return measurement.t_available_ns - self._latency_ns
        return measurement.t_ns

    def _coarse(self, quality: FloatArray) -> tuple[FloatArray, FloatArray]:
        worst = self._table[1]
        sigma, correlation_s = np.full(len(quality), worst[0]), np.full(len(quality), worst[1])
        for code, (one, other) in self._table.items():
            sigma = np.where(quality == code, one, sigma)
            correlation_s = np.where(quality == code, other, correlation_s)
        return sigma, correlation_s


def coarse_white_m(reading: FixReading) -> FloatArray:
    """(R,) white part of a coarse position."""
    white: FloatArray = _WHITE_RATIO * reading.coarse_sigma_m * reading.wider
    return white
