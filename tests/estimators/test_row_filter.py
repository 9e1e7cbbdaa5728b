"""Offset and heading between the rows, carried on from scan to scan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.estimators.robot import COLUMNS as OTHERS
from tests.estimators.robot import SLOT_M, TRACK_M, G, make_setup, measure
from tests.estimators.rows import WIDTH_M, Pose, lane, noisy, scan, setup_of, turn
from twin.errors import BadInputError
from twin.estimators.row_filter import RowFilter, RowFilterConfig
from twin.signals import NS_PER_S, FloatArray, Measurement

SHEET = {"gyro_noise_rad_s": 4.4e-4, "gyro_bias_rad_s": 0.047, "accel_noise_m_s2": 0.02}
DT_S = 0.02
STAND_S = 3.0


def make(*kinds: str, runs: int = 1, **changes: Any) -> RowFilter:
    infos = make_setup(*kinds, datasheet=SHEET).sensors
    table = {"kind": "row_filter", "sensors": ["lidar", *kinds], "rows": {"lane_width_m": WIDTH_M}, **changes}
    return RowFilter(RowFilterConfig.model_validate(table), setup_of(*infos.values(), runs=runs))


class Robot:
    """Stands, then drives with a given yaw rate at a given speed; tells an estimator what its sensors say."""

    def __init__(
        self,
        estimator: RowFilter,
        *,
        yaw_rate: Callable[[float], float] = lambda _: 0.0,
        speed: float = 0.5,
        offset_m: float = 0.0,
        gyro_bias: float = 0.0,
        noise: float = 0.0,
        trees: FloatArray | None = None,
        kinds: tuple[str, ...] = ("imu", "wheel_encoders"),
        latency_s: float = 0.0,
        blind: Callable[[float], bool] = lambda _: False,
        seed: int = 0,
    ) -> None:
        self._estimator, self._yaw_rate, self._speed = estimator, yaw_rate, speed
        self._trees = lane() if trees is None else trees
        self._kinds, self._latency_s, self._blind = kinds, latency_s, blind
        self._bias, self._noise, self._rng = gyro_bias, noise, np.random.default_rng(seed)
        self._poses = [np.array([0.0, offset_m, 0.0])]
        self._late: list[Measurement] = []
        self.truth: list[Pose] = []
        self.said: list[FloatArray] = []
        self.sigma: list[FloatArray] = []
        self.covariance: list[FloatArray] = []
        self.times: list[float] = []

    def go(self, duration_s: float) -> Robot:
        for _ in range(round(duration_s / DT_S)):
            self._step()
        return self

    def _step(self) -> None:
        k = len(self._poses)
        t = k * DT_S
        moving = t > STAND_S
        rate, speed = (self._yaw_rate(t), self._speed) if moving else (0.0, 0.0)
        east, north, heading = self._poses[-1]
        middle = heading + 0.5 * rate * DT_S
        way = speed * DT_S
        self._poses.append(np.array([east + way * np.cos(middle), north + way * np.sin(middle), heading + rate * DT_S]))
        for measurement in self._heard(k, rate):
            self._estimator.process(measurement)
        if k % 10 == 0 and not self._blind(t):
            self._late.append(scan(noisy(self._turn(t), self._rng) if self._noise else self._turn(t), t))
        while self._late and self._late[0].t_ns + self._latency_s * NS_PER_S <= t * NS_PER_S + 1:
            self._estimator.process(self._late.pop(0))
        estimate = self._estimator.estimate(round(t * NS_PER_S))
        self.truth.append(tuple(self._poses[-1].tolist()))
        self.said.append(estimate.values[0])
        self.sigma.append(estimate.sigmas[0])
        self.covariance.append(estimate.covariance[0])
        self.times.append(t)

    def _turn(self, t: float) -> FloatArray:
        return turn(self._trees, self._pose_at, t)

    def _pose_at(self, t: float) -> Pose:
        place = min(max(t / DT_S, 0.0), len(self._poses) - 1.0)
        before = min(int(place), len(self._poses) - 2)
        share = place - before
        pose = (1.0 - share) * self._poses[before] + share * self._poses[before + 1]
        return float(pose[0]), float(pose[1]), float(pose[2])

    def _heard(self, k: int, rate: float) -> list[Measurement]:
        poses = np.array(self._poses)
        turned = poses[-1, 2]
        way = np.sum(np.hypot(*np.diff(poses[:, :2], axis=0).T)) if k else 0.0
        slots = np.floor((way + 0.5 * TRACK_M * np.array([-turned, turned])) / SLOT_M + 0.5)
        shake = self._noise * self._rng.normal(size=6) * np.repeat([0.02, 4.4e-4], 3)
        imu = np.array([0.0, self._speed * rate, G, 0.0, 0.0, rate + self._bias]) + shake
        values = {"imu": imu, "wheel_encoders": slots}
        return [measure(kind, round(k * DT_S * NS_PER_S), values[kind]) for kind in self._kinds]

    def errors(self, from_s: float = 0.0) -> FloatArray:
        """(T, 2) of offset and heading."""
        chosen = np.array(self.times) > from_s
        said, truth = np.array(self.said)[:, :2], np.array(self.truth)[:, 1:]
        return (said - truth)[chosen]

    def column(self, name: str) -> FloatArray:
        return np.array(self.said)[:, self._estimator.columns.index(name)]


def test_the_columns_are_the_truths_and_what_they_rest_on() -> None:
    assert make().columns == (
        "lane_offset_m",
        "lane_heading_rad",
        "rows_seen",
        "trunks_seen",
        "fit_offset_m",
        "fit_heading_rad",
        "since_fix_s",
    )
    assert make("imu", "wheel_encoders").columns[-1] == "since_fix_m"
    assert OTHERS["wheel_encoders"] == ("left_slots", "right_slots")


@pytest.mark.parametrize(
    ("kinds", "given"),
    [(("imu",), "1 of kind 'imu', 0 of kind 'wheel_encoders'"), (("wheel_encoders",), "0 of kind 'imu', 1 of kind")],
)
def test_inertial_unit_and_wheels_go_together(kinds: tuple[str, ...], given: str) -> None:
    with pytest.raises(BadInputError, match=given):
        make(*kinds)


def test_no_turn_of_the_inertial_unit_may_be_left_out() -> None:
    with pytest.raises(BadInputError, match=r"rate_hz = 20: has to be at least the 50 Hz of 'imu'"):
        make("imu", "wheel_encoders", rate_hz=20.0)


def test_a_gyroscope_bias_that_is_not_known_yet_is_allowed_for() -> None:
    # Three degrees a second, before anything could be learnt: NEES of every instant of the standstill stays small.
    robot = Robot(make("imu", "wheel_encoders"), gyro_bias=0.05, noise=1.0).go(2.9)
    errors, P = robot.errors(0.3), np.array(robot.covariance)[np.array(robot.times) > 0.3]
    nees = np.einsum("ti,tij,tj->t", errors, np.linalg.inv(P), errors)
    assert nees.max() < 18.4  # once in 10 000 draws


def test_a_scan_is_straightened_while_the_robot_turns() -> None:
    # At 1 rad/s the first beam of a turn is 0.2 rad old: rows fitted to the raw scan point 0.1 rad the wrong way.
    def swing(t: float) -> float:
        return float(np.cos(4.0 * (t - STAND_S)))

    fused = Robot(make("imu", "wheel_encoders"), yaw_rate=swing).go(9.0)
    alone = Robot(make(), yaw_rate=swing, kinds=()).go(9.0)
    at_scan = np.isclose(np.array(fused.times) % 0.2, 0.0, atol=1e-6) & (np.array(fused.times) > 5.0)
    truth = np.array(fused.truth)[at_scan, 2]
    straightened = fused.column("fit_heading_rad")[at_scan] - truth
    raw = alone.column("fit_heading_rad")[at_scan] - truth
    assert np.sqrt(np.mean(straightened**2)) < 0.006
    assert np.sqrt(np.mean(raw**2)) > 5.0 * np.sqrt(np.mean(straightened**2))


def test_late_scans_are_moved_to_now() -> None:
    late = Robot(
        make("imu", "wheel_encoders"), yaw_rate=lambda t: 0.3 * float(np.cos(2.0 * (t - STAND_S))), latency_s=0.3
    ).go(9.0)
    assert np.abs(late.errors(4.0)).max(axis=0) == pytest.approx([0.0, 0.0], abs=0.01)


def test_without_rows_it_reckons_on_with_a_growing_sigma() -> None:
    for seed in range(3):
        robot = Robot(
            make("imu", "wheel_encoders"),
            yaw_rate=lambda t: 0.02 * float(np.cos(0.7 * (t - STAND_S))),
            gyro_bias=0.03,
            noise=1.0,
            blind=lambda t: t > 8.0,
            seed=seed,
        ).go(20.0)
        sigma = np.array(robot.sigma)
        seen = robot.column("rows_seen")
        assert seen[round(7.0 / DT_S)] == 2.0
        assert (seen[round(8.6 / DT_S) :] == 0.0).all()
        assert (np.diff(sigma[round(8.0 / DT_S) :, 0]) >= 0.0).all()
        assert robot.column("since_fix_m")[-1] == pytest.approx(6.0, abs=0.05)
        assert robot.column("since_fix_s")[-1] == pytest.approx(12.0, abs=0.05)
        # Straight rows: the fits' white part alone, 1 mm and 1 mrad a scan, but the filter allows for crooked ones.
        assert np.abs(robot.errors(19.9)[:, 0]).max() < 3.0 * sigma[-1, 0]
        assert sigma[-1, 0] < 0.06


def test_a_drift_that_was_not_learnt_at_rest_is_learnt_from_the_rows() -> None:
    # Never at rest: 0.02 rad/s of bias stay in the heading filter, and go into RATE.
    moved = Robot(make("imu", "wheel_encoders", heading=_restless()), gyro_bias=0.02, noise=1.0).go(15.0)
    assert np.abs(moved.errors(12.0)[:, 1]).max() < 0.02
    assert np.abs(moved.errors(12.0)[:, 0]).max() < 0.02


def _restless() -> dict[str, Any]:
    return {
        "kind": "heading_filter",
        "sensors": ["imu", "wheel_encoders"],
        "preparation": {"standstill_s": 0.0, "gyro_offset": False, "accelerometer_offset": False},
        "wheels": {"drift_rad_rtm": 1.0},
    }


def test_a_lidar_alone_holds_its_fit_and_does_not_trust_it_for_long() -> None:
    robot = Robot(make(), kinds=(), noise=1.0, blind=lambda t: t > 6.0).go(8.0)
    at = round(6.0 / DT_S) - 1
    assert np.abs(robot.errors(3.5)[:50, 0]).max() < 0.02
    before, after = robot.sigma[at][0], robot.sigma[-1][0]
    # 0.1 m per root of a second of sideways motion that nobody sees, for 2 s.
    assert after == pytest.approx(np.hypot(before, 0.1 * np.sqrt(2.0)), rel=0.1)
    assert robot.column("rows_seen")[-1] == 0.0


def test_members_differ_by_their_own_scans_only() -> None:
    together, alone = make(runs=2), make()
    rng = np.random.default_rng(1)
    for k in range(1, 30):
        t = 0.2 * k
        ranges = noisy(turn(lane(), lambda t: (0.3 * t, 0.1, 0.05), t), rng, 2)
        together.process(scan(ranges, t, valid=np.array([True, k % 3 > 0])))
        alone.process(scan(ranges[:1], t))
        both, one = (each.estimate(round(t * NS_PER_S)) for each in (together, alone))
        np.testing.assert_allclose(both.values[:1], one.values, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(both.sigmas[:1], one.sigmas, rtol=0.0, atol=1e-9)


def test_a_filter_that_is_contradicted_for_long_begins_anew() -> None:
    estimator = make("imu", "wheel_encoders")
    for k in range(1, 1001):
        t_ns = round(k * DT_S * NS_PER_S)
        estimator.process(measure("imu", t_ns, np.array([0.0, 0.0, G, 0.0, 0.0, 0.0])))
        estimator.process(measure("wheel_encoders", t_ns, np.zeros(2)))
        if k % 10 == 0:
            carried = 0.2 if k > 500 else 0.0  # somebody lifts the robot over
            estimator.process(scan(turn(lane(), lambda _, e=carried: (5.0, e, 0.0), k * DT_S), k * DT_S))
        estimate = estimator.estimate(t_ns)
        if k == 505:
            assert abs(estimate.values[0, 0]) < 0.02
    assert estimate.values[0, 0] == pytest.approx(0.2, abs=0.02)


def _weaving(amplitude: float, frequency: float) -> Callable[[float], float]:
    return lambda t: amplitude * float(np.cos(frequency * (t - STAND_S)))


@pytest.mark.slow
def test_nees_over_worlds() -> None:
    # Each world has its own crooked lane, bias and noise. Trees come and go within 6 m: 20 m are about 3 independent
    # windows, so 40 worlds make the mean of about 120 draws of chi-square with 2 degrees: standard error 0.18.
    found = []
    for seed in range(40):
        rng = np.random.default_rng(1000 + seed)
        trees = lane(from_m=-4.0, to_m=30.0)
        trees[:, :2] += 0.03 * rng.normal(size=(len(trees), 2))
        trees = trees[rng.random(len(trees)) > 0.1]
        robot = Robot(
            make("imu", "wheel_encoders"),
            yaw_rate=_weaving(0.05 * rng.normal(), 0.5 + 0.5 * rng.random()),
            gyro_bias=0.03 * rng.normal(),
            noise=1.0,
            trees=trees,
            seed=seed,
        ).go(43.0)
        errors, P = robot.errors(), np.array(robot.covariance)
        nees = np.einsum("ti,tij,tj->t", errors, np.linalg.inv(P), errors)
        found.append(nees[np.array(robot.times) > 5.0][::50].mean())
    assert 2.0 - 3 * 0.18 < np.mean(found) < 2.0 + 3 * 0.18
