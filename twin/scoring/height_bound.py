"""How well any causal filter could know the height through a loss of fixes: the covariance with the true noise.

The filter of this bound knows all that real ones have to find out: attitude, offsets and outliers of the
accelerometer, which fixes are right, the receiver's lag; and its samples are never late. What is left are random
errors. Its state is height h, vertical velocity v, the accelerometer's in-run instability b, and the receiver's slow
errors: c of a fix, d per second of age of its corrections, k of each lesser state, s of the vertical speed.

    h' = v,   v' = a - b + w,   every slow error a Gauss-Markov process
    seen: h + c + (age) d + white,   or h + k + white,   and v + s + white
    (few satellites dilute c, k, s and what is white)

The Riccati recursion runs at the receiver's rate, first to its steady state with fixes, then through the loss. All
errors are normal and all is linear, so that no filter can be better. As in the receiver, the slow error of a state goes
on while it is in another, and a lesser state's that is still growing (:mod:`twin.sensors.gnss_errors`) has the size it
has grown to. What an attitude error makes of level acceleration,
and all that has to be told apart first, makes real filters worse.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from twin.scenario import Scenario
from twin.scoring.height_supply import Fixes, Lesser, Seen, supply_of
from twin.scoring.riccati import known_after
from twin.sensors.ahrs import AhrsConfig
from twin.sensors.gnss_config import GnssConfig
from twin.signals import LEVEL_WITHIN_M, FloatArray

_H, _V, _B, _C, _D, _S, _SIZE = range(7)
"""Lesser states' errors come after these."""
_LONGEST_S, _CHECKED_S, _SETTLED = 3000.0, 50.0, 1e-3
"""The steady state is looked for so long; it is found when b changes by less than that share in so long."""
_CYCLE_S = 1.0
"""Ages of corrections repeat after this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightErrors:
    """True random errors, 1 sigma."""

    accel_noise_m_s2_rthz: float
    """White noise of the acceleration, as the two-sided density: velocity walks by so many m/s in a second. Data sheets
    and :mod:`twin.sensors.noise` have one-sided densities, N sqrt(rate / 2) in one sample: those are to be divided by
    the square root of two. 60 ug/sqrt(Hz) of an MTi-300 (15 ug for 300 s) with a fix of 8.6 mm (100 s) and 1.7 mm white
    at 10 Hz: taken as two-sided, 0.95 mm/s and 8 ug are left at the loss and 95 % are within 30 mm for 8.2 s; as
    one-sided, which the simulated sensor has, 0.79 mm/s, 7.1 ug and 9.8 s."""
    bias_m_s2: float
    bias_correlation_s: float
    """In-run instability of the acceleration."""
    fix: Fixes
    """Of an RTK fix."""
    speed_white_m_s: float | None = None
    """Of the vertical speed, in one sample; None for receivers that have none."""
    speed_correlated_m_s: float = 0.0
    speed_correlation_s: float = 60.0
    rate_hz: float = 10.0
    """Of the receiver."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightBound:
    """Least standard deviations since the begin of a loss, (T,) each."""

    t_s: FloatArray
    """Since the begin, when the first fix was missing."""
    sigma_m: FloatArray
    velocity_sigma_m_s: FloatArray
    bias_sigma_m_s2: FloatArray
    sigma_tracking_m: float
    """Of the height after the last fix before."""

    @property
    def sigma_at_end_m(self) -> float:
        """Of the height at the last sample within the loss."""
        return float(self.sigma_m[-1])

    def time_within_s(self, limit_m: float, share: float = 0.95) -> float:
        """How long that share of all runs is within the limit, each instant for itself; infinite if to the end."""
        allowed = limit_m / NormalDist().inv_cdf(0.5 + 0.5 * share)
        beyond = self.sigma_m > allowed
        if not beyond.any():
            return math.inf
        first = int(np.argmax(beyond))
        pair = slice(max(first - 1, 0), first + 1)
        return float(np.interp(allowed, self.sigma_m[pair], self.t_s[pair]))


def height_bound(errors: HeightErrors, *, loss_s: float, seen: Callable[[float], Seen]) -> HeightBound:
    """Bound through a loss.

    Args:
        errors: true errors of the sensors.
        loss_s: how long the loss lasts.
        seen: what there is to be seen a time (s) after its begin; negative times are before it.
    """
    model = _Model(errors)
    steps = max(1, round(loss_s * errors.rate_hz))
    P = tracking = model.steady(seen)
    variances = np.empty((steps, 3))
    for step in range(steps):
        P = model.step(P, seen(step / errors.rate_hz))
        variances[step] = np.diagonal(P)[[_H, _V, _B]]
    sigma = np.sqrt(variances)
    return HeightBound(
        t_s=np.arange(steps) / errors.rate_hz,
        sigma_m=sigma[:, 0],
        velocity_sigma_m_s=sigma[:, 1],
        bias_sigma_m_s2=sigma[:, 2],
        sigma_tracking_m=math.sqrt(tracking[_H, _H]),
    )


class _Model:
    """The recursion over one period of the receiver."""

    def __init__(self, errors: HeightErrors) -> None:
        self._errors = errors
        T = 1.0 / errors.rate_hz
        self._period_s = T
        F = np.eye(_SIZE)
        F[_H, _V], F[_H, _B], F[_V, _B] = T, -0.5 * T * T, -T
        Q = np.zeros((_SIZE, _SIZE))
        noise = errors.accel_noise_m_s2_rthz**2
        Q[:2, :2] = noise * np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
        sigmas = {
            _B: (errors.bias_m_s2, errors.bias_correlation_s),
            _C: (1.0, errors.fix.correlation_s),
            _D: (1.0, errors.fix.age_drift_correlation_s),
            _S: (errors.speed_correlated_m_s, errors.speed_correlation_s),
        }
        for place, (sigma, correlation_s) in sigmas.items():
            F[place, place] = math.exp(-T / correlation_s)
            Q[place, place] = sigma**2 * -math.expm1(-2.0 * T / correlation_s)
        self._F, self._Q = F, Q
        start = np.array([1.0, 0.1, errors.bias_m_s2, 1.0, 1.0, errors.speed_correlated_m_s])
        self._start = np.diag(start**2)
        self._lesser: dict[str, int] = {}

    def steady(self, seen: Callable[[float], Seen]) -> FloatArray:
        """Covariance after very many fixes, a period before time zero."""
        P, checked = self._start, math.inf
        total = round(_LONGEST_S / self._period_s)
        often = round(_CHECKED_S / self._period_s)
        cycle = round(_CYCLE_S / self._period_s)
        for step in range(1, total + 1):
            P = self.step(P, seen(-((total - step) % cycle + 1) * self._period_s))
            if step % often == 0 and (total - step) % cycle == 0:
                if abs(P[_B, _B] / checked - 1.0) < _SETTLED:
                    break
                checked = float(P[_B, _B])
        return P

    def step(self, P: FloatArray, seen: Seen) -> FloatArray:
        """Covariance a period later, after what is seen then."""
        errors, lesser, dilution = self._errors, seen.lesser, seen.dilution
        P = self._F @ P @ self._F.T + self._Q
        if seen.fix_age_s is not None:
            fix = errors.fix
            weights = {_H: 1.0, _C: dilution * fix.correlated_m, _D: fix.age_drift_m_s * seen.fix_age_s}
            P = known_after(P, weights, dilution * fix.white_m)
        if lesser is not None:
            if lesser.name not in self._lesser:
                P = self._meet(lesser, P)
            weights = {_H: 1.0, self._lesser[lesser.name]: dilution * lesser.correlated_m}
            P = known_after(P, weights, dilution * lesser.white_m)
        if seen.speed and errors.speed_white_m_s is not None:
            P = known_after(P, {_V: 1.0, _S: dilution}, dilution * errors.speed_white_m_s)
        return P

    def _meet(self, lesser: Lesser, P: FloatArray) -> FloatArray:
        """Covariance with the error of a lesser state that was never seen before: stationary, of variance one."""
        self._lesser[lesser.name] = len(P)
        keep = math.exp(-self._period_s / lesser.correlation_s)
        self._F, self._Q = _grown(self._F, keep), _grown(self._Q, 1.0 - keep * keep)
        return _grown(P, 1.0)


def _grown(matrix: FloatArray, corner: float) -> FloatArray:
    """The matrix with one more row and column, zero but for their common element."""
    grown = np.pad(matrix, (0, 1))
    grown[-1, -1] = corner
    return grown


# --- of a scenario ---------------------------------------------------------------------------------------------------


def names(scenario: Scenario) -> list[str]:
    """Names of :func:`metrics`."""
    if scenario.scoring.height_bound_of is None:
        return []
    in_loss = ["sigma_at_end_of_loss_mm", "time_to_30mm_s"] if scenario.loss_window_s is not None else []
    return [f"bound.height.{name}" for name in ("sigma_tracking_mm", *in_loss)]


def metrics(scenario: Scenario) -> dict[str, FloatArray]:
    """Bound with the sensors of ``scoring.height_bound_of``, shape (1,) each: standard deviation with fixes and at the
    end of the loss, and the time since its begin for which 95 % of all runs are within 30 mm."""
    estimator = scenario.scoring.height_bound_of
    if estimator is None:
        return {}
    bound = scenario_bound(scenario, scenario.estimators[estimator].sensors)
    if bound is None:
        return {name: np.array([math.nan]) for name in names(scenario)}
    figures = [1e3 * bound.sigma_tracking_m, 1e3 * bound.sigma_at_end_m, bound.time_within_s(LEVEL_WITHIN_M)]
    return {name: np.array([figure]) for name, figure in zip(names(scenario), figures, strict=False)}


def scenario_bound(scenario: Scenario, sensors: Sequence[str]) -> HeightBound | None:
    """Bound through the scenario's loss for a filter with these sensors; None without an AHRS and a receiver that
    fixes."""
    configs = [scenario.sensors[name] for name in sensors]
    units = [config for config in configs if isinstance(config, AhrsConfig)]
    receivers = [config for config in configs if isinstance(config, GnssConfig)]
    if not units or not receivers:
        return None
    unit, receiver = units[0], receivers[0]
    supply = supply_of(receiver, begin_s=(scenario.loss_window_s or (scenario.duration_s, 0.0))[0])
    if supply is None:
        return None
    begin_s, end_s = scenario.loss_window_s or (scenario.duration_s, scenario.duration_s)
    speed = receiver.vertical_speed
    errors = HeightErrors(
        accel_noise_m_s2_rthz=unit.accel_noise_m_s2 / math.sqrt(unit.rate_hz),
        bias_m_s2=unit.accel_bias_instability_m_s2,
        bias_correlation_s=unit.accel_bias_correlation_s,
        fix=supply.fixes,
        speed_white_m_s=None if speed is None else speed.white_sigma_m_s,
        speed_correlated_m_s=0.0 if speed is None else speed.correlated_sigma_m_s,
        speed_correlation_s=60.0 if speed is None else speed.correlation_s,
        rate_hz=receiver.rate_hz,
    )
    return height_bound(errors, loss_s=min(end_s, scenario.duration_s) - begin_s, seen=supply.at)
