"""Which fixes a height filter believes, and when: one branch that coasts, one that follows fixes on probation.

Each member has a *held* branch, which the estimate is taken from, and at times a *candidate*. A fix goes

- straight into the held branch if it agrees with it (Mahalanobis gate) and there is nothing to prove: no fix has been
  refused since fixes were last believed, and they have come without a break, or the held branch knows so well where it
  is that whatever passes the gate is within ``harmless_m``; or it does not know at all;
- otherwise into the candidate, which is the held branch with the fixes since then. A receiver that has just found its
  fix again, or has been fixed wrongly, gives fixes that agree with one another: only time tells. So it is with one
  whose fixes have been refused. The candidate takes the held one's place when its fixes have agreed for
  ``probation_s``; a fix that does not agree with it, or agrees with the held branch instead, starts it anew. A
  receiver's height that has not moved since it was refused (a stuck output is right whenever the implement comes by,
  and for longer when it rests there) has to agree as long as one that contradicts.

Where the first fix that is refused is not far beyond the gate, its height may have crept away from the true one: by
what the fixes of the last second have moved the state, it may be wrong, and its covariance says so.

A candidate whose first fix contradicts the held branch is *contrary*: it begins without the held height, and has to
last ``patience_s``, since a wrong fix may last for many seconds, or, if that is shorter, as long as the fixes
on which the held branch rests had lasted. So no member locks itself out for good.

Vertical speed and coarse positions go into both branches. A coarse position has an error of its own for every stretch
of one fix state; one that does not pass the gate begins a new stretch. A receiver that flaps comes back with the error
it left: stretches that follow within the error's correlation time tell how the height changes, not where it is. A
vertical speed that has been refused for ``speed_patience_s`` while no fix was used opens the velocity: then the
accelerometer is wrong.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.estimators.engines import Engine
from twin.estimators.height_filter_beliefs import NEVER, Beliefs, GatesConfig
from twin.estimators.height_filter_model import (
    B0,
    B1,
    UNKNOWN_M,
    C,
    H,
    SpanMotion,
    SumOfStates,
    V,
    renew_state,
)
from twin.estimators.height_filter_profile import ProfileAid, ProfileState
from twin.estimators.height_filter_receiver import FixReading, HeightReceiver
from twin.estimators.height_filter_surface import SurfaceAid, SurfaceState
from twin.estimators.height_filter_tilt import LevelFilter, LevelSnapshot
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray

WAITING, TRACKING, COASTING, PROBATION, CONTRADICTED = range(5)
"""Modes: no fix yet; fixes are used; none is; fixes are on probation; fixes contradict what is held."""
_ANY_ERROR = 100.0
"""Of a coarse position of which nothing is known, in standard deviations."""
_DIGITS = 10.0
"""The range of some hundred samples of white noise is 5.5 to 6.5 standard deviations."""
_LATELY_S = 1.0
"""For so long it counts what a fix has done to the state; a choice."""
_CREEPING = 2.0
"""A fix that is refused within so many half widths of the gate has crept there; a choice."""
_VAGUE_M = 10.0
"""Whoever knows the height no better than this has nothing to lose."""


Snapshot = tuple[
    FloatArray,
    FloatArray,
    FloatArray,
    FloatArray,
    Beliefs,
    LevelSnapshot | None,
    ProfileState | None,
    SurfaceState | None,
]


class Branches:
    """The held branch and the candidate of R members, and what they make of a receiver's samples."""

    def __init__(
        self,
        held: Engine,
        candidate: Engine,
        motion: SpanMotion,
        *,
        level: LevelFilter | None,
        profile: ProfileAid | None = None,
        surface: SurfaceAid | None = None,
        receiver: HeightReceiver,
        gates: GatesConfig,
    ) -> None:
        self.held, self.candidate, self.motion, self.level = held, candidate, motion, level
        self.profile, self.surface = profile, surface
        self.beliefs = Beliefs.none(*held.x.shape)
        self.nis: dict[str, FloatArray] = {}
        """Normalised innovation squared (R,) of the last samples against the held branch, before gating."""
        self._receiver, self._gates = receiver, gates
        self._gate = gates.sigmas**2
        self._memory_ns, self._unbroken_ns = round(gates.memory_s * NS_PER_S), round(gates.unbroken_s * NS_PER_S)
        self._probation_ns, self._patience_ns = (
            round(value * NS_PER_S) for value in (gates.probation_s, max(gates.patience_s, gates.probation_s))
        )
        self._speed_patience_ns = round(gates.speed_patience_s * NS_PER_S)

    # --- time --------------------------------------------------------------------------------------------------------

    def advance(self, sums: FloatArray, span_s: float, t_ns: int = 0) -> None:
        """Move on by a span with these integrals (13, R), to a time."""
        self.look(sums)
        if self.profile is not None:
            self.profile.advance(sums, span_s, t_ns)
        for branch, _ in self._both():
            branch.predict(self.motion, sums, span_s)
        if self.level is not None:
            self.level.advance(sums, span_s)

    def look(self, sums: FloatArray) -> None:
        """Tell the model what a span is like that begins now."""
        self.motion.sums = sums
        if self.level is not None:
            self.motion.lean = self.level.lean()

    def snapshot(self) -> Snapshot:
        """All that is known; nothing is copied, since nothing changes in place."""
        level = None if self.level is None else self.level.snapshot()
        profile = None if self.profile is None else self.profile.state
        surface = None if self.surface is None else self.surface.state
        return self.held.x, self.held.P, self.candidate.x, self.candidate.P, self.beliefs, level, profile, surface

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to what was known."""
        held_x, held_P, candidate_x, candidate_P, self.beliefs, level, profile, surface = snapshot
        if self.surface is not None and surface is not None:
            self.surface.restore(surface)
        if self.profile is not None and profile is not None:
            self.profile.restore(profile)
        if self.level is not None and level is not None:
            self.level.restore(level)
        self.held.restore(held_x, held_P)
        self.candidate.restore(candidate_x, candidate_P)

    def mode(self, t_ns: int) -> IntArray:
        """(R,) the modes at a time."""
        beliefs = self.beliefs
        trial = np.where(beliefs.contrary, CONTRADICTED, PROBATION)
        # a fix is as old as its latency; half a second later it is missing
        tracking = t_ns - beliefs.used_ns <= self._unbroken_ns + NS_PER_S // 2
        on_trial = beliefs.on_trial & (t_ns - beliefs.heard_ns <= self._memory_ns + NS_PER_S // 2)
        known = np.where(tracking, TRACKING, np.where(on_trial, trial, COASTING))
        modes: IntArray = np.where((beliefs.used_ns == NEVER) & ~on_trial, WAITING, known).astype(np.int64)
        return modes

    # --- what the receiver says --------------------------------------------------------------------------------------

    def hear(
        self, reading: FixReading, *, antenna_m: FloatArray, behind_m_s: FloatArray, heading_rad: FloatArray
    ) -> None:
        """Take a sample that is true now.

        ``antenna_m`` (3, R) is where the antenna is, seen from the AHRS; ``behind_m_s`` (3, R) how much slower the
        receiver's velocity is than the AHRS, which heads ``heading_rad`` (R,): by its own lag, and by the antenna's
        motion against the AHRS.
        """
        self.nis = {}
        arm_m = antenna_m[2]
        self._drop_old_candidates(reading.t_ns)
        if self.level is not None:
            self.level.hear(reading, behind_m_s, heading_rad)
        if self._receiver.speed is not None:
            self._hear_speed(reading, behind_m_s[2])
        if self.profile is not None:
            self._hear_profile(self.profile, reading)
        self._hear_coarse(reading, arm_m)
        if reading.fixed.any():
            self._hear_fix(reading, arm_m)
        if self.surface is not None and self.level is not None:
            self.surface.follow(reading, antenna_m, behind_m_s)
            self._hear_surface(self.surface, self.level.lean(), reading.t_ns)

    def _drop_old_candidates(self, t_ns: int) -> None:
        beliefs = self.beliefs
        old = beliefs.on_trial & (t_ns - beliefs.heard_ns > self._memory_ns)
        if old.any():
            self.beliefs = replace(beliefs, on_trial=beliefs.on_trial & ~old)

    def _both(self) -> list[tuple[Engine, BoolArray]]:
        everyone = np.ones(len(self.beliefs.on_trial), dtype=np.bool_)
        branches = [(self.held, everyone)]
        if self.beliefs.on_trial.any():
            branches.append((self.candidate, self.beliefs.on_trial))
        return branches

    def _hear_speed(self, reading: FixReading, behind_m_s: FloatArray) -> None:
        sheet, layout, beliefs = self._receiver.speed, self.motion.layout, self.beliefs
        assert sheet is not None
        known = reading.speed_known
        z = reading.speed_m_s + behind_m_s
        # the lag is made good by the measured acceleration, whose offset remains
        weights: dict[int, float | FloatArray] = {V: 1.0, B0: sheet.lag_s, B1: sheet.lag_s}
        if layout.speed is not None:
            weights[layout.speed] = reading.diluted
        observation = SumOfStates(weights, np.square(sheet.white_m_s * reading.diluted), size=layout.size)
        quiet = np.maximum(beliefs.speed_ns, beliefs.used_ns)
        lost = known & (quiet > NEVER) & (reading.t_ns - quiet > self._speed_patience_ns)
        for branch, members in self._both():
            y, S = observation.innovation(branch.x, branch.P, z)
            passed = np.square(y) <= self._gate * S
            anew = known & members & ~passed & lost
            if anew.any():
                renew_state(branch, V, anew, z, np.square(y))
            branch.update(observation, z[:, np.newaxis], known & members & (passed | anew), observation.R)
            if branch is self.held:
                self.nis["vertical_speed"] = np.where(known, np.square(y) / S, np.nan)
                # where none comes there is none to refuse
                self.beliefs = replace(
                    beliefs, speed_ns=np.where(passed | anew | ~known, reading.t_ns, beliefs.speed_ns)
                )

    def _hear_profile(self, profile: ProfileAid, reading: FixReading) -> None:
        layout = self.motion.layout
        rise = profile.look(reading, None if self.level is None else self.level.lean())
        if not rise.known.any():
            return
        observation = profile.observe(rise, layout)
        tracking = reading.t_ns - self.beliefs.used_ns <= self._unbroken_ns
        for branch, members in self._both():
            profile.align(branch, rise, layout, members)
            y, S = observation.innovation(branch.x, branch.P, rise.speed_m_s)
            passed = rise.known & members & (np.square(y) <= self._gate * S)
            branch.update(observation, rise.speed_m_s[:, np.newaxis], passed, observation.R)
            if branch is self.held:
                self.nis["profile"] = np.where(rise.known, np.square(y) / S, np.nan)
                profile.learn(rise, y, S, tracking)

    def _hear_surface(self, surface: SurfaceAid, lean: FloatArray, t_ns: int) -> None:
        """Read the ground under the rear axle, into the held branch alone, and remember what the blade leaves."""
        layout, held = self.motion.layout, self.held
        tracking = t_ns - self.beliefs.used_ns <= self._unbroken_ns
        ground = surface.read(lean)
        if ground.known.any():
            surface.begin((held, self.candidate), ground, layout)
            observation = surface.observe(ground, layout)
            y, S = observation.innovation(held.x, held.P, ground.height_m)
            self.nis["surface"] = np.where(ground.known, np.square(y) / S, np.nan)
            passed = ground.known & (np.square(y) <= self._gate * S)
            held.update(observation, ground.height_m[:, np.newaxis], passed, surface.believed(ground, y, S))
            surface.learn(ground, y, S, tracking)
        surface.write(held.x, held.P, layout, tracking)

    def _hear_coarse(self, reading: FixReading, arm_m: FloatArray) -> None:
        place, beliefs, motion = self.motion.layout.coarse, self.beliefs, self.motion
        if place is None:
            return
        heard = ~np.isnan(reading.quality) & (reading.quality > 0.0)
        changed = heard & (reading.quality != beliefs.quality)
        self.beliefs = replace(beliefs, quality=np.where(heard, reading.quality, beliefs.quality))
        if not reading.coarse.any():
            return
        motion.coarse_s = np.where(reading.coarse, reading.coarse_s, motion.coarse_s)
        observation = SumOfStates(
            {H: 1.0, place: reading.coarse_sigma_m * reading.wider},
            np.square(reading.coarse_white_m * reading.wider),
            size=motion.layout.size,
        )
        z, runs = reading.height_m - arm_m, len(arm_m)
        told = reading.t_ns - self.beliefs.coarse_ns < reading.coarse_s * NS_PER_S
        for branch, members in self._both():
            y, S = observation.innovation(branch.x, branch.P, z)
            anew = reading.coarse & members & (changed | (np.square(y) > self._gate * S))
            if anew.any():
                renew_state(branch, place, anew, np.zeros(runs), np.where(told, _ANY_ERROR**2, 1.0))
                y, S = observation.innovation(branch.x, branch.P, z)
            if branch is self.held:
                coarse_ns = np.where(anew & ~told, reading.t_ns, self.beliefs.coarse_ns)
                self.beliefs = replace(self.beliefs, coarse_ns=coarse_ns)
            used = reading.coarse & members & (np.square(y) <= self._gate * S)
            branch.update(observation, z[:, np.newaxis], used, observation.R)

    def _hear_fix(self, reading: FixReading, arm_m: FloatArray) -> None:
        t_ns, beliefs, gates = reading.t_ns, self.beliefs, self._gates
        observation, z = self._fix(reading), reading.height_m - arm_m
        fixed = reading.fixed
        y, S = observation.innovation(self.held.x, self.held.P, z)
        passed = np.square(y) <= self._gate * S
        self.nis["fix"] = np.where(fixed, np.square(y) / S, np.nan)
        vague = self.held.P[:, H, H] > _VAGUE_M**2
        narrow = self._gate * S <= gates.harmless_m**2
        unbroken = t_ns - beliefs.used_ns <= self._unbroken_ns
        straight = fixed & passed & ((narrow | unbroken) & ~beliefs.doubted | vague)
        since = np.where(straight & vague, t_ns, beliefs.since_ns)
        used_ns = np.where(straight, t_ns, beliefs.used_ns)
        on_trial = beliefs.on_trial & ~straight
        self.beliefs = replace(beliefs, used_ns=used_ns, since_ns=since, on_trial=on_trial)
        refused = fixed & ~passed
        # what jumps was right before, what creeps is refused as soon as it is past the gate
        self._suspect(refused & ~beliefs.doubted & (np.square(y) <= _CREEPING**2 * self._gate * S))
        self._doubt(reading, refused=refused, believed=straight)
        tried = fixed & ~straight
        if tried.any():
            self._try(reading, observation, z, tried=tried, contrary=~passed)
        if straight.any():
            before = self.held.x
            self.held.update(observation, z[:, np.newaxis], straight, observation.R)
            kept = np.exp(-(t_ns - beliefs.used_ns) / (_LATELY_S * NS_PER_S))[:, np.newaxis]
            moved = kept * beliefs.moved + (self.held.x - before)
            self.beliefs = replace(self.beliefs, moved=np.where(straight[:, np.newaxis], moved, beliefs.moved))

    def _suspect(self, members: BoolArray) -> None:
        """A height that creeps away from the true one has moved the state before its first fix was refused. By as much
        the state may be wrong.
        """
        if members.any():
            moved = np.where(members[:, np.newaxis], self.beliefs.moved, 0.0)
            self.held.restore(self.held.x, self.held.P + moved[:, :, np.newaxis] * moved[:, np.newaxis])

    def _doubt(self, reading: FixReading, *, refused: BoolArray, believed: BoolArray) -> None:
        """Keep in mind that fixes have been refused, and between which heights they have been since."""
        beliefs, z = self.beliefs, reading.height_m
        begins = refused & ~beliefs.doubted
        low = np.where(begins, z, np.where(reading.fixed, np.fmin(beliefs.lowest_m, z), beliefs.lowest_m))
        high = np.where(begins, z, np.where(reading.fixed, np.fmax(beliefs.highest_m, z), beliefs.highest_m))
        doubted = (beliefs.doubted | refused) & ~believed
        self.beliefs = replace(beliefs, doubted=doubted, lowest_m=low, highest_m=high)

    def _fix(self, reading: FixReading) -> SumOfStates:
        sheet, layout = self._receiver.fix, self.motion.layout
        weights: dict[int, float | FloatArray] = {H: 1.0, C: sheet.correlated_m * reading.wider}
        if layout.drift is not None:
            weights[layout.drift] = reading.drift_m * reading.wider
        return SumOfStates(weights, np.square(sheet.white_m * reading.wider), size=layout.size)

    # --- the candidate -----------------------------------------------------------------------------------------------

    def _try(
        self, reading: FixReading, observation: SumOfStates, z: FloatArray, *, tried: BoolArray, contrary: BoolArray
    ) -> None:
        """Let fixes into the candidate where ``tried``; start it anew where they do not agree with it."""
        t_ns, beliefs = reading.t_ns, self.beliefs
        y, S = observation.innovation(self.candidate.x, self.candidate.P, z)
        # what agrees with the held branch is no witness of a candidate that contradicts it
        deserted = beliefs.contrary & ~contrary
        anew = tried & ~(beliefs.on_trial & ~deserted & (np.square(y) <= self._gate * S))
        if anew.any():
            self._copy(self.held, self.candidate, anew)
            if (anew & contrary).any():
                self._forget_level(anew & contrary, z)
        beliefs = replace(
            beliefs,
            on_trial=beliefs.on_trial | tried,
            contrary=np.where(anew, contrary, beliefs.contrary),
            trial_ns=np.where(anew, t_ns, beliefs.trial_ns),
            heard_ns=np.where(tried, t_ns, beliefs.heard_ns),
        )
        self.candidate.update(observation, z[:, np.newaxis], tried, observation.R)
        self.beliefs = beliefs
        won = tried & (t_ns - beliefs.trial_ns >= self._needed_ns(beliefs))
        if won.any():
            self._promote(won, observation, z, t_ns)

    def _needed_ns(self, beliefs: Beliefs) -> IntArray:
        borne_out = np.where(beliefs.used_ns == NEVER, 0, beliefs.used_ns - beliefs.since_ns)
        contrary = np.clip(borne_out, self._probation_ns, self._patience_ns)
        needed: IntArray = np.where(beliefs.contrary | self._stands_still(beliefs), contrary, self._probation_ns)
        return needed

    def _stands_still(self, beliefs: Beliefs) -> BoolArray:
        """(R,) whether the receiver's height has not moved by more than its digits since its fixes were refused."""
        moved = beliefs.highest_m - beliefs.lowest_m > _DIGITS * self._receiver.fix.white_m
        return beliefs.doubted & ~moved

    def _promote(self, won: BoolArray, observation: SumOfStates, z: FloatArray, t_ns: int) -> None:
        beliefs = self.beliefs
        _, S = observation.innovation(self.held.x, self.held.P, z)
        # a held height that would have told a wrong fix by a wavelength bears the new fixes out
        same_level = ~beliefs.contrary & (self._gate * S < 0.19**2)
        self._copy(self.candidate, self.held, won)
        if self.surface is not None:
            self.surface.forget(won & beliefs.contrary)
        self.beliefs = replace(
            beliefs,
            used_ns=np.where(won, t_ns, beliefs.used_ns),
            since_ns=np.where(won & ~same_level, beliefs.trial_ns, beliefs.since_ns),
            doubted=beliefs.doubted & ~won,
            on_trial=beliefs.on_trial & ~won,
        )

    def _forget_level(self, members: BoolArray, z: FloatArray) -> None:
        """The candidate's height is that of its fixes alone, and their error a new one."""
        runs = len(z)
        renew_state(self.candidate, H, members, z, np.full(runs, UNKNOWN_M**2))
        renew_state(self.candidate, C, members, np.zeros(runs), np.ones(runs))

    def _copy(self, source: Engine, target: Engine, members: BoolArray) -> None:
        if members.all():
            target.restore(source.x, source.P)
            return
        target.restore(
            np.where(members[:, np.newaxis], source.x, target.x),
            np.where(members[:, np.newaxis, np.newaxis], source.P, target.P),
        )
