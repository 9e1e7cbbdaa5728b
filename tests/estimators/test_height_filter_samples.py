"""The history of accelerations: outliers, lost samples, silence, levers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from twin.errors import BadInputError
from twin.estimators.height_filter_kernels import GAIN_V, Q_VV
from twin.estimators.height_filter_levers import Lever
from twin.estimators.height_filter_samples import COLUMNS, AccelerationHistory
from twin.geometry import rotation_from_rpy
from twin.signals import EstimatorSetup, Measurement, Mount, SensorInfo

STEP_NS = 20_000_000
NOISE = 0.003
SHEET = {"free_accel_noise_m_s2": NOISE, "outlier_probability": 0.001, "outlier_sigma_m_s2": 0.1}
HERE = Mount(body="plate", xyz_m=(0.0, 0.0, 0.0))


def history(runs: int = 1, sheet: dict[str, float] | None = None, leak: float = 0.0) -> AccelerationHistory:
    info = SensorInfo(name="ahrs", kind="ahrs", columns=COLUMNS, mount=HERE, rate_hz=50.0, datasheet=sheet or SHEET)
    setup = EstimatorSetup(
        name="ours", runs=runs, sensors={"ahrs": info}, reference=HERE, rows_y_m=(), start_e_n_heading=(0.0, 0.0, 0.0)
    )
    nothing = Lever(xyz_m=(0.0, 0.0, 0.0))
    return AccelerationHistory(info, setup, antenna=nothing, kept_s=3.0, leak_sigma_rad=leak)


def sample(index: int, up: np.ndarray, *, valid: np.ndarray | None = None) -> Measurement:
    values = np.zeros((len(up), len(COLUMNS)))
    values[:, 0] = up
    known = np.ones(len(up), dtype=bool) if valid is None else valid
    values[~known] = np.nan
    return Measurement(
        sensor="ahrs", t_ns=index * STEP_NS, t_available_ns=index * STEP_NS, columns=COLUMNS, values=values, valid=known
    )


def feed(told: AccelerationHistory, up: np.ndarray) -> None:
    for index, row in enumerate(up, start=1):
        told.hear(sample(index, row))


def gained(told: AccelerationHistory, first: int, last: int) -> np.ndarray:
    return told.sums(first * STEP_NS, last * STEP_NS)[GAIN_V]


def test_an_outlier_is_taken_out_while_standing() -> None:
    up = np.random.default_rng(1).normal(0.0, NOISE, (120, 200))
    told = history(200)
    up[100] += 0.1
    feed(told, up)
    # one sample is now the mean of its neighbours, whose noise is NOISE / sqrt(2), and the outlier itself is gone
    error = gained(told, 100, 101) / 0.02
    assert np.sqrt(np.square(error).mean()) < 1.5 * NOISE


def test_smooth_motion_is_left_alone() -> None:
    """A hand's motion of 0.4 m/s at 1 Hz with the sensor's noise: next to nothing is taken away."""
    t = np.arange(1, 141)[:, np.newaxis] * 0.02
    up = 2.5 * np.sin(2.0 * np.pi * t + np.linspace(0.0, 6.0, 200)) + np.random.default_rng(2).normal(
        0.0, NOISE, (140, 200)
    )
    told = history(200)
    feed(told, up)
    removed = (up[20:130].sum(axis=0) * 0.02) - gained(told, 20, 130)
    # the noise alone walks by NOISE 0.02 sqrt(110)
    assert np.sqrt(np.square(removed).mean()) < 0.1 * NOISE * 0.02 * np.sqrt(110.0)


def shaking(generator: np.random.Generator) -> np.ndarray:
    return generator.normal(0.0, 0.3, (130, 2000))


def swinging(generator: np.random.Generator) -> np.ndarray:
    """A hand's 0.4 m/s at 0.5 Hz."""
    t = np.arange(1, 131)[:, np.newaxis] * 0.02
    return 1.25 * np.sin(np.pi * t + generator.uniform(0.0, 6.0, 2000))


@pytest.mark.parametrize("motion", [shaking, swinging])
def test_what_is_left_of_outliers_is_in_the_variance(motion: Callable[[np.random.Generator], np.ndarray]) -> None:
    """In motion that hides outliers and in motion that does not, velocity errors are as large as the variance says."""
    generator = np.random.default_rng(3)
    told = history(2000)
    true = motion(generator)
    hit = generator.random(true.shape) < 0.001
    outlier = np.where(hit, generator.normal(0.0, 0.1, true.shape), 0.0)
    feed(told, true + outlier + generator.normal(0.0, NOISE, true.shape))
    sums = told.sums(20 * STEP_NS, 125 * STEP_NS)
    error = sums[GAIN_V] - true[20:125].sum(axis=0) * 0.02
    # 2000 members tell a variance to 2 % where errors are normal, and to 6 % where single outliers make them
    assert np.square(error).mean() / sums[Q_VV].mean() == pytest.approx(1.0, abs=0.2)


def test_a_machine_that_begins_to_shake_is_believed() -> None:
    """Two seconds of rest, then at once white shaking of 0.5 m/s^2: after 0.1 s nothing is taken away."""
    generator = np.random.default_rng(6)
    up = generator.normal(0.0, NOISE, (200, 500))
    up[100:] += generator.normal(0.0, 0.5, (100, 500))
    told = history(500)
    feed(told, up)
    removed = np.abs(up[105:195].sum(axis=0) * 0.02 - gained(told, 105, 195))
    # one sample's outlier in 0.02 s would be 2 mm/s
    assert np.quantile(removed, 0.95) < 0.002


def test_without_outliers_on_the_data_sheet_samples_are_as_they_come() -> None:
    up = np.random.default_rng(4).normal(0.0, 1.0, (60, 5))
    told = history(5, {"free_accel_noise_m_s2": NOISE})
    feed(told, up)
    np.testing.assert_allclose(gained(told, 10, 59), up[10:59].sum(axis=0) * 0.02, rtol=1e-12)
    np.testing.assert_allclose(told.sums(10 * STEP_NS, 59 * STEP_NS)[Q_VV], 49 * (NOISE * 0.02) ** 2)


def test_a_lost_sample_is_bridged_and_makes_the_velocity_less_certain() -> None:
    t = np.arange(1, 101)[:, np.newaxis] * 0.02
    up = np.repeat(np.sin(2.0 * np.pi * t), 2, axis=1)
    told, whole = history(2), history(2)
    for index, row in enumerate(up, start=1):
        whole.hear(sample(index, row))
        told.hear(sample(index, row, valid=np.array([True, index != 60])))
    error = gained(told, 50, 90) - gained(whole, 50, 90)
    assert error[0] == 0.0
    # the mean of the neighbours is off by a'' dt^2 / 2
    assert 0.0 < abs(error[1]) < 1.01 * 0.5 * (2.0 * np.pi * 0.02) ** 2 * 0.02
    spread = told.sums(50 * STEP_NS, 90 * STEP_NS)[Q_VV]
    assert spread[1] > spread[0]
    assert abs(error[1]) < 3.0 * np.sqrt(spread[1])


def test_silence_opens_the_velocity() -> None:
    told = history(1)
    feed(told, np.zeros((50, 1)))
    told.hear(sample(100, np.zeros(1)))
    told.hear(sample(101, np.zeros(1)))
    # 0.5 m/s^2 for 0.3 s at a time over 0.98 s: 0.38 m/s
    assert np.sqrt(told.sums(50 * STEP_NS, 100 * STEP_NS)[Q_VV][0]) == pytest.approx(0.38, rel=0.02)
    assert not told.hear(sample(90, np.zeros(1)))


def test_the_newest_sample_counts_at_once() -> None:
    told = history(1)
    feed(told, np.full((50, 1), 0.7))
    assert told.settled_ns == 49 * STEP_NS
    np.testing.assert_allclose(gained(told, 40, 50), 0.14, rtol=1e-6)
    np.testing.assert_allclose(told.sums(40 * STEP_NS, 51 * STEP_NS)[GAIN_V], 0.154, rtol=1e-6)


def test_a_lever_turns_with_the_attitude() -> None:
    ahrs = SensorInfo(
        name="ahrs",
        kind="ahrs",
        columns=COLUMNS,
        mount=Mount(body="plate", xyz_m=(0.1, 0.2, 0.3), rpy_rad=(0.0, 0.0, 0.4)),
        rate_hz=50.0,
    )
    setup = EstimatorSetup(
        name="ours", runs=1, sensors={}, reference=HERE, rows_y_m=(), start_e_n_heading=(0.0, 0.0, 0.0)
    )
    point = Mount(body="plate", xyz_m=(-0.5, 0.6, -1.8))
    lever = Lever.between(ahrs, point, setup)
    body = rotation_from_rpy(0.1, -0.2, 0.7)
    turned = body @ rotation_from_rpy(0.0, 0.0, 0.4)
    attitude = np.array([
        [np.arctan2(turned[2, 1], turned[2, 2])], [-np.arcsin(turned[2, 0])], [np.arctan2(turned[1, 0], turned[0, 0])]
    ])  # fmt: skip
    expected = body @ (np.array(point.xyz_m) - np.array(ahrs.mount.xyz_m))
    np.testing.assert_allclose(lever.place(attitude)[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(lever.height(attitude)[0], expected[2], atol=1e-12)
    step = np.array([[1e-6], [0.0], [0.0]]), np.array([[0.0], [1e-6], [0.0]])
    slopes = [(lever.height(attitude + each)[0] - lever.height(attitude)[0]) / 1e-6 for each in step]
    assert lever.slope(attitude)[0] == pytest.approx(np.hypot(*slopes), rel=1e-4)
    with pytest.raises(BadInputError, match="sits on 'plate'"):
        Lever.between(ahrs, Mount(body="chassis", xyz_m=(0.0, 0.0, 0.0)), setup)
