"""A differential drive: two wheels on gear motors of their own, each with a speed loop.

**Command.** Speed v and yaw rate w become wheel rates, (v - w b / 2) / r on the left and (v + w b / 2) / r on the
right, with the track b and the wheels' nominal rolling radius r: the controller does not know how they slip. If one
wheel is asked for more than its motor can turn, both are slowed alike, so that the path keeps its curvature.

**Dead band.** A rate that the motor cannot hold because its gears stick is taken for zero.

**Speed loop.** The set-point follows the command with a first-order lag; proportional and integral action on the
wheel's rate, with acceleration and the gears' friction fed forward, asks for torque. A wheel that is to stand is left
without current once it is slower than the dead band; its gears hold it.

**Motor.** A permanent-magnet motor on a battery: at a share u of the full voltage, -1 to 1, its torque at the wheel is
M = M_stall (u - omega / omega_free), and its current is the stall current times M / M_stall. The friction of the gears
is a dry moment on the wheel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin.signals import Command
from twin.world.machine import Actuation
from twin.world.urdf import Urdf


@dataclass(frozen=True, slots=True, kw_only=True)
class DifferentialSpec:
    """Geometry, motors and speed loop; all torques and rates are at the wheel."""

    wheels: tuple[str, str]
    """Spin joints, left and right."""
    track_m: float
    radius_m: float
    """Nominal, what the controller counts with."""
    inertia_kg_m2: float
    """What one motor has to speed up: its wheel and rotor, and half of the mass at the wheel's radius."""
    stall_torque_n_m: float
    """Of one motor at standstill and full voltage."""
    free_rate_rad_s: float
    """Of one motor without load at full voltage."""
    stall_current_a: float
    """Of one motor."""
    gear_friction_n_m: float
    dead_band_rad_s: float
    """Wheel rates below this are not driven."""
    lag_s: float
    """Of the set-point behind the command."""
    brake_n_m: float
    """Dry moment of the brake on each wheel, beyond the gears' friction."""


_TOP_SHARE = 0.7
"""Largest wheel rate that is asked for, of the free rate: under load a motor does not reach more."""
_LOOP_1_S = 60.0
"""Bandwidth of the speed loop."""
_INTEGRAL_S = 0.05


class DifferentialDrive:
    """Implements :class:`twin.world.machine.Drive`."""

    columns: tuple[str, ...] = (
        "wheel_setpoint_left_rad_s",
        "wheel_setpoint_right_rad_s",
        "motor_torque_left_n_m",
        "motor_torque_right_n_m",
        "motor_current_a",
    )
    servos: tuple[int, ...] = ()
    steering_rad = 0.0

    def __init__(self, spec: DifferentialSpec, urdf: Urdf) -> None:
        self._spec = spec
        self._joints = [urdf.joint_index(name) for name in spec.wheels]
        self.engaged = True
        self.reset()

    def reset(self) -> None:
        """Go back to standstill."""
        self._setpoint = [0.0, 0.0]
        self._integral = [0.0, 0.0]
        self._torque = [0.0, 0.0]
        self.current_a = 0.0

    def step(
        self,
        command: Command,
        q: list[float],  # noqa: ARG002  (part of the protocol)
        qd: list[float],
        dt_s: float,
        out: Actuation,
    ) -> None:
        """Advance by one step from joint rates, and fill ``out``."""
        spec = self._spec
        powered = self.engaged and not command.brake
        wanted = self._wheel_rates(command) if powered else (0.0, 0.0)
        brake = spec.gear_friction_n_m + (spec.brake_n_m if command.brake else 0.0)
        for side, joint in enumerate(self._joints):
            if powered:
                torque = self._drive_wheel(side, wanted[side], qd[joint], dt_s)
            else:
                torque = self._setpoint[side] = self._integral[side] = 0.0
            self._torque[side] = torque
            out.torque_n_m[joint] = torque
            out.brake_n_m[joint] = brake
        drawn = abs(self._torque[0]) + abs(self._torque[1])
        self.current_a = spec.stall_current_a * drawn / spec.stall_torque_n_m

    def _wheel_rates(self, command: Command) -> tuple[float, float]:
        """Rates of the left and the right wheel that a command asks for, rad/s."""
        spec = self._spec
        difference = 0.5 * command.yaw_rate_rad_s * spec.track_m
        left = (command.speed_m_s - difference) / spec.radius_m
        right = (command.speed_m_s + difference) / spec.radius_m
        top = _TOP_SHARE * spec.free_rate_rad_s
        share = top / max(abs(left), abs(right), top)
        left, right = (rate * share if abs(rate) >= spec.dead_band_rad_s else 0.0 for rate in (left, right))
        return left, right

    def _drive_wheel(self, side: int, wanted: float, rate: float, dt_s: float) -> float:
        """Torque of one motor, N m."""
        spec = self._spec
        change = (wanted - self._setpoint[side]) * dt_s / (spec.lag_s + dt_s)
        self._setpoint[side] += change
        if wanted == 0.0 and max(abs(rate), abs(self._setpoint[side])) < spec.dead_band_rad_s:
            self._setpoint[side] = self._integral[side] = 0.0
            return 0.0
        gain = spec.inertia_kg_m2 * _LOOP_1_S
        error = self._setpoint[side] - rate
        forward = spec.inertia_kg_m2 * change / dt_s + math.copysign(spec.gear_friction_n_m, self._setpoint[side])
        asked = gain * error + self._integral[side] + forward
        generated = rate / spec.free_rate_rad_s
        voltage = asked / spec.stall_torque_n_m + generated
        bounded = math.copysign(min(abs(voltage), 1.0), voltage)
        if voltage == bounded:
            self._integral[side] += gain / _INTEGRAL_S * error * dt_s
        return spec.stall_torque_n_m * (bounded - generated)

    def diagnostics(self) -> tuple[float, ...]:
        """Set-points of the wheels' rates, torques of the motors, their current."""
        return *self._setpoint, *self._torque, self.current_a
