"""A made-up run for the picture tests: every stream the pictures know, from closed-form motion.

The reference frame (the implement) follows straights and turns at given curvature; the tractor's base runs ahead of it
on the same path. Estimates are the truth plus first-order Gauss-Markov errors of the stated sigma.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin.geometry import wrap_angle
from twin.recording import (
    Recording,
    Stream,
    covariance_column,
    estimate_stream,
    measurement_stream,
)
from twin.signals import NS_PER_S, Event, FloatArray, row_position, row_speed, sigma_column
from viz.scene import Scene

RATE_HZ = 50
ROWS = 8
ROW_SPACING_M = 0.75
DRAWBAR_M = 4.2
ROWS_Y_M = tuple((ROWS - 1) / 2 * ROW_SPACING_M - ROW_SPACING_M * row for row in range(ROWS))

STAND_S = 5.0
SPEED_M_S = 2.5
RADIUS_M = 10.0
SEGMENTS = (("straight 15 m", 15.0, 0.0), ("turn 180 deg right", np.pi * RADIUS_M, -1.0 / RADIUS_M))

SCENARIO_TOML = """
title = "Synthetic: a straight and a half circle"
source = "made up for the tests"
notes = "Closed-form motion, Gauss-Markov errors."
seed = 7
duration_s = {duration}
"""


@dataclass(frozen=True)
class Motion:
    t_ns: np.ndarray
    e: FloatArray
    n: FloatArray
    heading: FloatArray
    yaw_rate: FloatArray
    speed: FloatArray
    segment: FloatArray
    base_e: FloatArray
    base_n: FloatArray
    base_heading: FloatArray


def hill(e: FloatArray, n: FloatArray) -> FloatArray:
    """Rolling ground, m."""
    return 0.5 * np.sin(e / 17.0) * np.cos(n / 13.0) + 0.01 * np.sin(e * 1.3) * np.cos(n * 1.7)


def drive(duration_s: float) -> Motion:
    """Integrate the path by arc length and sample the motion at ``RATE_HZ``."""
    step = 0.01
    bounds = np.cumsum([0.0, *(length for _, length, _ in SEGMENTS)])
    curvatures = np.array([0.0, *(curvature for _, _, curvature in SEGMENTS), 0.0])
    arc = np.arange(-1.0, 500.0, step)
    curvature = curvatures[np.searchsorted(bounds, arc, side="right")]
    heading = np.cumsum(curvature) * step
    e, n = np.cumsum(np.cos(heading)) * step, np.cumsum(np.sin(heading)) * step
    t_ns = np.arange(round(duration_s * RATE_HZ) + 1, dtype=np.int64) * (NS_PER_S // RATE_HZ)
    t = t_ns / NS_PER_S
    speed = SPEED_M_S * np.clip((t - STAND_S) / 2.0, 0.0, 1.0)
    s = np.cumsum(speed) / RATE_HZ

    def at(values: FloatArray, where: FloatArray) -> FloatArray:
        return np.interp(where, arc, values)

    return Motion(
        t_ns=t_ns,
        e=at(e, s),
        n=at(n, s),
        heading=at(heading, s),
        yaw_rate=speed * at(curvature, s),
        speed=speed,
        segment=np.where(t < STAND_S, 0.0, np.searchsorted(bounds, s, side="right").astype(float)),
        base_e=at(e, s + DRAWBAR_M),
        base_n=at(n, s + DRAWBAR_M),
        base_heading=at(heading, s + DRAWBAR_M),
    )


def gauss_markov(rng: np.random.Generator, count: int, sigma: float, tau_s: float) -> FloatArray:
    """First-order Gauss-Markov noise, (count,)."""
    decay = np.exp(-1.0 / (RATE_HZ * tau_s))
    white = rng.standard_normal(count) * sigma * np.sqrt(1.0 - decay**2)
    out = np.empty(count)
    state = sigma * rng.standard_normal()
    for i in range(count):
        state = decay * state + white[i]
        out[i] = state
    return out


def table(t_ns: np.ndarray, columns: dict[str, FloatArray], *, measured: bool = False) -> Stream:
    """A stream of one run."""
    values = np.stack(list(columns.values()), axis=-1)[:, np.newaxis, :]
    late = t_ns + 20_000_000 if measured else None
    valid = np.ones((len(t_ns), 1), dtype=bool) if measured else None
    return Stream(columns=tuple(columns), t_ns=t_ns, values=values, t_available_ns=late, valid=valid)


def rows_of(e: FloatArray, n: FloatArray, heading: FloatArray) -> dict[str, FloatArray]:
    """East and north of every row unit."""
    out: dict[str, FloatArray] = {}
    for row, y in enumerate(ROWS_Y_M, start=1):
        east, north = row_position(row)
        out[east], out[north] = e - y * np.sin(heading), n + y * np.cos(heading)
    return out


def truth_stream(motion: Motion) -> Stream:
    zeros = np.zeros(len(motion.t_ns))
    columns = {
        "position_e_m": motion.e,
        "position_n_m": motion.n,
        "position_u_m": hill(motion.e, motion.n),
        "heading_rad": wrap_angle(motion.heading),
        "yaw_rate_rad_s": motion.yaw_rate,
        "speed_m_s": motion.speed,
        **{row_speed(row): motion.speed - motion.yaw_rate * y for row, y in enumerate(ROWS_Y_M, start=1)},
        **rows_of(motion.e, motion.n, motion.heading),
        "segment": motion.segment,
        "base_e_m": motion.base_e,
        "base_n_m": motion.base_n,
        "base_u_m": hill(motion.base_e, motion.base_n),
        "base_qx": zeros,
        "base_qy": zeros,
        "base_qz": np.sin(motion.base_heading / 2),
        "base_qw": np.cos(motion.base_heading / 2),
        "joint.hitch_rad": motion.heading - motion.base_heading,
        "joint.steer_rad": np.arctan(2.8 * np.gradient(motion.base_heading) * RATE_HZ / np.maximum(motion.speed, 0.1)),
        "joint.wheel_rad": np.cumsum(motion.speed) / RATE_HZ / 0.9,
    }
    return table(motion.t_ns, columns)


def central_stream(motion: Motion, rng: np.random.Generator) -> Stream:
    count = len(motion.t_ns)
    sigma_e, sigma_n = 0.05 + 0.1 * np.linspace(0, 1, count), 0.03 + 0.05 * np.linspace(0, 1, count)
    e = motion.e + sigma_e * gauss_markov(rng, count, 1.0, 8.0)
    n = motion.n + sigma_n * gauss_markov(rng, count, 1.0, 8.0)
    heading = motion.heading + gauss_markov(rng, count, 0.01, 5.0)
    speed = motion.speed + gauss_markov(rng, count, 0.03, 0.5)
    yaw_rate = motion.yaw_rate + gauss_markov(rng, count, 0.005, 0.2)
    values = {
        "position_e_m": e,
        "position_n_m": n,
        "speed_m_s": speed,
        "heading_rad": wrap_angle(heading),
        "yaw_rate_rad_s": yaw_rate,
        **{row_speed(row): speed - yaw_rate * y for row, y in enumerate(ROWS_Y_M, start=1)},
        **rows_of(e, n, heading),
        "standstill": (motion.speed < 0.05).astype(float),
    }
    sigmas = {
        "position_e_m": sigma_e,
        "position_n_m": sigma_n,
        "speed_m_s": 0.03,
        "heading_rad": 0.01,
        "yaw_rate_rad_s": 0.005,
        **{row_speed(row): np.hypot(0.03, 0.005 * y) for row, y in enumerate(ROWS_Y_M, start=1)},
    }
    values |= {sigma_column(name): np.broadcast_to(sigma, count) for name, sigma in sigmas.items()}
    values |= {
        covariance_column("position_e_m", "position_e_m"): sigma_e**2,
        covariance_column("position_e_m", "position_n_m"): 0.5 * sigma_e * sigma_n,
        covariance_column("position_n_m", "position_n_m"): sigma_n**2,
    }
    return table(motion.t_ns, values)


def radar_stream(motion: Motion, rng: np.random.Generator) -> Stream:
    speed = motion.speed + 0.03 * rng.standard_normal(len(motion.t_ns))
    speed = np.where(motion.speed < 0.13, 0.0, speed)
    return table(motion.t_ns, {"speed_m_s": speed, "pulses": np.round(speed * 99 / RATE_HZ)}, measured=True)


def radar_only_stream(radar: Stream) -> Stream:
    speed = radar.column("speed_m_s")[:, 0]
    columns = {"speed_m_s": speed} | {row_speed(row): speed for row in range(1, ROWS + 1)}
    columns |= {sigma_column(row_speed(row)): np.full(len(speed), 0.03) for row in range(1, ROWS + 1)}
    return table(radar.t_ns, columns)


def gnss_stream(motion: Motion, rng: np.random.Generator) -> Stream:
    pick = slice(0, None, RATE_HZ // 10)
    t_ns = motion.t_ns[pick]
    count = len(t_ns)
    quality = np.full(count, 4.0)
    for code, share in ((5, 0.6), (2, 0.75), (1, 0.85), (0, 0.93), (4, 0.96)):
        quality[int(share * count) :] = code
    sigma = np.select([quality == 4, quality == 5, quality == 2, quality == 1], [0.01, 0.2, 0.4, 0.8], np.nan)
    noise = rng.standard_normal((3, count)) * sigma
    columns = {
        "position_e_m": motion.e[pick] + noise[0],
        "position_n_m": motion.n[pick] + noise[1],
        "position_u_m": hill(motion.e, motion.n)[pick] + 1.2 + noise[2] * 0.1,
        "speed_m_s": motion.speed[pick],
        "course_rad": wrap_angle(motion.heading[pick]),
        "sigma_e_m": sigma,
        "sigma_n_m": sigma,
        "sigma_u_m": sigma * 1.9,
        "quality": quality,
        "satellites": np.full(count, 12.0),
        "hdop": np.full(count, 0.8),
        "vdop": np.full(count, 1.4),
        "age_s": np.full(count, 1.0),
    }
    return table(t_ns, columns, measured=True)


def imu_stream(motion: Motion, rng: np.random.Generator) -> Stream:
    axes = [f"{kind}_{axis}_{unit}" for kind, unit in (("accel", "m_s2"), ("gyro", "rad_s")) for axis in "xyz"]
    return table(motion.t_ns, {name: rng.standard_normal(len(motion.t_ns)) for name in axes}, measured=True)


def make_recording(duration_s: float = 30.0, *, seed: int = 7) -> Recording:
    """A complete recording: truth, radar, GNSS, four IMUs, two estimators, events."""
    rng = np.random.default_rng(seed)
    motion = drive(duration_s)
    radar = radar_stream(motion, rng)
    streams = {"truth": truth_stream(motion), measurement_stream("radar"): radar}
    streams[measurement_stream("gnss")] = gnss_stream(motion, rng)
    streams |= {measurement_stream(f"imu_{row}"): imu_stream(motion, rng) for row in (1, 4, 5, 8)}
    streams[estimate_stream("central")] = central_stream(motion, rng)
    streams[estimate_stream("radar_only")] = radar_only_stream(radar)
    changes = np.flatnonzero(np.diff(motion.segment, prepend=-1))
    labels = ("stand 5 s", *(name for name, _, _ in SEGMENTS), "straight to the end")
    events = [
        Event(t_ns=int(motion.t_ns[i]), source="driver", level="info", text=labels[int(motion.segment[i])])
        for i in changes
    ]
    lost_ns = round(0.6 * duration_s) * NS_PER_S
    events.append(Event(t_ns=lost_ns, source="sensors.gnss", level="warning", text="corrections lost: RTK float"))
    events.append(Event(t_ns=lost_ns + 5 * NS_PER_S, source="sensors.gnss", level="error", text="no position"))
    return Recording(
        scenario_toml=SCENARIO_TOML.format(duration=duration_s),
        scenario_name="synthetic",
        seed=seed,
        runs=(0,),
        streams=streams,
        events=events,
        ended_t_s=duration_s,
    )


def make_result(duration_s: float = 30.0) -> dict[str, Any]:
    """A result in the shape of ``result.json``."""
    return {
        "schema": 1,
        "scenario": "synthetic",
        "seed": 7,
        "run": 0,
        "verdict": "fail",
        "ended": {"reason": "duration", "t_s": duration_s},
        "metrics": {
            "central.row_speed.mean_abs_error_turns_m_s": 0.0213,
            "radar_only.row_speed.mean_abs_error_row_1_m_s": 0.61,
            "radar_only.position.rmse_m": None,
        },
        "published": {"radar_only.row_speed.mean_abs_error_row_1_m_s": 0.57},
        "checks": [
            {"metric": "central.row_speed.mean_abs_error_turns_m_s", "max": 0.06, "value": 0.0213, "ok": True},
            {
                "metric": "central.row_speed.mean_abs_error_turns_m_s",
                "ratio_to": "radar_only.row_speed.mean_abs_error_turns_m_s",
                "max_ratio": 0.2,
                "value": 0.31,
                "ok": False,
            },
        ],
        "timing": {"simulated_s": duration_s, "wall_s": 1.1, "real_time_factor": duration_s / 1.1},
    }


def make_scene(folder: Path) -> Scene:
    """The scene of the run, with its machine's URDF written to ``folder``."""
    urdf = folder / "synthetic_planter.urdf"
    urdf.write_text(URDF)
    cell, x0, y0 = 0.25, -40.0, -60.0
    e, n = np.meshgrid(x0 + cell * np.arange(480), y0 + cell * np.arange(400))
    motion = drive(60.0)
    return Scene(
        urdf=urdf,
        heights=hill(e, n),
        origin_m=(x0, y0),
        cell_m=cell,
        planned_path=np.column_stack([motion.e, motion.n])[::10],
        row_count=ROWS,
    )


def _box(name: str, size: str, xyz: str, colour: str) -> str:
    return (
        f'<visual name="{name}"><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry>'
        f'<material name="{name}"><color rgba="{colour} 1"/></material></visual>'
        f'<collision><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry></collision>'
    )


def _wheel(radius: float, width: float) -> str:
    return (
        f'<visual name="tyre"><origin rpy="1.5708 0 0"/><geometry><cylinder radius="{radius}" length="{width}"/>'
        '</geometry><material name="tyre"><color rgba="0.05 0.05 0.05 1"/></material></visual>'
    )


def _joint(name: str, *, kind: str, parent: str, child: str, xyz: str, axis: str) -> str:
    limit = '<limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>' if kind == "revolute" else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


URDF = f"""<?xml version="1.0"?>
<robot name="synthetic_planter">
<link name="tractor">{_box("hood", "2.2 0.9 0.8", "2.0 0 1.3", "0.1 0.45 0.15")}
{_box("cab", "1.6 1.6 1.6", "0.3 0 2.0", "0.75 0.85 0.9")}</link>
<link name="wheel">{_wheel(0.9, 2.4)}</link>
<link name="axle">{_box("axle", "0.3 1.8 1.0", "0 0 0", "0.05 0.05 0.05")}</link>
<link name="planter">{_box("toolbar", "0.3 6.4 0.3", "0 0 0.8", "0.8 0.1 0.1")}
{_box("drawbar", "3.0 0.2 0.2", "1.6 0 0.7", "0.8 0.1 0.1")}</link>
{_joint("wheel", kind="continuous", parent="tractor", child="wheel", xyz="0 0 0.9", axis="0 1 0")}
{_joint("steer", kind="revolute", parent="tractor", child="axle", xyz="2.8 0 0.5", axis="0 0 1")}
{_joint("hitch", kind="revolute", parent="tractor", child="planter", xyz=f"{-DRAWBAR_M} 0 0", axis="0 0 1")}
</robot>
"""
