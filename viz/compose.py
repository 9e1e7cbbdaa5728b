"""Builds the scene of a recording from its own scenario."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twin.control import build_driver
from twin.recording import TRUTH, Recording
from twin.scenario import Scenario, loads
from twin.scoring.coverage import coverage_of
from twin.sensors.lidar import LidarConfig
from twin.signals import NS_PER_S, FloatArray
from twin.world.clearance import Outline
from twin.world.ground import build_ground
from twin.world.machine import MachineBaseConfig
from twin.world.magnetics import IronConfig, MagnetConfig, Magnetics, MagneticsConfig
from twin.world.orchard import planted
from twin.world.signs import put_up
from twin.world.terrain import Terrain
from twin.world.urdf import read_urdf
from viz.levelled import highest_ground
from viz.magnetic import MU0_4PI_UT, MagneticPieces
from viz.scene import Scanner, Scene

_SHARE_S = 0.05
_OURS = "height_filter"
"""Kind of estimator whose sigma is drawn about its height."""
_PATH_STEP_M = 0.5
"""Of the drawn path; a tenth of it for machines that turn within their own length."""


def scene_of(recording: Recording) -> Scene:
    """Machine, ground and planned path of a recording.

    The ground is the recording's own if it is still in memory; a recording read from disk gets it made again from
    scenario and seed (a terrain file has to lie in the current folder then).

    Raises:
        BadInputError: the recording's scenario cannot be read, or its terrain file is not there any more.
    """
    scenario = loads(recording.scenario_toml, where=f"{recording.scenario_name}/scenario.toml")
    machine, drawn = scenario.machine, scenario.recording.drawn
    driver = build_driver(
        scenario.driver,
        start_e_n_heading=machine.vehicle_start,
        wheelbase_m=machine.wheelbase_m,
        seed=recording.seed,
    )
    path = driver.path.polyline(_PATH_STEP_M if not machine.turns_on_the_spot else 0.1 * _PATH_STEP_M)
    terrain = recording.terrain
    trunks = scenario.orchard.trunks(recording.seed)
    if terrain is None:
        terrain = build_ground(
            scenario.terrain,
            machine,
            seed=recording.seed,
            path=driver.path.polyline(),
            orchard=scenario.orchard,
            signs=scenario.signs,
        )
    kinds = {name: estimator.kind for name, estimator in scenario.estimators.items()}
    ours = frozenset(name for name, kind in kinds.items() if kind == _OURS)
    return Scene(
        urdf=machine.asset,
        heights=terrain.heights,
        origin_m=(terrain.west_m, terrain.south_m),
        cell_m=terrain.cell_m,
        planned_path=path,
        row_count=len(machine.rows_y_m),
        footprint_m=_footprint(machine),
        paved=scenario.soil.preset == "asphalt",
        trunks=planted(trunks, terrain),
        signs=put_up(scenario.signs, terrain),
        magnetic=_magnetic(scenario.magnetics, terrain, ended_t_s=recording.ended_t_s),
        scanners=_scanners(scenario),
        hidden=frozenset(set(scenario.estimators) - set(drawn)) if drawn else frozenset(),
        banded=ours or None,
        levelling=scenario.levelling,
        blade=machine.model(recording.seed).blade,
        bench=machine.fixed,
        antennas=_antennas(scenario),
        highest=highest_ground(terrain.heights, recording.ground) if recording.ground is not None else None,
        coverage=coverage_of(recording.truth, scenario) if TRUTH in recording.streams else None,
        guided_legs=tuple(scenario.planned_legs) if scenario.judges_guidance else (),
        segment_labels=driver.segment_names,
    )


def _footprint(machine: MachineBaseConfig) -> Outline:
    """The machine's footprint; of a bench, whose joints stand above one another, the square that fits in its reach."""
    half = machine.reach_m * math.sqrt(0.5)
    return ((-half, -half), (half, half)) if machine.fixed else machine.footprint_m


def _antennas(scenario: Scenario) -> dict[str, FloatArray]:
    """From the reference frame to the antennas that sit on its body."""
    machine = scenario.machine
    reference = machine.reference
    found: dict[str, FloatArray] = {}
    for name, sensor in scenario.sensors.items():
        mount = machine.resolved_mounts[sensor.mount]
        if sensor.kind == "gnss" and mount.body == reference.body:
            found[name] = np.subtract(mount.xyz_m, reference.xyz_m)
    return found


def _magnetic(config: MagneticsConfig, terrain: Terrain, *, ended_t_s: float) -> MagneticPieces:
    """Magnets and iron; the share of magnets that come and go is looked up every 20th of a second."""
    come_and_go = any(magnet.from_s > 0.0 or magnet.to_s is not None for magnet in config.magnets)
    times = np.arange(0.0, ended_t_s, _SHARE_S) if come_and_go else np.zeros(1)
    moments: list[tuple[float, ...]] = [magnet.moment_a_m2 for magnet in config.magnets]
    iron = _on_ground(config.iron, terrain)
    moments += [_moment(config, piece, place, terrain) for piece, place in zip(config.iron, iron, strict=True)]
    return MagneticPieces(
        magnets=_on_ground(config.magnets, terrain),
        iron=iron,
        moments_a_m2=np.array(moments, dtype=np.float64).reshape(-1, 3),
        share_t_ns=np.round(times * NS_PER_S).astype(np.int64),
        shares=np.array([[magnet.share(t_s) for magnet in config.magnets] for t_s in times.tolist()]),
        earth_ut=config.strength_ut,
    )


def _moment(config: MagneticsConfig, iron: IronConfig, place: FloatArray, terrain: Terrain) -> tuple[float, ...]:
    """What the earth induces in a piece of iron, A m^2, told from the field eastwards of it.

    There, at r, the field of a dipole m is mu_0 / (4 pi r^3) (2 m_e, -m_n, -m_u).
    """
    away_m = 2.0 * iron.radius_m
    alone = Magnetics(config.model_copy(update={"magnets": (), "iron": (iron,)}), terrain)
    field_ut = alone.field_ut(place[:3] + np.array([away_m, 0.0, 0.0]), 0.0) - config.earth_field.enu_ut
    moment: FloatArray = away_m**3 / MU0_4PI_UT * field_ut * (0.5, -1.0, -1.0)
    return tuple(moment.tolist())


def _on_ground(pieces: Sequence[MagnetConfig | IronConfig], terrain: Terrain) -> FloatArray:
    """East, north, up and radius of pieces, (K, 4)."""
    places = [(p.east_m, p.north_m, terrain.height(p.east_m, p.north_m) + p.height_m, p.radius_m) for p in pieces]
    return np.array(places, dtype=np.float64).reshape(-1, 4)


def _scanners(scenario: Scenario) -> dict[str, Scanner]:
    """The lidars; one on another link than the root, or turned, is left out."""
    root = read_urdf(scenario.machine.asset).links[0].name
    found: dict[str, Scanner] = {}
    for name, sensor in scenario.sensors.items():
        if not isinstance(sensor, LidarConfig):
            continue
        mount = scenario.machine.resolved_mounts[sensor.mount]
        if mount.body == root and not any(mount.rpy_rad):
            found[name] = Scanner(xyz_m=mount.xyz_m, range_m=(sensor.min_range_m, sensor.max_range_m))
    return found
