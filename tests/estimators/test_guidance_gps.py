"""The receiver's own word, held; and what all guidance filters read and tell."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.guidance import SLOT_M, fix, make_setup, measure
from twin.errors import BadInputError
from twin.estimators.guidance_base import GuidanceOutput
from twin.estimators.guidance_gps import GuidanceGps, GuidanceGpsConfig
from twin.estimators.guidance_readers import EncoderReader, FixReader, ImuRateReader
from twin.signals import NS_PER_S, EstimatorSetup, Mount, SensorInfo


def make(setup: EstimatorSetup | None = None, **options: object) -> GuidanceGps:
    config = GuidanceGpsConfig.model_validate({"kind": "guidance_gps", "sensors": ("gnss",), **options})
    return GuidanceGps(config, setup or make_setup("gnss"))


def told(guide: GuidanceGps, t_s: float = 100.0) -> np.ndarray:
    return guide.estimate(round(t_s * NS_PER_S)).values[0, :4]


def test_position_is_that_of_the_reference_by_the_course() -> None:
    """Northwards, an antenna 1.5 m ahead and 0.1 m to the left is 1.5 m north and 0.1 m west of the axle."""
    guide = make()
    guide.process(fix(1.0, 10.0, 20.0, speed=1.0, course=np.pi / 2))
    np.testing.assert_allclose(told(guide), [10.1, 18.5, np.pi / 2, 1.0])
    estimate = guide.estimate(2 * NS_PER_S)
    np.testing.assert_allclose(estimate.sigmas[0, :2], 2.5)
    np.testing.assert_allclose(estimate.covariance, [np.eye(2) * 2.5**2])


def test_course_is_not_taken_when_slow() -> None:
    guide = make(make_setup("gnss", start=(0.0, 0.0, 0.5)))
    guide.process(fix(1.0, 0.0, 0.0, speed=0.19, course=3.0))
    assert told(guide)[2] == pytest.approx(0.5)
    guide.process(fix(2.0, 0.0, 0.0, speed=0.21, course=3.0))
    assert told(guide)[2] == pytest.approx(3.0)


def test_it_holds_until_a_newer_fix_comes() -> None:
    guide = make(make_setup("gnss", runs=2, arm=(0.0, 0.0, 2.0)))
    guide.process(fix(2.0, [1.0, 2.0], [3.0, 4.0], speed=1.0, course=0.0))
    guide.process(fix(1.0, 9.0, 9.0, speed=[1.0, 1.0], course=0.0))  # out of order
    guide.process(fix(3.0, [5.0, 6.0], [np.nan, 7.0], speed=1.0, course=0.0, quality=[1.0, 0.0]))
    np.testing.assert_allclose(guide.estimate(9).values[:, :2], [[1.0, 3.0], [2.0, 4.0]])
    guide.process(fix(4.0, [5.0, 6.0], [7.0, 8.0], speed=1.0, course=0.0, valid=[True, False]))
    np.testing.assert_allclose(guide.estimate(9).values[:, :2], [[5.0, 7.0], [2.0, 4.0]])


def test_bare_positions_have_the_motion_of_their_way() -> None:
    """GGA alone tells neither speed nor course: 3 m east and 4 m north in 2 s are 2.5 m/s."""
    guide = make(make_setup("gnss", start=(0.0, 0.0, np.nan), arm=(0.0, 0.0, 2.0)))
    guide.process(fix(1.0, 0.0, 0.0))
    assert np.isnan(told(guide)[2:]).all()
    guide.process(fix(3.0, 3.0, 4.0))
    np.testing.assert_allclose(told(guide)[2:], [np.arctan2(4.0, 3.0), 2.5])


def test_a_receiver_that_reports_zero_knows_no_sigma() -> None:
    reader = FixReader(make_setup("gnss").sensors["gnss"], make_setup("gnss"))
    np.testing.assert_array_equal(reader.read(fix(1.0, 0.0, 0.0, sigma=0.0)).sigma, [[np.nan, np.nan]])


def test_ways_go_on_through_lost_counts() -> None:
    """A member that lost a count gets the whole way with its next one."""
    setup = make_setup("wheel_encoders", runs=2)
    reader = EncoderReader(setup.sensors["wheel_encoders"], setup, wheel_radius_m=0.4635)
    assert not reader.read(measure("wheel_encoders", 1.0, [[0.0, 0.0]] * 2)).there.any()
    second = reader.read(measure("wheel_encoders", 1.5, [[10.0, 20.0]] * 2, valid=[True, False]))
    np.testing.assert_array_equal(second.there, [True, False])
    assert second.value[0] == pytest.approx(15.0 * SLOT_M / 0.5)
    third = reader.read(measure("wheel_encoders", 2.0, [[30.0, 40.0]] * 2))
    np.testing.assert_allclose(third.value, [20.0 * SLOT_M / 0.5, 35.0 * SLOT_M / 1.0])


def test_an_inertial_unit_may_be_mounted_upside_down() -> None:
    setup = make_setup("imu")
    info = setup.sensors["imu"]
    turned = SensorInfo(
        name="imu",
        kind="imu",
        columns=info.columns,
        mount=Mount(body="base", xyz_m=(0.0, 0.0, 0.0), rpy_rad=(np.pi, 0.0, 0.0)),
        rate_hz=10.0,
    )
    rate = ImuRateReader(turned, setup).read(measure("imu", 1.0, [0.0, 0.0, -9.8, 0.0, 0.0, 0.3]))
    np.testing.assert_allclose(rate.value, [-0.3])


def test_innovations_are_told_once() -> None:
    output = GuidanceOutput(2, nis=("nis_speed",))
    output.news.put_position(np.ones((2, 2)), np.full(2, 3.0), np.array([True, False]))
    first, second = (output.estimate(1, np.zeros((2, 4)), None) for _ in range(2))
    place = output.columns.index("nis_position")
    np.testing.assert_array_equal(first.values[:, place], [3.0, np.nan])
    assert np.isnan(second.values[:, 4:]).all()


@pytest.mark.parametrize(
    ("setup", "message"),
    [
        (make_setup(), "exactly one sensor of kind 'gnss'"),
        (make_setup("gnss", "imu"), "is of kind 'imu'"),
    ],
)
def test_other_sensors_are_refused(setup: EstimatorSetup, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        make(setup)
