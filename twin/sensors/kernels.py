"""The loops over runs that happen at every sample, compiled.

Each handles one run after the other in scalar arithmetic, in the order written and without fast-math, so that a run's
numbers are the same whatever other runs there are. Arrays are C-contiguous float64 of exactly the shapes stated, runs
first: nothing is broadcast and no bound is checked.
"""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import FloatArray


@compiled
def gauss_markov(value: FloatArray, keep: FloatArray, drive: FloatArray, normals: FloatArray) -> None:
    """``value = keep value + drive normals`` in place; all (R, n)."""
    for run in range(value.shape[0]):
        for k in range(value.shape[1]):
            value[run, k] = value[run, k] * keep[run, k] + normals[run, k] * drive[run, k]


@compiled
def random_walk(value: FloatArray, drive: FloatArray, normals: FloatArray) -> None:
    """``value += drive normals`` in place; (R, n), drive (n,)."""
    for run in range(value.shape[0]):
        for k in range(value.shape[1]):
            value[run, k] += normals[run, k] * drive[k]


@compiled
def low_pass(value: FloatArray, gain: FloatArray, target: FloatArray) -> None:
    """``value += gain (target - value)`` in place; (R, n), gain (n,)."""
    for run in range(value.shape[0]):
        for k in range(value.shape[1]):
            value[run, k] += gain[k] * (target[run, k] - value[run, k])


@compiled
def quantise(values: FloatArray, lsb: FloatArray, low: FloatArray, high: FloatArray) -> None:
    """Clip and round in place; values (R, n), the others (n,)."""
    for run in range(values.shape[0]):
        for k in range(values.shape[1]):
            value = min(max(values[run, k], low[k]), high[k])
            if lsb[k] > 0.0:
                value = np.rint(value / lsb[k]) * lsb[k]
            values[run, k] = value


@compiled
def wrap(values: FloatArray, column: int) -> None:
    """Wrap one column of ``values`` (R, n) into (-pi, pi] in place, as :func:`twin.geometry.wrap_angle` does."""
    for run in range(values.shape[0]):
        angle = values[run, column]
        values[run, column] = angle - 2.0 * np.pi * np.ceil((angle - np.pi) / (2.0 * np.pi))


@compiled
def two_triads(sensitivity: FloatArray, truth: FloatArray, out: FloatArray) -> None:
    """Write ``out = T truth`` for two three-axis sensors; sensitivity (R, 6, 3), truth (6,), out (R, 6)."""
    for run in range(out.shape[0]):
        for k in range(6):
            first = 3 * (k // 3)
            out[run, k] = (
                sensitivity[run, k, 0] * truth[first]
                + sensitivity[run, k, 1] * truth[first + 1]
                + sensitivity[run, k, 2] * truth[first + 2]
            )


@compiled
def hidden_row(values: FloatArray, truth: FloatArray, extra: FloatArray, clock_error_s: float, out: FloatArray) -> None:
    """Write errors of the first columns, extra hidden values and clock error into ``out`` (R, m)."""
    errors = out.shape[1] - extra.shape[1] - 1
    for run in range(out.shape[0]):
        for k in range(errors):
            out[run, k] = values[run, k] - truth[k]
        for k in range(extra.shape[1]):
            out[run, errors + k] = extra[run, k]
        out[run, -1] = clock_error_s


@compiled
def two_way_lag(  # noqa: PLR0917 - compiled functions are called by position
    speed: FloatArray,
    output: FloatArray,
    difference: FloatArray,
    gain: FloatArray,
    gain_up: float,
    gain_down: float,
    gain_difference: float,
    threshold: float,
) -> None:
    """One step of a lag with two time constants; ``output``, ``difference`` and ``gain`` (R,) change in place."""
    for run in range(speed.shape[0]):
        change = speed[run] - output[run]
        difference[run] += gain_difference * (change - difference[run])
        if difference[run] > threshold:
            gain[run] = gain_up
        elif difference[run] < -threshold:
            gain[run] = gain_down
        output[run] += gain[run] * change


@compiled
def count_pulses(  # noqa: PLR0917 - compiled functions are called by position
    speed: FloatArray,
    phase: FloatArray,
    last_s: FloatArray,
    reading: FloatArray,
    out: FloatArray,
    t_s: float,
    interval_s: float,
    pulses_per_m: float,
    minimum_m_s: float,
    timer_s: float,
    patience_s: float,
) -> None:
    """Count pulses over one interval at ``speed``, none below the minimum, and read speed from their period.

    ``phase`` (part of a pulse), ``last_s`` (when the last pulse came by the timer, NaN if none is of use) and
    ``reading`` (R,) change in place; ``out`` (R, 2) gets reading and count.
    """
    for run in range(speed.shape[0]):
        frequency = speed[run] * pulses_per_m if speed[run] >= minimum_m_s else 0.0
        total = phase[run] + frequency * interval_s
        pulses = np.floor(total)
        phase[run] = total - pulses
        if pulses > 0.0:
            pulse_s = np.floor((t_s - phase[run] / frequency) / timer_s) * timer_s
            if pulse_s > last_s[run]:  # False too while there is no pulse before
                reading[run] = pulses / ((pulse_s - last_s[run]) * pulses_per_m)
            last_s[run] = pulse_s
        if t_s - last_s[run] > patience_s:
            reading[run] = 0.0
            last_s[run] = np.nan
        out[run, 0] = reading[run]
        out[run, 1] = pulses
