"""Levers by an AHRS's attitude: exact by rotation matrices, and what it costs to take the mast for upright."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.estimators.height_bench import Machine, run
from twin.errors import BadInputError
from twin.estimators import HeightFilterConfig
from twin.estimators.height_filter_levers import Lever
from twin.geometry import rotation_from_rpy
from twin.signals import EstimatorSetup, Mount, SensorInfo

MAST_M = 2.0
SWAY_RAD = 0.08
angles = st.floats(-0.5, 0.5)


@given(roll=angles, pitch=angles, heading=st.floats(-3.1, 3.1))
def test_a_lever_is_the_rotated_vector(roll: float, pitch: float, heading: float) -> None:
    lever = Lever(xyz_m=(0.3, -0.2, 1.5))
    attitude = np.array([[roll], [pitch], [heading]])
    place = rotation_from_rpy(roll, pitch, heading) @ np.array(lever.xyz_m)
    np.testing.assert_allclose(lever.place(attitude)[:, 0], place, atol=1e-12)
    assert lever.height(attitude)[0] == pytest.approx(place[2], abs=1e-12)
    step = 1e-6
    by_roll, by_pitch = (
        (lever.height(attitude + change) - lever.height(attitude - change))[0] / (2.0 * step)
        for change in (np.array([[step], [0.0], [0.0]]), np.array([[0.0], [step], [0.0]]))
    )
    assert lever.slope(attitude)[0] == pytest.approx(np.hypot(by_roll, by_pitch), abs=1e-6)


@given(roll=angles, pitch=angles, heading=st.floats(-3.1, 3.1))
def test_an_upright_lever_does_not_lean(roll: float, pitch: float, heading: float) -> None:
    lever = Lever(xyz_m=(0.3, -0.2, 1.5), upright=True)
    attitude = np.array([[roll], [pitch], [heading]])
    assert lever.height(attitude)[0] == 1.5
    np.testing.assert_array_equal(lever.place(attitude)[:, 0], [0.0, 0.0, 1.5])
    assert lever.slope(attitude)[0] == 0.0


def test_points_of_two_bodies_have_no_lever() -> None:
    mount = Mount(body="plate", xyz_m=(0.0, 0.0, 0.0))
    ahrs = SensorInfo(name="ahrs", kind="ahrs", columns=(), mount=mount, rate_hz=50.0)
    setup = EstimatorSetup(
        name="ours", runs=1, sensors={}, reference=mount, rows_y_m=(), start_e_n_heading=(0.0, 0.0, 0.0)
    )
    with pytest.raises(BadInputError, match="point on 'mast'"):
        Lever.between(ahrs, Mount(body="mast", xyz_m=(0.0, 0.0, 1.0)), setup)


@pytest.mark.parametrize(("sway_rad", "lower_m"), [(0.0, 0.0), (SWAY_RAD, MAST_M * SWAY_RAD**2 / 2.0)])
def test_who_takes_a_leaning_mast_for_upright_is_too_low_by_the_mean_of_its_lean(
    sway_rad: float, lower_m: float
) -> None:
    """An antenna h above is lower by h (roll^2 + pitch^2) / 2; its mean over two sines of amplitude a is h a^2 / 2.

    Attitude errors are not learned: velocities that the lever leaves unexplained would be taken for them.
    """
    machine = Machine(sway_rad=sway_rad, mounts={"gnss": (0.0, 0.0, MAST_M)})
    found = run(
        {
            name: HeightFilterConfig(kind="height_filter", sensors=("gnss", "ahrs"), tilt=False, lever_arm=lever_arm)
            for name, lever_arm in (("leaning", True), ("upright", False))
        },
        duration_s=40.0,
        members=10,
        machine=machine,
    )
    late = found["leaning"].t_s > 15.0
    means = {name: result.error_m[late].mean() for name, result in found.items()}
    # the same receiver and AHRS: what is left of the difference is the AHRS's attitude error, 5 mrad squared
    assert means["upright"] - means["leaning"] == pytest.approx(-lower_m, abs=0.15 * lower_m + 2e-4)
