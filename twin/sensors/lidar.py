"""Turning laser distance sensor (kind ``lidar``), one column per beam of a turn.

Beam k of n points 2 pi k / n counter-clockwise from the mount's x axis; a turn takes one sample period, in which the
machine moves on: a scan is not a picture of one instant. For a beam that goes d,

    r = d + g b + s n

with n white noise and b a constant error drawn once per run (both standard normal); the sizes s and g are constant
below ``near_to_m`` and in proportion to d beyond it, as data sheets of triangulating sensors state them. What lies
outside the range, or meets nothing, gives no value (NaN).

In light beyond ``light_limit_lux`` the spot drowns: a beam is lost with the probability 1 - limit / light, and a share
of those lost finds a wrong spot and gives a range that means nothing (uniform over the sensor's range). Data sheets
state the limit; how points are lost beyond it is a choice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from twin.config import NonNegative, Positive, Probability
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.noise import Quantiser
from twin.signals import Capture, FloatArray, Mount, Need, RayNeed, RayScan


def range_columns(beams: int) -> tuple[str, ...]:
    """Columns of a turn, ``range_000_m`` and so on."""
    digits = len(str(beams - 1))
    return tuple(f"range_{beam:0{digits}d}_m" for beam in range(beams))


class LidarConfig(SensorConfig):
    """Errors are standard deviations; whatever is left out is absent."""

    kind: Literal["lidar"]
    beams: Annotated[int, Field(ge=1, le=4096)] = 360
    """Of one turn; a turn takes one sample period."""
    min_range_m: NonNegative
    max_range_m: Positive
    near_to_m: NonNegative = 0.0
    """Errors are constant up to here, and in proportion to the distance beyond."""
    near_noise_m: NonNegative = 0.0
    far_noise_ratio: NonNegative = 0.0
    near_bias_m: NonNegative = 0.0
    """Constant error of a unit."""
    far_bias_ratio: NonNegative = 0.0
    resolution_m: NonNegative = 0.0
    lost_probability: Probability = 0.0
    """Of a beam, in any light."""
    light_limit_lux: Positive | None = None
    """Beyond it beams are lost to the light."""
    wrong_share: Probability = 0.0
    """Of the beams lost to the light, those that give a wrong range."""

    @model_validator(mode="after")
    def _ranges_in_order(self) -> Self:
        if not self.min_range_m < self.max_range_m:
            raise ValueError(f"min_range_m = {self.min_range_m:g} must be less than max_range_m")
        return self

    @property
    def bearings_rad(self) -> FloatArray:
        """(n,) counter-clockwise from the mount's x axis."""
        return 2.0 * math.pi / self.beams * np.arange(self.beams, dtype=np.float64)

    @property
    def recorded_columns(self) -> int:
        """About how many numbers a sample leaves in memory."""
        return 4 * self.beams

    def need(self, mount: Mount) -> Need:
        """Beams all round, sent over one sample period."""
        bearings = tuple(self.bearings_rad.tolist())
        return RayNeed(mount=mount, bearings_rad=bearings, reach_m=self.max_range_m, sweep_s=1.0 / self.rate_hz)


class Lidar(Sensor):
    """Ranges of a turn that ends when it is sampled."""

    def __init__(
        self, config: LidarConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        self.columns = self.error_columns = range_columns(config.beams)
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._config = config
        self._bias = self._streams.once("bias", 1)
        self._noise = self._streams.normal("noise", config.beams)
        self._chance = self._streams.uniform("lost", config.beams)
        self._wrong = self._streams.uniform("wrong", 2 * config.beams)
        self._digits = Quantiser(lsb=np.full(config.beams, config.resolution_m))

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, RayScan)
        config = self._config
        truth = np.where(np.isfinite(capture.distance_m), capture.distance_m, np.nan)
        near = truth < config.near_to_m
        noise = np.where(near, config.near_noise_m, config.far_noise_ratio * truth)
        bias = np.where(near, config.near_bias_m, config.far_bias_ratio * truth)
        values = truth + bias * self._bias + noise * self._noise.next()
        values[(values < config.min_range_m) | (values > config.max_range_m)] = np.nan
        self._lose(values, capture.illuminance_lux)
        return Reading(
            values=self._digits.apply(values), truth=truth, hidden=np.empty((self._runs, 0), dtype=np.float64)
        )

    def _lose(self, values: FloatArray, lux: float) -> None:
        """Take beams away that are lost, and put wrong ranges where the light makes them."""
        config = self._config
        limit = config.light_limit_lux
        drowned = 0.0 if limit is None or lux <= limit else 1.0 - limit / lux
        if drowned == 0.0 and config.lost_probability == 0.0:
            return
        chance = self._chance.next()
        in_light = chance < drowned
        values[in_light | (chance > 1.0 - config.lost_probability)] = np.nan
        if drowned > 0.0 and config.wrong_share > 0.0:
            pair = self._wrong.next()
            mistaken = in_light & (pair[:, : config.beams] < config.wrong_share)
            anywhere = config.min_range_m + (config.max_range_m - config.min_range_m) * pair[:, config.beams :]
            values[mistaken] = anywhere[mistaken]

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, LidarConfig)
        sheet = {
            "beams": float(config.beams),
            "min_range_m": config.min_range_m,
            "max_range_m": config.max_range_m,
            "near_to_m": config.near_to_m,
            "near_noise_m": config.near_noise_m,
            "far_noise_ratio": config.far_noise_ratio,
            "near_bias_m": config.near_bias_m,
            "far_bias_ratio": config.far_bias_ratio,
            "resolution_m": config.resolution_m,
        }
        limit = config.light_limit_lux
        return sheet if limit is None else {**sheet, "light_limit_lux": limit}

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        assert isinstance(config, LidarConfig)
        return np.full(config.beams, config.near_noise_m)
