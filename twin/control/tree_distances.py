"""Chapter 5's controller of paper 001: the yaw rate is K times the difference of two distances (eqs 70 and 71).

    V_angular = K (L1 - L2),  later K (L3 - L4),  L in cm and K = 0.01 rad/s per cm.

The speed is constant. Where a tree of the pair is not found there is nothing to steer by, and the robot goes straight
on, which is what the paper implies.

**What the law does.** A pair of trees at the bearing b to either side is a pair of ranges, and ranges do not change
with the machine's heading. For a lidar that is l ahead of the axle, at the offset e and the heading psi,

    L1 - L2 = -2 sin(b) (e + l psi),

so with k = 100 K per second and metre, and e' = v psi, the loop is

    e'' + 2 k sin(b) l e' + 2 k sin(b) v e = 0.

It swings: a wavelength of 2 pi sqrt(v / (2 k sin(b))), 3.1 m at 0.5 m/s beside the trees. All of its damping comes
from the lever l; a delay T (turn of the lidar, motors) takes away: its damping is that of a lever of l - v T. With
l = 5.5 cm and T about 0.3 s the swings die down below 0.18 m/s and grow above. The paper's field of four trees is over
before the first swing is.

From pair to pair sin(b) falls and rises with the trees' spacing. Where the wavelength is twice the spacing, that
pumps it (Mathieu's equation): with trees 1 m apart and a mean sine of 0.82 (a pair is in use from 0.68 m ahead to
0.32 m behind) about v = 2 k sin(b) (1 m / pi)^2 = 0.17 m/s. Seen in runs: calm at 0.13 and 0.19 m/s, into the trees at
0.15.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import field_validator

from twin.config import Positive
from twin.control.hearing import TRUTH
from twin.control.lane_keeping import STANDING, STOPPED_AT_END, STOPPED_AT_SIGN, LaneDriver, LaneDriverConfig
from twin.signals import Knowledge

DRIVING, NO_TREES = "driving", "straight on: no trees"
_PAIRS = {1: ("tree_1_m", "tree_2_m"), 2: ("tree_3_m", "tree_4_m")}
_CM_PER_M = 100.0


class TreeDistancesDriverConfig(LaneDriverConfig):
    """Options of :class:`TreeDistancesDriver`."""

    states: ClassVar = (STANDING, DRIVING, NO_TREES, STOPPED_AT_SIGN, STOPPED_AT_END)
    steers_by: ClassVar = ("pair", *_PAIRS[1], *_PAIRS[2])

    kind: Literal["tree_distances"]
    follows: str
    """Estimator of the distances."""
    gain_rad_s_cm: Positive = 0.01
    """K: yaw rate per centimetre (eqs 70 and 71)."""

    @field_validator("follows")
    @classmethod
    def _an_estimator(cls, value: str) -> str:
        if value == TRUTH:
            raise ValueError("the truth tells no tree distances; name an estimator of kind 'tree_distances'")
        return value


class TreeDistancesDriver(LaneDriver):
    """Driver of :class:`TreeDistancesDriverConfig`."""

    def __init__(self, config: TreeDistancesDriverConfig, *, start_e_n_heading: tuple[float, float, float]) -> None:
        super().__init__(config, start_e_n_heading=start_e_n_heading)
        self._config = config

    def steer(self, knowledge: Knowledge, interval_s: float) -> tuple[str, float, float]:  # noqa: ARG002
        """Return the state to be in, the speed wanted (m/s) and the yaw rate (rad/s)."""
        said, speed = knowledge.said.get(self._config.follows), self._config.speed_m_s
        if said is None:
            return STANDING, 0.0, 0.0
        pair = said.values["pair"]
        if math.isnan(pair) or int(pair) not in _PAIRS:
            return NO_TREES, speed, 0.0
        left, right = (said.values[column] for column in _PAIRS[int(pair)])
        return DRIVING, speed, self._config.gain_rad_s_cm * _CM_PER_M * (left - right)
