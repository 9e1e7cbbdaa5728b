"""Reaction time and lag of estimates whose dynamics are known: what a ramp does to them is worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.small_scenario import small_scenario_toml
from twin import scenario as scenario_files
from twin.recording import Recording, Stream
from twin.scoring import metrics, score
from twin.scoring.ramps import NAMES, RampTally, find_ramps
from twin.signals import FloatArray

DT_NS = 20_000_000
DT_S = 0.02
ACCELERATION = 1.0
UP, DOWN = (
    ("speed.reaction_accelerating_s", "speed.lag_accelerating_s"),
    ("speed.reaction_braking_s", "speed.lag_braking_s"),
)


def speed_of(*pieces: tuple[float, float], step_s: float = DT_S) -> tuple[np.ndarray, FloatArray]:
    """Times (T,) in ns and speed (T,) through pieces (seconds, speed at the end), linear within each."""
    ends = np.cumsum([0.0, *(seconds for seconds, _ in pieces)])
    t_s = np.arange(0.0, ends[-1] - 1e-9, step_s)
    return np.round(t_s * 1e9).astype(np.int64), np.interp(t_s, ends, [0.0, *(speed for _, speed in pieces)])


STOP_AND_GO = ((10.0, 0.0), (2.5, 2.5), (10.0, 2.5), (2.5, 0.0), (10.0, 0.0))
"""2.5 m/s up and down at 1 m/s^2, in time to settle."""


def first_order(speed: FloatArray, tau_s: float) -> FloatArray:
    """Response of a first-order lag, exact for a speed that is linear between its samples."""
    keep = math.exp(-DT_S / tau_s)
    found = np.empty_like(speed)
    found[0] = speed[0]
    for k in range(1, len(speed)):
        slope = (speed[k] - speed[k - 1]) / DT_S
        found[k] = speed[k] - slope * tau_s + keep * (found[k - 1] - speed[k - 1] + slope * tau_s)
    return found


def delay_at_half(tau_s: float, half_s: float) -> float:
    """d = tau (1 - exp(-(T / 2 + d) / tau)), by iteration."""
    delay = 0.0
    for _ in range(100):
        delay = tau_s * (1.0 - math.exp(-(half_s + delay) / tau_s))
    return delay


def measured(t_ns, speed: FloatArray, estimate: FloatArray, *, piece: int | None = None) -> dict[str, FloatArray]:
    errors = (estimate.T - speed).T
    errors = errors[:, np.newaxis] if errors.ndim == 1 else errors
    tally = RampTally(errors.shape[1], acceleration_m_s2=ACCELERATION, smallest_m_s=0.5)
    for at in range(0, len(t_ns), piece or len(t_ns)):
        upto = slice(at, at + (piece or len(t_ns)))
        tally.add(t_ns[upto], speed[upto], errors[upto])
    return tally.metrics()


@pytest.mark.parametrize("tau_s", [0.2, 0.7, 1.0])
def test_a_first_order_lag_reacts_in_tau_ln_20_e_over_the_step(tau_s: float) -> None:
    """e = a tau (1 - exp(-T / tau)) at the end of the ramp decays to D / 20 in tau ln(20 e / D); it lags by tau."""
    t_ns, speed = speed_of(*STOP_AND_GO)
    found = measured(t_ns, speed, first_order(speed, tau_s))
    left = ACCELERATION * tau_s * (1.0 - math.exp(-2.5 / tau_s))
    for reaction, lag in (UP, DOWN):
        # One sample for the end of the ramp, one for the time at which it comes inside.
        assert found[reaction][0] == pytest.approx(tau_s * math.log(20.0 * left / 2.5), abs=2.0 * DT_S)
        assert found[reaction.replace("reaction", "delay")][0] == pytest.approx(
            delay_at_half(tau_s, 1.25), abs=DT_S / 2.0
        )
        # exp(-5 / tau) of the error is left after the settling.
        assert found[lag][0] == pytest.approx(tau_s, abs=0.02)


def test_accelerating_and_braking_are_told_apart() -> None:
    """0.2 s upwards, 0.7 s downwards, as the radar's lags."""
    t_ns, speed = speed_of(*STOP_AND_GO)
    half = int(18.0 / DT_S)
    estimate = np.concatenate([first_order(speed[:half], 0.2), first_order(speed[half:], 0.7)])
    found = measured(t_ns, speed, estimate)
    assert found[UP[1]][0] == pytest.approx(0.2, abs=0.02)
    assert found[DOWN[1]][0] == pytest.approx(0.7, abs=0.02)
    assert found[DOWN[0]][0] > 3.0 * found[UP[0]][0] > 0.0


def test_an_error_within_the_band_is_no_reaction_time_but_still_a_lag() -> None:
    """0.1 s behind 1 m/s^2 are 0.1 m/s, less than 5 % of 2.5 m/s."""
    t_ns, speed = speed_of(*STOP_AND_GO)
    found = measured(t_ns, speed, first_order(speed, 0.1))
    assert found[UP[0]][0] == found[DOWN[0]][0] == 0.0
    assert found[UP[1]][0] == pytest.approx(0.1, abs=0.02)


def test_a_delay_lags_by_itself_and_an_estimate_ahead_by_less_than_nothing() -> None:
    t_ns, speed = speed_of(*STOP_AND_GO)
    late, early = np.roll(speed, 15), np.roll(speed, -15)
    found = measured(t_ns, speed, np.stack([late, early, speed], axis=1))
    # One sample for the beginning of the ramp, whose speed half of the step is counted from.
    np.testing.assert_allclose(found["speed.delay_braking_s"], [0.3, -0.3, 0.0], atol=DT_S)
    # The early one's rise begins before the ramp, which is not seen: half of 0.3 s squared over 2.5 m/s.
    np.testing.assert_allclose(found[UP[1]], [0.3, -0.3 + 0.3**2 / 2.0 / 2.5, 0.0], atol=0.02)
    # Late by 0.3 s at 1 m/s^2 it comes within 0.125 m/s of the end speed 0.3 - 0.125 s after the ramp.
    np.testing.assert_allclose(found[UP[0]], [0.175, 0.0, 0.0], atol=2.0 * DT_S)


def test_who_never_settles_never_reacts_and_who_is_not_known_has_no_figure() -> None:
    t_ns, speed = speed_of(*STOP_AND_GO)
    estimate = np.stack([speed + 0.13, speed + 0.12, speed], axis=1)
    estimate[int(14.0 / DT_S), 2] = np.nan
    found = measured(t_ns, speed, estimate)
    np.testing.assert_array_equal(found[UP[0]], [math.inf, 0.0, math.nan])
    assert math.isnan(found[UP[1]][2])
    # A constant error e adds -e (T + 5 s) / D while accelerating, the opposite while braking.
    np.testing.assert_allclose(found[UP[1]][:2], [-0.13 * 7.5 / 2.5, -0.12 * 7.5 / 2.5], atol=0.01)
    np.testing.assert_allclose(found[DOWN[1]][:2], [0.13 * 7.5 / 2.5, 0.12 * 7.5 / 2.5], atol=0.01)


def test_half_of_the_step_that_is_never_reached_is_a_delay_without_end() -> None:
    t_ns, speed = speed_of(*STOP_AND_GO)
    found = measured(t_ns, speed, np.minimum(speed, 1.0))
    assert found["speed.delay_accelerating_s"][0] == math.inf


def test_a_filter_that_follows_its_sensor_lags_as_it_does_but_begins_before_it() -> None:
    """Accelerations known, the sensor behind by tau = 0.7 s, followed with the gain K: two lags, tau and T / K.

    Their error while the acceleration lasts is a tau (1 - (c exp(-t / c) - tau exp(-t / tau)) / (c - tau)), c = T / K.
    """
    tau_s, gain = 0.7, 0.0311
    t_ns, speed = speed_of(*STOP_AND_GO)
    sensed = first_order(speed, tau_s)
    estimate = np.zeros_like(speed)
    for k in range(1, len(speed)):
        predicted = estimate[k - 1] + speed[k] - speed[k - 1]
        estimate[k] = predicted + gain * (sensed[k] - predicted)
    sensor, fused = (measured(t_ns, speed, each) for each in (sensed, estimate))
    assert fused[UP[1]][0] == pytest.approx(sensor[UP[1]][0], abs=0.02)
    c, behind = DT_S / gain, 0.0
    for _ in range(100):
        t = 1.25 + behind
        behind = tau_s * (1.0 - (c * math.exp(-t / c) - tau_s * math.exp(-t / tau_s)) / (c - tau_s))
    assert fused["speed.delay_accelerating_s"][0] == pytest.approx(behind, abs=DT_S / 2.0)
    assert behind < 0.9 * sensor["speed.delay_accelerating_s"][0]
    assert fused[UP[0]][0] > sensor[UP[0]][0]


def test_an_error_that_comes_back_counts_to_its_last_time() -> None:
    t_ns, speed = speed_of(*STOP_AND_GO)
    estimate = speed.copy()
    estimate[(t_ns >= 14_000_000_000) & (t_ns < 14_500_000_000)] += 0.2  # 1.5 to 2 s after the ramp
    assert measured(t_ns, speed, estimate)[UP[0]][0] == pytest.approx(2.0, abs=1.5 * DT_S)


def test_ramps_begin_and_end_where_the_speed_changes_and_small_ones_do_not_count() -> None:
    t_ns, speed = speed_of((5.0, 0.0), (2.0, 2.0), (8.0, 2.0), (0.4, 1.6), (8.0, 1.6), (1.6, 0.0), (3.0, 0.0))
    speed = speed + 0.02 * np.sin(2.0 * math.pi * 1.7 * t_ns / 1e9)  # what rough ground does: 0.2 m/s^2
    found = find_ramps(t_ns, speed, acceleration_m_s2=1.0, smallest_m_s=0.5)
    times = [(t_ns[ramp.begin] / 1e9, t_ns[ramp.end] / 1e9) for ramp in found]
    np.testing.assert_allclose(times, [(5.0, 7.0), (23.4, 25.0)], atol=0.05)
    assert [ramp.step_m_s for ramp in found] == pytest.approx([2.0, -1.6], abs=0.06)
    assert all(ramp.is_over for ramp in found)


def test_a_ramp_that_the_run_cuts_off_is_not_judged() -> None:
    t_ns, speed = speed_of((5.0, 0.0), (3.0, 3.0))
    found = measured(t_ns, speed, 0.0 * speed)
    assert all(math.isnan(found[name][0]) for name in NAMES)


def test_the_next_ramp_ends_the_settling_of_the_one_before() -> None:
    """A lag of 0.7 s with 1 s between the ramps: what the second adds is not charged to the first."""
    t_ns, speed = speed_of((5.0, 0.0), (2.5, 2.5), (1.0, 2.5), (2.5, 0.0), (10.0, 0.0))
    estimate = first_order(speed, 0.2)
    found = measured(t_ns, speed, estimate)
    assert found[UP[1]][0] == pytest.approx(0.2, abs=0.02)
    assert found[DOWN[1]][0] == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("piece", [1, 7, 50, 333, 1200])
def test_pieces_add_up_to_the_whole(piece: int) -> None:
    rng = np.random.default_rng(piece)
    t_ns, speed = speed_of(*STOP_AND_GO, (3.0, 3.0), (1.0, 3.0), (2.0, 1.0), (6.5, 1.0), (1.0, 0.0), (0.8, 0.0))
    speed = speed + 0.01 * np.cumsum(rng.normal(size=len(speed))) * DT_S
    estimate = np.stack([first_order(speed, tau_s) for tau_s in (0.2, 0.7, 2.0)], axis=1)
    estimate += 0.01 * rng.normal(size=estimate.shape)
    whole, parts = measured(t_ns, speed, estimate), measured(t_ns, speed, estimate, piece=piece)
    for name in NAMES:
        assert np.isfinite(whole[name][0])
        np.testing.assert_allclose(parts[name], whole[name], rtol=1e-12, err_msg=name)


def test_no_more_is_kept_than_the_last_ramp() -> None:
    t_ns, speed = speed_of(*STOP_AND_GO * 20)
    tally = RampTally(1, acceleration_m_s2=ACCELERATION, smallest_m_s=0.5)
    for at in range(0, len(t_ns), 100):
        tally.add(t_ns[at : at + 100], speed[at : at + 100], np.zeros((len(speed[at : at + 100]), 1)))
        # Half a window before the ramp, the ramp, the settling, half a window after, the piece.
        assert len(tally._t_ns) <= (0.5 + 2.5 + 5.0 + 0.5 + 2.0) / DT_S + 10


def a_recording(smallest_ramp_m_s: float | None) -> Recording:
    t_ns, speed = speed_of(*STOP_AND_GO)

    def stream(values: FloatArray) -> Stream:
        return Stream(columns=("speed_m_s",), t_ns=t_ns, values=values[:, np.newaxis, np.newaxis])

    scoring = {} if smallest_ramp_m_s is None else {"smallest_ramp_m_s": smallest_ramp_m_s}
    return Recording(
        scenario_toml=small_scenario_toml(scoring=scoring, driver={"acceleration_m_s2": ACCELERATION}),
        scenario_name="made_up",
        seed=1,
        runs=(0,),
        streams={"truth": stream(speed), "estimates/one": stream(first_order(speed, 0.7))},
        ended_t_s=35.0,
    )


def test_a_scenario_that_asks_gets_them_and_no_other() -> None:
    asked, not_asked = score(a_recording(1.0)).metrics, score(a_recording(None)).metrics
    assert asked["one.speed.lag_braking_s"] == pytest.approx(0.7, abs=0.02)
    assert set(asked) - set(not_asked) == {f"one.{name}" for name in NAMES}
    recording = a_recording(1.0)
    parsed = scenario_files.loads(recording.scenario_toml, where="made_up")
    assert list(asked) == metrics.metric_names(parsed, recording.truth.columns, {"one": ("speed_m_s",)})
