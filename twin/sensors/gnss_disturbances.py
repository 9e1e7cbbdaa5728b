"""What the faults inside a GNSS receiver come to, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.errors import BadInputError
from twin.fix_quality import NO_POSITION, RTK_FIXED
from twin.sensors.faults import FaultAtWork
from twin.sensors.gnss_fault_processes import BadReacquisitions, Flapping, WrongFix
from twin.sensors.gnss_faults import (
    BadReacquisitionFault,
    CorrectionsLostFault,
    CorrectionsOldFault,
    FlappingQualityFault,
    SatellitesMaskedFault,
    WrongFixFault,
    ZeroCovarianceFault,
)
from twin.sensors.gnss_states import OPEN_SKY
from twin.sensors.noise import Streams
from twin.signals import FloatArray, IntArray, nanoseconds

_Process = Flapping | WrongFix | BadReacquisitions


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

    def _process(self, at_work: FaultAtWork, *, period_s: float, streams: Streams) -> _Process | None:
        match at_work.fault:
            case FlappingQualityFault(qualities=qualities, changes_hz=changes_hz):
                if changes_hz * period_s > 1.0:
                    raise BadInputError(f"{at_work.key}.changes_hz = {changes_hz:g}: more than one a sample")
                states = [self._state(quality, f"{at_work.key}.qualities") for quality in qualities]
                return Flapping(states, probability=changes_hz * period_s, streams=streams, process=at_work.process)
            case WrongFixFault() as fault:
                return WrongFix(
                    fault, state=self._state(RTK_FIXED, at_work.key), streams=streams, process=at_work.process
                )
            case BadReacquisitionFault() as fault:
                state = self._state(RTK_FIXED, at_work.key)
                return BadReacquisitions(fault, state=state, streams=streams, process=at_work.process)
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

    def _act(self, at_work: FaultAtWork, process: _Process | None, since_ns: int, *, opening: bool) -> None:
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

    def _impose(self, process: _Process | None, *, opening: bool) -> None:
        if isinstance(process, Flapping):
            self.forced = process.step(opening=opening)
        elif isinstance(process, WrongFix):
            self.forced = np.full(self._runs, process.state, dtype=np.int64)
            self.offset_m = process.step(opening=opening)

    def look_at_states(self, t_ns: int, index: IntArray) -> None:
        """Let those faults act that follow the states ``index`` (R,) in which the receivers are now."""
        for at_work, process in zip(self._faults, self._processes, strict=True):
            if isinstance(process, BadReacquisitions):
                offset_m = process.step(t_ns, index, is_open=at_work.since_ns is not None)
                if offset_m is not None:
                    self.offset_m = offset_m if self.offset_m is None else self.offset_m + offset_m
