"""The standstill detector of paper 000, section 2.7, and what it takes to make it work.

**As published**: the norm of the accelerometer, low-pass filtered, "should sum up to the gravitation vector while
standing still"; the speed is set to zero with no uncertainty while it does, unless the last speed was above 1 m/s. No
threshold, no time constant.

**Why that is not enough.** A horizontal acceleration a changes the norm by a^2 / 2g only: 13 mm/s^2 at a start of
0.5 m/s^2, below the 16 mm/s^2 of noise that four units (variance 0.05 per sample) leave after a low-pass of 0.5 s. The
norm alone therefore calls every smooth motion below 1 m/s standstill; and since the estimate is then held at zero
without uncertainty, it never exceeds the 1 m/s that would release it: the filter *latches* while the machine drives
off. What tells an implement in motion is that it shakes.

**What is built**, with tau the time constant, T the step, alpha = 1 - exp(-T / tau), d the mean over the units of the
norm minus that unit's norm in the calibration, and V the variance of d seen in the calibration. A machine stands if

    |low-pass(d)| <= k sqrt(V alpha / (2 - alpha))       the published test, two-sided
    low-pass(d^2) <= V (1 + c sqrt(2 alpha / (2 - alpha)))        it does not shake either

k and c are quantiles at which a standing machine fails either test with half of ``missed_rate`` each, for noise that
is white and normal at the units' rate. A weighted sum of squares is skewed: c is that of a Pearson III distribution
with the sum's third moment. ``missed_rate`` may be generous (5 %): not recognising standstill for a moment costs
nothing, a false standstill costs the whole speed. ``shaking_test = false`` leaves the published test alone.

**What remains**: on the twin's class C ground the planter hardly shakes at walking pace (the norm's standard deviation
over four units is 0.008 m/s^2 at 0.5 m/s, 0.02 at 1 m/s, 0.4 at 2.5 m/s, against 0.11 of sensor noise), so a smooth
drive-off is called standstill for 1 to 2 s, until the shaking or the guard releases it: ``planter_turns`` loses up to
0.7 m/s and a metre of position there. The paper describes the same peak where its car stops. A detector that believes
speed sensors sooner is a smaller ``guard_m_s``; the default stays the paper's.

The 1 m/s guard looks at the estimate, as published, and (``guard_by_sensors``) at the newest reading of every speed
sensor too: a latched filter is then released at the latest when a sensor reads 1 m/s.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Annotated

import numpy as np
from pydantic import Field

from twin.config import Config, NonNegative, Positive
from twin.estimators.calibration import Calibration, mean_of_units
from twin.signals import BoolArray, FloatArray

_VARIANCE_FLOOR = 1e-6
"""(1 mm/s^2)^2, about one digit of a cheap accelerometer: a unit without noise has no smaller resolution."""


class StandstillConfig(Config):
    """How standstill is recognised; see the module's docstring."""

    enabled: bool = True
    """Whether standstill is recognised at all."""
    time_constant_s: Positive = 0.5
    """Time constant of the low-pass filters."""
    missed_rate: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.05
    """Share of the time in which a standing machine is not recognised as standing."""
    guard_m_s: NonNegative = 1.0
    """Above this last speed the detector is ignored."""
    shaking_test: bool = True
    """Also ask that the machine does not shake. False: the norm alone, as published."""
    guard_by_sensors: bool = True
    """The guard also looks at the newest reading of every speed sensor. False: at the estimate alone, as published."""


def low_pass_gain(time_constant_s: float, step_s: float) -> float:
    """Gain alpha of the discrete first-order low-pass y += alpha (u - y)."""
    return 1.0 - math.exp(-step_s / time_constant_s)


def mean_quantile(probability: float, alpha: float) -> float:
    """Quantile of low-passed white normal noise of variance 1."""
    return NormalDist().inv_cdf(probability) * math.sqrt(alpha / (2.0 - alpha))


def energy_quantile(probability: float, alpha: float) -> float:
    """Quantile of the low-passed square of white normal noise of variance 1.

    The sum of alpha (1 - alpha)^k chi-square(1) has mean 1, variance 2 alpha / (2 - alpha) and third central moment
    8 alpha^3 / (1 - (1 - alpha)^3). The quantile is that of a Pearson III distribution with these three moments, by
    the cube-root (Wilson-Hilferty) approximation.
    """
    variance = 2.0 * alpha / (2.0 - alpha)
    skewness = 8.0 * alpha**3 / (1.0 - (1.0 - alpha) ** 3) / math.pow(variance, 1.5)
    z = NormalDist().inv_cdf(probability)
    root = 1.0 + skewness * z / 6.0 - skewness * skewness / 36.0
    return 1.0 + math.sqrt(variance) * (2.0 / skewness) * (root * root * root - 1.0)


class StandstillDetector:
    """The two low-pass filters and their thresholds, for R runs and the inertial units of one filter."""

    def __init__(self, config: StandstillConfig, calibration: Calibration, *, step_s: float) -> None:
        self._alpha = low_pass_gain(config.time_constant_s, step_s)
        self._norm = calibration.norm
        self._all_units = list(range(len(calibration.norm)))
        variance = np.maximum(calibration.norm_variance, _VARIANCE_FLOOR)
        miss = config.missed_rate / 2.0 if config.shaking_test else config.missed_rate
        self.mean_limit: FloatArray = mean_quantile(1.0 - miss / 2.0, self._alpha) * np.sqrt(variance)
        self.energy_limit: FloatArray | None = None
        if config.shaking_test:
            self.energy_limit = energy_quantile(1.0 - miss, self._alpha) * variance
        self._mean = np.zeros_like(variance)
        self._energy = variance

    def update(self, units: list[int], norms: FloatArray, present: BoolArray | None) -> None:
        """Take one tick: ``norms`` (k, R) of the ``units`` that answered, ``present`` (k, R) where usable.

        ``present`` None says that all are usable, in every member.
        """
        reference = self._norm if units == self._all_units else self._norm[units]
        deviation, count = mean_of_units(norms - reference, present)
        gain = self._alpha if present is None else np.where(count > 0.0, self._alpha, 0.0)
        # Fewer units leave more noise in their mean; the weight keeps its expected energy at V.
        weight = count / len(self._norm)
        self._mean = self._mean + gain * (deviation - self._mean)
        self._energy = self._energy + gain * (weight * deviation * deviation - self._energy)

    def standing(self) -> BoolArray:
        """Tell which members stand, shape (R,)."""
        still: BoolArray = np.abs(self._mean) <= self.mean_limit
        return still if self.energy_limit is None else still & (self._energy <= self.energy_limit)
