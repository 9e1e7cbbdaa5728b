"""Rauch-Tung-Striebel smoother over the steps of a Kalman filter: what hindsight could know.

Not for a machine, which cannot wait for the future: it shows how much of a filter's error is due to being causal.
With the filter's states x_f, P_f after the updates of a step and x_p, P_p = F P_f F^T + Q before those of the next
one, going back from the last step (Rauch, Tung and Striebel 1965; Gustafsson, *Statistical Sensor Fusion*):

    G = P_f F^T P_p^-1,   x_s = x_f + G (x_s+ - x_p),   P_s = P_f + G (P_s+ - P_p) G^T
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.signals import FloatArray

_JITTER = 1e-12
"""Of a correlation matrix's diagonal: a state that follows another without lag and noise makes it singular."""


@dataclass(slots=True)
class _Step:
    index: int
    F: FloatArray
    predicted: tuple[FloatArray, FloatArray]
    corrected: tuple[FloatArray, FloatArray] | None = None


class RtsRecorder:
    """Keeps every step of a filter of R members; implements :class:`twin.estimators.ins_filter.Recorder`.

    An epoch may have several steps (a receiver's error is drawn anew between two updates). Memory grows with time.
    """

    def __init__(self, x: FloatArray, P: FloatArray) -> None:
        self._start = (x, P)
        self._steps: list[_Step] = []
        self._index = 0

    def begin(self, index: int) -> None:
        """An epoch begins; what is known of it and of later ones is forgotten."""
        while self._steps and self._steps[-1].index >= index:
            self._steps.pop()
        self._index = index

    def predicted(self, F: FloatArray, x: FloatArray, P: FloatArray) -> None:
        """State (R, n) and covariance (R, n, n) after a prediction with the Jacobian F (R, n, n)."""
        self._steps.append(_Step(self._index, F, (x, P)))

    def corrected(self, x: FloatArray, P: FloatArray) -> None:
        """The same after the updates that followed."""
        if self._steps:
            self._steps[-1].corrected = (x, P)
        else:
            self._start = (x, P)

    def smooth(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Smoothed state (R, n) and covariance (R, n, n) at the end of every epoch, by its index."""
        if not self._steps:
            return {}
        smoothed: dict[int, tuple[FloatArray, FloatArray]] = {}
        last = self._steps[-1]
        x, P = _after(last)
        smoothed[last.index] = (x, P)
        for step, following in zip(reversed(self._steps[:-1]), reversed(self._steps[1:]), strict=True):
            x_f, P_f = _after(step)
            x_p, P_p = following.predicted
            G = _gain(P_f, following.F, P_p)
            x = x_f + np.einsum("rij,rj->ri", G, x - x_p)
            P = P_f + G @ (P - P_p) @ G.transpose(0, 2, 1)
            smoothed.setdefault(step.index, (x, P))
        return smoothed


def _after(step: _Step) -> tuple[FloatArray, FloatArray]:
    return step.predicted if step.corrected is None else step.corrected


def _gain(P_f: FloatArray, F: FloatArray, P_p: FloatArray) -> FloatArray:
    """G = P_f F^T P_p^-1; solved in units of the standard deviations, which differ by many orders of magnitude."""
    sigma = np.sqrt(np.einsum("rii->ri", P_p))
    sigma = np.where(sigma > 0.0, sigma, 1.0)
    correlation = P_p / (sigma[:, :, np.newaxis] * sigma[:, np.newaxis, :])
    correlation = correlation + _JITTER * np.eye(correlation.shape[-1])
    right = (F @ P_f) / sigma[:, :, np.newaxis]
    solved: FloatArray = np.linalg.solve(correlation, right) / sigma[:, :, np.newaxis]
    return solved.transpose(0, 2, 1)
