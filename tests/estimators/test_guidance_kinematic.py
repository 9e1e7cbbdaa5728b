"""Start, lever arm, lost and repeated fixes, members and engines of paper 004's filters; the double filter's choice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.guidance_bench import CURVE, STRAIGHT, Bench, fix, make_setup
from tests.small_scenario import small_scenario
from twin.errors import BadInputError
from twin.estimation import estimator_setup
from twin.estimators import build_estimator
from twin.estimators.guidance_gps import GuidanceGpsConfig
from twin.estimators.guidance_imm import GuidanceImmConfig
from twin.estimators.guidance_kinematic import GuidanceKinematicConfig
from twin.geometry import Path
from twin.scenario import resolve
from twin.signals import Estimator, EstimatorSetup, Measurement, Mount, SensorInfo

KINDS = ("guidance_kinematic", "guidance_imm")
BODY = Mount(body="body", xyz_m=(0.0, 0.0, 0.0))


def make(setup: EstimatorSetup, kind: str = "guidance_kinematic", **options) -> Estimator:
    return build_estimator(make_config(kind, sensors=tuple(setup.sensors), **options), setup)


def make_config(kind: str, **options) -> GuidanceKinematicConfig | GuidanceImmConfig:
    which = GuidanceKinematicConfig if kind == "guidance_kinematic" else GuidanceImmConfig
    return which.model_validate({"kind": kind, "sensors": ("gps",)} | options)


def value(estimator: Estimator, column: str, t_s: float, member: int = 0) -> float:
    return float(estimator.estimate(round(t_s * 1e9)).values[member, estimator.columns.index(column)])


def sensor(kind: str, *columns: str, **sheet: float) -> SensorInfo:
    return SensorInfo(name=kind, kind=kind, columns=columns, mount=BODY, rate_hz=5.0, datasheet=sheet)


def says(info: SensorInfo, t_s: float, *values) -> Measurement:
    table = np.stack([np.atleast_1d(np.asarray(one, dtype=float)) for one in values], axis=-1)
    t_ns = round(t_s * 1e9)
    return Measurement(
        sensor=info.name,
        t_ns=t_ns,
        t_available_ns=t_ns,
        columns=info.columns,
        values=table,
        valid=np.ones(len(table), dtype=bool),
    )


# --- start -----------------------------------------------------------------------------------------------------------


def test_start_is_the_mean_of_the_fixes_before_the_last_one_standing() -> None:
    estimator = make(make_setup(), model="constant_velocity", variant="published")
    east = [1.0, 3.0, 2.0, 9.0]
    for k, at in enumerate(east):
        estimator.process(fix(float(k), [at, 0.0, 0.0], speed=0.1, hdop=2.0))
    estimate = estimator.estimate(3_500_000_000)
    # eq 7: the start epoch's own fix, 9, is not in the mean; eq 9: three times HDOP over nine
    assert estimate.values[0, 0] == pytest.approx(2.0)
    assert estimate.sigmas[0, 0] ** 2 == pytest.approx(3 * 2.0 / 9.0)
    assert value(estimator, "speed_m_s", 3.5) == 0.0
    estimator.process(fix(4.0, [4.0, 0.0, 0.0], speed=2.0, hdop=2.0))
    # eq 2 from x0 = 2 with C = 2/3 and no speed, 1 s after the start epoch: C- = 2/3 + 0.5, gain C- / (C- + 2)
    prior = 2.0 / 3.0 + 0.5
    assert value(estimator, "position_e_m", 4.0) == pytest.approx(2.0 + prior / (prior + 2.0) * 2.0)


@pytest.mark.parametrize("kind", KINDS)
def test_start_may_be_set_by_time(kind: str) -> None:
    estimator = make(make_setup(), kind, start_s=5.0)
    for k in range(7):
        estimator.process(fix(float(k), [3.0 * k, 0.0, 0.0], speed=3.0))
        moves = value(estimator, "speed_m_s", float(k)) > 0.0
        assert moves == (k >= 5)


@pytest.mark.parametrize("kind", KINDS)
def test_vehicle_that_never_stood_is_caught_within_seconds(kind: str) -> None:
    estimator = make(make_setup(rate_hz=1.0), kind)
    for k in range(6):
        estimator.process(fix(float(k), [8.0 * k, 0.0, 0.0], speed=8.0))
    assert value(estimator, "position_e_m", 5.0) == pytest.approx(40.0, abs=0.3)
    assert value(estimator, "speed_m_s", 5.0) == pytest.approx(8.0, abs=0.3)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_known_before_the_first_fix(kind: str) -> None:
    estimator = make(make_setup(), kind)
    estimate = estimator.estimate(0)
    assert np.isnan(estimate.values[0, :2]).all()
    assert np.isnan(estimate.sigmas[0, :2]).all()
    assert value(estimator, "heading_rad", 0.0) == 0.0


# --- fixes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_repeated_late_and_empty_fixes_change_nothing(kind: str) -> None:
    clean, troubled = make(make_setup(), kind), make(make_setup(), kind)
    for k in range(20):
        good = fix(0.2 * k, [k, 0.1 * k * k, 0.0])
        clean.process(good)
        troubled.process(good)
        troubled.process(good)
        troubled.process(fix(0.2 * k - 0.5, [99.0, 99.0, 99.0]))
        troubled.process(fix(0.2 * k + 0.1, [99.0, 99.0, 99.0], quality=0.0))
        troubled.process(fix(0.2 * k + 0.1, [np.nan, 99.0, 99.0]))
    assert (troubled.estimate(4_000_000_000).values == clean.estimate(4_000_000_000).values)[0, :4].all()


@pytest.mark.parametrize("kind", KINDS)
def test_innovations_are_told_once(kind: str) -> None:
    estimator = make(make_setup(), kind)
    for k in range(3):
        estimator.process(fix(0.2 * k, [k, 0.0, 0.0]))
    assert value(estimator, "innovation_e_m", 0.4) != 0.0
    assert np.isnan(value(estimator, "innovation_e_m", 0.42))
    assert np.isnan(value(estimator, "nis_position", 0.44))
    estimator.process(fix(0.6, [3.0, 0.0, 0.0]))
    assert value(estimator, "nis_position", 0.6) >= 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_position_is_moved_on_between_fixes(kind: str) -> None:
    estimator = make(make_setup(rate_hz=1.0), kind)
    for k in range(40):
        estimator.process(fix(float(k), [6.0 * k, 0.0, 0.0], speed=6.0))
    assert value(estimator, "position_e_m", 39.5) == pytest.approx(6.0 * 39.5, abs=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_receiver_without_height_speed_and_dilutions_will_do(kind: str) -> None:
    columns = ("position_e_m", "position_n_m")
    estimator = make(make_setup(columns=columns), kind)
    assert "position_u_m" not in estimator.columns
    for k in range(30):
        t_ns = k * 200_000_000
        values = np.array([[1.0 * k, 2.0 * k]])
        estimator.process(
            Measurement(
                sensor="gps", t_ns=t_ns, t_available_ns=t_ns, columns=columns, values=values, valid=np.array([True])
            )
        )
    assert value(estimator, "position_n_m", 5.8) == pytest.approx(58.0, abs=0.2)
    assert value(estimator, "heading_rad", 5.8) == pytest.approx(np.arctan2(2.0, 1.0), abs=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_heading_is_held_while_slow(kind: str) -> None:
    estimator = make(make_setup(), kind, start_s=0.0)
    for k in range(50):  # north at 3 m/s, then to a stop at 1 m/s^2
        speed = np.clip(10.0 - 0.2 * k, 0.0, 3.0)
        north = 3.0 * min(0.2 * k, 7.0) + (9.0 - speed**2) / 2.0
        estimator.process(fix(0.2 * k, [0.0, north, 0.0], speed=speed, course=np.pi / 2))
    rng = np.random.default_rng(2)
    for k in range(50, 100):
        wobble = 0.02 * rng.standard_normal(3)
        estimator.process(fix(0.2 * k, np.array([0.0, north, 0.0]) + wobble, speed=0.05, course=rng.uniform(-3, 3)))
    assert value(estimator, "heading_rad", 19.8) == pytest.approx(np.pi / 2, abs=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_slow_is_what_the_option_says(kind: str) -> None:
    # north at 0.3 m/s, set out to the east; nothing is told that is not told to every other guidance filter
    headings = {}
    for slow_m_s in (None, 0.5):
        estimator = make(make_setup(), kind, start_s=0.0, **{} if slow_m_s is None else {"course_from_m_s": slow_m_s})
        for k in range(300):
            estimator.process(fix(0.2 * k, [0.0, 0.06 * k, 0.0], speed=0.3, course=np.pi / 2))
        headings[slow_m_s] = value(estimator, "heading_rad", 59.8)
    assert headings[None] == pytest.approx(np.pi / 2, abs=0.01)
    assert headings[0.5] == 0.0


def test_guidance_filters_share_their_defaults() -> None:
    configs = [GuidanceGpsConfig(kind="guidance_gps", sensors=("gps",))]
    configs += [make_config(kind) for kind in KINDS]
    assert len({(config.rate_hz, config.course_from_m_s) for config in configs}) == 1


@pytest.mark.parametrize("model", ["constant_velocity", "constant_acceleration"])
def test_heading_does_not_turn_round_at_a_hard_stop(model: str) -> None:
    # 7 m/s to a stop at 2 m/s^2, told once a second: constant acceleration then goes backwards at 2 m/s or so
    estimator = make(make_setup(rate_hz=1.0), model=model, start_s=0.0)
    for k in range(30):
        braked = np.clip(k - 15.0, 0.0, 3.5)
        east = 7.0 * min(k, 15.0) + 7.0 * braked - braked**2
        estimator.process(fix(float(k), [east, 0.0, 0.0], speed=7.0 - 2.0 * braked))
        assert abs(value(estimator, "heading_rad", k + 0.5)) < 0.01


# --- lever arm -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_antenna_before_the_axle_is_set_back_along_the_heading_not_the_course(kind: str) -> None:
    # reference on a circle of 25 m to the left at 5 m/s, antenna 1.5 m before it and 0.4 m to the left, 2.5 m up
    setup = make_setup(arm=(1.5, 0.4, 2.5))
    estimator = make(setup, kind, **{"model": "constant_acceleration"} if kind == KINDS[0] else {"noise_m": 0.1})
    rate = 5.0 / 25.0
    for k in range(300):
        turned = rate * 0.2 * k
        ahead = np.exp(1j * turned)
        antenna = 25.0 * -1j * ahead + ahead * (1.5 + 0.4j)
        velocity = 1j * rate * antenna
        at = [antenna.real, antenna.imag, 2.5]
        estimator.process(fix(0.2 * k, at, speed=abs(velocity), course=np.angle(velocity)))
    heading = value(estimator, "heading_rad", 59.8)
    place = 25.0 * -1j * ahead
    lag = 0.02 if kind == KINDS[1] else 0.15  # of the model itself, in fixed axes: test_guidance_models
    assert np.angle(np.exp(1j * (heading - turned))) == pytest.approx(0.0, abs=0.02)  # the course is 0.06 off
    assert value(estimator, "position_e_m", 59.8) == pytest.approx(place.real, abs=lag)
    assert value(estimator, "position_n_m", 59.8) == pytest.approx(place.imag, abs=lag)
    assert value(estimator, "speed_m_s", 59.8) == pytest.approx(5.0, abs=lag)


# --- members and engines ---------------------------------------------------------------------------------------------


OPTIONS = [
    ("guidance_kinematic", {"model": "constant_velocity", "variant": "published"}),
    ("guidance_kinematic", {"model": "double", "variant": "published"}),
    ("guidance_kinematic", {"model": "double", "noise": "continuous"}),
    ("guidance_kinematic", {"model": "double", "switch": {"by": "planned_track"}}),
    ("guidance_imm", {}),
    ("guidance_imm", {"velocity": "none"}),
]


@pytest.mark.parametrize(("kind", "options"), OPTIONS)
def test_member_of_an_ensemble_is_the_single_run(kind: str, options: dict) -> None:
    # 60 % of fixes arrive, each member loses its own: intervals differ, and starts do
    bench = Bench(seeds=range(1, 5), rate_hz=1.0)
    lost = np.random.default_rng(4).random((len(bench.seen), 4)) < 0.4
    planned = bench.drives[2].planned
    ensemble = make(make_setup(runs=4, rate_hz=1.0, planned_path=planned), kind, **options)
    engines = [make(make_setup(rate_hz=1.0, planned_path=planned), kind, engine=name, **options) for name in ENGINES]
    for k, sample in enumerate(bench.fixes()):
        sample.valid[:] = ~lost[k]
        ensemble.process(sample)
        if sample.valid[2]:
            for single in engines:
                single.process(replace(sample, values=sample.values[2:3], valid=sample.valid[2:3]))
        at = sample.t_ns + 300_000_000
        expected = ensemble.estimate(at)
        for single in engines:
            estimate = single.estimate(at)
            assert estimate.values[0] == pytest.approx(expected.values[2], abs=1e-9, nan_ok=True)
            assert estimate.sigmas[0] == pytest.approx(expected.sigmas[2], abs=1e-9, nan_ok=True)


ENGINES = ("filterpy", "ensemble")


@pytest.mark.parametrize("kind", KINDS)
def test_filterpy_steps_one_run(kind: str) -> None:
    with pytest.raises(BadInputError, match=r"engine = 'filterpy': steps one run, not 2; allowed: auto, ensemble"):
        make(make_setup(runs=2), kind, engine="filterpy")


@pytest.mark.parametrize("kind", KINDS)
def test_exactly_one_receiver(kind: str) -> None:
    setup = make_setup(sensor("yaw_gyro", "yaw_rate_rad_s"))
    alone = replace(setup, sensors={"yaw_gyro": setup.sensors["yaw_gyro"]})
    with pytest.raises(BadInputError, match="exactly one sensor of kind 'gnss'"):
        make(alone, kind)


# --- the double filter's choice --------------------------------------------------------------------------------------


Tell = Callable[[int, float], list[Measurement]]


def turns_seen(bench: Bench, estimator: Estimator, tell: Tell | None = None) -> np.ndarray:
    """(K, R) mode after each fix."""
    out = []
    for k, sample in enumerate(bench.fixes()):
        for other in tell(k, sample.t_ns / 1e9) if tell is not None else ():
            estimator.process(other)
        estimator.process(sample)
        out.append(estimator.estimate(sample.t_ns).values[:, estimator.columns.index("mode_turning")])
    return np.array(out)


SEEN_BY = {
    "angle_transducer": (("steering_angle_rad",), lambda _, bent: [np.arctan(2.0 * bent)]),
    "yaw_gyro": (("yaw_rate_rad_s",), lambda speed, bent: [speed * bent]),
    "imu": (("gyro_z_rad_s",), lambda speed, bent: [speed * bent]),
    "odometry": (("speed_m_s", "yaw_rate_rad_s"), lambda speed, bent: [speed, speed * bent]),
}


@pytest.mark.parametrize("kind", [None, *SEEN_BY])
def test_model_is_the_curves_in_curves_and_the_other_on_straights(kind: str | None) -> None:
    bench = Bench(seeds=range(1, 6))
    speeds, bends, phases = bench.at_fixes("speed"), bench.at_fixes("curvature"), bench.at_fixes("phase")
    if kind is None:
        modes = turns_seen(bench, make(make_setup(runs=5)))
    else:
        columns, told = SEEN_BY[kind]
        info = sensor(kind, *columns)
        estimator = make(make_setup(info, runs=5, wheelbase_m=2.0), switch={"by": "odometer_and_steering"})
        modes = turns_seen(bench, estimator, lambda k, t_s: [says(info, t_s, *told(speeds[k], bends[k]))])
    # a course of 0.05 / 7 rad, differenced over 0.2 s and smoothed over 0.5 s: 1/600 m beside the thresholds' 1/120
    assert modes[phases == CURVE].mean() > 0.99
    assert modes[phases == STRAIGHT].mean() < 0.02


def test_wheels_tell_a_curve() -> None:
    info = sensor("wheel_encoders", "left_slots", "right_slots", slots_per_turn=360.0)
    estimator = make(
        make_setup(info), switch={"by": "odometer_and_steering", "wheel_radius_m": 0.5, "track_m": 1.6}, start_s=0.0
    )
    slot = 2.0 * np.pi * 0.5 / 360.0
    modes = []
    for k in range(100):
        way, turned = 1.2 * k, max(k - 50, 0) * 1.2 / 40.0
        wheels = (np.floor((way - 0.8 * turned) / slot), np.floor((way + 0.8 * turned) / slot))
        estimator.process(says(info, 0.2 * k, *wheels))
        estimator.process(fix(0.2 * k, [way, 0.0, 0.0]))
        modes.append(value(estimator, "mode_turning", 0.2 * k))
    assert not any(modes[:50])
    assert all(modes[56:])


def test_wheels_of_unknown_size_tell_no_curve() -> None:
    info = sensor("wheel_encoders", "left_slots", "right_slots", slots_per_turn=360.0)
    by = {"by": "odometer_and_steering"}
    with pytest.raises(BadInputError, match="nothing here tells how large they are and how far apart"):
        make(make_setup(info, wheel_radius_m=0.5), switch=by)
    make(make_setup(info, wheel_radius_m=0.5), switch=by | {"track_m": 1.6})
    make(make_setup(info, wheel_radius_m=0.5, track_m=1.6), switch=by)


def test_zero_of_the_steering_is_learnt() -> None:
    info = sensor("angle_transducer", "steering_angle_rad")
    estimator = make(
        make_setup(info, wheelbase_m=1.1), switch={"by": "odometer_and_steering", "smoothing_s": 0.2}, start_s=0.0
    )
    modes = []
    for k in range(60):  # 1.5 degrees off, on 1.1 m the curvature of 42 m; from 40 s on round a bend of 25 m
        bent = 1.0 / 25.0 if k >= 40 else 0.0
        estimator.process(says(info, 1.0 * k, np.arctan(1.1 * bent) + np.radians(1.5)))
        estimator.process(fix(1.0 * k, [5.0 * k, 0.0, 0.0]))
        modes.append(value(estimator, "mode_turning", 1.0 * k))
    assert not any(modes[12:40])
    assert all(modes[40:])


def test_choice_has_hysteresis() -> None:
    info = sensor("angle_transducer", "steering_angle_rad")
    setup = make_setup(info, wheelbase_m=2.0)
    estimator = make(setup, switch={"by": "odometer_and_steering", "smoothing_s": 1e-3}, start_s=0.0)
    modes = []
    for k, radius in enumerate([1e9, 150.0, 110.0, 150.0, 190.0, 220.0, 150.0]):
        estimator.process(says(info, 1.0 * k, np.arctan(2.0 / radius)))
        estimator.process(fix(1.0 * k, [5.0 * k, 0.0, 0.0]))
        modes.append(value(estimator, "mode_turning", 1.0 * k))
    assert modes == [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0]


def test_planned_track_chooses_where_it_bends() -> None:
    bench = Bench(seeds=[3], wander_m_s2=1e-4)
    estimator = make(make_setup(planned_path=bench.drives[0].planned), switch={"by": "planned_track"})
    modes, phases = turns_seen(bench, estimator), bench.at_fixes("phase")
    assert modes[phases == CURVE].mean() > 0.95
    assert modes[phases == STRAIGHT].mean() < 0.05


def test_driver_who_leaves_the_plan_is_found_out() -> None:
    # straight for 10 s as planned, then round a circle of 25 m at 8 m/s for 12 s
    plan = Path(east_m=0.0, north_m=0.0, heading_rad=0.0, pieces=[(500.0, 0.0)])
    estimator = make(make_setup(planned_path=plan), switch={"by": "planned_track"}, start_s=0.0)
    modes = []
    for k in range(110):
        t_s = 0.2 * k
        turned = max(t_s - 10.0, 0.0) * 8.0 / 25.0
        at = [8.0 * min(t_s, 10.0) + 25.0 * np.sin(turned), 25.0 * (1.0 - np.cos(turned)), 0.0]
        estimator.process(fix(t_s, at, speed=8.0, course=turned))
        modes.append(value(estimator, "mode_turning", t_s))
    # 1.18 a fix once both have settled to the circle: 35 fixes to odds of 300, and up to 3 s to settle
    assert not any(modes[: 50 + 35])
    assert all(modes[50 + 35 + 15 :])


def test_planned_track_needs_a_plan_and_steering_needs_something_that_turns() -> None:
    with pytest.raises(BadInputError, match="no path is planned here"):
        make(make_setup(), switch={"by": "planned_track"})
    with pytest.raises(BadInputError, match="none of them sees a turn"):
        make(make_setup(), switch={"by": "odometer_and_steering"})
    with pytest.raises(BadInputError, match="no wheelbase"):
        make(make_setup(sensor("angle_transducer", "steering_angle_rad")), switch={"by": "odometer_and_steering"})


def test_setup_knows_what_the_driver_means_to_drive() -> None:
    scenario = resolve(small_scenario(), where="small scenario")
    setup = estimator_setup("guide", scenario, {}, (), 1)
    assert setup.planned_path is not None
    assert setup.planned_path.length_m == pytest.approx(20.0)
    east, north, _ = scenario.machine.vehicle_start
    begin = setup.planned_path.pose(0.0)
    assert (begin.east_m, begin.north_m) == pytest.approx((east, north))
