"""What a whole turn tells: hard iron, the ellipse, the gyroscope's scale; and that less than a turn tells nothing."""

from __future__ import annotations

import numpy as np
import pytest

from twin.estimators.turn_fit import TurnFit, fit_turn

ACROSS_UT = 25.7
NOISE_UT = 0.3
SOFT = np.array([[1.03, 0.02], [-0.01, 0.98]])
IRON = np.array([15.0, -8.0])


def there_and_back(degrees: float, samples: int = 700) -> np.ndarray:
    """True angle (T, 1): out and back at an even rate."""
    half = np.radians(np.linspace(0.0, degrees, samples // 2))
    return np.concatenate([half, half[::-1]])[:, np.newaxis]


def seen(turned: np.ndarray, *, noise_ut: float = 0.0, seed: int = 0, start: float = 1.4) -> np.ndarray:
    """Field (T, R, 2) of a body that has turned so far, of soft and hard iron."""
    angle = start - turned
    field = ACROSS_UT * np.stack([np.cos(angle), np.sin(angle)], axis=-1) @ SOFT.T + IRON
    return field + noise_ut * np.random.default_rng(seed).normal(size=field.shape)


def fit(turned: np.ndarray, *, scale: float, **noise: float) -> TurnFit:
    return fit_turn(turned * (1.0 + scale), seen(turned, **noise), np.ones(turned.shape, dtype=bool))


def directions(found: TurnFit, field: np.ndarray) -> np.ndarray:
    x, y = np.einsum("rij,trj->rit", found.correction, field - found.centre_ut)[0]
    return np.unwrap(np.arctan2(y, x))


@pytest.mark.parametrize("scale", [-0.03, 0.0, 0.015, 0.03])
@pytest.mark.parametrize("degrees", [360.0, -358.0, 720.0])
def test_without_noise_everything_is_found(scale: float, degrees: float) -> None:
    turned = there_and_back(degrees)
    found = fit(turned, scale=scale)
    assert found.found.all()
    np.testing.assert_allclose(found.centre_ut[0], IRON, atol=1e-6)
    assert found.rate_factor[0] == pytest.approx(1.0 / (1.0 + scale), abs=1e-9)
    shown = directions(found, seen(turned))
    np.testing.assert_allclose(shown - shown[0], -turned[:, 0], atol=1e-8)


def test_a_plain_circle_is_left_as_it_is() -> None:
    turned = there_and_back(360.0)
    field = ACROSS_UT * np.stack([np.cos(-turned), np.sin(-turned)], axis=-1)
    found = fit_turn(turned, field, np.ones(turned.shape, dtype=bool))
    np.testing.assert_allclose(found.correction[0], np.eye(2), atol=1e-9)
    assert found.rate_factor[0] == pytest.approx(1.0, abs=1e-9)


def test_the_sigma_of_the_scale_is_what_its_errors_have_over_many_draws() -> None:
    turned = np.repeat(there_and_back(360.0), 300, axis=1)
    found = fit(turned, scale=0.02, noise_ut=NOISE_UT)
    errors = found.rate_factor - 1.0 / 1.02
    # 300 draws tell a standard deviation to 4 %: 0.83 to 1.17 are four of those.
    assert 0.83 < np.sqrt(np.mean((errors / found.rate_sigma) ** 2)) < 1.17
    # 0.3 uT in 25.7 is 0.0117 rad; 700 samples over angles spread evenly over 2 pi, 1.81 rad rms about their mean,
    # would tell a slope to 0.0117 / (sqrt(700) 1.81) = 0.024 % if nothing else were sought; all else costs some.
    assert 0.00024 < found.rate_sigma.mean() < 0.0024


def test_less_than_a_whole_turn_changes_nothing() -> None:
    found = fit(there_and_back(300.0), scale=0.02, noise_ut=NOISE_UT)
    assert not found.found.any()
    np.testing.assert_array_equal(found.centre_ut, 0.0)
    np.testing.assert_array_equal(found.correction[0], np.eye(2))
    assert found.rate_factor[0] == 1.0
    assert np.isnan(found.rate_sigma[0])


def test_members_stand_alone_and_lost_samples_are_left_out() -> None:
    turned = np.repeat(there_and_back(360.0), 3, axis=1)
    field = seen(turned, noise_ut=NOISE_UT)
    used = np.ones(turned.shape, dtype=bool)
    used[::3, 1] = False
    used[:, 2] = False
    broken = field.copy()
    broken[~used] = np.nan
    found = fit_turn(1.01 * turned, broken, used)
    assert found.found.tolist() == [True, True, False]
    for member, rows in ((0, slice(None)), (1, used[:, 1])):
        one = slice(member, member + 1)
        alone = fit_turn(1.01 * turned[rows, one], field[rows, one], used[rows, one])
        np.testing.assert_allclose(found.rate_factor[one], alone.rate_factor, rtol=1e-9)
        np.testing.assert_allclose(found.centre_ut[one], alone.centre_ut, rtol=1e-9)
