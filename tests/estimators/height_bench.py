"""A bench for height estimators without a world: vertical motion as by hand, real sensor classes, faults, and scores."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.sensors.motions import CONFIGS, DT_NS
from twin.estimators import build_estimator
from twin.geometry import STANDARD_GRAVITY_M_S2, rotation_from_rpy
from twin.randomness import world_generator
from twin.sensors import Sensor, build_sensor
from twin.sensors.gnss import TRUE_FIX
from twin.sensors.presets import load_preset
from twin.signals import NS_PER_S, Estimator, EstimatorSetup, FloatArray, Measurement, Mount, MountMotion

DESIGN_M = 1.0
GNSS_SAMPLE_S = 0.1
LIMIT_M = 0.03
_G = np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])


@dataclass(frozen=True)
class Machine:
    """How a body moves. Up: a hand's random reciprocation in 0.4 m at up to 0.4 m/s; level: what ``speed`` says."""

    seed: int = 1
    stand_s: float = 0.0
    speed: Callable[[float], tuple[float, float]] | None = None
    """East and north velocity at a time."""
    mounts: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    sway_rad: float = 0.0
    """Amplitude of roll and pitch."""

    def __post_init__(self) -> None:
        generator = world_generator(self.seed, "bench")
        hz = generator.uniform(0.15, 0.6, 6)
        amplitude = generator.uniform(0.5, 1.0, 6) / hz
        amplitude *= 0.4 / (2.0 * math.pi * (amplitude * hz).sum())
        object.__setattr__(self, "_waves", (hz, amplitude, generator.uniform(0.0, 2.0 * math.pi, 6)))

    def up(self, t: float) -> tuple[float, float]:
        """Height above the design plane and velocity."""
        hz, amplitude, phase = self._waves  # type: ignore[attr-defined]
        run = t - self.stand_s
        ramp = min(max(run / 3.0, 0.0), 1.0)
        soft, rate = ramp * ramp * (3.0 - 2.0 * ramp), (6.0 * ramp * (1.0 - ramp)) / 3.0
        angle = 2.0 * math.pi * hz * run + phase
        wave, slope = (
            float((amplitude * np.sin(angle)).sum()),
            float((2.0 * math.pi * hz * amplitude * np.cos(angle)).sum()),
        )
        return soft * wave, soft * slope + rate * wave

    def rotation(self, t: float) -> FloatArray:
        heading = 0.3
        if self.speed is not None:
            east, north = self.speed(t)
            heading = math.atan2(north, east) if east or north else heading
        roll, pitch = self.sway_rad * math.sin(2.1 * t), self.sway_rad * math.sin(1.3 * t + 1.0)
        return rotation_from_rpy(roll, pitch, heading)

    def motion(self, t0: float, t1: float, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> MountMotion:
        """Of a mount at ``offset`` in body axes."""
        span = t1 - t0
        places, speeds = zip(*(self._point(t, np.array(offset)) for t in (t0, t1)), strict=True)
        turned = self.rotation(t0).T @ self.rotation(t1)
        return MountMotion(
            t_ns=round(t1 * NS_PER_S),
            interval_s=span,
            position_enu_m=places[1],
            rotation=self.rotation(t1),
            velocity_enu_m_s=speeds[1],
            mean_velocity_enu_m_s=(places[1] - places[0]) / span,
            mean_specific_force_m_s2=self.rotation(0.5 * (t0 + t1)).T @ ((speeds[1] - speeds[0]) / span + _G),
            mean_rate_rad_s=np.array([turned[2, 1], turned[0, 2], turned[1, 0]]) / span,
        )

    def _point(self, t: float, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
        height, rising = self.up(t)
        east, north = (0.0, 0.0) if self.speed is None else self.speed(t)
        # places are only used through their differences over a sample; level ones start anew each time
        place = (
            np.array([east * t, north * t, DESIGN_M + height])
            if self.speed is None
            else np.array([*_travelled(self.speed, t), DESIGN_M + height])
        )
        step = 1e-4
        arm_rate = (self.rotation(t + step) - self.rotation(t - step)) @ offset / (2.0 * step)
        return place + self.rotation(t) @ offset, np.array([east, north, rising]) + arm_rate


_TRAVELLED: dict[Any, tuple[float, FloatArray]] = {}


def _travelled(speed: Callable[[float], tuple[float, float]], t: float) -> FloatArray:
    """Level place at a time, integrated on a fixed grid of 10 ms."""
    grid = _TRAVELLED.get(speed)
    if grid is None or t > grid[0] - 1.0:
        end = t + 200.0
        times = np.arange(0.0, end, 0.01)
        velocity = np.array([speed(float(each)) for each in times])
        steps = 0.5 * (velocity[1:] + velocity[:-1]) * 0.01
        grid = (end, np.vstack([np.zeros(2), np.cumsum(steps, axis=0)]))
        _TRAVELLED[speed] = grid
    index = int(t / 0.01)
    rest = t / 0.01 - index
    return grid[1][index] * (1.0 - rest) + grid[1][index + 1] * rest


def make_sensor(
    name: str, preset: str, machine: Machine, *, runs: Sequence[int], seed: int = 1, **changes: Any
) -> Sensor:
    config = CONFIGS.validate_python({"mount": name, **load_preset(preset), **changes})
    mount = Mount(body="plate", xyz_m=machine.mounts.get(name, (0.0, 0.0, 0.0)))
    return build_sensor(config, name=name, mount=mount, dt_ns=DT_NS, seed=seed, runs=runs)


@dataclass(frozen=True)
class Result:
    """What one estimator said at 50 Hz: (T,) times and (T, R) arrays."""

    t_s: FloatArray
    error_m: FloatArray
    sigma_m: FloatArray
    velocity_error_m_s: FloatArray
    velocity_sigma_m_s: FloatArray
    nees: FloatArray
    extra: dict[str, FloatArray]
    fix_s: FloatArray
    """(F,) times of the receiver's samples."""
    true_fix: FloatArray
    """(F, R) whether each was a fix that is what it says."""


def run(
    estimators: Mapping[str, Any],
    *,
    duration_s: float,
    machine: Machine | None = None,
    members: int | Sequence[int] = 1,
    seed: int = 1,
    gnss: str = "rtk_chcnav_i70",
    faults: Sequence[Mapping[str, Any]] = (),
    gnss_changes: Mapping[str, Any] | None = None,
    ahrs_changes: Mapping[str, Any] | None = None,
) -> dict[str, Result]:
    """Drive the bench; ``estimators`` are configurations by name."""
    machine = machine or Machine(seed=seed)
    runs = range(members) if isinstance(members, int) else members
    sensors = [
        make_sensor("gnss", gnss, machine, runs=runs, seed=seed, faults=list(faults), **(gnss_changes or {})),
        make_sensor("ahrs", "ahrs_mti300", machine, runs=runs, seed=seed, **(ahrs_changes or {})),
    ]
    setup = EstimatorSetup(
        name="ours",
        runs=len(runs),
        sensors={sensor.name: sensor.info for sensor in sensors},
        reference=Mount(body="plate", xyz_m=machine.mounts.get("reference", (0.0, 0.0, 0.0))),
        rows_y_m=(),
        start_e_n_heading=(0.0, 0.0, 0.0),
        design_height_m=DESIGN_M,
    )
    built = {name: build_estimator(config, setup) for name, config in estimators.items()}
    return drive(built, sensors, machine, duration_s=duration_s)


def drive(
    estimators: Mapping[str, Estimator], sensors: Sequence[Sensor], machine: Machine, *, duration_s: float
) -> dict[str, Result]:
    waiting: list[tuple[int, int, Measurement]] = []
    before = dict.fromkeys((sensor.name for sensor in sensors), 0.0)
    said: dict[str, list[Any]] = {name: [] for name in estimators}
    truth: list[tuple[float, float, float]] = []
    count = 0
    fixes: list[tuple[float, FloatArray]] = []
    for step in range(1, round(duration_s * 50.0) + 1):
        t_ns = step * 20_000_000
        for sensor in sensors:
            while sensor.next_tick * DT_NS <= t_ns:
                t = sensor.next_tick * DT_NS / NS_PER_S
                captured = machine.motion(before[sensor.name], t, machine.mounts.get(sensor.name, (0.0, 0.0, 0.0)))
                before[sensor.name] = t
                sample = sensor.sample(captured)
                if TRUE_FIX in sensor.hidden_columns:
                    fixes.append((t, sample.hidden[:, sensor.hidden_columns.index(TRUE_FIX)]))
                for measurement in sample.measurements:
                    heapq.heappush(waiting, (measurement.t_available_ns, count, measurement))
                    count += 1
        while waiting and waiting[0][0] <= t_ns:
            measurement = heapq.heappop(waiting)[2]
            for estimator in estimators.values():
                estimator.process(measurement)
        t = t_ns / NS_PER_S
        place, speed = machine._point(t, np.array(machine.mounts.get("reference", (0.0, 0.0, 0.0))))
        truth.append((t, place[2] - DESIGN_M, speed[2]))
        for name, estimator in estimators.items():
            said[name].append(estimator.estimate(t_ns))
    t_s, height, rising = np.array(truth).T
    fixed = np.array([each[0] for each in fixes]), np.array([each[1] for each in fixes])
    return {name: _result(estimators[name], said[name], t_s, height, rising, fixed) for name in estimators}


def _result(
    estimator: Estimator,
    said: list[Any],
    t_s: FloatArray,
    height: FloatArray,
    rising: FloatArray,
    fixed: tuple[FloatArray, FloatArray],
) -> Result:
    values, sigmas = np.stack([each.values for each in said]), np.stack([each.sigmas for each in said])
    error = np.stack([values[:, :, 0] - height[:, np.newaxis], values[:, :, 1] - rising[:, np.newaxis]], axis=-1)
    nees = np.full(error.shape[:2], np.nan)
    if estimator.state_columns and said[0].covariance is not None:
        covariance = np.stack([each.covariance for each in said])
        nees = np.einsum("tri,trij,trj->tr", error, np.linalg.inv(covariance), error)
    return Result(
        t_s=t_s,
        error_m=error[:, :, 0],
        sigma_m=sigmas[:, :, 0],
        velocity_error_m_s=error[:, :, 1],
        velocity_sigma_m_s=sigmas[:, :, 1],
        nees=nees,
        extra={name: values[:, :, index] for index, name in enumerate(estimator.columns[2:], start=2)},
        fix_s=fixed[0],
        true_fix=fixed[1],
    )


# --- scores ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Honesty:
    """Of one result from a time on, and in bins of a second."""

    inside: float
    """Share with |e| <= 2.576 sigma."""
    worst_bin_inside: float
    unsafe: float
    """Share with |e| > 30 mm while 3 sigma < 30 mm."""
    worst_ratio: float
    """Mean sigma over RMS error, largest of all bins."""
    least_ratio: float
    rmse_m: float


def honesty(result: Result, from_s: float, to_s: float = math.inf) -> Honesty:
    counted = (result.t_s > from_s + 1e-9) & (result.t_s <= to_s + 1e-9)
    error, sigma = np.abs(result.error_m[counted]), result.sigma_m[counted]
    inside = error <= 2.576 * sigma
    bins = np.floor(result.t_s[counted] - from_s - 1e-6).astype(int)
    shares = [inside[bins == each].mean() for each in np.unique(bins)]
    ratios = [sigma[bins == each].mean() / np.sqrt(np.square(error[bins == each]).mean()) for each in np.unique(bins)]
    return Honesty(
        inside=float(inside.mean()),
        worst_bin_inside=float(min(shares)),
        unsafe=float(((error > LIMIT_M) & (3.0 * sigma < LIMIT_M)).mean()),
        worst_ratio=float(max(ratios)),
        least_ratio=float(min(ratios)),
        rmse_m=float(np.sqrt(np.square(error).mean())),
    )


def recovered(result: Result, end_s: float, within_s: float) -> float:
    """Share of members with |e| <= 30 mm and sigma <= 15 mm so long after their first true fix since ``end_s``."""
    later = result.fix_s >= end_s - 1e-9
    first_s = result.fix_s[later][np.argmax(result.true_fix[later] > 0.0, axis=0)]
    at = np.searchsorted(result.t_s, first_s + within_s - 1e-9)
    counted = (result.true_fix[later] > 0.0).any(axis=0) & (at < len(result.t_s))
    members = np.flatnonzero(counted)
    error, sigma = np.abs(result.error_m[at[members], members]), result.sigma_m[at[members], members]
    return float(((error <= LIMIT_M) & (sigma <= 0.5 * LIMIT_M)).mean())
