"""Model of our heading filter: attitude as a rotation error, gyroscope bias, and the offsets of two heading references.

The attitude itself is a quaternion above the engine (:mod:`twin.estimators.heading_filter`), good at any tilt. The
engine keeps what is not known of it, in world axes (an invariant error: Sola, *Quaternion kinematics for the
error-state Kalman filter*, 2017, section 7):

====== ==== =========================================================================================
place  n    state
====== ==== =========================================================================================
T      3    rotation theta from the attitude held to the true one: C = exp(theta) C_held, rad
B      3    gyroscope bias b, body axes, rad/s
D0     1    constant part of the local field's deviation from magnetic north, rad
D      1    its part that comes and goes: Gauss-Markov (buildings, iron in the ground, hard iron left over)
C      1    heading minus the heading counted by the wheels, rad: drifts as the wheels slip
====== ==== =========================================================================================

Motion, with w = gyroscope - b:  theta' = -C_held (db),  b' = white,  D' = -D / tau + white,  C' = white with the way
and the turn. Observations: what each says of theta is linear, because theta lives in the axes in which gravity and
north are fixed. For gravity, C_held f / g = (-theta_y, theta_x, 1). For a field of horizontal angle a and dip d,

    angle(C_held m) - north = D0 + D - theta_z - tan(d) (cos(a) theta_x + sin(a) theta_y),

d positive below the horizon, as in the northern hemisphere. For the wheels, turned - heading held = theta_z - C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.signals import FloatArray

T, B, D0, D, C = 0, 3, 6, 7, 8
SIZE = 9


@dataclass(slots=True)
class StepNoise:
    """What differs from step to step and from member to member; set before each prediction."""

    turn_variance: FloatArray
    """(R,) of each component of theta gathered in this step, rad^2."""
    slip_variance: FloatArray
    """(R,) of C gathered in this step, rad^2."""


class HeadingMotion:
    """Motion of the error state; ``attitude`` (R, 3, 3), body to world, and ``noise`` are set before a prediction."""

    def __init__(self, *, bias_walk_rad_s_rts: float, deviation_rad: float, deviation_s: float, runs: int) -> None:
        self.attitude: FloatArray = np.tile(np.eye(3), (runs, 1, 1))
        self.noise = StepNoise(np.zeros(runs), np.zeros(runs))
        self._bias_density = bias_walk_rad_s_rts**2
        self._deviation = deviation_rad
        self._deviation_s = deviation_s

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """State after ``dt_s`` (R, 9), the held attitude having followed the gyroscope, and its Jacobian."""
        F = np.zeros((len(x), SIZE, SIZE))
        F[:] = np.eye(SIZE)
        F[:, T : T + 3, B : B + 3] = -dt_s * self.attitude
        keep = math.exp(-dt_s / self._deviation_s)
        F[:, D, D] = keep
        moved = x.copy()
        moved[:, D] = keep * x[:, D]
        return moved, F

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise (R, 9, 9)."""
        Q = np.zeros((len(self.noise.turn_variance), SIZE, SIZE))
        for axis in range(3):
            Q[:, T + axis, T + axis] = self.noise.turn_variance
            Q[:, B + axis, B + axis] = self._bias_density * dt_s
        Q[:, D, D] = self._deviation**2 * (1.0 - math.exp(-2.0 * dt_s / self._deviation_s))
        Q[:, C, C] = self.noise.slip_variance
        return Q


class GravitySeen:
    """The horizontal part of the specific force over g, world axes: (-theta_y, theta_x)."""

    def __init__(self) -> None:
        self.R: FloatArray = np.ones(2)
        self._H: FloatArray = np.zeros((2, SIZE))
        self._H[0, T + 1], self._H[1, T] = -1.0, 1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Expected (R, 2)."""
        return np.stack([-x[:, T + 1], x[:, T]], axis=-1)

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (2, 9)."""
        return self._H


class FieldSeen:
    """The angle of the horizontal field minus magnetic north; ``angle`` and ``tan_dip`` (R,) are set before use."""

    def __init__(self, *, runs: int) -> None:
        self.R: FloatArray = np.ones(1)
        self.angle: FloatArray = np.zeros(runs)
        self.tan_dip: FloatArray = np.zeros(runs)

    def h(self, x: FloatArray) -> FloatArray:
        """Expected (R, 1)."""
        return np.einsum("rmi,ri->rm", self.H(x), x)

    def H(self, x: FloatArray) -> FloatArray:  # noqa: N802
        """Jacobian (R, 1, 9)."""
        H = np.zeros((len(x), 1, SIZE))
        H[:, 0, T] = -self.tan_dip * np.cos(self.angle)
        H[:, 0, T + 1] = -self.tan_dip * np.sin(self.angle)
        H[:, 0, T + 2] = -1.0
        H[:, 0, D0] = H[:, 0, D] = 1.0
        return H


class WheelsSeen:
    """The heading counted by the wheels minus the heading held."""

    def __init__(self, variance: float) -> None:
        self.R: FloatArray = np.array([variance])
        self._H: FloatArray = np.zeros((1, SIZE))
        self._H[0, T + 2], self._H[0, C] = 1.0, -1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Expected (R, 1)."""
        return x[:, T + 2 : T + 3] - x[:, C : C + 1]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (1, 9)."""
        return self._H


class BiasSeen:
    """The machine stands: the gyroscopes read their biases."""

    def __init__(self, variance: float) -> None:
        self.R: FloatArray = np.full(3, variance)
        self._H: FloatArray = np.zeros((3, SIZE))
        self._H[np.arange(3), B + np.arange(3)] = 1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Expected (R, 3)."""
        return x[:, B : B + 3]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (3, 9)."""
        return self._H


# --- rotations over the ensemble axis --------------------------------------------------------------------------------


def rotation_of(q: FloatArray) -> FloatArray:
    """Rotation (R, 3, 3) of unit quaternions (R, 4) as (x, y, z, w)."""
    x, y, z, w = q.T
    C_ = np.empty((len(q), 3, 3))
    C_[:, 0, 0], C_[:, 1, 1], C_[:, 2, 2] = (
        1.0 - 2.0 * (y * y + z * z),
        1.0 - 2.0 * (x * x + z * z),
        1.0 - 2.0 * (x * x + y * y),
    )
    C_[:, 0, 1], C_[:, 1, 0] = 2.0 * (x * y - z * w), 2.0 * (x * y + z * w)
    C_[:, 0, 2], C_[:, 2, 0] = 2.0 * (x * z + y * w), 2.0 * (x * z - y * w)
    C_[:, 1, 2], C_[:, 2, 1] = 2.0 * (y * z - x * w), 2.0 * (y * z + x * w)
    return C_


def exponential(rotation: FloatArray) -> FloatArray:
    """Unit quaternions (R, 4) of rotation vectors (R, 3)."""
    half = 0.5 * np.sqrt(np.einsum("ri,ri->r", rotation, rotation))
    scale = 0.5 * np.sinc(half / np.pi)
    return np.concatenate([rotation * scale[:, np.newaxis], np.cos(half)[:, np.newaxis]], axis=1)


def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Quaternion products (R, 4), normalised: first q, then p."""
    px, py, pz, pw = p.T
    qx, qy, qz, qw = q.T
    out = np.stack(
        [
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ],
        axis=-1,
    )
    unit: FloatArray = out / np.sqrt(np.einsum("ri,ri->r", out, out))[:, np.newaxis]
    return unit


def rotate(attitude: FloatArray, vectors: FloatArray) -> FloatArray:
    """Body vectors (R, 3) in world axes."""
    turned: FloatArray = np.einsum("rij,rj->ri", attitude, vectors)
    return turned
