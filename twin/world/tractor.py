"""A tractor's drive: continuously variable transmission to the rear axle, Ackermann steering, brakes.

Speed: a governor (proportional and integral on the mean rear wheel speed, as a transmission controller has it) asks
for axle torque, which follows with a first-order lag, within limits; an open differential halves it. The set-point
follows the command with limited acceleration. Steering: the wheel angle follows the command with a first-order lag, a
rate limit and end stops; the two front wheels stand on one centre (Ackermann). These figures are choices in the range
of medium tractors; a hydraulic steering rate near 0.4 rad/s takes about 3 s from stop to stop. Any front-steered,
rear-driven machine can have it, with figures of its own, and so can one with driven front wheels: their axle gets a
share of the force, and a shaft between the axles, seen as a damper, keeps one from spinning while the other grips.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin.signals import Command
from twin.world.machine import DRIVE_TORQUE, STEERING, Actuation
from twin.world.urdf import Urdf


@dataclass(frozen=True, slots=True, kw_only=True)
class TractorSpec:
    """Geometry and actuator figures."""

    wheelbase_m: float
    front_track_m: float
    """Between the steering axes."""
    rear_wheels: tuple[str, str]
    """Spin joints, left and right."""
    knuckles: tuple[str, str]
    """Steering joints, left and right."""
    rolling_radius_m: float
    """Of the loaded rear wheels: turns their speed into what the driver reads."""
    total_mass_kg: float
    """What the governor has to move; sets its gains."""
    largest_force_n: float
    """Traction force the transmission can ask for."""
    acceleration_m_s2: float = 1.0
    """Largest change of the speed set-point, both ways."""
    torque_lag_s: float = 0.15
    governor_1_s: float = 3.0
    """Bandwidth of the speed loop: force per speed error, over the mass. A load F slows the machine by at most about
    F / (mass * bandwidth) before the integral takes it."""
    integral_s: float = 1.5
    """Time in which the integral takes over what a steady error asks for."""
    steering_lag_s: float = 0.15
    steering_rate_rad_s: float = 0.4
    largest_steering_rad: float = math.radians(40.0)
    """End stop of the equivalent single wheel."""
    brake_n_m: float = 30_000.0
    """Dry moment of each rear brake."""
    front_wheels: tuple[str, str] | None = None
    """Spin joints of driven front wheels, left and right."""
    front_radius_m: float = 0.0
    """Of the loaded driven front wheels."""
    front_share: float = 0.0
    """Part of the traction force that driven front wheels get."""
    coupling_n_s_m: float = 0.0
    """Force that goes to the slower axle per difference of the speeds at which the axles' wheels roll."""


_SERVO_1_S = 25.0


class TractorDrive:
    """Implements :class:`twin.world.machine.Drive`."""

    columns: tuple[str, ...] = (STEERING, DRIVE_TORQUE, "speed_setpoint_m_s")

    def __init__(self, spec: TractorSpec, urdf: Urdf) -> None:
        self._spec = spec
        self._left, self._right = (urdf.joint_index(name) for name in spec.rear_wheels)
        self._knuckle_left, self._knuckle_right = (urdf.joint_index(name) for name in spec.knuckles)
        self._front = tuple(urdf.joint_index(name) for name in spec.front_wheels or ())
        self.servos: tuple[int, ...] = (self._knuckle_left, self._knuckle_right)
        self.engaged = True
        self.current_a = 0.0
        self.reset()

    def reset(self) -> None:
        """Go back to standstill, wheels straight."""
        self.steering_rad = self._setpoint_m_s = self._integral_n = self._force_n = 0.0

    def step(self, command: Command, q: list[float], qd: list[float], dt_s: float, out: Actuation) -> None:
        """Advance by one step from joint angles and rates, and fill ``out``."""
        self._steer(command.steering_rad, q, dt_s, out)
        force = 0.0
        if command.brake or not self.engaged:
            self._setpoint_m_s = self._integral_n = self._force_n = 0.0
        else:
            force = self._govern(command.speed_m_s, 0.5 * (qd[self._left] + qd[self._right]), dt_s)
        to_front = self._to_front_n(force, qd) if self._front else 0.0
        brake = self._spec.brake_n_m if command.brake else 0.0
        for joint in (self._left, self._right):
            out.torque_n_m[joint] = 0.5 * (force - to_front) * self._spec.rolling_radius_m
            out.brake_n_m[joint] = brake
        for joint in self._front:
            out.torque_n_m[joint] = 0.5 * to_front * self._spec.front_radius_m

    def _govern(self, wanted_m_s: float, wheel_rad_s: float, dt_s: float) -> float:
        spec = self._spec
        limit = spec.acceleration_m_s2 * dt_s
        change = min(max(wanted_m_s - self._setpoint_m_s, -limit), limit)
        self._setpoint_m_s += change
        error = self._setpoint_m_s - wheel_rad_s * spec.rolling_radius_m
        gain = spec.governor_1_s * spec.total_mass_kg
        asked = gain * error + self._integral_n + spec.total_mass_kg * change / dt_s
        bounded = min(max(asked, -spec.largest_force_n), spec.largest_force_n)
        if asked == bounded:
            self._integral_n += gain / spec.integral_s * error * dt_s
        self._force_n += (bounded - self._force_n) * dt_s / (spec.torque_lag_s + dt_s)
        return self._force_n

    def _to_front_n(self, force_n: float, qd: list[float]) -> float:
        spec = self._spec
        rear = 0.5 * (qd[self._left] + qd[self._right]) * spec.rolling_radius_m
        front = 0.5 * sum(qd[joint] for joint in self._front) * spec.front_radius_m
        return spec.front_share * force_n + spec.coupling_n_s_m * (rear - front)

    def _steer(self, wanted_rad: float, q: list[float], dt_s: float, out: Actuation) -> None:
        spec = self._spec
        wanted = min(max(wanted_rad, -spec.largest_steering_rad), spec.largest_steering_rad)
        rate = (wanted - self.steering_rad) / (spec.steering_lag_s + dt_s)
        self.steering_rad += min(max(rate, -spec.steering_rate_rad_s), spec.steering_rate_rad_s) * dt_s
        left, right = ackermann(self.steering_rad, spec.wheelbase_m, spec.front_track_m)
        out.servo_rad_s[self._knuckle_left] = _SERVO_1_S * (left - q[self._knuckle_left])
        out.servo_rad_s[self._knuckle_right] = _SERVO_1_S * (right - q[self._knuckle_right])

    def diagnostics(self) -> tuple[float, ...]:
        """Steering angle of the equivalent single wheel, axle torque, speed set-point."""
        return self.steering_rad, self._force_n * self._spec.rolling_radius_m, self._setpoint_m_s


def ackermann(steering_rad: float, wheelbase_m: float, track_m: float) -> tuple[float, float]:
    """Angles of the left and right front wheel whose axes meet the rear axle's line in one point, rad."""
    tangent = math.tan(steering_rad)
    half = 0.5 * track_m * tangent
    left = math.atan2(wheelbase_m * tangent, wheelbase_m - half)
    right = math.atan2(wheelbase_m * tangent, wheelbase_m + half)
    return left, right
