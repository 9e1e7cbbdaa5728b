"""How the satellites' geometry changes while they move: DOP, and with it every error, better and worse by turns.

Satellites rise and set over hours; the dilution of a full sky swings about its usual value by some part of it. A single
sine stands for that: ``1 + swing sin(2 pi t / period + phase)``, with a phase that belongs to the world (all members of
an ensemble stand under one sky). Errors, reported sigmas and DOP are multiplied by it alike, as they are when
satellites are masked (:func:`twin.sensors.gnss_states.dilution`).
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from twin.config import Config, Positive
from twin.randomness import world_generator
from twin.signals import NS_PER_S


class GeometrySwing(Config):
    """Slow change of the dilution."""

    swing_ratio: Annotated[float, Field(gt=0.0, lt=1.0)]
    """Its amplitude as a part of the usual value."""
    period_s: Positive
    """From one best geometry to the next."""


class Geometry:
    """The factor on errors, reported sigmas and DOP of the receiver ``name`` in the world ``seed``."""

    def __init__(self, config: GeometrySwing, *, seed: int, name: str) -> None:
        self._swing = config.swing_ratio
        self._rate = 2.0 * math.pi / config.period_s
        self._phase = 2.0 * math.pi * world_generator(seed, f"sensors.{name}.geometry").random()

    def at(self, t_ns: int) -> float:
        """The factor now."""
        return 1.0 + self._swing * math.sin(self._rate * t_ns / NS_PER_S + self._phase)
