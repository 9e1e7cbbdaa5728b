"""Several inertial units as one: noise, weights, lever arms, stuck and missing units."""

import numpy as np
import pytest

from tests.estimators.planter import STEP_S, G
from twin.estimators.inertial_array import ACCEL, GYRO, InertialArray
from twin.signals import FloatArray

ACCEL_NOISE, GYRO_NOISE = 0.22, 1e-3
ARMS = np.array([[0.0, y, 0.0] for y in (2.625, 0.375, -0.375, -2.625)])


def array(arms: FloatArray = ARMS, *, runs: int = 1, accel: float = ACCEL_NOISE, gyro: float = GYRO_NOISE, **options):
    count = len(arms)
    keys = {"accel_noise": [accel] * count, "gyro_noise": [gyro] * count, "gyro_response": [0.018] * count}
    return InertialArray(**{"arms_m": arms, "step_s": STEP_S, "runs": runs, **keys, **options})


def noise(rng: np.random.Generator, count: int, runs: int, accel: float = ACCEL_NOISE, gyro: float = GYRO_NOISE):
    """One tick of readings (k, R, 6) of a level machine at a steady speed."""
    sigma = np.repeat([accel, gyro], 3)
    return rng.normal(size=(count, runs, 6)) * sigma + [0.0, 0.0, G, 0.0, 0.0, 0.0]


def all_there(count: int, runs: int = 1) -> np.ndarray:
    return np.ones((count, runs), dtype=bool)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_mean_of_k_units_has_a_kth_of_the_variance_and_says_so(count: int) -> None:
    """Over 3000 samples of three axes the variance is known to sqrt(2 / 9000) = 1.5 %; four times that is allowed.

    The units sit at the reference, so that no noise comes by the lever arms.
    """
    rng, units = np.random.default_rng(1), array(np.zeros((count, 3)))
    fused = [units.fuse(noise(rng, count, 1), all_there(count)) for _ in range(3000)]
    u = np.array([each.u[0] for each in fused]) - [0.0, 0.0, G, 0.0, 0.0, 0.0]
    for triad, sigma, said in (
        (ACCEL, ACCEL_NOISE, [each.accel_variance[0] for each in fused]),
        (GYRO, GYRO_NOISE, [each.gyro_variance[0] for each in fused]),
    ):
        assert np.square(u[:, triad]).mean() == pytest.approx(sigma**2 / count, rel=0.06)
        np.testing.assert_allclose(said, sigma**2 / count, rtol=1e-12)


def test_a_unit_with_ten_times_the_noise_weighs_a_hundredth_in_its_member_alone() -> None:
    """The residual of the noisy unit is its own noise, once it counts for little: weight 1/100 of 1 / (3 + 1/100).

    Its energy is a mean over 0.5 s, 75 values: known to 16 % (one sigma); averaged over the last 20 s, 40 such means of
    its inverse, to 3 % and a bias of 2/75.
    """
    rng, units = np.random.default_rng(2), array(np.zeros((4, 3)), runs=2)
    share = []
    for step in range(2000):
        readings = noise(rng, 4, 2)
        if step >= 200:
            extra = noise(rng, 1, 1)[0, 0] - [0.0, 0.0, G, 0.0, 0.0, 0.0]
            readings[1, 1] += np.sqrt(99.0) * extra
        units.fuse(readings, all_there(4, 2))
        if step >= 1000:
            share.append(units.weights[:, :, :].copy())
    weights = np.mean(share, axis=0)
    np.testing.assert_allclose(weights[1, 1], 0.01 / 3.01, rtol=0.15)
    np.testing.assert_array_equal(units.weights[:, 0], 0.25)  # the other member knows nothing of it


def test_a_stuck_triad_is_left_out_after_the_stated_number_of_equal_readings() -> None:
    rng, units = np.random.default_rng(3), array(runs=2, stuck_after=5)
    held = None
    for step in range(60):
        readings = noise(rng, 4, 2)
        if step >= 40:
            held = readings[2, 0, GYRO].copy() if held is None else held
            readings[2, 0, GYRO] = held
        units.fuse(readings, all_there(4, 2))
        # Equal readings from step 40 on: the fifth of them is that of step 44.
        assert (units.weights[2, 0, 1] == 0.0) == (step >= 44), step
        assert units.weights[2, 0, 0] > 0.0  # its accelerometers live
        assert (units.weights[2, 1] > 0.0).all()  # and so does the other member's unit
    units.fuse(noise(rng, 4, 2), all_there(4, 2))
    assert units.weights[2, 0, 1] == 0.25  # it moves again


def test_a_unit_that_is_not_there_does_not_count_as_stuck() -> None:
    rng, units = np.random.default_rng(4), array()
    present = all_there(4)
    present[0] = False
    for _ in range(10):
        units.fuse(noise(rng, 4, 1), present)
        assert (units.weights[0] == 0.0).all()
    units.fuse(noise(rng, 4, 1), all_there(4))
    assert (units.weights[0] == 0.25).all()


@pytest.mark.parametrize("leaving", ["absent", "stuck"])
def test_leaving_a_unit_out_does_not_shift_the_bias_of_the_fused_reading(leaving: str) -> None:
    """Biases of 0.5 m/s^2 and 0.05 rad/s, 20 s to learn the differences: 1000 samples leave 1/sqrt(1000) of a sample's
    noise in each. The mean over 500 samples after the unit has gone is known to a twentieth; without the differences
    the bias would jump by a third of the unit's distance from the mean, 0.2 m/s^2 and 0.02 rad/s."""
    rng = np.random.default_rng(5)
    bias = np.array([[0.5, -0.5, 0.3, 0.05, 0.0, 0.06], [-0.4, 0.2, 0.0, -0.04, 0.02, -0.05]] * 2)[:, np.newaxis]
    bias[2:] *= 0.3
    units, present, seen = array(), all_there(4), []
    held = None
    for step in range(1500):
        readings = noise(rng, 4, 1) + bias
        if step >= 1000 and leaving == "absent":
            present[0] = False
        if step >= 1000 and leaving == "stuck":
            held = readings[0].copy() if held is None else held
            readings[0] = held
        seen.append(units.fuse(readings, present).u[0])
    before, after = np.mean(seen[500:1000], axis=0), np.mean(seen[1005:], axis=0)
    assert np.abs(after - before)[ACCEL].max() < 5.0 * ACCEL_NOISE * np.sqrt(1 / 2000 + 1 / 1500 + 1 / 1000)
    # The gyroscopes of outer units see no lever arms.
    assert np.abs(after - before)[GYRO].max() < 5.0 * GYRO_NOISE * np.sqrt(1 / 2000 + 1 / 1500 + 1 / 1000)


def turning_unit(arm: FloatArray, w: FloatArray, turning: FloatArray) -> FloatArray:
    """What a noiseless unit reads: f = f_0 + w' x r + w x (w x r), (T, 6); the reference feels (0.3, 0.6, g)."""
    force = np.array([0.3, 0.6, G]) + np.cross(turning, arm) + np.cross(w, np.cross(w, arm))
    return np.concatenate([force, w], axis=1)


@pytest.mark.parametrize("arm", [(0.5, 2.6, 0.4), (-1.0, -2.6, 0.0)])
def test_a_unit_off_the_reference_gives_the_reference_s_force(arm: tuple[float, float, float]) -> None:
    """Angular acceleration (0.2, -0.1, 0.5) rad/s^2 for 2 s: at 2.6 m and 1 rad/s the unit feels up to 3 m/s^2 more."""
    turning = np.tile([0.2, -0.1, 0.5], (100, 1))
    w = np.cumsum(turning, axis=0) * STEP_S
    readings = turning_unit(np.array(arm), w, turning)
    units = array(np.array([arm]))
    for step in range(100):
        fused = units.fuse(readings[step][np.newaxis, np.newaxis], all_there(1))
        if step:
            np.testing.assert_allclose(fused.u[0], [0.3, 0.6, G, *w[step]], atol=1e-9)


def test_angular_acceleration_over_a_gap_is_that_over_the_gap() -> None:
    """Ten ticks without a sample: the rate has changed by ten steps' worth, not by one step's at ten times the pace."""
    turning = np.tile([0.0, 0.0, 0.5], (30, 1))
    w = np.cumsum(turning, axis=0) * STEP_S
    arm = np.array([0.0, 2.6, 0.0])
    readings, units = turning_unit(arm, w, turning), array(arm[np.newaxis])
    for step in (0, 1, 2, 12, 13):
        fused = units.fuse(readings[step][np.newaxis, np.newaxis], all_there(1), steps=10 if step == 12 else 1)
        if step:
            np.testing.assert_allclose(fused.u[0, ACCEL], [0.3, 0.6, G], atol=1e-9)


def test_without_a_live_gyroscope_the_rate_is_held_and_no_turning_is_made_up() -> None:
    """One unit far from the reference in a turn, its gyroscope stuck: a rate that fell to zero within a step would be
    an angular acceleration of 12 rad/s^2, 33 m/s^2 at 2.6 m."""
    arm = np.array([0.0, 2.625, 0.0])
    rng, units = np.random.default_rng(6), array(arm[np.newaxis])
    w = np.array([0.0, 0.0, 0.25])
    steady = turning_unit(arm, w[np.newaxis], np.zeros((1, 3)))[0]
    for step in range(100):
        readings = (steady + noise(rng, 1, 1) - [0.0, 0.0, G, 0.0, 0.0, 0.0])[:, :, :]
        if step >= 50:
            readings[..., GYRO] = w
        fused = units.fuse(readings, all_there(1))
        if step >= 54:
            np.testing.assert_array_equal(fused.u[0, GYRO], w)
            # Known less and less: 0.3 rad/s after half a second.
            expected = 1e-6 + (0.3 * min(1.0, (step - 53) * STEP_S / 0.5)) ** 2
            assert fused.gyro_variance[0] == pytest.approx(expected)
        # Rate noise over the step at 2.6 m: sqrt(2) 1e-3 / 0.02 * 2.6 = 0.18 m/s^2 beside 0.22 of its own.
        assert np.abs(fused.u[0, ACCEL] - [0.3, 0.6, G]).max() < 5.0 * np.hypot(0.22, 0.18)


def test_without_any_unit_everything_is_held_and_believed_less_and_less() -> None:
    """One lost sample is next to nothing, 3 m/s^2 x 0.02 s / 0.5 s = 0.12 m/s^2 beside the units' 0.11; after half a
    second nobody knows."""
    rng, units = np.random.default_rng(7), array(runs=2)
    last = units.fuse(noise(rng, 4, 2), all_there(4, 2))
    np.testing.assert_allclose(last.accel_variance, ACCEL_NOISE**2 / 4)
    present = all_there(4, 2)
    present[:, 1] = False
    for lost in range(1, 30):
        fused = units.fuse(np.where(present[..., np.newaxis], noise(rng, 4, 2), np.nan), present)
        np.testing.assert_array_equal(fused.u[1], last.u[1])
        forgotten = min(1.0, lost * STEP_S / 0.5)
        assert fused.accel_variance[1] == pytest.approx(ACCEL_NOISE**2 / 4 + (3.0 * forgotten) ** 2)
        assert fused.gyro_variance[1] == pytest.approx(GYRO_NOISE**2 / 4 + (0.3 * forgotten) ** 2)
        assert fused.accel_variance[0] == pytest.approx(ACCEL_NOISE**2 / 4)
        assert np.isfinite(fused.u).all()
    back = units.fuse(noise(rng, 4, 2), all_there(4, 2))
    np.testing.assert_allclose(back.accel_variance, ACCEL_NOISE**2 / 4)
    # Ten ticks that nobody had: the new sample stands for all of them.
    gap = units.fuse(noise(rng, 4, 2), all_there(4, 2), steps=11)
    np.testing.assert_allclose(gap.accel_variance, ACCEL_NOISE**2 / 4 + (3.0 * 0.2 / 0.5) ** 2)


def test_good_accelerometers_far_out_are_not_suspected_for_the_gyroscopes_noise() -> None:
    """Moving a force to the reference over 2.6 m with rates of 1 mrad/s noise (four units: half of it) adds
    sqrt(2) 5e-4 / 0.02 * 2.6 = 0.09 m/s^2, thirty times the noise of a good accelerometer; that is no fault of it."""
    rng, units = np.random.default_rng(8), array(accel=0.003)
    for _ in range(500):
        units.fuse(noise(rng, 4, 1, accel=0.003), all_there(4))
        np.testing.assert_array_equal(units.weights, 0.25)


def test_unwatched_units_weigh_by_their_data_sheets() -> None:
    rng = np.random.default_rng(9)
    units = array(np.zeros((2, 3)), watch=False, accel_noise=[0.1, 0.3], gyro_noise=[1e-3, 1e-3])
    stuck = noise(rng, 2, 1)
    for _ in range(20):
        units.fuse(stuck, all_there(2))
    np.testing.assert_allclose(units.weights[:, 0], [[0.9, 0.5], [0.1, 0.5]])
