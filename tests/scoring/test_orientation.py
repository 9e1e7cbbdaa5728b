"""The split of an orientation error into heading and inclination."""

from __future__ import annotations

import numpy as np
import pytest

from twin.scoring.orientation import multiply, orientation_errors


def about(axis: int, degrees: float, count: int = 4) -> np.ndarray:
    q = np.zeros((count, 4))
    q[:, axis], q[:, 3] = np.sin(np.deg2rad(degrees) / 2.0), np.cos(np.deg2rad(degrees) / 2.0)
    return q


OPTICAL = multiply(about(2, 130.0), about(0, 50.0))
ALL = np.ones(4, dtype=bool)


def test_a_turn_about_the_vertical_is_heading_and_a_tilt_is_inclination() -> None:
    heading = orientation_errors(multiply(about(2, 7.0), OPTICAL), OPTICAL, ALL)
    assert heading.heading_deg == pytest.approx(7.0)
    assert heading.inclination_deg == pytest.approx(0.0, abs=1e-5)
    assert heading.total_deg == pytest.approx(7.0)
    assert heading.relative_heading_deg == pytest.approx(0.0, abs=1e-9)
    tilt = orientation_errors(multiply(about(1, 5.0), OPTICAL), OPTICAL, ALL)
    assert tilt.heading_deg == pytest.approx(0.0, abs=1e-9)
    assert tilt.inclination_deg == pytest.approx(5.0)


def test_both_together_are_cos_of_halves_multiplied() -> None:
    """cos(total / 2) = cos(heading / 2) cos(inclination / 2)."""
    errors = orientation_errors(multiply(multiply(about(2, 40.0), about(0, 30.0)), OPTICAL), OPTICAL, ALL)
    assert errors.heading_deg == pytest.approx(40.0)
    assert errors.inclination_deg == pytest.approx(30.0)
    half = np.cos(np.deg2rad(20.0)) * np.cos(np.deg2rad(15.0))
    assert errors.total_deg == pytest.approx(2.0 * np.rad2deg(np.arccos(half)))


def test_the_sign_of_a_quaternion_and_what_is_not_scored_do_not_matter() -> None:
    estimated, optical = -multiply(about(2, 7.0), OPTICAL), OPTICAL.copy()
    estimated[0] = about(0, 180.0, 1)
    optical[1] = np.nan
    errors = orientation_errors(estimated, optical, np.array([False, True, True, True]))
    assert errors.heading_deg == pytest.approx(7.0)
    assert errors.samples == 2


def test_a_mean_across_the_half_turn_is_taken_off() -> None:
    estimated = np.concatenate([multiply(about(2, angle, 2), OPTICAL[:2]) for angle in (178.0, -178.0)])
    errors = orientation_errors(estimated, OPTICAL, ALL)
    assert errors.heading_deg == pytest.approx(178.0)
    assert errors.relative_heading_deg == pytest.approx(2.0)


def test_nothing_known_is_nothing_scored() -> None:
    errors = orientation_errors(np.full((4, 4), np.nan), OPTICAL, ALL)
    assert errors.samples == 0
    assert np.isnan(errors.heading_deg)
