"""How a machine moves between two rows of trees, and how an estimator knows it: the model of the row filter.

====== ==== =========================================================================================
place  n    state
====== ==== =========================================================================================
E      1    offset of the reference point from the lane's axis, left positive, m
PSI    1    heading against the axis, rad
RATE   1    rate by which the heading heard drifts from the true one, rad/s (what is left of a gyroscope's bias)
WE     1    offset of the fitted rows from the axis: the trees in sight do not stand quite in their rows, m
WPSI   1    their heading against it, rad
====== ==== =========================================================================================

Over a way d in which the heading heard turns by a:  E += d sin(PSI + a / 2),  PSI += a + RATE dt. What the trees in
sight are off by stays while the same trees are in sight: Gauss-Markov with the way, its variance the fit's own
``standing`` one. A mean over a window of length 2 L has the autocorrelation 1 - s / (2 L), whose integral is that of
exp(-s / L); a slope over the same window forgets sooner, L / 3 is a choice.
A scan's fit sees E + WE and PSI + WPSI.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from twin.estimators.heading_filter import HeadingFilter
from twin.estimators.heading_noise import HeadingNoiseConfig, Sheet
from twin.estimators.wheel_odometry import Odometer
from twin.geometry import turned
from twin.signals import NS_PER_S, YAW_RATE, BoolArray, FloatArray, Measurement, SensorInfo

E, PSI, RATE, WE, WPSI = range(5)
SIZE = 5
_SLOPE_SHARE = 1.0 / 3.0
_SWING_RAD = 0.1
"""A machine in a lane turns back what it turned: a scale error makes an angle error of no more than its swings. Taken
for white it has to be that of a swing of this size; a choice."""


class RowMotion:
    """Motion of the five states; the attributes are set before a prediction."""

    def __init__(self, *, memory_m: float, runs: int) -> None:
        self._memory_m = memory_m
        self.turn_variance: FloatArray = np.zeros(runs)
        """(R,) gathered by PSI in this step, rad^2."""
        self.offset_variance: FloatArray = np.zeros(runs)
        """(R,) gathered by E in this step, m^2."""
        self.rate_variance = 0.0
        """Gathered by RATE in this step, (rad/s)^2."""
        self.standing: FloatArray = np.zeros((runs, 2))
        """(R, 2) variances of WE and WPSI in the long run."""
        self.kept: FloatArray = np.ones((runs, 2))
        """(R, 2) what is left of WE and WPSI after this step."""

    def travel(self, way_m: FloatArray) -> None:
        """Forget the trees left behind on a way (R,)."""
        lengths = self._memory_m * np.array([1.0, _SLOPE_SHARE])
        self.kept = np.exp(-np.abs(way_m)[:, np.newaxis] / lengths)

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """State (R, 5) after a step in which the heading turned and the machine went as ``u`` (R, 2) says."""
        turned, way = u[:, 0], u[:, 1]
        middle = x[:, PSI] + 0.5 * (turned + x[:, RATE] * dt_s)
        moved = x.copy()
        moved[:, E] += way * np.sin(middle)
        moved[:, PSI] += turned + x[:, RATE] * dt_s
        moved[:, WE : WPSI + 1] *= self.kept
        F = np.tile(np.eye(SIZE), (len(x), 1, 1))
        F[:, E, PSI] = way * np.cos(middle)
        F[:, E, RATE] = 0.5 * dt_s * F[:, E, PSI]
        F[:, PSI, RATE] = dt_s
        F[:, WE, WE], F[:, WPSI, WPSI] = self.kept[:, 0], self.kept[:, 1]
        return moved, F

    def Q(self, dt_s: float) -> FloatArray:  # noqa: ARG002, N802
        """Process noise (R, 5, 5)."""
        Q = np.zeros((len(self.turn_variance), SIZE, SIZE))
        Q[:, E, E], Q[:, PSI, PSI], Q[:, RATE, RATE] = self.offset_variance, self.turn_variance, self.rate_variance
        renewed = self.standing * (1.0 - self.kept**2)
        Q[:, WE, WE], Q[:, WPSI, WPSI] = renewed[:, 0], renewed[:, 1]
        return Q


class RowsObserved:
    """A fit: E + WE and PSI + WPSI, taken apart into two numbers whose errors are independent and of variance 1."""

    def __init__(self, noise: FloatArray) -> None:
        self._whiten: FloatArray = np.linalg.inv(np.linalg.cholesky(noise))
        self._H: FloatArray = np.zeros((2, SIZE))
        self._H[0, [E, WE]] = self._H[1, [PSI, WPSI]] = 1.0
        self.R: FloatArray = np.ones(2)

    def whitened(self, z: FloatArray) -> FloatArray:
        """A fit's offset and heading (R, 2) as this observation."""
        return np.asarray(np.einsum("rij,rj->ri", self._whiten, z))

    def h(self, x: FloatArray) -> FloatArray:
        """Expected (R, 2)."""
        return self.whitened(x @ self._H.T)

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (R, 2, 5)."""
        return self._whiten @ self._H


class DeadReckoning(Protocol):
    """Who tells how the machine moved since it was asked last."""

    counts_way: bool

    def process(self, measurement: Measurement) -> None:
        """Take a measurement of any sensor."""

    def step(self, t_ns: int, dt_s: float, motion: RowMotion) -> tuple[FloatArray, FloatArray]:
        """Heading turned (R,) and way made (R,) until ``t_ns``; writes what they may be off by into ``motion``."""

    def resting(self) -> tuple[BoolArray, FloatArray]:
        """Members (R,) that rest and learn their drift from it, and its variance then (R,)."""


class Unknown:
    """Nobody knows how the machine moves: it may turn and move to the side as it likes, from scan to scan."""

    counts_way = False

    def __init__(self, *, turn_rad_rts: float, side_m_rts: float, runs: int) -> None:
        self._turn, self._side, self._runs = turn_rad_rts**2, side_m_rts**2, runs

    def process(self, measurement: Measurement) -> None:
        """Nothing says how it moves."""

    def step(self, t_ns: int, dt_s: float, motion: RowMotion) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Zero, and wide variances; no tree is known from the scan before."""
        motion.turn_variance = np.full(self._runs, self._turn * dt_s)
        motion.offset_variance = np.full(self._runs, self._side * dt_s)
        motion.kept = np.zeros((self._runs, 2))
        return np.zeros(self._runs), np.zeros(self._runs)

    def resting(self) -> tuple[BoolArray, FloatArray]:
        """Nobody knows."""
        return np.zeros(self._runs, dtype=np.bool_), np.zeros(self._runs)


class HeadingAndWheels:
    """The turns of the gyroscope as the heading filter levels it and takes its bias off, and the wheels' way.

    Not the differences of its heading: that jumps when the filter learns what it held for a turn was bias.
    """

    counts_way = True

    def __init__(
        self,
        heading: HeadingFilter,
        odometer: Odometer,
        *,
        imu: SensorInfo,
        encoders: SensorInfo,
        noise: HeadingNoiseConfig,
        sideslip_m_rtm: float,
        runs: int,
    ) -> None:
        self._heading, self._odometer, self._encoders = heading, odometer, encoders.name
        self._sheet = Sheet.of(imu, None, noise)
        self._sample_s = 1.0 / imu.rate_hz
        self._sideslip = sideslip_m_rtm**2
        self._way: FloatArray = np.zeros(runs)
        self._runs = runs
        columns = heading.columns
        self._places = [columns.index(name) for name in (YAW_RATE, "resting", "gyro_bias_z_rad_s")]
        self._resting: BoolArray = np.zeros(runs, dtype=np.bool_)
        self._bias_variance: FloatArray = np.full(runs, self._sheet.bias**2)

    @property
    def drift_variance(self) -> float:
        """Of the rate left over before anything was learnt."""
        return float(self._sheet.bias**2)

    def process(self, measurement: Measurement) -> None:
        """Hand on to the heading filter; count slots."""
        self._heading.process(measurement)
        if measurement.sensor == self._encoders:
            slots = measurement.values
            counted = measurement.valid & np.isfinite(slots).all(axis=1)
            _, way = self._odometer.step(np.where(counted[:, np.newaxis], slots, 0.0), counted)
            self._way = self._way + way

    def step(self, t_ns: int, dt_s: float, motion: RowMotion) -> tuple[FloatArray, FloatArray]:
        """Turn and way since the last step."""
        estimate = self._heading.estimate(t_ns)
        rate, resting, _ = (estimate.values[:, place] for place in self._places)
        bias_sigma = estimate.sigmas[:, self._places[2]]
        turned = dt_s * rate
        way, self._way = self._way, np.zeros(self._runs)
        self._resting, self._bias_variance = resting > 0.5, bias_sigma**2
        sheet = self._sheet
        moving = np.where(self._resting, 0.0, 1.0)
        heard = sheet.gyro**2 * self._sample_s * dt_s
        motion.turn_variance = moving * heard + sheet.scale**2 * np.abs(turned) * _SWING_RAD
        motion.offset_variance = self._sideslip * np.abs(way)
        motion.rate_variance = sheet.bias_walk**2 * dt_s
        motion.travel(way)
        return turned, way

    def resting(self) -> tuple[BoolArray, FloatArray]:
        """What the heading filter does not know of its bias at rest is where the drift begins."""
        return self._resting, self._bias_variance


class Track:
    """Where the machine was lately, by dead reckoning, in a frame of its own."""

    def __init__(self, *, runs: int, kept_s: float) -> None:
        self._kept_ns = round(kept_s * NS_PER_S)
        self._times: list[int] = []
        self._poses: list[FloatArray] = []
        self._pose: FloatArray = np.zeros((runs, 3))

    def add(self, t_ns: int, turned: FloatArray, way: FloatArray) -> None:
        """Move on by a turn and a way (R,)."""
        x, y, heading = self._pose.T
        middle = heading + 0.5 * turned
        self._pose = np.stack([x + way * np.cos(middle), y + way * np.sin(middle), heading + turned], axis=-1)
        self._times.append(t_ns)
        self._poses.append(self._pose)
        while len(self._times) > 2 and self._times[1] < t_ns - self._kept_ns:
            del self._times[0], self._poses[0]

    def seen_from_now(self, t_ns: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (R, M) seen from the machine's frame at times ``t_ns`` (R, M), in its frame now."""
        times, poses = np.array(self._times, dtype=np.float64), np.array(self._poses)
        if len(times) < 2:
            return x, y
        later = np.clip(np.searchsorted(times, t_ns), 1, len(times) - 1)
        share = np.clip((t_ns - times[later - 1]) / (times[later] - times[later - 1]), 0.0, 1.0)[..., np.newaxis]
        members = np.arange(len(x))[:, np.newaxis]
        then = (1.0 - share) * poses[later - 1, members] + share * poses[later, members]  # (R, M, 3)
        now = self._pose[:, np.newaxis, :]
        east, north = turned(x, y, then[..., 2])
        east, north = then[..., 0] + east - now[..., 0], then[..., 1] + north - now[..., 1]
        return turned(east, north, -now[..., 2])
