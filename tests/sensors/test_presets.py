"""Every preset validates, runs, and says where each of its numbers is from."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import constant, drive, preset, sensor
from twin import paths
from twin.errors import BadInputError
from twin.sensors.presets import load_preset

NAMES = sorted(path.stem for path in paths.PRESETS.glob("*.toml"))


def dotted(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from dotted(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def test_the_presets_that_scenarios_name_exist() -> None:
    wanted = {"radar_99ppm", "rtk_f9p", "single_point", "imu_row_unit", "imu_mpu6050", "imu_mti300"}
    wanted |= {"imu_bno085", "mag_qmc5883l", "mag_qmc5883l_8g", "mag_hmc5883l", "wheel_encoders_lm393"}
    wanted |= {"rtk_survey", "rtk_f9p_dual", "rtk_chcnav_i70", "rtk_navcom_sf3050", "lea_5s"}
    wanted |= {"trurover", "gx1230", "gx1230_raw", "dgps", "gyro_gx1", "potentiometer_n35", "encoders_e6b2"}
    assert wanted <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_value_has_a_source_and_every_source_a_value(name: str) -> None:
    table = tomllib.loads((paths.PRESETS / f"{name}.toml").read_text())
    sources = table.pop("sources")
    keys = {key for key, value in dotted(table) if key != "kind"}
    assert keys == set(sources)
    assert all(isinstance(text, str) and len(text) > 5 for text in sources.values())


@pytest.mark.parametrize("name", NAMES)
def test_preset_validates_and_its_sensor_measures(name: str) -> None:
    device = sensor(preset(name), runs=range(3))
    log = drive(device, constant(2.0), 2.0)
    sample = log.measurements[-1]
    assert sample.values.shape == (3, len(device.columns))
    assert log.samples[-1].hidden.shape == (3, len(device.hidden_columns))
    known = [column for column in device.columns if column != "age_s"]
    assert all(np.isfinite(sample.column(column)).all() for column in known)
    assert all(math.isfinite(value) for value in device.info.datasheet.values())
    assert device.info.columns == device.columns
    assert device.need.mount is device.mount


@pytest.mark.parametrize(
    ("name", "message"), [("rtk_f9", "did you mean 'rtk_f9p'"), ("../rtk_f9p", "expected a plain name")]
)
def test_a_preset_that_does_not_exist_is_refused(name: str, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        load_preset(name)
