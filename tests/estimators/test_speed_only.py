from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.planter import STEP_NS, gnss, make_setup, radar, sensors
from twin.errors import BadInputError
from twin.estimators import GnssSpeedOnlyConfig, RadarOnlyConfig, build_estimator

CONFIG = RadarOnlyConfig(kind="radar_only", sensors=("radar",))


def make(runs: int = 1):
    return build_estimator(CONFIG, make_setup({"radar": sensors()["radar"]}, runs=runs))


def test_every_row_gets_the_radars_speed_and_no_sigma() -> None:
    estimator = make(2)
    assert np.array_equal(estimator.estimate(0).values, np.zeros((2, 9)))
    estimator.process(radar(STEP_NS, [2.5, 2.4]))
    estimate = estimator.estimate(STEP_NS)
    assert estimator.columns == ("speed_m_s", *(f"row_speed_{row}_m_s" for row in range(1, 9)))
    np.testing.assert_array_equal(estimate.values, np.repeat([[2.5], [2.4]], 9, axis=1))
    assert np.isnan(estimate.sigmas).all()
    assert estimate.covariance is None


def test_it_holds_through_losses_nan_and_late_samples_per_member() -> None:
    estimator = make(3)
    estimator.process(radar(2 * STEP_NS, [1.0, 1.0, 1.0]))
    estimator.process(radar(3 * STEP_NS, [2.0, np.nan, 2.0], valid=[True, True, False]))
    estimator.process(radar(1 * STEP_NS, [9.0, 9.0, 9.0], t_available_ns=4 * STEP_NS))
    estimator.process(radar(3 * STEP_NS, [8.0, 8.0, 8.0], t_available_ns=4 * STEP_NS))
    np.testing.assert_array_equal(estimator.estimate(4 * STEP_NS).values[:, 0], [2.0, 1.0, 1.0])


def test_standing_is_zero() -> None:
    estimator = make()
    estimator.process(radar(STEP_NS, 1.0))
    estimator.process(radar(2 * STEP_NS, 0.0))
    assert not estimator.estimate(2 * STEP_NS).values.any()


@pytest.mark.parametrize(("infos", "message"), [({}, "exactly one radar"), (sensors(), "'imu_1' is of kind 'imu'")])
def test_it_wants_one_radar(infos, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        build_estimator(CONFIG, make_setup(infos))


def test_a_receivers_speed_serves_the_same_way() -> None:
    config = GnssSpeedOnlyConfig(kind="gnss_speed_only", sensors=("gnss",))
    estimator = build_estimator(config, make_setup({"gnss": sensors(gnss=True)["gnss"]}, runs=2))
    estimator.process(gnss(5 * STEP_NS, 7.0, 8.0, [2.5, 2.4], t_available_ns=9 * STEP_NS))
    np.testing.assert_array_equal(estimator.estimate(9 * STEP_NS).values, np.repeat([[2.5], [2.4]], 9, axis=1))


def test_each_kind_refuses_the_others_sensor() -> None:
    config = GnssSpeedOnlyConfig(kind="gnss_speed_only", sensors=("radar",))
    with pytest.raises(BadInputError, match="'radar' is of kind 'radar'; gnss_speed_only can use gnss"):
        build_estimator(config, make_setup({"radar": sensors()["radar"]}))
