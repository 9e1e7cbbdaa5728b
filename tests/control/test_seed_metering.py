"""The seed meter: whole cells of the estimated way, the luck of each cell, and when a seed comes to rest."""

import numpy as np
import pytest
from pydantic import ValidationError

from twin.control.seed_metering import SeedingConfig, SeedMeter, Seeds

X_REF = 0.16
IDEAL = SeedingConfig(
    spacing_m=X_REF, drop_delay_s=0.0, drop_spread_s=0.0, skip_probability=0.0, double_probability=0.0
)
LATE = 1e9


def _meter(config: SeedingConfig = IDEAL, *, runs: tuple[int, ...] = (0,), rows: tuple[int, ...] = (1,)) -> SeedMeter:
    return SeedMeter(config, seed=1, runs=runs, rows=rows)


def _constant(speed: float, *, duration_s: float, runs: int = 1, rows: int = 1) -> tuple[np.ndarray, np.ndarray]:
    t_s = np.arange(round(duration_s / 0.02) + 1) * 0.02
    return t_s, np.full((len(t_s), runs, rows), speed)


def _all(meter: SeedMeter, t_s: np.ndarray, speeds: np.ndarray) -> Seeds:
    """Turn to the end, and long enough stopped for all seeds to land."""
    meter.turn(t_s, speeds)
    meter.turn(t_s[-1:] + np.array([0.02, 10.0]), np.zeros((2, *speeds.shape[1:])))
    return meter.landed(LATE)


def _per_meter(seeds: Seeds, member: int, row: int) -> np.ndarray:
    return seeds.landed_s[(seeds.member == member) & (seeds.row == row)]


def test_seeds_are_released_at_whole_cells_of_the_estimated_way() -> None:
    # 2.5 m/s over 0.16 m: a cell every 0.064 s, between the estimates' instants; 156 whole ones in 10 s.
    landed = _all(_meter(), *_constant(2.5, duration_s=10.0)).landed_s
    # The last speed holds for the 0.02 s until the meter is told to stop: 10.02 s.
    assert len(landed) == int(10.02 * 2.5 / X_REF)
    np.testing.assert_allclose(landed, 0.064 * np.arange(1, len(landed) + 1), atol=1e-9)


def test_the_number_of_seeds_is_the_integral_of_the_estimated_speed() -> None:
    rng = np.random.default_rng(3)
    t_s = np.cumsum(rng.uniform(0.01, 0.05, 3000))
    speeds = 2.0 + rng.standard_normal((3000, 2, 3))
    meter = _meter(runs=(0, 1), rows=(1, 2, 3))
    meter.turn(t_s, speeds)
    seeds = meter.landed(LATE)
    # Each speed holds until the next estimate; a negative one meters nothing.
    cells = (np.maximum(speeds[:-1], 0.0) * np.diff(t_s)[:, None, None]).sum(axis=0) / X_REF
    counts = np.zeros((2, 3))
    np.add.at(counts, (seeds.member, seeds.row), 1)
    np.testing.assert_array_equal(counts, np.floor(cells))


def test_a_speed_that_is_negative_or_unknown_meters_nothing_and_forgets_nothing() -> None:
    # 0.1 m, then a second of nothing, then on: the first seed falls after 0.06 m more.
    t_s = np.array([0.0, 0.1, 0.6, 1.1, 2.1])
    for nothing in (-1.0, np.nan):
        speeds = np.array([1.0, nothing, nothing, 1.0, 0.0]).reshape(-1, 1, 1)
        meter = _meter()
        meter.turn(t_s, speeds)
        assert meter.landed(LATE).landed_s[0] == pytest.approx(1.16)


def test_a_diverged_estimate_turns_the_meter_no_faster_than_its_drive_can() -> None:
    for speed in (1e6, np.inf):
        assert len(_all(_meter(), *_constant(speed, duration_s=0.98)).landed_s) == 100


def test_pieces_give_the_seeds_of_the_whole() -> None:
    config = SeedingConfig(spacing_m=X_REF, skip_probability=0.1, double_probability=0.1, drop_spread_s=0.05)
    rng = np.random.default_rng(5)
    t_s = 0.02 * np.arange(1, 2001)
    speeds = np.abs(2.0 + rng.standard_normal((2000, 2, 2)))
    whole = _meter(config, runs=(0, 1), rows=(1, 8))
    whole.turn(t_s, speeds)
    expected = whole.landed(LATE)
    pieces = _meter(config, runs=(0, 1), rows=(1, 8))
    found = []
    for first in range(0, 2000, 77):
        pieces.turn(t_s[first : first + 77], speeds[first : first + 77])
        found.append(pieces.landed(t_s[min(first + 50, 1999)]))
    found.append(pieces.landed(LATE))
    for member in (0, 1):
        for row in (0, 1):
            times = np.concatenate([_per_meter(seeds, member, row) for seeds in found])
            assert (np.diff(times) >= 0.0).all(), "a seed was told after one that landed later"
            np.testing.assert_array_equal(times, _per_meter(expected, member, row))


def test_a_member_meters_what_the_run_of_its_index_meters_whatever_else_is_metered() -> None:
    config = SeedingConfig(spacing_m=X_REF, skip_probability=0.2, double_probability=0.2)
    together = _all(_meter(config, runs=(0, 1, 2), rows=(1, 4, 8)), *_constant(2.0, duration_s=20.0, runs=3, rows=3))
    alone = _all(_meter(config, runs=(2,), rows=(8,)), *_constant(2.0, duration_s=20.0))
    np.testing.assert_array_equal(_per_meter(together, 2, 2), alone.landed_s)
    assert not np.array_equal(_per_meter(together, 1, 2)[:100], alone.landed_s[:100])
    assert not np.array_equal(_per_meter(together, 2, 1)[:100], alone.landed_s[:100])


def test_drop_times_have_the_stated_mean_and_spread() -> None:
    config = IDEAL.model_copy(update={"drop_delay_s": 0.3, "drop_spread_s": 0.005})
    landed = _all(_meter(config), *_constant(2.5, duration_s=1000.0)).landed_s
    fell = landed - 0.064 * np.arange(1, len(landed) + 1)
    # 15 625 seeds: the mean is known to 0.005 / 125 s, the spread to 0.57 %; four of each.
    assert fell.mean() == pytest.approx(0.3, abs=4 * 0.005 / 125)
    assert fell.std() == pytest.approx(0.005, rel=4 * 0.0057)


def test_cells_are_empty_or_double_as_often_as_stated() -> None:
    config = IDEAL.model_copy(update={"skip_probability": 0.03, "double_probability": 0.08})
    landed = _all(_meter(config), *_constant(2.5, duration_s=1000.0)).landed_s
    cell = np.rint(landed / 0.064)
    cells = int(1000.02 / 0.064)
    held = np.bincount(cell.astype(int), minlength=cells + 1)[1:]
    for number, share in ((0, 0.03), (1, 0.89), (2, 0.08)):
        assert (held == number).mean() == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / cells))
    assert held.max() == 2


def test_more_outcomes_than_cells_are_refused() -> None:
    with pytest.raises(ValidationError, match="more than 1"):
        SeedingConfig(spacing_m=0.16, skip_probability=0.6, double_probability=0.5)
