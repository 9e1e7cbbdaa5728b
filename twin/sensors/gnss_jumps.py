"""Steps in a GNSS position when the receiver changes the set of satellites that it uses.

    offset = dilution x jump_sigma_s x u

Each satellite's range has an error of its own (orbit, ionosphere, multipath) that changes slowly; the position's error
is a weighted mean of them. When a satellite is taken into the solution or drops out of it, the weights change at once,
and the position steps by what the mean then differs. Here such changes come as a Poisson process of mean interval
``jump_interval_s``, and each draws ``u``, three independent standard normal numbers, anew: the offset has the standard
deviation of ``jump_sigma_m`` at all times, a step that times sqrt(2), and what is left of it after a time t is
exp(-t / ``jump_interval_s``). All positions while one set is in use are shifted alike, so such an offset cannot be told
from a slow error until it steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.sensors.gnss_states import FixState
from twin.sensors.noise import OccasionalNormals, Streams
from twin.signals import FloatArray, IntArray


class Jumps:
    """The offsets of R receivers, each with satellites of its own."""

    def __init__(self, states: Sequence[FixState], *, interval_s: float, period_s: float, streams: Streams) -> None:
        self._sigma = np.array([state.jump_sigma_m for state in states])
        self._probability = -math.expm1(-period_s / interval_s)
        self._when = streams.uniform("jump", 1)
        self._sizes = OccasionalNormals(streams=streams, process="jump_sizes", least=3)
        self._unit = streams.once("jump_start", 3)

    def step(self, index: IntArray, dilution: FloatArray) -> FloatArray:
        """Advance by one sample: the offsets (R, 3) of receivers in the states ``index`` (R,), zero without a position.

        ``dilution`` (S,) is the factor of each state.
        """
        for run in np.flatnonzero(self._when.next()[:, 0] < self._probability).tolist():
            first = self._sizes.used[run]
            self._unit[run] = self._sizes.values[run, first : first + 3]
            self._sizes.used[run] += 3
            self._sizes.top_up(int(self._sizes.used[run]))
        scale = np.vstack([self._sigma * dilution[:, np.newaxis], np.zeros(3)])
        offset: FloatArray = self._unit * scale[index]
        return offset
