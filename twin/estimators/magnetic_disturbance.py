"""Tells a disturbed magnetic field from the earth's, for every member of an ensemble.

Three signs: the field's **strength** and its **dip** against those of the place, and its **heading** against what the
gyroscope carried on (the innovation of the filter, averaged over a short window). A magnet beside the robot can leave
any one of them alone: one that pushes the horizontal field sideways by 15 deg changes strength by 0.6 % and dip by
0.8 deg where the dip is 65 deg; only the gyroscope tells.

States of a member, and what leads from one to the next::

    LEARNING ----- as many samples as the reference needs -----> CLEAN
    CLEAN -------- strength, dip or heading is off ------------> DISTURBED
    DISTURBED ---- all three are right ------------------------> RECOVERING
    RECOVERING --- one is off again ---------------------------> DISTURBED
    RECOVERING --- all right for ``recovery_s`` ---------------> CLEAN
    DISTURBED ---- another strength and dip, steady while the
                   machine turned for ``new_place_s`` ---------> CLEAN, with the new reference

Only CLEAN samples are used. A field that is steady while the machine stands proves nothing (a magnet held still is as
steady), so only time in which it turns counts towards a new reference. The limits of strength, dip and times are those
that Laidig and Seel give for VQF (*Information Fusion* 91, 2023): 10 %, 10 deg, 0.5 s, 20 s, turning at 20 deg/s.
"""

from __future__ import annotations

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.signals import BoolArray, FloatArray

LEARNING, CLEAN, DISTURBED, RECOVERING = range(4)


class DisturbanceConfig(Config):
    """When a magnetic field counts as disturbed."""

    enabled: bool = True
    strength_ratio: Positive = 0.1
    """Largest deviation of the strength, of that of the place."""
    dip_rad: Positive = float(np.deg2rad(10.0))
    """Largest deviation of the dip."""
    heading_sigmas: Positive = 3.0
    """Largest innovation of the heading, in its standard deviations."""
    window_s: Positive = 0.25
    """Over which strength, dip and innovation are averaged (exponentially)."""
    recovery_s: NonNegative = 0.5
    """How long all must be right before a member trusts the field again."""
    learning_s: NonNegative = 1.0
    """First seconds whose mean strength and dip are taken for those of the place, unless given."""
    new_place_s: Positive = 20.0
    """Time of steady field while turning after which it becomes the reference."""
    new_place_rate_rad_s: NonNegative = float(np.deg2rad(20.0))
    """What counts as turning."""
    strength_ut: Positive | None = None
    """Strength of the earth's field at the place, if its owner looked it up."""
    dip_of_place_rad: float | None = None
    """Its dip, positive below the horizon."""


class DisturbanceDetector:
    """The states of R members. Strengths in microtesla, angles in rad."""

    def __init__(self, config: DisturbanceConfig, *, runs: int) -> None:
        self._config = config
        self.strength: FloatArray = np.full(runs, np.nan)
        """(R,) of the place; NaN while it is learnt."""
        self.dip: FloatArray = np.full(runs, np.nan)
        """(R,) of the place; NaN while it is learnt."""
        known = config.strength_ut is not None and config.dip_of_place_rad is not None
        if known:
            self.strength[:] = config.strength_ut
            self.dip[:] = config.dip_of_place_rad
        self.state = np.full(runs, CLEAN if known else LEARNING)
        """(R,) one of the four states."""
        self._learnt_s = np.zeros(runs)
        self._learnt = np.zeros((2, runs))
        self._mean: FloatArray | None = None
        self._heading: FloatArray = np.zeros(runs)
        self._right_s = np.zeros(runs)
        self._steady_s = np.zeros(runs)
        self._other = np.full((2, runs), np.nan)

    def step(
        self,
        strength: FloatArray,
        dip: FloatArray,
        *,
        innovation: FloatArray,
        expected: FloatArray,
        sample_variance: FloatArray,
        turning: FloatArray,
        fresh: BoolArray,
        dt_s: float,
    ) -> tuple[BoolArray, BoolArray]:
        """Take a sample; return where it may be used, (R,), and where a new reference was adopted, (R,).

        ``innovation`` is the field's heading minus the filter's, ``expected`` the variance of the filter's part of it,
        ``sample_variance`` that of one sample's white noise, ``turning`` the rate at which the body turns, all (R,).
        """
        config = self._config
        self._learn(strength, dip, fresh, dt_s)
        if not config.enabled:
            return fresh.copy(), np.zeros_like(fresh)
        weight = dt_s / (config.window_s + dt_s)
        mean = np.stack([strength, dip])
        before = mean if self._mean is None else self._mean
        self._mean = np.where(fresh, before + weight * (mean - before), before)
        self._heading = np.where(fresh, self._heading + weight * (innovation - self._heading), self._heading)
        # White noise of variance v through this mean leaves v weight / (2 - weight).
        limit = config.heading_sigmas * np.sqrt(expected + sample_variance * weight / (2.0 - weight))
        right = self._like(self._mean, np.stack([self.strength, self.dip]), 1.0) & (np.abs(self._heading) <= limit)
        adopted = self._look_for_new_place(turning, fresh, dt_s)
        self._move_on(right, fresh, dt_s)
        self.state = np.where(adopted, CLEAN, self.state)
        return fresh & (self.state == CLEAN), adopted

    def forget_heading(self, members: BoolArray) -> None:
        """The filter's heading was set anew in these members: the mean innovation begins at zero."""
        self._heading = np.where(members, 0.0, self._heading)

    def _learn(self, strength: FloatArray, dip: FloatArray, fresh: BoolArray, dt_s: float) -> None:
        learning = fresh & (self.state == LEARNING)
        if not learning.any():
            return
        self._learnt_s = self._learnt_s + np.where(learning, dt_s, 0.0)
        self._learnt = self._learnt + np.where(learning, dt_s, 0.0) * np.stack([strength, dip])
        done = learning & (self._learnt_s >= self._config.learning_s)
        means = self._learnt / np.maximum(self._learnt_s, 1e-9)
        self.strength, self.dip = np.where(done, means[0], self.strength), np.where(done, means[1], self.dip)
        self.state = np.where(done, CLEAN, self.state)

    def _like(self, mean: FloatArray, reference: FloatArray, part: float) -> BoolArray:
        """Whether mean strength and dip (2, R) are within ``part`` of the limits of a reference (2, R)."""
        config = self._config
        near = np.abs(mean[0] - reference[0]) <= part * config.strength_ratio * reference[0]
        return np.asarray(near & (np.abs(mean[1] - reference[1]) <= part * config.dip_rad))

    def _move_on(self, right: BoolArray, fresh: BoolArray, dt_s: float) -> None:
        known = fresh & (self.state != LEARNING)
        self._right_s = np.where(known, np.where(right, self._right_s + dt_s, 0.0), self._right_s)
        trusted = (self.state == CLEAN) | (self._right_s > self._config.recovery_s)
        after = np.where(right, np.where(trusted, CLEAN, RECOVERING), DISTURBED)
        self.state = np.where(known, after, self.state)

    def _look_for_new_place(self, turning: FloatArray, fresh: BoolArray, dt_s: float) -> BoolArray:
        """Follow the field of disturbed members slowly; adopt it where it has stayed alike while they turned."""
        assert self._mean is not None
        config = self._config
        looking = fresh & (self.state == DISTURBED)
        unlike = looking & ~self._like(self._mean, self._other, 0.5)  # NaN is unlike
        self._other = np.where(unlike, self._mean, self._other)
        self._steady_s = np.where(
            unlike | ~((self.state == DISTURBED) | (self.state == RECOVERING)), 0.0, self._steady_s
        )
        counts = looking & ~unlike & (turning >= config.new_place_rate_rad_s)
        self._steady_s = self._steady_s + np.where(counts, dt_s, 0.0)
        adopted = self._steady_s >= config.new_place_s
        self.strength = np.where(adopted, self._other[0], self.strength)
        self.dip = np.where(adopted, self._other[1], self.dip)
        self._steady_s = np.where(adopted, 0.0, self._steady_s)
        return np.asarray(adopted)
