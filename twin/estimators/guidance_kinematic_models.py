"""The constant-velocity and the constant-acceleration model of paper 004, eqs 3 to 15, over the ensemble axis.

State (eqs 3 and 12): position, velocity and acceleration of the antenna, each east, north and up, in the local frame
instead of latitude, longitude and height: over a field the map between them is linear, which changes no gain. The
constant-velocity model is the same state with the acceleration held at zero, exactly known: nothing of it then reaches
position or velocity, and a member of the ensemble may go over from one model to the other.

**Eq 11 as printed,** C_ww = sigma_v^2 [dT^2, dT; dT, 0] per axis, is no covariance: its eigenvalues are
sigma_v^2 (dT^2 +- sqrt(dT^4 + 4 dT^2)) / 2, at dT = 0.2 s sigma_v^2 times 0.22 and -0.18. What it does can be told
beforehand. With L = diag(0, sigma_v^2),

    F L F^T = sigma_v^2 [dT^2, dT; dT, 1],    so    F (P - L) F^T + C_ww = F P F^T - L    whatever dT,

and an update of P - L is the update of P, less L, as L has no part in the position measured. So the published filter
is, gain by gain, the filter *without any process noise* that started with a speed uncertain by sigma_v; its own
covariance is that filter's less L. From the first update on the variance of the velocity that it states is negative
(no sigma can be told of it), and it goes to -sigma_v^2. The position's stays positive and so does every innovation
variance: nothing breaks. But the gains die as in a straight line fitted to all fixes since the start, about 4 / k for
the position and 6 / (k^2 dT) for the velocity at the k-th fix, and in a bend the filter goes straight on.

**Corrected:** sigma_v^2 [dT^2, dT; dT, 1], the propagated variance of a velocity that changes by sigma_v from fix to
fix; or continuous white acceleration, sigma_v^2 [dT^3/3, dT^2/2; dT^2/2, dT], sigma_v^2 then being m^2/s^3. Eq 15 is
sigma_a^2 g g^T with g = [dT^2/2, dT, 1], sound as it stands; continuously it is white jerk.

The paper gives sigma_v^2 = sigma_a^2 = "0.5 m/s": taken for the variance, 0.5 m^2/s^2 and 0.5 m^2/s^4, per fix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.estimators.guidance_kinematic_kernels import (
    CONTINUOUS,
    PRINTED,
    STEP,
    axes_transition,
    curve_noise,
    straight_noise,
)
from twin.signals import BoolArray, FloatArray

AXES = 3
"""East, north and up; they do not see one another."""
STATES = 9
P_, V_, A_ = slice(0, 3), slice(3, 6), slice(6, 9)
"""Places in the state."""
_FORMS = {"printed": PRINTED, "step": STEP, "continuous": CONTINUOUS}


def on_axes(block: FloatArray, axes: int = AXES) -> FloatArray:
    """Matrices (..., n axes, n axes) of several axes that all have the matrix ``block`` (..., n, n)."""
    size = block.shape[-1] * axes
    whole = np.zeros((*block.shape[:-2], size, size))
    for axis in range(axes):
        whole[..., axis::axes, axis::axes] = block
    return whole


def transition(dt_s: FloatArray, *, orders: int = 3) -> FloatArray:
    """Transition of one axis over ``dt_s`` (...): [p, v, a], or [p, v] with two orders; shape (..., orders, orders)."""
    F = np.zeros((*dt_s.shape, orders, orders))
    F[..., range(orders), range(orders)] = 1.0
    F[..., 0, 1] = dt_s
    if orders == 3:
        F[..., 1, 2] = dt_s
        F[..., 0, 2] = 0.5 * dt_s**2
    return F


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessNoise:
    """What the models are believed to be worth."""

    velocity: float
    """sigma_v^2: m^2/s^2 per fix, or m^2/s^3."""
    acceleration: float
    """sigma_a^2: m^2/s^4 per fix, or m^2/s^5."""
    form: Literal["printed", "step", "continuous"] = "step"
    """Eq 11 as printed; corrected; or continuous white noise."""

    @property
    def phantom(self) -> float:
        """What the printed form takes from the variance of a velocity: L of the module's docstring, m^2/s^2."""
        return self.velocity if self.form == "printed" else 0.0

    def of_straight(self, dt_s: FloatArray) -> FloatArray:
        """C_ww of one axis over ``dt_s`` (R,) with constant velocity, (R, 3, 3); zero where no time passes."""
        return straight_noise(dt_s, self.velocity, _FORMS[self.form])

    def of_curve(self, dt_s: FloatArray) -> FloatArray:
        """C_ww of one axis over ``dt_s`` (R,) with constant acceleration (eq 15), (R, 3, 3)."""
        return curve_noise(dt_s, self.acceleration, _FORMS[self.form])


class KinematicMotion:
    """Eqs 4 and 13 for members that stand at times of their own.

    ``intervals_s`` (R,) and ``curved`` (R,), which of the models holds, are put in before each step; where the interval
    is zero nothing changes. The ``dt_s`` of the engine's call is not looked at.
    """

    def __init__(self, noise: ProcessNoise, runs: int) -> None:
        self._noise = noise
        self.intervals_s: FloatArray = np.zeros(runs)
        self.curved: BoolArray = np.zeros(runs, dtype=np.bool_)

    def axis_noise(self, dt_s: FloatArray) -> FloatArray:
        """C_ww of one axis over ``dt_s`` (R,), each member by its model, (R, 3, 3)."""
        if not self.curved.any():
            return self._noise.of_straight(dt_s)
        if self.curved.all():
            return self._noise.of_curve(dt_s)
        which = self.curved[:, np.newaxis, np.newaxis]
        return np.where(which, self._noise.of_curve(dt_s), self._noise.of_straight(dt_s))

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """State (R, 9) after each member's interval, and the transition (R, 9, 9)."""
        F = axes_transition(self.intervals_s)
        return np.matmul(F, x[:, :, np.newaxis])[:, :, 0], F

    def Q(self, dt_s: float) -> FloatArray:  # noqa: ARG002, N802
        """Process noise of each member's interval, (R, 9, 9)."""
        return on_axes(self.axis_noise(self.intervals_s))


class PositionSeen:
    """Eqs 5, 6 and 14: the position; its variances come with each fix."""

    R: FloatArray = np.ones(AXES)

    def __init__(self) -> None:
        self._H: FloatArray = np.eye(AXES, STATES)

    def h(self, x: FloatArray) -> FloatArray:
        """Expected position, (R, 3)."""
        return x[:, P_]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian, (3, 9)."""
        return self._H


def steady_gain(F: FloatArray, Q: FloatArray, r: float) -> FloatArray:
    """Gain (n,) in the steady state of a filter of one axis that measures its first state with variance ``r``."""
    P = Q + r * np.eye(len(F))
    gain = np.zeros(len(F))
    for _ in range(100_000):
        P = F @ P @ F.T + Q
        before, gain = gain, P[:, 0] / (P[0, 0] + r)
        P = P - np.outer(gain, P[0])
        if np.abs(gain - before).max() < 1e-14:
            break
    return gain


def circle_response(F: FloatArray, gain: FloatArray, turned_rad: float) -> complex:
    """How a filter with a steady gain shows a vehicle that drives round a circle, turning ``turned_rad`` per fix.

    East and north as one complex number: z = r exp(i k turned) is an eigenfunction of the filter, whose position is z
    times this number. 1 minus its real part is the share of the radius by which the track shown lies inside the circle,
    or outside where negative; its imaginary part, negative, is by how much it comes behind, in radii.
    """
    n = len(F)
    closed = (np.eye(n) - np.outer(gain, np.eye(n)[0])) @ F
    shown = np.linalg.solve(np.eye(n) - closed * np.exp(-1j * turned_rad), gain.astype(np.complex128))
    return complex(shown[0])
