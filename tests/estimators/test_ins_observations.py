"""What sensors see of the strapdown state: Jacobians and lever arms."""

import math

import numpy as np
import pytest

from tests.estimators.test_ins_model import everything, jacobian_by_differences, random_states
from twin.estimators.ins_model import BG, CORE_STATES, PITCH, ROLL, SLIP, VX, VY, VZ, YAW, E, N, ReceiverModel
from twin.estimators.ins_observations import AntennaFix, NoSlip, Standing, StatesThemselves

SIZE = everything().size


def no_slip() -> NoSlip:
    observation = NoSlip((0.0025, 0.01), axle_m=(0.55, 0.2, -0.75), size=SIZE)
    observation.rate = np.random.default_rng(1).normal(size=(3, 3))
    return observation


OBSERVATIONS = [
    StatesThemselves([CORE_STATES, CORE_STATES + 3], [0.1, 0.2], size=SIZE),
    AntennaFix(everything().receivers[0], size=SIZE),
    no_slip(),
    Standing(speed_variance=1e-4, size=SIZE),
]


@pytest.mark.parametrize("observation", OBSERVATIONS, ids=lambda one: type(one).__name__)
def test_the_jacobian_is_that_of_the_expectation(observation) -> None:
    """All are linear but the lever arm of 2 m, whose central differences are off by delta^2 / 6 of it."""
    x, _ = random_states(everything(), 2)
    expected = jacobian_by_differences(observation.h, x)
    found = np.broadcast_to(observation.H(x), expected.shape)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert observation.R.shape == (observation.h(x).shape[1],)


def antenna_at(arm: tuple[float, float, float], **angles: float) -> np.ndarray:
    receiver = ReceiverModel(name="gnss", arm_m=arm, velocity_lag_s=0.1, correlation_s=200.0, at=CORE_STATES)
    x = np.zeros((1, CORE_STATES + 4))
    x[0, [E, N]] = 100.0, 50.0
    for name, value in angles.items():
        x[0, {"roll": ROLL, "pitch": PITCH, "yaw": YAW}[name]] = value
    return AntennaFix(receiver, size=x.shape[1]).h(x)[0] - [100.0, 50.0]


def test_where_an_antenna_on_a_mast_is() -> None:
    """2 m up, 0.5 m forward. Heading east: nose down (positive pitch) throws it forward by 2 sin; left side up
    (positive roll) throws it to the right, which is south, by 2 sin. Heading north turns both by 90 degrees."""
    arm = (0.5, 0.0, 2.0)
    np.testing.assert_allclose(antenna_at(arm), [0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(antenna_at(arm, yaw=math.pi / 2), [0.0, 0.5], atol=1e-12)
    ahead = 0.5 * math.cos(0.1) + 2.0 * math.sin(0.1)
    np.testing.assert_allclose(antenna_at(arm, pitch=0.1), [ahead, 0.0], atol=1e-12)
    np.testing.assert_allclose(antenna_at(arm, pitch=0.1, yaw=math.pi / 2), [0.0, ahead], atol=1e-12)
    np.testing.assert_allclose(antenna_at(arm, roll=0.1), [0.5, -2.0 * math.sin(0.1)], atol=1e-12)
    np.testing.assert_allclose(antenna_at(arm, roll=0.1, yaw=math.pi / 2), [2.0 * math.sin(0.1), 0.5], atol=1e-12)


def test_an_antenna_s_correlated_error_is_in_its_position() -> None:
    receiver = everything().receivers[0]
    x = np.zeros((1, SIZE))
    x[0, receiver.at + 2 : receiver.at + 4] = 0.3, -0.2
    still = AntennaFix(receiver, size=SIZE)
    np.testing.assert_allclose(still.h(x) - still.h(np.zeros((1, SIZE))), [[0.3, -0.2]])


def test_the_axle_that_does_not_slip_lies_before_and_below_the_reference() -> None:
    """Turning left with w_z = 0.25, the axle 0.55 m ahead would move to the left by 0.1375 m/s: the reference has to
    move to the right by as much. A pitch rate of 0.1 (nose down) lowers it, a roll rate of 0.1 swings what is 0.75 m
    below to the left (v = w x r, (w_x, 0, 0) x (0, 0, -0.75) = (0, 0.75 w_x, 0))."""
    observation = NoSlip((0.0025, 0.01), axle_m=(0.55, 0.0, -0.75), size=SIZE)
    x = np.zeros((1, SIZE))
    x[0, [VX, VY, VZ]] = 2.5, -0.55 * 0.25 - 0.075, 0.55 * 0.1
    observation.rate = np.array([[0.1, 0.1, 0.25]])
    np.testing.assert_allclose(observation.h(x), 0.0, atol=1e-12)
    x[0, SLIP] = 0.02
    np.testing.assert_allclose(observation.h(x), [[-0.02, 0.0]], atol=1e-12)


def test_standing_is_no_velocity_and_gyroscopes_that_read_their_bias() -> None:
    x = np.zeros((1, SIZE))
    x[0, BG : BG + 3] = 0.01, 0.02, 0.03
    np.testing.assert_allclose(Standing(speed_variance=1e-4, size=SIZE).h(x), [[0.0, 0.0, 0.0, 0.01, 0.02, 0.03]])
