"""Hampel filters over the ensemble axis: single wild samples are replaced, causally, sample by sample.

**As published** (paper 002, eqs 1 to 3): with the mean m and the standard deviation s (divided by n = 3) of the three
samples before, a sample with |a - m| > 3 s is replaced by m. Eq 1 as printed compares a with |m +- 3 s|, which would
replace every sample of the wrong sign; the text and the filter's name leave no doubt. The three samples are the raw
ones. Of good white samples it throws away one in six: (a - m) / sqrt(4/3) over sqrt(3 s^2 / 2) is Student's t with two
degrees of freedom, and 3 s stands at 3 / sqrt(2) of it, so that

    P = 1 - t / sqrt(t^2 + 2) at t = 3 / sqrt(2):   16.8 %.

**Robust** (ours). Three things are different.

* The middle is the median of the three samples before, as they were given out, so that it follows a moving machine
  within two samples and no outlier gets into it.
* The scale is 1.4826 times the median of how far the last 25 raw samples lay from their own middles (the deviation of
  a normal error whose median modulus this is), and never less than what the sensor's own noise makes of it. It grows
  with motion and with vibration, and 0.5 s of one or two outliers do not move it. The limit is 4.5 scales: where the
  scale is the white noise's own, estimated, 0.1 % of the samples lie beyond it.
* A machine that starts moves the acceleration for good, an outlier for one sample. So what is withheld of a sample
  beyond the limit is given back with the next, if that lies nearer to it than to the middle: then both were motion, and
  the velocity, which is their sum, loses nothing.

On a machine that moves, eqs 1 to 3 do harm beyond the sixth: three samples of an acceleration that grows lie close
together, and the fourth, farther off than 3 s of them, is taken back to their mean. Its growth comes late, its decay
does not, so that velocity is lost with every stroke: on strokes of a hand of up to 0.4 m/s enough to make the height of
paper 002's filter three times as wrong, 40 mm with corrections at their best.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from twin.compiled import compiled
from twin.signals import BoolArray, FloatArray, IntArray

WINDOW = 3
"""Samples before the present one that both filters look at."""
_LIMIT = 3.0
"""Standard deviations, eq 1."""

_REMEMBERED = 25
_FEWEST = 5
"""Deviations without which there is no scale yet."""
_ROBUST_LIMIT = 4.5
_TO_SIGMA = 1.4826
"""From the median modulus of a normal error to its standard deviation."""
_OF_MIDDLE = math.sqrt(1.4487)
"""Standard deviation of the difference between a normal number and the median of three others."""


class OutlierFilter(Protocol):
    """Replaces outliers of R streams of samples."""

    @property
    def replaced(self) -> BoolArray:
        """(R,) whether the last sample was an outlier."""

    def step(self, sample: FloatArray, fresh: BoolArray) -> FloatArray:
        """The samples (R,) without outliers, where ``fresh`` (R,) says that there is one; others are as given."""


class PublishedHampel:
    """Eqs 1 to 3 of paper 002 for R streams."""

    def __init__(self, runs: int) -> None:
        self._before: FloatArray = np.zeros((WINDOW, runs))
        self._count: IntArray = np.zeros(runs, dtype=np.int64)
        self.replaced: BoolArray = np.zeros(runs, dtype=np.bool_)

    def step(self, sample: FloatArray, fresh: BoolArray) -> FloatArray:
        """The samples (R,), replaced where they lie beyond three standard deviations of the three before."""
        first, second, third = self._before
        mean = (first + second + third) / WINDOW
        variance = ((first - mean) ** 2 + (second - mean) ** 2 + (third - mean) ** 2) / WINDOW
        beyond = np.abs(sample - mean) > _LIMIT * np.sqrt(variance)
        self.replaced = fresh & beyond & (self._count >= WINDOW)
        self._before = np.where(fresh, np.stack([second, third, sample]), self._before)
        self._count = self._count + fresh
        return np.where(self.replaced, mean, sample)


class RobustHampel:
    """The robust filter for R streams.

    Args:
        noise: standard deviation of the sensor's own white noise in one sample, in the samples' unit.
        runs: R.
    """

    def __init__(self, *, noise: float, runs: int) -> None:
        self._floor = noise * _OF_MIDDLE
        self._before: FloatArray = np.zeros((runs, WINDOW))
        self._deviations: FloatArray = np.zeros((runs, _REMEMBERED))
        self._sorted: FloatArray = np.zeros((runs, _REMEMBERED))
        self._count: IntArray = np.zeros(runs, dtype=np.int64)
        self._withheld: FloatArray = np.zeros(runs)
        self.replaced: BoolArray = np.zeros(runs, dtype=np.bool_)

    def step(self, sample: FloatArray, fresh: BoolArray) -> FloatArray:
        """The samples (R,), the median of the three before where they are outliers."""
        given = np.array(sample, dtype=np.float64)
        _robust(
            given,
            fresh,
            self._floor,
            self._before,
            self._deviations,
            self._sorted,
            self._count,
            self._withheld,
            self.replaced,
        )
        return given


@compiled
def _robust(  # noqa: PLR0917 - plain loop, called by position
    given: FloatArray,
    fresh: BoolArray,
    floor: float,
    before: FloatArray,
    deviations: FloatArray,
    ordered: FloatArray,
    count: IntArray,
    withheld: FloatArray,
    replaced: BoolArray,
) -> None:
    """Take the samples in ``given`` and put there what is given out; everything changes in place."""
    for run in range(len(given)):
        replaced[run] = False
        if not fresh[run]:
            continue
        sample = passed = given[run]
        seen = count[run] - before.shape[1]
        if seen >= 0:
            a, b, c = before[run, 0], before[run, 1], before[run, 2]
            middle = max(min(a, b), min(max(a, b), c))
            deviation = sample - middle
            beyond = False
            if seen >= _FEWEST:
                scale = max(floor, _TO_SIGMA * _median(ordered[run], min(seen, ordered.shape[1])))
                beyond = abs(deviation) > _ROBUST_LIMIT * scale
            _remember(abs(deviation), seen, deviations[run], ordered[run])
            # The last of ``before`` is the middle that was given out where something was withheld.
            if withheld[run] != 0.0 and abs(sample - c - withheld[run]) < abs(sample - c):
                given[run] = sample + withheld[run]
                before[run, 2] = c + withheld[run]
                withheld[run] = 0.0
            elif beyond:
                replaced[run] = True
                given[run] = passed = middle
                withheld[run] = deviation
            else:
                withheld[run] = 0.0
        before[run, 0], before[run, 1], before[run, 2] = before[run, 1], before[run, 2], passed
        count[run] += 1


@compiled
def _median(ordered: FloatArray, count: int) -> float:
    """Median of ``count`` numbers in ascending order."""
    half = count // 2
    median: float = ordered[half] if count % 2 else 0.5 * (ordered[half - 1] + ordered[half])
    return median


@compiled
def _remember(value: float, seen: int, latest: FloatArray, ordered: FloatArray) -> None:
    """Put a number in the place of the oldest of ``latest``, of which ``seen`` came before, and keep them in order."""
    size = len(latest)
    place = min(seen, size - 1)
    if seen >= size:
        oldest = latest[seen % size]
        place = 0
        while ordered[place] != oldest:
            place += 1
    latest[seen % size] = value
    while place > 0 and ordered[place - 1] > value:
        ordered[place] = ordered[place - 1]
        place -= 1
    last = min(seen, size - 1)
    while place < last and ordered[place + 1] < value:
        ordered[place] = ordered[place + 1]
        place += 1
    ordered[place] = value
