"""Levelling: keeps the edge of a blade on the design plane by what is known of its height.

The lift is asked for the speed

    v = k (h_wanted - h - T v_h)

with h and v_h the height above the design plane and the vertical speed of the edge as the followed estimator says, and
T a look ahead over the valve's dead time and lag. The loop is an integrator behind a delay of about 0.2 s, so that
k = 2.5 per second keeps half of the gain that would make it swing (pi / 2 / 0.2 = 7.9 per second without the look
ahead). A dead band keeps the valve quiet. An estimator without vertical speed is followed without the look ahead.

The blade is lifted out of the ground, to the stop of its lift, where the driver wants it raised (headland turns), and,
with ``raise_when_sigma_m``, as long as the estimator's own sigma of the height is larger: it has lost the height and
knows it. An estimator that has not spoken, or says NaN, keeps the blade up too.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field

from twin.config import Config, NonNegative, Positive
from twin.signals import HEIGHT, VELOCITY, Command, Knowledge, Listening, Said, sigma_column

TRUTH = "truth"
_UP_M_S = 1.0
"""More than any lift can do: to the stop."""
_TRUST_AGAIN = 0.8
"""Share of ``raise_when_sigma_m`` below which the blade goes down again."""


class LevellingControlConfig(Config):
    """Who holds the blade, and by what."""

    kind: Literal["levelling"]
    follows: str = TRUTH
    """Estimator of the height, or "truth"."""
    gain_1_s: Annotated[float, Field(gt=0.0, le=20.0)] = 2.5
    """Lift speed per height error."""
    look_ahead_s: NonNegative = 0.2
    """Dead time and lag of the valve, over which the height is foreseen."""
    dead_band_m: NonNegative = 0.002
    """Errors up to this leave the valve shut."""
    target_m: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.0
    """Height wanted, above the design plane."""
    raise_when_sigma_m: Positive | None = None
    """Lift the blade as long as the estimator's sigma of the height is larger; without it never."""

    @property
    def listens(self) -> Listening:
        """Whom it listens to."""
        return Listening() if self.follows == TRUTH else Listening(estimators=(self.follows,), truth=False)

    @property
    def needed_columns(self) -> dict[str, tuple[str, ...]]:
        """Columns that are needed of the estimator."""
        return {} if self.follows == TRUTH else {self.follows: (HEIGHT,)}


class LevellingControl:
    """Implements :class:`twin.control.ImplementController`."""

    def __init__(self, config: LevellingControlConfig) -> None:
        self._config = config
        self._trusts = True

    def amend(self, command: Command, knowledge: Knowledge) -> Command:
        """Return the driver's command with the lift's speed in it."""
        said = (
            knowledge.seen_of_implement if self._config.follows == TRUTH else knowledge.said.get(self._config.follows)
        )
        height_m = math.nan if said is None else said.values[HEIGHT]
        if said is None or command.raised or not math.isfinite(height_m) or self._lost(said):
            return replace(command, lift_m_s=_UP_M_S)
        foreseen_m = height_m + self._config.look_ahead_s * self._rise(said)
        error_m = self._config.target_m - foreseen_m
        if abs(error_m) <= self._config.dead_band_m:
            return replace(command, lift_m_s=0.0)
        return replace(command, lift_m_s=self._config.gain_1_s * error_m)

    def _rise(self, said: Said) -> float:
        rise = said.values.get(VELOCITY[2], 0.0)
        return rise if math.isfinite(rise) else 0.0

    def _lost(self, said: Said) -> bool:
        """Whether the estimator has lost the height and says so, with some hysteresis."""
        limit_m = self._config.raise_when_sigma_m
        if limit_m is None:
            return False
        sigma_m = said.values.get(sigma_column(HEIGHT), 0.0)
        self._trusts = sigma_m <= (limit_m if self._trusts else _TRUST_AGAIN * limit_m)
        return not self._trusts
