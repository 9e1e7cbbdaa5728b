"""What a position filter without other sensors takes from its receiver, and how it starts from the standing mean.

**Start** (paper 004, eqs 7 to 9). The start epoch is the last fix before the vehicle moves. The position there is the
mean of the fixes before it, its covariance the sum of theirs over N^2, the velocity zero and certain. That the vehicle
moves is seen from the receiver's speed, or set by time. A vehicle that never stood starts at its first fix, with a
velocity nobody knows. ``longest_s`` bounds the mean: errors of minutes' memory do not average out, and where the mean
of twenty minutes differs from the fixes of the last seconds, by metres, it is those that the track begins at.

A fix is used once and in order: what is repeated, or older than the last one used, is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import BadInputError
from twin.estimators.roles import GNSS, SPEED_COLUMN, Places, column_places, mount_arm
from twin.signals import NS_PER_S, POSITION, BoolArray, EstimatorSetup, FloatArray, IntArray, Measurement, SensorInfo

NEVER = np.iinfo(np.int64).min
_LEAST_MOVING_M_S = 0.2
_NOISES = 4.0
"""Speeds of a standing receiver beyond so many standard deviations of its noise are rare (1 in 3000, two axes)."""
_SMALLEST_NOISE_M = 1e-3
_NOISE_FIXES = 10.0
"""Fixes over which the short-term noise is averaged; at first, of those there are."""
_OPTIONAL = (SPEED_COLUMN, "course_rad", "hdop", "vdop", "quality", "sigma_e_m", "sigma_n_m")


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """One fix of the receiver for R members."""

    t_ns: int
    position: FloatArray
    """(R, 3); up is 0 for a receiver that gives none."""
    new: BoolArray
    """(R,) where there is one, and it is newer than the last."""
    told: dict[str, FloatArray]
    """(R,) of each further column the receiver has, NaN where it says nothing."""

    def of(self, column: str) -> FloatArray:
        """A further column, NaN where the receiver has none such."""
        told = self.told.get(column)
        return np.full(len(self.new), np.nan) if told is None else told


class Receiver:
    """Reads the one receiver of a setup.

    Raises:
        BadInputError: not exactly one GNSS receiver, or one that gives no position.
    """

    def __init__(self, setup: EstimatorSetup, *, estimator: str) -> None:
        receivers = [info for info in setup.sensors.values() if info.kind == GNSS]
        if len(receivers) != 1:
            raise BadInputError(
                f"[estimators.{setup.name}] sensors = {list(setup.sensors)}: {estimator} needs exactly one sensor of "
                f"kind {GNSS!r}"
            )
        self.info: SensorInfo = receivers[0]
        self.name = self.info.name
        self.arm = mount_arm(self.info, setup)
        """Antenna in the reference frame: metres forward, to the left, up."""
        self.gives_up = POSITION[2] in self.info.columns
        self._position: Places = column_places(self.info, POSITION[: 3 if self.gives_up else 2], setup=setup)
        self._told = {name: self.info.columns.index(name) for name in _OPTIONAL if name in self.info.columns}
        self.tells_velocity = {SPEED_COLUMN, "course_rad"} <= set(self.info.columns)
        self._newest: IntArray = np.full(setup.runs, NEVER)
        noise = self.info.datasheet.get("speed_noise_m_s", 0.0)
        self.moving_m_s = max(_LEAST_MOVING_M_S, _NOISES * noise)
        """Speed beyond which the vehicle is said to move."""

    def read(self, measurement: Measurement) -> Fix:
        """Take a sample; a clock that runs ahead of its arrival is held there."""
        t_ns = min(measurement.t_ns, measurement.t_available_ns)
        position = np.zeros((len(measurement.valid), 3))
        position[:, : 3 if self.gives_up else 2] = measurement.values[:, self._position]
        told = {name: measurement.values[:, place] for name, place in self._told.items()}
        new = np.isfinite(position).all(axis=1) & measurement.valid & (t_ns > self._newest)
        if "quality" in told:
            new = new & (told["quality"] != 0.0)
        self._newest = np.where(new, t_ns, self._newest)
        return Fix(t_ns=t_ns, position=position, new=new, told=told)


class ShortTermNoise:
    """How much positions err from one fix to the next, from fixes of a standing vehicle: half the mean square of their
    differences. It is what tells the models apart, unlike the metres that they err together. Arrays are (R,).
    """

    def __init__(self, *, fallback_m: float, least_m: float, runs: int) -> None:
        self._fallback, self._least = fallback_m**2, max(least_m, _SMALLEST_NOISE_M) ** 2
        self._last = np.full((runs, 2), np.nan)
        self._count = np.zeros(runs)
        self._variance = np.zeros(runs)

    def take(self, fix: Fix, standing: BoolArray) -> None:
        """Look at a fix, of members that stand."""
        used = standing & fix.new
        if not used.any():
            return
        half_square = 0.25 * ((fix.position[:, :2] - self._last) ** 2).sum(axis=1)
        compared = used & np.isfinite(half_square)
        self._count = self._count + compared
        # 1 / n until the memory is full, then 1 / memory: twenty minutes may pass before it moves
        share = 1.0 / np.clip(self._count, 1.0, 10.0 * _NOISE_FIXES)
        self._variance = np.where(compared, self._variance + share * (half_square - self._variance), self._variance)
        self._last = np.where(used[:, np.newaxis], fix.position[:, :2], self._last)

    @property
    def variance(self) -> FloatArray:
        """Of one coordinate, m^2; the fallback until there were enough fixes."""
        return np.where(self._count >= _NOISE_FIXES, np.maximum(self._variance, self._least), self._fallback)


class StandingStart:
    """Where members start from, and when. Arrays are (R, ...)."""

    def __init__(
        self, *, runs: int, moving_m_s: float, start_s: float | None = None, longest_fixes: float = np.inf
    ) -> None:
        self._moving_m_s = moving_m_s
        self._start_ns = None if start_s is None else round(start_s * NS_PER_S)
        self._longest = longest_fixes
        self.started: BoolArray = np.zeros(runs, dtype=np.bool_)
        self.count: FloatArray = np.zeros(runs)
        """N, fixes in the mean."""
        self.t_ns: IntArray = np.full(runs, NEVER)
        """Of the last fix before it moved, or the first where it never stood."""
        self.mean: FloatArray = np.full((runs, 3), np.nan)
        """x0 of eq 7."""
        self.covariance: FloatArray = np.zeros((runs, 3))
        """Diagonal of C_nn,0, eq 9."""
        self._variance = np.zeros((runs, 3))
        self._pending = np.full((runs, 3), np.nan)
        self._pending_variance = np.zeros((runs, 3))

    def take(self, fix: Fix, variances: FloatArray) -> BoolArray:
        """Take a fix with its variances (R, 3) and return where the vehicle moves now for the first time, (R,)."""
        waiting = fix.new & ~self.started
        if not waiting.any():
            return waiting
        if self._start_ns is not None:
            moving = waiting & (fix.t_ns >= self._start_ns)
        else:
            speed = fix.of(SPEED_COLUMN)
            moving = waiting & ~(speed <= self._moving_m_s)  # a receiver that tells no speed may be moving
        standing = waiting & ~moving
        first = standing & (self.t_ns == NEVER)
        self._average(standing & ~first, self._pending, self._pending_variance)
        self._pending = np.where(standing[:, np.newaxis], fix.position, self._pending)
        self._pending_variance = np.where(standing[:, np.newaxis], variances, self._pending_variance)
        self.t_ns = np.where(standing, fix.t_ns, self.t_ns)
        self._begin(moving, fix, variances)
        return moving

    @property
    def stood(self) -> BoolArray:
        """Whether the vehicle was seen standing, (R,)."""
        return self.count > 0.0

    @property
    def position(self) -> FloatArray:
        """Mean so far, or the first fix while there is but one, (R, 3)."""
        return np.where(np.isfinite(self.mean), self.mean, self._pending)

    def _average(self, which: BoolArray, position: FloatArray, variances: FloatArray) -> None:
        """Put a fix into the mean."""
        here = which[:, np.newaxis]
        self.count = np.where(which, np.minimum(self.count + 1.0, self._longest), self.count)
        share = (1.0 / np.maximum(self.count, 1.0))[:, np.newaxis]
        known = np.isfinite(self.mean)
        mean = np.where(known, self.mean + share * (position - self.mean), position)
        self.mean = np.where(here, mean, self.mean)
        self._variance = np.where(here, self._variance + share * (variances - self._variance), self._variance)
        self.covariance = np.where(here, share * self._variance, self.covariance)

    def _begin(self, moving: BoolArray, fix: Fix, variances: FloatArray) -> None:
        alone = moving & ~self.stood
        seen = alone & (self.t_ns != NEVER)  # one standing fix is all there is
        self._average(seen, self._pending, self._pending_variance)
        never = (alone & ~seen)[:, np.newaxis]
        self.mean = np.where(never, fix.position, self.mean)
        self.covariance = np.where(never, variances, self.covariance)
        self.t_ns = np.where(never[:, 0], fix.t_ns, self.t_ns)
        self.started = self.started | moving
