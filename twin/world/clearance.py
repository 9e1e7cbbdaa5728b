"""How far a machine is from the nearest trunk, seen from above."""

from __future__ import annotations

import math

import numpy as np

from twin.signals import FloatArray
from twin.world.orchard import EAST, NORTH, RADIUS

Outline = tuple[tuple[float, float], tuple[float, float]]
"""Rectangle in the frame of the root link: (back, right) and (front, left) corner, m."""


def clearance_m(trunks: FloatArray, east_m: float, north_m: float, heading_rad: float, outline: Outline) -> float:
    """Least distance between the outline and a trunk's surface, m; zero or less where they touch.

    Args:
        trunks: (N, TRUNK_COLUMNS); with none the distance is infinite.
        east_m: of the root link's origin.
        north_m: of the root link's origin.
        heading_rad: of the root link.
        outline: of the machine.
    """
    if not len(trunks):
        return math.inf
    east, north = trunks[:, EAST] - east_m, trunks[:, NORTH] - north_m
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    (back, right), (front, left) = outline
    forward, leftward = cosine * east + sine * north, cosine * north - sine * east
    ahead = np.maximum(np.maximum(back - forward, forward - front), 0.0)
    aside = np.maximum(np.maximum(right - leftward, leftward - left), 0.0)
    return float(np.min(np.hypot(ahead, aside) - trunks[:, RADIUS]))
