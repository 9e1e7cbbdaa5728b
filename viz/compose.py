"""Builds the scene of a recording from its own scenario."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.control import build_driver
from twin.recording import Recording
from twin.scenario import Scenario, loads
from twin.signals import FloatArray
from twin.world.magnetics import IronConfig, MagnetConfig
from twin.world.orchard import planted
from twin.world.signs import put_up
from twin.world.terrain import Terrain, build_terrain, wanted_extent
from twin.world.urdf import read_urdf
from viz.scene import Scene

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
        posts = np.array([(sign.east_m, sign.north_m) for sign in scenario.signs]).reshape(-1, 2)
        places = np.vstack([path, machine.vehicle_start[:2], trunks[:, :2], posts])
        extent = wanted_extent(places, machine.reach_m)
        terrain = build_terrain(scenario.terrain, seed=recording.seed, extent=extent)
    return Scene(
        urdf=machine.asset,
        heights=terrain.heights,
        origin_m=(terrain.west_m, terrain.south_m),
        cell_m=terrain.cell_m,
        planned_path=path,
        row_count=len(machine.rows_y_m),
        footprint_m=machine.footprint_m,
        paved=scenario.soil.preset == "asphalt",
        trunks=planted(trunks, terrain),
        signs=put_up(scenario.signs, terrain),
        magnets=_on_ground(scenario.magnetics.magnets, terrain),
        iron=_on_ground(scenario.magnetics.iron, terrain),
        scanners=_scanners(scenario),
        hidden=frozenset(set(scenario.estimators) - set(drawn)) if drawn else frozenset(),
        segment_labels=driver.segment_names,
    )


def _on_ground(pieces: Sequence[MagnetConfig | IronConfig], terrain: Terrain) -> FloatArray:
    """East, north, up and radius of pieces, (K, 4)."""
    places = [(p.east_m, p.north_m, terrain.height(p.east_m, p.north_m) + p.height_m, p.radius_m) for p in pieces]
    return np.array(places, dtype=np.float64).reshape(-1, 4)


def _scanners(scenario: Scenario) -> dict[str, tuple[float, float, float]]:
    """Where the lidars sit; one on another link than the root, or turned, is left out."""
    root = read_urdf(scenario.machine.asset).links[0].name
    mounts = {
        name: scenario.machine.resolved_mounts[sensor.mount]
        for name, sensor in scenario.sensors.items()
        if sensor.kind == "lidar"
    }
    return {name: mount.xyz_m for name, mount in mounts.items() if mount.body == root and not any(mount.rpy_rad)}
