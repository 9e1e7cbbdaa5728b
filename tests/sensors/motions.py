"""Synthetic motions of a mount, with the exact means a world would capture, and a loop that samples a sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from twin.geometry import STANDARD_GRAVITY_M_S2, rotation_from_rpy
from twin.sensors import AnySensorConfig, Sample, Sensor, SensorConfigUnion, build_sensor
from twin.sensors.presets import load_preset
from twin.signals import (
    NS_PER_S,
    BoolArray,
    Capture,
    EarthField,
    FloatArray,
    ImageNeed,
    JointMotion,
    JointNeed,
    MagneticField,
    MagneticNeed,
    Measurement,
    Mount,
    MountMotion,
    Need,
    Picture,
    RayNeed,
    RayScan,
)
from twin.stop_sign import draw_plate, octagon

DT_NS = 2_000_000
MOUNT = Mount(body="base", xyz_m=(0.0, 0.0, 0.0))
CONFIGS: TypeAdapter[AnySensorConfig] = TypeAdapter(SensorConfigUnion)

Motion = Callable[[float, float], MountMotion]
"""From the begin and the end of an interval (s) to the motion over it."""

_G = np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])


def _motion(
    t0: float, t1: float, *, position: Callable[[float], Any], velocity: Callable[[float], Any], rotation: FloatArray
) -> dict[str, Any]:
    span = t1 - t0
    return {
        "t_ns": round(t1 * NS_PER_S),
        "interval_s": span,
        "position_enu_m": np.array(position(t1), dtype=np.float64),
        "rotation": rotation,
        "velocity_enu_m_s": np.array(velocity(t1), dtype=np.float64),
        "mean_velocity_enu_m_s": (np.array(position(t1)) - np.array(position(t0))) / span,
    }


def straight(
    speed: Callable[[float], float],
    distance: Callable[[float], float],
    *,
    pitch_rad: float = 0.0,
    heading_rad: float = 0.0,
) -> Motion:
    """Level travel along a heading; ``distance`` is the integral of ``speed``. The mount may be pitched."""
    rotation = rotation_from_rpy(0.0, pitch_rad, heading_rad)
    along = np.array([math.cos(heading_rad), math.sin(heading_rad), 0.0])

    def motion(t0: float, t1: float) -> MountMotion:
        acceleration = (speed(t1) - speed(t0)) / (t1 - t0) * along
        return MountMotion(
            **_motion(
                t0, t1, position=lambda t: distance(t) * along, velocity=lambda t: speed(t) * along, rotation=rotation
            ),
            mean_specific_force_m_s2=rotation.T @ (acceleration + _G),
            mean_rate_rad_s=np.zeros(3),
        )

    return motion


def constant(speed: float, *, pitch_rad: float = 0.0, heading_rad: float = 0.0) -> Motion:
    """Steady level travel."""
    return straight(lambda _: speed, lambda t: speed * t, pitch_rad=pitch_rad, heading_rad=heading_rad)


def ramp(start: float, acceleration: float, *, from_s: float, to_s: float) -> Motion:
    """Steady, then evenly accelerated between two times, then steady."""

    def speed(t: float) -> float:
        return start + acceleration * (min(max(t, from_s), to_s) - from_s)

    def distance(t: float) -> float:
        run = min(max(t, from_s), to_s) - from_s
        return start * t + 0.5 * acceleration * run**2 + acceleration * (to_s - from_s) * max(0.0, t - to_s)

    return straight(speed, distance)


def circle(speed: float, radius: float) -> Motion:
    """Level circle to the left, from the origin towards east."""
    rate = speed / radius

    def position(t: float) -> list[float]:
        return [radius * math.sin(rate * t), radius * (1.0 - math.cos(rate * t)), 0.0]

    def motion(t0: float, t1: float) -> MountMotion:
        return MountMotion(
            **_motion(
                t0,
                t1,
                position=position,
                velocity=lambda t: [speed * math.cos(rate * t), speed * math.sin(rate * t), 0.0],
                rotation=rotation_from_rpy(0.0, 0.0, rate * t1),
            ),
            mean_specific_force_m_s2=np.array([0.0, speed * rate, 0.0]) + _G,
            mean_rate_rad_s=np.array([0.0, 0.0, rate]),
        )

    return motion


def spin(force: Sequence[float], rate: Sequence[float]) -> Motion:
    """A test bench: any constant specific force and rate, standing."""

    def motion(t0: float, t1: float) -> MountMotion:
        return MountMotion(
            **_motion(t0, t1, position=lambda _: [0.0] * 3, velocity=lambda _: [0.0] * 3, rotation=np.eye(3)),
            mean_specific_force_m_s2=np.array(force, dtype=np.float64),
            mean_rate_rad_s=np.array(rate, dtype=np.float64),
        )

    return motion


STANDING = constant(0.0)
EARTH = EarthField()
WHEEL_RADIUS_M = 0.033


def shown(need: Need, motion: MountMotion) -> Capture:
    """What a world would show: wheels roll with the mount, a single slide swings; a wall at 1 m all round, a sign."""
    place: dict[str, Any] = {"t_ns": motion.t_ns, "position_enu_m": motion.position_enu_m}
    match need:
        case JointNeed(joints=(_,)):
            return JointMotion(**place, position=0.15 * np.sin(np.linalg.norm(motion.position_enu_m, keepdims=True)))
        case JointNeed():
            turned = float(np.linalg.norm(motion.position_enu_m)) / WHEEL_RADIUS_M
            return JointMotion(**place, position=np.full(len(need.joints), turned))
        case MagneticNeed():
            return MagneticField(**place, field_ut=EARTH.enu_ut @ motion.rotation, motor_current_a=0.0)
        case RayNeed():
            return RayScan(**place, distance_m=np.full(len(need.bearings_rad), 1.0), illuminance_lux=500.0)
        case ImageNeed():
            return Picture(
                **place, rgb=sign_ahead(need), illuminance_lux=5_000.0, sign_xyz_m=np.array([0.83, 0.0, 0.0])
            )
        case _:
            return motion


def sign_ahead(
    need: ImageNeed, size_px: int = 48, *, ground: tuple[int, int, int] = (110, 140, 80)
) -> NDArray[np.uint8]:
    """Picture of a stop sign, seen straight from the front in the middle, before something of one colour."""
    rgb = np.full((need.height_px, need.width_px, 3), ground, dtype=np.uint8)
    inside = np.zeros((size_px, size_px), dtype=np.uint8)
    cv2.fillPoly(inside, [np.round(octagon(size_px) + 0.5 * (size_px - 1)).astype(np.int32)], 1)
    top, left = (need.height_px - size_px) // 2, (need.width_px - size_px) // 2
    part = rgb[top : top + size_px, left : left + size_px]
    part[inside == 1] = draw_plate(size_px)[inside == 1]
    return rgb


def preset(name: str) -> dict[str, Any]:
    """Values of a preset, with a mount."""
    return {"mount": "here", **load_preset(name)}


def sensor(config: dict[str, Any], *, runs: Sequence[int] = (0,), seed: int = 1, name: str = "device") -> Sensor:
    """Validate a configuration and build its sensor."""
    return build_sensor(
        CONFIGS.validate_python({"mount": "here", **config}), name=name, mount=MOUNT, dt_ns=DT_NS, seed=seed, runs=runs
    )


@dataclass(frozen=True, kw_only=True)
class Log:
    """All samples of one sensor."""

    sensor: Sensor
    samples: list[Sample]
    taken_ns: list[int]

    @property
    def measurements(self) -> list[Measurement]:
        return [measurement for sample in self.samples for measurement in sample.measurements]

    def values(self, column: str) -> FloatArray:
        """(T, R)."""
        return np.stack([measurement.column(column) for measurement in self.measurements])

    def hidden(self, column: str) -> FloatArray:
        """(T, R)."""
        index = self.sensor.hidden_columns.index(column)
        return np.stack([sample.hidden[:, index] for sample in self.samples])

    @property
    def valid(self) -> BoolArray:
        """(T, R)."""
        return np.stack([measurement.valid for measurement in self.measurements])

    @property
    def t_s(self) -> FloatArray:
        """(T,) when samples were taken."""
        return np.array(self.taken_ns) / NS_PER_S


def drive(device: Sensor, motion: Motion, duration_s: float) -> Log:
    """Sample until the end."""
    samples, taken = [], []
    before_ns = 0
    while (t_ns := device.next_tick * DT_NS) <= round(duration_s * NS_PER_S):
        samples.append(device.sample(shown(device.need, motion(before_ns / NS_PER_S, t_ns / NS_PER_S))))
        taken.append(t_ns)
        before_ns = t_ns
    return Log(sensor=device, samples=samples, taken_ns=taken)
