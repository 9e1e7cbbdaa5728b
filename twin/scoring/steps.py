"""Smallest steps: how finely an estimated position moves on, once a second along a straight.

Paper 003 judges its filter, where it has no truth, by the "minimal fluctuation" of the coordinates east and north: 2.21
and 0.68 m of the receiver, 0.52 and 0.23 m of the filter. It gives no formula. Of the receiver it says that the *least*
change of its data is 1.5 and 0.45 m: a figure of a coarse position that stands still for seconds and then jumps by a
step that no speed of the trials (0.25 to 1.1 m/s, once a second) explains. Of the filter it gives the *average* change,
0.45 and 0.20 m, whose ratio is that of the other pair (2.25 and 2.26): a smooth position moves by what the machine
drives in a second, 0.5 m in one and the same direction. Both are changes of the output from one second to the next.

Taken literally, the smallest of all such changes is no property of an estimator: of noisy values it falls with every
further sample. Here *smallest* is the step that 95 % of the steps exceed, and a step is a change of more than 10 mm
(less is standing still: two digits are what the paper prints) between outputs one second apart, at whole seconds, while
the machine moves straight on. For a coarse position that is its step, for a smooth one what is driven in a second, less
its noise. The *median* of the same steps is told beside it: it is what the paper's average of a filter is to be
compared with. Not taken: the smallest of all (see above); the average with standing still (of any position that never
goes back it is the distance driven, whatever its steps); the change beyond the true movement (the paper had no truth
there).
"""

from __future__ import annotations

import numpy as np

from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray

LEAST_M = 0.010
MOVING_M_S = 0.1
NAMES = ("step.smallest_e_m", "step.smallest_n_m", "step.median_e_m", "step.median_n_m")
_SHARE = 0.05


class Steps:
    """Steps of estimated positions that are fed in pieces, for R runs side by side."""

    def __init__(self, runs: int) -> None:
        self._runs = runs
        self._changes: list[FloatArray] = []
        self._last: tuple[IntArray, FloatArray, BoolArray] | None = None

    def add(self, t_ns: IntArray, points_m: FloatArray, straight_on: BoolArray) -> None:
        """Take the next piece: times (T,), positions (T, R, 2), whether the machine moves straight on (T,)."""
        whole = t_ns % NS_PER_S == 0
        piece = t_ns[whole], points_m[whole], straight_on[whole]
        if self._last is not None:
            before, places, straight = self._last
            piece = (
                np.concatenate([before, piece[0]]),
                np.concatenate([places, piece[1]]),
                np.concatenate([straight, piece[2]]),
            )
        if not len(piece[0]):
            return
        self._last = piece[0][-1:], piece[1][-1:].copy(), piece[2][-1:]
        counted = (np.diff(piece[0]) == NS_PER_S) & piece[2][1:] & piece[2][:-1]
        self._changes.append(np.abs(np.diff(piece[1], axis=0))[counted])

    def metrics(self) -> dict[str, FloatArray]:
        """Figures by :data:`NAMES`, each of shape (R,); NaN where there was no step, or a position was not known."""
        changes = np.concatenate(self._changes) if self._changes else np.zeros((0, self._runs, 2))
        found = np.full((len(NAMES), self._runs), np.nan)
        for run in range(self._runs):
            for axis in range(2):
                values = changes[:, run, axis]
                steps = values[~(values <= LEAST_M)]
                if len(steps) and not np.isnan(steps).any():
                    found[axis, run] = np.quantile(steps, _SHARE, method="inverted_cdf")
                    found[2 + axis, run] = np.median(steps)
        return dict(zip(NAMES, found, strict=True))
