"""What an estimate does when fixes come back after a loss: how far it jumps, and when it has recovered.

Both count from a member's first *true* fix at or after the end of the loss, which the receiver's hidden stream tells
(``true_fix``, 1 or 0, at the time of the sample): a wrong fix, or a report of one, does not begin the time.

The *jump* is the largest change of the error from one epoch to the next in the 4 s after it: a filter that first looks
whether a fix is a right one steps when it has seen enough, and the longest time that recovery may take
(:mod:`twin.scoring.honesty`) and a second more have to be over before nothing is left to come. An estimate has
*recovered* when its error and the sigma that it claims are within the family's tolerance and stay there for a second.
"""

from __future__ import annotations

import math

import numpy as np

from twin.families import Tolerance
from twin.recording import Stream
from twin.sensors.gnss import TRUE_FIX
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray

_JUMP_WINDOW_NS = 4 * NS_PER_S
_HOLD_NS = NS_PER_S
_NEVER = np.iinfo(np.int64).max // 2


class FirstFixes:
    """When each of R members had its first true fix at or after the end of a loss, fed in pieces."""

    def __init__(self, runs: int, loss_end_ns: int) -> None:
        self.loss_end_ns = loss_end_ns
        self.t_ns: IntArray = np.full(runs, _NEVER)
        """(R,), far beyond any run where there was none yet."""

    @property
    def came(self) -> BoolArray:
        """Which members had one, (R,)."""
        return self.t_ns < _NEVER

    def add(self, fixes: Stream) -> None:
        """Take the next piece of the receiver's hidden stream, with its column ``true_fix``."""
        after = fixes.t_ns >= self.loss_end_ns
        if not after.any():
            return
        true = fixes.column(TRUE_FIX)[after] > 0.5
        first = np.where(true.any(axis=0), fixes.t_ns[after][true.argmax(axis=0)], _NEVER)
        self.t_ns = np.minimum(self.t_ns, first)


class Reacquisition:
    """Jump and recovery of one estimator's error, fed in pieces after the fixes of the same time."""

    def __init__(self, tolerance: Tolerance, fixes: FirstFixes) -> None:
        runs = len(fixes.t_ns)
        self._tolerance = tolerance
        self._fixes = fixes
        self._before: FloatArray | None = None
        self._largest: FloatArray = np.full(runs, -math.inf)
        self._well_since: IntArray = np.full(runs, _NEVER)
        self._recovered_ns: IntArray = np.full(runs, _NEVER)
        self.claims: BoolArray = np.zeros(runs, dtype=np.bool_)
        """Members in which a sigma was claimed after the loss, (R,)."""

    def add(self, t_ns: IntArray, errors: FloatArray, sigmas: FloatArray) -> None:
        """Take a piece: times (T,), signed errors and sigmas (T, R) in the family's unit."""
        since = int(np.searchsorted(t_ns, self._fixes.loss_end_ns))
        if since < len(t_ns):
            before = errors[since - 1] if since > 0 else self._before
            self._add_jump(t_ns[since:], errors[since:], before)
            self._add_recovery(t_ns[since:], errors[since:], sigmas[since:])
        if len(t_ns):
            self._before = errors[-1].copy()

    def _add_jump(self, t_ns: IntArray, errors: FloatArray, before: FloatArray | None) -> None:
        if before is not None:
            errors = np.concatenate([before[np.newaxis], errors])
        else:
            t_ns = t_ns[1:]
        begin = self._fixes.t_ns
        near = (t_ns > begin.min()) & (t_ns <= begin.max() + _JUMP_WINDOW_NS)
        if not near.any():
            return
        at = t_ns[near, np.newaxis]
        steps = np.abs(np.diff(errors, axis=0)[near])
        # An error that is not known makes the jump unknown: NaN stays NaN in a maximum.
        counted = np.where((at > begin) & (at <= begin + _JUMP_WINDOW_NS), steps, -math.inf)
        self._largest = np.maximum(self._largest, counted.max(axis=0))

    def _add_recovery(self, t_ns: IntArray, errors: FloatArray, sigmas: FloatArray) -> None:
        self.claims |= ~np.isnan(sigmas).all(axis=0)
        if (self._recovered_ns < _NEVER).all():
            return
        well = (np.abs(errors) <= self._tolerance.error) & (sigmas <= self._tolerance.settled_sigma)
        well &= t_ns[:, np.newaxis] >= self._fixes.t_ns
        # All has been well since the epoch after the last that was not, or since a piece before this one.
        epochs = np.arange(len(t_ns))[:, np.newaxis]
        last_ill = np.maximum.accumulate(np.where(well, -1, epochs), axis=0)
        from_start = np.where(self._well_since < _NEVER, self._well_since, t_ns[0])
        since = np.where(last_ill < 0, from_start, t_ns[np.minimum(last_ill + 1, len(t_ns) - 1)])
        held = well & (t_ns[:, np.newaxis] - since >= _HOLD_NS)
        found = np.where(held.any(axis=0), since[held.argmax(axis=0), np.arange(held.shape[1])], _NEVER)
        self._recovered_ns = np.minimum(self._recovered_ns, found)
        self._well_since = np.where(well[-1], since[-1], _NEVER)

    def jump(self) -> FloatArray:
        """Largest change at re-acquisition, (R,), in the family's unit; NaN where no true fix came."""
        return np.where(np.isneginf(self._largest), math.nan, self._largest)

    def recovery_s(self) -> FloatArray:
        """Time from the first true fix, (R,); inf if never, NaN where none came or no sigma is claimed."""
        recovered = self._recovered_ns < _NEVER
        taken = np.where(recovered, (self._recovered_ns - self._fixes.t_ns) / NS_PER_S, math.inf)
        return np.where(self._fixes.came & self.claims, taken, math.nan)
