"""The pulse output that ground-speed sensors share, and the counter that reads it.

A sensor gives so many pulses per metre, none below its minimum speed. Each sample divides the pulses since the last one
it used by the time between these two pulses, read from a timer with a finite step. Without a new pulse it holds
its value, and reads zero once it has waited longer than one period at minimum speed.

The pulse rate within one sample interval is the one of its end.
"""

from __future__ import annotations

import math

import numpy as np

from twin.sensors import kernels
from twin.sensors.noise import Streams
from twin.signals import FloatArray

SPEED_AND_PULSES = ("speed_m_s", "pulses")
"""What a counter reads in one interval: speed from the pulses' period, and how many there were."""


class PulseCounter:
    """Speed from the time between pulses, for the runs of ``streams``; each starts at a phase of its own."""

    def __init__(
        self, *, pulses_per_m: float, minimum_speed_m_s: float, timer_resolution_s: float, streams: Streams
    ) -> None:
        self._pulses_per_m = pulses_per_m
        self._timer_s = timer_resolution_s
        self._minimum_m_s = minimum_speed_m_s
        minimum_hz = pulses_per_m * minimum_speed_m_s
        self._patience_s = 1.0 / minimum_hz if minimum_hz > 0.0 else math.inf
        self._phase = streams.uniform("start_phase", 1).next()[:, 0].copy()
        self._last_s = np.full(len(self._phase), np.nan)
        self._reading = np.zeros(len(self._phase))

    def step(self, speed: FloatArray, t_s: float, interval_s: float) -> FloatArray:
        """Count over one interval at this ``speed`` (R,); return reading and count, (R, 2)."""
        out = np.empty((len(speed), 2))
        kernels.count_pulses(
            speed,
            self._phase,
            self._last_s,
            self._reading,
            out,
            t_s,
            interval_s,
            self._pulses_per_m,
            self._minimum_m_s,
            self._timer_s,
            self._patience_s,
        )
        return out
