from __future__ import annotations

import numpy as np

from tests.estimators.planter import STEP_NS, imu, radar
from twin.estimators.ticks import TickClock

MS = 1_000_000


def clock() -> TickClock:
    return TickClock(rate_hz=50.0, max_age_s=1.0, inertial=["imu_1", "imu_4"])


def names(tick) -> list[tuple[str, bool]]:
    return [(sample.sensor, fresh) for sample, fresh in tick.samples]


def test_jittered_units_share_a_tick_and_a_later_one_closes_it() -> None:
    c = clock()
    assert c.add(imu("imu_1", 20 * MS - 3 * MS, 0.0, 0.0)) is None
    assert c.add(imu("imu_4", 20 * MS + 4 * MS, 0.0, 0.0)) is None
    tick = c.add(imu("imu_1", 40 * MS, 0.0, 0.0))
    assert tick is not None
    assert (tick.index, tick.steps) == (1, 1)
    assert names(tick) == [("imu_1", True), ("imu_4", True)]


def test_a_gap_counts_its_steps() -> None:
    c = clock()
    c.add(imu("imu_1", STEP_NS, 0.0, 0.0))
    c.close()
    c.add(imu("imu_1", 8 * STEP_NS, 0.0, 0.0))
    tick = c.close()
    assert tick is not None
    assert (tick.index, tick.steps) == (8, 7)


def test_late_samples_count_as_current_but_not_as_fresh() -> None:
    c = clock()
    c.add(imu("imu_1", 2 * STEP_NS, 0.0, 0.0))
    c.add(imu("imu_4", STEP_NS, 0.0, 0.0, t_available_ns=2 * STEP_NS))
    tick = c.close()
    assert tick is not None
    assert names(tick) == [("imu_1", True), ("imu_4", False)]
    c.add(imu("imu_4", STEP_NS + 1, 0.0, 0.0, t_available_ns=3 * STEP_NS))
    after = c.close()
    assert after is not None
    assert (after.index, after.steps) == (2, 0)


def test_repeated_and_old_samples_are_dropped() -> None:
    c = clock()
    c.add(imu("imu_1", STEP_NS, 0.0, 0.0))
    c.add(imu("imu_1", 2 * STEP_NS, 0.0, 0.0))
    c.add(imu("imu_1", STEP_NS, 9.0, 9.0, t_available_ns=2 * STEP_NS))  # repeated, out of order
    c.add(imu("imu_4", STEP_NS, 9.0, 9.0, t_available_ns=STEP_NS + 1_000_000_001))
    tick = c.close()
    assert tick is not None
    assert names(tick) == [("imu_1", True)]


def test_a_sensor_before_the_inertial_units_waits_for_its_tick() -> None:
    c = clock()
    c.add(imu("imu_1", STEP_NS, 0.0, 0.0))
    c.close()
    c.add(radar(2 * STEP_NS, 1.0))
    assert c.close() is None
    c.add(imu("imu_1", 2 * STEP_NS, 0.0, 0.0))
    tick = c.close()
    assert tick is not None
    assert [name for name, _ in names(tick)] == ["radar", "imu_1"]


def test_silent_inertial_units_do_not_stop_time() -> None:
    c = clock()
    c.add(imu("imu_1", STEP_NS, 0.0, 0.0))
    c.close()
    ticks = [tick for k in range(2, 20) for tick in [c.add(radar(k * STEP_NS, 1.0)), c.close()] if tick is not None]
    assert ticks[0].index == 7  # 0.1 s of patience is five ticks
    assert sum(len(tick.samples) for tick in ticks) + len(c._waiting) == 18


def test_a_clock_that_runs_ahead_is_held_at_arrival() -> None:
    c = clock()
    c.add(imu("imu_1", STEP_NS + 3_000_000_000, 0.0, 0.0, t_available_ns=STEP_NS))
    tick = c.close()
    assert tick is not None
    assert tick.index == 1
    assert np.all(tick.samples[0][0].valid)
