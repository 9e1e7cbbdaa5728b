"""Families of scenarios: one base file, small differences."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from tests.small_scenario import small_scenario
from twin.errors import BadInputError
from twin.scenario import json_schema, load, resolve
from twin.scenario.files import _read_extended

FIRST = {"metric": "central.row_speed.mean_abs_error_m_s", "max": 1.0}
SECOND = {"metric": "radar_only.row_speed.mean_abs_error_m_s", "max": 2.0}
THIRD = {"metric": "central.position.rmse_m", "max": 3.0}


def _write(folder: Path, name: str, table: dict[str, Any]) -> Path:
    path = folder / f"{name}.toml"
    path.write_text(tomli_w.dumps(table))
    return path


def _base(folder: Path) -> None:
    _write(folder, "_base", small_scenario(checks=[FIRST, SECOND], driver={"speed_m_s": 2.0}))


def _checked(path: Path) -> list[str]:
    return [check.metric for check in load(path).scenario.checks]


def test_a_chain_of_three_keeps_what_nobody_changed(tmp_path: Path) -> None:
    _base(tmp_path)
    middle = {"extends": "_base", "title": "middle", "driver": {"speed_m_s": 3.0, "preview_s": 0.4}}
    _write(tmp_path, "_middle", middle)
    last = {"extends": "_middle", "driver": {"speed_m_s": 4.0}, "sensors": {"radar": {"rate_hz": 10.0}}}
    scenario = load(_write(tmp_path, "last", last)).scenario
    assert scenario.title == "middle"
    assert scenario.driver.speed_m_s == 4.0
    assert scenario.driver.preview_s == 0.4
    assert scenario.duration_s == 4.0
    assert scenario.sensors["radar"].rate_hz == 10.0
    assert scenario.sensors["radar"].mount == "radar"


def test_keys_of_another_kind_are_not_inherited(tmp_path: Path) -> None:
    """Neither terrain nor driver has the keys of the kind that the base has; what stays of one kind is merged."""
    rough = {"kind": "rough", "psd_m3": 1e-5, "psd_slope": 2.0}
    _write(tmp_path, "_base", small_scenario(checks=[], terrain=rough, driver={"speed_m_s": 2.0}))
    bench = {"machine": {"kind": "rail_bench"}, "driver": {"kind": "reciprocation", "stand_s": 1.0}}
    alone = {"sensors": {}, "estimators": {}}
    changed = _read_extended(_write(tmp_path, "bench", {"extends": "_base", "terrain": {"kind": "flat"}, **bench}))
    scenario = resolve({**changed, **alone}, where="bench")
    assert scenario.driver.stand_s == 1.0
    assert scenario.terrain.kind == "flat"
    kept = {"extends": "_base", "terrain": {"psd_slope": 1.5}, "driver": {"kind": "path", "preview_s": 0.4}}
    scenario = load(_write(tmp_path, "kept", kept)).scenario
    assert (scenario.terrain.psd_m3, scenario.terrain.psd_slope) == (1e-5, 1.5)
    assert scenario.driver.speed_m_s == 2.0


def test_an_array_is_replaced_as_a_whole(tmp_path: Path) -> None:
    _base(tmp_path)
    path = _write(tmp_path, "child", {"extends": "_base", "driver": {"path": [{"straight_m": 5.0}]}, "checks": [THIRD]})
    scenario = load(path).scenario
    assert [segment.straight_m for segment in scenario.driver.path] == [5.0]
    assert scenario.driver.speed_m_s == 2.0
    assert [check.metric for check in scenario.checks] == [THIRD["metric"]]


def test_extra_checks_come_behind_the_inherited_ones(tmp_path: Path) -> None:
    _base(tmp_path)
    _write(tmp_path, "_middle", {"extends": "_base", "checks": [FIRST], "extra_checks": [SECOND]})
    path = _write(tmp_path, "last", {"extends": "_middle", "extra_checks": [THIRD]})
    assert _checked(path) == [FIRST["metric"], SECOND["metric"], THIRD["metric"]]
    # A later file's own checks replace all of them.
    assert _checked(_write(tmp_path, "other", {"extends": "_middle", "checks": [THIRD]})) == [THIRD["metric"]]
    # Where nothing is inherited they are the checks.
    alone = _write(tmp_path, "alone", {**small_scenario(), "extra_checks": [THIRD]})
    assert _checked(alone) == [THIRD["metric"]]


@pytest.mark.parametrize("wrong", [{"metric": "a", "max": 1.0}, 3, "checks"])
def test_extra_checks_that_are_no_array_are_refused(wrong: object, tmp_path: Path) -> None:
    path = _write(tmp_path, "alone", {**small_scenario(), "extra_checks": wrong})
    with pytest.raises(BadInputError, match=r"alone\.toml: extra_checks: expected an array"):
        load(path)


def test_a_wrong_extra_check_is_named_by_its_place_among_all(tmp_path: Path) -> None:
    _base(tmp_path)
    path = _write(tmp_path, "child", {"extends": "_base", "extra_checks": [{"metric": "a", "maximum": 1.0}]})
    with pytest.raises(BadInputError, match=r"checks\.2\.maximum: unknown key"):
        load(path)


def test_a_circle_is_refused(tmp_path: Path) -> None:
    _write(tmp_path, "one", {"extends": "other"})
    path = _write(tmp_path, "other", {"extends": "one"})
    with pytest.raises(BadInputError, match=r"one.toml: extends: 'other' extends itself \(other -> one -> other\)"):
        load(path)
    path = _write(tmp_path, "alone", {"extends": "alone"})
    with pytest.raises(BadInputError, match=r"alone.toml: extends: 'alone' extends itself \(alone -> alone\)"):
        load(path)


def test_only_so_many_files_deep(tmp_path: Path) -> None:
    _base(tmp_path)
    for depth in range(6):
        _write(tmp_path, f"file_{depth}", {"extends": f"file_{depth - 1}" if depth else "_base"})
    load(tmp_path / "file_4.toml")
    with pytest.raises(BadInputError, match="extends: more than 5 files deep"):
        load(tmp_path / "file_5.toml")


def test_a_misspelt_base_is_told_the_nearest(tmp_path: Path) -> None:
    _base(tmp_path)
    path = _write(tmp_path, "child", {"extends": "bse"})
    with pytest.raises(BadInputError, match=r"there is no bse.toml beside it; did you mean '_base'\?"):
        load(path)


def test_a_new_sensor_that_does_not_fit_may_be_another_that_is_misspelt(tmp_path: Path) -> None:
    path = _write(tmp_path, "alone", small_scenario())
    settings = [("sensors.gns.preset", "rtk_survey"), ("sensors.gns.rate_hz", 5.0)]
    told = (
        r"sensors\.gns\.mount: missing.*\n"
        r"--set sensors\.gns\.preset: unknown sensor 'gns'; did you mean 'gnss'\? "
        r"\(there are gnss, .*radar\): it would be a new one$"
    )
    with pytest.raises(BadInputError, match=told):
        load(path, settings=settings)
    # One that fits is a new sensor, and no mistake elsewhere is blamed on it.
    settings.append(("sensors.gns.mount", "antenna"))
    assert "gns" in load(path, settings=settings).scenario.sensors
    with pytest.raises(BadInputError, match=r"duration_s: given -1\.0: [^\n]*$"):
        load(path, settings=[*settings, ("duration_s", -1.0)])


def test_the_schema_allows_what_a_family_needs() -> None:
    properties = json_schema()["properties"]
    assert properties["extra_checks"]["items"] == properties["checks"]["items"]
    assert {"extends", "repetitions", "bus"} <= properties.keys()
