"""Builds the scene of a recording from its own scenario."""

from __future__ import annotations

import numpy as np

from twin.control.driver import Driver
from twin.recording import Recording
from twin.scenario import loads
from twin.world.terrain import build_terrain, wanted_extent
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
    machine = scenario.machine
    driver = Driver(
        scenario.driver,
        start_e_n_heading=machine.vehicle_start,
        wheelbase_m=machine.wheelbase_m,
        seed=recording.seed,
    )
    path = driver.path.polyline(_PATH_STEP_M if not machine.turns_on_the_spot else 0.1 * _PATH_STEP_M)
    terrain = recording.terrain
    if terrain is None:
        extent = wanted_extent(np.vstack([path, machine.vehicle_start[:2]]), machine.reach_m)
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
        segment_labels=driver.segment_names,
    )
