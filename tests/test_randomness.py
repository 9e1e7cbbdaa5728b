"""Named random streams: what a member draws depends on its own name and run alone."""

import numpy as np

from twin.randomness import NormalStream, UniformStream, draw_per_run, value_generator, world_generator


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
