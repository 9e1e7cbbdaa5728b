"""How the height filter reads a GNSS receiver: what its data sheet says of each fix state, and what a sample says.

A sigma that the receiver reports may widen what the data sheet says, never narrow it: a float solution may claim 11 mm
and be 0.4 m off, and a driver that does not fill the field in reports zero. So may a dilution of precision beyond the
least that the receiver had with a fix so far, which is taken for that of an open sky. A value that repeats the one
before exactly is no news (a stuck output, a held sample): it is not used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.estimators.roles import column_places, usable
from twin.fix_quality import ORDINARY, RTK_FIXED, SINGLE, STATES
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

_COLUMNS = ("position_u_m", "sigma_u_m", "quality", "age_s")
_VERTICAL_SPEED = "vertical_speed_m_s"
_LEVEL = ("speed_m_s", "course_rad")
_PLACE = ("position_e_m", "position_n_m")
_DILUTION = "vdop"
_WHITE_RATIO = 0.2
"""White part of a coarse position against the whole where the data sheet is silent; ordinary receivers: 0.03 to 0.2."""
_ROUNDING_M, _ROUNDING_M_S = 1e-4, 1e-4
"""No output is better than its digits."""


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
        total = sheet.get("height_noise_m", ORDINARY[RTK_FIXED].height_m)
        return cls(
            correlated_m=sheet.get("height_correlated_sigma_m", 0.93 * total),
            correlation_s=sheet.get("height_correlation_s", ORDINARY[RTK_FIXED].height_s),
            white_m=max(sheet.get("height_white_sigma_m", 0.36 * total), _ROUNDING_M),
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
            white_m_s=max(white, _ROUNDING_M_S),
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
    """(R,) by how much errors of the height are larger than the data sheet says, at least 1."""
    diluted: FloatArray
    """(R,) the same of velocities, which only the geometry of the satellites widens."""
    drift_m: FloatArray
    """(R,) standard deviation that the corrections' age adds."""
    coarse_sigma_m: FloatArray
    """(R,)."""
    coarse_white_m: FloatArray
    """(R,) its white part."""
    coarse_s: FloatArray
    """(R,) correlation time of the rest."""
    speed_m_s: FloatArray
    """(R,) vertical speed."""
    speed_known: BoolArray
    """(R,) with news."""
    level_m_s: FloatArray
    """(2, R) velocity eastwards and northwards."""
    level_variance: FloatArray
    """(R,) of each."""
    level_known: BoolArray
    """(R,) with news."""
    place_m: FloatArray
    """(2, R) east and north."""
    placed: BoolArray
    """(R,) whether that is an RTK fix."""


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
        wanted = (*_COLUMNS, _VERTICAL_SPEED, *_LEVEL, *_PLACE, _DILUTION)
        self._places = {column: info.columns.index(column) for column in wanted if column in info.columns}
        self.has_level_velocity = all(column in self._places for column in _LEVEL)
        self._level_noise = sheet.get("speed_noise_m_s", 0.05), sheet.get("speed_noise_ratio", 0.0)
        self._latency_ns = round(sheet.get("latency_s", 0.0) * NS_PER_S)
        self._design_m = setup.design_height_m
        self._table = {quality: _coarse(sheet, name) for quality, name in STATES.items()}
        none = np.full(setup.runs, np.nan)
        self._least_dilution: FloatArray = none
        self._last = dict.fromkeys(("position_u_m", _VERTICAL_SPEED, "speed_m_s"), none)

    def read(self, measurement: Measurement) -> FixReading:
        """What a sample says."""
        column = {name: measurement.values[:, place] for name, place in self._places.items()}
        runs = len(measurement.valid)
        quality = np.where(measurement.valid, column["quality"], np.nan)
        news = self._news(measurement, "position_u_m") & (quality > 0.0)
        fixed = quality == RTK_FIXED
        sigma, white, correlation_s = self._coarse(quality)
        age = np.where(fixed & np.isfinite(column["age_s"]), column["age_s"], 0.0)
        drift = self.fix.age_drift_m_s * np.maximum(age, 0.0)
        total = np.hypot(np.hypot(self.fix.correlated_m, self.fix.white_m), drift)
        said = np.where(np.isfinite(column["sigma_u_m"]), column["sigma_u_m"], 0.0)
        said_wider = said / np.where(fixed, total, np.hypot(sigma, white))
        speed_known = np.zeros(runs, dtype=np.bool_)
        if self.speed is not None:
            speed_known = self._news(measurement, _VERTICAL_SPEED)
        level, level_known = self._level(measurement)
        diluted = np.maximum(self._diluted(column.get(_DILUTION), fixed), 1.0)
        nowhere = np.full(runs, np.nan)
        place = np.stack([column.get(name, nowhere) for name in _PLACE])
        return FixReading(
            t_ns=self._time_ns(measurement),
            height_m=np.where(news, column["position_u_m"] - self._design_m, 0.0),
            fixed=news & fixed,
            coarse=news & ~fixed,
            quality=quality,
            wider=np.maximum(said_wider, diluted),
            diluted=diluted,
            drift_m=drift,
            coarse_sigma_m=sigma,
            coarse_white_m=white,
            coarse_s=correlation_s,
            speed_m_s=np.where(speed_known, column.get(_VERTICAL_SPEED, 0.0), 0.0),
            speed_known=speed_known,
            level_m_s=level,
            level_variance=np.square(diluted)
            * (self._level_noise[0] ** 2 + self._level_noise[1] ** 2 * np.square(level).sum(axis=0)),
            level_known=level_known,
            place_m=place,
            placed=news & fixed & np.isfinite(place).all(axis=0),
        )

    def _news(self, measurement: Measurement, name: str) -> BoolArray:
        """Members in which a column is a number and another than in the sample before."""
        values = measurement.values[:, self._places[name]]
        known = usable(measurement, values[:, np.newaxis])
        news: BoolArray = known & (values != self._last[name])
        self._last[name] = np.where(known, values, self._last[name])
        return news

    def _diluted(self, dilution: FloatArray | None, fixed: BoolArray) -> FloatArray:
        """(R,) dilution of precision against the least there was with a fix; zero where nothing is known of it."""
        if dilution is None:
            return np.zeros(len(fixed))
        known = np.isfinite(dilution) & (dilution > 0.0)
        self._least_dilution = np.where(known & fixed, np.fmin(dilution, self._least_dilution), self._least_dilution)
        diluted: FloatArray = np.where(known & np.isfinite(self._least_dilution), dilution / self._least_dilution, 0.0)
        return diluted

    def _level(self, measurement: Measurement) -> tuple[FloatArray, BoolArray]:
        if not self.has_level_velocity:
            return np.zeros((2, len(measurement.valid))), np.zeros(len(measurement.valid), dtype=np.bool_)
        speed, course = (measurement.values[:, self._places[name]] for name in _LEVEL)
        known = self._news(measurement, "speed_m_s") & np.isfinite(course)
        speed, course = np.where(known, speed, 0.0), np.where(known, course, 0.0)
        return np.stack([speed * np.cos(course), speed * np.sin(course)]), known

    def _time_ns(self, measurement: Measurement) -> int:
        """When it was true; a clock that runs ahead of the arrival is not believed."""
        if measurement.t_ns > measurement.t_available_ns:
            return measurement.t_available_ns - self._latency_ns
        return measurement.t_ns

    def _coarse(self, quality: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Correlated and white sigma (m) and correlation time (s) of positions that are no fixes, (R,) each."""
        found = np.repeat(np.array(self._table[SINGLE])[:, np.newaxis], len(quality), axis=1)
        for code, figures in self._table.items():
            found[:, quality == code] = np.array(figures)[:, np.newaxis]
        sigma, white, correlation_s = found
        return sigma, white, correlation_s


def _coarse(sheet: Mapping[str, float], name: str) -> tuple[float, float, float]:
    """Correlated and white sigma and correlation time of a lesser state's height; a data sheet tells the whole."""
    usual = next(ORDINARY[quality] for quality in ORDINARY if STATES.get(quality) == name)
    whole = sheet.get(f"{name}_height_sigma_m", usual.height_m)
    white = min(sheet.get(f"{name}_height_white_sigma_m", _WHITE_RATIO * whole), 0.99 * whole)
    correlated = math.sqrt(whole * whole - white * white)
    return correlated, white, sheet.get(f"{name}_height_correlation_s", usual.height_s)
