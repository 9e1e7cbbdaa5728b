"""The position-velocity filter of paper 003: its equations by hand, its zero row, its turns, its lesser company."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.estimators.guidance import ALL, WHEELBASE_M, Passes, drive, fix, make_setup, measure, pass_to_pass
from twin.errors import BadInputError
from twin.estimators.engines import EnsembleEngine
from twin.estimators.guidance_epochs import Epochs
from twin.estimators.guidance_pv import CLOSED, FILTERING, GuidancePv, GuidancePvConfig
from twin.estimators.guidance_pv_model import Antenna, CorrectedMotion, PublishedMotion, Rows
from twin.signals import NS_PER_S, EstimatorSetup

Q, R, P0 = (0.033, 0.033, 0.003, 0.0025), (6.25, 6.25, 0.25, 0.025, 0.025), (2.0, 2.0, 0.1, 0.01)


def make(setup: EstimatorSetup, **options: Any) -> GuidancePv:
    config = GuidancePvConfig.model_validate({"kind": "guidance_pv", "sensors": tuple(setup.sensors), **options})
    return GuidancePv(config, setup)


def paper_step(x: np.ndarray, P: np.ndarray, z: np.ndarray, delta: float, c: float) -> tuple[np.ndarray, ...]:
    """Eqs 7 to 11 word for word, T = 1 s."""
    H = np.zeros((5, 4))
    H[:4] = np.eye(4)
    K = P @ H.T @ np.linalg.inv(np.diag(R) + H @ P @ H.T)
    x = x + K @ (z - H @ x)
    P = (np.eye(4) - K @ H) @ P
    Phi = np.eye(4)
    Phi[0, 3], Phi[1, 3] = np.sin(x[2] + c * delta), np.cos(x[2] + c * delta)
    Phi[2, 3] = np.tan(delta) / WHEELBASE_M
    return x, P, Phi @ x, Phi @ P @ Phi.T + np.diag(Q), K


def feed(
    guide: GuidancePv, t_s: float, position: tuple[float, float], *, rate: float, slots: float, steer: float
) -> None:
    guide.process(fix(t_s, *position))
    guide.process(measure("yaw_gyro", t_s, [rate]))
    guide.process(measure("wheel_encoders", t_s, [slots, slots]))
    guide.process(measure("angle_transducer", t_s, [steer]))


@pytest.mark.parametrize("engine", ["filterpy", "ensemble"])
def test_three_steps_are_those_of_the_equations(engine: str) -> None:
    """Northwards past (100, 200), 0.8 m/s, the front wheel turned 0.05 rad to the right; no turn beyond the limits."""
    guide = make(make_setup(*ALL, start=(0.0, 0.0, np.pi / 2)), engine=engine)
    slot_m = 2.0 * np.pi * 0.4635 / 360.0
    x = P = None
    heading, c = np.pi / 2, 1.5 / WHEELBASE_M
    fixes = ((100.0, 200.0), (101.0, 200.5), (100.2, 202.0))
    for k, position in enumerate(fixes):
        slots, rate = round(0.8 / slot_m) * k, -0.03
        feed(guide, float(k + 1), position, rate=rate, slots=slots, steer=-0.05)
        heading += rate if k else 0.0  # the first sample has no interval
        v = round(0.8 / slot_m) * slot_m if k else None
        z = np.array([*position, np.pi / 2 - heading, 0.0 if v is None else v, 0.05])
        if x is None:  # it begins there, which is not told to it a second time
            x, P = z[:4].copy(), np.diag(P0)
            Phi = np.eye(4)
            Phi[0, 3], Phi[1, 3] = np.sin(x[2] + c * 0.05), np.cos(x[2] + c * 0.05)
            Phi[2, 3] = np.tan(0.05) / WHEELBASE_M
            here, cov = x, P
            x, P = Phi @ x, Phi @ P @ Phi.T + np.diag(Q)
        else:
            here, cov, x, P, _ = paper_step(x, P, z, 0.05, c)
        np.testing.assert_allclose(guide.engine.x[0], here, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(guide.engine.P[0], cov, rtol=0.0, atol=1e-12)


def test_first_gain_by_hand() -> None:
    """P = 2 and R = 6.25: a fix moves the position by 2 / 8.25 of its innovation."""
    x = np.array([[10.0, 20.0, 0.0, 1.0]])
    engine = EnsembleEngine(x, np.diag(P0)[np.newaxis])
    engine.update(Rows((0, 1), R[:2], states=4), np.array([[11.0, 18.0]]), np.array([True]))
    np.testing.assert_allclose(engine.x[0, :2], [10.0 + 2.0 / 8.25, 20.0 - 4.0 / 8.25])
    np.testing.assert_allclose(np.diag(engine.P[0])[:2], 2.0 * 6.25 / 8.25)


def test_phi_by_hand() -> None:
    """psi = 30 deg, c delta = 0.6 x 0.1, v = 2 m/s, T = 1 s, W = 1.1 m."""
    motion = PublishedMotion(process_variances=Q, step_s=1.0, wheelbase_m=1.1, c=0.6)
    moved, Phi = motion.linearise(np.array([[1.0, 2.0, np.pi / 6, 2.0]]), np.array([0.1]), 1.0)
    np.testing.assert_allclose(Phi[0, :, 3], [0.551031, 0.834485, 0.091213, 1.0], atol=1e-6)
    np.testing.assert_allclose(moved[0], [2.102062, 3.668970, 0.706025, 2.0], atol=2e-6)


def test_zero_row_is_harmless() -> None:
    """It changes neither x nor P by a bit, whatever the steering angle."""
    rng = np.random.default_rng(1)
    half = rng.normal(size=(3, 4, 4))
    x, P = rng.normal(size=(3, 4)), half @ half.transpose(0, 2, 1)
    engine = EnsembleEngine(x, P)
    engine.update(Rows((None,), (0.025,), states=4), np.array([[0.3], [-1.0], [9.0]]), np.ones(3, dtype=bool))
    np.testing.assert_array_equal(engine.x, x)
    np.testing.assert_array_equal(engine.P, P)
    H = np.vstack([np.eye(4), np.zeros(4)])
    K = P @ H.T @ np.linalg.inv(np.diag(R) + H @ P @ H.T)
    np.testing.assert_array_equal(K[:, :, 4], 0.0)


@pytest.mark.parametrize("states", [4, 5])
def test_corrected_jacobian_is_the_derivative(states: int) -> None:
    motion = CorrectedMotion(process_variances=(*Q, 0.01)[:states], step_s=1.0, wheelbase_m=1.1)
    antenna = Antenna(R[:2], forward_m=1.5, left_m=0.2)
    for delta in (0.4, 0.0):
        x = np.array([[1.0, 2.0, 0.7, 1.3, delta]])[:, :states]
        u = np.array([delta])
        _, F = motion.linearise(x, u, 1.0)
        for place in range(states):
            step = np.zeros((1, states))
            step[0, place] = 1e-6
            slope = (motion.linearise(x + step, u, 1.0)[0] - motion.linearise(x - step, u, 1.0)[0]) / 2e-6
            np.testing.assert_allclose(F[0, :, place], slope[0], atol=1e-8)
            seen = (antenna.h(x + step) - antenna.h(x - step)) / 2e-6
            np.testing.assert_allclose(antenna.H(x)[0, :, place], seen[0], atol=1e-8)


def test_corrected_motion_keeps_to_the_circle() -> None:
    """A quarter of a circle of radius W / tan(delta) to the right, from north."""
    delta = 0.5
    radius = 1.1 / np.tan(delta)
    motion = CorrectedMotion(process_variances=Q, step_s=1.0, wheelbase_m=1.1)
    x = np.array([[0.0, 0.0, 0.0, 0.5 * np.pi * radius]])
    moved, _ = motion.linearise(x, np.array([delta]), 1.0)
    np.testing.assert_allclose(moved[0, :3], [radius, radius, np.pi / 2], atol=1e-12)


def test_closed_in_turns_and_started_anew() -> None:
    """In the turn it says what the sensors say; in the new row it starts with P of eq 14 and half a turn more."""
    world = Passes(passes=2, seed=3, weave_rad=0.0, steering_noise_rad=0.0, steering_offset_rad=0.0)
    guide = make(world.setup(), rate_hz=10.0)
    values, _, _ = drive(world, guide)
    mode = values[:, 0, guide.columns.index("mode")]
    rate = world.plan[1]
    turn = np.flatnonzero(rate != 0.0)
    second = np.flatnonzero(world.plan[2] == 1)
    fixes = 10  # steps between two
    assert (mode[turn[0] + fixes : turn[-1]] == CLOSED).all()
    assert (mode[second[0] + 3 * fixes + 1 :] == FILTERING).all()
    assert (mode[turn[0] - 300 : turn[0]] == FILTERING).all()
    place = guide.columns.index("nis_position")
    assert np.isnan(values[turn[0] + fixes : turn[-1], 0, place]).all()
    # closed: the position is that of the last fix, the heading that of the gyro
    held = values[turn[-1] - 25, 0, 2]
    np.testing.assert_allclose(held, world.truth[turn[-1] - 25, 0, 2], atol=0.6)


def test_new_row_begins_from_the_old_heading_turned() -> None:
    """Gyro 0.2 rad off after the turn: published starts half a turn from the old row, corrected from the gyro."""
    psi = {}
    for variant in ("published", "corrected"):
        guide = make(make_setup(*ALL), variant=variant, straight_s=0.0)
        t = 0.0
        for rate in (0.0, 0.0, 0.0, *([(np.pi - 0.2) / 5] * 5), 0.0):
            t += 1.0
            feed(guide, t, (0.0, 0.0), rate=rate, slots=10.0 * t, steer=0.0)
        x, P = guide.engine.x[0], guide.engine.P[0]
        gyro = np.pi / 2 - (np.pi - 0.2)
        start = -np.pi / 2 if variant == "published" else gyro
        psi[variant] = x[2]
        assert x[2] == pytest.approx(start, abs=1e-12)
        np.testing.assert_array_equal(P, np.diag(P0))
    assert psi["corrected"] > psi["published"] + 0.1


@pytest.mark.parametrize("variant", ["published", "corrected"])
def test_the_fix_that_begins_is_not_counted_twice(variant: str) -> None:
    """It is the state already: there is no innovation, and P is that of eq 14. The next one has one."""
    guide = make(make_setup(*ALL), variant=variant)
    told = []
    for k in range(2):
        feed(guide, k + 1.0, (3.0 + k, 0.0), rate=0.0, slots=100.0 * k, steer=0.0)
        told.append(guide.estimate(round((k + 1.0) * NS_PER_S)).values[0, guide.columns.index("nis_position")])
        if not k:
            np.testing.assert_array_equal(guide.engine.P[0], np.diag(P0))
    assert np.isnan(told[0])
    assert np.isfinite(told[1])


@pytest.mark.parametrize("first", ["yaw_gyro", "wheel_encoders"])
def test_the_turn_of_the_first_second_in_motion_counts(first: str) -> None:
    """Five seconds of rest show an offset of 0.01 rad/s; then it turns by 0.2 rad in the second in which it starts.

    Whichever sensor is heard first, the heading has all of that turn, and the offset nothing of it. The first second of
    the rest is not confirmed on both sides where the gyro comes last; its offset may stay in the heading.
    """
    setup = make_setup(*ALL)
    infos = {info.kind: info for info in setup.sensors.values()}
    config = GuidancePvConfig.model_validate({"kind": "guidance_pv", "sensors": ALL})
    epochs, headings = Epochs(infos, setup, config), []
    for k in range(10):
        samples = {
            "yaw_gyro": measure("yaw_gyro", k + 1.0, [0.01 + (0.2 if k == 6 else 0.0)]),
            "wheel_encoders": measure("wheel_encoders", k + 1.0, [100.0 * max(k - 5, 0)] * 2),
        }
        epochs.add(fix(k + 1.0, 0.8 * max(k - 5, 0), 0.0))
        for name in sorted(samples, key=lambda name: name != first):
            epochs.add(samples[name])
        headings.append(epochs.heading[0])
    assert headings[6] == pytest.approx(0.2, abs=0.0101)
    np.testing.assert_allclose(headings[7:], headings[6], atol=1e-12)


@pytest.mark.parametrize("steering_state", [False, True])
def test_closed_and_begun_corrected_it_tells_the_rear_axle(steering_state: bool) -> None:
    """An antenna 1.5 m ahead and 0.1 m to the left, without errors: after each fix the position is exact.

    North and then eastwards: at the start, closed in the turn to the right, and where the new row begins.
    """
    setup = make_setup(*ALL, start=(0.0, 0.0, np.pi / 2))
    guide = make(setup, variant="corrected", steering_state=steering_state, straight_s=1.5)
    modes = []
    for k in range(12):  # on the spot, for simplicity: by 0.3 rad/s for five seconds
        turned = -0.3 * min(max(k - 2, 0), 5)
        ahead = np.exp(1j * (np.pi / 2 + turned))
        antenna = 10.0 + 20.0j + ahead * (1.5 + 0.1j)
        rate = -0.3 if 2 < k <= 7 else 0.0
        # the counts go on: were the wheels still, the gyro would be set to zero
        feed(guide, k + 1.0, (antenna.real, antenna.imag), rate=rate, slots=20.0 * k, steer=0.0)
        said = guide.estimate(round((k + 1.0) * NS_PER_S)).values[0]
        modes.append(said[guide.columns.index("mode")])
        if k in {0, 5, 6, 7, 9}:
            np.testing.assert_allclose(said[:2], [10.0, 20.0], atol=1e-9)
    assert modes[0] == FILTERING
    assert modes[5:9] == [CLOSED] * 4
    assert modes[9] == FILTERING


def test_steering_state_reads_the_transducer() -> None:
    """With Q 0.01, R 0.025 and P 0.025, a random walk settles on a steady angle."""
    guide = make(make_setup(*ALL), steering_state=True)
    for k in range(30):
        feed(guide, k + 1.0, (0.8 * k, 0.0), rate=0.0, slots=100.0 * k, steer=0.05)
    assert guide.engine.x[0, 4] == pytest.approx(-0.05, abs=1e-4)  # to the right, as the paper counts
    steady = 0.5 * (-0.01 + np.sqrt(0.01**2 + 4 * 0.01 * 0.025))  # P - P^2 / (P + R) + Q = P + Q - ..., after updates
    assert guide.engine.P[0, 4, 4] == pytest.approx(steady, rel=1e-3)


@pytest.mark.parametrize("variant", ["published", "corrected"])
@pytest.mark.parametrize("steering_state", [False, True])
def test_engines_and_members_agree(variant: str, steering_state: bool) -> None:
    world = Passes(runs=3, passes=2, length_m=12.0, seed=5)
    options = {"variant": variant, "steering_state": steering_state}
    together, _, joint = drive(world, make(world.setup(), **options))
    for member in range(3):
        for engine in ("filterpy", "ensemble"):
            one = make(make_setup(*ALL, rates=dict.fromkeys(ALL, 10.0) | {"gnss": 1.0}), engine=engine, **options)
            alone, _, cov = drive(world, one, member=member)
            np.testing.assert_allclose(alone[:, 0], together[:, member], atol=1e-9)
            np.testing.assert_allclose(cov[:, 0], joint[:, member], atol=1e-9)


@pytest.mark.parametrize(
    "kinds",
    [
        ("gnss",),
        ("gnss", "imu"),
        ("gnss", "yaw_gyro"),
        ("gnss", "wheel_encoders"),
        ("gnss", "angle_transducer"),
        ("gnss", "odometry"),
        ("gnss", "radar", "yaw_gyro"),
    ],
)
@pytest.mark.parametrize("variant", ["published", "corrected"])
def test_lesser_company_will_do(kinds: tuple[str, ...], variant: str) -> None:
    """With a receiver of a few centimetres, whatever else there is, it stays within what it smooths: 2 m, 0.6 rad."""
    sheet = {"gnss": {"single_position_correlated_sigma_m": 0.01, "single_position_white_sigma_m": 0.01}}
    world = Passes(kinds=kinds, sheets=sheet, length_m=40.0, passes=1, seed=2, steering_offset_rad=0.0)
    values, _, _ = drive(world, make(world.setup(), variant=variant))
    late = slice(200, None)
    truth = world.truth[late, 0]
    assert np.hypot(*(values[late, 0, :2] - truth[:, :2]).T).max() < 2.0
    assert np.abs(values[late, 0, 2] - truth[:, 2]).max() < 0.6
    assert np.abs(values[late, 0, 3] - truth[:, 3]).max() < 0.3


def test_a_start_that_is_not_known_is_found() -> None:
    """Without a heading from the owner it waits for a course, and then counts the gyro from there."""
    world = Passes(length_m=40.0, passes=1, heading=1.0, seed=2)
    setup = make_setup(*ALL, start=(np.nan, np.nan, np.nan), rates=dict.fromkeys(ALL, 10.0) | {"gnss": 1.0})
    values, _, _ = drive(world, make(setup))
    assert np.isnan(values[:40, 0, 0]).all()
    assert np.abs(values[100:, 0, 2] - world.truth[100:, 0, 2]).max() < 0.6


def test_after_a_long_silence_it_starts_anew() -> None:
    guide = make(make_setup("gnss"))
    for k in range(5):
        guide.process(fix(k + 1.0, float(k), 0.0, speed=1.0, course=0.0))
        guide.estimate(round((k + 1.2) * NS_PER_S))
    guide.process(fix(100.0, 500.0, 0.0, speed=1.0, course=0.0))
    said = guide.estimate(round(100.2 * NS_PER_S))
    assert said.values[0, 0] == pytest.approx(500.0 - 1.5 + 0.2, abs=1e-6)


def test_filterpy_steps_one_run() -> None:
    with pytest.raises(BadInputError, match="steps one run"):
        make(make_setup(*ALL, runs=2), engine="filterpy")


def test_wheels_of_unknown_size_are_refused() -> None:
    """The machine tells their radius, or the owner does; nobody else's is taken for it."""
    setup = make_setup(*ALL, wheel_radius_m=0.0)
    with pytest.raises(BadInputError, match=r"wheel_radius_m: .wheel_encoders. counts turns of wheels"):
        make(setup)
    told = make(setup, wheel_radius_m=0.3)
    of_machine = make(make_setup(*ALL, wheel_radius_m=0.3))
    for guide in (told, of_machine):
        for k in range(2):
            feed(guide, k + 1.0, (0.0, 0.0), rate=0.0, slots=360.0 * k, steer=0.2)
        # closed, it says what the wheels say: one turn in a second
        assert guide.estimate(2 * NS_PER_S).values[0, 3] == pytest.approx(2.0 * np.pi * 0.3)


def test_it_cannot_take_away_the_receivers_wander() -> None:
    """Its time constant (15 s) is short against the wander's (1200 s): pass to pass it is as wrong as the receiver.

    Driven to and fro, a station is passed again after a lag from some 10 to 80 s, so the difference has a variance of
    the mean of 2 sigma^2 (1 - exp(-lag / tau)), if gyro and wheels are as good as perfect, as here.
    """
    gyro = {"noise_rad_s": 1e-4, "bias_rad_s": 1e-5, "bias_random_walk_rad_s_rts": 0.0, "scale_error_ratio": 0.0}
    world = Passes(runs=200, seed=11, sheets={"yaw_gyro": gyro}, slip_ratio=0.0, steering_offset_rad=0.0)
    values, _, _ = drive(world, make(world.setup()))
    seen = np.sqrt(np.mean(np.square(pass_to_pass(world, values[..., :2]))))
    grid = np.linspace(0.2, 0.95, 16)
    lag = 2.0 * (1.0 - grid) * 50.0 / 1.1 + np.pi * 2.0 / 1.1
    expected = np.sqrt(np.mean(2.0 * 2.12**2 * -np.expm1(-lag / 1200.0)))
    assert 0.8 * expected < seen < 1.25 * expected
