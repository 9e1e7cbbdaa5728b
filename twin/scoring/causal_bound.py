"""How well any causal filter could know the row speeds: the steady covariance of a Kalman filter with the true noise.

The filter of this bound knows all that real ones have to find out: attitude and with it gravity, every bias and scale
error, the wheels' slip. What is left to it are the white noises of its sensors and their lags. Its state is the speed
v, the radar's lagged speed L and the receiver's lagged speed G, the latter kept for as many steps as a GNSS sample is
late; the mean accelerometer of all units drives v:

    v+ = v + T (a + n_a),   L+ = L + (1 - e^{-T/tau_L}) (v + n_r - L),   G+ = G + (1 - e^{-T/tau_G}) (v - G)

Observed are L at every step and the delayed G with the receiver's speed noise at its rate. The Riccati recursion runs
to its periodic steady state. A row at y adds the noise of the mean gyroscope, y sigma_w; the mean absolute error of a
normal error of standard deviation sigma is sqrt(2 / pi) sigma. Pitching and heaving in the radar's beam, the start and
changes of speed make a real filter worse; AccoSats are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.scenario import Scenario
from twin.sensors.gnss import GnssConfig
from twin.sensors.imu import ImuConfig
from twin.sensors.radar import RadarConfig
from twin.signals import FloatArray

_STEPS = 4000
_LAST = 500
_COUNTER_M_S = 0.0005
"""Reading of a pulse counter: its timer's step."""


def causal_bound_m_s(
    scenario: Scenario, sensors: Sequence[str], *, speed_m_s: float, rows_y_m: Sequence[float]
) -> float:
    """Bound on the mean absolute row-speed error (m/s), mean over rows, at a steady speed.

    NaN without an inertial unit, or without a radar or GNSS receiver: then there is no steady state.
    """
    configs = [scenario.sensors[name] for name in sensors]
    units = [config for config in configs if isinstance(config, ImuConfig)]
    radars = [config for config in configs if isinstance(config, RadarConfig)]
    receivers = [config for config in configs if isinstance(config, GnssConfig)]
    if not units or not (radars or receivers):
        return math.nan
    step_s = 1.0 / units[0].rate_hz
    accel = sum(unit.accel_noise_m_s2**2 for unit in units) / len(units) ** 2
    gyro = sum(unit.gyro_noise_rad_s**2 for unit in units) / len(units) ** 2
    variance = _steady_variance(radars, receivers, accel=accel, step_s=step_s, speed_m_s=speed_m_s)
    sigmas = [math.sqrt(variance + y * y * gyro) for y in rows_y_m]
    return math.sqrt(2.0 / math.pi) * float(np.mean(sigmas))


def _steady_variance(
    radars: Sequence[RadarConfig], receivers: Sequence[GnssConfig], *, accel: float, step_s: float, speed_m_s: float
) -> float:
    """Variance of the speed after the updates of a step, mean over the period of the receivers, (m/s)^2."""
    late = [math.ceil((receiver.latency_s + receiver.latency_jitter_s) / step_s) for receiver in receivers]
    size = 1 + len(radars) + sum(steps + 1 for steps in late)
    F, Q = np.zeros((size, size)), np.zeros((size, size))
    F[0, 0] = 1.0
    Q[0, 0] = accel * step_s**2
    seen: list[tuple[int, int, float]] = []  # place in the state, steps between samples, variance
    at = 1
    for radar in radars:
        gain = _gain(radar.lag_speeding_up_s, step_s)
        F[at, 0], F[at, at] = gain, 1.0 - gain
        Q[at, at] = (gain * radar.speed_noise_m_s) ** 2
        seen.append((at, max(1, round(1.0 / (radar.rate_hz * step_s))), _COUNTER_M_S**2))
        at += 1
    for receiver, steps in zip(receivers, late, strict=True):
        gain = _gain(receiver.velocity_lag_s, step_s)
        F[at, 0], F[at, at] = gain, 1.0 - gain
        for delay in range(1, steps + 1):
            F[at + delay, at + delay - 1] = 1.0
        state = receiver.usual_state
        noise = state.velocity_noise_m_s**2 + (state.velocity_noise_ratio * speed_m_s) ** 2
        seen.append((at + steps, max(1, round(1.0 / (receiver.rate_hz * step_s))), noise))
        at += steps + 1
    return _riccati(F, Q, seen)


def _gain(lag_s: float, step_s: float) -> float:
    return 1.0 - math.exp(-step_s / lag_s) if lag_s > 0.0 else 1.0


def _riccati(F: FloatArray, Q: FloatArray, seen: Sequence[tuple[int, int, float]]) -> float:
    P = np.eye(len(F))
    kept: list[float] = []
    for step in range(_STEPS):
        P = F @ P @ F.T + Q
        for place, every, variance in seen:
            if step % every == 0:
                K = P[:, place] / (P[place, place] + variance)
                P = P - np.outer(K, P[place])
                P = 0.5 * (P + P.T)
        if step >= _STEPS - _LAST:
            kept.append(float(P[0, 0]))
    return float(np.mean(kept))
