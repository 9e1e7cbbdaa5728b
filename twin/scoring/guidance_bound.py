"""How well anybody could know where one pass lies beside another: covariance of their difference, true noise given.

Whatever an estimator tells on pass i and on pass j, the difference of its errors is the error of what it holds the
displacement p_j - p_i to be; and nobody can know that better than E[p_j - p_i | all measured until j], the estimate of
a Kalman filter with the true noise that keeps the place p_i of pass i as a state and learns of it afterwards. The
standard deviation of its error across the line is the bound. A constant error of the receiver drops out of it, and of
a slow one what changes between the passes is left, as far as wheels and gyro do not show it:

    receiver alone      sigma^2 = 2 s^2 (1 - exp(-t / tau)) + 2 white^2       at a lag t between the passes
    wheels and gyro     the position walks as the heading is wrong: by v times the sum of the heading error

The course is a plan: passes to and fro, half circles between them. Errors about it are linear and normal: position,
heading, offset and scale of the gyro, scale of the wheels, slow and stepping error of the receiver. Steps are taken for
a Gauss-Markov process of the same autocorrelation; who sees single steps come can do better than the bound that this
makes. Rounding of the output is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.scoring.riccati import known_after
from twin.signals import FloatArray

_X, _Y, _PSI, _B, _G, _K, _C, _J = 0, 1, 2, 3, 4, 5, 6, 8
_SIZE = 10
_UNKNOWN_M = 1e3

Motion = Callable[[float], tuple[float, float, float]]
"""Speed, heading against the first pass, and rate of turn at a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidanceErrors:
    """True random errors, 1 sigma, each axis."""

    slow_m: float
    slow_s: float
    """Slow error of the receiver and its 1/e time."""
    jump_m: float = 0.0
    jump_s: float = 120.0
    """Part of it that steps, and the mean time between two steps."""
    white_m: float = 0.05
    """New in every fix."""
    velocity_m_s: float | None = None
    """Of the receiver's velocity, new in every fix; None where it tells none, or nobody uses it."""
    rate_hz: float = 1.0
    """Of the receiver."""
    gyro_rad_rts: float | None = None
    """Angle random walk of the gyro; None where there is none, and the heading is what positions and velocities say."""
    gyro_bias_rad_s: float = 0.0
    gyro_bias_walk_rad_s_rts: float = 0.0
    gyro_scale_ratio: float = 0.0
    turn_walk_rad_rts: float = 0.3
    """Without a gyro: walk of the heading."""
    speed_scale_ratio: float = 0.0
    """Scale of the wheels' way."""
    walk_m_rtm: float = 0.0
    """Walk of the position per root of a metre that wheels roll: slip, and where they do not roll where they point."""
    start_heading_rad: float = 0.1
    forward_m: float = 0.0
    """The antenna's distance ahead of the rear axle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PassPlan:
    """Parallel passes of a machine."""

    length_m: float
    spacing_m: float
    speed_m_s: float
    stand_s: float = 5.0
    """At rest before the first."""
    pair: tuple[int, int] = (0, 1)
    """Which passes are compared, counted from 0; the later one last."""

    @property
    def pass_s(self) -> float:
        """Time of a pass."""
        return self.length_m / self.speed_m_s

    @property
    def turn_s(self) -> float:
        """Time of a half circle from one to the next."""
        return 0.5 * math.pi * self.spacing_m / self.speed_m_s

    def begin_s(self, number: int) -> float:
        """When a pass begins."""
        return self.stand_s + number * (self.pass_s + self.turn_s)

    def time_s(self, number: int, station_m: FloatArray) -> FloatArray:
        """When (n,) a pass is at the stations (n,), counted from where the first begins."""
        way = station_m if number % 2 == 0 else self.length_m - station_m
        time: FloatArray = self.begin_s(number) + way / self.speed_m_s
        return time

    def motion(self, t_s: float) -> tuple[float, float, float]:
        """Speed, heading against the first pass, and rate of turn at a time."""
        if t_s < self.stand_s:
            return 0.0, 0.0, 0.0
        number, into = divmod(t_s - self.stand_s, self.pass_s + self.turn_s)
        before = math.pi if number % 2 else 0.0
        if into < self.pass_s:
            return self.speed_m_s, before, 0.0
        rate = (-1.0 if number % 2 else 1.0) * math.pi / self.turn_s
        return self.speed_m_s, before + rate * (into - self.pass_s), rate


@dataclass(frozen=True, slots=True, kw_only=True)
class PassBound:
    """Standard deviations across the line (n,) of the difference of two passes at the same station."""

    station_m: FloatArray
    lag_s: FloatArray
    """Between the passes."""
    sigma_m: FloatArray
    """The least there can be."""
    receiver_m: FloatArray
    """Of the receiver alone."""

    @property
    def rms_m(self) -> float:
        """Root mean square of the least over the stations."""
        return float(np.sqrt(np.mean(np.square(self.sigma_m))))

    @property
    def receiver_rms_m(self) -> float:
        """The same of the receiver alone."""
        return float(np.sqrt(np.mean(np.square(self.receiver_m))))


def guidance_bound(errors: GuidanceErrors, plan: PassPlan, *, stations: int = 16) -> PassBound:
    """Bound on the pass-to-pass error, at stations evenly between a fifth of the length and 0.95 of it.

    Raises:
        ValueError: the passes of the pair are not one after the other.
    """
    first, second = plan.pair
    if not 0 <= first < second:
        raise ValueError(f"pair = {plan.pair}: two passes, the later one last")
    station_m = np.linspace(0.2, 0.95, stations) * plan.length_m
    early, late = plan.time_s(first, station_m), plan.time_s(second, station_m)
    lag_s = late - early
    receiver = 2.0 * errors.slow_m**2 * -np.expm1(-lag_s / errors.slow_s)
    receiver += 2.0 * errors.jump_m**2 * -np.expm1(-lag_s / errors.jump_s) + 2.0 * errors.white_m**2
    return PassBound(
        station_m=station_m,
        lag_s=lag_s,
        sigma_m=_differences(errors, plan, early, late),
        receiver_m=np.sqrt(receiver),
    )


def _differences(errors: GuidanceErrors, plan: PassPlan, early: FloatArray, late: FloatArray) -> FloatArray:
    """Standard deviation (n,) of what is not known of y(late) - y(early), after all fixes until ``late``."""
    sigma: FloatArray = between_passes(errors, plan.motion, np.stack([early, late]))[0, 1]
    return sigma


def between_passes(errors: GuidanceErrors, motion: Motion, times_s: FloatArray) -> FloatArray:
    """Standard deviation of what is not known of the way across the first line from one pass to another.

    Args:
        errors: true errors of the sensors.
        motion: what the machine does at a time: speed, heading against the first pass, rate of turn.
        times_s: (passes, stations) when each pass is at each station, later passes last.

    Returns:
        (passes, passes, stations): of pass j against pass i < j, after all fixes until j is there; NaN elsewhere.
    """
    passes, stations = times_s.shape
    model = _Model(errors, motion)
    step_s = 1.0 / errors.rate_hz
    due: dict[int, list[tuple[int, int]]] = {}
    for number in range(passes):
        for place in range(stations):
            due.setdefault(max(1, round(times_s[number, place] / step_s)), []).append((number, place))
    P = model.start()
    kept: dict[tuple[int, int], int] = {}
    sigma = np.full((passes, passes, stations), math.nan)
    for step in range(1, max(due) + 1):
        P = model.step(P, step * step_s)
        for number, place in due.get(step, ()):
            for earlier in range(number):
                clone = kept[earlier, place]
                variance = P[_Y, _Y] + P[clone, clone] - 2.0 * P[_Y, clone]
                sigma[earlier, number, place] = math.sqrt(max(variance, 0.0))
            kept[number, place] = len(P)
            P = np.block([[P, P[:, _Y : _Y + 1]], [P[_Y : _Y + 1], P[_Y : _Y + 1, _Y : _Y + 1]]])
    return sigma


class _Model:
    """The recursion over one period of the receiver; states after ``_SIZE`` are places that are kept."""

    def __init__(self, errors: GuidanceErrors, motion: Motion) -> None:
        self._errors, self._motion = errors, motion
        self._step_s = 1.0 / errors.rate_hz

    def start(self) -> FloatArray:
        """Covariance before the first fix."""
        errors = self._errors
        gyro = errors.gyro_rad_rts is not None
        sigmas = [_UNKNOWN_M, _UNKNOWN_M, errors.start_heading_rad]
        sigmas += [errors.gyro_bias_rad_s if gyro else 0.0, errors.gyro_scale_ratio if gyro else 0.0]
        sigmas += [errors.speed_scale_ratio, errors.slow_m, errors.slow_m, errors.jump_m, errors.jump_m]
        return np.diag(np.square(sigmas))

    def step(self, P: FloatArray, t_s: float) -> FloatArray:
        """Covariance a period later, after the fix at ``t_s``."""
        errors, T = self._errors, self._step_s
        speed, heading, rate = self._motion(t_s - 0.5 * T)
        size = len(P)
        F, Q = np.eye(size), np.zeros((size, size))
        along, aside = (math.cos(heading), math.sin(heading)), (-math.sin(heading), math.cos(heading))
        for axis in range(2):
            F[axis, _PSI] = speed * T * aside[axis]
            F[axis, _B] = -0.5 * T * F[axis, _PSI]
            F[axis, _G] = 0.5 * T * rate * F[axis, _PSI]
            F[axis, _K] = speed * T * along[axis]
            Q[axis, axis] = errors.walk_m_rtm**2 * speed * T
        if speed > 0.0:
            F[_PSI, _B], F[_PSI, _G] = -T, rate * T
            walk = errors.turn_walk_rad_rts if errors.gyro_rad_rts is None else errors.gyro_rad_rts
            Q[_PSI, _PSI] = walk**2 * T
        Q[_B, _B] = errors.gyro_bias_walk_rad_s_rts**2 * T if errors.gyro_rad_rts is not None else 0.0
        for place, sigma, correlation_s in ((_C, errors.slow_m, errors.slow_s), (_J, errors.jump_m, errors.jump_s)):
            kept = math.exp(-T / correlation_s)
            for each in (place, place + 1):
                F[each, each] = kept
                Q[each, each] = sigma**2 * (1.0 - kept * kept)
        P = F @ P @ F.T + Q
        if speed == 0.0 and errors.gyro_rad_rts is not None and errors.gyro_bias_rad_s > 0.0:
            P = known_after(P, {_B: 1.0}, errors.gyro_rad_rts / math.sqrt(T))
        return self._see(P, *self._motion(t_s))

    def _see(self, P: FloatArray, speed: float, heading: float, rate: float) -> FloatArray:
        errors = self._errors
        arm = errors.forward_m
        along, aside = (math.cos(heading), math.sin(heading)), (-math.sin(heading), math.cos(heading))
        for axis in range(2):
            seen = {axis: 1.0, _PSI: arm * aside[axis], _C + axis: 1.0, _J + axis: 1.0}
            P = known_after(P, seen, errors.white_m)
        if errors.velocity_m_s is not None and speed > 0.0:
            for axis in range(2):
                moving = {
                    _PSI: speed * aside[axis] - arm * rate * along[axis],
                    _K: speed * along[axis],
                    _B: -arm * aside[axis],
                    _G: arm * rate * aside[axis],
                }
                P = known_after(P, moving, errors.velocity_m_s)
        return P
