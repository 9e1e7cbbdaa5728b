"""NIS and whiteness: against numpy and scipy on whole series, by hand, and of filters known to be right or wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from twin.recording import Stream
from twin.scoring.innovations import InnovationTally, NisTally, Whiteness
from twin.signals import FloatArray


def in_pieces(values: FloatArray, *sizes: int) -> list[FloatArray]:
    """The values in pieces of these sizes, over and over."""
    ends = np.cumsum(np.resize(np.array(sizes), len(values)))
    return np.split(values, ends[ends < len(values)])


def whiteness(values: FloatArray, *sizes: int) -> Whiteness:
    found = Whiteness()
    for piece in in_pieces(values, *sizes):
        found.add(piece)
    return found


def test_autocorrelation_by_hand() -> None:
    # 1, 3, 2, 6 have the mean 3 and deviations -2, 0, -1, 3: products 0, 0, -3; squares 4 + 0 + 1 + 9.
    found = whiteness(np.array([1.0, 3.0, 2.0, 6.0]), 1)
    assert found.mean == pytest.approx(3.0)
    assert found.rms == pytest.approx(math.sqrt(50.0 / 4.0))
    assert found.lag1 == pytest.approx(-3.0 / 14.0)
    assert found.bound == pytest.approx(1.96 / 2.0)


@pytest.mark.parametrize("offset", [0.0, 5.0, -1e6])
@pytest.mark.parametrize("sizes", [(1,), (7, 1, 100), (5000,)])
def test_pieces_with_gaps_give_what_the_whole_gives(offset: float, sizes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    noise = rng.standard_normal(3001)
    values = offset + noise[1:] + 0.6 * noise[:-1]
    found = whiteness(np.insert(values, [0, 40, 40, 1700, 3000], math.nan), *sizes)
    centred = values - values.mean()
    assert found.count == 3000
    assert found.mean == pytest.approx(values.mean(), rel=1e-12, abs=1e-12)
    assert found.rms == pytest.approx(math.sqrt(np.mean(values**2)), rel=1e-12)
    assert found.lag1 == pytest.approx((centred[1:] @ centred[:-1]) / (centred @ centred), rel=1e-8)


def test_white_noise_is_within_its_bound_and_a_moving_average_is_not() -> None:
    rng = np.random.default_rng(8)
    inside = 0
    for _ in range(400):
        noise = rng.standard_normal(200)
        found = whiteness(noise, 50)
        inside += abs(found.lag1) <= found.bound
    # 95 % of 400 are 380, with a standard deviation of 4.4; r is biased by -1/N, which is nothing beside 1.96/sqrt(N).
    assert 366 <= inside <= 394
    noise = rng.standard_normal(10_001)
    # The lag-1 autocorrelation of e_k + 0.6 e_k-1 is 0.6 / (1 + 0.36).
    assert whiteness(noise[1:] + 0.6 * noise[:-1], 999).lag1 == pytest.approx(0.6 / 1.36, abs=0.03)


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 2.0], [4.0, 4.0, 4.0], [math.nan, math.nan]])
def test_too_little_has_no_autocorrelation(values: list[float]) -> None:
    assert math.isnan(whiteness(np.array(values), 2).lag1)


@pytest.mark.parametrize("degrees", [1, 2])
def test_nis_as_scipy_has_it(degrees: int) -> None:
    rng = np.random.default_rng(5)
    values = rng.chisquare(degrees, 5000)
    found = NisTally(degrees)
    for piece in in_pieces(np.insert(values, [0, 3000], math.nan), 13, 400):
        found.add(piece)
    figures = found.figures("nis")
    low, high = stats.chi2.interval(0.95, 5000 * degrees)
    assert figures["nis"] == pytest.approx(values.mean(), rel=1e-12)
    assert (figures["nis_low"], figures["nis_high"]) == pytest.approx((low / 5000, high / 5000), rel=1e-12)
    inside = 100.0 * np.mean(values <= stats.chi2.ppf(0.95, degrees))
    assert figures["nis_inside_percent"] == pytest.approx(inside, rel=1e-12)
    assert figures["nis_updates"] == 5000.0


def scalar_filter(r: float, *, told_r: float, seed: int) -> FloatArray:
    """Innovation and NIS (T, 2) of the steady filter of a random walk (q = 1), told another measurement variance."""
    rng = np.random.default_rng(seed)
    p = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * told_r))  # of p = p r / (p + r) + q, before the update
    x = state = 0.0
    rows = []
    for _ in range(4000):
        x += rng.standard_normal()
        innovation = x + math.sqrt(r) * rng.standard_normal() - state
        rows.append((innovation, innovation**2 / (p + told_r)))
        state += p / (p + told_r) * innovation
    return np.array(rows)


def figures_of(rows: FloatArray) -> dict[str, float]:
    columns = ("innovation_speed_m_s", "nis_speed", "gated_speed")
    tally = InnovationTally(columns)
    gated = (rows[:, 1] > 9.0).astype(float)
    values = np.column_stack([rows, gated])[:, np.newaxis]
    tally.add(Stream(columns=columns, t_ns=np.arange(len(rows)), values=values))
    assert tally.figures()["innovation.gated_speed_updates"] == gated.sum()
    return tally.figures()


def test_a_filter_told_the_truth_is_consistent_and_white() -> None:
    found = figures_of(scalar_filter(4.0, told_r=4.0, seed=1))
    assert found["consistency.nis_speed_low"] < found["consistency.nis_speed"] < found["consistency.nis_speed_high"]
    assert abs(found["innovation.lag1_speed"]) < found["innovation.lag1_bound_speed"]
    assert found["consistency.nis_speed_inside_percent"] == pytest.approx(95.0, abs=1.1)  # 3 sigma of 4000
    assert abs(found["innovation.mean_speed_m_s"]) < 3.0 * found["innovation.rms_speed_m_s"] / math.sqrt(4000)


def test_a_filter_told_too_much_or_too_little_noise_is_neither() -> None:
    confident = figures_of(scalar_filter(4.0, told_r=0.04, seed=2))
    assert confident["consistency.nis_speed"] > 3.0 * confident["consistency.nis_speed_high"]
    # It takes the noise for motion, and takes it back the next time.
    assert confident["innovation.lag1_speed"] < -5.0 * confident["innovation.lag1_bound_speed"]
    shy = figures_of(scalar_filter(4.0, told_r=400.0, seed=3))
    assert shy["consistency.nis_speed"] < 0.5 * shy["consistency.nis_speed_low"]
    assert shy["innovation.lag1_speed"] > 5.0 * shy["innovation.lag1_bound_speed"]
