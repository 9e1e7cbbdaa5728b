"""The height of GNSS, held."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.bench import DESIGN_M, GNSS_COLUMNS, STEP_NS, gnss, make_setup
from twin.errors import BadInputError
from twin.estimators.height_hold import HeightHold, HeightHoldConfig
from twin.signals import EstimatorSetup, Mount, SensorInfo


def make(setup: EstimatorSetup | None = None, **options: object) -> HeightHold:
    config = HeightHoldConfig.model_validate({"kind": "height_hold", "sensors": ("gnss",), **options})
    return HeightHold(config, setup or make_setup("gnss"))


def test_height_is_that_of_the_reference_above_the_design_plane() -> None:
    """An antenna 2.5 m above a blade's edge that stands 0.3 m above the plane of up = 1.7 m."""
    receiver = SensorInfo(
        name="gnss",
        kind="gnss",
        columns=GNSS_COLUMNS,
        mount=Mount(body="scraper", xyz_m=(0.0, 0.2, 3.0)),
        rate_hz=10.0,
    )
    edge = Mount(body="scraper", xyz_m=(-0.4, 0.0, 0.5))
    hold = make(make_setup(sensors={"gnss": receiver}, reference=edge))
    sample = gnss(STEP_NS, 0.0, sigma=0.021)
    sample.values[:, GNSS_COLUMNS.index("position_u_m")] = DESIGN_M + 0.3 + 2.5
    hold.process(sample)
    estimate = hold.estimate(10 * STEP_NS)
    np.testing.assert_allclose(estimate.values, [[0.3]])
    np.testing.assert_allclose(estimate.sigmas, [[0.021]])


def test_it_holds_until_a_newer_one_comes() -> None:
    """In each member for itself: what overtook on the way counts, what comes after it does not."""
    hold = make(make_setup("gnss", runs=2))
    assert np.isnan(hold.estimate(STEP_NS).values).all()
    hold.process(gnss(1, [0.1, 0.2]))
    hold.process(gnss(3, [0.3, np.nan], valid=[True, False]))
    np.testing.assert_allclose(hold.estimate(4).values[:, 0], [0.3, 0.2])
    hold.process(gnss(2, [0.5, 0.6]))
    np.testing.assert_allclose(hold.estimate(5).values[:, 0], [0.3, 0.6])
    hold.process(gnss(6, [np.nan, np.nan], quality=0.0, sigma=np.nan, age=np.nan))
    np.testing.assert_allclose(hold.estimate(7).values[:, 0], [0.3, 0.6])
    np.testing.assert_allclose(hold.estimate(7).sigmas[:, 0], 0.015)


def test_heights_may_be_counted_from_the_first() -> None:
    hold = make(make_setup("gnss", runs=2), zero="start", start_height_m=0.05)
    for t_ns, heights in ((1, [0.01, np.nan]), (2, [0.04, -0.03]), (3, [0.02, 0.0])):
        hold.process(gnss(t_ns, heights))
    np.testing.assert_allclose(hold.estimate(4).values[:, 0], [0.06, 0.08])


@pytest.mark.parametrize(
    ("setup", "message"),
    [
        (make_setup(), "exactly one sensor of kind 'gnss'"),
        (make_setup("gnss", "ahrs"), "is of kind 'ahrs'"),
        (make_setup("gnss", reference=Mount(body="chassis", xyz_m=(0.0, 0.0, 0.0))), "sits on 'plate'"),
    ],
)
def test_other_sensors_are_refused(setup: EstimatorSetup, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        make(setup)
