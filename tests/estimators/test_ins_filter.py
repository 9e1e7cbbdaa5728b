"""The strapdown filter: late samples, gates, members, and a receiver's correlated error."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.estimators.planter import STEP_S, G
from tests.estimators.test_ins_model import NOISE, radar_model
from twin.estimators.engines import EngineName, make_engine
from twin.estimators.inertial_array import Fused
from twin.estimators.ins_filter import AidReading, Epoch, GateConfig, Receiving, StrapdownFilter
from twin.estimators.ins_model import (
    BA,
    BG,
    CORE_STATES,
    PITCH,
    ROLL,
    SLIP,
    VX,
    VZ,
    YAW,
    E,
    K,
    N,
    ReceiverModel,
    Strapdown,
    size_of,
)
from twin.estimators.ins_observations import AntennaFix, NoSlip, Standing, StatesThemselves
from twin.estimators.rts_smoother import RtsRecorder
from twin.signals import FloatArray

SIZE = size_of(1, 1)
RADAR = radar_model(lags_s=(0.2, 0.7))
ANTENNA = ReceiverModel(name="gnss", arm_m=(0.4, 0.3, 2.0), velocity_lag_s=0.1, correlation_s=200.0, at=CORE_STATES + 2)
SPEED = StatesThemselves([RADAR.at], [1e-5], size=SIZE)
VELOCITY = StatesThemselves([ANTENNA.at, ANTENNA.at + 1], [1e-4, 1e-4], size=SIZE)
POSITION = AntennaFix(ANTENNA, size=SIZE)
REACQUIRE_S = 1.0
RUNS = 3


def make(
    runs: int = RUNS, *, engine: EngineName = "ensemble", gated: bool = True, recorded: bool = False, history: int = 30
) -> StrapdownFilter:
    model = Strapdown(pulse_sensors=[RADAR], receivers=[ANTENNA], noise=NOISE, runs=runs)
    sigma = np.zeros(SIZE)
    sigma[[E, N]] = 0.1
    sigma[VX : VZ + 1] = 0.1
    sigma[ROLL], sigma[PITCH], sigma[YAW] = 0.05, 0.05, 0.02
    sigma[BA : BA + 3], sigma[BG : BG + 3], sigma[K : K + 3], sigma[SLIP] = 0.2, 0.01, 0.01, 0.02
    sigma[CORE_STATES:] = 0.1, 0.01, 0.1, 0.1, 1.0, 1.0
    x = np.zeros((runs, SIZE))
    x[:, [VX, RADAR.at, ANTENNA.at]] = 2.5
    P = np.repeat(np.diag(sigma**2)[np.newaxis], runs, axis=0)
    return StrapdownFilter(
        engine=make_engine(engine, x, P),
        model=model,
        no_slip=NoSlip((0.0025, 0.01), axle_m=(0.55, 0.0, -0.75), size=SIZE),
        standing=Standing(speed_variance=1e-4, size=SIZE),
        gate=GateConfig(enabled=gated, sigmas=5.0, reacquire_s=REACQUIRE_S),
        lag_switch_m_s=0.05,
        step_s=STEP_S,
        history=history,
        speed_sources=["radar", "gnss_velocity"],
        recorder=RtsRecorder(x, P) if recorded else None,
    )


@dataclass(frozen=True)
class Story:
    """What a drive of T steps gives to R members: straight on at 2.5 m/s and then, if so, to a stop."""

    u: FloatArray
    """(T, R, 6)."""
    speed: FloatArray
    """(T,)."""
    east: FloatArray
    """(T,)."""
    noise: FloatArray
    """(T, R, 5) of radar, velocity and position."""
    standing: FloatArray
    """(T,)."""


def story(steps: int = 200, runs: int = RUNS, *, stop: bool = False, seed: int = 1) -> Story:
    rng = np.random.default_rng(seed)
    speed = np.full(steps, 2.5)
    if stop:
        speed = np.clip(2.5 - 1.5 * STEP_S * (np.arange(steps) - steps // 3), 0.0, 2.5)
    accel = np.diff(speed, prepend=speed[0]) / STEP_S
    u = rng.normal(size=(steps, runs, 6)) * np.repeat([0.11, 5e-4], 3)
    u[..., 0] += accel[:, np.newaxis]
    u[..., 2] += G
    return Story(u, speed, np.cumsum(speed) * STEP_S, rng.normal(size=(steps, runs, 5)), speed == 0.0)


def epoch(of: Story, step: int) -> Epoch:
    runs = of.u.shape[1]
    fused = Fused(u=of.u[step], accel_variance=np.full(runs, 0.11**2), gyro_variance=np.full(runs, 5e-4**2))
    return Epoch(index=step, dt_s=STEP_S, inertial=fused, standing=np.full(runs, of.standing[step]))


def reading(source: str, observation, z: FloatArray, sigma: float, **more) -> AidReading:
    keys = {"sensor": source.partition("_")[0], "mask": np.ones(len(z), dtype=bool), "speed_source": True}
    return AidReading(
        **{
            "source": source,
            "observation": observation,
            "z": z,
            "variances": np.full(z.shape, sigma**2),
            **keys,
            **more,
        }
    )


def radar_reading(of: Story, step: int, **more) -> AidReading:
    return reading("radar", SPEED, of.speed[step] + 0.01 * of.noise[step, :, :1], 0.003, **more)


def velocity_reading(of: Story, step: int, **more) -> AidReading:
    z = 0.013 * of.noise[step, :, 1:3]
    z[:, 0] += of.speed[max(step - 5, 0)]
    return reading("gnss_velocity", VELOCITY, z, 0.013, **more)


def position_reading(
    of: Story, step: int, *, state: object = 4.0, sigma_m: float = 0.003, jump_m: object = 0.0, **more
):
    z = 0.0008 * of.noise[step, :, 3:]
    z[:, 0] += of.east[step] + 0.4 + jump_m
    z[:, 1] += 0.3
    runs = len(z)
    fix = Receiving(
        model=ANTENNA, sigma_m=np.full(runs, sigma_m), state=np.broadcast_to(np.asarray(state, float), (runs,))
    )
    return reading("gnss_position", POSITION, z, 0.0008, receiver=fix, speed_source=False, **more)


def gnss_readings(of: Story, step: int, **more) -> list[AidReading]:
    return [velocity_reading(of, step), position_reading(of, step, **more)]


def drive(one: StrapdownFilter, of: Story, late: dict[int, int] | None = None, *, spike: bool = False) -> None:
    """Radar at every step, GNSS at every fifth, that of step k ``late[k]`` steps late (5 by default)."""
    late = {} if late is None else late
    due: list[tuple[int, int, list[AidReading]]] = []
    for step in range(len(of.speed)):
        one.step(epoch(of, step))
        fresh = radar_reading(of, step)
        if spike and step % 17 == 3:
            fresh = replace(fresh, z=fresh.z + 1.0)
        one.add(step, [fresh])
        if step % 5 == 0:
            state = 4.0 if step < 100 or step > 150 else 5.0
            due.append((step + late.get(step, 5), step, gnss_readings(of, step, state=state)))
        for _, about, aids in sorted(entry for entry in due if entry[0] == step):
            one.add(about, aids)
        due = [entry for entry in due if entry[0] > step]


def assert_same(one: StrapdownFilter, other: StrapdownFilter, members: slice = slice(None)) -> None:
    for a, b in ((one.engine.x, other.engine.x), (one.engine.P, other.engine.P)):
        assert np.isfinite(a).all()
        np.testing.assert_allclose(a[members], b, rtol=1e-9, atol=1e-9)


# --- late samples ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("spike", [False, True])
def test_late_samples_in_any_order_give_what_those_on_time_give(stop: bool, spike: bool) -> None:
    """With gates at work, changes of the fix state among what comes in the wrong order, and a stop in between."""
    of = story(stop=stop)
    on_time = make()
    drive(on_time, of, dict.fromkeys(range(200), 0), spike=spike)
    rng = np.random.default_rng(3)
    for delays in (dict.fromkeys(range(200), 7), {step: int(rng.integers(0, 25)) for step in range(200)}):
        late = make()
        drive(late, of, {step: min(delay, 199 - step) for step, delay in delays.items()}, spike=spike)
        assert_same(late, on_time)
        assert late.modes.fix_state.keys() == on_time.modes.fix_state.keys()
        for mode in ("braking", "difference", "refused_since", "used_at", "position_sigma_m", "fix_state"):
            for name, expected in getattr(on_time.modes, mode).items():
                np.testing.assert_allclose(getattr(late.modes, mode)[name], expected, rtol=1e-9, atol=1e-9)


def test_several_sensors_of_one_instant_may_arrive_in_any_order() -> None:
    """A radar that is off by 0.15 m/s is accepted before the receiver has narrowed its lagged speed, or refused after:
    which of them, must not depend on the order of arrival."""
    of, results = story(steps=30), []
    for order in ((0, 1), (1, 0)):
        one = make()
        for step in range(30):
            one.step(epoch(of, step))
        radar = radar_reading(of, 20)
        aids = [[replace(radar, z=radar.z + 0.15)], gnss_readings(of, 20)]
        for which in order:
            one.add(20, aids[which])
        results.append(one)
    assert_same(*results)


def test_what_is_older_than_the_history_counts_as_the_oldest_kept() -> None:
    of = story(steps=40)
    old, oldest = make(history=10), make(history=10)
    for one, about in ((old, 3), (oldest, 30)):
        for step in range(40):
            one.step(epoch(of, step))
        one.add(about, [radar_reading(of, 30)])
    assert_same(old, oldest)


def test_what_has_not_begun_takes_nothing() -> None:
    one = make()
    one.add(0, [radar_reading(story(5), 0)])
    assert one.index is None
    np.testing.assert_array_equal(one.engine.x, make().engine.x)


def test_an_innovation_counts_once_however_often_it_is_made_again() -> None:
    """The radar's of steps 10 to 14 are made again for a receiver's sample of step 10; none is told a second time."""
    of, one = story(steps=20), make()
    for step in range(15):
        one.step(epoch(of, step))
        one.add(step, [radar_reading(of, step)])
    one.nis.clear()
    one.add(10, gnss_readings(of, 10))
    assert set(one.nis) == {"gnss_velocity", "gnss_position"}
    # A member without the sample keeps what was told before.
    told = one.nis["gnss_velocity"].copy()
    one.add(11, [replace(velocity_reading(of, 11), mask=np.array([True, False, True]))])
    assert one.nis["gnss_velocity"][1] == told[1]
    assert one.nis["gnss_velocity"][0] != told[0]


# --- members and engines --------------------------------------------------------------------------------------------


def cut(of: Story, index: int) -> Story:
    part = slice(index, index + 1)
    return replace(of, u=of.u[:, part], noise=of.noise[:, part])


def troubled(one: StrapdownFilter, of: Story, members: slice) -> list[FloatArray]:
    """Drive with trouble that differs by member; returns what of the radar was refused, step by step."""
    everyone, refused = np.arange(RUNS), []
    for step in range(len(of.speed)):
        one.step(epoch(of, step))
        lost = (everyone + step) % 7 == 0
        slips = (everyone == 1) & (step > 60)
        speed = replace(
            radar_reading(of, step), mask=~lost[members], variances=np.full((len(everyone[members]), 1), 1e-5)
        )
        z = np.where(slips[members, np.newaxis], 0.5, 1.0) * speed.z
        z[lost[members]] = np.nan
        one.add(step, [replace(speed, z=z)])
        if step % 5 == 0 and step >= 10:
            jump = np.where((everyone == 2) & (step > 80), 1.0, 0.0)[members]
            state = np.where((everyone == 0) & (100 < step < 150), 5.0, 4.0)[members]
            one.add(step - 5, gnss_readings(of, step - 5, jump_m=jump, state=state))
        refused.append(np.isnan(one.modes.refused_since["radar"]))
    return refused


@pytest.fixture(scope="module")
def together() -> tuple[StrapdownFilter, list[FloatArray]]:
    one = make()
    return one, troubled(one, story(), slice(None))


@pytest.mark.parametrize("engine", ["filterpy", "ensemble"])
@pytest.mark.parametrize("index", range(RUNS))
def test_a_member_alone_goes_its_way_with_either_engine(together, index: int, engine: EngineName) -> None:
    members = slice(index, index + 1)
    alone = make(1, engine=engine)
    refused = troubled(alone, cut(story(), index), members)
    for a, b in zip(refused, together[1], strict=True):
        np.testing.assert_array_equal(a, b[members])
    for a, b in ((alone.engine.x, together[0].engine.x), (alone.engine.P, together[0].engine.P)):
        np.testing.assert_allclose(a, b[members], rtol=1e-9, atol=1e-9)
    if index == 1:
        assert not all(each[0] for each in refused)


def test_a_sample_that_is_nowhere_changes_nothing() -> None:
    of, with_it, without = story(steps=30), make(), make()
    for step in range(30):
        for one in (with_it, without):
            one.step(epoch(of, step))
        nobody = np.zeros(RUNS, dtype=bool)
        nan = np.full((RUNS, 2), np.nan)
        with_it.add(step, [replace(velocity_reading(of, step), z=nan, mask=nobody)])
        with_it.add(max(step - 3, 0), [replace(position_reading(of, step, sigma_m=1.0), z=nan, mask=nobody)])
    assert_same(with_it, without)


# --- gates ----------------------------------------------------------------------------------------------------------


def jumping(one: StrapdownFilter, of: Story, steps: int, *, jump_from: int, jump_m: float) -> FloatArray:
    """East error of the filter (steps, R)."""
    errors = []
    for step in range(steps):
        one.step(epoch(of, step))
        one.add(step, [radar_reading(of, step)])
        if step % 5 == 0:
            one.add(step, gnss_readings(of, step, jump_m=jump_m if step >= jump_from else 0.0))
        errors.append(one.engine.x[:, E] - of.east[step])
    return np.array(errors)


def test_a_jump_of_a_metre_is_refused_then_taken_for_another_error_and_never_followed() -> None:
    """Errors are centimetres at most; the correlated error of the receiver takes the metre."""
    one = make()
    errors = jumping(one, story(400), 400, jump_from=200, jump_m=1.0)
    assert np.abs(errors[200:]).max() < 0.06
    assert np.isnan(one.modes.refused_since["gnss_position"]).all()  # it is used again
    np.testing.assert_allclose(one.engine.x[:, ANTENNA.at + 2], 1.0, atol=0.1)
    # While it was refused, and not a sample longer than reacquire_s.
    again = make()
    jumping(again, story(400), 200 + round(REACQUIRE_S / STEP_S) - 5, jump_from=200, jump_m=1.0)
    np.testing.assert_array_equal(again.modes.refused_since["gnss_position"], 200.0)


def test_without_gates_a_jump_is_followed() -> None:
    """A position believed to 3 mm, where the filter's own is known to centimetres, pulls it by far more than half of
    the metre, and its heading with it."""
    errors = jumping(make(gated=False), story(400), 400, jump_from=200, jump_m=1.0)
    assert np.abs(errors[200:] - errors[199]).max(axis=0).min() > 0.5


def test_a_single_wild_sample_leaves_no_trace() -> None:
    of = story(100)
    wild, calm = make(), make()
    for step in range(100):
        for one in (wild, calm):
            one.step(epoch(of, step))
            if step != 60 or one is calm:
                one.add(step, [radar_reading(of, step, mask=np.full(RUNS, step != 60))])
            else:
                one.add(step, [replace(radar_reading(of, step), z=np.full((RUNS, 1), 50.0))])
    assert_same(wild, calm)


def scaled(one: StrapdownFilter, of: Story, *, velocities: bool) -> FloatArray:
    """Forward speed (T, R) with a radar that reads 0.8 of the truth from step 100 on."""
    found = []
    for step in range(len(of.speed)):
        one.step(epoch(of, step))
        factor = 0.8 if step >= 100 else 1.0
        one.add(step, [reading("radar", SPEED, factor * radar_reading(of, step).z, 0.003)])
        if velocities and step % 5 == 0:
            one.add(step, [velocity_reading(of, step)])
        found.append(one.engine.x[:, VX])
    return np.array(found)


def test_a_speed_that_another_speaks_against_stays_refused() -> None:
    of = story(500)
    one = make()
    found = scaled(one, of, velocities=True)
    assert np.abs(found[150:] - 2.5).max() < 0.05
    np.testing.assert_array_equal(one.modes.refused_since["radar"], 100.0)


def test_the_only_speed_there_is_is_believed_again() -> None:
    """Refused for a second (to step 150), then used: the speed is at once about what the radar says. That the change
    was none of speed or bias takes the filter some seconds more, with another refusal now and then."""
    one = make()
    found = scaled(one, story(600), velocities=False)
    assert np.abs(found[149] - 2.5).max() < 0.15  # refused so far
    assert np.abs(found[160] - 2.0).max() < 0.15
    np.testing.assert_allclose(one.engine.x[:, RADAR.at], 2.0, atol=0.05)


# --- a receiver's error ---------------------------------------------------------------------------------------------


def error_variance(one: StrapdownFilter) -> FloatArray:
    return one.engine.P[:, ANTENNA.at + 2, ANTENNA.at + 2].copy()


def settled(of: Story, steps: int = 100) -> StrapdownFilter:
    one = make()
    jumping(one, of, steps, jump_from=steps, jump_m=0.0)
    return one


def test_another_fix_state_is_another_error_in_its_member_alone() -> None:
    """From fixed, 3 mm, to float, 0.25 m: the correlated error is drawn anew where the state has changed, and only
    there; position and velocity go on as they were, up to what the first float position says of them."""
    of = story(150)
    one = settled(of)
    before, east = error_variance(one), one.engine.x[:, E].copy()
    one.step(epoch(of, 100))
    state = np.array([4.0, 5.0, 4.0])
    sigma = np.where(state == 5.0, 0.25, 0.003)
    aid = position_reading(of, 100, state=state)
    assert aid.receiver is not None
    H = POSITION.H(one.engine.x)[1, 0].copy()
    H[ANTENNA.at + 2] = 0.0
    known = H @ one.engine.P[1] @ H
    one.add(100, [replace(aid, receiver=replace(aid.receiver, sigma_m=sigma))])
    after = error_variance(one)
    np.testing.assert_allclose(after[[0, 2]], before[[0, 2]], rtol=1e-3)
    # The new error, 0.25 m, is seen against where the antenna is known to be, and no better than that and the noise.
    assert after[1] == pytest.approx(1.0 / (1.0 / 0.25**2 + 1.0 / (known + 0.0008**2)), rel=1e-6)
    np.testing.assert_array_equal(one.modes.position_sigma_m["gnss"], sigma)
    np.testing.assert_allclose(one.engine.x[:, E] - east, 0.05, atol=0.01)  # a step of 2.5 m/s x 0.02 s


def test_an_error_that_grows_keeps_what_is_known_of_it_and_adds_the_rest() -> None:
    """Old corrections: from 3 to 50 mm in the same state, 50^2 - 3^2 mm^2 more; nothing when it is told again."""
    of = story(150)
    one = settled(of)
    before, mean = error_variance(one), one.engine.x[:, ANTENNA.at + 2].copy()
    nobody_used = 1e9  # a white noise so large that the update itself says nothing
    aid = position_reading(of, 100, sigma_m=0.05)
    blind = replace(aid, variances=np.full((RUNS, 2), nobody_used))
    one.add(99, [blind])
    np.testing.assert_allclose(error_variance(one) - before, 0.05**2 - 0.003**2, rtol=1e-3)
    np.testing.assert_allclose(one.engine.x[:, ANTENNA.at + 2], mean, atol=1e-6)
    one.add(99, [blind])
    np.testing.assert_allclose(error_variance(one) - before, 0.05**2 - 0.003**2, rtol=1e-3)


def test_going_back_over_a_change_of_the_fix_state_does_not_renew_it_twice() -> None:
    of = story(150)
    straight, back = settled(of), settled(of)
    for step in range(100, 120):
        for one in (straight, back):
            one.step(epoch(of, step))
            if step == 105:
                one.add(step, [position_reading(of, step, state=5.0, sigma_m=0.25)])
        straight.add(step, [radar_reading(of, step)])
    for step in reversed(range(100, 120)):
        back.add(step, [radar_reading(of, step)])
    assert_same(straight, back)
    np.testing.assert_array_equal(back.modes.fix_state["gnss"], 5.0)


# --- standing -------------------------------------------------------------------------------------------------------


def test_standing_tells_the_gyroscopes_biases() -> None:
    """Ten seconds of readings of noise 5e-4: the bias is known to 5e-4 / sqrt(500), three axes and members; it wanders
    by 1e-5 a root second meanwhile. Five sigma."""
    of = story(500)
    of = replace(of, standing=np.ones(500, dtype=bool), speed=np.zeros(500))
    of.u[..., 3:] += [0.005, -0.003, 0.004]
    one = make()
    one.engine.restore(np.zeros((RUNS, SIZE)), one.engine.P)
    for step in range(500):
        one.step(epoch(of, step))
    expected = np.hypot(5e-4 / np.sqrt(500), 1e-5 * np.sqrt(10.0))
    assert np.abs(one.engine.x[:, BG : BG + 3] - [0.005, -0.003, 0.004]).max() < 5.0 * expected
    assert np.abs(one.engine.x[:, VX : VZ + 1]).max() < 0.01


# --- anything at all ------------------------------------------------------------------------------------------------

SAMPLES = st.lists(
    st.tuples(
        st.integers(0, 39),
        st.sampled_from(["radar", "velocity", "position"]),
        st.integers(0, 35),
        st.sampled_from(["sound", "spike", "nan", "twice", "float"]),
    ),
    max_size=40,
)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(samples=SAMPLES, stop=st.booleans())
def test_whatever_arrives_the_covariance_stays_one_and_everything_finite(samples, stop: bool) -> None:
    of, one = story(40, runs=2, stop=stop), make(2)
    for step in range(40):
        one.step(epoch(of, step))
        for about, kind, delay, trouble in samples:
            if min(about + delay, 39) != step:
                continue
            state = 5.0 if trouble == "float" else 4.0
            aid = {
                "radar": radar_reading(of, about),
                "velocity": velocity_reading(of, about),
                "position": position_reading(of, about, state=state, sigma_m=0.25 if trouble == "float" else 0.003),
            }[kind]
            if trouble == "spike":
                aid = replace(aid, z=aid.z + 1e3)
            if trouble == "nan":
                z = aid.z.copy()
                z[1] = np.nan
                aid = replace(aid, z=z, mask=np.array([True, False]))
            for _ in range(2 if trouble == "twice" else 1):
                one.add(about, [aid])
        x, P = one.engine.x, one.engine.P
        assert np.isfinite(x).all()
        assert np.isfinite(P).all()
        scale = np.sqrt(np.einsum("rii->ri", P))
        assert (scale > 0.0).all()
        correlation = P / (scale[:, :, np.newaxis] * scale[:, np.newaxis, :])
        np.testing.assert_allclose(correlation, correlation.transpose(0, 2, 1), atol=1e-9)
        assert np.linalg.eigvalsh(correlation).min() > -1e-9
