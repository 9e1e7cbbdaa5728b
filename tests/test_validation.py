"""Sentences about what is wrong in a file: in the words of the file, each mistake once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.estimators.planter import make_setup, sensors
from tests.small_scenario import small_scenario_toml
from twin.errors import BadInputError
from twin.execution import open_members
from twin.formats.csv_mapping import read_mapping
from twin.logreplay import choose
from twin.scenario import find, load, parse_setting


def told(*settings: str) -> str:
    with pytest.raises(BadInputError) as error:
        load(find("planter_turns")[0], settings=[parse_setting(text) for text in settings])
    return str(error.value).partition("planter_turns.toml: ")[2]


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("estimators.central.sensors=gnss", "estimators.central.sensors: given 'gnss': input should be a list"),
        ("estimators.central=3", "estimators.central: given 3: input should be a table"),
        ("estimators=3", "estimators: given 3: input should be a table"),
        ("estimators.central.noise=3", "estimators.central.noise: given 3: input should be a table"),
        ("driver.path=[]", "driver.path: given []: list should have at least 1 item, not 0"),
        ("driver.path=[3]", "driver.path.0: given 3: input should be a table"),
    ],
)
def test_types_are_told_in_the_words_of_the_file(setting: str, sentence: str) -> None:
    assert told(setting) == sentence


def test_a_wrong_table_of_a_mapping_is_told_once(tmp_path: Path) -> None:
    path = tmp_path / "mapping.toml"
    path.write_text(
        '[[tables]]\nkind = "gnss"\n[tables.time]\ncolumn = "t"\n[tables.columns]\nlatitude_deg = {column = "lat"}\n'
        'longitude_deg = {column = "lon"}\nspeed_m_s = {column = "v", unit = "feet"}\n'
    )
    with pytest.raises(BadInputError) as error:
        read_mapping(path)
    assert str(error.value) == (f"{path}: tables.0: columns.speed_m_s: unit = 'feet'; allowed: m/s, km/h, kn, mph")
    path.write_text("tables = []\n")
    with pytest.raises(BadInputError, match=r"tables: given \[\]: list should have at least 1 item, not 0"):
        read_mapping(path)


def test_an_estimator_that_cannot_work_is_named_once(tmp_path: Path) -> None:
    toml = small_scenario_toml(estimators={"radar_only": {"sensors": ["gnss"]}})
    path = tmp_path / "small.toml"
    path.write_text(toml)
    with pytest.raises(BadInputError) as error:
        open_members(load(path), runs=(0,))
    assert str(error.value).startswith(f"{path}: [estimators.radar_only] sensors")
    assert str(error.value).count("estimators.radar_only") == 1


def test_an_estimator_that_cannot_work_with_a_log_is_named_once() -> None:
    (choice,) = choose(["radar_only"])
    with pytest.raises(BadInputError) as error:
        choice.build(make_setup(sensors(radar=False, gnss=True)))
    assert str(error.value).startswith("[estimators.radar_only] sensors")
    assert str(error.value).count("estimators.radar_only") == 1
