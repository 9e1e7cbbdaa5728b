"""What aiding sensors (radar, AccoSat, GNSS) tell a filter of one rigid body, and how much they are believed.

**As published** every reading of a sensor has one variance (paper 000, table 4.1). A GNSS receiver is one of two
classes there, RTK or plain GPS; here its data sheet tells which: RTK if it states a position noise below 0.1 m. The
class does not change when the receiver loses its fix, which is what the published filter suffers from.

**As reported** (``gnss.noise = "reported"``): the variance of a position is the square of the sigma that the receiver
reports with it, east and north, but no less than a floor. A sigma of zero (or none at all) means that the
receiver does not know it, not that it is perfect: then the published variance holds. Samples whose quality is below
``minimum_quality`` are not used, neither their position nor their speed. Receivers report no sigma of their speed; its
variance stays the published one.

Either way a sample counts as current when it arrives, as in paper 000: at 2.5 m/s a latency of 0.1 s puts the
position 0.25 m behind, which no reported sigma includes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from twin.config import Config, NonNegative, Positive
from twin.estimators.coordinated_turn import AntennaPosition, ForwardSpeed
from twin.estimators.engines import Observation
from twin.estimators.roles import (
    GNSS,
    POSITION_COLUMNS,
    SPEED_COLUMN,
    Places,
    column_places,
    lever_arm,
    usable,
)
from twin.signals import BoolArray, EstimatorSetup, FloatArray, Measurement, SensorInfo

Quality = Literal["single", "differential", "float", "fix"]

_FROM_WORST: Mapping[Quality, tuple[int, ...]] = {"single": (1,), "differential": (2, 3), "float": (5,), "fix": (4,)}
"""NMEA quality codes (GGA field 6) from the worst to the best; 3 is the encrypted GPS service."""

_RTK_NOISE_M = 0.1
"""Position noise on a data sheet below which a receiver is an RTK receiver: RTK has centimetres, others decimetres."""


class GnssWeighting(Config):
    """How much GNSS is believed; see the module's docstring."""

    noise: Literal["published", "reported"] = "published"
    """A constant variance by class of receiver, or what the receiver reports with each sample."""
    sigma_floor_m: NonNegative = 0.03
    """Reported: no position is believed better. A roll of 1 degree moves an antenna 2 m up by 35 mm."""
    minimum_quality: Quality = "single"
    """Reported: samples of a worse quality are not used."""


class AidingNoise(Config):
    """Variances of the aiding sensors; the defaults are the paper's (table 4.1)."""

    radar_m2_s2: Positive = 0.1
    """Variance of a radar speed."""
    accosat_m2_s2: Positive = 0.1
    """Variance of an AccoSat speed."""
    rtk: Positive = 0.1
    """Variance of position (m^2) and speed ((m/s)^2) of an RTK receiver."""
    gps: Positive = 1.0
    """The same of any other GNSS receiver."""
    variance: dict[str, Positive] = Field(default_factory=dict)
    """By sensor name: a variance of that aiding sensor alone, in place of the above."""

    def of(self, info: SensorInfo) -> float:
        """The published variance of an aiding sensor."""
        if info.name in self.variance:
            return self.variance[info.name]
        if info.kind == GNSS:
            return self.rtk if info.datasheet.get("position_noise_m", np.inf) < _RTK_NOISE_M else self.gps
        return {"radar": self.radar_m2_s2, "accosat": self.accosat_m2_s2}[info.kind]


class ReportedQuality:
    """Reads quality and sigmas of a receiver's samples.

    Raises:
        BadInputError: the receiver does not report them.
    """

    def __init__(self, info: SensorInfo, weighting: GnssWeighting, setup: EstimatorSetup, *, published: float) -> None:
        self._quality = column_places(info, ("quality",), setup=setup)
        self._sigmas = column_places(info, ("sigma_e_m", "sigma_n_m"), setup=setup)
        names = list(_FROM_WORST)
        self._accepted = [
            code for name in names[names.index(weighting.minimum_quality) :] for code in _FROM_WORST[name]
        ]
        self._floor = weighting.sigma_floor_m**2
        self._published = published

    def accepts(self, measurement: Measurement) -> BoolArray:
        """Members whose sample is of a quality that is used, shape (R,)."""
        return np.isin(measurement.values[:, self._quality][:, 0], self._accepted)

    def position_variances(self, measurement: Measurement) -> FloatArray:
        """Variances (R, 2) of east and north, in m^2."""
        sigmas = measurement.values[:, self._sigmas]
        known = np.isfinite(sigmas) & (sigmas > 0.0)
        return np.where(known, np.maximum(np.where(known, sigmas, 0.0) ** 2, self._floor), self._published)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What an aid makes of one measurement."""

    values: FloatArray
    """(R, m)."""
    mask: BoolArray
    """(R,) where it can be used."""
    variances: FloatArray | None
    """(R, m) in place of the observation's own, where the sensor reports them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Aid:
    """One thing an aiding sensor tells the filter: these of its columns, seen so."""

    name: str
    """What its innovations are called."""
    places: Places
    observation: Observation
    is_speed: bool
    reported: ReportedQuality | None = None

    def read(self, measurement: Measurement) -> Reading:
        """Take from a measurement what the filter needs."""
        values = measurement.values[:, self.places]
        mask = usable(measurement, values)
        if self.reported is None:
            return Reading(values=values, mask=mask, variances=None)
        variances = None if self.is_speed else self.reported.position_variances(measurement)
        return Reading(values=values, mask=mask & self.reported.accepts(measurement), variances=variances)


def aids_of(
    info: SensorInfo, noise: AidingNoise, weighting: GnssWeighting, setup: EstimatorSetup, origin_left_m: float
) -> list[Aid]:
    """What an aiding sensor tells a filter whose origin is ``origin_left_m`` to the left of the reference.

    Raises:
        BadInputError: the sensor sits on another body, or lacks a column that is needed.
    """
    forward, left = lever_arm(info, setup)
    left -= origin_left_m
    variance = noise.of(info)
    speed = ForwardSpeed(variance, left_m=left)
    if info.kind != GNSS:
        places = column_places(info, (SPEED_COLUMN,), setup=setup)
        return [Aid(name=info.name, places=places, observation=speed, is_speed=True)]
    reported = None
    if weighting.noise == "reported":
        reported = ReportedQuality(info, weighting, setup, published=variance)
    aids: list[Aid] = []
    if all(name in info.columns for name in POSITION_COLUMNS):
        places = column_places(info, POSITION_COLUMNS, setup=setup)
        seen = AntennaPosition(variance, forward_m=forward, left_m=left)
        aids.append(
            Aid(name=f"{info.name}_position", places=places, observation=seen, is_speed=False, reported=reported)
        )
    if SPEED_COLUMN in info.columns:
        places = column_places(info, (SPEED_COLUMN,), setup=setup)
        aids.append(Aid(name=f"{info.name}_speed", places=places, observation=speed, is_speed=True, reported=reported))
    return aids
