"""How fast an estimate follows when the machine changes its speed: reaction time and lag on the ramps of a run.

**Ramps** are found in the true speed alone, smoothed as a seed meter's user would by eye: the acceleration over
1 s about each instant. A ramp is where it exceeds half of what the driver uses; a straight ramp of the driver's own
acceleration then begins and ends where it truly does, since a mean over a symmetric window passes half its step at the
step. Changes of speed smaller than ``scoring.smallest_ramp_m_s`` do not count.

After a ramp of step D an estimate has 5 s to settle (or until the next ramp, or the end). Three figures, each the mean
over all ramps upwards (``accelerating``) or downwards (``braking``), of the machine's speed:

* ``speed.delay_<way>_s``: from the truth's passing half of the step until the estimate passes it, infinite if it never
  does: the distance between two curves that paper 000 reads (sections 4.5 and 4.6.3; there between filter and radar).
* ``speed.reaction_<way>_s``: from the end of the ramp until the error stays within 5 % of D: 0 if it never was beyond,
  infinite if it was not inside for good.
* ``speed.lag_<way>_s``: integral of truth minus estimate over ramp and settling, divided by D: metres that the
  estimate missed, per metre a second. A meter that sows by the estimate misses as many seeds as lie on them.

**What a first-order lag tau comes to** on a ramp of acceleration a and length T = D / a: a delay d of
tau (1 - exp(-(T / 2 + d) / tau)); an error of e = a tau (1 - exp(-T / tau)) at the end, and so a reaction time of
tau ln(20 e / D), or 0 if e is less than D / 20; a lag of tau, whatever the ramp. A filter that takes accelerations and
follows its speed sensor in the long run, as those of paper 000 do, passes on the sensor's error smoothed: it is less
behind while a ramp is young, behind for longer after it, and its lag is the sensor's. A constant error e adds
e (T + 5 s) / D to the lag.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from twin.signals import NS_PER_S, FloatArray, IntArray

SETTLING_NS = 5 * NS_PER_S
"""Time after a ramp in which it counts how the estimate settles: seven times the slowest radar lag, 0.7 s."""
BAND = 0.05
"""Share of the step within which the estimate has reacted."""
_HALF_WINDOW_NS = NS_PER_S // 2

NAMES = tuple(f"speed.{what}_{way}_s" for what in ("delay", "reaction", "lag") for way in ("accelerating", "braking"))
"""Names of the figures."""


@dataclass(frozen=True, slots=True)
class Ramp:
    """A change of speed, by places in the times it was found in."""

    begin: int
    end: int
    """First place after it."""
    step_m_s: float
    is_over: bool
    """False where the times end before it does."""


def find_ramps(t_ns: IntArray, speed_m_s: FloatArray, *, acceleration_m_s2: float, smallest_m_s: float) -> list[Ramp]:
    """Ramps in a speed (T,) at rising times (T,): where the acceleration over 1 s is beyond half of the given one.

    Half a second from either end of the times the acceleration is not known, and no ramp begins or ends there. A ramp
    that is not over is given whatever its step.
    """
    known = (t_ns >= t_ns[0] + _HALF_WINDOW_NS) & (t_ns <= t_ns[-1] - _HALF_WINDOW_NS)
    if not known.any():
        return []
    after, before = (np.interp(t_ns + shift, t_ns, speed_m_s) for shift in (_HALF_WINDOW_NS, -_HALF_WINDOW_NS))
    acceleration = (after - before) / (2 * _HALF_WINDOW_NS / NS_PER_S)
    way = np.where(known & (np.abs(acceleration) > 0.5 * acceleration_m_s2), np.sign(acceleration), 0.0)
    last_known = int(np.flatnonzero(known)[-1])
    changes = np.flatnonzero(np.diff(way, prepend=0.0, append=0.0) != 0.0).tolist()
    found = []
    for begin, end in itertools.pairwise(changes):
        if way[begin] != 0.0:
            step = float(speed_m_s[min(end, last_known)] - speed_m_s[begin])
            is_over = end <= last_known
            if abs(step) >= smallest_m_s or not is_over:
                found.append(Ramp(begin, end, step, is_over))
    return found


class RampTally:
    """Reaction times and lags of one estimator, for R runs, in pieces; of the errors it keeps one ramp's at most."""

    def __init__(self, runs: int, *, acceleration_m_s2: float, smallest_m_s: float) -> None:
        self._acceleration = acceleration_m_s2
        self._smallest = smallest_m_s
        self._t_ns: IntArray = np.empty(0, dtype=np.int64)
        self._speed: FloatArray = np.empty(0)
        self._errors: FloatArray = np.empty((0, runs))
        self._sums: dict[str, FloatArray] = {name: np.zeros(runs) for name in NAMES}
        self._counts = dict.fromkeys(NAMES, 0)

    def add(self, t_ns: IntArray, speed_m_s: FloatArray, errors_m_s: FloatArray) -> None:
        """Take the next times (T,), true speeds (T,) and errors, estimate minus truth (T, R)."""
        self._t_ns = np.concatenate([self._t_ns, t_ns])
        self._speed = np.concatenate([self._speed, speed_m_s])
        self._errors = np.concatenate([self._errors, errors_m_s])
        self._score(at_end=False)

    def metrics(self) -> dict[str, FloatArray]:
        """The figures of all that was added, each (R,), NaN where there was no such ramp. To be called once, last."""
        self._score(at_end=True)
        return {
            name: total / self._counts[name] if self._counts[name] else np.full(len(total), math.nan)
            for name, total in self._sums.items()
        }

    def _score(self, *, at_end: bool) -> None:
        """Score the ramps that are over and settled, and forget them."""
        t_ns = self._t_ns
        if not len(t_ns):
            return
        ramps = find_ramps(t_ns, self._speed, acceleration_m_s2=self._acceleration, smallest_m_s=self._smallest)
        begins = [int(t_ns[ramp.begin]) for ramp in ramps]
        # Until when all ramps are known: what is not over yet may become one and end the settling of the one before.
        known_until = int(t_ns[-1]) - _HALF_WINDOW_NS
        if ramps and not ramps[-1].is_over:
            known_until = begins[-1]
        needed_from = known_until
        for place, ramp in enumerate(ramps):
            until = int(t_ns[ramp.end]) + SETTLING_NS if ramp.is_over else known_until
            if place + 1 < len(ramps):
                until = min(until, begins[place + 1])
            if not ramp.is_over or (until > known_until and not at_end):
                needed_from = begins[place]
                break
            self._take(ramp, max(int(np.searchsorted(t_ns, until)), ramp.end + 1))
        keep = t_ns >= needed_from - _HALF_WINDOW_NS
        self._t_ns, self._speed, self._errors = t_ns[keep], self._speed[keep], self._errors[keep]

    def _take(self, ramp: Ramp, until: int) -> None:
        """Add what one ramp says; its settling ends before the place ``until``."""
        way = "accelerating" if ramp.step_m_s > 0.0 else "braking"
        t_s = self._t_ns[ramp.begin : until] / NS_PER_S
        errors = self._errors[ramp.begin : until]
        lag = -(errors[1:] * np.diff(t_s)[:, np.newaxis]).sum(axis=0) / ramp.step_m_s
        after = slice(ramp.end - ramp.begin, None)
        reaction = _time_to_stay(t_s[after], errors[after], BAND * abs(ramp.step_m_s))
        speed = self._speed[ramp.begin : until, np.newaxis]
        half = float(speed[0, 0]) + 0.5 * ramp.step_m_s
        passed = [_time_past(t_s, (each - half) * np.sign(ramp.step_m_s)) for each in (speed + errors, speed)]
        for what, seconds in (("delay", passed[0] - passed[1]), ("reaction", reaction), ("lag", lag)):
            name = f"speed.{what}_{way}_s"
            self._sums[name] = self._sums[name] + seconds
            self._counts[name] += 1


def _time_past(t_s: FloatArray, values: FloatArray) -> FloatArray:
    """When ``values`` (T, R) first reach zero from below, interpolated; inf if never, NaN where one is not known."""
    at = np.argmax(values >= 0.0, axis=0)
    runs = np.arange(values.shape[1])
    before = np.maximum(at - 1, 0)
    low, high = values[before, runs], values[at, runs]
    share = np.where(at > 0, -low / np.where(at > 0, high - low, 1.0), 0.0)
    found: FloatArray = np.where(high >= 0.0, t_s[before] + share * (t_s[at] - t_s[before]), math.inf)
    found[np.isnan(values).any(axis=0)] = math.nan
    return found


def _time_to_stay(t_s: FloatArray, errors: FloatArray, band: float) -> FloatArray:
    """Time from the first of ``t_s`` (T,) until ``errors`` (T, R) stay in the band; NaN where one is not known."""
    outside = np.abs(errors) > band
    settled = len(t_s) - np.argmax(outside[::-1], axis=0)  # first place of the rest that is inside
    since = np.append(t_s - t_s[0], math.inf)
    found: FloatArray = np.where(outside.any(axis=0), since[settled], 0.0)
    found[np.isnan(errors).any(axis=0)] = math.nan
    return found
