"""Several inertial units on one rigid body as one: weighted by how they behave, each known against the others.

Every unit's reading, in body axes and moved to the reference point, is the body's motion plus the unit's own bias and
noise. The fused reading is the weighted mean of (reading - d), where d is the unit's slow difference from the fused
reading, so that leaving a unit out does not shift the bias of the fused one. Two things take a unit's weight:

* **It repeats itself.** A live sensor is noisy: so many readings in a row that are equal in every axis of a triad mean
  that the triad is stuck, and it gets no weight until it moves again.
* **It disagrees.** The variance of its residual (reading - d - fused), low-passed, beyond what its data sheet leaves
  takes the place of the data sheet's in its weight: a unit with ten times the noise weighs a hundredth.

Accelerometers and gyroscopes are judged apart. Moving a specific force from a unit at r to the reference takes
f - w' x r - w x (w x r); w' is the difference of two fused rates over the step, whose noise telescopes in the velocity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.estimators.ins_model import cross
from twin.signals import BoolArray, FloatArray

ACCEL, GYRO = slice(0, 3), slice(3, 6)
_TRIADS = (ACCEL, GYRO)
_UNKNOWN = np.array([3.0, 0.3])
"""What is assumed of a body without any live accelerometer (m/s^2) or gyroscope (rad/s): it accelerates and turns, who
knows how."""
_FORGOTTEN_S = 0.5
"""Time without a live sample after which that is so; sooner, the last one still says something."""

_SUSPICIOUS = 4.0
"""Energy of a residual, times what noise and scale errors leave of it, from which on a unit is believed less."""
_SETTLED = 25
"""Samples after which a unit's difference from the others is known well enough to judge it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fused:
    """One inertial sample of the body, for R members."""

    u: FloatArray
    """(R, 6) specific force and angular rate at the reference point."""
    accel_variance: FloatArray
    """(R,)."""
    gyro_variance: FloatArray
    """(R,)."""


class InertialArray:
    """Fuses the units' samples tick by tick (R members, k units).

    Args:
        arms_m: (k, 3) places of the units in body axes, from the reference point.
        accel_noise: (k,) noise of one sample by the data sheet, m/s^2.
        gyro_noise: (k,) the same, rad/s.
        gyro_response: (k,) scale and cross-axis errors by the data sheet: share of the rate that a unit may add.
        step_s: time between samples.
        runs: R.
        watch: judge the units; without it all weigh by their data sheets for good.
        stuck_after: equal readings in a row that mean a triad is stuck.
    """

    def __init__(
        self,
        *,
        arms_m: FloatArray,
        accel_noise: Sequence[float],
        gyro_noise: Sequence[float],
        gyro_response: Sequence[float],
        step_s: float,
        runs: int,
        watch: bool = True,
        stuck_after: int = 5,
        residual_s: float = 0.5,
        difference_s: float = 20.0,
    ) -> None:
        count = len(arms_m)
        self._arms = arms_m
        self._sheet = np.stack([np.square(accel_noise), np.square(gyro_noise)], axis=-1)[:, np.newaxis, :]
        self._sheet = np.maximum(self._sheet, 1e-12)
        self._response = np.square(gyro_response)[:, np.newaxis]
        self._step_s = step_s
        self._watch = watch
        self._stuck_after = stuck_after
        self._residual_gain = min(1.0, step_s / residual_s)
        self._difference_samples = difference_s / step_s
        self._seen = np.zeros((count, runs))
        self._difference = np.zeros((count, runs, 6))
        self._energy = np.repeat(self._sheet, runs, axis=1)
        self._equal = np.zeros((count, runs, 2))
        self._last = np.full((count, runs, 6), np.nan)
        self._last_rate: FloatArray | None = None
        self._turning_variance = np.zeros(runs)
        self._held = np.zeros((runs, 6))
        self._held_variance = np.repeat(np.square(_UNKNOWN)[np.newaxis], runs, axis=0)
        self._silent_s = np.full((runs, 2), _FORGOTTEN_S)
        self.weights: FloatArray = np.full((count, runs, 2), 1.0 / count)
        """(k, R, 2) share of each unit's accelerometers and gyroscopes in the last fused sample."""

    def fuse(self, readings: FloatArray, present: BoolArray, steps: int = 1) -> Fused:
        """One tick: ``readings`` (k, R, 6) in body axes, ``present`` (k, R) where a unit answered; ``steps`` since the
        last one."""
        live = np.repeat(present[..., np.newaxis], 2, axis=2)
        readings = np.where(present[..., np.newaxis], readings, 0.0)
        variances = np.broadcast_to(self._sheet, live.shape)
        if self._watch:
            live = live & ~self._stuck(readings, present)
            variances = np.where(self._energy > self._suspicious(), self._energy, variances)
        raw = np.where(live, 1.0 / variances, 0.0)
        total = raw.sum(axis=0)
        known = total > 0.0
        self.weights = raw / np.where(known, total, 1.0)
        sample = 1.0 / np.where(known, total, 1.0)
        u = np.empty_like(self._held)
        gyro = readings[..., GYRO] - self._difference[..., GYRO]
        u[:, GYRO] = np.where(known[:, 1:2], (self.weights[..., 1:2] * gyro).sum(axis=0), self._held[:, GYRO])
        transported = readings.copy()
        transported[..., ACCEL] -= self._lever_terms(u[:, GYRO], steps * self._step_s)
        force = transported[..., ACCEL] - self._difference[..., ACCEL]
        u[:, ACCEL] = (self.weights[..., 0:1] * force).sum(axis=0)
        u[:, ACCEL] = np.where(known[:, 0:1], u[:, ACCEL], self._held[:, ACCEL])
        self._turning_variance = 2.0 * sample[:, 1] / (steps * self._step_s) ** 2
        if self._watch:
            self._learn(transported, live, u)
        self._held = u
        variance = self._variance(sample, known, steps)
        return Fused(u=u, accel_variance=variance[:, 0], gyro_variance=variance[:, 1])

    def _variance(self, sample: FloatArray, known: BoolArray, steps: int) -> FloatArray:
        """Variance (R, 2) of the fused sample over the time since the last: what was not heard is known less and less.

        ``sample`` (R, 2) is that of the live units' mean, where there are any (``known``).
        """
        gap_s = (steps - 1) * self._step_s
        silent_s = np.where(known, gap_s, self._silent_s + gap_s + self._step_s)
        self._silent_s = np.where(known, 0.0, silent_s)
        self._held_variance = np.where(known, sample, self._held_variance)
        variance: FloatArray = self._held_variance + np.square(_UNKNOWN * np.minimum(1.0, silent_s / _FORGOTTEN_S))
        return variance

    def _lever_terms(self, rate: FloatArray, dt_s: float) -> FloatArray:
        """Acceleration of every unit against the reference, dw/dt x r + w x (w x r), (k, R, 3)."""
        turning = np.zeros_like(rate) if self._last_rate is None else (rate - self._last_rate) / dt_s
        self._last_rate = rate
        return np.stack([cross(turning, arm) + cross(rate, cross(rate, arm)) for arm in self._arms])

    def _suspicious(self) -> FloatArray:
        """Energy of a residual (k, R, 2) from which on a unit is believed less.

        Beside its own noise a force has that of the turning w' it was moved with, |w' x r|^2 / 3 an axis.
        """
        expected = np.repeat(self._sheet, len(self._held), axis=1)
        expected[..., 0] += 2.0 / 3.0 * np.square(self._arms).sum(axis=1)[:, np.newaxis] * self._turning_variance
        expected[..., 1] += self._response * np.square(self._held[:, 5])
        return _SUSPICIOUS * expected

    def _stuck(self, readings: FloatArray, present: BoolArray) -> BoolArray:
        same = np.stack([(readings[..., triad] == self._last[..., triad]).all(axis=2) for triad in _TRIADS], axis=2)
        counted = present[..., np.newaxis]
        self._equal = np.where(counted, np.where(same, self._equal + 1.0, 0.0), self._equal)
        self._last = np.where(counted, readings, self._last)
        stuck: BoolArray = self._equal >= self._stuck_after - 1
        return stuck

    def _learn(self, transported: FloatArray, live: BoolArray, fused: FloatArray) -> None:
        """Follow each unit's difference from the fused sample, and the energy of what is left of it."""
        if len(self._arms) < 2:
            return
        from_fused = transported - fused
        left = from_fused - self._difference
        self._seen = np.where(live.all(axis=2), self._seen + 1.0, self._seen)
        gain = 1.0 / np.clip(self._seen, 1.0, self._difference_samples)
        trusted = live & (self._energy <= self._suspicious())
        settled = self._seen > _SETTLED
        for place, triad in enumerate(_TRIADS):
            step = np.where(trusted[..., place], gain, 0.0)[..., np.newaxis]
            self._difference[..., triad] += step * left[..., triad]
            energy = np.square(left[..., triad]).mean(axis=2)
            follows = np.where(live[..., place] & settled, self._residual_gain, 0.0)
            self._energy[..., place] += follows * (energy - self._energy[..., place])
