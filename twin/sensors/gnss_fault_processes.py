"""What some faults inside a GNSS receiver draw for each run as they go on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.sensors.gnss_faults import BadReacquisitionFault, WrongFixFault
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


class WrongFix:
    """An offset that stays as long as the window is open."""

    def __init__(self, fault: WrongFixFault, *, state: int, streams: Streams, process: str) -> None:
        self.state = state
        self._sigma = np.array(fault.sigma_m or WRONG_FIX_SIGMA_M)
        self._stream = streams.normal(process, 3) if fault.offset_m is None else None
        self._offset: FloatArray = np.zeros((len(streams.runs), 3))
        if fault.offset_m is not None:
            self._offset += fault.offset_m

    def step(self, *, opening: bool) -> FloatArray:
        """Return the offset, (R, 3)."""
        if opening and self._stream is not None:
            self._offset = self._stream.next() * self._sigma
        return self._offset


class BadReacquisitions:
    """An offset after each coming back to a state, for a while; drawn anew each time and in each run by itself."""

    def __init__(self, fault: BadReacquisitionFault, *, state: int, streams: Streams, process: str) -> None:
        runs = len(streams.runs)
        self._state = state
        self._for_ns = nanoseconds(fault.for_s)
        self._fixed_m = fault.offset_m
        self._sigma = np.array(fault.sigma_m or WRONG_FIX_SIGMA_M)
        self._normals = OccasionalNormals(streams=streams, process=process, least=3)
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
        self._until_ns[run] = t_ns + self._for_ns
        if self._fixed_m is not None:
            self._offset[run] = self._fixed_m
            return
        first = int(self._normals.used[run])
        self._offset[run] = self._normals.values[run, first : first + 3] * self._sigma
        self._normals.used[run] += 3
        self._normals.top_up(first + 3)
