"""A kinematic bicycle, and estimators that speak of it late, seldom or not at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from twin.control.path_following import PathDriver
from twin.signals import HEADING, NS_PER_S, POSITION, SPEED, Command, Knowledge, Said, VehicleState

WHEELBASE_M = 1.1
STEP_S = 0.02

Speech = Callable[[int, list[VehicleState]], Said | None]
"""What an estimator says at a step, by the states of all steps until then."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One step of a drive."""

    t_s: float
    state: VehicleState
    offset_m: float
    """From the planned path, left positive."""
    leg: int
    command: Command


def drive(driver: PathDriver, duration_s: float, says: Speech | None = None) -> list[Moment]:
    """Drive with a steering lag of 0.2 s, 0.6 rad/s of steering rate and a speed lag of 0.3 s.

    With ``says`` the driver hears an estimator ``est`` and sees nothing.
    """
    start = driver.path.pose(0.0)
    east, north, heading, speed, steering = start.east_m, start.north_m, start.heading_rad, 0.0, 0.0
    states: list[VehicleState] = []
    moments = []
    station = 0.0
    for step in range(round(duration_s / STEP_S)):
        turned = math.remainder(heading, 2.0 * math.pi)
        states.append(VehicleState(east_m=east, north_m=north, heading_rad=turned, speed_m_s=speed))
        t_ns = round(step * STEP_S * NS_PER_S)
        if says is None:
            knowledge = Knowledge(t_ns=t_ns, vehicle=states[-1])
        else:
            said = says(step, states)
            knowledge = Knowledge(t_ns=t_ns, said={} if said is None else {"est": said})
        command = driver.command(knowledge, STEP_S)
        station, offset = driver.path.project(east, north, near_m=station, window_m=2.0)
        moments.append(
            Moment(t_s=step * STEP_S, state=states[-1], offset_m=offset, leg=driver.segment, command=command)
        )
        speed = 0.0 if command.brake else speed + (command.speed_m_s - speed) * STEP_S / 0.3
        steering += min(max((command.steering_rad - steering) * STEP_S / 0.2, -0.6 * STEP_S), 0.6 * STEP_S)
        east += speed * math.cos(heading) * STEP_S
        north += speed * math.sin(heading) * STEP_S
        heading += speed * math.tan(steering) / WHEELBASE_M * STEP_S
    return moments


def estimate(
    t_ns: int,
    state: VehicleState,
    *,
    ahead_m: float = 0.0,
    left_m: float = 0.0,
    turned_rad: float = 0.0,
    speed_m_s: float | None = None,
) -> Said:
    """What an estimator of a frame ``ahead_m`` before the rear axle says that errs by the other figures."""
    heading = state.heading_rad + turned_rad
    values = (
        state.east_m + ahead_m * math.cos(heading) - left_m * math.sin(heading),
        state.north_m + ahead_m * math.sin(heading) + left_m * math.cos(heading),
        heading,
        state.speed_m_s if speed_m_s is None else speed_m_s,
    )
    return Said(t_ns=t_ns, values=dict(zip((*POSITION[:2], HEADING, SPEED), values, strict=True)))
