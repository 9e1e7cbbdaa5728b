"""One step of the recursions by which bounds are worked out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.signals import FloatArray


def known_after(P: FloatArray, weights: Mapping[int, float], white: float) -> FloatArray:
    """Covariance (n, n) after a weighted sum of states has been seen.

    Args:
        P: covariance (n, n) before.
        weights: of the states in the sum, by place; all others have none.
        white: standard deviation of what is new in this measurement.
    """
    h = np.zeros(len(P))
    h[list(weights)] = list(weights.values())
    PHt = P @ h
    P = P - np.outer(PHt, PHt) / (h @ PHt + white**2)
    return 0.5 * (P + P.T)
