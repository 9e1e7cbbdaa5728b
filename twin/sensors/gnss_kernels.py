"""The GNSS receiver's loops over runs, compiled; as in :mod:`twin.sensors.kernels` each run is handled by itself."""

from __future__ import annotations

import numpy as np

from twin.compiled import compiled
from twin.signals import FloatArray, IntArray

NEVER = 2**62
"""An instant that does not come, ns. Its negative: one that has never been; an age from there exceeds any time-out."""
NS_TO_S = 1e-9
WHITE, VELOCITY, DRIFT = 3, 6, 8
"""Where the white numbers, those of the velocity and those of the age drift begin among a sample's normal numbers."""


@compiled
def fix_states(  # noqa: PLR0917 - compiled functions are called by position
    t_ns: int,
    reference_ns: IntArray,
    satellites: int,
    until_ns: IntArray,
    needed: IntArray,
    acquire_ns: FloatArray,
    acquire_spread: FloatArray,
    ready_ns: IntArray,
    normals: FloatArray,
    used: IntArray,
    index: IntArray,
    allowed: IntArray,
) -> int:
    """One step of the fix-state machine; returns how many of a run's ``normals`` are used up at most.

    ``reference_ns`` (R,) is the epoch of the newest corrections; the tables (S,) describe the states, best first.
    ``ready_ns`` (R, S), ``used``, ``index`` and ``allowed`` (R,) change in place. A state becomes ready
    ``acquire`` after its conditions have come to hold; the receiver is in the first that is ready, S if none is.
    """
    states = until_ns.shape[0]
    most = 0
    for run in range(index.shape[0]):
        age_ns = t_ns - reference_ns[run]
        first_allowed = states
        state = states
        for s in range(states):
            if satellites < needed[s] or age_ns >= until_ns[s]:
                ready_ns[run, s] = NEVER
                continue
            if ready_ns[run, s] == NEVER:
                wait_ns = np.int64(0)
                if acquire_ns[s] > 0.0:
                    wait_ns = np.int64(np.rint(acquire_ns[s] * np.exp(acquire_spread[s] * normals[run, used[run]])))
                    used[run] += 1
                ready_ns[run, s] = t_ns + wait_ns
            first_allowed = min(first_allowed, s)
            if state == states and ready_ns[run, s] <= t_ns:
                state = s
        index[run] = state
        allowed[run] = first_allowed
        most = max(most, used[run])
    return most


@compiled
def position_errors(  # noqa: PLR0917 - compiled functions are called by position
    step: int,
    t_ns: int,
    reference_ns: IntArray,
    index: IntArray,
    allowed: IntArray,
    sigma: FloatArray,
    white_sigma: FloatArray,
    decay_rate: FloatArray,
    keep: FloatArray,
    entry: FloatArray,
    growth_keep: FloatArray,
    settling_keep: FloatArray,
    age_drift: FloatArray,
    dilution: FloatArray,
    unit: FloatArray,
    unit_step: IntArray,
    last: IntArray,
    share: FloatArray,
    drift: FloatArray,
    drift_keep: float,
    normals: FloatArray,
    correlated: FloatArray,
    error: FloatArray,
) -> None:
    """Advance the position errors of R receivers by one sample.

    The tables (S,) and (S, 3) describe the states. ``unit`` (R, S, 3) holds one Gauss-Markov process of variance one
    per state, each as it was at sample ``unit_step`` (R, S): only the present state's is advanced, over all the time
    since it was last used. ``last`` (R,) is the state before, ``share`` (R,) the present part of the state's sigma,
    ``drift`` (R, 3) a process of variance one for old corrections. ``normals`` has (R, 6 or more) columns: three for
    ``unit``, three white, and from DRIFT on three for ``drift`` where there is one. ``correlated`` and ``error`` (R, 3)
    are written; zero where there is no position.
    """
    drifting = normals.shape[1] > DRIFT
    drift_drive = np.sqrt(1.0 - drift_keep * drift_keep)
    for run in range(index.shape[0]):
        s = index[run]
        if drifting:
            for k in range(3):
                drift[run, k] = drift[run, k] * drift_keep + normals[run, DRIFT + k] * drift_drive
        if s >= sigma.shape[0]:
            last[run] = s
            for k in range(3):
                correlated[run, k] = 0.0
                error[run, k] = 0.0
            continue
        if s != last[run]:
            share[run] = entry[s] if last[run] < s else 1.0
            last[run] = s
        else:
            acquiring = allowed[run] < s
            target = entry[s] if acquiring else 1.0
            kept = settling_keep[s] if acquiring else growth_keep[s]
            share[run] = target + (share[run] - target) * kept
        age_s = (t_ns - reference_ns[run]) * NS_TO_S if reference_ns[run] > -NEVER else 0.0
        steps = step - unit_step[run, s]
        unit_step[run, s] = step
        for k in range(3):
            kept = keep[s, k] if steps == 1 else np.exp(-steps * decay_rate[s, k])
            unit[run, s, k] = unit[run, s, k] * kept + normals[run, k] * np.sqrt(1.0 - kept * kept)
            slow = unit[run, s, k] * sigma[s, k] * share[run] * dilution[s]
            slow += age_s * age_drift[s, k] * drift[run, k]
            correlated[run, k] = slow
            error[run, k] = slow + normals[run, WHITE + k] * white_sigma[s, k] * dilution[s]


@compiled
def speed_and_course(  # noqa: PLR0917 - compiled functions are called by position
    east_m_s: float,
    north_m_s: float,
    true_speed_m_s: float,
    index: IntArray,
    still_noise: FloatArray,
    noise_ratio: FloatArray,
    normals: FloatArray,
    first: int,
    values: FloatArray,
) -> None:
    """Write modulus and direction of a velocity with noise into two columns of ``values`` (R, n), from ``first`` on.

    The noise of each component is ``still_noise`` and ``noise_ratio`` times the speed in quadrature, by state.
    """
    for run in range(index.shape[0]):
        s = min(index[run], still_noise.shape[0] - 1)
        moving = noise_ratio[s] * true_speed_m_s
        sigma = np.sqrt(still_noise[s] * still_noise[s] + moving * moving)
        east = east_m_s + sigma * normals[run, VELOCITY]
        north = north_m_s + sigma * normals[run, VELOCITY + 1]
        values[run, first] = np.sqrt(east * east + north * north)
        values[run, first + 1] = np.arctan2(north, east)


@compiled
def receiver_reports(  # noqa: PLR0917 - compiled functions are called by position
    t_ns: int,
    reference_ns: IntArray,
    index: IntArray,
    satellites: int,
    sigma: FloatArray,
    age_drift: FloatArray,
    numbers: FloatArray,
    dilution: FloatArray,
    first: int,
    values: FloatArray,
) -> None:
    """Write what R receivers say of themselves into the columns from ``first`` on; ``values`` (R, n).

    Three sigmas, quality, satellites, HDOP, VDOP, age of corrections. ``numbers`` (S, 5) has quality, satellites,
    HDOP, VDOP of the states and whether corrections are in use. Without a position everything measured is NaN.
    """
    for run in range(index.shape[0]):
        s = index[run]
        if s >= sigma.shape[0]:
            for k in range(values.shape[1]):
                values[run, k] = np.nan
            values[run, first + 3] = 0.0
            values[run, first + 4] = min(numbers[0, 1], satellites)
            continue
        known = numbers[s, 4] > 0.0 and reference_ns[run] > -NEVER
        age_s = (t_ns - reference_ns[run]) * NS_TO_S if known else np.nan
        for k in range(3):
            value = sigma[s, k] * dilution[s]
            if known and age_drift[s, k] > 0.0:
                grown = age_drift[s, k] * age_s
                value = np.sqrt(value * value + grown * grown)
            values[run, first + k] = value
        values[run, first + 3] = numbers[s, 0]
        values[run, first + 4] = min(numbers[s, 1], satellites)
        values[run, first + 5] = numbers[s, 2] * dilution[s]
        values[run, first + 6] = numbers[s, 3] * dilution[s]
        values[run, first + 7] = age_s
