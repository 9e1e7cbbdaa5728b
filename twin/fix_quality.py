"""What a receiver's word for its solution means: NMEA's quality (GGA, field 6), and what such positions are like.

Figures of ordinary receivers are for receivers whose data sheet is silent, or that have none: those in logs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

NO_POSITION, SINGLE, DIFFERENTIAL, PPS, RTK_FIXED, RTK_FLOAT = range(6)
WITH_CORRECTIONS = frozenset({DIFFERENTIAL, RTK_FIXED, RTK_FLOAT})
"""Qualities for which a receiver tells the age of its corrections."""
STATES: Mapping[int, str] = {
    RTK_FLOAT: "float",
    DIFFERENTIAL: "differential",
    PPS: "differential",
    SINGLE: "single",
}
"""Names of the states below RTK fixed, which begin the names of their figures on data sheets; whatever else there is
(dead reckoning, simulated, not told) is no better than single."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ordinary:
    """Errors of an ordinary receiver in a state, 1 sigma; level ones are of one axis."""

    reported_m: float
    reported_height_m: float
    """What it claims."""
    slow_m: float
    slow_s: float
    """What wanders, and its 1/e time."""
    white_m: float
    """What is new in every position."""
    height_m: float
    height_s: float
    """Whole error of the height, and the 1/e time of what wanders of it."""


ORDINARY: Mapping[int, Ordinary] = {
    RTK_FIXED: Ordinary(
        reported_m=0.01,
        reported_height_m=0.02,
        slow_m=0.0046,
        slow_s=245.0,
        white_m=0.004,
        height_m=0.015,
        height_s=100.0,
    ),
    RTK_FLOAT: Ordinary(
        reported_m=0.2,
        reported_height_m=0.4,
        slow_m=0.16,
        slow_s=100.0,
        white_m=0.03,
        height_m=0.37,
        height_s=170.0,
    ),
    DIFFERENTIAL: Ordinary(
        reported_m=0.5,
        reported_height_m=0.95,
        slow_m=0.4,
        slow_s=100.0,
        white_m=0.05,
        height_m=0.76,
        height_s=100.0,
    ),
    SINGLE: Ordinary(
        reported_m=1.5,
        reported_height_m=2.9,
        slow_m=0.8,
        slow_s=160.0,
        white_m=0.05,
        height_m=1.52,
        height_s=160.0,
    ),
}
"""From the best quality to the worst. Claims: an F9P's own word for RTK fixed, the measured error of its float solution
(whose own word is a hundredth of it), a choice for differential, a NEO-M8U's own word for single point. Slow errors: an
F9P standing 2490 s, its float solution, a choice as in the receivers' presets, a NEO-M8U on a standing tractor."""
