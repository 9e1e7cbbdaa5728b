"""Preparation of an AHRS's upward free acceleration: outliers, zero offset, trend (paper 002, section 2.2).

The paper takes 50 min of standing samples, replaces outliers (:mod:`twin.estimators.hampel`), takes off the mean
(-13.80 mm/s^2) and "extracts and removes the trending term using the least square method". On a machine all of it has
to be causal: from each sample, in this order, the outlier is replaced and a straight line taken off,

    a = a_filtered - (offset + trend t),     t since the sensor's first sample.

**Offset.** ``"standing"``: mean of the filtered samples of the first ``calibration_s``, in which the machine stands and
its acceleration is given out as zero. White noise of density D (one-sided) leaves the offset D / sqrt(2 T) wrong: with
an MTi-300 (60 ug/sqrt(Hz)) 9.5 ug after 20 s and 0.8 ug after the paper's 50 min; 7.8 ug are 30 mm in 28 s.
``"given"``: a number from an earlier record. ``"none"``: as it comes.

**Trend.** ``"none"``, which is best for a short run. ``"given"``: the slope of an earlier record (:func:`fit_line`
takes it from one as the paper does). ``"standing"``: slope and offset by least squares over the ``calibration_s``, and
the line is gone on with for good. It is there to show what that costs: a slope fitted over T has the standard deviation
D sqrt(6 / T^3), so that at a time t long after the calibration the line is 2 sqrt(3) t / T times as wrong as the mean.

**Outliers.** ``"standing"``: eqs 1 to 3, while the machine stands to calibrate. The paper describes them for its
standing record, and with them in a run its filter could not have been as good as its figures say
(:mod:`twin.estimators.hampel`). ``"always"``: eqs 1 to 3 on every sample, the other way to read it. ``"robust"``: ours,
on every sample.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from twin.config import Config, NonNegative
from twin.estimators.hampel import OutlierFilter, PublishedHampel, RobustHampel
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray, nanoseconds

PUBLISHED_OFFSET_M_S2 = -0.0138
"""Zero offset of the paper's AHRS."""

_NEVER = np.iinfo(np.int64).min


class HeightPreparationConfig(Config):
    """What is done to the free acceleration before a filter gets it; the defaults are the paper's, made causal."""

    outliers: Literal["none", "standing", "always", "robust"] = "standing"
    """Whether and how outliers are replaced."""
    offset: Literal["none", "standing", "given"] = "standing"
    """Where the zero offset is taken from."""
    offset_m_s2: float = PUBLISHED_OFFSET_M_S2
    """The offset that is given."""
    trend: Literal["none", "standing", "given"] = "none"
    """Where the slope is taken from."""
    trend_m_s3: float = 0.0
    """The slope that is given."""
    calibration_s: NonNegative = 20.0
    """How long the machine stands at the start."""


class Line(NamedTuple):
    """A straight line offset + trend t through samples."""

    offset: FloatArray
    """(R,)."""
    trend: FloatArray
    """(R,) per second."""


def fit_line(t_s: FloatArray, samples: FloatArray) -> Line:
    """Straight lines through samples (T, R) at times ``t_s`` (T,), by least squares; the offset is that at t = 0."""
    mean_t = t_s.mean()
    about = t_s - mean_t
    trend = about @ (samples - samples.mean(axis=0)) / (about @ about)
    return Line(samples.mean(axis=0) - trend * mean_t, trend)


class RunningLine:
    """Least-squares lines through samples of R streams, without keeping them."""

    def __init__(self, runs: int) -> None:
        self.count: FloatArray = np.zeros(runs)
        """(R,) samples taken."""
        self._mean_t: FloatArray = np.zeros(runs)
        self._mean: FloatArray = np.zeros(runs)
        self._spread: FloatArray = np.zeros(runs)
        self._product: FloatArray = np.zeros(runs)

    def add(self, t_s: FloatArray, samples: FloatArray, used: BoolArray) -> None:
        """Take samples (R,) at times (R,) where ``used`` (R,)."""
        self.count = self.count + used
        share = used / np.maximum(self.count, 1.0)
        before, beside = np.where(used, t_s - self._mean_t, 0.0), np.where(used, samples - self._mean, 0.0)
        self._mean_t = self._mean_t + before * share
        self._mean = self._mean + beside * share
        after = np.where(used, t_s - self._mean_t, 0.0)
        self._spread = self._spread + before * after
        self._product = self._product + after * beside

    def line(self, *, trend: FloatArray | None = None) -> Line:
        """The lines; with ``trend`` (R,) given, those of that slope. Zero where there were no samples."""
        if trend is None:
            trend = np.zeros_like(self._mean)
            trend = np.divide(self._product, self._spread, out=trend, where=self._spread > 0.0)
        return Line(np.where(self.count > 0.0, self._mean - trend * self._mean_t, 0.0), trend)


class HeightPreparation:
    """Prepares one AHRS's upward acceleration for R runs.

    Args:
        config: what is done.
        noise_m_s2: standard deviation of the sensor's white noise in one sample; zero if it is not known.
        runs: R.
    """

    def __init__(self, config: HeightPreparationConfig, *, noise_m_s2: float, runs: int) -> None:
        self._config = config
        self._filter = _outlier_filter(config, noise_m_s2, runs)
        self._first_ns: IntArray = np.zeros(runs, dtype=np.int64)
        self._newest_ns: IntArray = np.full(runs, _NEVER, dtype=np.int64)
        self._record = RunningLine(runs)
        needed = "standing" in {config.offset, config.trend}
        self._calibration_ns = nanoseconds(config.calibration_s) if needed else 0
        self._finished = False
        self.line = Line(np.zeros(runs), np.zeros(runs))
        """What is taken off: m/s^2 and m/s^3."""
        self.acceleration: FloatArray = np.zeros(runs)
        """(R,) the newest prepared sample, m/s^2; zero before the first and while the machine stands to calibrate."""
        self.replaced: BoolArray = np.zeros(runs, dtype=np.bool_)
        """(R,) whether the last sample was taken for an outlier."""
        self._learn()

    def take(self, t_ns: int, sample: FloatArray, there: BoolArray) -> FloatArray:
        """Take the samples (R,) of time ``t_ns`` where they are ``there`` (R,); return :attr:`acceleration`.

        Samples that are no newer than the last one (repeated, out of order) are ignored.
        """
        there = there & (t_ns > self._newest_ns)
        self._first_ns = np.where(there & (self._newest_ns == _NEVER), t_ns, self._first_ns)
        self._newest_ns = np.where(there, t_ns, self._newest_ns)
        since_ns = t_ns - self._first_ns
        standing = since_ns < self._calibration_ns
        filtered = self._without_outliers(sample, there, standing)
        self._calibrate(since_ns, filtered, there & standing)
        straight = self.line.offset + self.line.trend * (since_ns / NS_PER_S)
        self.acceleration = np.where(there, np.where(standing, 0.0, filtered - straight), self.acceleration)
        return self.acceleration

    def _without_outliers(self, sample: FloatArray, there: BoolArray, standing: BoolArray) -> FloatArray:
        if self._filter is None or (self._config.outliers == "standing" and self._finished):
            return sample
        filtered = self._filter.step(sample, there)
        if self._config.outliers != "standing":
            self.replaced = self._filter.replaced
            return filtered
        self.replaced = self._filter.replaced & standing
        return np.where(standing, filtered, sample)

    def _calibrate(self, since_ns: IntArray, filtered: FloatArray, stood: BoolArray) -> None:
        """Learn from those that still stand, (R,)."""
        if self._finished:
            return
        self._record.add(since_ns / NS_PER_S, filtered, stood)
        self._learn()
        self._finished = not (since_ns < self._calibration_ns).any() and bool((self._newest_ns != _NEVER).all())

    def _learn(self) -> None:
        config, runs = self._config, len(self._newest_ns)
        trend = None
        if config.trend != "standing":
            trend = np.full(runs, config.trend_m_s3 if config.trend == "given" else 0.0)
        line = self._record.line(trend=trend)
        if config.offset == "standing":
            self.line = line
        else:
            self.line = Line(np.full(runs, config.offset_m_s2 if config.offset == "given" else 0.0), line.trend)


def _outlier_filter(config: HeightPreparationConfig, noise_m_s2: float, runs: int) -> OutlierFilter | None:
    if config.outliers == "none":
        return None
    return RobustHampel(noise=noise_m_s2, runs=runs) if config.outliers == "robust" else PublishedHampel(runs)
