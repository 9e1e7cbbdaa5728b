"""Between the local frame and the globe: latitude, longitude and compass course exist only on this side of the house.

The local frame is east, north, up in the plane that touches the WGS 84 ellipsoid at the origin (pymap3d).
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
import pymap3d
from pydantic import Field

from twin.config import Config
from twin.geometry import wrap_angle
from twin.signals import FloatArray


class Origin(Config):
    """Where on the globe the local frame lies; heights are above the ellipsoid."""

    latitude_deg: Annotated[float, Field(ge=-89.0, le=89.0)] = 30.0
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 120.0
    height_m: Annotated[float, Field(ge=-1_000.0, le=9_000.0)] = 10.0
    geoid_height_m: Annotated[float, Field(ge=-110.0, le=90.0)] = 10.0
    """Of mean sea level above the ellipsoid here: receivers tell heights above the sea."""

    def geodetic(self, enu_m: FloatArray) -> FloatArray:
        """Latitude (deg), longitude (deg) and ellipsoidal height (m) of points (..., 3) of the local frame."""
        east, north, up = np.moveaxis(np.asarray(enu_m, dtype=np.float64), -1, 0)
        found = pymap3d.enu2geodetic(east, north, up, self.latitude_deg, self.longitude_deg, self.height_m)
        return np.stack([np.asarray(part, dtype=np.float64) for part in found], axis=-1)

    def enu(self, geodetic: FloatArray) -> FloatArray:
        """Points (..., 3) of the local frame at latitude (deg), longitude (deg) and ellipsoidal height (m)."""
        latitude, longitude, height = np.moveaxis(np.asarray(geodetic, dtype=np.float64), -1, 0)
        found = pymap3d.geodetic2enu(latitude, longitude, height, self.latitude_deg, self.longitude_deg, self.height_m)
        return np.stack([np.asarray(part, dtype=np.float64) for part in found], axis=-1)


def compass_deg(heading_rad: float) -> float:
    """Clockwise from north, in [0, 360), of an angle counter-clockwise from east."""
    return math.degrees(0.5 * math.pi - heading_rad) % 360.0


def heading_rad(compass: float) -> float:
    """Counter-clockwise from east, in (-pi, pi], of an angle clockwise from north, in degrees."""
    return float(wrap_angle(np.array(0.5 * math.pi - math.radians(compass))))
