"""Rows of trees for tests, without a world: scans of a lidar that moves between them, exact to begin with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.estimators.lidar_scan import LidarSheet
from twin.signals import NS_PER_S, EstimatorSetup, FloatArray, Measurement, Mount, SensorInfo

BEAMS, TURN_S, MAX_RANGE_M = 360, 0.2, 3.5
FORWARD_M = 0.055
COLUMNS = tuple(f"range_{beam:03d}_m" for beam in range(BEAMS))
LDS01 = {
    "max_range_m": MAX_RANGE_M,
    "near_to_m": 0.5,
    "near_noise_m": 0.005,
    "far_noise_ratio": 0.0175,
    "far_bias_ratio": 0.018,
}
WIDTH_M, SPACING_M, RADIUS_M = 0.9, 1.0, 0.05
Pose = tuple[float, float, float]


def lane(
    *, width_m: float = WIDTH_M, spacing_m: float = SPACING_M, from_m: float = -4.0, to_m: float = 60.0
) -> FloatArray:
    """Trunks (N, 3) east, north, radius along the east axis."""
    along = np.arange(from_m, to_m + 1e-9, spacing_m)
    rows = [np.column_stack([along, np.full_like(along, side * width_m / 2.0)]) for side in (1.0, -1.0)]
    places = np.concatenate(rows)
    return np.column_stack([places, np.full(len(places), RADIUS_M)])


def lidar_info(**datasheet: float) -> SensorInfo:
    return SensorInfo(
        name="lidar",
        kind="lidar",
        columns=COLUMNS,
        mount=Mount(body="base", xyz_m=(FORWARD_M, 0.0, 0.1)),
        rate_hz=1.0 / TURN_S,
        datasheet=LDS01 | datasheet,
    )


def setup_of(*others: SensorInfo, runs: int = 1, info: SensorInfo | None = None) -> EstimatorSetup:
    infos = (info or lidar_info(), *others)
    return EstimatorSetup(
        name="rows",
        runs=runs,
        sensors={each.name: each for each in infos},
        reference=Mount(body="base", xyz_m=(0.0, 0.0, 0.0)),
        rows_y_m=(),
        start_e_n_heading=(0.0, 0.0, 0.0),
    )


def sheet_of() -> LidarSheet:
    setup = setup_of()
    return LidarSheet.of(setup.sensors["lidar"], setup)


def turn(trunks: FloatArray, pose_at: Callable[[float], Pose], t_s: float) -> FloatArray:
    """Exact ranges (n,) of the turn that ends at ``t_s``; ``pose_at`` gives east, north, heading of the reference."""
    ages = (1.0 - np.arange(1, BEAMS + 1) / BEAMS) * TURN_S
    poses = np.array([pose_at(t_s - age) for age in ages])
    origin = poses[:, :2] + FORWARD_M * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    angle = poses[:, 2] + 2.0 * np.pi * np.arange(BEAMS) / BEAMS
    towards = trunks[np.newaxis, :, :2] - origin[:, np.newaxis, :]  # (n, N, 2)
    along = towards[..., 0] * np.cos(angle)[:, np.newaxis] + towards[..., 1] * np.sin(angle)[:, np.newaxis]
    gap = np.sum(towards**2, axis=-1) - along**2
    inside = trunks[:, 2] ** 2 - gap
    hit = (inside >= 0.0) & (along > 0.0)
    ranges = np.where(hit, along - np.sqrt(np.maximum(inside, 0.0)), np.inf).min(axis=1)
    return np.where(ranges <= MAX_RANGE_M, ranges, np.nan)


def noisy(ranges: FloatArray, rng: np.random.Generator, runs: int = 1) -> FloatArray:
    """The same with the noise of an LDS-01, (R, n)."""
    sigma = np.where(ranges < LDS01["near_to_m"], LDS01["near_noise_m"], LDS01["far_noise_ratio"] * ranges)
    return ranges + sigma * rng.normal(size=(runs, len(ranges)))


def scan(
    ranges: FloatArray, t_s: float, arrives_s: float | None = None, valid: FloatArray | None = None
) -> Measurement:
    """A measurement of ranges (R, n) or (n,)."""
    values = np.atleast_2d(ranges)
    return Measurement(
        sensor="lidar",
        t_ns=round(t_s * NS_PER_S),
        t_available_ns=round((t_s if arrives_s is None else arrives_s) * NS_PER_S),
        columns=COLUMNS,
        values=values,
        valid=np.ones(len(values), dtype=bool) if valid is None else np.asarray(valid),
    )


def standing(offset_m: float, heading_rad: float, east_m: float = 10.3) -> Callable[[float], Pose]:
    """A machine that does not move, ``offset_m`` to the left of the axis."""
    return lambda _: (east_m, offset_m, heading_rad)
