"""How well any causal filter could know the row speeds: the steady covariance of a Kalman filter with the true noise.

The filter of this bound knows all that real ones have to find out: attitude and with it gravity, every bias and scale
error, the wheels' slip, the direction of travel. What is left to it are its sensors' random errors and their lags.
Its state is the speed v; each radar's lagged speed L; each receiver's lagged speed G and place along the track p, both
kept for as many steps as a sample is late, and the correlated error c of its positions. The mean accelerometer of all
units drives v over the step T:

    v+ = v + T (a + n_a),   L+ = L + (1 - e^{-T/tau_L}) ((v + v+) / 2 + n_r - L),   p+ = p + T (v + v+) / 2
    G+ = e^{-T/tau_G} G + the first-order response to a ramp from v to v+,   c+ = e^{-T/tau_c} c + n_c

Observed are L, the delayed G with the receiver's speed noise, and the delayed p + c with its white position noise, each
at its rate. Positions count: white by a millimetre, as with RTK, they tell the speed over half a second as well as a
radar does. The Riccati recursion runs to its periodic steady state. A row at y adds the noise of the mean gyroscope,
y sigma_w; the mean absolute error of a normal error of standard deviation sigma is sqrt(2 / pi) sigma. Pitching and
heaving in the radar's beam, the start and changes of speed make a real filter worse; AccoSats are left out, and
receivers count in their usual fix state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.scenario import Scenario
from twin.sensors.gnss_config import GnssConfig
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


@dataclass(frozen=True, slots=True)
class _Seen:
    """A scalar observation: the sum of some states, every so many steps, with white noise."""

    places: tuple[int, ...]
    every: int
    variance: float


class _Model:
    """The state in the making; its first is the speed. ``F`` (n, n) and ``Q`` (n, n) grow sensor by sensor."""

    def __init__(self, *, accel: float, step_s: float) -> None:
        self.step_s = step_s
        self.seen: list[_Seen] = []
        self._drive = accel * step_s**2
        self._rows: list[dict[int, float]] = [{0: 1.0}]
        self._by_speed_noise = [1.0]
        self._own_variance = [0.0]
        self._at_start = [1.0]

    def _add(
        self, row: dict[int, float], *, by_speed_noise: float = 0.0, variance: float = 0.0, at_start: float = 1.0
    ) -> int:
        self._rows.append(row)
        self._by_speed_noise.append(by_speed_noise)
        self._own_variance.append(variance)
        self._at_start.append(at_start)
        return len(self._rows) - 1

    def _delayed(self, place: int, steps: int) -> int:
        for _ in range(steps):
            place = self._add({place: 1.0})
        return place

    def _every(self, rate_hz: float) -> int:
        return max(1, round(1.0 / (rate_hz * self.step_s)))

    def add_radar(self, radar: RadarConfig) -> None:
        """A lag over the mean speed of the step; its own samples' noise, whatever their rate."""
        gain, own = _gain(radar.lag_speeding_up_s, self.step_s), _gain(radar.lag_speeding_up_s, 1.0 / radar.rate_hz)
        share = own / (2.0 - own) * (2.0 - gain) / gain
        at = len(self._rows)
        variance = (gain * radar.speed_noise_m_s) ** 2 * share
        self._add({0: gain, at: 1.0 - gain}, by_speed_noise=0.5 * gain, variance=variance)
        self.seen.append(_Seen((at,), self._every(radar.rate_hz), _COUNTER_M_S**2))

    def add_receiver(self, receiver: GnssConfig, *, speed_m_s: float) -> None:
        """Lagged velocity and position along the track, both late, and the position's correlated error."""
        state, step_s = receiver.usual_state, self.step_s
        late = math.ceil((receiver.latency_s + receiver.latency_jitter_s) / step_s - 1e-9)
        gain, at = _gain(receiver.velocity_lag_s, step_s), len(self._rows)
        end = 1.0 - receiver.velocity_lag_s / step_s * gain
        self._add({0: gain, at: 1.0 - gain}, by_speed_noise=end)
        noise = state.velocity_noise_m_s**2 + (state.velocity_noise_ratio * speed_m_s) ** 2
        every = self._every(receiver.rate_hz)
        self.seen.append(_Seen((self._delayed(at, late),), every, noise))
        at = len(self._rows)
        self._add({0: step_s, at: 1.0}, by_speed_noise=0.5 * step_s)
        place, error = self._delayed(at, late), len(self._rows)
        # either axis alike: the mean of east and north
        correlated, white = (
            float(np.square(sigma_m[:2]).mean()) for sigma_m in (state.correlated_sigma_m, state.white_sigma_m)
        )
        keep = math.exp(-step_s / float(np.mean(state.correlation_s[:2])))
        self._add({error: keep}, variance=correlated * (1.0 - keep * keep), at_start=correlated)
        self.seen.append(_Seen((place, error), every, white))

    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """F, Q and the covariance at the start; slow errors start with their own, which 80 s would not forget."""
        F = np.zeros((len(self._rows), len(self._rows)))
        for at, row in enumerate(self._rows):
            for place, value in row.items():
                F[at, place] = value
        drive = np.array(self._by_speed_noise)
        return F, self._drive * np.outer(drive, drive) + np.diag(self._own_variance), np.diag(self._at_start)


def _steady_variance(
    radars: Sequence[RadarConfig], receivers: Sequence[GnssConfig], *, accel: float, step_s: float, speed_m_s: float
) -> float:
    """Variance of the speed after the updates of a step, mean over the period of the receivers, (m/s)^2."""
    model = _Model(accel=accel, step_s=step_s)
    for radar in radars:
        model.add_radar(radar)
    for receiver in receivers:
        model.add_receiver(receiver, speed_m_s=speed_m_s)
    return _riccati(*model.matrices(), model.seen)


def _gain(lag_s: float, step_s: float) -> float:
    return 1.0 - math.exp(-step_s / lag_s) if lag_s > 0.0 else 1.0


def _riccati(F: FloatArray, Q: FloatArray, P: FloatArray, seen: Sequence[_Seen]) -> float:
    kept: list[float] = []
    for step in range(_STEPS):
        P = F @ P @ F.T + Q
        for one in seen:
            if step % one.every == 0:
                PHt = P[:, one.places].sum(axis=1)
                S = PHt[list(one.places)].sum() + one.variance
                P = P - np.outer(PHt, PHt) / S if S > 0.0 else P
                P = 0.5 * (P + P.T)
        if step >= _STEPS - _LAST:
            kept.append(float(P[0, 0]))
    return float(np.mean(kept))
