"""Detection rates of the standstill detector against theory, and that it does not latch."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import pearson3

from tests.estimators.planter import STEP_S, G, make_setup, profile, stream
from tests.estimators.test_row_speed_ekf import column, make, play
from twin.estimators.calibration import StandstillCalibration, specific_force_norm
from twin.estimators.standstill import (
    StandstillConfig,
    StandstillDetector,
    energy_quantile,
    low_pass_gain,
    mean_quantile,
)

SIGMA = np.sqrt(0.05)
UNITS = [0, 1, 2, 3]
ALPHA = low_pass_gain(0.5, STEP_S)


def readings(rng: np.random.Generator, runs: int, heave: np.ndarray | float = 0.0, offset: float = 0.0) -> np.ndarray:
    values = np.zeros((4, runs, 6))
    values[..., :3] = SIGMA * rng.normal(size=(4, runs, 3)) + [0.3, -0.2, G]
    values[..., 0] += offset
    values[..., 2] += heave
    values[1, :, 2] += 0.5  # one unit with another bias: its own norm counts
    return values


def calibrated(rng: np.random.Generator, runs: int, config: StandstillConfig) -> StandstillDetector:
    gather = StandstillCalibration(units=4, runs=runs)
    present = np.ones((4, runs), dtype=bool)
    for _ in range(3000):
        gather.add(UNITS, readings(rng, runs), present)
    result = gather.finish(accelerometer_variance=0.05)
    # The mean norm of four units has variance 0.05 / 4; 3000 samples tell it to sqrt(2 / 3000) = 2.6 % (1 sigma).
    assert result.norm_variance.mean() == pytest.approx(0.05 / 4, rel=4 * 0.026 / np.sqrt(runs))
    np.testing.assert_allclose(
        result.mean[0, :, :3].mean(axis=0), [0.3, -0.2, G], atol=4 * SIGMA / np.sqrt(3000 * runs)
    )
    return StandstillDetector(config, result, step_s=STEP_S)


def share_standing(detector: StandstillDetector, rng: np.random.Generator, runs: int, heave_rms: float) -> float:
    present = np.ones((4, runs), dtype=bool)
    total, steps = 0, 3000
    for step in range(-300, steps):
        values = readings(rng, runs, heave_rms * rng.normal(size=runs))
        detector.update(UNITS, specific_force_norm(values), present)
        total += detector.standing().sum() if step >= 0 else 0
    return float(total / steps / runs)


@pytest.mark.parametrize("shaking_test", [True, False])
def test_a_standing_machine_is_missed_as_often_as_stated(shaking_test) -> None:
    """Stated 5 %: two tests at 2.5 % (4.9 % together if independent), or one at 5 %. 100 members times 3000 steps hold
    6000 independent looks (the low-pass remembers about 2 tau = 50 steps): sigma 0.28 %; a member's threshold is off
    with its calibration (2.6 % of V against a margin of 45 %), which adds some 0.5 %."""
    rng, runs = np.random.default_rng(1), 100
    detector = calibrated(rng, runs, StandstillConfig(shaking_test=shaking_test))
    assert 1.0 - share_standing(detector, rng, runs, 0.0) == pytest.approx(0.05, abs=4 * 0.0028 + 0.005)


def test_a_shaking_machine_is_taken_to_stand_as_seldom_as_derived() -> None:
    """White heave of 0.13 m/s^2 rms (what 0.3 m/s^2 at 2.5 m/s is at 0.5 m/s) lifts V = 0.0125 to 0.0294. The energy
    test then passes with the probability of a Pearson III variable below its limit, and the mean test a little less
    often than at rest: at most 2.5 %. The same number of looks as above; the quantile's slope makes 1 % of it 0.1 %."""
    rng, runs = np.random.default_rng(2), 100
    detector = calibrated(rng, runs, StandstillConfig())
    V, r2 = 0.05 / 4, 0.13**2
    assert detector.energy_limit is not None
    spread = np.sqrt(2.0 * ALPHA / (2.0 - ALPHA))
    skew = 8.0 * ALPHA**3 / (1.0 - (1.0 - ALPHA) ** 3) / spread**3
    passed = pearson3.cdf((energy_quantile(0.975, ALPHA) * V / (V + r2) - 1.0) / spread, skew)
    assert passed < 0.025
    assert share_standing(detector, rng, runs, 0.13) == pytest.approx(passed, abs=0.01)
    # 0.3 m/s^2, the gentlest ride at working speed: a member would need a sixth of the mean energy, 4 sigma down.
    assert share_standing(detector, rng, runs, 0.3) == 0.0


def test_quantiles_against_simulation() -> None:
    """Energy of 2e6 low-passed squares; at p the share beyond is 1 - p, known to sqrt(p (1-p) / n_eff), n_eff = 4e4."""
    rng = np.random.default_rng(3)
    energy, mean, above, beyond = np.ones(2000), np.zeros(2000), 0, 0
    for step in range(-200, 1000):
        d = rng.normal(size=2000)
        energy += ALPHA * (d * d - energy)
        mean += ALPHA * (d - mean)
        if step >= 0:
            above += (energy > energy_quantile(0.975, ALPHA)).sum()
            beyond += (np.abs(mean) > mean_quantile(0.975, ALPHA)).sum()
    sigma = np.sqrt(0.025 * 0.975 / 4e4)
    assert above / 2e6 == pytest.approx(0.025, abs=4 * sigma + 0.001)  # and 0.1 % for the three-moment fit
    assert beyond / 2e6 == pytest.approx(0.05, abs=8 * sigma)


def drive_off(runs: int, heave_rms: float = 0.3, **standstill) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """10 s of calibration, 0.5 m/s^2 up to 2.5 m/s, then on; ``heave_rms`` at 2.5 m/s, growing with sqrt(speed)."""
    speed, rate = profile((10.0, 0.0, 0.0), (5.0, 2.5, 0.0), (15.0, 2.5, 0.0))
    ticks = stream(
        speed,
        rate,
        runs=runs,
        accel_sigma=SIGMA,
        gyro_sigma=1e-3,
        radar_sigma=0.05,
        shaking=heave_rms * np.sqrt(speed / 2.5),
        seed=5,
    )
    estimator = make(make_setup(runs=runs), calibration_s=10.0, standstill=standstill)
    estimates = play(estimator, ticks)
    return speed, column(estimator, estimates, "speed_m_s"), column(estimator, estimates, "standstill")


def test_it_does_not_latch_when_the_machine_drives_off() -> None:
    """The heave's energy is 0.018 t after t seconds of starting; low-passed, 0.018 (t - 0.5) or more. To pass for
    standing, V + 0.018 (t - 0.5) would have to look like 1.46 V: at t = 2 s the mean energy is 3.2 V, and 1.46 / 3.2 is
    2.7 sigma down (1e-3 or less with the skew); at 2.5 s, 3.9 V. The shaking alone, without the sensors' guard."""
    _, speed, standing = drive_off(40, guard_by_sensors=False)
    start = 500
    assert standing[start + 50 : start + 100].mean() < 0.5  # gone for most between 1 and 2 s
    assert standing[start + 125 :].mean() < 1e-3
    # What was lost while held at zero dies out with K = 0.0311: below 1 % after 3 s; noise of the estimate 0.015 m/s.
    assert np.abs(speed[-500:] - 2.5).max() < 5 * 0.02


def test_the_published_form_latches() -> None:
    """On smooth ground the norm's mean passes 95 % of the time whatever the speed. From zero without uncertainty the
    gain grows by Q/R = 1e-3 a step, so 1 m/s is reached after 30 steps or more out of the detector's sight;
    spells of 0.6 s are rare for a low-pass of 0.5 s: the machine drives at 2.5 m/s and most estimates stand."""
    true_speed, speed, standing = drive_off(40, heave_rms=0.0, shaking_test=False, guard_by_sensors=False)
    at_speed = np.flatnonzero(true_speed >= 2.5)[0]
    assert np.median(speed[at_speed]) < 0.25
    assert standing[at_speed].mean() > 0.5


def test_the_sensors_guard_releases_a_latched_filter() -> None:
    """With the radar in the guard even the published norm, on smooth ground, is ignored above 1 m/s true speed."""
    true_speed, speed, standing = drive_off(40, heave_rms=0.0, shaking_test=False)
    assert not standing[true_speed > 1.3].any()  # radar noise 0.05: 6 sigma
    assert np.abs(speed[-1] - 2.5).max() < 5 * 0.02


def test_speed_is_zero_without_uncertainty_at_standstill() -> None:
    """After the stop the energy of the ride (2 V at 0.5 m/s) decays with 0.5 s; 1.5 s later the stated 5 % are
    missed. 20 members times 10 s hold some 200 independent looks: sigma 1.5 %; the calibration of 20 s
    blurs the thresholds."""
    speed, rate = profile((20.0, 0.0, 0.0), (5.0, 2.5, 0.0), (5.0, 0.0, 0.0), (11.5, 0.0, 0.0))
    shaking = 0.3 * np.sqrt(speed / 2.5)
    estimator = make(make_setup(runs=20), calibration_s=20.0)
    ticks = stream(speed, rate, runs=20, accel_sigma=SIGMA, gyro_sigma=1e-3, shaking=shaking, seed=8)
    estimates = play(estimator, ticks)
    stands = column(estimator, estimates, "standstill").astype(bool)
    assert stands[-500:].mean() > 0.95 - 4 * 0.015 - 0.02
    assert not stands[speed > 1.3].any()
    for each, held in zip(estimates[-500:], stands[-500:], strict=True):
        assert np.abs(each.values[held, 2]).max(initial=0.0) < 1e-12
        assert each.sigmas[held, 2].max(initial=0.0) < 1e-12


def test_switched_off_it_stays_silent() -> None:
    _, _, standing = drive_off(2, enabled=False)
    assert not standing[500:].any()


def test_units_without_noise_have_a_floor() -> None:
    speed, rate = profile((2.0, 0.0, 0.0), (3.0, 0.0, 0.0))
    estimator = make()
    stands = column(estimator, play(estimator, stream(speed, rate)), "standstill")
    assert stands.all()
