"""Strapdown inertial model of a ground machine: motion of the state between two inertial samples.

The state of one rigid body, in this order (body axes FLU at the reference point, ENU world):

    E, N              position of the reference point, m
    v_x, v_y, v_z     its velocity in body axes, m/s
    phi, theta, psi   roll, pitch, heading (intrinsic z-y'-x''; heading not wrapped), rad
    b_a (3)           accelerometer bias, m/s^2
    b_g (3)           gyroscope bias, rad/s
    k (3)             what a yaw rate of 1 rad/s falsely adds to each gyro axis: cross-axis on x and y, scale on z
    beta              sideslip: lateral velocity of the point that should not slip, m/s
    and, for every pulse sensor, its lagged output L (m/s) and scale error s (an AccoSat, which is a filter itself and
    errs slowly, has an additive error e in m/s in place of s); for every GNSS receiver its lagged velocity G_e, G_n
    (m/s) and the time-correlated error c_e, c_n (m) of its position

Strapdown mechanisation (Titterton and Weston 2004, chapter 3, without the earth's rotation: 7e-5 rad/s are lost in the
gyro bias) with the inertial sample u = (f, g), specific force and angular rate averaged over the step T:

    a = f - b_a,   w = g - b_g - k (g_z - b_gz)
    v'     = a + R^T (0, 0, -g0) - w x v
    phi'   = w_x + (w_y sin phi + w_z cos phi) tan theta
    theta' = w_y cos phi - w_z sin phi
    psi'   = (w_y sin phi + w_z cos phi) / cos theta
    (E, N)' = first two rows of R v,    R = Rz(psi) Ry(theta) Rx(phi)

So tilt turns gravity into what the accelerometers feel, and the filter knows it: that is what the published filter
lacks. Lags follow their inputs as first-order filters. A radar's is a filter of samples, L+ = L + (1 - e^{-T/tau})
(D - L), where D is the mean over the step of the speed that it sees: |(1 + s)(v_x - tan(A) v_z)| at the sensor's mount
for a beam that points A below the horizontal, so that pitching and heaving are in it. A receiver's is continuous: its
velocity is that of a filter over an input that changes linearly within the step, so without a lag it is the velocity at
the end of the step. Correlated errors decay with e^{-T/tau} and are driven so that they keep their variance. Biases
wander as random walks, scale errors slowly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import FloatArray

E, N = 0, 1
VX, VY, VZ = 2, 3, 4
ROLL, PITCH, YAW = 5, 6, 7
BA, BG, K = 8, 11, 14
SLIP = 17
CORE_STATES = 18

_FORCE, _RATE = slice(0, 3), slice(3, 6)


@dataclass(frozen=True, slots=True, kw_only=True)
class PulseSensorModel:
    """A pulse sensor as the filter sees it."""

    name: str
    arm_m: tuple[float, float, float]
    """Mount in body axes from the reference point."""
    beam_slope: float
    """tan of the beam's angle below the horizontal: share of the vertical velocity that it sees; 0 for none."""
    speed_noise_m_s: float
    """White noise of the input speed in one sample."""
    sample_s: float
    """Time between two samples."""
    lags_s: tuple[float, float]
    """Time constants: speeding up, braking."""
    slow_error: tuple[float, float] | None = None
    """Standard deviation (m/s) and 1/e time (s) of an additive error, which then takes the place of the scale error."""
    at: int = 0
    """Index of L in the state; s or e follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverModel:
    """A GNSS receiver as the filter sees it."""

    name: str
    arm_m: tuple[float, float, float]
    """Antenna in body axes from the reference point."""
    velocity_lag_s: float
    correlation_s: float
    """1/e time of the position error."""
    at: int = 0
    """Index of G_e in the state; G_n, c_e, c_n follow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessNoise:
    """Densities: of a random walk, its growth per square root of a second."""

    accel_bias: float
    gyro_bias: float
    accel_extra: float
    """White acceleration the model does not know (scale, vibration rectified), m/s^2 per root Hz."""
    rate_extra: float
    """White rate, rad/s per root Hz."""
    response: float
    """Of k, 1 per root s."""
    sideslip_m_s: float
    """Standard deviation of beta."""
    sideslip_correlation_s: float
    scale: float
    """Of s, 1 per root s."""


def size_of(pulse_sensors: int, receivers: int) -> int:
    """Number of states with so many aiding sensors."""
    return CORE_STATES + 2 * pulse_sensors + 4 * receivers


@dataclass(slots=True)
class Drive:
    """What differs from step to step and from member to member: given to the model before it predicts."""

    accel_variance: FloatArray
    """(R,) of the inertial sample's specific force, (m/s^2)^2."""
    gyro_variance: FloatArray
    """(R,) of its angular rate, (rad/s)^2."""
    lags_s: Mapping[str, FloatArray] = field(default_factory=dict)
    """(R,) time constant of each pulse sensor now."""
    position_sigmas_m: Mapping[str, FloatArray] = field(default_factory=dict)
    """(R,) standard deviation of each receiver's correlated error."""


@dataclass(slots=True)
class _Step:
    """A prediction in the making."""

    x: FloatArray
    u: FloatArray
    w: FloatArray
    dw: FloatArray
    dt: float
    moved: FloatArray
    F: FloatArray


class Strapdown:
    """The motion model; ``drive`` is set before each prediction.

    Implements :class:`twin.estimators.engines.Motion` with inputs u of shape (R, 6).
    """

    def __init__(
        self,
        *,
        pulse_sensors: Sequence[PulseSensorModel],
        receivers: Sequence[ReceiverModel],
        noise: ProcessNoise,
        runs: int,
    ) -> None:
        self.pulse_sensors = tuple(pulse_sensors)
        self.receivers = tuple(receivers)
        self.size = size_of(len(self.pulse_sensors), len(self.receivers))
        self.drive = Drive(accel_variance=np.zeros(runs), gyro_variance=np.zeros(runs))
        self._noise = noise
        self._runs = runs

    def rate(self, x: FloatArray, u: FloatArray) -> FloatArray:
        """Angular rate of the body (R, 3), the sample's errors taken off."""
        unbiased = u[:, _RATE] - x[:, BG : BG + 3]
        corrected: FloatArray = unbiased - x[:, K : K + 3] * unbiased[:, 2:3]
        return corrected

    def _rate_jacobian(self, x: FloatArray, u: FloatArray) -> FloatArray:
        """Derivative of :meth:`rate` by the state, (R, 3, n)."""
        dw = np.zeros((len(x), 3, self.size))
        for axis in range(3):
            dw[:, axis, BG + axis] -= 1.0
            dw[:, axis, BG + 2] += x[:, K + axis]
            dw[:, axis, K + axis] = x[:, BG + 2] - u[:, 5]
        return dw

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """State after ``dt_s`` (R, n) and its Jacobian (R, n, n)."""
        runs = len(x)
        F = np.zeros((runs, self.size, self.size))
        F[:] = np.eye(self.size)
        moved = x.copy()
        step = _Step(x=x, u=u, w=self.rate(x, u), dw=self._rate_jacobian(x, u), dt=dt_s, moved=moved, F=F)
        _turn(step)
        _accelerate(step)
        _travel(step)
        keep = math.exp(-dt_s / self._noise.sideslip_correlation_s)
        moved[:, SLIP] = keep * x[:, SLIP]
        F[:, SLIP, SLIP] = keep
        for sensor in self.pulse_sensors:
            self._lag_pulses(sensor, step)
        for receiver in self.receivers:
            _lag_receiver(receiver, step)
        return moved, F

    def _lag_pulses(self, sensor: PulseSensorModel, step: _Step) -> None:
        x, w, dw, dt, moved, F = step.x, step.w, step.dw, step.dt, step.moved, step.F
        at = sensor.at
        # the mean of what it sees at the begin and at the end of the step
        seen = 0.5 * (doppler(sensor, x, w) + doppler(sensor, moved, w))
        unmoved = np.broadcast_to(np.eye(self.size)[VX : VZ + 1], F[:, VX : VZ + 1].shape)
        d_before = _doppler_jacobian(sensor, x, w, dw, unmoved)
        d_after = _doppler_jacobian(sensor, moved, w, dw, F[:, VX : VZ + 1])
        gain = lag_gain(self.drive.lags_s[sensor.name], dt)
        moved[:, at] = x[:, at] + gain * (seen - x[:, at])
        F[:, at] = (0.5 * gain)[:, np.newaxis] * (d_before + d_after)
        F[:, at, at] += 1.0 - gain
        if sensor.slow_error is not None:
            keep = math.exp(-dt / sensor.slow_error[1])
            moved[:, at + 1] = keep * x[:, at + 1]
            F[:, at + 1, at + 1] = keep

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise of ``dt_s``, shape (R, n, n)."""
        noise, drive = self._noise, self.drive
        diagonal = np.zeros((self._runs, self.size))
        diagonal[:, :2] = 1e-8 * dt_s
        diagonal[:, VX : VZ + 1] = (drive.accel_variance * dt_s**2 + noise.accel_extra**2 * dt_s)[:, np.newaxis]
        diagonal[:, ROLL : YAW + 1] = (drive.gyro_variance * dt_s**2 + noise.rate_extra**2 * dt_s)[:, np.newaxis]
        diagonal[:, BA : BA + 3] = noise.accel_bias**2 * dt_s
        diagonal[:, BG : BG + 3] = noise.gyro_bias**2 * dt_s
        diagonal[:, K : K + 3] = noise.response**2 * dt_s
        keep = math.exp(-dt_s / noise.sideslip_correlation_s)
        diagonal[:, SLIP] = noise.sideslip_m_s**2 * (1.0 - keep * keep)
        for sensor in self.pulse_sensors:
            gain = lag_gain(drive.lags_s[sensor.name], dt_s)
            # the sensor's own samples leave g / (2 - g) of their variance behind its lag; so do ours with this share
            own = lag_gain(drive.lags_s[sensor.name], sensor.sample_s)
            share = own / (2.0 - own) * (2.0 - gain) / gain
            diagonal[:, sensor.at] = (gain * sensor.speed_noise_m_s) ** 2 * share
            diagonal[:, sensor.at + 1] = noise.scale**2 * dt_s
            if sensor.slow_error is not None:
                sigma, tau_s = sensor.slow_error
                diagonal[:, sensor.at + 1] = sigma**2 * (1.0 - math.exp(-2.0 * dt_s / tau_s))
        for receiver in self.receivers:
            diagonal[:, receiver.at : receiver.at + 2] = 1e-8
            keep_c = math.exp(-dt_s / receiver.correlation_s)
            driven = drive.position_sigmas_m[receiver.name] ** 2 * (1.0 - keep_c * keep_c)
            diagonal[:, receiver.at + 2 : receiver.at + 4] = driven[:, np.newaxis]
        Q = np.zeros((self._runs, self.size, self.size))
        places = np.arange(self.size)
        Q[:, places, places] = diagonal
        return Q


# --- parts of a step ------------------------------------------------------------------------------------------------


def _turn(step: _Step) -> None:
    """Attitude."""
    x, w, dw, dt, moved, F = step.x, step.w, step.dw, step.dt, step.moved, step.F
    sine, cosine = np.sin(x[:, ROLL]), np.cos(x[:, ROLL])
    tangent, secant = np.tan(x[:, PITCH]), 1.0 / np.cos(x[:, PITCH])
    about = w[:, 1] * sine + w[:, 2] * cosine  # the rate about the vertical, times cos theta
    cross = w[:, 1] * cosine - w[:, 2] * sine
    moved[:, ROLL] += dt * (w[:, 0] + about * tangent)
    moved[:, PITCH] += dt * cross
    moved[:, YAW] += dt * about * secant
    F[:, ROLL, ROLL] += dt * cross * tangent
    F[:, ROLL, PITCH] += dt * about * secant * secant
    F[:, PITCH, ROLL] -= dt * about
    F[:, YAW, ROLL] += dt * cross * secant
    F[:, YAW, PITCH] += dt * about * secant * tangent
    d_about = sine[:, np.newaxis] * dw[:, 1] + cosine[:, np.newaxis] * dw[:, 2]
    F[:, ROLL] += dt * (dw[:, 0] + tangent[:, np.newaxis] * d_about)
    F[:, PITCH] += dt * (cosine[:, np.newaxis] * dw[:, 1] - sine[:, np.newaxis] * dw[:, 2])
    F[:, YAW] += dt * secant[:, np.newaxis] * d_about


def _accelerate(step: _Step) -> None:
    """Velocity, with the gravity of the mean attitude over the step."""
    x, u, w, dw, dt, moved, F = step.x, step.u, step.w, step.dw, step.dt, step.moved, step.F
    roll, pitch = 0.5 * (x[:, ROLL] + moved[:, ROLL]), 0.5 * (x[:, PITCH] + moved[:, PITCH])
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    g = STANDARD_GRAVITY_M_S2
    v = x[:, VX : VZ + 1]
    gravity = np.stack([g * sp, -g * cp * sr, -g * cp * cr], axis=-1)
    moved[:, VX : VZ + 1] += dt * (u[:, _FORCE] - x[:, BA : BA + 3] + gravity - cross(w, v))
    F[:, VX, PITCH] += dt * g * cp
    F[:, VY, ROLL] -= dt * g * cp * cr
    F[:, VY, PITCH] += dt * g * sp * sr
    F[:, VZ, ROLL] += dt * g * cp * sr
    F[:, VZ, PITCH] += dt * g * sp * cr
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        F[:, VX + axis, BA + axis] -= dt
        # (w x v)_axis = w_first v_second - w_second v_first
        F[:, VX + axis, VX + second] -= dt * w[:, first]
        F[:, VX + axis, VX + first] += dt * w[:, second]
        F[:, VX + axis] -= dt * (v[:, second, np.newaxis] * dw[:, first] - v[:, first, np.newaxis] * dw[:, second])


def _travel(step: _Step) -> None:
    """Position, by mean velocity and attitude."""
    x, dt, moved, F = step.x, step.dt, step.moved, step.F
    v = 0.5 * (x[:, VX : VZ + 1] + moved[:, VX : VZ + 1])
    attitude = 0.5 * (x[:, ROLL : YAW + 1] + moved[:, ROLL : YAW + 1])
    east_north, by_velocity, by_attitude = horizontal(v, attitude)
    moved[:, :2] += dt * east_north
    F[:, :2, VX : VZ + 1] += dt * by_velocity
    F[:, :2, ROLL : YAW + 1] += dt * by_attitude


def _lag_receiver(receiver: ReceiverModel, step: _Step) -> None:
    """A receiver's lagged velocity and correlated error."""
    x, w, dw, dt, moved, F = step.x, step.w, step.dw, step.dt, step.moved, step.F
    at = receiver.at
    arm = np.array(receiver.arm_m)
    swing, d_swing = cross(w, arm), _cross_jacobian(dw, arm)
    first, last = _ramp_gains(receiver.velocity_lag_s, dt)
    before, by_velocity, by_attitude = horizontal(x[:, VX : VZ + 1] + swing, x[:, ROLL : YAW + 1])
    after, by_velocity_after, by_attitude_after = horizontal(moved[:, VX : VZ + 1] + swing, moved[:, ROLL : YAW + 1])
    decay = 1.0 - first - last
    moved[:, at : at + 2] = decay * x[:, at : at + 2] + first * before + last * after
    d_after = by_velocity_after @ (F[:, VX : VZ + 1] + d_swing) + by_attitude_after @ F[:, ROLL : YAW + 1]
    F[:, at : at + 2] = first * (by_velocity @ d_swing) + last * d_after
    F[:, at : at + 2, VX : VZ + 1] += first * by_velocity
    F[:, at : at + 2, ROLL : YAW + 1] += first * by_attitude
    F[:, at, at] += decay
    F[:, at + 1, at + 1] += decay
    keep = math.exp(-dt / receiver.correlation_s)
    for place in (at + 2, at + 3):
        moved[:, place] = keep * x[:, place]
        F[:, place, place] = keep


class ErrorChange:
    """A receiver's correlated error changes at once: it is drawn anew (``keep`` 0), or grows (``keep`` 1)."""

    def __init__(self, receiver: ReceiverModel, *, keep: FloatArray, added_m2: FloatArray, size: int) -> None:
        self._places = [receiver.at + 2, receiver.at + 3]
        self._keep = keep
        self._added = added_m2
        self._size = size

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """What is kept of the error, (R, n), and the Jacobian (R, n, n)."""
        F = np.zeros((len(x), self._size, self._size))
        F[:] = np.eye(self._size)
        moved = x.copy()
        for place in self._places:
            moved[:, place] = self._keep * x[:, place]
            F[:, place, place] = self._keep
        return moved, F

    def Q(self, dt_s: float) -> FloatArray:  # noqa: ARG002, N802
        """Variance that is added, (R, n, n)."""
        Q = np.zeros((len(self._added), self._size, self._size))
        for place in self._places:
            Q[:, place, place] = self._added
        return Q


# --- geometry that the observations share ----------------------------------------------------------------------------


def lag_gain(lag_s: FloatArray, dt_s: float) -> FloatArray:
    """Gain of first-order lags over a step; 1 where there is no lag."""
    gain: FloatArray = 1.0 - np.exp(-dt_s / np.maximum(lag_s, 1e-9))
    return gain


def _ramp_gains(lag_s: float, dt_s: float) -> tuple[float, float]:
    """Shares of an input's values at the begin and the end of a step in a first-order lag's output at its end.

    Exact for an input that changes linearly within the step: the convolution of e^{-t/tau} / tau with it.
    """
    if lag_s <= 0.0:
        return 0.0, 1.0
    decay, ratio = math.exp(-dt_s / lag_s), lag_s / dt_s
    last = 1.0 - ratio * (1.0 - decay)
    return 1.0 - decay - last, last


def cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Cross product over the last axis of (R, 3) with (R, 3) or (3,)."""
    product: FloatArray = np.stack(
        [
            first[..., 1] * second[..., 2] - first[..., 2] * second[..., 1],
            first[..., 2] * second[..., 0] - first[..., 0] * second[..., 2],
            first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0],
        ],
        axis=-1,
    )
    return product


def _cross_jacobian(dw: FloatArray, arm: FloatArray) -> FloatArray:
    """Derivative (R, 3, n) of w x arm by the state, from that of w."""
    jacobian: FloatArray = np.stack(
        [
            dw[:, 1] * arm[2] - dw[:, 2] * arm[1],
            dw[:, 2] * arm[0] - dw[:, 0] * arm[2],
            dw[:, 0] * arm[1] - dw[:, 1] * arm[0],
        ],
        axis=1,
    )
    return jacobian


def horizontal(v: FloatArray, attitude: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """East and north (R, 2) of a body vector (R, 3); its derivatives by vector and attitude (R, 2, 3)."""
    sr, cr = np.sin(attitude[:, 0]), np.cos(attitude[:, 0])
    sp, cp = np.sin(attitude[:, 1]), np.cos(attitude[:, 1])
    sy, cy = np.sin(attitude[:, 2]), np.cos(attitude[:, 2])
    left = cr * v[:, 1] - sr * v[:, 2]
    up = sr * v[:, 1] + cr * v[:, 2]
    ahead, down = cp * v[:, 0] + sp * up, -sp * v[:, 0] + cp * up
    value = np.stack([cy * ahead - sy * left, sy * ahead + cy * left], axis=-1)
    by_vector = np.empty((len(v), 2, 3))
    by_vector[:, 0, 0], by_vector[:, 1, 0] = cy * cp, sy * cp
    by_vector[:, 0, 1], by_vector[:, 1, 1] = cy * sp * sr - sy * cr, sy * sp * sr + cy * cr
    by_vector[:, 0, 2], by_vector[:, 1, 2] = cy * sp * cr + sy * sr, sy * sp * cr - cy * sr
    by_attitude = np.empty((len(v), 2, 3))
    # roll turns (left, up) into (-up, left); pitch turns (ahead, down) into (down, -ahead)
    by_attitude[:, 0, 0], by_attitude[:, 1, 0] = cy * sp * left + sy * up, sy * sp * left - cy * up
    by_attitude[:, 0, 1], by_attitude[:, 1, 1] = cy * down, sy * down
    by_attitude[:, 0, 2], by_attitude[:, 1, 2] = -value[:, 1], value[:, 0]
    return value, by_vector, by_attitude


def doppler(sensor: PulseSensorModel, x: FloatArray, w: FloatArray) -> FloatArray:
    """Speed that a pulse sensor sees now (R,), without lag and noise."""
    seen: FloatArray = np.abs(_scale(sensor, x) * _along(sensor, x, w))
    return seen


def _scale(sensor: PulseSensorModel, x: FloatArray) -> FloatArray:
    return np.ones(len(x)) if sensor.slow_error is not None else 1.0 + x[:, sensor.at + 1]


def _along(sensor: PulseSensorModel, x: FloatArray, w: FloatArray) -> FloatArray:
    """Speed along the beam over the cosine of its angle."""
    swing = cross(w, np.array(sensor.arm_m))
    along = x[:, VX] + swing[:, 0] - sensor.beam_slope * (x[:, VZ] + swing[:, 2])
    return along if sensor.slow_error is None else along + x[:, sensor.at + 1]


def _doppler_jacobian(
    sensor: PulseSensorModel, x: FloatArray, w: FloatArray, dw: FloatArray, dv: FloatArray
) -> FloatArray:
    """Derivative of :func:`doppler` by the state, (R, n), from those of rate and velocity, (R, 3, n) each."""
    along, d_swing = _along(sensor, x, w), _cross_jacobian(dw, np.array(sensor.arm_m))
    d_along = dv[:, 0] + d_swing[:, 0] - sensor.beam_slope * (dv[:, 2] + d_swing[:, 2])
    sign = np.where(along < 0.0, -1.0, 1.0)
    jacobian: FloatArray = (sign * _scale(sensor, x))[:, np.newaxis] * d_along
    jacobian[:, sensor.at + 1] += sign * along if sensor.slow_error is None else sign
    return jacobian
