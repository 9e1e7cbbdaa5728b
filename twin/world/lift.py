"""A lift: what moves a machine's implement up and down when a command asks for a speed.

A hydraulic cylinder behind a proportional valve: the valve stays shut for commands within its dead band, opens after a
dead time, and the speed follows with a first-order lag, limited by the pump's flow, a little less upwards against the
load than downwards. Near its ends the cylinder is cushioned. Without a command it stays where it is: a servo holds the
position that the speed has led to, with all the force it needs. The plate of a bench in somebody's hand is the same
thing without valve.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from twin.world.machine import Actuation
from twin.world.urdf import Urdf

LIFT_COLUMNS = ("lift_asked_m_s", "lift_rate_m_s")
"""What :meth:`Lift.diagnostics` says."""
_SERVO_1_S = 25.0
_CUSHION_S = 0.05
"""Time constant with which the speed falls as an end comes near."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftSpec:
    """Travel and valve."""

    joint: str
    lowest_m: float
    """Lower end of the travel, in the joint's coordinate."""
    highest_m: float
    fastest_up_m_s: float
    fastest_down_m_s: float
    lag_s: float
    """Of the speed behind the valve."""
    dead_time_s: float = 0.0
    """From command to valve."""
    dead_band_m_s: float = 0.0
    """Commands up to this leave the valve shut."""


class Lift:
    """One slide and its actuator."""

    def __init__(self, spec: LiftSpec, urdf: Urdf) -> None:
        self._spec = spec
        self.joint = urdf.joint_index(spec.joint)
        self.reset()

    def reset(self) -> None:
        """Stand still at the joint's zero, with no command on its way."""
        self._on_the_way: deque[float] = deque()
        self._asked_m_s = self._rate_m_s = self._place_m = 0.0

    def step(self, asked_m_s: float, q: list[float], dt_s: float, out: Actuation) -> None:
        """Advance by one step towards the speed asked for, from the joint positions, and fill ``out``."""
        spec = self._spec
        self._asked_m_s = asked_m_s
        self._on_the_way.append(asked_m_s)
        wanted = self._on_the_way.popleft() if len(self._on_the_way) > round(spec.dead_time_s / dt_s) else 0.0
        if abs(wanted) <= spec.dead_band_m_s:
            wanted = 0.0
        wanted = min(max(wanted, -spec.fastest_down_m_s), spec.fastest_up_m_s)
        rate = self._rate_m_s + (wanted - self._rate_m_s) * dt_s / (spec.lag_s + dt_s)
        to_top, to_bottom = spec.highest_m - self._place_m, self._place_m - spec.lowest_m
        self._rate_m_s = min(max(rate, -to_bottom / _CUSHION_S), to_top / _CUSHION_S)
        self._place_m += self._rate_m_s * dt_s
        out.servo_rad_s[self.joint] = self._rate_m_s + _SERVO_1_S * (self._place_m - q[self.joint])

    def diagnostics(self) -> tuple[float, ...]:
        """Values of ``LIFT_COLUMNS``: the speed asked for, the speed that valve and oil give."""
        return self._asked_m_s, self._rate_m_s
