"""Flatness figures are those of the heights inside the area, once a second."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.errors import BadInputError
from twin.signals import NS_PER_S
from twin.world.survey import SURVEY_COLUMNS, FieldSurvey
from twin.world.terrain import Terrain


def field() -> Terrain:
    heights = np.random.default_rng(5).normal(2.0, 0.04, (61, 101))
    return Terrain(heights, -5.0, -3.0, 0.1)


def test_figures_are_those_of_the_area() -> None:
    terrain = field()
    part = terrain.heights[10:31, 20:71]
    sd, mean, near, nearer_than_50mm = FieldSurvey(terrain, (-3.0, -2.0, 2.0, 0.0), design_height_m=1.5).measure()
    assert sd == pytest.approx(part.std(ddof=1))
    assert mean == pytest.approx(part.mean() - 1.5)
    assert near == np.mean(np.abs(part - part.mean()) <= 0.03)
    assert nearer_than_50mm == np.mean(np.abs(part - part.mean()) <= 0.05)
    # A normal distribution has erf(limit / (sigma sqrt 2)) within a limit; 1071 heights tell it to 1.5 % (1 sigma).
    assert near == pytest.approx(math.erf(0.03 / 0.04 / math.sqrt(2.0)), abs=0.05)
    assert nearer_than_50mm == pytest.approx(math.erf(0.05 / 0.04 / math.sqrt(2.0)), abs=0.05)


def test_a_changed_field_is_seen_at_the_next_second() -> None:
    terrain = field()
    survey = FieldSurvey(terrain, terrain.extent)
    first = survey.truth(0)
    assert len(first) == len(SURVEY_COLUMNS)
    terrain.heights[:] = 2.5
    assert survey.truth(NS_PER_S - 1) == first
    assert survey.truth(NS_PER_S) == (0.0, 2.5, 1.0, 1.0)


def test_an_area_off_the_terrain_is_refused() -> None:
    with pytest.raises(BadInputError, match="area_m"):
        FieldSurvey(field(), (20.0, 0.0, 30.0, 5.0))
