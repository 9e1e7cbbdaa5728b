"""The heading filters of paper 001 against numbers worked out by hand, and against the package the paper cites."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.estimators.robot import SLOT_M, TRACK_M, Drive, field_at, make_setup, measure, run
from twin.errors import BadInputError
from twin.estimators import build_estimator
from twin.estimators.heading_complementary import HeadingComplementaryConfig
from twin.estimators.heading_kalman import HeadingKalmanConfig
from twin.estimators.heading_madgwick import HeadingMadgwickConfig, gain_of, madgwick_step, published_step
from twin.estimators.heading_preparation import PreparationConfig
from twin.estimators.wheel_odometry import WheelOdometryConfig
from twin.signals import EstimatorSetup

CONFIGS: dict[str, Any] = {
    "heading_complementary": HeadingComplementaryConfig,
    "heading_madgwick": HeadingMadgwickConfig,
    "heading_kalman": HeadingKalmanConfig,
    "wheel_odometry": WheelOdometryConfig,
}
RAW = PreparationConfig(standstill_s=0.0, filtered=False)
"""Neither calibration nor pre-filter: the filter's own equations."""
MARG, WHEELS = ("imu", "magnetometer"), ("imu", "wheel_encoders")
KALMAN_KINDS = {
    "imu": MARG,
    "odometry_gyro": WHEELS,
    "odometry_gyro_mag": (*MARG, "wheel_encoders"),
    "integrated": MARG,
}


def make(kind: str, setup: EstimatorSetup, **options: Any):
    if kind != "wheel_odometry":
        options = {"preparation": RAW} | options
    return build_estimator(CONFIGS[kind](kind=kind, sensors=tuple(setup.sensors), **options), setup)


def held(deflection_deg: float, steps: int, from_step: int) -> np.ndarray:
    """A field turned from a step on."""
    return np.deg2rad(deflection_deg) * (np.arange(steps) >= from_step)


# --- complementary ---------------------------------------------------------------------------------------------------


def test_complementary_follows_a_held_magnet_by_one_minus_alpha_to_the_n() -> None:
    drive = Drive(yaw_rate=np.zeros(60), kinds=MARG, heading=0.3, deviation=held(15.0, 60, 20))
    error = run(make("heading_complementary", drive.setup()), drive, "heading_rad")[:, 0] - 0.3
    # The field turns counter-clockwise, so the heading seems to turn clockwise.
    expected = -np.deg2rad(15.0) * (1.0 - 0.9 ** np.arange(1, 41))
    np.testing.assert_allclose(error[20:], expected, atol=1e-12)
    np.testing.assert_allclose(error[:20], 0.0, atol=1e-12)


@pytest.mark.parametrize("rate_hz", [50.0, 2000.0 / 7.0])
def test_complementary_lags_a_gyro_bias_by_its_time_constant(rate_hz: float) -> None:
    """bias * alpha dT / (1 - alpha) = bias * 0.18 s, whatever the rate."""
    drive = Drive(yaw_rate=np.zeros(round(4 * rate_hz)), kinds=MARG, rate_hz=rate_hz, gyro_bias=0.1)
    error = run(make("heading_complementary", drive.setup()), drive, "heading_rad")[:, 0]
    assert error[-1] == pytest.approx(0.1 * 0.18, rel=1e-6)


def test_complementary_as_published_takes_zero_for_the_middle_between_plus_and_minus_a_half_turn() -> None:
    """Turned by 181 deg from the start: gyro 181, magnetometer -179; appendix G averages, the correction wraps."""
    drive = Drive(yaw_rate=np.deg2rad(181.0) / 2.0 * (np.arange(105) >= 5), kinds=MARG)
    published = run(make("heading_complementary", drive.setup()), drive, "heading_rad")[-1, 0]
    corrected = run(make("heading_complementary", drive.setup(), variant="corrected"), drive, "heading_rad")[-1, 0]
    assert abs(np.rad2deg(np.angle(np.exp(1j * (published - drive.headings[-1]))))) > 20.0
    assert np.angle(np.exp(1j * (corrected - drive.headings[-1]))) == pytest.approx(0.0, abs=1e-9)


# --- Madgwick --------------------------------------------------------------------------------------------------------


def test_corrected_madgwick_equals_the_package_that_the_paper_cites() -> None:
    madgwick = pytest.importorskip("ahrs").filters.Madgwick(frequency=50.0, gain=0.041)
    rng = np.random.default_rng(1)
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    ours, theirs = q[np.newaxis], q
    for _ in range(300):
        rate, force = rng.normal(size=3), rng.normal((0.0, 0.0, 9.8), 1.0)
        field = rng.normal((20.0, 0.0, -43.0), 1.0)
        theirs = madgwick.updateMARG(theirs, gyr=rate, acc=force, mag=field)
        unit = [each[np.newaxis] / np.linalg.norm(each) for each in (force, field)]
        ours = madgwick_step(ours, rate[np.newaxis], unit[0], unit[1], beta=0.041, dt_s=0.02)
        np.testing.assert_allclose(ours[0], theirs, atol=1e-12)
    theirs = madgwick.updateIMU(theirs, gyr=rate, acc=force)
    alone = madgwick_step(ours, rate[np.newaxis], unit[0], None, beta=0.041, dt_s=0.02)
    np.testing.assert_allclose(alone[0], theirs, atol=1e-12)


def test_madgwick_turns_at_most_two_beta_towards_a_magnet() -> None:
    """And all of it towards the field where gravity is satisfied: 2 * 0.041 rad/s * 0.4 s = 1.88 deg."""
    drive = Drive(yaw_rate=np.zeros(40), kinds=MARG, deviation=held(90.0, 40, 20))
    error = run(make("heading_madgwick", drive.setup()), drive, "heading_rad", "roll_rad", "pitch_rad")[:, 0]
    bound = 2.0 * 0.041 * 0.02 * np.arange(1, 21)
    assert (np.abs(error[20:, 0]) <= bound + 1e-6).all()
    assert np.abs(error[-1, 0]) > 0.25 * bound[-1]
    assert gain_of(np.deg2rad(0.267)) == pytest.approx(0.00404, abs=5e-6)


def test_madgwick_as_published_knows_no_gyroscope_and_no_time() -> None:
    """Eq 43 moves by beta a step against the gradient: at 50 Hz fifty times beta dT."""
    q = np.array([[1.0, 0.0, 0.0, 0.0]])
    angle = np.deg2rad(30.0)
    field = np.array([[np.cos(angle), -np.sin(angle), 0.0]])  # level field, the body turned by 30 deg
    up = np.array([[0.0, 0.0, 1.0]])
    moved = published_step(q, up, field, beta=0.01)
    assert np.linalg.norm(moved - q) == pytest.approx(0.01, rel=1e-3)
    # The entry that eq 38 repeats is the one that should turn the yaw: -2 bx q4 + bz q2 = 0 here, printed -bz q1 = 0.
    slow = madgwick_step(q, np.zeros((1, 3)), up, field, beta=0.01, dt_s=0.02)
    assert np.linalg.norm(slow - q) == pytest.approx(0.01 * 0.02, rel=1e-3)
    tilted = np.array([[np.cos(angle) * 0.4, -np.sin(angle) * 0.4, -0.9165]])
    correct = madgwick_step(q, np.zeros((1, 3)), up, tilted, beta=1e-6, dt_s=1.0) - q
    printed = published_step(q, up, tilted, beta=1e-6) - q
    assert np.abs(correct / 1e-6 - printed / 1e-6).max() > 0.1


# --- Kalman ----------------------------------------------------------------------------------------------------------


def steady_gain() -> np.ndarray:
    """Gain of the paper's filter by iterating the textbook Riccati equation, in degrees."""
    A, H = np.array([[1.0, -0.02], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    P = 0.1 * np.eye(2)
    for _ in range(20_000):
        P = A @ P @ A.T + np.diag([0.002, 0.005]) * 0.02
        K = P @ H.T / (H @ P @ H.T + 0.03)
        P = (np.eye(2) - K @ H) @ P
    return K[:, 0]


def test_kalman_imu_has_the_gain_of_the_riccati_equation_and_takes_off_a_constant_bias() -> None:
    bias = np.deg2rad(1.0)
    drive = Drive(yaw_rate=np.zeros(3000), kinds=MARG, gyro_bias=bias, deviation=held(10.0, 3000, 2999))
    filter_ = make("heading_kalman", drive.setup(), inputs="imu")
    found = run(filter_, drive, "heading_rad", "gyro_bias_z_rad_s")[:, 0]
    assert found[-2] == pytest.approx([0.0, bias], abs=1e-4)
    K = steady_gain()
    assert (found[-1] - found[-2]) == pytest.approx(-np.deg2rad(10.0) * K, rel=1e-3)


def test_kalman_odometry_gyro_does_not_feel_a_magnet_and_loses_no_heading_to_bias() -> None:
    drive = Drive(yaw_rate=np.zeros(2000), kinds=WHEELS, gyro_bias=np.deg2rad(0.5))
    error = run(make("heading_kalman", drive.setup(), inputs="odometry_gyro"), drive, "heading_rad")[:, 0]
    assert np.abs(error[-1]) < np.deg2rad(1e-3)
    # First the bias comes through: less than its integral over the bias state's time to settle, about a second.
    assert np.deg2rad(0.02) < np.abs(error).max() < np.deg2rad(0.5)


@pytest.mark.parametrize(("bias_input", "least", "most"), [("eq_59", 0.5, 5.0), ("appendix_h", 0.0, 1e-9)])
def test_eq_59_lets_a_magnet_in_through_the_bias_and_appendix_h_does_not(
    bias_input: str, least: float, most: float
) -> None:
    drive = Drive(yaw_rate=np.zeros(400), deviation=held(15.0, 400, 50))
    filter_ = make("heading_kalman", drive.setup(), inputs="odometry_gyro_mag", bias_input=bias_input)
    error = np.rad2deg(np.abs(run(filter_, drive, "heading_rad")[:, 0]))
    assert least <= error.max() <= most
    assert error[-1] < 0.1


def test_the_integrated_filter_jumps_with_the_field_and_returns_to_the_gyroscope() -> None:
    """The whole jump enters as the input's integral, the gain of one step takes off its share; then it decays.

    Eq 69 is a derivative: of a jump by 15 deg it makes sin(15 deg) rad = 14.83 deg.
    """
    drive = Drive(yaw_rate=np.zeros(3100), kinds=MARG, deviation=held(15.0, 3100, 3000))
    error = np.rad2deg(run(make("heading_kalman", drive.setup(), inputs="integrated"), drive, "heading_rad")[:, 0])
    assert error[3000] == pytest.approx(-np.rad2deg(np.sin(np.deg2rad(15.0))) * (1.0 - steady_gain()[0]), rel=1e-3)
    assert abs(error[-1]) < 2.0


@pytest.mark.parametrize("inputs", KALMAN_KINDS)
def test_both_engines_and_members_agree(inputs: str) -> None:
    kinds, steps = KALMAN_KINDS[inputs], 300
    base = {"yaw_rate": 0.5 * np.sin(np.arange(steps) / 40.0), "kinds": kinds}
    noisy = Drive(**base, runs=3, gyro_noise=0.01, field_noise=1.0, accel_noise=0.1, seed=2)
    together = run(make("heading_kalman", noisy.setup(), inputs=inputs), noisy, "heading_rad", "gyro_bias_z_rad_s")
    for engine in ("filterpy", "ensemble"):
        alone = make("heading_kalman", make_setup(*kinds), inputs=inputs, engine=engine)
        for k, (t_ns, measurements) in enumerate(noisy.ticks()):
            for m in measurements:
                alone.process(measure(m.sensor, m.t_ns, m.values[1:2]))
            values = alone.estimate(t_ns).values[0, [0, 2]]
            np.testing.assert_allclose(values, together[k, 1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", ["heading_complementary", "heading_madgwick"])
def test_a_member_equals_the_run_alone(kind: str) -> None:
    steps = 200
    drive = Drive(yaw_rate=np.full(steps, 0.4), kinds=MARG, runs=3, gyro_noise=0.01, field_noise=1.0, seed=3)
    together = run(make(kind, drive.setup()), drive, "heading_rad", "roll_rad")
    alone = make(kind, make_setup(*MARG))
    for k, (t_ns, measurements) in enumerate(drive.ticks()):
        for m in measurements:
            alone.process(measure(m.sensor, m.t_ns, m.values[2:]))
        np.testing.assert_allclose(alone.estimate(t_ns).values[0, [0, 2]], together[k, 2], rtol=1e-9, atol=1e-12)


# --- odometry --------------------------------------------------------------------------------------------------------


def test_one_slot_of_one_wheel_turns_by_five_point_six_six_degrees() -> None:
    setup = make_setup("wheel_encoders", heading=1.0)
    odometry = make("wheel_odometry", setup)
    for t_ns, slots in ((20_000_000, [5.0, 5.0]), (40_000_000, [5.0, 6.0])):
        odometry.process(measure("wheel_encoders", t_ns, slots))
    assert np.rad2deg(odometry.estimate(40_000_000).values[0, 0] - 1.0) == pytest.approx(5.657, abs=1e-3)


@pytest.mark.parametrize(("variant", "tolerance_m"), [("corrected", 1e-12), ("published", 0.05)])
def test_odometry_drives_a_circle_to_its_far_side(variant: str, tolerance_m: float) -> None:
    """Left 20 and right 40 slots a step, ten steps of (40 - 20) slots: after half a turn it is 2 R to the left."""
    turned = 20 * SLOT_M / TRACK_M
    steps = 10
    radius = 30 * SLOT_M / turned
    odometry = make("wheel_odometry", make_setup("wheel_encoders"), variant=variant)
    for k in range(steps + 1):
        odometry.process(measure("wheel_encoders", (k + 1) * 20_000_000, [20.0 * k, 40.0 * k]))
    heading, _, east, north = odometry.estimate((steps + 1) * 20_000_000).values[0]
    angle = steps * turned
    assert np.angle(np.exp(1j * (heading - angle))) == pytest.approx(0.0, abs=1e-9)
    found, expected = np.array([east, north]), radius * np.array([np.sin(angle), 1.0 - np.cos(angle)])
    off = np.linalg.norm(found - expected)
    assert off <= tolerance_m if variant == "corrected" else off > tolerance_m


# --- preparation, reference, bad input -------------------------------------------------------------------------------


def test_an_uncorrected_gyro_bias_drifts_and_the_standstill_or_the_dead_band_stops_it() -> None:
    """The integrated filter follows its gyroscope: 0.2 deg/s for 20 s is 4 deg."""
    drive = Drive(yaw_rate=np.zeros(1000), kinds=MARG, gyro_bias=np.deg2rad(0.2))

    def drift(**preparation: Any) -> float:
        options = {"standstill_s": 0.0, "filtered": False} | preparation
        filter_ = make("heading_kalman", drive.setup(), inputs="integrated", preparation=PreparationConfig(**options))
        return float(np.rad2deg(run(filter_, drive, "heading_rad")[-1, 0]))

    assert drift() == pytest.approx(4.0, abs=0.05)
    assert drift(standstill_s=2.0) == pytest.approx(0.0, abs=1e-9)
    assert drift(filtered=True) == pytest.approx(0.0, abs=1e-9)  # below 0.267 deg/s


def test_magnetic_north_is_the_reference_if_asked_for() -> None:
    """Heading 20 deg, declination 5 deg east: magnetic north lies at 85 deg."""
    heading, north = np.deg2rad(20.0), np.deg2rad(85.0)
    drive = Drive(yaw_rate=np.zeros(100), kinds=MARG, heading=heading, deviation=np.deg2rad(-5.0))
    setup = make_setup(*MARG, heading=2.0)  # what the owner set out is wrong
    for kind, options in (
        ("heading_complementary", {}),
        ("heading_kalman", {"inputs": "imu"}),
        ("heading_madgwick", {}),
    ):
        filter_ = make(kind, setup, heading_reference="magnetic_north", magnetic_north_rad=north, **options)
        assert run(filter_, drive, "heading_rad")[-1, 0] == pytest.approx(heading, abs=1e-3)


def test_arctan_does_not_tell_a_direction_from_its_opposite() -> None:
    drive = Drive(yaw_rate=np.zeros(100), kinds=MARG, heading=np.deg2rad(-100.0))
    filter_ = make(
        "heading_kalman", drive.setup(), inputs="imu", heading_reference="magnetic_north", arctangent="arctan"
    )
    assert np.rad2deg(run(filter_, drive, "heading_rad")[-1, 0]) == pytest.approx(80.0, abs=0.01)


@pytest.mark.parametrize(
    ("kind", "kinds", "message"),
    [
        ("heading_complementary", ("imu",), "takes one of kind 'magnetometer', not 0"),
        ("heading_madgwick", ("imu", "magnetometer", "wheel_encoders"), "is of kind 'wheel_encoders'"),
        ("wheel_odometry", ("imu",), "is of kind 'imu'"),
    ],
)
def test_sensors_that_do_not_fit_are_named(kind: str, kinds: tuple[str, ...], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        make(kind, make_setup(*kinds))


def test_the_field_of_the_tests_points_north() -> None:
    """A body that looks north sees the field ahead, one that looks east to its left."""
    ahead, left = field_at(np.array([np.pi / 2, 0.0]))
    assert ahead[0] > 0.0
    assert ahead[1] == pytest.approx(0.0, abs=1e-12)
    assert left[1] > 0.0
    assert left[0] == pytest.approx(0.0, abs=1e-12)
