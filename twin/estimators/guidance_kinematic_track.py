"""One Kalman filter of paper 004, eqs 1 and 2: members at times of their own, each by its model.

Prediction and update are the house's engines'; the update there is Joseph's form, for this gain the same numbers as
(I - G A) C of eq 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.estimators.engines import EngineName, innovation, make_engine
from twin.estimators.guidance_kinematic_kernels import moved_axes
from twin.estimators.guidance_kinematic_models import (
    A_,
    AXES,
    P_,
    STATES,
    V_,
    KinematicMotion,
    PositionSeen,
    ProcessNoise,
)
from twin.estimators.guidance_kinematic_receiver import NEVER
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray

_NO_INPUT: FloatArray = np.empty(0)


@dataclass(frozen=True, slots=True, eq=False)
class Surprise:
    """Innovation of a fix: ``y`` (R, 3), measured minus expected, and its variances ``s`` (R, 3)."""

    y: FloatArray
    s: FloatArray

    @property
    def nis(self) -> FloatArray:
        """Of east and north, (R,): chi-square with two degrees of freedom if the filter is right about itself."""
        nis: FloatArray = (self.y[:, :2] ** 2 / self.s[:, :2]).sum(axis=1)
        return nis

    @property
    def log_likelihood(self) -> FloatArray:
        """Of east and north, but for a constant, (R,)."""
        said: FloatArray = -0.5 * (self.nis + np.log(self.s[:, :2]).sum(axis=1))
        return said


class KinematicTrack:
    """Position, velocity and acceleration of the antenna (R, 9), and the covariance (R, 9, 9)."""

    def __init__(self, noise: ProcessNoise, *, acceleration_variance: float, engine: EngineName, runs: int) -> None:
        self._phantom = noise.phantom
        self._acceleration_variance = acceleration_variance
        self._motion = KinematicMotion(noise, runs)
        self._seen = PositionSeen()
        self._engine = make_engine(engine, np.zeros((runs, STATES)), np.zeros((runs, STATES, STATES)))
        self.t_ns: IntArray = np.full(runs, NEVER)
        """Of the last fix used, (R,)."""

    @property
    def x(self) -> FloatArray:
        """State at the last fix, (R, 9)."""
        return self._engine.x

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Its covariance, (R, 9, 9)."""
        return self._engine.P

    @property
    def curved(self) -> BoolArray:
        """Whether acceleration is constant, not zero, (R,)."""
        return self._motion.curved

    def start(
        self,
        which: BoolArray,
        *,
        position: FloatArray,
        variances: FloatArray,
        speed_variance: FloatArray,
        t_ns: IntArray,
        curved: BoolArray,
        acceleration_variance: float,
    ) -> None:
        """Start members at a position (R, 3) with velocity and acceleration of zero (eqs 7 and 8)."""
        x, P = np.zeros((len(which), STATES)), np.zeros((len(which), STATES, STATES))
        x[:, P_] = position
        for axis in range(AXES):
            P[:, axis, axis] = variances[:, axis]
            P[:, V_.start + axis, V_.start + axis] = speed_variance
            P[:, A_.start + axis, A_.start + axis] = np.where(curved, acceleration_variance, 0.0)
        self._put(which, x, P)
        self.t_ns = np.where(which, t_ns, self.t_ns)
        self._motion.curved = np.where(which, curved, self._motion.curved)

    def adopt(self, which: BoolArray, other: KinematicTrack) -> None:
        """Go on, in some members, from where another filter is and by its model."""
        self._put(which, other.x, other.P)
        self.t_ns = np.where(which, other.t_ns, self.t_ns)
        self._motion.curved = np.where(which, other.curved, self._motion.curved)

    def change_model(self, curved: BoolArray) -> None:
        """Hand state and covariance over to the model that is to hold, (R,).

        Into a curve: an acceleration of zero that may be anything a bend gives. The printed covariance, which is that
        of a sound filter less its phantom (:mod:`twin.estimators.guidance_kinematic_models`), gets it back: a model
        that adds no phantom would drive its innovation variances through zero. Out of it the acceleration is dropped.
        """
        enters, leaves = curved & ~self.curved, self.curved & ~curved
        if enters.any() or leaves.any():
            x, P = self.x.copy(), self.P.copy()
            x[leaves, A_] = 0.0
            P[leaves, A_] = 0.0
            P[leaves, :, A_] = 0.0
            for axis in range(AXES):
                velocity, acceleration = V_.start + axis, A_.start + axis
                P[enters, velocity, velocity] += self._phantom
                P[enters, acceleration, acceleration] = self._acceleration_variance
            self._put(enters | leaves, x, P)
            self._motion.curved = np.where(enters | leaves, curved, self.curved)

    def predict(self, t_ns: int, which: BoolArray) -> None:
        """Move some members on to ``t_ns`` (eq 1)."""
        self._motion.intervals_s = np.where(which, t_ns - self.t_ns, 0) / NS_PER_S
        self._engine.predict(self._motion, _NO_INPUT, 0.0)
        self.t_ns = np.where(which, t_ns, self.t_ns)

    def update(self, position: FloatArray, variances: FloatArray, which: BoolArray) -> Surprise:
        """Update some members with a position (R, 3) of these variances (eq 2); say what was not expected."""
        news = innovation(self._engine, self._seen, position, variances)
        self._engine.update(self._seen, position, which, variances)
        return Surprise(news.y, np.diagonal(news.S, axis1=1, axis2=2))

    def at(self, t_ns: int, known: BoolArray) -> tuple[FloatArray, FloatArray]:
        """State (R, 9) and covariance of each axis (R, 3 axes, 3, 3) at a later time, where known."""
        dt_s = np.where(known, np.maximum(t_ns - self.t_ns, 0), 0) / NS_PER_S
        x, P = np.ascontiguousarray(self.x), np.ascontiguousarray(self.P)
        return moved_axes(x, P, dt_s, self._motion.axis_noise(dt_s))

    def _put(self, which: BoolArray, x: FloatArray, P: FloatArray) -> None:
        here = which[:, np.newaxis]
        self._engine.restore(np.where(here, x, self.x), np.where(here[..., np.newaxis], P, self.P))
