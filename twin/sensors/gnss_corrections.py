"""The stream of corrections that reaches a GNSS receiver."""

from __future__ import annotations

import numpy as np

from twin.sensors.gnss_kernels import NEVER
from twin.sensors.noise import Streams
from twin.signals import IntArray, nanoseconds


class Corrections:
    """Which corrections R receivers have.

    A base station sends one message for every multiple of ``interval_s``; it arrives ``delay_s`` later, unless it is
    lost. The age of corrections counts from their epoch, as in NMEA. The link between two samples is taken to be as it
    was at the first of them; a message that arrives right at a sample finds it as it is then.
    """

    def __init__(self, *, interval_s: float | None, delay_s: float, loss: float, streams: Streams) -> None:
        self.reference_ns: IntArray = np.full(len(streams.runs), -NEVER, dtype=np.int64)
        """(R,) epoch of the newest corrections received; changes in place."""
        self._interval_ns = None if interval_s is None else nanoseconds(interval_s)
        self._delay_ns = nanoseconds(delay_s)
        self._loss = loss
        self._stream = streams.uniform("corrections_loss", 1) if loss > 0.0 else None
        self._link_up = True
        self._next = 0
        if self._interval_ns is not None:
            newest = -self._delay_ns // self._interval_ns
            self.reference_ns[:] = newest * self._interval_ns
            self._next = newest + 1

    def update(self, t_ns: int, *, link_up: bool, late_ns: int) -> None:
        """Receive what arrives until ``t_ns``, over a link that is up or not now and delays by ``late_ns`` more."""
        if self._interval_ns is not None:
            sent_ns = t_ns - self._delay_ns - late_ns
            newest, since_ns = divmod(sent_ns, self._interval_ns)
            for message in range(self._next, newest + 1):
                just_now = message == newest and since_ns == 0
                self._take(message * self._interval_ns, link_up=link_up if just_now else self._link_up)
            self._next = max(self._next, newest + 1)
        self._link_up = link_up

    def _take(self, epoch_ns: int, *, link_up: bool) -> None:
        # Drawn for every message, received or not, so that a lost link does not shift later losses.
        received = slice(None) if self._stream is None else self._stream.next()[:, 0] >= self._loss
        if link_up:
            self.reference_ns[received] = epoch_ns
