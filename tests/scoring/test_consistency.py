"""NEES: by hand, across the wrap of an angle, where a filter claims certainty, and of a filter known to be right."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from tests.small_scenario import small_scenario
from twin.recording import Stream, covariance_column
from twin.scenario import Scenario, resolve
from twin.scoring.compared import compare, sampled_nees
from twin.scoring.consistency import NEES_PERIOD_NS, nees, nis_degrees, state_columns
from twin.scoring.ensemble import over_worlds
from twin.scoring.scorer import Scorer
from twin.signals import HEADING, NS_PER_S, POSITION, SPEED, FloatArray, IntArray

STATES = (SPEED, HEADING)
ROW = np.array([0])


def _stream(states: Sequence[str], t_ns: IntArray, x: FloatArray, P: FloatArray | None = None) -> Stream:
    """States (T, n) and, of an estimate, their covariance (T, n, n)."""
    columns, values = list(states), [x]
    if P is not None:
        for first, one in enumerate(states):
            for second in range(first, len(states)):
                columns.append(covariance_column(one, states[second]))
                values.append(P[:, first, second, np.newaxis])
    return Stream(columns=tuple(columns), t_ns=t_ns, values=np.concatenate(values, axis=1)[:, np.newaxis])


def _nees(error: tuple[float, float], P: FloatArray, truth: tuple[float, float] = (0.0, 0.0)) -> float:
    true, t_ns = np.array([truth]), np.array([0])
    estimate = _stream(STATES, t_ns, true + np.array([error]), P[np.newaxis])
    assert state_columns(estimate.columns) == list(STATES)
    return float(nees(_stream(STATES, t_ns, true), estimate, STATES, ROW, ROW)[0, 0])


def test_nees_of_two_correlated_states_by_hand() -> None:
    # P = [[4, 2], [2, 3]]: det 8, P^-1 = [[3, -2], [-2, 4]] / 8; e = (1, 2): (3 - 8 + 16) / 8 = 11 / 8.
    # Without the correlation it would be 1/4 + 4/3.
    assert _nees((1.0, 2.0), np.array([[4.0, 2.0], [2.0, 3.0]])) == pytest.approx(11.0 / 8.0, rel=1e-12)
    assert _nees((1.0, 2.0), np.diag([4.0, 3.0])) == pytest.approx(1.0 / 4.0 + 4.0 / 3.0, rel=1e-12)
    # Units do not matter: the same in mm/s and with a variance of 1e-8.
    assert _nees((1e-4, 2e-4), 1e-8 * np.array([[4.0, 2.0], [2.0, 3.0]])) == pytest.approx(11.0 / 8.0, rel=1e-9)


def test_the_error_of_an_angle_is_the_short_way_round() -> None:
    # The estimate at -pi + 0.05, the truth at pi - 0.05: 0.1 rad apart, one sigma, and not 2 pi - 0.1.
    assert _nees((0.0, 0.1 - 2.0 * math.pi), np.diag([1.0, 0.01]), (0.0, math.pi - 0.05)) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "P",
    [np.diag([0.0, 0.01]), np.zeros((2, 2)), np.ones((2, 2))],
    ids=["one state known", "all known", "a combination known"],
)
def test_certainty_gives_no_ratio(P: FloatArray) -> None:
    # As after an update with R = 0 (the speed at standstill): e' P^-1 e has no value, however small the error.
    assert math.isnan(_nees((0.0, 0.1), P))
    assert math.isnan(_nees((0.5, 0.1), P))


def test_certain_instants_are_left_out_of_the_mean_and_nees_is_taken_once_a_second() -> None:
    # 3.5 s at 4 Hz: full seconds 0, 1, 2, 3. Errors of 0, 1, 2, 3 sigma there, and at 2 s the filter claims certainty:
    # the mean is (0 + 1 + 9) / 3; what lies between the seconds (100 sigma) does not count.
    t_ns = np.arange(14) * (NS_PER_S // 4)
    full = t_ns % NEES_PERIOD_NS == 0
    error = np.where(full, t_ns / NS_PER_S, 100.0)
    P = np.ones((14, 1, 1))
    P[8] = 0.0
    truth = _stream((SPEED,), t_ns, np.zeros((14, 1)))
    estimate = _stream((SPEED,), t_ns, error[:, np.newaxis], P)
    times, values = sampled_nees(truth, estimate, compare(truth, estimate, [SPEED]))
    assert times.tolist() == [0, NS_PER_S, 2 * NS_PER_S, 3 * NS_PER_S]
    np.testing.assert_allclose(values[:, 0], [0.0, 1.0, math.nan, 9.0])
    scorer = Scorer(_scenario(), truth.columns, {"kalman": estimate.columns})
    scorer.add(truth, {"kalman": estimate})
    assert scorer.metrics()["kalman.consistency.nees"] == pytest.approx(10.0 / 3.0)


# --- a filter that is right by construction --------------------------------------------------------------------------

AXIS = (POSITION[0], SPEED)
STEP_S = 0.1
F = np.array([[1.0, STEP_S], [0.0, 1.0]])
Q = 0.05 * np.array([[STEP_S**3 / 3.0, STEP_S**2 / 2.0], [STEP_S**2 / 2.0, STEP_S]])
"""White acceleration of 0.05 m^2/s^3 (Bar-Shalom, Li and Kirubarajan 2001, eq 6.2.2-12)."""
R = 0.04
P0 = np.diag([1.0, 0.25])
WORLDS, SECONDS = 60, 40


def _scenario() -> Scenario:
    return resolve(small_scenario(), where="test")


def _tracked(rng: np.random.Generator, claim: float) -> tuple[Stream, Stream]:
    """Truth and estimate of a point that moves by F and Q and whose position is measured with variance R."""
    steps = round(SECONDS / STEP_S)
    x = rng.multivariate_normal([0.0, 1.0], P0)
    estimate, P = np.array([0.0, 1.0]), P0
    truths, estimates, covariances = [], [], []
    for _ in range(steps):
        x = F @ x + rng.multivariate_normal([0.0, 0.0], Q)
        estimate, P = F @ estimate, F @ P @ F.T + Q
        gain = P[:, 0] / (P[0, 0] + R)
        estimate = estimate + gain * (x[0] + math.sqrt(R) * rng.normal() - estimate[0])
        P = P - np.outer(gain, P[0])
        truths.append(x)
        estimates.append(estimate)
        covariances.append(claim * P)
    t_ns = np.arange(1, steps + 1) * round(STEP_S * NS_PER_S)
    return _stream(AXIS, t_ns, np.array(truths)), _stream(AXIS, t_ns, np.array(estimates), np.array(covariances))


@pytest.mark.parametrize("claim", [1.0, 0.25])
def test_a_matched_kalman_filter_is_inside_its_bounds_and_one_of_a_quarter_of_its_covariance_is_not(
    claim: float,
) -> None:
    rng = np.random.default_rng(7)
    worlds: list[tuple[IntArray, FloatArray]] = []

    def watch(name: str, t_ns: IntArray, values: FloatArray) -> None:
        if name == "kalman.nees":
            worlds.append((t_ns, values[:, 0]))

    means = []
    for _ in range(WORLDS):
        truth, estimate = _tracked(rng, claim)
        scorer = Scorer(_scenario(), truth.columns, {"kalman": estimate.columns}, watch=watch)
        scorer.add(truth, {"kalman": estimate})
        means.append(scorer.metrics()["kalman.consistency.nees"][0])
    found = over_worlds("nees", worlds, len(AXIS))
    assert found is not None
    assert (found.degrees, found.worlds, len(worlds[0][0])) == (2, WORLDS, SECONDS)
    assert found.mean == pytest.approx(np.mean(means))
    # The mean of 60 chi-square values of 2 degrees has a standard deviation of sqrt(4 / 60) = 0.258: bounds 2 -+ 0.51.
    assert found.low == pytest.approx(1.53, abs=0.03)
    assert found.high == pytest.approx(2.54, abs=0.03)
    # The filter's error decays as e^{-w t / sqrt(2)}, w = (q / (R T))^{1/4} = 1.9 rad/s: after a second at most 1/e is
    # left, and its square of the correlation of NEES. 40 instants are worth 40 (1 - e^-2) / (1 + e^-2) = 30 at least:
    # standard error of the mean over all 0.258 / sqrt(30) = 0.047, of the share inside sqrt(0.95 * 0.05 / 30) = 4 %.
    if claim == 1.0:
        assert found.mean == pytest.approx(2.0, abs=4 * 0.047)
        assert found.inside >= 0.95 - 4 * 0.04
    else:
        # Four times as large: 8 -+ 1.03 at one instant, the bound is 5.3 standard deviations away.
        assert found.mean == pytest.approx(8.0, abs=4 * 4 * 0.047)
        assert found.inside == 0.0


def test_positions_and_velocities_have_two_degrees_of_freedom_and_speeds_one() -> None:
    columns = ["nis_gyro", "nis_radar", "nis_gnss_speed", "nis_gnss_velocity", "nis_gnss_position"]
    assert [nis_degrees(column) for column in columns] == [1, 1, 1, 2, 2]
