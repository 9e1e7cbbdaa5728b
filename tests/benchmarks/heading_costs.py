"""Table 6 of paper 001 beside ours: what each heading filter costs per update, and what it holds in memory.

``python -m tests.benchmarks.heading_costs`` prints it. An update is one inertial sample with what else the filter
hears, and the question for its estimate. All filters run in one process, in turns, over the same drive.

**What can be compared.** The paper gives per cents of a Raspberry Pi's processor and memory for a whole ROS node: a
Python interpreter, its libraries, a subscriber at 50 Hz and the filter; the same node with the least of the filters
costs 19.8 %, so most of every figure is the node. Ours is the filter alone. So the order and the ratios can be looked
at, not the figures: the paper's filters cost 1.2 to 1.4 times the complementary one, with the node in numerator and
denominator; ours show how far they are apart without it. Memory: the paper's 2.84 to 3.59 % of 1 GB (the size of its
Raspberry Pi is not stated) are 30 MB, an interpreter; a filter's own state is kilobytes. It is measured as what
Python's allocators hand out while the filter is built and stepped (tracemalloc, largest and left at the end), once
everything it imports is loaded. What a filter costs per member of an ensemble of 100 has no counterpart in the paper.
"""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from tests.estimators.robot import Drive
from twin.estimators import EstimatorConfigUnion, build_estimator
from twin.signals import EstimatorSetup, Measurement

UPDATES = 500
ROUNDS = 5
MARG, WHEELS = ("imu", "magnetometer"), ("imu", "wheel_encoders")
FILTERS: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "complementary": (MARG, {"kind": "heading_complementary"}),
    "madgwick": (MARG, {"kind": "heading_madgwick"}),
    "kalman_imu": (MARG, {"kind": "heading_kalman", "inputs": "imu"}),
    "kalman_odometry_gyro": (WHEELS, {"kind": "heading_kalman", "inputs": "odometry_gyro"}),
    "kalman_odometry_gyro_mag": ((*MARG, "wheel_encoders"), {"kind": "heading_kalman", "inputs": "odometry_gyro_mag"}),
    "integrated_kalman": (MARG, {"kind": "heading_kalman", "inputs": "integrated"}),
    "wheel_odometry": (("wheel_encoders",), {"kind": "wheel_odometry"}),
    "heading_filter": ((*MARG, "wheel_encoders"), {"kind": "heading_filter"}),
}
PUBLISHED_PERCENT: dict[str, tuple[float, float]] = {
    "complementary": (19.80, 2.84),
    "madgwick": (28.10, 3.55),
    "kalman_imu": (24.30, 3.58),
    "kalman_odometry_gyro": (27.20, 3.59),
    "kalman_odometry_gyro_mag": (27.30, 3.59),
    "integrated_kalman": (25.00, 3.57),
    "wheel_odometry": (6.70, 4.75),
}
"""Table 6: processor and memory, per cent; of the odometry its node."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """A filter and what it is fed."""

    config: Any
    setup: EstimatorSetup
    ticks: Sequence[tuple[int, list[Measurement]]]

    def do(self) -> Any:
        """Build the filter and take all updates; return it."""
        estimator = build_estimator(self.config, self.setup)
        for t_ns, measurements in self.ticks:
            for measurement in measurements:
                estimator.process(measurement)
            estimator.estimate(t_ns)
        return estimator


def work(name: str, *, runs: int) -> Work:
    """A drive of :data:`UPDATES` samples for one of :data:`FILTERS`."""
    kinds, options = FILTERS[name]
    if options["kind"].startswith("heading_") and options["kind"] != "heading_filter":
        options = options | {"preparation": {"standstill_s": 0.0}}
    drive = Drive(
        yaw_rate=0.3 * np.sin(np.arange(UPDATES) / 30.0),
        speed=np.full(UPDATES, 0.4),
        kinds=kinds,
        runs=runs,
        gyro_noise=1e-3,
        field_noise=0.5,
        accel_noise=0.05,
    )
    setup = drive.setup()
    config = TypeAdapter(EstimatorConfigUnion).validate_python(options | {"sensors": list(setup.sensors)})
    return Work(config=config, setup=setup, ticks=list(drive.ticks()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What a filter costs."""

    update_us: float
    """Per update of one run."""
    member_us: float
    """Per update and member of an ensemble of 100."""
    held_bytes: int
    """Left at the end, with the filter alive."""
    peak_bytes: int
    """Largest at any time."""


def measured() -> dict[str, Cost]:
    """Measure all filters: the quickest of some rounds, in which they take turns (others share the machine)."""
    tasks = {(name, runs): work(name, runs=runs) for name in FILTERS for runs in (1, 100)}
    for task in tasks.values():
        task.do()
    rounds = [{key: _cpu_s(task) for key, task in tasks.items()} for _ in range(ROUNDS)]
    least_us = {key: min(each[key] for each in rounds) / UPDATES * 1e6 for key in tasks}
    return {name: _cost(tasks[name, 1], least_us[name, 1], least_us[name, 100] / 100) for name in FILTERS}


def _cost(one: Work, update_us: float, member_us: float) -> Cost:
    gc.collect()
    tracemalloc.start()
    estimator = one.do()
    gc.collect()
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    del estimator
    return Cost(update_us=update_us, member_us=member_us, held_bytes=held, peak_bytes=peak)


def _cpu_s(task: Work) -> float:
    started = time.process_time()
    task.do()
    return time.process_time() - started


def table(costs: dict[str, Cost]) -> str:
    """Table 6 with ours beside it, as text."""
    least = costs["complementary"]
    head = f"{'filter':<26}{'us/update':>10}{'ratio':>7}{'us/member':>11}{'held kB':>9}{'peak kB':>9}"
    lines = [head + f"{'paper CPU %':>13}{'ratio':>7}{'paper mem %':>13}"]
    for name, found in costs.items():
        line = (
            f"{name:<26}{found.update_us:>10.1f}{found.update_us / least.update_us:>7.2f}{found.member_us:>11.2f}"
            f"{found.held_bytes / 1024:>9.1f}{found.peak_bytes / 1024:>9.1f}"
        )
        if name in PUBLISHED_PERCENT:
            processor, memory = PUBLISHED_PERCENT[name]
            ratio = processor / PUBLISHED_PERCENT["complementary"][0]
            line += f"{processor:>13.2f}{ratio:>7.2f}{memory:>13.2f}"
        lines.append(line)
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(measured()))
