"""A made-up run of a levelling blade for the picture tests: one lane over a small field, from closed forms.

The blade's edge stays on the design plane along a lane and leaves the ground there 10 mm low; what it cuts it carries.
Estimates are the truth plus a stated error; the receiver's antenna leans with the machine.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from tests.viz.synthetic_run import RATE_HZ, _box, _joint, table
from twin.groundlog import GroundLog
from twin.recording import Recording, Stream, estimate_stream, hidden_stream, measurement_stream
from twin.signals import HEIGHT, NS_PER_S, VELOCITY, Event, FloatArray, sigma_column
from twin.world.blade_spec import BladeSpec
from twin.world.levelling import LevellingConfig
from viz.scene import Scene

DURATION_S = 24.0
DESIGN_M = 0.5
AREA_M = (0.0, -3.0, 16.0, 3.0)
CELL_M, WEST_M, SOUTH_M, SHAPE = 0.1, -10.0, -10.0, (201, 401)
SPEED_M_S = 1.0
HALF_LANE_M = 1.0
FINISHED_M = -0.010
LOST_S = (10.0, 16.0)
ROLL_RAD = 0.05
LEVER_M = np.array([-0.1, 0.3, 2.0])
RECEIVER_ERROR_M = 0.02
OURS_ERROR_M, OURS_SIGMA_M = 0.008, 0.012
BLADE = BladeSpec(body="scraper", middle_m=(0.0, 0.0, 0.1), width_m=2.0, height_m=0.4)

SCENARIO_TOML = """
title = "Synthetic: one lane of levelling"
duration_s = 24.0
[estimators.ours]
kind = "height_filter"
[estimators.vpkf]
kind = "height_vpkf"
"""


def first_ground() -> FloatArray:
    """Two waves across the field, +-60 mm about the plane."""
    north, east = np.meshgrid(
        SOUTH_M + CELL_M * np.arange(SHAPE[0]), WEST_M + CELL_M * np.arange(SHAPE[1]), indexing="ij"
    )
    waves: FloatArray = DESIGN_M + 0.04 * np.sin(east / 1.7) + 0.02 * np.cos(north / 1.1)
    return waves


def ground_log() -> GroundLog:
    """The lane's nodes, each as the edge passes it."""
    rows = np.flatnonzero(np.abs(SOUTH_M + CELL_M * np.arange(SHAPE[0])) <= HALF_LANE_M + 1e-9)
    columns = np.flatnonzero((WEST_M + CELL_M * np.arange(SHAPE[1]) >= 0.0) & (CELL_M * np.arange(SHAPE[1]) < 30.0))
    passed_ns = np.rint((WEST_M + CELL_M * columns) / SPEED_M_S * NS_PER_S).astype(np.int64)
    return GroundLog(
        t_ns=np.repeat(passed_ns, len(rows)),
        cell=(np.tile(rows, len(columns)) * SHAPE[1] + np.repeat(columns, len(rows))).astype(np.int64),
        height_m=np.full(len(rows) * len(columns), DESIGN_M + FINISHED_M),
    )


def make_scene(folder: Path) -> Scene:
    """Scene of the run, with the machine's URDF written to ``folder``."""
    urdf = folder / "synthetic_scraper.urdf"
    urdf.write_text(URDF)
    return Scene(
        urdf=urdf,
        heights=first_ground(),
        origin_m=(WEST_M, SOUTH_M),
        cell_m=CELL_M,
        planned_path=np.array([[0.0, 0.0], [16.0, 0.0]]),
        footprint_m=((-1.2, -1.0), (1.0, 1.0)),
        banded=frozenset({"ours"}),
        levelling=LevellingConfig(design_height_m=DESIGN_M, area_m=AREA_M),
        blade=BLADE,
        antennas={"gnss": LEVER_M},
    )


def truth_stream() -> Stream:
    """The blade rides on the plane, then is raised for the last four seconds."""
    t_ns = np.arange(round(DURATION_S * RATE_HZ) + 1, dtype=np.int64) * (NS_PER_S // RATE_HZ)
    t = t_ns / NS_PER_S
    raised = np.clip((t - 20.0) / 1.0, 0.0, 1.0) * 0.3
    zero = np.zeros(len(t))
    load = BLADE.capacity_m3 * np.clip(t / 20.0, 0.0, 1.0) * (t < 20.0)
    columns = {
        "position_e_m": SPEED_M_S * t,
        "position_n_m": zero,
        "position_u_m": DESIGN_M + raised,
        "yaw_rate_rad_s": zero,
        "base_e_m": SPEED_M_S * t + 1.0,
        "base_n_m": zero,
        "base_u_m": zero + DESIGN_M + 0.4,
        "base_qx": zero + math.sin(ROLL_RAD / 2.0),
        "base_qy": zero,
        "base_qz": zero,
        "base_qw": zero + math.cos(ROLL_RAD / 2.0),
        "joint.lift_m": raised,
        HEIGHT: raised,
        VELOCITY[2]: zero,
        "blade_load_m3": load,
        "blade_draught_n": 8000.0 * load,
        "field_sd_m": 0.03 - 0.0005 * np.floor(t),
        "field_within_30mm": 0.6 + 0.01 * np.floor(t),
        "field_within_50mm": 0.8 + 0.005 * np.floor(t),
    }
    return table(t_ns, columns)


def gnss_stream(truth: Stream) -> Stream:
    """Ten a second: fixed, then a second of DGPS two metres off, then fixed."""
    pick = slice(0, None, RATE_HZ // 10)
    t_ns = truth.t_ns[pick]
    t = t_ns / NS_PER_S
    lost = (t >= LOST_S[0] + 2.0) & (t < LOST_S[1])
    # the body z axis leans by the roll: the antenna's left part rises, its height shrinks
    lever_up = LEVER_M[1] * math.sin(ROLL_RAD) + LEVER_M[2] * math.cos(ROLL_RAD)
    columns = {
        "position_e_m": truth.column("position_e_m")[pick, 0],
        "position_n_m": truth.column("position_n_m")[pick, 0],
        "position_u_m": truth.column("position_u_m")[pick, 0] + lever_up + np.where(lost, 2.0, RECEIVER_ERROR_M),
        "sigma_u_m": np.where(lost, 1.0, 0.015),
        "quality": np.where(lost, 2.0, 4.0),
        "age_s": np.where((t >= LOST_S[0]) & (t < LOST_S[1]), 1.0 + t - LOST_S[0], 1.0),
    }
    return table(t_ns, columns, measured=True)


def make_recording() -> Recording:
    """Truth, a receiver, two estimators, the ground's changes, events."""
    truth = truth_stream()
    height = truth.column(HEIGHT)[:, 0]
    gnss = gnss_stream(truth)
    t = truth.t_ns / NS_PER_S
    lost = (t >= LOST_S[0]) & (t < LOST_S[1])
    sigma = sigma_column(HEIGHT)
    ours = {HEIGHT: height + OURS_ERROR_M, sigma: np.full(len(t), OURS_SIGMA_M), "mode": np.where(lost, 2.0, 1.0)}
    vpkf = {
        HEIGHT: height + np.where(lost, 1.5, 0.015),
        sigma: np.full(len(t), 0.016),
        "mode": np.where(lost, 1.0, 2.0),
    }
    hidden = {"position_u_m.error": np.where(gnss.column("quality")[:, 0] == 2.0, 2.0, RECEIVER_ERROR_M)}
    faults = [
        Event(t_ns=round(at * NS_PER_S), source="sensors.gnss", level="warning", text=f"fault corrections_lost {does}")
        for at, does in zip(LOST_S, ("begins", "ends"), strict=True)
    ]
    return Recording(
        scenario_toml=SCENARIO_TOML,
        scenario_name="synthetic_levelling",
        seed=7,
        runs=(0,),
        streams={
            "truth": truth,
            measurement_stream("gnss"): gnss,
            hidden_stream("gnss"): table(gnss.t_ns, hidden),
            estimate_stream("ours"): table(truth.t_ns, ours),
            estimate_stream("vpkf"): table(truth.t_ns, vpkf),
        },
        events=faults,
        ground=ground_log(),
        ended_t_s=DURATION_S,
    )


def without_area(scene: Scene) -> Scene:
    """The same scene, nothing of which is to be levelled."""
    return dataclasses.replace(scene, levelling=LevellingConfig(design_height_m=DESIGN_M))


URDF = f"""<?xml version="1.0"?>
<robot name="synthetic_scraper">
<link name="chassis">{_box("body", "2.0 1.0 0.5", "0 0 0.2", "0.75 0.12 0.14")}</link>
<link name="scraper">{_box("plate", "0.04 2.0 0.4", "-0.02 0 0.3", "0.8 0.65 0.1")}
{_box("mast", "0.05 0.05 2.0", "-0.1 0 1.0", "0.6 0.6 0.6")}</link>
{
    _joint("lift", kind="prismatic", parent="chassis", child="scraper", xyz="-1.0 0 -0.5", axis="0 0 1").replace(
        "<axis", '<limit lower="-1" upper="1" effort="1" velocity="1"/><axis'
    )
}
</robot>
"""
