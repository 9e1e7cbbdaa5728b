"""Errors against a reference by hand, and of claims that are right or too small."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.scoring.against_reference import Differences, HeightDifferences, ReferenceTally
from twin.signals import FloatArray


def differences(east: FloatArray, north: FloatArray, sigma: float) -> Differences:
    variance = np.full(len(east), sigma**2)
    return Differences(east_m=east, north_m=north, var_e_m2=variance, cov_en_m2=np.zeros(len(east)), var_n_m2=variance)


def test_by_hand_and_by_quality() -> None:
    # 3-4-5 and 0.6-0.8-1: lengths 5 and 1 twice; one row where the reference says nothing.
    east = np.array([3.0, 0.6, -0.6, math.nan])
    north = np.array([4.0, 0.8, 0.8, 1.0])
    quality = np.array([5.0, 4.0, 4.0, 4.0])
    tally = ReferenceTally()
    for part in (slice(0, 2), slice(2, 4)):
        tally.add(differences(east[part], north[part], 1.0), quality[part], np.ones(2, dtype=bool))
    found = tally.figures()
    assert found["reference.epochs"] == 3.0
    assert found["reference.rmse_m"] == pytest.approx(math.sqrt(27.0 / 3.0))
    assert found["reference.max_m"] == pytest.approx(5.0)
    assert (found["reference.mean_e_m"], found["reference.mean_n_m"]) == pytest.approx((1.0, 5.6 / 3.0))
    # e' P^-1 e: 25, 1, 1; chi-square of two has 95 % below 5.99.
    assert found["reference.mean_nees"] == pytest.approx(9.0)
    assert found["reference.error_over_sigma"] == pytest.approx(math.sqrt(4.5))
    assert found["reference.inside_percent"] == pytest.approx(200.0 / 3.0)
    assert found["reference.rmse_fixed_m"] == pytest.approx(1.0)
    assert found["reference.rmse_float_m"] == pytest.approx(5.0)
    assert (found["reference.epochs_fixed"], found["reference.epochs_float"]) == (2.0, 1.0)


def test_the_covariance_of_east_and_north_counts() -> None:
    # P = [[4, 2], [2, 3]]: e = (1, 2) gives 11 / 8 (as in the tests of NEES).
    one = np.ones(1)
    found = Differences(east_m=one, north_m=2.0 * one, var_e_m2=4.0 * one, cov_en_m2=2.0 * one, var_n_m2=3.0 * one)
    assert found.nees[0] == pytest.approx(11.0 / 8.0)
    certain = Differences(east_m=one, north_m=one, var_e_m2=one, cov_en_m2=one, var_n_m2=one)
    assert math.isnan(certain.nees[0])


def test_honest_and_over_confident_claims_of_known_errors() -> None:
    rng = np.random.default_rng(4)
    east, north = 0.2 * rng.standard_normal((2, 20_000))
    quality, fixed = np.full(20_000, 5.0), np.ones(20_000, dtype=bool)
    honest, confident = ReferenceTally(), ReferenceTally()
    honest.add(differences(east, north, 0.2), quality, fixed)
    confident.add(differences(east, north, 0.02), quality, fixed)
    # The mean of 40 000 squares has a relative standard deviation of sqrt(2 / 40 000) = 0.7 %.
    assert honest.figures()["reference.error_over_sigma"] == pytest.approx(1.0, abs=0.015)
    assert honest.figures()["reference.inside_percent"] == pytest.approx(95.0, abs=0.6)
    assert confident.figures()["reference.error_over_sigma"] == pytest.approx(10.0, abs=0.15)
    # A hundredth of 5.99: 1 - exp(-0.03) lie within.
    assert confident.figures()["reference.inside_percent"] == pytest.approx(2.95, abs=0.4)
    # 95 % of Rayleigh are below 2.448 sigma; the percentile is read from bins of 2.3 %.
    assert honest.figures()["reference.p95_m"] == pytest.approx(2.448 * 0.2, rel=0.03)


def test_fixes_of_the_reference_are_preferred_to_what_it_says_without() -> None:
    zeros = np.zeros(4)
    tally = ReferenceTally()
    errors = differences(np.array([1.0, 1.0, 9.0, 9.0]), zeros, 1.0)
    tally.add(errors, np.full(4, 4.0), np.array([True, True, False, False]))
    assert tally.figures()["reference.rmse_m"] == pytest.approx(1.0)
    never = ReferenceTally()
    never.add(errors, np.full(4, 4.0), np.zeros(4, dtype=bool))
    assert never.figures()["reference.epochs"] == 4.0


def test_heights_by_hand() -> None:
    # 3, -1, 1 and one unknown; sigma 1: squares 9, 1, 1, and 95 % of one number's are below 3.84.
    up = np.array([3.0, -1.0, 1.0, math.nan])
    tally = ReferenceTally(HeightDifferences)
    claimed = HeightDifferences(up_m=up, var_u_m2=np.ones(4))
    tally.add(claimed, np.array([5.0, 4.0, 4.0, 4.0]), np.ones(4, dtype=bool))
    found = tally.figures()
    assert found["reference.height_epochs"] == 3.0
    assert found["reference.height_rmse_m"] == pytest.approx(math.sqrt(11.0 / 3.0))
    assert (found["reference.height_mean_m"], found["reference.height_max_m"]) == pytest.approx((1.0, 3.0))
    assert found["reference.height_error_over_sigma"] == pytest.approx(math.sqrt(11.0 / 3.0))
    assert found["reference.height_inside_percent"] == pytest.approx(200.0 / 3.0)
    assert found["reference.height_rmse_float_m"] == pytest.approx(3.0)
    assert found["reference.height_rmse_fixed_m"] == pytest.approx(1.0)
    nothing_claimed = HeightDifferences(up_m=up, var_u_m2=np.zeros(4))
    assert np.isnan(nothing_claimed.nees).all()
    assert ReferenceTally(HeightDifferences).figures() == {}
