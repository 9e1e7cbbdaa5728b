"""From the antenna's position, velocity and acceleration to what guidance wants: where the machine is and heads.

The machine drives forwards, so the course of its antenna tells the heading; while it is slow, by the filter's speed or
the receiver's, the heading is held: where a machine brakes to a stop, a filter that takes accelerations to last goes
backwards for a moment. An antenna f metres before the reference and l to the left moves at v_a = (v - omega l, omega f)
in the machine's frame: it heads into the turn by the angle asin(omega f / |v_a|), and where the model knows an
acceleration a, omega is (v x a) / |v|^2. A model without one takes the machine to go straight: 0.06 rad for an antenna
1.5 m before the axle on a radius of 25 m, 0.09 m at the axle.

An antenna a height above the ground that leans with the machine is not set upright here: nobody tells the roll.
"""

from __future__ import annotations

import numpy as np

from twin.estimators.guidance_kinematic_kernels import turned_antenna, under_antenna
from twin.signals import BoolArray, FloatArray

_TIGHTEST_1_M = 1.0 / 4.0
"""Curvature of the tightest turn of a machine that steers; more is noise."""


class AntennaPose:
    """Pose of the reference frame from the motion of the antenna, for R members.

    Args:
        arm: antenna in the reference frame, metres forward, to the left, up.
        heading_rad: at the start.
        runs: R.
        slow_m_s: slower than this the heading is held.
    """

    def __init__(self, arm: tuple[float, float, float], heading_rad: float, runs: int, *, slow_m_s: float) -> None:
        self._slow_m_s = slow_m_s
        self._forward, self._left, self._up = arm
        self.heading: FloatArray = np.full(runs, float(heading_rad))
        """(R,) as it was last known."""
        self._stands: BoolArray = np.zeros(runs, dtype=np.bool_)

    def turn(self, velocity: FloatArray, acceleration: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Heading and speed of the reference (R,), from east and north (R, 2) of the antenna's motion.

        Where ``known`` (R,) is False, or the antenna is slow, the heading is the one last known.
        """
        return turned_antenna(
            np.ascontiguousarray(velocity),
            np.ascontiguousarray(acceleration),
            known & ~self._stands,
            self.heading,
            self._forward,
            self._left,
            self._slow_m_s,
            _TIGHTEST_1_M,
        )

    def hear(self, speed: FloatArray, new: BoolArray) -> None:
        """Take the speed (R,) that the receiver tells with a new fix; NaN where it tells none."""
        self._stands = np.where(new, speed < self._slow_m_s, self._stands)

    def keep(self, heading: FloatArray) -> None:
        """Remember a heading (R,) at a fix."""
        self.heading = heading

    def place(self, antenna: FloatArray, heading: FloatArray) -> FloatArray:
        """Position (R, 3) of the reference under an antenna (R, 3)."""
        return under_antenna(np.ascontiguousarray(antenna), heading, (self._forward, self._left, self._up))
