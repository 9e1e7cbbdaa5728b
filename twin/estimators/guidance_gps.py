"""The receiver's own position, course and speed, held from sample to sample (kind ``guidance_gps``).

What a guidance system shows that has nothing but a receiver. A sample counts as current from when it arrives, however
late that is: at 1 Hz and 1.1 m/s the position shown is up to 1.1 m, and the latency's way, behind.

The reference frame lies at the antenna less its lever arm, turned by the last course that was one. Course is the
direction in which the antenna travels: on a machine that reverses it points backwards; at an antenna a metres ahead of
the rear axle it leads the heading by atan(a omega / v) in a turn; slower than ``course_from_m_s`` it is noise and not
taken. A receiver that tells neither speed nor course (bare GGA sentences) moves as its positions do: speed and course
are those of the way from one sample to the next.

Sigmas are those the receiver reports of its position, for what they are worth.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.estimators.guidance_base import GuidanceConfig, GuidanceOutput, guidance_sensors
from twin.estimators.guidance_fix_kernels import motion_of
from twin.estimators.guidance_readers import Fix, FixReader
from twin.estimators.roles import GNSS
from twin.signals import POSITION, Estimate, EstimatorSetup, FloatArray, IntArray, Measurement

KIND = "guidance_gps"
_LONGEST_WAY_S = 5.0
"""Between two samples farther apart in time, the way is not a velocity."""


class GuidanceGpsConfig(GuidanceConfig):
    """Options of :class:`GuidanceGps`."""

    kind: Literal["guidance_gps"]


class Motion:
    """Speed and course (R,) of a receiver: told, or of the way from fix to fix where it tells none."""

    def __init__(self, runs: int) -> None:
        self._last_ns: IntArray = np.zeros(runs, dtype=np.int64)
        self._last = np.full((runs, 2), np.nan)

    def of(self, fix: Fix) -> tuple[FloatArray, FloatArray]:
        """Speed (m/s) and course (rad) at a fix; NaN where neither is known."""
        return motion_of(
            fix.t_ns, fix.position, fix.there, fix.speed, fix.course, self._last_ns, self._last, _LONGEST_WAY_S
        )


class GuidanceGps:
    """Estimator of :class:`GuidanceGpsConfig`; columns as in :mod:`twin.estimators.guidance_base`.

    Raises:
        BadInputError: not exactly one receiver, it gives no position, or sits on another body than the reference frame.
    """

    state_columns: tuple[str, ...] = POSITION[:2]

    def __init__(self, config: GuidanceGpsConfig, setup: EstimatorSetup) -> None:
        infos = guidance_sensors(setup, estimator=KIND, kinds=(GNSS,))
        self._reader = FixReader(infos[GNSS], setup)
        self._course_from_m_s = config.course_from_m_s
        self._output = GuidanceOutput(setup.runs)
        self.columns = self._output.columns
        self._motion = Motion(setup.runs)
        self._newest_ns: int | None = None
        self._antenna = np.full((setup.runs, 2), np.nan)
        self._sigma = np.full((setup.runs, 2), np.nan)
        self._heading = np.full(setup.runs, setup.start_e_n_heading[2])
        self._speed = np.full(setup.runs, np.nan)

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival; one older than the newest is ignored."""
        if measurement.sensor != self._reader.name:
            return
        fix = self._reader.read(measurement)
        if self._newest_ns is not None and fix.t_ns <= self._newest_ns:
            return
        self._newest_ns = fix.t_ns
        there = fix.there[:, np.newaxis]
        self._antenna = np.where(there, fix.position, self._antenna)
        self._sigma = np.where(there, fix.sigma, self._sigma)
        speed, course = self._motion.of(fix)
        self._speed = np.where(np.isfinite(speed), speed, self._speed)
        moving = (speed >= self._course_from_m_s) & np.isfinite(course)  # False for NaN
        self._heading = np.where(moving, course, self._heading)

    def estimate(self, t_ns: int) -> Estimate:
        """Return what the receiver told last."""
        heading = self._heading
        arm_known = np.where(np.isfinite(heading), heading, 0.0)
        position = self._reader.reference(self._antenna, arm_known)
        state = np.column_stack([position, heading, self._speed])
        estimate = self._output.estimate(
            t_ns, state, None, sigmas=np.column_stack([self._sigma, np.full((len(state), 2), np.nan)])
        )
        covariance = np.zeros((len(state), 2, 2))
        covariance[:, 0, 0], covariance[:, 1, 1] = np.square(self._sigma).T
        return Estimate(t_ns=t_ns, values=estimate.values, sigmas=estimate.sigmas, covariance=covariance)
