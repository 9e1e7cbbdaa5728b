"""A small scenario that tests change: a flat field, a short straight, the sensors and estimators of the planter."""

from typing import Any

import tomli_w

from twin.scenario import merge, resolve

IMUS = {f"imu_{row}": {"preset": "imu_row_unit", "mount": f"row_{row}"} for row in (1, 4, 5, 8)}

SMALL: dict[str, Any] = {
    "title": "A short straight on flat ground",
    "duration_s": 4.0,
    "terrain": {"kind": "flat"},
    "soil": {"preset": "firm"},
    "machine": {"kind": "planter_f8"},
    "driver": {"speed_m_s": 2.0, "path": [{"stop_s": 1.0}, {"straight_m": 20.0}]},
    "sensors": {
        **IMUS,
        "radar": {"preset": "radar_99ppm", "mount": "radar"},
        "gnss": {"preset": "rtk_f9p", "mount": "antenna"},
    },
    "estimators": {
        "radar_only": {"kind": "radar_only", "sensors": ["radar"]},
        "central": {"kind": "row_speed_ekf", "sensors": [*IMUS, "radar"], "calibration_s": 1.0},
    },
}


def small_scenario(**changes: Any) -> dict[str, Any]:
    """The small scenario as a table, with changes merged in."""
    return merge(SMALL, changes)


def small_scenario_toml(**changes: Any) -> str:
    """The small scenario as the text of a scenario file."""
    table = small_scenario(**changes)
    resolve(table, where="small scenario")
    return tomli_w.dumps(table)
