"""The bound on the pass-to-pass error (:mod:`twin.scoring.guidance_bound`) of a scenario's sensors, field and machine.

It is of filters that know position and velocity of the receiver, the way of the wheels and a rate of turn. Errors are
those of the sensors' configurations, and what is not in them is taken as none: wheels that roll exactly where they
point, no rounding, a heading that is known at the start. So it is a bound on the best there could be, not a promise.
What a steering angle or the difference of two wheels tells of the heading is not in it: who knew how tyres slip could
do better yet. Of a receiver whose axes differ, the smaller sigma and the longer correlation time count. Faults are left
out, and the receiver is in its usual state throughout: in lesser ones less is known. Accelerating takes no time.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.control.path_following import PathDriverConfig
from twin.control.path_plan import lay_out
from twin.control.planned_legs import PlannedLeg, parallel_passes, planned_legs
from twin.scenario import Scenario
from twin.scoring.guidance_bound import GuidanceErrors, between_passes
from twin.scoring.pass_to_pass import LONGEST_NS
from twin.sensors.gnss_config import GnssConfig
from twin.sensors.imu import ImuConfig
from twin.sensors.yaw_gyro import YawGyroConfig
from twin.signals import NS_PER_S, FloatArray

NAME = "bound.pass_to_pass.rms_m"
_STATIONS = 8
_INSIDE = 0.05
"""Share of the passes' length that is left out at either end."""
_KNOWN_RAD = 1e-6
_LEAST_WHITE_M, _LEAST_M_S = 1e-4, 1e-4
"""Of an error that is none: the recursion divides by it."""
_ANY_S = 120.0


class Course:
    """When a path driver is where, at the speeds that it has been told.

    Raises:
        ValueError: it spins, or has fewer than two parallel passes beside one another.
    """

    def __init__(self, config: PathDriverConfig, start_e_n_heading: tuple[float, float, float]) -> None:
        planned = planned_legs(config, start_e_n_heading)
        legs = lay_out(config.path, config.speed_m_s)[1]
        self._passes = parallel_passes(planned)
        if not self._passes or any(leg.spins for leg in planned):
            raise ValueError("a course has two parallel passes at least, and no turns on the spot")
        self._along = self._passes[0].direction
        first_rad = self._passes[0].heading_rad
        self._begins_s: list[float] = []
        self._spans: list[tuple[float, float, float]] = []
        self._leg_begins_s: list[float] = []
        now_s = 0.0
        for place, leg in zip(planned, legs, strict=True):
            self._leg_begins_s.append(now_s)
            if not place.pieces:
                self._note(now_s, 0.0, place.heading_rad - first_rad, 0.0)
                now_s += leg.stop_s
            for piece in place.pieces:
                rate = leg.speed_m_s * piece.curvature_1_m
                self._note(now_s, leg.speed_m_s, piece.heading_rad - first_rad, rate)
                now_s += piece.length_m / leg.speed_m_s
        self._speeds_m_s = [leg.speed_m_s for leg in legs]

    def _note(self, begin_s: float, speed_m_s: float, heading_rad: float, rate_rad_s: float) -> None:
        self._begins_s.append(begin_s)
        self._spans.append((speed_m_s, heading_rad, rate_rad_s))

    def motion(self, t_s: float) -> tuple[float, float, float]:
        """Speed, heading against the first pass, and rate of turn at a time."""
        place = max(0, bisect_right(self._begins_s, t_s) - 1)
        speed, heading, rate = self._spans[place]
        return speed, heading + rate * (t_s - self._begins_s[place]), rate

    def times_s(self, stations: int = _STATIONS) -> FloatArray:
        """When (passes, stations) each pass is at stations evenly spread over what all have in common.

        Raises:
            ValueError: they have nothing in common.
        """
        begins = np.array([self._station(leg, 0.0) for leg in self._passes])
        ends = np.array([self._station(leg, leg.length_m) for leg in self._passes])
        low, high = np.minimum(begins, ends).max(), np.maximum(begins, ends).min()
        if low >= high:
            raise ValueError("passes that are nowhere beside one another")
        at = low + np.linspace(_INSIDE, 1.0 - _INSIDE, stations) * (high - low)
        leg_begins = np.array([self._leg_begins_s[leg.index] for leg in self._passes])
        speeds = np.array([self._speeds_m_s[leg.index] for leg in self._passes])
        times: FloatArray = leg_begins[:, np.newaxis] + np.abs(at - begins[:, np.newaxis]) / speeds[:, np.newaxis]
        return times

    def _station(self, leg: PlannedLeg, way_m: float) -> float:
        return float((np.array([leg.east_m, leg.north_m]) + way_m * leg.direction) @ self._along)


def names(scenario: Scenario) -> list[str]:
    """Names of :func:`metrics`."""
    return [] if scenario.scoring.pass_to_pass_bound_of is None else [NAME]


def metrics(scenario: Scenario) -> dict[str, FloatArray]:
    """Bound with the sensors of ``scoring.pass_to_pass_bound_of``, shape (1,).

    It is the root mean square over all pairs of passes within 15 minutes; NaN without a receiver and wheels, or without
    passes.
    """
    estimator = scenario.scoring.pass_to_pass_bound_of
    if estimator is None:
        return {}
    bound = scenario_bound_m(scenario, scenario.estimators[estimator].sensors)
    return {NAME: np.array([math.nan if bound is None else bound])}


def scenario_bound_m(scenario: Scenario, sensors: Sequence[str]) -> float | None:
    """Root mean square over all pairs of passes; None without a receiver and wheels, or without passes."""
    driver = scenario.driver
    if not isinstance(driver, PathDriverConfig):
        return None
    try:
        course = Course(driver, scenario.machine.vehicle_start)
        times = course.times_s()
    except ValueError:
        return None
    passing_m_s = course.motion(float(times[0, 0]))[0]
    errors = errors_of(scenario, sensors, speed_m_s=passing_m_s)
    if errors is None:
        return None
    sigma = between_passes(errors, course.motion, times)
    lag = times[np.newaxis, :] - times[:, np.newaxis]
    counted = np.isfinite(sigma) & (lag <= LONGEST_NS / NS_PER_S)
    return float(np.sqrt(np.mean(np.square(sigma[counted])))) if counted.any() else None


def errors_of(scenario: Scenario, sensors: Sequence[str], *, speed_m_s: float) -> GuidanceErrors | None:
    """True errors of these sensors at a speed; None without a receiver and wheels."""
    configs = [scenario.sensors[name] for name in sensors]
    receiver = next((config for config in configs if isinstance(config, GnssConfig)), None)
    if receiver is None or not any(config.kind == "wheel_encoders" for config in configs):
        return None
    state = receiver.usual_state
    errors = GuidanceErrors(
        slow_m=min(state.correlated_sigma_m[:2]),
        slow_s=max(state.correlation_s[:2]),
        jump_m=0.0 if receiver.jump_interval_s is None else min(state.jump_sigma_m[:2]),
        jump_s=receiver.jump_interval_s or _ANY_S,
        white_m=max(min(state.white_sigma_m[:2]), _LEAST_WHITE_M),
        velocity_m_s=max(math.hypot(state.velocity_noise_m_s, state.velocity_noise_ratio * speed_m_s), _LEAST_M_S),
        rate_hz=receiver.rate_hz,
        start_heading_rad=_KNOWN_RAD,
        forward_m=scenario.machine.mounts[receiver.mount].xyz_m[0],
    )
    gyro = next((config for config in configs if isinstance(config, YawGyroConfig | ImuConfig)), None)
    return errors if gyro is None else replace(errors, **_gyro_errors(gyro))


def _gyro_errors(gyro: YawGyroConfig | ImuConfig) -> dict[str, float]:
    """Of a data sheet's figures those that matter to the heading; an instability in run is taken as none."""
    prefix = "gyro_" if isinstance(gyro, ImuConfig) else ""
    noise_rad_s: float = getattr(gyro, f"{prefix}noise_rad_s")
    return {
        "gyro_rad_rts": max(noise_rad_s / math.sqrt(gyro.rate_hz), _KNOWN_RAD),
        "gyro_bias_rad_s": getattr(gyro, f"{prefix}bias_rad_s"),
        "gyro_bias_walk_rad_s_rts": getattr(gyro, f"{prefix}bias_random_walk_rad_s_rts"),
        "gyro_scale_ratio": getattr(gyro, f"{prefix}scale_error_ratio"),
    }
