"""Outliers of an acceleration: judged by their neighbours, by how samples usually are, and by the data sheet.

An outlier stands alone: both the samples before it and the parabola through those and the one that follows want it
elsewhere, to the same side. So a sample is judged when the next one has come. How far genuine samples are off that
parabola, a running mean square tells, with the peaks of the last moments; data sheet and Bayes' rule tell the rest: how
likely the sample is an outlier, how large that is to be expected, and how uncertain that leaves the acceleration. No
sample is thrown away outright, and with no outliers on the data sheet nothing is done. The newest sample is judged
against the parabola through the three before it, until its neighbour has come.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.estimators.height_filter_kernels import both_say, judge
from twin.signals import BoolArray, FloatArray

_USUAL_S = 2.0
"""Over which time it is learnt how far samples are off."""
_RECENT_S = 0.2
"""For how long a peak is remembered."""
_SHOCK, _SHAKING = 1e-5, 0.05
"""Probability of a true shock in a sample: as a rule (once in half an hour), and just after another sample that was
taken for an outlier, since these are alone; choices."""
_OFF_NOISE, _BEND_NOISE, _AHEAD_NOISE = 20.0 / 9.0, 14.0, 20.0
"""Variances of what is compared where samples are white noise of variance one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlierSheet:
    """Outliers as a data sheet has them."""

    probability: float
    """In one sample."""
    sigma: float
    """m/s^2."""

    @classmethod
    def of(cls, sheet: Mapping[str, float]) -> OutlierSheet:
        """Read a data sheet."""
        return cls(probability=sheet.get("outlier_probability", 0.0), sigma=sheet.get("outlier_sigma_m_s2", 0.0))


class _Usual:
    """How far genuine samples are off: a running mean square (R,), and a memory of recent peaks.

    What is far above the usual counts as nine times the usual: one outlier changes little, but where a machine begins
    to shake the third sample is believed.
    """

    def __init__(self, least: float, *, runs: int, step_s: float) -> None:
        self._least = least
        self._mean = np.full(runs, least)
        self._peak = np.zeros(runs)
        self._count = 0
        self._gain = step_s / _USUAL_S
        self._kept = math.exp(-step_s / _RECENT_S)

    def square(self) -> FloatArray:
        """(R,) mean square of what is usual now."""
        usual: FloatArray = np.maximum(np.maximum(self._mean, self._peak), self._least)
        return usual

    def learn(self, off: FloatArray, known: BoolArray) -> None:
        """Take one more, (R,), where it is known."""
        self._count += 1
        square = np.where(known, np.minimum(np.square(off), 9.0 * self.square()), self._mean)
        self._mean = self._mean + max(self._gain, 1.0 / self._count) * (square - self._mean)
        self._peak = np.maximum(square, self._peak * self._kept)


class OutlierJudge:
    """Expected outlier and remaining variance of the samples of R members, in order.

    Args:
        sheet: what the data sheet says of outliers.
        noise: of one sample, m/s^2.
        runs: R.
        step_s: time between samples.
    """

    def __init__(self, sheet: OutlierSheet, *, noise: float, runs: int, step_s: float) -> None:
        self._sheet = sheet
        self._off, self._bend, self._ahead = (
            _Usual(share * noise**2, runs=runs, step_s=step_s) for share in (_OFF_NOISE, _BEND_NOISE, _AHEAD_NOISE)
        )
        self._past: FloatArray = np.zeros((3, runs))
        self._suspected = np.zeros(runs)
        self._kept = math.exp(-step_s / _RECENT_S)
        self._count = 0
        self._idle = sheet.probability == 0.0 or sheet.sigma == 0.0
        self._nothing = np.zeros(runs)

    def settle(self, now: FloatArray, after: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
        """The outlier in a sample that another follows, (R,), and the variance that it leaves, (R,).

        Where not both are ``known`` (R,) there is none, and nothing is learnt.
        """
        if self._idle:
            return self._nothing, self._nothing
        before, second, third = self._past
        off = now - (before + (after - second) / 3.0)
        ahead = now - (3.0 * (before - second) + third)
        bend = after - (3.0 * before - 2.0 * second)
        # where the next one is unusually far off too, it is the motion that changes
        changed = np.where(np.square(bend) > 9.0 * self._bend.square(), np.square(bend), 0.0)
        usual = np.maximum(self._off.square(), changed)
        told = known & (self._count >= len(self._past))
        shock = _SHOCK + _SHAKING * self._suspected
        expected, variance, likely = self._judge(both_say(off, ahead), off, usual, shock) * told
        self._suspected = np.maximum(likely, self._kept * self._suspected)
        left = now - expected
        # learnt of the sample before, whose neighbours are both settled: an outlier must not speak for itself
        self._off.learn(before - (second + (left - third) / 3.0), told)
        self._bend.learn(bend, told)
        self._past = np.stack([left, before, second])
        self._count += 1
        return expected, variance

    def newest(self, now: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
        """The same of the newest sample, which none follows yet; it is not remembered."""
        if self._idle:
            return self._nothing, self._nothing
        before, second, third = self._past
        off = now - (3.0 * (before - second) + third)
        told = known & (self._count >= len(self._past))
        shock = _SHOCK + _SHAKING * self._suspected
        expected, variance, _ = self._judge(off, off, self._ahead.square(), shock) * told
        self._ahead.learn(off - expected, told)
        return expected, variance

    def _judge(self, evidence: FloatArray, off: FloatArray, usual: FloatArray, shock: FloatArray) -> FloatArray:
        return judge(evidence, off, usual, shock, self._sheet.probability, self._sheet.sigma**2)
