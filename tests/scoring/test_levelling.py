"""What is told of a levelled field and of the blade, from truth columns made up by hand."""

import math

import numpy as np
import pytest

from tests.small_scenario import small_scenario
from twin.recording import Stream
from twin.scenario import Scenario, resolve
from twin.scoring.motion import motion_metrics, motion_names


def _scenario(**changes: object) -> Scenario:
    return resolve(small_scenario(duration_s=10.0, scoring={"from_s": 2.0}, **changes), where="test")


def _truth() -> Stream:
    """10 s; the machine drives east at 1 m/s from 3 s on, and the blade is 20 mm high until east 2 m, then 5 mm low."""
    t_s = np.arange(0, 10, 0.02)
    driving = np.clip(t_s - 3.0, 0.0, None)
    done = t_s / t_s[-1]
    columns = {
        "position_e_m": driving,
        "position_n_m": np.zeros_like(t_s),
        "speed_m_s": np.where(t_s > 3.0, 1.0, 0.0),
        "height_m": np.where(t_s <= 3.0, 0.3, np.where(driving < 2.0, 0.020, -0.005)),
        "field_sd_m": np.floor(5 * done) * -0.005 + 0.045,
        "field_mean_m": 0.012 - 0.027 * done,
        "field_within_30mm": 0.5 + 0.4 * done,
        "field_within_50mm": 0.7 + 0.3 * done,
        "soil_cut_m3": 0.5 + 4.0 * done,
        "soil_spilled_m3": 0.2 * done,
    }
    values = np.stack(list(columns.values()), axis=-1)[:, np.newaxis]
    return Stream(columns=tuple(columns), t_ns=np.round(t_s * 1e9).astype(np.int64), values=values)


def test_the_field_is_told_before_and_after_and_what_was_moved() -> None:
    found = {name: float(value[0]) for name, value in motion_metrics(_truth(), _scenario()).items()}
    assert list(found) == motion_names(_scenario(), _truth().columns)
    prefix = "truth.levelling."
    assert found[prefix + "flatness_before_mm"] == pytest.approx(45.0)
    assert found[prefix + "flatness_after_mm"] == pytest.approx(20.0)
    assert found[prefix + "mean_height_before_mm"] == pytest.approx(12.0)
    assert found[prefix + "mean_height_after_mm"] == pytest.approx(-15.0)
    assert found[prefix + "within_30mm_before_percent"] == pytest.approx(50.0)
    assert found[prefix + "within_30mm_after_percent"] == pytest.approx(90.0)
    assert found[prefix + "within_50mm_after_percent"] == pytest.approx(100.0)
    assert found[prefix + "volume_moved_m3"] == pytest.approx(4.0)
    assert found[prefix + "volume_spilled_m3"] == pytest.approx(0.2)
    # 2 s of 20 mm and 5 s of -5 mm while it moves.
    assert found[prefix + "blade_rmse_mm"] == pytest.approx(math.sqrt((2 * 400 + 5 * 25) / 7), rel=0.01)


def test_the_blade_counts_over_the_area_that_counts() -> None:
    name = "truth.levelling.blade_rmse_mm"
    inside = _scenario(levelling={"area_m": [2.0, -1.0, 50.0, 1.0]})
    assert motion_metrics(_truth(), inside)[name] == pytest.approx(5.0)
    beside = _scenario(levelling={"area_m": [2.0, 1.0, 50.0, 3.0]})
    assert math.isnan(motion_metrics(_truth(), beside)[name][0])


def test_a_machine_that_levels_nothing_has_no_such_metric() -> None:
    truth = _truth()
    kept = Stream(columns=truth.columns[:4], t_ns=truth.t_ns, values=truth.values[:, :, :4])
    assert motion_metrics(kept, _scenario()) == {}
    assert motion_names(_scenario(), kept.columns) == []
