"""When a small machine rests: soon after a quick turn, not in a slow one, and with a bias that has changed unseen."""

from __future__ import annotations

import numpy as np

from twin.estimators.heading_rest import RestConfig, RestDetector

STEP_S = 0.02
GYRO, ACCEL, BIAS = float(np.deg2rad(0.05)), 0.04, float(np.deg2rad(2.7))
COMPASS = float(np.deg2rad(1.0))


def watch(
    rate: np.ndarray, *, turning: np.ndarray | None = None, compass: bool = True, runs: int = 20, rolled: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rest, surprise and its time (T, R) while the gyroscope reads ``rate`` (T,) and the body turns at ``turning``."""
    detector = RestDetector(
        RestConfig(), accel_noise_m_s2=ACCEL, gyro_noise_rad_s=GYRO, gyro_bias_rad_s=BIAS, runs=runs
    )
    rng = np.random.default_rng(3)
    turned = np.cumsum(np.zeros_like(rate) if turning is None else turning) * STEP_S
    fresh, still = np.ones(runs, dtype=bool), np.full(runs, rolled)
    found = []
    for k, claimed in enumerate(rate):
        readings = rng.normal(size=(runs, 6)) * np.repeat([ACCEL, GYRO], 3)
        readings[:, 5] += claimed
        direction = (0.4 - turned[k] + COMPASS * rng.normal(size=runs), fresh, np.full(runs, COMPASS))
        found.append(
            detector.step(
                readings,
                fresh,
                bias=np.zeros((runs, 3)),
                bias_sigma=np.full((runs, 3), 1e-4),
                rolled=still,
                dt_s=STEP_S,
                direction=direction if compass else None,
            )
        )
    return tuple(np.array([getattr(each, name) for each in found]) for name in ("resting", "surprise_rad_s", "quiet_s"))  # type: ignore[return-value]


def steps(*parts: tuple[float, float]) -> np.ndarray:
    """Rates in deg/s, each for so many seconds, as rad/s (T,)."""
    return np.concatenate([np.full(round(seconds / STEP_S), np.deg2rad(rate)) for rate, seconds in parts])


def test_rest_is_known_soon_after_a_quick_turn() -> None:
    rate = steps((0.0, 3.0), (90.0, 0.5), (0.0, 4.0))
    resting, _, _ = watch(rate, turning=rate)
    t_s = STEP_S * np.arange(len(rate))
    assert resting[(t_s > 2.5) & (t_s < 3.0)].all()
    assert not resting[(t_s > 3.03) & (t_s < 4.4)].any()
    # A second in which all agree, and a little more where a first sample's noise was taken for a mean.
    assert resting[t_s > 6.5].all()


def test_a_slow_turn_that_the_compass_shows_is_no_rest() -> None:
    rate = steps((0.0, 3.0), (0.5, 10.0))
    resting, surprise, _ = watch(rate, turning=rate)
    t_s = STEP_S * np.arange(len(rate))
    assert not resting[t_s > 4.0].any()
    assert not surprise.any()


def test_a_changed_bias_is_told_from_a_turn_by_the_compass_and_only_by_it() -> None:
    rate = steps((0.5, 10.0))
    resting, surprise, quiet_s = watch(rate)
    # A line through t / 20 ms samples of 1 deg each is known to 1 deg sqrt(12 x 20 ms / t^3): a quarter of 0.5 deg/s at
    # 2.5 s. A second later it is rest, or later where the noise looked like a turn.
    first = STEP_S * resting.argmax(axis=0)
    assert resting.any(axis=0).all()
    assert 3.3 < first.min() < first.max() < 6.0
    at = resting.argmax(axis=0), np.arange(resting.shape[1])
    np.testing.assert_allclose(surprise[at], np.deg2rad(0.5), atol=np.deg2rad(0.05))
    np.testing.assert_allclose(quiet_s[at], first + STEP_S, atol=0.03)
    assert not watch(rate, compass=False)[0].any()
    assert not watch(rate, rolled=True)[0].any()


def test_a_rate_beyond_the_data_sheets_bias_is_a_turn_even_if_the_compass_stands() -> None:
    assert not watch(steps((10.0, 8.0)))[0].any()  # a compass that is stuck
