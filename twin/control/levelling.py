"""Levelling: keeps the edge of a blade on the design plane by what is known of its height.

The lift answers late: its valve has a dead time, the cylinder a lag and limits of its speed. So the controller works on
the height as it will be when what it asks for now takes effect (a Smith predictor). From its own past commands it knows
how the lift moves, L'(t), and where what is already under way will take it; the rest of the blade's vertical speed is
what the ground does to the machine, and goes on for so long:

    h_ahead = h + (L(t + T) - L(t)) + T (v_h - L'(t)),     v = k (h_wanted - h_ahead),     T = dead time + lag.

With the lift's own delay out of the loop, k is bounded by what the model does not know; 5 per second keeps a gain
margin of 1.5 even if the delay were not modelled at all (pi / 2 / 0.2 s = 7.9 per second). A dead band keeps the valve
quiet. An estimator that tells no vertical speed is followed without the ground's part.

The blade is lifted out of the ground, to the stop of its lift, where the driver wants it raised (headland turns), and,
with ``raise_when_sigma_m``, as long as the estimator's own sigma of the height is larger: it has lost the height and
knows it. An estimator that has not spoken, or says NaN, keeps the blade up too.

Whoever sits on the machine sees how full the blade is. From ``ease_from_share`` of what it holds on he lets it ride up,
by ``ease_m`` when it is full, rather than leave windrows of what it spills: that soil is for the next round.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field

from twin.config import NonNegative, Positive
from twin.control.hearing import TRUTH, FollowerConfig
from twin.signals import HEIGHT, VELOCITY, Command, Knowledge, Said, sigma_column

_UP_M_S = 1.0
"""More than any lift can do: to the stop."""
_TRUST_AGAIN = 0.8
"""Share of ``raise_when_sigma_m`` below which the blade goes down again."""


class LevellingControlConfig(FollowerConfig):
    """Who holds the blade, and by which estimator of its height."""

    kind: Literal["levelling"]
    gain_1_s: Annotated[float, Field(gt=0.0, le=20.0)] = 5.0
    """Lift speed per height error."""
    dead_time_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.12
    """Of the valve, as its data sheet has it."""
    lag_s: NonNegative = 0.08
    """First-order time constant of the cylinder's speed."""
    fastest_up_m_s: Positive = 0.22
    """Of the lift."""
    fastest_down_m_s: Positive = 0.25
    """Of the lift."""
    dead_band_m: NonNegative = 0.002
    """Errors up to this leave the valve shut."""
    target_m: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.0
    """Height wanted, above the design plane."""
    ease_from_share: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.7
    """Share of the blade's capacity from which on it is eased."""
    ease_m: NonNegative = 0.05
    """By so much when it is full."""
    raise_when_sigma_m: Positive | None = None
    """Lift the blade as long as the estimator's sigma of the height is larger, or it tells none; without it never."""

    @property
    def goes_by(self) -> tuple[str, ...]:
        """Columns that are needed of the estimator."""
        return (HEIGHT,) if self.raise_when_sigma_m is None else (HEIGHT, sigma_column(HEIGHT))


class LevellingControl:
    """Implements :class:`twin.control.ImplementController`."""

    def __init__(self, config: LevellingControlConfig, *, interval_s: float) -> None:
        """Hold the blade, asked every ``interval_s``."""
        self._config = config
        self._trusts = True
        self._lift = _LiftModel(config, interval_s)

    def amend(self, command: Command, knowledge: Knowledge) -> Command:
        """Return the driver's command with the lift's speed in it."""
        asked = self._asked(command, knowledge)
        self._lift.step(asked)
        return replace(command, lift_m_s=asked)

    def _asked(self, command: Command, knowledge: Knowledge) -> float:
        whom = self._config.follows
        said = knowledge.seen_of_implement if whom == TRUTH else knowledge.said.get(whom)
        height_m = math.nan if said is None else said.values[HEIGHT]
        if said is None or command.raised or not math.isfinite(height_m) or self._lost(said):
            return _UP_M_S
        target_m = self._config.target_m + self._eased_m(knowledge)
        error_m = target_m - height_m - self._lift.under_way_m - self._ground_rise(said)
        return 0.0 if abs(error_m) <= self._config.dead_band_m else self._config.gain_1_s * error_m

    def _ground_rise(self, said: Said) -> float:
        """By how much the ground will lift the blade while the lift answers, m."""
        rise = said.values.get(VELOCITY[2], math.nan)
        delay_s = self._config.dead_time_s + self._config.lag_s
        return delay_s * (rise - self._lift.speed_m_s) if math.isfinite(rise) else 0.0

    def _eased_m(self, knowledge: Knowledge) -> float:
        """By how much a full blade is let up."""
        start = self._config.ease_from_share
        return self._config.ease_m * min(max((knowledge.load_share - start) / (1.0 - start), 0.0), 1.0)

    def _lost(self, said: Said) -> bool:
        """Whether the estimator has lost the height and says so, with some hysteresis; the truth is never lost."""
        limit_m = self._config.raise_when_sigma_m
        if limit_m is None or self._config.follows == TRUTH:
            return False
        sigma_m = said.values[sigma_column(HEIGHT)]
        self._trusts = sigma_m <= (limit_m if self._trusts else _TRUST_AGAIN * limit_m)
        return not self._trusts


class _LiftModel:
    """What the lift makes of what it is asked for, as far as the controller knows; the stops are not known."""

    def __init__(self, config: LevellingControlConfig, interval_s: float) -> None:
        self._limits = -config.fastest_down_m_s, config.fastest_up_m_s
        self._interval_s = interval_s
        self._lag_s = config.lag_s
        self._decay = math.exp(-interval_s / config.lag_s) if config.lag_s > 0.0 else 0.0
        self._waiting = deque([0.0] * round(config.dead_time_s / interval_s))
        self.speed_m_s = 0.0
        """Of the lift now."""

    def step(self, asked_m_s: float) -> None:
        """Move on by an interval during which this is asked for."""
        low, high = self._limits
        self._waiting.append(min(max(asked_m_s, low), high))
        self.speed_m_s = self._decay * self.speed_m_s + (1.0 - self._decay) * self._waiting.popleft()

    @property
    def under_way_m(self) -> float:
        """How far the lift will still go by what it has been asked for until now: what waits, and what it coasts."""
        return self._interval_s * sum(self._waiting) + self._lag_s * self.speed_m_s
