"""Soils: how much a wheel can push, how much it slips, and what rolling costs.

The presets follow the traction equations of Brixius (1987) as printed in ASABE D497, "Agricultural Machinery
Management Data", with that standard's wheel numeric Bn for each class of soil:

- gross traction ratio  mu_g(s) = 0.88 (1 - exp(-0.1 Bn)) (1 - exp(-7.5 s)) + 0.04
- motion resistance ratio  rho = 1/Bn + 0.04 (+ 0.5 s / sqrt(Bn), dropped here: 0.4 % of the load at 5 % slip)

Ours is a linear slip stiffness up to a friction limit: the limit is mu_g at full slip and the stiffness is the secant
of mu_g's slip-dependent part at 10 % slip, the middle of the 8 to 15 % where tractors pull best.

``asphalt`` is no soil: there the tyre's own rubber and carcass slip, and the figures are a passenger car tyre's.
Slip stiffnesses 22.3 per unit of slip and 21.9 per radian of slip angle, and its lateral peak friction of 1.05, are
those of the BMW 320i in the CommonRoad vehicle models (Althoff and Wuersching 2020, parameters p_kx1, p_ky1, p_dy1);
motion resistance 0.013 is the usual figure for car tyres on asphalt (Gillespie 1992, from memory).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from twin.config import Config

SoilName = Literal["asphalt", "firm", "tilled", "soft", "paddy"]

WHEEL_NUMERIC: dict[SoilName, float] = {"firm": 55.0, "tilled": 40.0, "soft": 20.0, "paddy": 8.0}
"""Bn: firm, tilled and soft from ASABE D497; 8 for a puddled paddy bottom is a choice (rho 0.165, mu 0.52)."""

_SECANT_SLIP = 0.10
_LATERAL_TO_LONGITUDINAL = 1.3
"""Cornering stiffness per longitudinal slip stiffness. Tractor yaw models use about 6 (front) to 8 (rear) per radian
and unit of load on firm ground (Karkee and Steward 2010, from memory); 1.3 times 4.6 is 6.0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Soil:
    """What the tyre-soil model needs to know."""

    friction: float
    """Largest horizontal force per normal load."""
    longitudinal_stiffness: float
    """Horizontal force per normal load and unit of slip 1 - v / (omega r)."""
    lateral_stiffness: float
    """Lateral force per normal load and radian of slip angle."""
    rolling_resistance: float
    """Motion resistance per normal load."""


ASPHALT = Soil(friction=1.05, longitudinal_stiffness=22.3, lateral_stiffness=21.9, rolling_resistance=0.013)
"""A passenger car tyre on dry asphalt; sources in the module's docstring."""


class SoilConfig(Config):
    """Soil: a preset, and single values that replace the preset's."""

    preset: SoilName = "tilled"
    """Kind of ground: asphalt, firm, tilled, soft or paddy."""
    friction: Annotated[float, Field(gt=0.0, le=2.0)] | None = None
    """Largest horizontal force per normal load."""
    longitudinal_stiffness: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """Force per normal load and unit of slip."""
    lateral_stiffness: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """Force per normal load and radian of slip angle."""
    rolling_resistance: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """Motion resistance per normal load."""

    def soil(self) -> Soil:
        """Return the preset with this section's own values on top."""
        base = ASPHALT if self.preset == "asphalt" else brixius(WHEEL_NUMERIC[self.preset])

        def pick(own: float | None, preset: float) -> float:
            return preset if own is None else own

        return Soil(
            friction=pick(self.friction, base.friction),
            longitudinal_stiffness=pick(self.longitudinal_stiffness, base.longitudinal_stiffness),
            lateral_stiffness=pick(self.lateral_stiffness, base.lateral_stiffness),
            rolling_resistance=pick(self.rolling_resistance, base.rolling_resistance),
        )


def brixius(wheel_numeric: float) -> Soil:
    """Soil of a given wheel numeric Bn, by the equations in the module's docstring."""
    cohesion = 0.88 * (1.0 - math.exp(-0.1 * wheel_numeric))
    stiffness = cohesion * (1.0 - math.exp(-7.5 * _SECANT_SLIP)) / _SECANT_SLIP
    return Soil(
        friction=cohesion + 0.04,
        longitudinal_stiffness=stiffness,
        lateral_stiffness=_LATERAL_TO_LONGITUDINAL * stiffness,
        rolling_resistance=1.0 / wheel_numeric + 0.04,
    )
