"""The bound on the pass-to-pass error of a scenario: of its course, its sensors, and where there is none."""

import math
from typing import Any

import numpy as np
import pytest

from tests.small_scenario import small_scenario
from twin.control.path_following import PathDriverConfig
from twin.errors import BadInputError
from twin.scenario import Scenario, resolve
from twin.scoring.guidance_bound import GuidanceErrors, PassPlan, between_passes, guidance_bound
from twin.scoring.pass_bound import NAME, Course, errors_of, metrics, names, scenario_bound_m

HALF_CIRCLES = [
    {"stop_s": 5.0},
    {"passes": 3, "length_m": 50.0, "width_m": 4.0, "turn_radius_m": 2.0},
]
PLAN = PassPlan(length_m=50.0, spacing_m=4.0, speed_m_s=1.1)
ERRORS = GuidanceErrors(
    slow_m=2.0, slow_s=1000.0, velocity_m_s=0.1, gyro_rad_rts=6e-4, gyro_bias_rad_s=0.005, forward_m=1.4
)
SENSORS = {
    "gps": {"preset": "lea_5s", "mount": "gps"},
    "gyro": {"preset": "gyro_gx1", "mount": "gyro"},
    "encoders": {"preset": "encoders_e6b2", "mount": "axle"},
}


def _course(path: list[dict[str, Any]], heading_rad: float = 0.0) -> Course:
    config = PathDriverConfig.model_validate({"path": path, "speed_m_s": 1.1})
    return Course(config, (3.0, -2.0, heading_rad))


def _scenario(path: list[dict[str, Any]] = HALF_CIRCLES, **changes: Any) -> Scenario:
    table = small_scenario(
        machine={"kind": "transplanter"},
        duration_s=200.0,
        driver={"path": path, "speed_m_s": 1.1},
        scoring={"pass_to_pass_bound_of": "ours"},
    )
    table["sensors"] = SENSORS
    table["estimators"] = {"ours": {"kind": "guidance_filter", "sensors": [*SENSORS]}}
    for key, value in changes.items():
        table[key] = value
    return resolve(table, where="test")


@pytest.mark.parametrize("heading_rad", [0.0, 2.0])
def test_a_course_of_half_circles_is_the_plan_of_the_bound(heading_rad: float) -> None:
    course = _course(HALF_CIRCLES, heading_rad)
    for t_s in (2.0, 20.0, 52.0, 60.0, 104.0, 120.0):
        (speed, heading, rate), planned = course.motion(t_s), PLAN.motion(t_s)
        assert (speed, rate) == pytest.approx((planned[0], planned[2]))
        assert math.remainder(heading - planned[1], 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    stations = 50.0 * np.linspace(0.05, 0.95, 5)
    expected = [PLAN.time_s(number, stations) for number in range(3)]
    np.testing.assert_allclose(course.times_s(5), expected)


def test_all_pairs_are_told_at_once() -> None:
    """Each as by the bound of that pair alone."""
    stations = np.linspace(0.2, 0.95, 4) * 50.0
    times = np.stack([PLAN.time_s(number, stations) for number in range(3)])
    all_pairs = between_passes(ERRORS, PLAN.motion, times)
    for pair in ((0, 1), (1, 2), (0, 2)):
        plan = PassPlan(length_m=50.0, spacing_m=4.0, speed_m_s=1.1, pair=pair)
        np.testing.assert_allclose(all_pairs[pair], guidance_bound(ERRORS, plan, stations=4).sigma_m)
    assert np.isnan(all_pairs[1, 0]).all()


def test_a_noisier_gyro_tells_less_and_nothing_is_told_without_receiver_or_wheels() -> None:
    scenario = _scenario()
    worse = dict(SENSORS, gyro=SENSORS["gyro"] | {"noise_density_rad_s_rthz": 0.02})
    bound = scenario_bound_m(scenario, [*SENSORS])
    noisy = scenario_bound_m(_scenario(sensors=worse), [*SENSORS])
    assert bound is not None
    assert noisy is not None
    # Never better than with the better gyro, and never worse than two independent fixes of 2.12 m a side.
    assert 0.0 < bound < noisy < 2.12 * math.sqrt(2.0)
    assert scenario_bound_m(scenario, ["gyro", "encoders"]) is None
    assert scenario_bound_m(scenario, ["gps", "gyro"]) is None


def test_errors_are_those_of_the_sensors() -> None:
    found = errors_of(_scenario(), [*SENSORS], speed_m_s=1.1)
    assert found is not None
    assert (found.slow_m, found.slow_s, found.jump_m, found.jump_s) == (1.96, 1600.0, 0.8, 120.0)
    assert (found.velocity_m_s, found.rate_hz, found.forward_m) == (0.1, 1.0, 1.4)
    # A one-sided density N is N / sqrt(2) of angle random walk, whatever the rate.
    assert found.gyro_rad_rts == pytest.approx(8.72665e-4 / math.sqrt(2.0))
    assert (found.gyro_bias_rad_s, found.gyro_scale_ratio) == (5.236e-3, 0.01)


def test_the_metric_is_told_where_it_is_asked_for() -> None:
    scenario = _scenario()
    assert names(scenario) == [NAME]
    assert metrics(scenario)[NAME][0] == scenario_bound_m(scenario, [*SENSORS])
    single_pass = _scenario([{"straight_m": 20.0}])
    assert np.isnan(metrics(single_pass)[NAME][0])
    plain = _scenario(scoring={})
    assert names(plain) == []
    assert metrics(plain) == {}


def test_who_has_no_estimator_of_that_name_is_told() -> None:
    with pytest.raises(BadInputError, match=r"pass_to_pass_bound_of: unknown estimator 'hours'; did you mean 'ours'"):
        _scenario(scoring={"pass_to_pass_bound_of": "hours"})


def test_a_course_that_spins_or_has_one_pass_has_no_bound() -> None:
    with pytest.raises(ValueError, match="two parallel passes"):
        _course([{"straight_m": 20.0}])
    with pytest.raises(ValueError, match="two parallel passes"):
        _course([*HALF_CIRCLES, {"spin_deg": 90.0}])
    with pytest.raises(ValueError, match="nowhere beside"):
        _course([{"straight_m": 10.0}, {"straight_m": 5.0, "raised": True}, {"straight_m": 10.0}]).times_s()
