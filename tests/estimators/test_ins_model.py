"""The strapdown model: its Jacobian, and motions whose course is known."""

import math

import numpy as np
import pytest

from tests.estimators.planter import STEP_S, G
from twin.estimators.ins_model import (
    BA,
    BG,
    CORE_STATES,
    PITCH,
    ROLL,
    SLIP,
    VX,
    VY,
    VZ,
    YAW,
    Drive,
    E,
    ErrorChange,
    K,
    N,
    ProcessNoise,
    PulseSensorModel,
    ReceiverModel,
    Strapdown,
    doppler,
    horizontal,
    lag_gain,
)
from twin.geometry import rotation_from_rpy
from twin.signals import FloatArray

RUNS = 3
BEAM_RAD = math.radians(35.0)
NOISE = ProcessNoise(
    accel_bias=1e-3,
    gyro_bias=1e-5,
    accel_extra=5e-3,
    rate_extra=2e-5,
    response=1e-6,
    sideslip_m_s=0.02,
    sideslip_correlation_s=5.0,
    scale=1e-4,
)


def radar_model(name: str = "radar", **changes) -> PulseSensorModel:
    keys = {"arm_m": (0.0, 0.0, 0.0), "beam_slope": math.tan(BEAM_RAD), "speed_noise_m_s": 0.05, "sample_s": STEP_S}
    return PulseSensorModel(**{"name": name, "lags_s": (0.2, 0.7), "at": CORE_STATES, **keys, **changes})


def model(
    pulses: list[PulseSensorModel] | None = None, receivers: list[ReceiverModel] | None = None, runs: int = 1
) -> Strapdown:
    pulses, receivers = pulses or [], receivers or []
    strapdown = Strapdown(pulse_sensors=pulses, receivers=receivers, noise=NOISE, runs=runs)
    strapdown.drive = Drive(
        accel_variance=np.full(runs, 0.01),
        gyro_variance=np.full(runs, 1e-6),
        lags_s={sensor.name: np.full(runs, sensor.lags_s[0]) for sensor in pulses},
        position_sigmas_m={receiver.name: np.full(runs, 0.01) for receiver in receivers},
    )
    return strapdown


def everything(runs: int = RUNS) -> Strapdown:
    """A lagging radar, an AccoSat without lag, a receiver with and one without a velocity lag, on odd mounts."""
    pulses = [
        radar_model(arm_m=(0.6, 0.4, 0.3)),
        radar_model(
            "accosat",
            arm_m=(-0.5, 1.0, 0.2),
            beam_slope=0.0,
            lags_s=(0.0, 0.0),
            slow_error=(0.06, 3.0),
            at=CORE_STATES + 2,
        ),
    ]
    receivers = [
        ReceiverModel(name=name, arm_m=(0.4, -0.7, 2.0), velocity_lag_s=lag_s, correlation_s=200.0, at=CORE_STATES + at)
        for name, lag_s, at in (("slow", 0.1, 4), ("prompt", 0.0, 8))
    ]
    return model(pulses, receivers, runs)


def random_states(strapdown: Strapdown, seed: int, runs: int = RUNS) -> tuple[FloatArray, FloatArray]:
    """States (R, n) and inputs (R, 6) such as a machine on a steep hillside might have."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(runs, strapdown.size))
    x[:, [VX, VY, VZ]] *= [1.0, 0.2, 0.2]
    x[:, VX] += 3.0 * rng.choice([-1.0, 1.0], size=runs)  # backwards too
    x[:, [ROLL, PITCH]] *= 0.2
    x[:, BA : BA + 3] *= 0.3
    x[:, BG : BG + 3] *= 0.05
    x[:, K : K + 3] *= 0.02
    for sensor in strapdown.pulse_sensors:
        x[:, sensor.at + 1] *= 0.05
    u = rng.normal(size=(runs, 6))
    u[:, 2] += G
    u[:, 3:] *= 0.3
    return x, u


def jacobian_by_differences(f, x: FloatArray, delta: float = 1e-5) -> FloatArray:
    """(R, m, n) by central differences."""
    columns = []
    for place in range(x.shape[1]):
        off = np.zeros(x.shape[1])
        off[place] = delta
        columns.append((f(x + off) - f(x - off)) / (2.0 * delta))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("seed", range(5))
def test_the_jacobian_is_that_of_the_mean_up_to_second_order_in_the_step(seed: int) -> None:
    """Gravity and travel are evaluated at the mean attitude and velocity of the step, whose dependence on the state is
    taken as one: what F leaves out is T^2 / 2 times a derivative of a rate by the state. The largest are g times that
    of a turn by a gyroscope's bias (9.8, in the velocity) and by the attitude (9.8 |w| = 9.8 x 1), and those of the
    velocity by the attitude (9.8, in the position): with T = 0.02 s, 2e-4 x 10. Twice that is allowed.
    """
    strapdown = everything()
    x, u = random_states(strapdown, seed)
    found = strapdown.linearise(x, u, STEP_S)[1]
    expected = jacobian_by_differences(lambda at: strapdown.linearise(at, u, STEP_S)[0], x)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2.0 * 0.5 * STEP_S**2 * G)
    # And it is second order: a tenth of the step leaves a hundredth of it.
    short = 0.1 * STEP_S
    found = strapdown.linearise(x, u, short)[1]
    expected = jacobian_by_differences(lambda at: strapdown.linearise(at, u, short)[0], x)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2.0 * 0.5 * short**2 * G)


def test_members_of_the_model_do_not_know_one_another() -> None:
    strapdown = everything()
    x, u = random_states(strapdown, 9)
    moved, F = strapdown.linearise(x, u, STEP_S)
    for index in range(RUNS):
        one = everything(1)
        alone, F_alone = one.linearise(x[index : index + 1], u[index : index + 1], STEP_S)
        np.testing.assert_allclose(alone[0], moved[index], rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(F_alone[0], F[index], rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(one.Q(STEP_S)[0], strapdown.Q(STEP_S)[index], rtol=1e-13)


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.3), (0.05, 0.0, 1.0), (0.0, -0.05, 2.0), (0.08, 0.06, -2.5)])
def test_standing_on_a_slope_keeps_its_velocity_of_zero(rpy: tuple[float, float, float]) -> None:
    """What a standing accelerometer feels is g upwards, in body axes R^T (0, 0, g)."""
    strapdown = model()
    x = np.zeros((1, strapdown.size))
    x[0, ROLL : YAW + 1] = rpy
    u = np.zeros((1, 6))
    u[0, :3] = rotation_from_rpy(*rpy).T @ [0.0, 0.0, G]
    for _ in range(500):
        x = strapdown.linearise(x, u, STEP_S)[0]
    assert np.abs(x[0, VX : VZ + 1]).max() < 1e-9
    np.testing.assert_allclose(x[0, ROLL : YAW + 1], rpy)


@pytest.mark.parametrize("pitch", [0.05, -0.05])
def test_gravity_pulls_forward_with_the_nose_down(pitch: float) -> None:
    """Pitch about the left axis is nose down if positive: without a longitudinal force it gains g sin(pitch)."""
    strapdown = model()
    x, u = np.zeros((1, strapdown.size)), np.zeros((1, 6))
    x[0, PITCH] = pitch
    u[0, 2] = G * math.cos(pitch)
    moved = strapdown.linearise(x, u, STEP_S)[0]
    assert moved[0, VX] == pytest.approx(G * math.sin(pitch) * STEP_S)
    assert moved[0, VY] == moved[0, N] == 0.0
    # Left side up (positive roll) pulls to the right.
    x[0, ROLL : PITCH + 1] = 0.05, 0.0
    u[0, 2] = G * math.cos(0.05)
    assert strapdown.linearise(x, u, STEP_S)[0][0, VY] == pytest.approx(-G * math.sin(0.05) * STEP_S)


@pytest.mark.parametrize("rate", [0.25, -0.25])
def test_a_steady_circle_stays_on_the_circle(rate: float) -> None:
    """Forward 2.5 m/s, w about the vertical, f_y = v w inwards: radius 10 m, once round in 2 pi / w.

    Travel by the mean heading is a polygon whose chord is v T instead of 2 r sin(w T / 2): its circle is larger by
    (w T)^2 / 24 = 1e-6, so that after one round it is back to well below a millimetre.
    """
    strapdown = model()
    x, u = np.zeros((1, strapdown.size)), np.zeros((1, 6))
    x[0, [VX, YAW]] = 2.5, 0.4
    u[0] = 0.0, 2.5 * rate, G, 0.0, 0.0, rate
    steps = 1256
    dt = 2.0 * math.pi / abs(rate) / steps
    centre = np.array([-math.sin(0.4), math.cos(0.4)]) * 2.5 / rate
    for step in range(steps):
        x = strapdown.linearise(x, u, dt)[0]
        assert math.hypot(*(x[0, :2] - centre)) == pytest.approx(10.0, abs=1e-4), step
    np.testing.assert_allclose(x[0, VX : VZ + 1], [2.5, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(x[0, :2], 0.0, atol=1e-3)
    assert x[0, YAW] - 0.4 == pytest.approx(math.copysign(2.0 * math.pi, rate))


def test_the_errors_of_the_gyroscopes_are_taken_off() -> None:
    """A unit with bias b and response k reads w + b + k w_z: here w_z = 0.5 after the first order in k."""
    strapdown = model()
    x = np.zeros((1, strapdown.size))
    x[0, BG : BG + 3] = 0.01, -0.02, 0.03
    x[0, K : K + 3] = 0.02, -0.01, 0.015
    u = np.zeros((1, 6))
    u[0, 3:] = np.array([0.0, 0.0, 0.5]) + x[0, BG : BG + 3] + 0.5 * x[0, K : K + 3]
    # k of k: 0.5 * 0.015 times k is left.
    np.testing.assert_allclose(strapdown.rate(x, u)[0], [0.0, 0.0, 0.5], atol=0.5 * 0.015 * 0.02 * 1.01)


def test_a_radar_at_35_degrees_sees_pitch_rate_and_heave() -> None:
    """v_x - tan(A) v_z at the mount: a beam pointing down takes a heave upwards for going backwards."""
    sensor = radar_model(arm_m=(0.5, 0.0, -0.2))
    x = np.zeros((3, CORE_STATES + 2))
    x[:, VX] = 2.5
    x[1, VZ] = 0.1
    w = np.zeros((3, 3))
    w[2, 1] = 0.2  # nose going down: the mount before the axle goes down by 0.5 m x 0.2 and back by 0.2 m x 0.2
    slope = math.tan(BEAM_RAD)
    np.testing.assert_allclose(
        doppler(sensor, x, w), [2.5, 2.5 - 0.1 * slope, 2.5 - 0.2 * 0.2 + 0.5 * 0.2 * slope], rtol=1e-12
    )
    # A machine that goes along its nose-down axis over level ground sinks in no frame of its own: nothing is seen of
    # it. Level motion under a body pitched nose down by d is v (cos d, 0, sin d) in the body: 1 - tan(A) d, as a
    # radar's data sheet says, 1.2 % a degree.
    d = math.radians(1.0)
    x[0, [VX, VZ]] = 2.5 * math.cos(d), 2.5 * math.sin(d)
    assert doppler(sensor, x, np.zeros((3, 3)))[0] / 2.5 - 1.0 == pytest.approx(-0.0122, abs=2e-4)
    # The direction is lost, the scale multiplies.
    x[0, [VX, VZ]] = -2.0, 0.0
    x[0, sensor.at + 1] = 0.03
    assert doppler(sensor, x, np.zeros((3, 3)))[0] == pytest.approx(2.06)


def accelerating(strapdown: Strapdown, seconds: float, accel: float) -> FloatArray:
    x, u = np.zeros((1, strapdown.size)), np.zeros((1, 6))
    u[0] = accel, 0.0, G, 0.0, 0.0, 0.0
    for _ in range(round(seconds / STEP_S)):
        x = strapdown.linearise(x, u, STEP_S)[0]
    return x


@pytest.mark.parametrize("lag_s", [0.2, 0.7, 0.0])
def test_a_radar_trails_a_ramp_by_its_lag(lag_s: float) -> None:
    """Its samples' filter takes means over the sample: on a ramp of a the output trails by T / (1 - e^{-T/tau}) less
    half a sample, tau + T^2 / 12 tau."""
    sensor = radar_model(lags_s=(lag_s, lag_s))
    x = accelerating(model([sensor]), 10.0, 0.5)
    behind_s = (x[0, VX] - x[0, sensor.at]) / 0.5
    gain = 1.0 - math.exp(-STEP_S / lag_s) if lag_s else 1.0
    assert behind_s == pytest.approx(STEP_S / gain - 0.5 * STEP_S, abs=1e-6)
    assert behind_s == pytest.approx(max(lag_s, 0.5 * STEP_S), abs=2e-4)


@pytest.mark.parametrize("lag_s", [0.1, 0.0])
def test_a_receiver_s_velocity_trails_by_its_lag_and_not_by_a_step_more(lag_s: float) -> None:
    antenna = ReceiverModel(
        name="gnss", arm_m=(0.0, 0.0, 2.0), velocity_lag_s=lag_s, correlation_s=200.0, at=CORE_STATES
    )
    x = accelerating(model(receivers=[antenna]), 5.0, 0.5)
    assert (x[0, VX] - x[0, antenna.at]) / 0.5 == pytest.approx(lag_s, abs=1e-6)
    # In a steady turn the velocity's direction trails by the heading turned within the lag.
    strapdown = model(receivers=[antenna])
    x, u = np.zeros((1, strapdown.size)), np.zeros((1, 6))
    x[0, [VX, antenna.at]] = 2.5, 2.5
    u[0] = 0.0, 2.5 * 0.25, G, 0.0, 0.0, 0.25
    for _ in range(200):
        x = strapdown.linearise(x, u, STEP_S)[0]
    course = math.atan2(x[0, antenna.at + 1], x[0, antenna.at])
    assert x[0, YAW] - course == pytest.approx(math.atan(0.25 * lag_s), abs=1e-5)


def test_an_antenna_abroad_swings_with_the_turn() -> None:
    """To the left of the reference by 2 m, turning left with 0.25 rad/s: 0.5 m/s slower."""
    antenna = ReceiverModel(name="gnss", arm_m=(0.0, 2.0, 0.0), velocity_lag_s=0.0, correlation_s=200.0, at=CORE_STATES)
    strapdown = model(receivers=[antenna])
    x, u = np.zeros((1, strapdown.size)), np.zeros((1, 6))
    x[0, VX] = 2.5
    u[0] = 0.0, 2.5 * 0.25, G, 0.0, 0.0, 0.25
    x = strapdown.linearise(x, u, STEP_S)[0]
    assert math.hypot(*x[0, antenna.at : antenna.at + 2]) == pytest.approx(2.0, abs=1e-3)


def test_a_lag_s_gain_is_one_without_a_lag() -> None:
    np.testing.assert_allclose(
        lag_gain(np.array([0.0, 0.2, 0.7]), 0.02), [1.0, 1 - math.exp(-0.1), 1 - math.exp(-2 / 70)]
    )


def test_an_accosat_s_error_is_added_and_dies_away() -> None:
    """0.1 m/s too fast at 2 m/s; after 3 s a third (1/e) of it is left."""
    sensor = radar_model("accosat", beam_slope=0.0, lags_s=(0.0, 0.0), slow_error=(0.06, 3.0))
    strapdown = model([sensor])
    x = np.zeros((1, strapdown.size))
    x[0, [VX, sensor.at + 1]] = 2.0, 0.1
    assert doppler(sensor, x, np.zeros((1, 3)))[0] == pytest.approx(2.1)
    for _ in range(150):
        x = strapdown.linearise(x, np.array([[0.0, 0.0, G, 0.0, 0.0, 0.0]]), STEP_S)[0]
    assert x[0, sensor.at + 1] == pytest.approx(0.1 / math.e)
    assert x[0, sensor.at] == pytest.approx(2.0 + 0.1 / math.e, abs=1e-3)
    assert strapdown.Q(STEP_S)[0, sensor.at + 1, sensor.at + 1] == pytest.approx(0.06**2 * (1 - math.exp(-0.04 / 3.0)))


def test_correlated_errors_keep_their_variance() -> None:
    antenna = ReceiverModel(name="gnss", arm_m=(0.0, 0.0, 2.0), velocity_lag_s=0.1, correlation_s=20.0, at=CORE_STATES)
    strapdown = model(receivers=[antenna])
    places = [SLIP, antenna.at + 2]
    variances = np.array([NOISE.sideslip_m_s**2, 0.01**2])
    x, P = np.zeros((1, strapdown.size)), np.zeros((1, strapdown.size, strapdown.size))
    P[0, places, places] = variances
    for _ in range(300):
        x, F = strapdown.linearise(x, np.array([[0.0, 0.0, G, 0.0, 0.0, 0.0]]), STEP_S)
        P = F @ P @ F.transpose(0, 2, 1) + strapdown.Q(STEP_S)
    np.testing.assert_allclose(P[0, places, places], variances, rtol=1e-9)


@pytest.mark.parametrize(("lag_s", "rate_hz"), [(0.2, 50.0), (0.2, 10.0), (0.0, 50.0), (0.0, 10.0), (0.05, 5.0)])
def test_a_radar_s_output_is_as_noisy_as_its_own_samples_make_it(lag_s: float, rate_hz: float) -> None:
    """White noise behind a lag of gain g a sample keeps g / (2 - g) of its variance, however often the filter steps."""
    sensor = radar_model(lags_s=(lag_s, lag_s), sample_s=1.0 / rate_hz, beam_slope=0.0)
    strapdown = model([sensor])
    at = sensor.at
    keep = float(1.0 - lag_gain(np.array([lag_s]), STEP_S)[0])
    stationary = strapdown.Q(STEP_S)[0, at, at] / (1.0 - keep**2)
    gain = float(lag_gain(np.array([lag_s]), 1.0 / rate_hz)[0])
    assert stationary == pytest.approx(0.05**2 * gain / (2.0 - gain), rel=1e-9)


def test_horizontal_turns_as_the_rotation_does() -> None:
    rng = np.random.default_rng(4)
    v, attitude = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)) * [0.3, 0.3, 2.0]
    value, by_vector, by_attitude = horizontal(v, attitude)
    for member in range(4):
        rotation = rotation_from_rpy(*attitude[member])
        np.testing.assert_allclose(value[member], (rotation @ v[member])[:2], atol=1e-14)
        np.testing.assert_allclose(by_vector[member], rotation[:2], atol=1e-14)
    numeric = jacobian_by_differences(lambda at: horizontal(v, at)[0], attitude)
    np.testing.assert_allclose(by_attitude, numeric, atol=1e-9)


def test_an_error_is_drawn_anew_or_grows_and_nothing_else_changes() -> None:
    antenna = ReceiverModel(name="gnss", arm_m=(0.0, 0.0, 2.0), velocity_lag_s=0.1, correlation_s=200.0, at=CORE_STATES)
    strapdown = model(receivers=[antenna], runs=2)
    rng = np.random.default_rng(5)
    x = rng.normal(size=(2, strapdown.size))
    root = rng.normal(size=(2, strapdown.size, strapdown.size))
    P = root @ root.transpose(0, 2, 1)
    change = ErrorChange(antenna, keep=np.array([0.0, 1.0]), added_m2=np.array([0.25, 0.09]), size=strapdown.size)
    moved, F = change.linearise(x, np.zeros((2, 6)), 0.0)
    after = F @ P @ F.transpose(0, 2, 1) + change.Q(0.0)
    error, rest = [antenna.at + 2, antenna.at + 3], np.arange(antenna.at + 2)
    np.testing.assert_array_equal(moved[0, error], 0.0)
    np.testing.assert_array_equal(moved[1], x[1])
    np.testing.assert_allclose(after[0][np.ix_(error, error)], 0.25 * np.eye(2))
    np.testing.assert_allclose(after[0][np.ix_(error, rest)], 0.0)
    np.testing.assert_allclose(after[1] - P[1], np.diag([0.0] * len(rest) + [0.09, 0.09]), atol=1e-12)
    np.testing.assert_allclose(after[:, rest][:, :, rest], P[:, rest][:, :, rest])
    assert moved[0, E] == x[0, E]
