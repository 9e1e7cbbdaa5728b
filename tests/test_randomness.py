"""Named random streams: what a member draws depends on its own name and run alone."""

import numpy as np

from twin.randomness import (
    NormalStream,
    UniformStream,
    counted_uniform,
    counter_keys,
    draw_per_run,
    value_generator,
    world_generator,
)


def _rows(stream: NormalStream, count: int) -> np.ndarray:
    return np.stack([stream.next().copy() for _ in range(count)])


def test_a_member_draws_what_the_single_run_draws_whatever_the_block() -> None:
    ensemble = _rows(NormalStream(seed=3, runs=range(5), name="imu", size=6, block=64), 300)
    for run in range(5):
        alone = _rows(NormalStream(seed=3, runs=[run], name="imu", size=6, block=17), 300)
        np.testing.assert_array_equal(ensemble[:, run], alone[:, 0])


def test_seed_run_and_name_each_change_the_numbers() -> None:
    base = value_generator(1, 0, "radar").standard_normal(4)
    others = [
        value_generator(2, 0, "radar"), value_generator(1, 1, "radar"), value_generator(1, 0, "gnss"),
        world_generator(1, "radar"),
    ]  # fmt: skip
    for other in others:
        assert not np.array_equal(base, other.standard_normal(4))


def test_streams_are_standard_normal_and_uniform() -> None:
    # Standard errors for n = 100 000: mean 0.0032, variance 0.0045, uniform mean 0.00091; five of them.
    normal = _rows(NormalStream(seed=1, runs=[0, 1], name="a", size=5), 10_000).ravel()
    assert abs(normal.mean()) < 5 * 0.0032
    assert abs(normal.var() - 1.0) < 5 * 0.0045
    uniform = _rows(UniformStream(seed=1, runs=[0, 1], name="a", size=5), 10_000).ravel()
    assert 0.0 <= uniform.min() < uniform.max() < 1.0
    assert abs(uniform.mean() - 0.5) < 5 * 0.00091


def test_members_are_independent_of_one_another() -> None:
    drawn = draw_per_run(seed=1, runs=range(2000), name="bias", size=2)
    # Correlation of neighbouring members, standard error 1 / sqrt(2000) = 0.022; five of them.
    assert abs(np.corrcoef(drawn[:-1, 0], drawn[1:, 0])[0, 1]) < 0.11


def test_counted_numbers_depend_on_key_and_count_alone() -> None:
    keys = counter_keys(seed=3, runs=range(4), name="meter")
    np.testing.assert_array_equal(keys[2:3], counter_keys(seed=3, runs=[2], name="meter"))
    counts = np.arange(1000)
    whole = counted_uniform(np.repeat(keys[2], 1000), counts)
    np.testing.assert_array_equal(whole[[17, 800]], counted_uniform(keys[[2, 2]], counts[[17, 800]]))


def test_counted_numbers_are_uniform_and_independent() -> None:
    count = 100_000
    keys = counter_keys(seed=3, runs=range(2), name="meter")
    one, other = (counted_uniform(np.repeat(key, count), np.arange(count)) for key in keys)
    # Standard errors: mean 0.00091, correlations 0.0032, a tenth of the numbers 0.00095; five of each.
    assert abs(one.mean() - 0.5) < 0.0046
    for first, second in ((one, other), (one[1:], one[:-1]), (one[3:], one[:-3])):
        assert abs(np.corrcoef(first, second)[0, 1]) < 0.016
    assert np.abs(np.histogram(one, 10, (0.0, 1.0))[0] / count - 0.1).max() < 0.0048
    assert 0.0 < one.min() < one.max() < 1.0
