"""What some faults inside a GNSS receiver draw for each run as they go on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from twin.sensors.gnss_faults import BadReacquisitionFault, WrongAmbiguitiesFault, WrongFixFault
from twin.sensors.noise import OccasionalNormals, Streams
from twin.signals import BoolArray, FloatArray, IntArray, nanoseconds

WRONG_FIX_SIGMA_M = (0.2, 0.2, 0.38)
"""Of an offset that is drawn: about a wavelength of L1, vertical x 1.9."""


class Flapping:
    """States that change at random, in each run by itself."""

    def __init__(self, states: Sequence[int], *, probability: float, streams: Streams, process: str) -> None:
        self._states = np.array(states, dtype=np.int64)
        self._probability = probability
        self._stream = streams.uniform(process, 2)
        self._runs = len(streams.runs)
        self._place = np.zeros(self._runs, dtype=np.int64)

    def step(self, *, opening: bool) -> IntArray:
        """Return the state of each run, (R,)."""
        if opening:
            self._place = np.zeros(self._runs, dtype=np.int64)
        else:
            others = len(self._states) - 1
            change, choice = self._stream.next().T
            ahead = 1 + np.floor(choice * others).astype(np.int64)
            self._place = (self._place + np.where(change < self._probability, ahead, 0)) % len(self._states)
        return self._states[self._place]


class Offsets:
    """What offsets a fault with wrong ambiguities makes of normal numbers."""

    def __init__(self, fault: WrongAmbiguitiesFault) -> None:
        self._given = None if fault.offset_m is None else np.array(fault.offset_m)
        self._sigma = np.array(fault.sigma_m or WRONG_FIX_SIGMA_M)
        self.normals_needed = 3 if self._given is None else int(fault.either_sign)
        """How many normal numbers an offset takes."""

    def of(self, normals: FloatArray) -> FloatArray:
        """Offsets (R, 3) of the runs with these numbers (R, ``normals_needed``)."""
        offsets: FloatArray = normals * self._sigma if self._given is None else self._sign(normals) * self._given
        return offsets

    def _sign(self, normals: FloatArray) -> FloatArray:
        return np.where(normals < 0.0, -1.0, 1.0) if self.normals_needed else np.ones((len(normals), 1))


class WrongFix:
    """An offset that stays as long as the window is open."""

    def __init__(self, fault: WrongFixFault, *, state: int, streams: Streams, process: str) -> None:
        self.state = state
        self._rule = Offsets(fault)
        self._stream = streams.normal(process, self._rule.normals_needed) if self._rule.normals_needed else None
        self._offset = self._rule.of(np.zeros((len(streams.runs), self._rule.normals_needed)))

    def step(self, *, opening: bool) -> FloatArray:
        """Return the offset, (R, 3)."""
        if opening and self._stream is not None:
            self._offset = self._rule.of(self._stream.next())
        return self._offset


class BadReacquisitions:
    """An offset after each coming back to a state, for a while; drawn anew each time and in each run by itself."""

    def __init__(self, fault: BadReacquisitionFault, *, state: int, streams: Streams, process: str) -> None:
        runs = len(streams.runs)
        self._state = state
        self._longest_s, self._least_s = fault.for_s, fault.for_least_s
        self._rule = Offsets(fault)
        self._needed = self._rule.normals_needed + (0 if fault.for_least_s is None else 1)
        self._normals = OccasionalNormals(streams=streams, process=process, least=max(self._needed, 1))
        self._was_there: BoolArray = np.ones(runs, dtype=np.bool_)
        self._until_ns: IntArray = np.zeros(runs, dtype=np.int64)
        self._offset: FloatArray = np.zeros((runs, 3))

    def step(self, t_ns: int, index: IntArray, *, is_open: bool) -> FloatArray | None:
        """Look at the states ``index`` (R,) at ``t_ns``; return the offsets (R, 3), or None where no run has one.

        To be called for every sample, whether the window is open or not: coming back is seen against the one before.
        The state in the very first sample was there before.
        """
        there = index == self._state
        if is_open:
            for run in np.flatnonzero(there & ~self._was_there).tolist():
                self._come_back(run, t_ns)
        self._was_there = there
        off = there & (t_ns < self._until_ns)
        if not is_open or not off.any():
            return None
        offset: FloatArray = self._offset * off[:, np.newaxis]
        return offset

    def _come_back(self, run: int, t_ns: int) -> None:
        first = int(self._normals.used[run])
        normals = self._normals.values[run, first : first + self._needed]
        self._normals.used[run] += self._needed
        self._offset[run] = self._rule.of(normals[np.newaxis, : self._rule.normals_needed])[0]
        self._until_ns[run] = t_ns + nanoseconds(self._for_s(normals))
        self._normals.top_up(first + self._needed)

    def _for_s(self, normals: FloatArray) -> float:
        if self._least_s is None:
            return self._longest_s
        evenly = float(ndtr(normals[-1]))
        return self._least_s + evenly * (self._longest_s - self._least_s)
