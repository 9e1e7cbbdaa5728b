"""What paper 001 does to the readings before they reach a filter: calibration (chapter 3), then a pre-filter (4.1).

**Calibration.** The machine stands first: the mean gyroscope reading is its offset, and so is the accelerometer's,
gravity left on the upward axis. That takes a tilt of the ground, or of the unit, for an offset. Then it may turn: half
the sum of the largest and smallest reading of a magnetometer axis is its hard iron (eq 18). A machine that turns on
level ground says nothing about the upward axis: there, half the sum is the vertical field itself; ``turn_axes`` says
which axes to believe. The heading turned is followed by the gyroscope. With ``turn_fit``, which is ours and not the
paper's, a whole turn tells more (:mod:`twin.estimators.turn_fit`): soft iron, and the gyroscope's scale.

**Pre-filter** (table 1). A reading that differs by more than NP from what the pre-filter last gave passes; between NPS
and NP it gives the mean of both; below NPS it is low-passed with the weight NPL. For the gyroscope what is compared
with is zero and NPL is zero: a dead band of 0.267 deg/s. **What that costs**: a gyroscope bias left over, or a real
turn, below the band vanishes: a robot may turn 16 deg in a minute without any of the paper's filters noticing by
gyroscope. And a magnet's ramp slower than NP passes late, by the low-pass of 0.20 Hz. NPL 0.025 is for 50 Hz; at
another rate the weight of the same cut-off, Fc = NPL / ((1 - NPL) 2 pi dT), is taken.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Strict

from twin.config import Config, NonNegative, Probability, Vector3
from twin.estimators.heading_inputs import HeadingSample
from twin.estimators.turn_fit import fit_turn
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import BoolArray, FloatArray

_PAPER_STEP_S = 0.02

Matrix3 = Annotated[tuple[Vector3, Vector3, Vector3], Strict(strict=False)]


class BandConfig(Config):
    """One row of table 1."""

    pass_above: NonNegative
    """NP: a difference above it passes as it is."""
    mean_above: NonNegative
    """NPS: between it and NP the mean is given."""
    low_pass_weight: Probability
    """NPL at 50 Hz: weight of a new reading below NPS."""


class PreFilterConfig(Config):
    """The pre-filter's table 1; the gyroscope's limits in rad/s."""

    accelerometer: BandConfig = BandConfig(pass_above=0.2095, mean_above=0.1796, low_pass_weight=0.025)
    gyro: BandConfig = BandConfig(
        pass_above=float(np.deg2rad(0.267)), mean_above=float(np.deg2rad(0.267)), low_pass_weight=0.0
    )
    magnetometer: BandConfig = BandConfig(pass_above=3.0, mean_above=3.0, low_pass_weight=0.025)


class PreparationConfig(Config):
    """What happens to the readings before they reach a filter."""

    standstill_s: NonNegative = 20.0
    """Standstill at the start from which offsets are taken (the paper: 1000 samples at 50 Hz); 0: none."""
    accelerometer_offset: bool = True
    """Whether the accelerometers' mean is taken for an offset: right only on level ground."""
    gyro_offset: bool = True
    turn_s: NonNegative = 0.0
    """Turning after the standstill from which the hard iron is taken; 0: none."""
    turn_axes: Literal["xy", "xyz"] = "xy"
    """Axes whose hard iron the turning shows: xy for a turn on level ground."""
    turn_fit: bool = False
    """Whether the turning also tells the level soft iron and the scale of the gyroscope about z, if it was whole."""
    hard_iron_ut: Vector3 = (0.0, 0.0, 0.0)
    """Hard iron known from a calibration before; the turn replaces it on its axes."""
    soft_iron: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """What makes a sphere of the readings once the hard iron is off (rows); the paper's filters take none."""
    filtered: bool = True
    """Whether the pre-filter is used."""
    prefilter: PreFilterConfig = PreFilterConfig()
    """Its table 1."""


class BandFilter:
    """Function NF of section 4.1 over an array of readings (R, 3); ``towards_zero`` compares with zero."""

    def __init__(self, config: BandConfig, *, towards_zero: bool = False) -> None:
        self._config = config
        self._towards_zero = towards_zero
        weight = config.low_pass_weight
        self._cut_off = weight / ((1.0 - weight) * _PAPER_STEP_S) if weight < 1.0 else np.inf
        self._last: FloatArray | None = None
        self._seen: BoolArray | None = None

    def step(self, values: FloatArray, fresh: BoolArray, dt_s: float) -> FloatArray:
        """Give the filtered readings (R, 3); members that are not ``fresh`` (R,) keep what was given last."""
        if self._last is None or self._seen is None:
            self._last, self._seen = np.zeros_like(values), np.zeros(len(values), dtype=np.bool_)
        config = self._config
        compared = np.zeros_like(values) if self._towards_zero else self._last
        far = np.abs(values - compared)
        step = self._cut_off * dt_s
        weight = step / (1.0 + step) if np.isfinite(step) else 1.0
        near = np.where(far > config.mean_above, 0.5 * (values + compared), (1.0 - weight) * compared + weight * values)
        given = np.where(far > config.pass_above, values, near)
        if not self._towards_zero:
            given = np.where(self._seen[:, np.newaxis], given, values)
        self._last = np.where(fresh[:, np.newaxis], given, self._last)
        self._seen = self._seen | fresh
        return self._last


class Preparation:
    """Calibration and pre-filter over the ensemble axis; memory does not grow once the calibration is over."""

    def __init__(self, config: PreparationConfig, *, step_s: float, runs: int) -> None:
        self._config = config
        self._standstill_ticks = round(config.standstill_s / step_s)
        self._ticks = self._standstill_ticks + round(config.turn_s / step_s)
        self._first: int | None = None
        self._count = np.zeros((3, runs))
        self._sum = np.zeros((3, runs, 3))
        self._high = np.full((runs, 3), -np.inf)
        self._low = np.full((runs, 3), np.inf)
        self._finished = False
        self.force_offset: FloatArray = np.zeros((runs, 3))
        """(R, 3) taken off the specific force, m/s^2."""
        self.rate_offset: FloatArray = np.zeros((runs, 3))
        """(R, 3) taken off the angular rate, rad/s."""
        self.hard_iron: FloatArray = np.broadcast_to(np.asarray(config.hard_iron_ut), (runs, 3)).copy()
        """(R, 3) taken off the field, microtesla."""
        self.turned: FloatArray = np.zeros(runs)
        """(R,) heading turned during the calibration, by gyroscope, rad."""
        self.scale_sigma: FloatArray = np.full(runs, np.nan)
        """(R,) of the gyroscope's scale about z, where a turn has told it; NaN elsewhere."""
        self._rate_factor: FloatArray = np.ones(runs)
        self._level_iron: FloatArray = np.tile(np.eye(2), (runs, 1, 1))
        self._swept: list[tuple[FloatArray, FloatArray, BoolArray]] = []
        bands = config.prefilter
        self._soft_iron = np.array(config.soft_iron)
        self._accelerometer = BandFilter(bands.accelerometer)
        self._gyro = BandFilter(bands.gyro, towards_zero=True)
        self._magnetometer = BandFilter(bands.magnetometer)

    def standing_field(self) -> tuple[FloatArray, BoolArray]:
        """Mean field of the standstill (R, 3), hard iron taken off, and where there was any, (R,)."""
        count = self._count[2]
        return self._without_iron(self._sum[2] / np.maximum(count, 1.0)[:, np.newaxis]), count > 0.0

    def take(self, sample: HeadingSample) -> HeadingSample | None:
        """Take a sample; return it calibrated and pre-filtered, or None while the calibration runs."""
        if self._first is None:
            self._first = sample.index
        age = sample.index - self._first
        if age < self._standstill_ticks:
            self._stand(sample)
            return None
        if age < self._ticks:
            self._turn(sample)
            return None
        if not self._finished:
            self._finish()
        sample.force = sample.force - self.force_offset
        sample.rate = sample.rate - self.rate_offset
        sample.rate[:, 2] *= self._rate_factor
        sample.field = self._without_iron(sample.field)
        if self._config.filtered:
            sample.force = self._accelerometer.step(sample.force, sample.inertial, sample.dt_s)
            sample.rate = self._gyro.step(sample.rate, sample.inertial, sample.dt_s)
            sample.field = self._magnetometer.step(sample.field, sample.magnetic, sample.dt_s)
        return sample

    def _without_iron(self, field: FloatArray) -> FloatArray:
        without = np.einsum("ij,rj->ri", self._soft_iron, field - self.hard_iron)
        without[:, :2] = np.einsum("rij,rj->ri", self._level_iron, without[:, :2])
        return np.asarray(without)

    def _stand(self, sample: HeadingSample) -> None:
        parts = ((sample.force, sample.inertial), (sample.rate, sample.inertial), (sample.field, sample.magnetic))
        for place, (values, fresh) in enumerate(parts):
            self._count[place] += fresh
            self._sum[place] += np.where(fresh[:, np.newaxis], values, 0.0)
        self._learn()

    def _learn(self) -> None:
        means = self._sum / np.maximum(self._count, 1.0)[..., np.newaxis]
        if self._config.gyro_offset:
            self.rate_offset = means[1]
        if self._config.accelerometer_offset:
            gravity = np.where(self._count[0] > 0.0, STANDARD_GRAVITY_M_S2, 0.0)
            self.force_offset = means[0] - gravity[:, np.newaxis] * np.array([0.0, 0.0, 1.0])

    def _turn(self, sample: HeadingSample) -> None:
        fresh = sample.magnetic[:, np.newaxis]
        self._high = np.where(fresh, np.maximum(self._high, sample.field), self._high)
        self._low = np.where(fresh, np.minimum(self._low, sample.field), self._low)
        self.turned = self.turned + sample.dt_s * (sample.rate - self.rate_offset)[:, 2]
        if self._config.turn_fit:
            self._swept.append((self.turned, sample.field, sample.magnetic))

    def _finish(self) -> None:
        self._finished = True
        seen = np.isfinite(self._high)
        if self._config.turn_axes == "xy":
            seen[:, 2] = False
        high, low = np.where(seen, self._high, 0.0), np.where(seen, self._low, 0.0)
        self.hard_iron = np.where(seen, 0.5 * (high + low), self.hard_iron)
        if self._swept:
            self._fit_turn()

    def _fit_turn(self) -> None:
        """Replace what the extreme readings told by what the whole turn tells, where it was one."""
        angle, field, used = (np.stack(each) for each in zip(*self._swept, strict=True))
        self._swept.clear()
        bent = np.einsum("ij,trj->tri", self._soft_iron, field - self.hard_iron)
        fit = fit_turn(angle, bent[..., :2], used)
        centre = np.concatenate([fit.centre_ut, np.zeros((len(fit.found), 1))], axis=1)
        self.hard_iron = self.hard_iron + np.linalg.solve(self._soft_iron, centre.T).T
        self._level_iron, self._rate_factor, self.scale_sigma = fit.correction, fit.rate_factor, fit.rate_sigma
        self.turned = self.turned * fit.rate_factor
