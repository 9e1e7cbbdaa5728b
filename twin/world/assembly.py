"""A machine laid out in the arrays that the kernels of :mod:`twin.world.dynamics` work on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.geometry import rotation_from_rpy
from twin.signals import FloatArray, IntArray
from twin.world import tyres
from twin.world.machine import KNEE_M_S, MachineModel
from twin.world.soil import Soil
from twin.world.statics import spring_preloads, static_loads
from twin.world.urdf import Urdf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assembly:
    """What of a machine does not change while it moves; the layout of the rows is that of the kernels."""

    parents: IntArray
    """(J,) link from which each joint hangs."""
    joints: FloatArray
    """(J, dynamics.JOINT_COLUMNS)."""
    root_com: FloatArray
    """(3,) centre of mass of the root link."""
    wheel_joints: IntArray
    """(W,) joint of each wheel."""
    wheels: FloatArray
    """(W, tyres.WHEEL_PARAMETERS)."""
    springs: FloatArray
    """(S, 4): joint, stiffness, damping, preload."""
    tools: FloatArray
    """(D, 6): link, x, y, z, force, knee speed of each soil-engaging point."""
    blade_tool: int | None
    """Row of ``tools`` whose force is what the blade feels from moment to moment; None without a blade."""
    static_sinkage_m: float
    """How far the tyres are pressed in as the machine stands, on average; zero without wheels."""


def assemble(urdf: Urdf, machine: MachineModel, soil: Soil, *, servos: Sequence[int]) -> Assembly:
    """Lay a machine out; ``servos`` are the joints that stiff servos hold.

    Raises:
        BadInputError: its wheels cannot carry it.
    """
    names, sprung = [wheel.joint for wheel in machine.wheels], [spring.joint for spring in machine.springs]
    held = [urdf.joints[joint].name for joint in servos]
    loads = static_loads(urdf, names, [*sprung, *held]) if names else np.zeros(0)
    preloads = spring_preloads(urdf, names, sprung, loads) if sprung else np.zeros(0)
    wheel_joints = [urdf.joint_index(name) for name in names]
    wheels = [
        tyres.wheel_parameters(wheel, soil, static_load_n=load, spin_inertia_kg_m2=_spin_inertia(urdf, joint))
        for wheel, load, joint in zip(machine.wheels, loads, wheel_joints, strict=True)
    ]
    springs = [
        (urdf.joint_index(spring.joint), spring.stiffness_n_m_rad, spring.damping_n_m_s_rad, preload)
        for spring, preload in zip(machine.springs, preloads, strict=True)
    ]
    tools = [
        (urdf.link_index(tool.body), tool.x_m, y, tool.z_m, tool.force_n / len(tool.y_m), tool.knee_m_s)
        for tool in machine.draughts
        for y in tool.y_m
    ]
    blade_tool = None if machine.blade is None else len(tools)
    if machine.blade is not None:
        tools.append((urdf.link_index(machine.blade.body), *machine.blade.middle_m, 0.0, KNEE_M_S))
    parameters = np.array(wheels).reshape(-1, tyres.WHEEL_PARAMETERS)
    return Assembly(
        parents=np.array(urdf.parent_indices(), dtype=np.int64),
        joints=np.array(
            [(*j.origin_m, *rotation_from_rpy(*j.origin_rpy).ravel(), *j.axis, float(j.slides)) for j in urdf.joints]
        ),
        root_com=np.array(urdf.links[0].com_m),
        wheel_joints=np.array(wheel_joints, dtype=np.int64),
        wheels=parameters,
        springs=np.array(springs).reshape(-1, 4),
        tools=np.array(tools).reshape(-1, 6),
        blade_tool=blade_tool,
        static_sinkage_m=float(np.mean(loads / parameters[:, tyres.STIFFNESS])) if names else 0.0,
    )


def _spin_inertia(urdf: Urdf, joint: int) -> float:
    axis = np.array(urdf.joints[joint].axis)
    return float(np.abs(axis) @ np.array(urdf.links[joint + 1].inertia_kg_m2))
