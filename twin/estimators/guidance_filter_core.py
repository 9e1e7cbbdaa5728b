"""What the guidance filter makes of fixes: where it starts, which error a fix has, jumps, and what is told of it.

**Start.** The first fix says P = z - arm - C - J: position and receiver error are unknown by metres, their sum by
centimetres. So P, C and J start with covariances of opposite signs, and whatever is learned of one is learned of all.

**Another kind of solution** (fix, float, differential, single) has another slow error. The old one goes on unseen (O);
when the receiver comes back to that kind, the two change places, so that flapping between two kinds does not feign
many independent positions. A kind that is neither is drawn anew by its sigma; four times as wide if it was there less
than a correlation time ago, as it may be the old error still, of which nothing new can be learned.

**Jumps.** An innovation beyond the gate is not used at first. When ``jump_epochs`` of them in a row say the same, it is
the receiver's error that has jumped, not the machine: J (or C) is widened by the jump, and the position stays where
wheels and gyro have it. Only when the error that the filter would have to believe in is beyond ten of the kind's sigma,
it is the position that is lost, and the filter starts anew; so it does at once where neither wheels nor the receiver's
velocity tell how the machine moves.

**Anchor.** From pass to pass a constant error is none. A is what the receiver's slow error was when the best kind of
solution so far was first met, and P + A the position in a frame that is shifted by it: of that nothing but the *change*
of the error since then is unknown. ``frame = "relative"`` tells P + A. Its sigma is honest for the position
nevertheless: as E[(P + A - P_true)^2] = var P + (mean of A)^2, what the filter learns of A is in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twin.config import Config, Positive
from twin.estimators.engines import AboutState, Engine, innovation
from twin.estimators.guidance_filter_model import PSI, AntennaSeen, E, Layout, N, ReceiverNoise, V
from twin.estimators.guidance_filter_receiver import FixError
from twin.estimators.guidance_readers import Fix
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray

_MOST_REJECTED = 20
"""After so many in a row, whatever they say, the error is taken for another one."""
_LOST_SIGMAS = 10.0
_UNUSUAL_SIGMAS = 3.0
_VAGUE = 10.0
"""A jump's variance against the square of what is seen of it: so vague, that it takes all and the position nothing."""
_LEARNING, _MOST_SURPRISED, _MOST_WIDER = 0.08, 8.0, 400.0
"""White variance not told: share learned from a fix, its largest normalised square, and the largest factor."""
_AGAIN = 4.0
"""Widening of an error that may be the old one."""
_STEP_S = 120.0
"""Longest time for which the same rounding is taken to last."""
_NEVER = np.iinfo(np.int64).min // 2


class GatesConfig(Config):
    """When a position is not believed."""

    sigmas: Positive = 4.0
    """A fix farther off than this is doubted."""
    jump_epochs: Positive = 3.0
    """So many in a row that say the same are a jump of the receiver's error."""


class Core:
    """State of R members, and their receiver's state."""

    def __init__(
        self,
        engine: Engine,
        layout: Layout,
        antenna: Callable[[FloatArray], AntennaSeen],
        *,
        start_variances: Callable[[], FloatArray],
        gates: GatesConfig,
        sway_m: float,
        sway_s: float,
        jump_s: float,
        drift_s: float,
        white_told: bool,
    ) -> None:
        """``antenna`` makes one whose samples drift by so much (R,), m; ``start_variances`` gives (n,) variances of all
        states but position, errors and anchor.
        """
        self.engine, self._layout, self._antenna_of = engine, layout, antenna
        self._start_variances, self._gates, self._sway_m = start_variances, gates, sway_m
        self._sway_s = sway_s
        runs = engine.x.shape[0]
        self.started: BoolArray = np.zeros(runs, dtype=np.bool_)
        self.doubting: BoolArray = np.zeros(runs, dtype=np.bool_)
        """(R,) whether the last fix was not believed."""
        self._white_told, self._wider = white_told, np.ones(runs)
        self.receiver = ReceiverNoise(
            slow_m=np.ones(runs),
            slow_s=np.full(runs, 100.0),
            other_m=np.zeros(runs),
            other_s=np.full(runs, 100.0),
            jump_m=np.zeros(runs),
            jump_s=jump_s,
            drift_s=drift_s,
        )
        """Noise of the errors that there are now."""
        self._kind: IntArray = np.full(runs, -1, dtype=np.int64)
        self._other_kind: IntArray = np.full(runs, -1, dtype=np.int64)
        self._met_ns: IntArray = np.full((runs, 4), _NEVER, dtype=np.int64)
        self._anchored: IntArray = np.full(runs, -1, dtype=np.int64)
        self._rejected, self._alike = np.zeros(runs, dtype=np.int64), np.zeros(runs, dtype=np.int64)
        self._last_rejected = np.zeros((runs, 2))

    def _antenna(self, error: FixError) -> AntennaSeen:
        return self._antenna_of(error.drift_m)

    # --- fixes -------------------------------------------------------------------------------------------------------

    def white_variances(self, error: FixError, speeds: FloatArray, resolution_m: FloatArray, dt_s: float) -> FloatArray:
        """Variances (R, 2) of what is new in a sample ``dt_s`` after the one before.

        The samples of ``sway_s`` share the machine's tilt, which counts as often as it is new. Rounding to steps of q
        is new (q^2 / 12) only once per step that is crossed: at a speed v along the axis, ``speeds`` (R, 2), the
        samples of q / v seconds share it.
        """
        white = self._wider * np.square(error.white_m) + self._sway_m**2 * max(self._sway_s / dt_s, 1.0)
        crossing_s = resolution_m / np.maximum(np.abs(speeds), 1e-3)
        shared = np.clip(np.minimum(crossing_s, _STEP_S) / dt_s, 1.0, None)
        variances: FloatArray = white[:, np.newaxis] + np.square(resolution_m) / 12.0 * shared
        return variances

    def begin(
        self,
        fix: Fix,
        error: FixError,
        heading: FloatArray,
        mask: BoolArray,
        rounding_m: FloatArray,
        *,
        speed: FloatArray,
        keep: BoolArray,
    ) -> None:
        """Start the members where ``mask`` (R,) at a fix, with a heading (R,) and, if it is a state, a speed (R,).

        Where ``keep`` (R,), what is known of the receiver's errors still holds.
        """
        if not mask.any():
            return
        layout, engine = self._layout, self.engine
        fresh = mask & ~keep
        kept = layout.errors
        x = np.where(mask[:, np.newaxis], 0.0, engine.x)
        x[:, kept] = np.where(fresh[:, np.newaxis], 0.0, engine.x[:, kept])
        x[:, PSI] = np.where(mask, heading, x[:, PSI])
        if not layout.has_speed:
            x[:, V] = np.where(mask & np.isfinite(speed), speed, x[:, V])
        x[:, [E, N]] = np.where(mask[:, np.newaxis], fix.position - self._antenna(error).h(x), x[:, [E, N]])
        P = self._at_start(x, error, fresh, rounding_m)
        engine.restore(x, np.where(mask[:, np.newaxis, np.newaxis], P, engine.P))
        self.started = self.started | mask
        self._kind = np.where(mask, error.kind, self._kind)
        self._other_kind = np.where(fresh, -1, self._other_kind)
        self._set_noise(error, mask)
        self._anchored = np.where(fresh, -1, self._anchored)
        self._rejected, self._alike = np.where(mask, 0, self._rejected), np.where(mask, 0, self._alike)
        self._remember(fix, error, mask)
        self._anchor(fresh, error)

    def _at_start(self, x: FloatArray, error: FixError, fresh: BoolArray, rounding_m: FloatArray) -> FloatArray:
        """Covariance (R, n, n) of P = z - arm - C - J: what is not known of the others is not known of P."""
        layout = self._layout
        P = np.repeat(np.diag(self._start_variances())[np.newaxis], len(x), axis=0)
        rows, columns = layout.errors[:, np.newaxis], layout.errors
        P[:, rows, columns] = np.where(fresh[:, np.newaxis, np.newaxis], 0.0, self.engine.P[:, rows, columns])
        for axis in range(2):
            self._set(P, layout.slow + axis, np.square(error.slow_m), fresh)
            if layout.jump is not None:
                self._set(P, layout.jump + axis, np.square(error.jump_m), fresh)
            if layout.drift is not None:
                self._set(P, layout.drift + axis, np.ones(len(x)), fresh)
        white = np.square(error.white_m) + self._sway_m**2
        T = np.repeat(np.eye(layout.size)[np.newaxis], len(x), axis=0)
        seen = self._antenna(error).H(x)
        for axis, place in enumerate((E, N)):
            P[:, place, place] = white + rounding_m[axis] ** 2 / 12.0
            T[:, place] = -seen[:, axis]
            T[:, place, place] = 1.0
        start: FloatArray = np.einsum("rij,rjk,rlk->ril", T, P, T, optimize=True)
        return start

    @staticmethod
    def _set(P: FloatArray, place: int, variance: FloatArray, mask: BoolArray) -> None:
        P[:, place, place] = np.where(mask, variance, P[:, place, place])

    def hear(
        self, fix: Fix, error: FixError, white: FloatArray, mask: BoolArray, *, may_jump: BoolArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
        """Take a fix where ``mask`` (R,).

        Returns innovation (R, 2), its normalised square (R,), who was updated (R,), and who is lost (R,): whose fix
        is not what is expected where ``may_jump`` (R,) is not, because nothing tells how the machine moves.
        """
        self._meet(fix, error, mask)
        engine, gate = self.engine, self._gates.sigmas**2
        z = np.where(mask[:, np.newaxis], fix.position, 0.0)
        seen = AboutState(self._antenna(error), engine.x)
        before = innovation(engine, seen, z, white)
        y, nis = before.y, before.nis
        outside: BoolArray = mask & (nis > gate)
        jumped, lost = outside, outside
        if outside.any():
            jumped = self._count_rejected(y, white, outside) & may_jump
            lost = outside & ~may_jump
            self._jump(jumped, y)
        taken = mask & (~outside | jumped)
        engine.update(seen, z, taken, white)
        self.doubting = np.where(mask, outside & ~jumped & ~lost, self.doubting)
        self._learn_white(nis, mask)
        self._rejected = np.where(taken, 0, self._rejected)
        self._alike = np.where(taken, 0, self._alike)
        self._remember(fix, error, taken)
        return y, nis, taken, lost

    def _count_rejected(self, y: FloatArray, white: FloatArray, outside: BoolArray) -> BoolArray:
        """Count innovations beyond the gate; return where (R,) there were so many that something has changed."""
        same = np.linalg.norm(y - self._last_rejected, axis=1) <= np.maximum(
            0.5 * np.linalg.norm(y, axis=1), self._gates.sigmas * np.sqrt(2.0 * white.sum(axis=1))
        )
        # those that say the same are a jump; those that contradict one another only try the patience
        self._rejected = np.where(outside, self._rejected + 1, self._rejected)
        self._alike = np.where(outside, np.where(same, self._alike + 1, 1), self._alike)
        self._last_rejected = np.where(outside[:, np.newaxis], y, self._last_rejected)
        enough = (self._alike >= self._gates.jump_epochs) | (self._rejected >= _MOST_REJECTED)
        return np.logical_and(outside, enough)

    def _learn_white(self, nis: FloatArray, mask: BoolArray) -> None:
        """Where no data sheet tells what is new in a fix, the innovations do: their mean square is to be 2."""
        if not self._white_told:
            learned = self._wider * np.exp(_LEARNING * (np.minimum(nis, _MOST_SURPRISED) / 2.0 - 1.0))
            self._wider = np.where(mask, np.clip(learned, 1.0, _MOST_WIDER), self._wider)

    def lost(self, error: FixError) -> BoolArray:
        """Whether (R,) the receiver's error would have to be larger than it can be."""
        C = self.engine.x[:, self._layout.slow : self._layout.slow + 2]
        if self._layout.jump is not None:
            C = C + self.engine.x[:, self._layout.jump : self._layout.jump + 2]
        whole = np.hypot(np.hypot(error.slow_m, error.jump_m), self._sway_m)
        far: BoolArray = np.logical_and((np.abs(C) > _LOST_SIGMAS * whole[:, np.newaxis]).any(axis=1), self.started)
        return far

    def _meet(self, fix: Fix, error: FixError, mask: BoolArray) -> None:
        """Take the error of the kind of solution there is now."""
        changed = mask & (error.kind != self._kind)
        if changed.any():
            self._exchange(fix, error, changed)
        self._set_noise(error, mask)

    def _set_noise(self, error: FixError, mask: BoolArray) -> None:
        noise = self.receiver
        if mask.all():
            self.receiver = replace(noise, slow_m=error.slow_m, slow_s=error.slow_s, jump_m=error.jump_m)
            return
        self.receiver = replace(
            noise,
            slow_m=np.where(mask, error.slow_m, noise.slow_m),
            slow_s=np.where(mask, error.slow_s, noise.slow_s),
            jump_m=np.where(mask, error.jump_m, noise.jump_m),
        )

    def _exchange(self, fix: Fix, error: FixError, changed: BoolArray) -> None:
        """C and O change places; where O was of a third kind, C is drawn anew."""
        layout, noise, rows = self._layout, self.receiver, changed[:, np.newaxis]
        order = np.arange(layout.size)
        order[layout.slow : layout.slow + 2], order[layout.other : layout.other + 2] = (
            order[layout.other : layout.other + 2].copy(),
            order[layout.slow : layout.slow + 2].copy(),
        )
        x = np.where(rows, self.engine.x[:, order], self.engine.x)
        P = np.where(rows[..., np.newaxis], self.engine.P[:, order][:, :, order], self.engine.P)
        new = changed & (error.kind != self._other_kind)
        since_s = (fix.t_ns - self._met_ns[np.arange(len(changed)), error.kind]) / NS_PER_S
        sigma = error.slow_m * np.where(since_s < error.slow_s, _AGAIN, 1.0)
        for place in (layout.slow, layout.slow + 1):
            x[new, place] = 0.0
            P[new, place, :] = P[new, :, place] = 0.0
            P[new, place, place] = np.square(sigma)[new]
        self.engine.restore(x, P)
        self.receiver = replace(
            noise,
            other_m=np.where(changed, noise.slow_m, noise.other_m),
            other_s=np.where(changed, noise.slow_s, noise.other_s),
        )
        self._other_kind = np.where(changed, self._kind, self._other_kind)
        self._kind = np.where(changed, error.kind, self._kind)
        self._rejected, self._alike = np.where(changed, 0, self._rejected), np.where(changed, 0, self._alike)

    def _jump(self, mask: BoolArray, size: FloatArray) -> None:
        """The receiver's error has changed by some such size (R, 2)."""
        if not mask.any():
            return
        layout, P = self._layout, self.engine.P.copy()
        first = layout.slow if layout.jump is None else layout.jump
        variance = _VAGUE * np.square(size).sum(axis=1)[mask]
        for place in (first, first + 1):
            P[mask, place, place] += variance
        self.engine.restore(self.engine.x, P)

    def _remember(self, fix: Fix, error: FixError, mask: BoolArray) -> None:
        rows = np.flatnonzero(mask)
        self._met_ns[rows, error.kind[rows]] = fix.t_ns

    # --- anchor ------------------------------------------------------------------------------------------------------

    def anchor_better(self, error: FixError, taken: BoolArray) -> None:
        """Let the anchor be the error of now where the solution is of a better kind than any before.

        So it does where the anchor turns out to be no usual error (a solution that had not converged yet).
        """
        anew: BoolArray = error.kind > self._anchored
        if self._layout.anchor is not None:
            A = self.engine.x[:, self._layout.anchor : self._layout.anchor + 2]
            usual = _UNUSUAL_SIGMAS * np.hypot(error.slow_m, error.jump_m)
            anew |= (np.abs(A) > usual[:, np.newaxis]).any(axis=1) & (error.kind == self._anchored)
        self._anchor(taken & anew, error)

    def _anchor(self, mask: BoolArray, error: FixError) -> None:
        self._anchored = np.where(mask, error.kind, self._anchored)
        layout = self._layout
        if layout.anchor is None or not mask.any():
            return
        x, P = self.engine.x, self.engine.P
        T = np.repeat(np.eye(layout.size)[np.newaxis], len(x), axis=0)
        for axis in range(2):
            T[:, layout.anchor + axis] = 0.0
            T[:, layout.anchor + axis, layout.slow + axis] = 1.0
            if layout.jump is not None:
                T[:, layout.anchor + axis, layout.jump + axis] = 1.0
            if layout.drift is not None:
                T[:, layout.anchor + axis, layout.drift + axis] = error.drift_m
        rows = mask[:, np.newaxis]
        moved = np.einsum("rij,rjk,rlk->ril", T, P, T, optimize=True)
        self.engine.restore(np.where(rows, np.einsum("rij,rj->ri", T, x), x), np.where(rows[..., np.newaxis], moved, P))
