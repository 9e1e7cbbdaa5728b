"""What each heading filter costs per update, beside table 6 of paper 001 (which gives per cents of a processor).

An update is one inertial sample with what else the filter hears, and the question for its estimate. Run by
``make benchmark``; the time of a round over 500 updates is what is measured.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from tests.estimators.robot import Drive
from twin.estimators import EstimatorConfigUnion, build_estimator

pytestmark = pytest.mark.slow

UPDATES = 500
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


@pytest.mark.parametrize("runs", [1, 100])
@pytest.mark.parametrize("name", FILTERS)
def test_five_hundred_updates(name: str, runs: int, benchmark: Any) -> None:
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
    ticks = list(drive.ticks())

    def updates() -> None:
        estimator = build_estimator(config, setup)
        for t_ns, measurements in ticks:
            for measurement in measurements:
                estimator.process(measurement)
            estimator.estimate(t_ns)

    benchmark.extra_info["updates"] = UPDATES
    benchmark.pedantic(updates, rounds=3, warmup_rounds=1)
