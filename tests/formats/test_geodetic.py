from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.formats.geodetic import Origin, compass_deg, heading_rad

A, F = 6_378_137.0, 1.0 / 298.257223563
"""WGS 84."""


@given(
    east=st.floats(-2e4, 2e4), north=st.floats(-2e4, 2e4), up=st.floats(-100.0, 100.0), latitude=st.floats(-70.0, 70.0)
)
def test_there_and_back(east: float, north: float, up: float, latitude: float) -> None:
    origin = Origin(latitude_deg=latitude, longitude_deg=179.99)
    point = np.array([east, north, up])
    np.testing.assert_allclose(origin.enu(origin.geodetic(point)), point, atol=1e-5)


def test_a_metre_is_as_many_degrees_as_the_ellipsoid_says() -> None:
    origin = Origin(latitude_deg=30.0, longitude_deg=120.0, height_m=0.0)
    e2 = F * (2.0 - F)
    w = math.sqrt(1.0 - e2 * math.sin(math.radians(30.0)) ** 2)
    prime, meridian = A / w, A * (1.0 - e2) / w**3
    latitude, longitude, _ = origin.geodetic(np.array([1.0, 1.0, 0.0]))
    assert math.radians(latitude - 30.0) * meridian == pytest.approx(1.0, rel=1e-5)
    assert math.radians(longitude - 120.0) * prime * math.cos(math.radians(30.0)) == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize(
    ("heading", "compass"), [(0.0, 90.0), (90.0, 0.0), (180.0, 270.0), (-90.0, 180.0), (91.0, 359.0)]
)
def test_the_compass_turns_the_other_way_and_begins_in_the_north(heading: float, compass: float) -> None:
    assert compass_deg(math.radians(heading)) == pytest.approx(compass, abs=1e-9)
    assert math.degrees(heading_rad(compass)) == pytest.approx(heading, abs=1e-9)
