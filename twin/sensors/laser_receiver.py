"""Receiver of a rotating laser: how high it is above the laser's plane, in a few levels (kind ``laser_receiver``).

The transmitter (an RL-H5A in paper 002) draws a level plane at ``plane_height_m``; the receiver's column of photocells
tells where the beam meets it. The LR4009 gives 23 levels, whose ranges are table 1 of paper 002 and no even steps: 3 mm
each up to 19.5 mm, then 13, 1, 29, 1 and 21 mm, as size and arrangement of the cells have it. Positive is a receiver
above the plane. On a mast that leans by d the beam meets the cells 1 / cos d farther out.

Beyond 84.5 mm the beam misses the cells. What the receiver then says is a choice of its maker: nothing (``none``, NaN
here), or the outermost level on the side where it lost the beam (``outermost``). The paper's text ("can only output the
height levels of +-81 mm") reads like the second, which an estimator cannot tell from a beam that meets the last cell;
so the first is the default, and the second what reproduces its figure 9.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.config import NonNegative
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.noise import WhiteNoise
from twin.signals import Capture, FloatArray, Mount, MountMotion

HEIGHT_LEVEL = "height_level_m"
LEVELS_M = np.array([0, 3, 6, 9, 12, 15, 18, 21, 33, 45, 63, 81]) * 1e-3
"""(12,) levels above the plane; those below are their negatives. Paper 002, table 1."""
UPPER_LIMITS_M = np.array([1.5, 4.5, 7.5, 10.5, 13.5, 16.5, 19.5, 32.5, 33.5, 62.5, 63.5, 84.5]) * 1e-3
"""(12,) height to which each is given; each begins where the one before ends. Paper 002, table 1."""


class LaserReceiverConfig(SensorConfig):
    """A receiver on the implement and the plane it sees."""

    kind: Literal["laser_receiver"]
    plane_height_m: float = 0.0
    """Up coordinate of the laser's plane."""
    plane_sigma_m: NonNegative = 0.0
    """How well the plane is at that height, 1 sigma, drawn once: the transmitter's levelling and its setting up."""
    noise_m: NonNegative = 0.0
    """White error of where the beam meets the cells, 1 sigma."""
    beyond_range: Literal["none", "outermost"] = "none"
    """What it says where the beam misses the cells."""


class LaserReceiver(Sensor):
    """Level of the height above the laser's plane. Hidden column: how much of the height is the plane's own error."""

    columns = (HEIGHT_LEVEL,)
    error_columns = columns
    extra_hidden_columns = (f"{HEIGHT_LEVEL}.bias",)

    def __init__(
        self, config: LaserReceiverConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._plane_m = config.plane_height_m
        self._bias = -config.plane_sigma_m * self._streams.once("plane", 1)
        self._noise = (
            WhiteNoise(sigma=config.noise_m, stream=self._streams.normal("noise", 1)) if config.noise_m > 0.0 else None
        )
        self._outermost = config.beyond_range == "outermost"

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, MountMotion)
        truth = float(capture.position_enu_m[2]) - self._plane_m
        upright = float(capture.rotation[2, 2])
        height = self._bias + truth
        # Cells that lie flat or hang upside down are met by no beam.
        along = height / upright if upright > 0.0 else np.full_like(height, math.inf)
        if self._noise is not None:
            along = along + self._noise.step()
        values = level(along, outermost=self._outermost and upright > 0.0)
        return Reading(values=values, truth=np.array([truth]), hidden=self._bias)

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        """Also table 1: ``level_<k>_m`` and ``level_<k>_to_m``, k from 0 (the middle) to 11."""
        assert isinstance(config, LaserReceiverConfig)
        sheet = {
            "plane_height_m": config.plane_height_m,
            "plane_sigma_m": config.plane_sigma_m,
            "noise_m": config.noise_m,
            "range_m": float(UPPER_LIMITS_M[-1]),
        }
        for k, (middle, limit) in enumerate(zip(LEVELS_M.tolist(), UPPER_LIMITS_M.tolist(), strict=True)):
            sheet |= {f"level_{k}_m": middle, f"level_{k}_to_m": limit}
        return sheet

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        """Rounding in the middle, and the noise."""
        assert isinstance(config, LaserReceiverConfig)
        return np.array([math.hypot(2.0 * UPPER_LIMITS_M[0] / math.sqrt(12.0), config.noise_m)])


def level(height_m: FloatArray, *, outermost: bool) -> FloatArray:
    """Level that a receiver gives at these heights, of any shape; NaN beyond the range, or the ``outermost`` one.

    A height right at a limit has the level nearer to zero.
    """
    place = np.searchsorted(UPPER_LIMITS_M, np.abs(height_m), side="left")
    inside = LEVELS_M[np.minimum(place, len(LEVELS_M) - 1)]
    given: FloatArray = np.where(height_m < 0.0, -inside, inside) + 0.0  # no negative zero
    return given if outermost else np.where(place < len(LEVELS_M), given, np.nan)
