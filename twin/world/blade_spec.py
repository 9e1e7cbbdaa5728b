"""Figures of a levelling blade and of the soil in front of it; :mod:`twin.world.blade` puts them to work.

The soil's are choices for a wet plough layer, unless a source is named:

- Angle of repose 30 degrees. Capacity per metre of blade follows: height^2 / (2 tan 30 degrees).
- Cutting resistance 10 kPa of cut cross-section: the passive earth pressure of a cohesive soil without friction adds
  2 c_u to the weight's part (Rankine), here with an undrained shear strength c_u of 5 kPa. Dry loam takes several times
  as much.
- Load: 1700 kg/m3 sliding on soil with a friction of 0.5 (27 degrees).
- Evening out: diffusion of 0.05 m2 per metre of travel, which spreads a lump to +-0.3 m in one metre.
- The vertical force of soil on the blade is small beside the weight of what carries it, and left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin.config import Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class BladeSpec:
    """A straight edge across a link, and the soil's figures in front of it."""

    body: str
    middle_m: Vector3
    """Middle of the edge in the link's frame; the edge runs along the link's y axis."""
    width_m: float
    height_m: float
    """Of the blade above its edge: the highest wedge that it holds."""
    repose_rad: float = math.radians(30.0)
    """Slope at which loose soil stands."""
    resistance_pa: float = 10e3
    """Force per cross-section of soil that is cut."""
    density_kg_m3: float = 1700.0
    """Of the carried soil."""
    friction: float = 0.5
    """Of the carried soil on the ground."""
    base_n: float = 150.0
    """Friction of the edge itself, all of it in the ground."""
    evening_m: float = 0.05
    """Lateral diffusion of the load, m^2 per metre of travel."""

    @property
    def capacity_m3(self) -> float:
        """The most that the blade carries."""
        return self.width_m * self.height_m**2 / (2.0 * math.tan(self.repose_rad))
