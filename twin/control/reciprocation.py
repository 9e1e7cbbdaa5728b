"""A hand that pushes and pulls the plate of a bench up and down (paper 002, section 2.4.1).

The paper's plate was moved by hand "reciprocally along the guide rail", at 0 to 400 mm/s, without touching the stops.
Here the hand stands still for a while and then makes stroke after stroke, each to a turning point drawn anew within the
travel less a margin, with a duration that puts the stroke's greatest speed at a drawn share of ``fastest_m_s``, or
lower where a short stroke would be a blow, and now and then with a rest in between. A stroke has the minimum-jerk
profile that a hand's point-to-point movements have (Flash and Hogan 1985): z(u) = 10 u^3 - 15 u^4 + 6 u^5 of its length
d over its duration, u in [0, 1]. Its greatest speed v is 15/8 of the mean one, its greatest acceleration
10 / sqrt(3) d / T^2 = 1.642 v^2 / d.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from twin.config import NonNegative, Probability
from twin.control.hearing import ControllerConfig
from twin.geometry import Path
from twin.randomness import world_generator
from twin.signals import NS_PER_S, STROKE, Command, Knowledge

_STANDING, _MOVING = 0, 1
_PEAK_TO_MEAN = 15.0 / 8.0
_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0) / _PEAK_TO_MEAN**2
"""Greatest acceleration of a stroke in v^2 / d."""
_HAND_1_S = 10.0
"""How fast the hand corrects what it sees of its error."""


class ReciprocationConfig(ControllerConfig):
    """The hand on a bench's handle."""

    kind: Literal["reciprocation"]
    stand_s: NonNegative = 5.0
    """Time at the beginning in which the plate rests in the middle of its travel."""
    reach_m: Annotated[float, Field(gt=0.0, le=0.19)] = 0.18
    """Turning points are at most so far from the middle: short of the stops at 0.2 m."""
    shortest_m: Annotated[float, Field(gt=0.0, le=0.3)] = 0.05
    """A stroke is at least so long."""
    slowest_m_s: Annotated[float, Field(gt=0.0, le=0.4)] = 0.1
    """Least of the greatest speeds of the strokes."""
    fastest_m_s: Annotated[float, Field(gt=0.0, le=0.4)] = 0.4
    """Greatest speed of any stroke (paper 002: 400 mm/s)."""
    hardest_m_s2: Annotated[float, Field(gt=0.0, le=10.0)] = 2.0
    """No stroke is accelerated harder: what an arm does to a plate of some kilograms without effort (a choice)."""
    rest_probability: Probability = 0.2
    """Of resting after a stroke."""
    longest_rest_s: NonNegative = 1.0
    """Rests are drawn evenly up to this."""

    @model_validator(mode="after")
    def _strokes_exist(self) -> Self:
        if self.shortest_m > self.reach_m:
            raise ValueError(
                f"shortest_m = {self.shortest_m:g} is more than reach_m = {self.reach_m:g}: from the middle of the"
                " travel no stroke would be long enough"
            )
        if self.slowest_m_s > self.fastest_m_s:
            raise ValueError(f"slowest_m_s = {self.slowest_m_s:g} is more than fastest_m_s = {self.fastest_m_s:g}")
        return self


class Reciprocation:
    """Implements :class:`twin.control.Driver`: stroke after stroke, as the world's seed draws them."""

    segment_names = ("standing", "moving")

    def __init__(
        self, config: ReciprocationConfig, *, start_e_n_heading: tuple[float, float, float], seed: int
    ) -> None:
        east, north, heading = start_e_n_heading
        self.path = Path(east_m=east, north_m=north, heading_rad=heading, pieces=[])
        self.segment = _STANDING
        self._config = config
        self._random = world_generator(seed, "driver")
        self._from_m = self._to_m = 0.0
        self._begins_s = config.stand_s
        self._lasts_s = 0.0

    def command(self, knowledge: Knowledge, interval_s: float) -> Command:  # noqa: ARG002
        """Speed of the plate now: that of the stroke, and what brings the plate back to where the hand wants it."""
        t_s = knowledge.t_ns / NS_PER_S
        self.segment = _STANDING if t_s < self._config.stand_s else _MOVING
        while self.segment == _MOVING and t_s >= self._begins_s + self._lasts_s:
            self._draw_stroke()
        u = (t_s - self._begins_s) / self._lasts_s if self._lasts_s > 0.0 else 0.0
        u = min(max(u, 0.0), 1.0)
        length = self._to_m - self._from_m
        wanted_m = self._from_m + length * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        speed = length / self._lasts_s * 30.0 * u**2 * (1.0 - u) ** 2 if self._lasts_s > 0.0 else 0.0
        return Command(lift_m_s=speed + _HAND_1_S * (wanted_m - knowledge.seen_of_implement.values[STROKE]))

    def _draw_stroke(self) -> None:
        config, begins_s = self._config, self._begins_s + self._lasts_s
        if self._random.random() < config.rest_probability:
            begins_s += config.longest_rest_s * self._random.random()
        here, reach = self._to_m, config.reach_m
        below, above = here - config.shortest_m + reach, reach - here - config.shortest_m
        place = max(below, 0.0) + max(above, 0.0)
        drawn = place * self._random.random()
        self._from_m = here
        self._to_m = -reach + drawn if drawn < below else here + config.shortest_m + drawn - max(below, 0.0)
        peak = config.slowest_m_s + (config.fastest_m_s - config.slowest_m_s) * self._random.random()
        length = abs(self._to_m - here)
        peak = min(peak, math.sqrt(config.hardest_m_s2 * length / _PEAK_ACCELERATION))
        self._begins_s, self._lasts_s = begins_s, _PEAK_TO_MEAN * length / peak
