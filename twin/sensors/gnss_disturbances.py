"""What the faults inside a GNSS receiver come to, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.errors import BadInputError
from twin.sensors.faults import FaultAtWork
from twin.sensors.gnss_faults import (
    CorrectionsLostFault,
    CorrectionsOldFault,
    FlappingQualityFault,
    SatellitesMaskedFault,
    WrongFixFault,
    ZeroCovarianceFault,
)
from twin.sensors.gnss_states import NO_POSITION, OPEN_SKY
from twin.sensors.noise import Streams
from twin.signals import FloatArray, IntArray, nanoseconds

_RTK_FIXED = 4
_WRONG_FIX_SIGMA_M = (0.2, 0.2, 0.38)


class _Flapping:
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


class _WrongFix:
    """An offset that stays as long as the window is open."""

    def __init__(self, fault: WrongFixFault, *, state: int, streams: Streams, process: str) -> None:
        self.state = state
        self._sigma = np.array(fault.sigma_m or _WRONG_FIX_SIGMA_M)
        self._stream = streams.normal(process, 3) if fault.offset_m is None else None
        self._offset: FloatArray = np.zeros((len(streams.runs), 3))
        if fault.offset_m is not None:
            self._offset += fault.offset_m

    def step(self, *, opening: bool) -> FloatArray:
        """Return the offset, (R, 3)."""
        if opening and self._stream is not None:
            self._offset = self._stream.next() * self._sigma
        return self._offset


class Disturbances:
    """The receiver's surroundings as its faults make them; without faults, perfect.

    Args:
        faults: those that act inside the receiver; their windows have been looked at when :meth:`update` is called.
        qualities: NMEA qualities of the receiver's states, best first.
        period_s: time between samples.

    Raises:
        BadInputError: a fault asks for a quality that the receiver does not have.
    """

    def __init__(
        self, faults: Sequence[FaultAtWork], *, qualities: Sequence[int], period_s: float, streams: Streams
    ) -> None:
        self.link_up = True
        """Corrections can arrive."""
        self.late_ns = 0
        """How much later than usual they arrive."""
        self.satellites = OPEN_SKY
        """No more than these are in view."""
        self.forced: IntArray | None = None
        """(R,) states that a fault imposes; None where none does."""
        self.offset_m: FloatArray | None = None
        """(R, 3) further position error, or None."""
        self.zero_sigmas = False
        """The receiver reports zero sigmas."""
        self._runs = len(streams.runs)
        self._qualities = qualities
        self._faults = list(faults)
        self._was_open = [False] * len(self._faults)
        self._processes = [self._process(at_work, period_s=period_s, streams=streams) for at_work in self._faults]

    def _process(self, at_work: FaultAtWork, *, period_s: float, streams: Streams) -> _Flapping | _WrongFix | None:
        match at_work.fault:
            case FlappingQualityFault(qualities=qualities, changes_hz=changes_hz):
                if changes_hz * period_s > 1.0:
                    raise BadInputError(f"{at_work.key}.changes_hz = {changes_hz:g}: more than one a sample")
                states = [self._state(quality, f"{at_work.key}.qualities") for quality in qualities]
                return _Flapping(states, probability=changes_hz * period_s, streams=streams, process=at_work.process)
            case WrongFixFault() as fault:
                return _WrongFix(
                    fault, state=self._state(_RTK_FIXED, at_work.key), streams=streams, process=at_work.process
                )
            case _:
                return None

    def _state(self, quality: int, key: str) -> int:
        if quality == NO_POSITION:
            return len(self._qualities)
        if quality not in self._qualities:
            known = ", ".join(str(known) for known in (*self._qualities, NO_POSITION))
            raise BadInputError(f"{key}: this receiver has no state of quality {quality}; there are {known}")
        return list(self._qualities).index(quality)

    def update(self) -> None:
        """Let the open windows act; later faults of the list override earlier ones."""
        if not self._faults:
            return
        self.link_up, self.late_ns, self.satellites = True, 0, OPEN_SKY
        self.forced, self.offset_m, self.zero_sigmas = None, None, False
        for index, at_work in enumerate(self._faults):
            since_ns = at_work.since_ns
            if since_ns is not None:
                self._act(at_work, self._processes[index], since_ns, opening=not self._was_open[index])
            self._was_open[index] = since_ns is not None

    def _act(
        self, at_work: FaultAtWork, process: _Flapping | _WrongFix | None, since_ns: int, *, opening: bool
    ) -> None:
        match at_work.fault:
            case CorrectionsLostFault():
                self.link_up = False
            case CorrectionsOldFault(delay_s=delay_s, growth=growth):
                self.late_ns += nanoseconds(delay_s) + round(growth * since_ns)
            case SatellitesMaskedFault(satellites=satellites):
                self.satellites = min(self.satellites, satellites)
            case ZeroCovarianceFault():
                self.zero_sigmas = True
            case _:
                self._impose(process, opening=opening)

    def _impose(self, process: _Flapping | _WrongFix | None, *, opening: bool) -> None:
        if isinstance(process, _Flapping):
            self.forced = process.step(opening=opening)
        elif isinstance(process, _WrongFix):
            self.forced = np.full(self._runs, process.state, dtype=np.int64)
            self.offset_m = process.step(opening=opening)
