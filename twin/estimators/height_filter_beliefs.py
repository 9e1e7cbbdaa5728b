"""What the height filter remembers of a receiver's fixes beside its state, and when it believes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.signals import LEVEL_WITHIN_M, BoolArray, FloatArray, IntArray

NEVER = -(2**62)


class GatesConfig(Config):
    """What is believed, and after how long."""

    sigmas: Positive = 4.0
    """Half the width of the gates, in standard deviations of the innovation."""
    unbroken_s: NonNegative = 0.35
    """Fixes that follow one another so fast come without a break: at 10 Hz two may be lost."""
    harmless_m: NonNegative = LEVEL_WITHIN_M
    """A gate narrower than this does no harm, whatever passes it: the limit for levelling (TD/T 1033-2012)."""
    probation_s: NonNegative = 1.2
    """How long fixes have to agree before they are believed again."""
    patience_s: Positive = 20.0
    """How long fixes that contradict what is held have to agree before they are believed."""
    memory_s: Positive = 1.0
    """After a longer break a candidate starts anew."""
    speed_patience_s: Positive = 2.0
    """How long a vertical speed is refused that nothing but the accelerometer speaks against."""


@dataclass(frozen=True, slots=True)
class Beliefs:
    """What branches remember of R members beside their states. Arrays are replaced, never changed in place."""

    used_ns: IntArray
    """When a fix was last used in the held branch."""
    since_ns: IntArray
    """Since when fixes have borne it out."""
    doubted: BoolArray
    """Whether a fix has been refused since fixes were last believed."""
    lowest_m: FloatArray
    """Lowest of the receiver's own heights since then."""
    highest_m: FloatArray
    """The highest."""
    on_trial: BoolArray
    """Whether there is a candidate."""
    contrary: BoolArray
    """Whether it contradicts."""
    trial_ns: IntArray
    """Its first fix."""
    heard_ns: IntArray
    """Its last fix."""
    quality: FloatArray
    """State of the last position; NaN before."""
    speed_ns: IntArray
    """When a vertical speed was last used, or none was there."""
    coarse_ns: IntArray
    """When a stretch of coarse positions last told where the height is, not only how it changes."""
    moved: FloatArray
    """(R, n) by how much fixes have lately moved the state of the held branch."""

    @classmethod
    def none(cls, runs: int, size: int) -> Beliefs:
        """Before anything was heard."""
        never, no = np.full(runs, NEVER, dtype=np.int64), np.zeros(runs, dtype=np.bool_)
        unknown = np.full(runs, np.nan)
        nothing = np.zeros((runs, size))
        return cls(never, never, no, unknown, unknown, no, no, never, never, unknown, never, never, nothing)
