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
V      2    horizontal velocity, world axes, m/s
S      3    scale error s of each gyroscope axis, which reads (1 + s) w + b: Gauss-Markov in the angle turned
====== ==== =========================================================================================

Motion, with w = (1 - s) (gyroscope - b):  theta' = -C_held (db + w ds),  b' = white,  D fades with time and with the
angle turned (iron that the body carries pushes the field another way after a turn) and is driven by white noise,  C' =
white with the way and the turn,  V' = the horizontal part of a + theta x a with a = C_held f. A scale error is
constant, but s fades like D: over a whole turn nothing here tells it from what a field does that deviates with the
heading, and who holds on to what it learnt of one pays with the other. So s stands for what turns to and fro cancel and
turns on and on add up. Observations: what each says of theta is linear, because theta lives in the axes in which
gravity and north are fixed.

**Gravity** enters by the velocity. An accelerometer cannot tell a tilt from an acceleration, but a machine that stays
about where it is cannot accelerate one way for long: its velocity is zero to within a metre a second or so, while a
tilt would make it grow without end. So what is observed is V = 0, with the sigma of the speeds to be expected. That
tells far more than to take accelerations for white noise on gravity, because they cancel. At rest the sigma is small.
The upward velocity is left out: it shows next to nothing of a tilt, but all of the accelerometer's offset on that axis,
which in a cheap one (0.05 g) would have the machine fall at metres a second.

For a field of horizontal angle a and dip d,

    angle(C_held m) - north = D0 + D - theta_z - tan(d) (cos(a) theta_x + sin(a) theta_y).

The last term is left out of H and counted as noise: with tan(d) above 2 a field that is off by a little would otherwise
tilt the attitude rather than turn it. For the wheels, turned - heading held = theta_z - C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.compiled import compiled
from twin.signals import FloatArray

T, B, D0, D, C, V, S = 0, 3, 6, 7, 8, 9, 11
SIZE = 14


@dataclass(slots=True)
class StepNoise:
    """What differs from step to step and from member to member; set before each prediction."""

    turn_variance: FloatArray
    """(R, 3) of theta gathered in this step, world axes, rad^2."""
    slip_variance: FloatArray
    """(R,) of C gathered in this step, rad^2."""
    speed_variance: FloatArray
    """(R,) of either component of V gathered in this step, (m/s)^2."""
    deviation_kept: FloatArray
    """(R,) what is left of D after this step, 0 to 1."""
    deviation_variance: FloatArray
    """(R,) of D where it has wandered long, rad^2."""
    scale_kept: FloatArray
    """(R,) what is left of S after this step, 0 to 1."""
    scale_variance: FloatArray
    """(R, 3) of S where it has wandered long."""


class HeadingMotion:
    """Motion of the error state.

    Before a prediction are set: ``attitude`` (R, 3, 3), body to world; ``rate`` (R, 3), that of the body; ``noise``.
    """

    def __init__(self, *, bias_walk_rad_s_rts: float, runs: int) -> None:
        self.attitude: FloatArray = np.tile(np.eye(3), (runs, 1, 1))
        self.rate: FloatArray = np.zeros((runs, 3))
        zero, one = np.zeros(runs), np.ones(runs)
        self.noise = StepNoise(
            turn_variance=np.zeros((runs, 3)),
            slip_variance=zero,
            speed_variance=zero,
            deviation_kept=one,
            deviation_variance=zero,
            scale_kept=one,
            scale_variance=np.zeros((runs, 3)),
        )
        self._bias_density = bias_walk_rad_s_rts**2

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """State after ``dt_s`` (R, 14), the held attitude having followed the gyroscope, and its Jacobian.

        ``u`` (R, 3) is the specific force in world axes, by the attitude held, m/s^2.
        """
        F = np.zeros((len(x), SIZE, SIZE))
        F[:] = np.eye(SIZE)
        F[:, T : T + 3, B : B + 3] = -dt_s * self.attitude
        F[:, T : T + 3, S : S + 3] = -dt_s * self.attitude * self.rate[:, np.newaxis, :]
        F[:, D, D] = self.noise.deviation_kept
        F[:, S, S] = F[:, S + 1, S + 1] = F[:, S + 2, S + 2] = self.noise.scale_kept
        for axis in range(2):
            first, second = (axis + 1) % 3, (axis + 2) % 3
            # (theta x a)_axis = theta_first a_second - theta_second a_first
            F[:, V + axis, T + first] = dt_s * u[:, second]
            F[:, V + axis, T + second] = -dt_s * u[:, first]
        moved = x.copy()
        moved[:, V : V + 2] += dt_s * u[:, :2]
        moved[:, D] = self.noise.deviation_kept * x[:, D]
        moved[:, S : S + 3] = self.noise.scale_kept[:, np.newaxis] * x[:, S : S + 3]
        return moved, F

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise (R, 14, 14)."""
        Q = np.zeros((len(self.noise.turn_variance), SIZE, SIZE))
        renewed = 1.0 - self.noise.scale_kept**2
        for axis in range(3):
            Q[:, S + axis, S + axis] = self.noise.scale_variance[:, axis] * renewed
            Q[:, T + axis, T + axis] = self.noise.turn_variance[:, axis]
            Q[:, B + axis, B + axis] = self._bias_density * dt_s
        Q[:, V, V] = Q[:, V + 1, V + 1] = self.noise.speed_variance
        Q[:, D, D] = self.noise.deviation_variance * (1.0 - self.noise.deviation_kept**2)
        Q[:, C, C] = self.noise.slip_variance
        return Q


class VelocitySeen:
    """The machine stays about where it is: its velocity is zero, to within the sigma of its speeds."""

    def __init__(self) -> None:
        self.R: FloatArray = np.ones(2)
        self._H: FloatArray = np.zeros((2, SIZE))
        self._H[np.arange(2), V + np.arange(2)] = 1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Velocity (R, 2)."""
        return x[:, V : V + 2]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (2, 14)."""
        return self._H


class FieldSeen:
    """The angle of the horizontal field minus magnetic north: D0 + D - theta_z."""

    def __init__(self) -> None:
        self.R: FloatArray = np.ones(1)
        self._H: FloatArray = np.zeros((1, SIZE))
        self._H[0, T + 2], self._H[0, D0], self._H[0, D] = -1.0, 1.0, 1.0

    def h(self, x: FloatArray) -> FloatArray:
        """Expected (R, 1)."""
        expected: FloatArray = (x[:, D0] + x[:, D] - x[:, T + 2])[:, np.newaxis]
        return expected

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (1, 14)."""
        return self._H


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
        """Jacobian (1, 14)."""
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
        """Jacobian (3, 14)."""
        return self._H


# --- rotations over the ensemble axis --------------------------------------------------------------------------------


@compiled
def rotation_of(q: FloatArray) -> FloatArray:
    """Rotation (R, 3, 3) of unit quaternions (R, 4) as (x, y, z, w)."""
    out = np.empty((len(q), 3, 3))
    for m in range(len(q)):
        x, y, z, w = q[m, 0], q[m, 1], q[m, 2], q[m, 3]
        out[m, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
        out[m, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
        out[m, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
        out[m, 0, 1], out[m, 1, 0] = 2.0 * (x * y - z * w), 2.0 * (x * y + z * w)
        out[m, 0, 2], out[m, 2, 0] = 2.0 * (x * z + y * w), 2.0 * (x * z - y * w)
        out[m, 1, 2], out[m, 2, 1] = 2.0 * (y * z - x * w), 2.0 * (y * z + x * w)
    return out


@compiled
def exponential(rotation: FloatArray) -> FloatArray:
    """Unit quaternions (R, 4) of rotation vectors (R, 3)."""
    out = np.empty((len(rotation), 4))
    for m in range(len(rotation)):
        x, y, z = rotation[m, 0], rotation[m, 1], rotation[m, 2]
        half = 0.5 * np.sqrt(x * x + y * y + z * z)
        scale = 0.5 * np.sin(half) / half if half > 1e-6 else 0.5 - half * half / 12.0
        out[m, 0], out[m, 1], out[m, 2], out[m, 3] = scale * x, scale * y, scale * z, np.cos(half)
    return out


@compiled
def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Quaternion products (R, 4), normalised: first q, then p."""
    out = np.empty_like(q)
    for m in range(len(q)):
        px, py, pz, pw = p[m, 0], p[m, 1], p[m, 2], p[m, 3]
        qx, qy, qz, qw = q[m, 0], q[m, 1], q[m, 2], q[m, 3]
        x = pw * qx + px * qw + py * qz - pz * qy
        y = pw * qy - px * qz + py * qw + pz * qx
        z = pw * qz + px * qy - py * qx + pz * qw
        w = pw * qw - px * qx - py * qy - pz * qz
        inverse = 1.0 / np.sqrt(x * x + y * y + z * z + w * w)
        out[m, 0], out[m, 1], out[m, 2], out[m, 3] = x * inverse, y * inverse, z * inverse, w * inverse
    return out


def rotate(attitude: FloatArray, vectors: FloatArray) -> FloatArray:
    """Body vectors (R, 3) in world axes."""
    turned: FloatArray = np.einsum("rij,rj->ri", attitude, vectors)
    return turned
