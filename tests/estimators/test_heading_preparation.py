"""Calibration of chapter 3, the pre-filter's three bands, and iron of a magnetometer."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.robot import G, field_at
from twin.errors import BadInputError
from twin.estimators.heading_inputs import HeadingSample
from twin.estimators.heading_preparation import BandConfig, BandFilter, Preparation, PreparationConfig
from twin.estimators.magnetometer_calibration import fit_ellipsoid, hard_iron_by_min_max, soft_iron_ratio

TABLE_1_FIELD = BandConfig(pass_above=3.0, mean_above=3.0, low_pass_weight=0.025)
TABLE_1_FORCE = BandConfig(pass_above=0.2095, mean_above=0.1796, low_pass_weight=0.025)
FRESH = np.array([True])


def one(value: float) -> np.ndarray:
    return np.full((1, 3), value)


def sample(index: int, *, force=(0.0, 0.0, G), rate=(0.0, 0.0, 0.0), field=(0.0, 0.0, 0.0)) -> HeadingSample:
    return HeadingSample(
        index=index,
        dt_s=0.02,
        force=np.array([force]),
        rate=np.array([rate]),
        inertial=FRESH,
        field=np.array([field]),
        magnetic=FRESH,
        slots=np.zeros((1, 2)),
        counted=np.array([False]),
    )


@pytest.mark.parametrize(
    ("second", "expected"),
    [(9.8 + 0.21, 9.8 + 0.21), (9.8 + 0.19, 9.8 + 0.095), (9.8 + 0.1, 9.8 + 0.0025), (9.8 - 0.19, 9.8 - 0.095)],
)
def test_the_bands_of_table_1_pass_take_the_mean_and_low_pass(second: float, expected: float) -> None:
    band = BandFilter(TABLE_1_FORCE)
    band.step(one(9.8), FRESH, 0.02)
    np.testing.assert_allclose(band.step(one(second), FRESH, 0.02), one(expected), rtol=1e-12)


def test_the_low_pass_keeps_its_cut_off_at_another_rate() -> None:
    """0.025 at 50 Hz is 0.204 Hz; a step of 1 uT has come to 1 - 1/e after 0.78 s, at 50 and at 286 Hz."""
    for step_s in (0.02, 0.0035):
        band = BandFilter(TABLE_1_FIELD)
        band.step(one(0.0), FRESH, step_s)
        for _ in range(round(0.78 / step_s)):
            found = band.step(one(1.0), FRESH, step_s)
        assert found[0, 0] == pytest.approx(1.0 - np.exp(-1.0), abs=0.01)


def test_the_gyroscope_has_a_dead_band_and_a_lost_sample_changes_nothing() -> None:
    band = BandFilter(BandConfig(pass_above=0.267, mean_above=0.267, low_pass_weight=0.0), towards_zero=True)
    assert band.step(one(0.266), FRESH, 0.02)[0, 0] == 0.0
    assert band.step(one(-0.268), FRESH, 0.02)[0, 0] == -0.268
    assert band.step(one(9.0), ~FRESH, 0.02)[0, 0] == -0.268


def test_offsets_come_from_the_standstill_and_gravity_stays_on_the_upward_axis() -> None:
    preparation = Preparation(PreparationConfig(standstill_s=0.2, filtered=False), step_s=0.02, runs=1)
    for index in range(10):
        assert preparation.take(sample(index, force=(0.3, -0.2, 10.0), rate=(0.01, 0.02, 0.03))) is None
    found = preparation.take(sample(10, force=(1.3, -0.2, 10.0), rate=(0.01, 0.02, 0.53)))
    assert found is not None
    np.testing.assert_allclose(found.force, [[1.0, 0.0, G]], atol=1e-12)
    np.testing.assert_allclose(found.rate, [[0.0, 0.0, 0.5]], atol=1e-12)


def test_a_turn_on_the_spot_gives_the_level_hard_iron_and_its_own_heading() -> None:
    iron = np.array([15.0, -8.0, 30.0])
    preparation = Preparation(PreparationConfig(standstill_s=0.2, turn_s=8.0, filtered=False), step_s=0.02, runs=1)
    rate = 2.0 * np.pi / 6.0
    heading = np.concatenate([np.zeros(10), rate * 0.02 * np.arange(1, 401)])
    for index, now in enumerate(heading):
        moving = rate if index >= 10 else 0.0
        assert preparation.take(sample(index, rate=(0.0, 0.0, moving), field=field_at(now) + iron)) is None
    found = preparation.take(sample(410, field=field_at(heading[-1]) + iron))
    assert found is not None
    np.testing.assert_allclose(found.field[0, :2], field_at(heading[-1])[:2], atol=0.02)
    assert found.field[0, 2] == pytest.approx(field_at(0.0)[2] + iron[2])  # a level turn says nothing of it
    assert preparation.turned[0] == pytest.approx(8.0 * rate, rel=1e-9)


def everywhere(count: int, seed: int) -> np.ndarray:
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return 48.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_min_max_finds_hard_iron_and_the_ratio_soft_iron() -> None:
    iron = np.array([20.0, -35.0, 5.0])
    np.testing.assert_allclose(hard_iron_by_min_max(everywhere(20_000, 1) + iron), iron, atol=0.1)
    assert soft_iron_ratio(everywhere(20_000, 1)) == pytest.approx(1.0, abs=0.01)
    assert soft_iron_ratio(everywhere(20_000, 1) * [1.1, 1.0, 0.9]) == pytest.approx(1.1 / 0.9, rel=0.01)


def test_an_ellipsoid_fit_undoes_hard_and_symmetric_soft_iron() -> None:
    iron, soft = np.array([20.0, -35.0, 5.0]), np.array([[1.1, 0.05, 0.0], [0.05, 0.95, -0.03], [0.0, -0.03, 1.0]])
    field = everywhere(500, 2)
    found = fit_ellipsoid(field @ soft.T + iron)
    np.testing.assert_allclose(found.hard_iron_ut, iron, atol=1e-6)
    corrected = found.apply(field @ soft.T + iron)
    scale = np.cbrt(np.linalg.det(soft))
    np.testing.assert_allclose(corrected, field * scale, atol=1e-6)


def test_readings_that_span_no_ellipsoid_are_refused() -> None:
    flat = everywhere(200, 3) * [1.0, 1.0, 0.0]
    with pytest.raises(BadInputError, match="turn the sensor about all three axes"):
        fit_ellipsoid(flat)
    with pytest.raises(BadInputError, match="at least 9"):
        fit_ellipsoid(everywhere(8, 4))


def test_a_whole_turn_also_tells_soft_iron_and_the_gyroscopes_scale() -> None:
    """Turned around and back with a gyroscope 2 % too quick: after it 50 deg are 50 deg, by rate and by field."""
    soft, iron = np.diag([1.04, 0.97, 1.0]), np.array([15.0, -8.0, 30.0])
    config = PreparationConfig(standstill_s=0.2, turn_s=12.0, turn_fit=True, filtered=False)
    preparation = Preparation(config, step_s=0.02, runs=1)
    rate = 2.0 * np.pi / 6.0
    rates = np.concatenate([np.zeros(10), np.full(300, rate), np.full(300, -rate)])
    for index, heading in enumerate(0.02 * np.cumsum(rates)):
        field = field_at(heading) @ soft + iron
        assert preparation.take(sample(index, rate=(0.0, 0.0, 1.02 * rates[index]), field=field)) is None
    fifty = np.radians(50.0)
    straight = preparation.take(sample(610, field=field_at(0.0) @ soft + iron))
    turned = preparation.take(sample(611, rate=(0.0, 0.0, 1.02), field=field_at(fifty) @ soft + iron))
    assert straight is not None
    assert turned is not None
    assert turned.rate[0, 2] == pytest.approx(1.0, abs=1e-6)
    shown = [np.arctan2(each.field[0, 1], each.field[0, 0]) for each in (straight, turned)]
    assert shown[0] - shown[1] == pytest.approx(fifty, abs=1e-6)
    assert preparation.turned[0] == pytest.approx(0.0, abs=1e-9)
    assert preparation.scale_sigma[0] < 1e-3


def test_a_turn_that_was_not_whole_leaves_the_hard_iron_of_the_extremes() -> None:
    iron = np.array([15.0, -8.0, 30.0])
    config = PreparationConfig(standstill_s=0.2, turn_s=4.0, turn_fit=True, filtered=False)
    preparation = Preparation(config, step_s=0.02, runs=1)
    rate = np.radians(270.0) / 4.0
    heading = np.concatenate([np.zeros(10), rate * 0.02 * np.arange(1, 201)])
    for index, now in enumerate(heading):
        preparation.take(sample(index, rate=(0.0, 0.0, rate * (index >= 10)), field=field_at(now) + iron))
    preparation.take(sample(210, field=field_at(heading[-1]) + iron))
    seen = field_at(heading[10:])[:, :2]
    np.testing.assert_allclose(preparation.hard_iron[0, :2], iron[:2] + 0.5 * (seen.max(0) + seen.min(0)), atol=1e-9)
    assert np.isnan(preparation.scale_sigma[0])
