"""The height filter with the real sensor classes: engines, members, honesty, options."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.estimators.height_bench import DESIGN_M, Machine, Result, honesty, recovered, run
from twin.errors import BadInputError
from twin.estimators import HeightFilterConfig, build_estimator
from twin.scoring.height_bound import HeightErrors, height_bound
from twin.scoring.height_supply import Fixes, Seen
from twin.signals import EstimatorSetup, Mount, SensorInfo

LOST_S, BACK_S, END_S = 40.0, 60.0, 75.0
TROUBLE = [
    {"kind": "wrong_fix", "offset_m": [0.0, 0.0, 0.2], "from_s": 4.0, "to_s": 6.0},
    {"kind": "outage", "from_s": 8.0, "to_s": 9.5},
    {"kind": "latency_step", "latency_s": 0.5, "from_s": 11.0, "to_s": 12.0},
    {"kind": "flapping_quality", "qualities": [4, 5, 2], "changes_hz": 4.0, "from_s": 12.0, "to_s": 15.0},
]


def ours(**options: Any) -> HeightFilterConfig:
    return HeightFilterConfig(kind="height_filter", sensors=("gnss", "ahrs"), **options)


def said(result: Result) -> list[np.ndarray]:
    parts = [result.error_m, result.sigma_m, result.velocity_error_m_s, result.velocity_sigma_m_s]
    return [*parts, result.extra["accel_bias_m_s2"]]


@pytest.mark.parametrize("tilt", [True, False])
def test_engines_agree(*, tilt: bool) -> None:
    found = run(
        {"one": ours(engine="filterpy", tilt=tilt), "other": ours(engine="ensemble", tilt=tilt)},
        duration_s=16.0,
        faults=TROUBLE,
    )
    for one, other in zip(said(found["one"]), said(found["other"]), strict=True):
        assert (np.abs(one - other) <= 1e-9 * (1.0 + np.abs(one))).all()
    np.testing.assert_array_equal(found["one"].extra["mode"], found["other"].extra["mode"])


def test_a_member_is_the_run_of_its_number() -> None:
    together = run({"ours": ours()}, duration_s=16.0, faults=TROUBLE, members=4)["ours"]
    alone = run({"ours": ours()}, duration_s=16.0, faults=TROUBLE, members=[2])["ours"]
    for one, other in zip(said(together), said(alone), strict=True):
        assert (np.abs(one[:, 2] - other[:, 0]) <= 1e-9 * (1.0 + np.abs(other[:, 0]))).all()


@pytest.fixture(scope="module")
def lost() -> Result:
    """500 members through 20 s without corrections, the last 10 s of them without fixes."""
    faults = [{"kind": "corrections_lost", "from_s": LOST_S, "to_s": BACK_S}]
    return run({"ours": ours()}, duration_s=END_S, members=500, faults=faults)["ours"]


def test_sigma_is_honest_through_a_loss(lost: Result) -> None:
    """The slow error of the fix makes each member one sample: 99 % of 500 have a standard error of 0.45 %."""
    found = honesty(lost, LOST_S)
    assert found.inside >= 0.985 - 0.0045
    assert found.worst_bin_inside >= 0.97
    assert found.unsafe <= 0.001
    assert found.worst_ratio <= 1.5
    # in one second's bin, 500 normal numbers tell a standard deviation to 3.2 %; a third of them sees three times that
    tracking = honesty(lost, 25.0, LOST_S)
    assert tracking.least_ratio > 1.0 / 1.1
    assert tracking.worst_ratio < 1.1


def test_the_covariance_is_that_of_the_error(lost: Result) -> None:
    """NEES of height and velocity: 2 on average; its mean over 500 members has a standard error of 2 / sqrt(500)."""
    for second in (30.0, LOST_S, 50.0, 55.0, BACK_S):
        at = int(np.argmin(np.abs(lost.t_s - second)))
        assert lost.nees[at].mean() == pytest.approx(2.0, abs=4.0 * 2.0 / np.sqrt(500.0))


def test_it_recovers_after_a_loss(lost: Result) -> None:
    """All but those whose fix is itself more than 30 mm off: 3.6 % with its 14.3 mm."""
    assert recovered(lost, BACK_S, 3.0) >= 0.964 - 3.0 * np.sqrt(0.964 * 0.036 / 500.0)


def test_vertical_speed_halves_what_coasting_loses() -> None:
    faults = [{"kind": "corrections_lost", "from_s": 30.0}]
    found = run({"with": ours(), "without": ours(vertical_speed=False)}, duration_s=91.0, faults=faults)
    at = int(np.argmin(np.abs(found["with"].t_s - 90.0)))
    assert found["with"].sigma_m[at, 0] <= 0.5 * found["without"].sigma_m[at, 0]


def test_it_is_close_to_the_limit_of_what_can_be_known() -> None:
    """A fix lost at once: no better than a filter that knows the attitude and all parameters, and no more than a
    quarter worse, for what it has to find out."""
    faults = [{"kind": "stuck", "columns": ["position_u_m"], "from_s": 80.0}]
    found = run({"ours": ours()}, duration_s=110.0, faults=faults)["ours"]
    g = 9.80665
    errors = HeightErrors(
        accel_noise_m_s2_rthz=60e-6 * g / np.sqrt(2.0),
        bias_m_s2=15e-6 * g,
        bias_correlation_s=100.0,
        fix=Fixes(correlated_m=0.014, correlation_s=100.0, white_m=0.0054, age_drift_m_s=0.0014),
        speed_white_m_s=0.02,
        speed_correlated_m_s=0.002,
    )
    bound = height_bound(errors, loss_s=31.0, seen=lambda t: Seen(fix_age_s=1.5 if t < 0.0 else None))
    for since_s in (0.0, 5.0, 10.0, 20.0, 30.0):
        ours_m = found.sigma_m[int(np.argmin(np.abs(found.t_s - 80.0 - since_s))), 0]
        least_m = float(np.interp(since_s, bound.t_s, bound.sigma_m))
        assert 0.99 * least_m < ours_m < 1.25 * least_m


def test_levers_are_reckoned_with() -> None:
    """A mast that sways by 4 degrees: the antenna 2 m above the edge and 0.3 m before the AHRS."""
    mounts = {"gnss": (0.3, 0.0, 2.0), "ahrs": (0.0, 0.0, 1.5), "reference": (-0.2, 0.0, 0.0)}
    machine = Machine(sway_rad=np.radians(4.0), mounts=mounts)
    exact = {"attitude_sigma_rad": 1e-6, "heading_sigma_rad": 1e-6}
    found = run(
        {"with": ours(), "without": ours(lever_arm=False)},
        duration_s=40.0,
        machine=machine,
        members=20,
        gnss_changes={"state": "fix"},
        ahrs_changes=exact,
    )
    counted = found["with"].t_s > 20.0
    # the fix's slow error is the same for both; what is left to the one is the sway of 0.5 m at 4 degrees
    spread = {name: float(np.std(result.error_m[counted], axis=0).mean()) for name, result in found.items()}
    assert spread["with"] < 0.006
    assert spread["without"] > 0.015
    share = np.square(found["with"].velocity_error_m_s[counted] / found["with"].velocity_sigma_m_s[counted]).mean()
    assert share < 1.5


def test_tilt_is_learnt_on_a_machine_that_drives_and_turns() -> None:
    """1 m/s to and fro with turns in 4 s: level acceleration leaks, and sigma says so."""

    def speed(t: float) -> tuple[float, float]:
        heading = np.pi * np.clip((t % 20.0 - 16.0) / 4.0, 0.0, 1.0) + np.pi * (t // 20.0)
        forward = min(t / 2.0, 1.0)
        return forward * float(np.cos(heading)), forward * float(np.sin(heading))

    faults = [{"kind": "wrong_fix", "offset_m": [5.0, 5.0, 5.0], "from_s": 50.0}]
    found = run(
        {"learns": ours(vertical_speed=False), "does_not": ours(vertical_speed=False, tilt=False)},
        duration_s=65.0,
        machine=Machine(speed=speed),
        members=100,
        faults=faults,
    )
    for result in found.values():
        assert honesty(result, 30.0).inside > 0.98
        assert honesty(result, 30.0).worst_ratio < 1.5
    assert honesty(found["learns"], 60.0).rmse_m < 0.85 * honesty(found["does_not"], 60.0).rmse_m


def test_it_needs_its_sensors() -> None:
    here = Mount(body="plate", xyz_m=(0.0, 0.0, 0.0))
    setup = EstimatorSetup(
        name="ours", runs=2, sensors={}, reference=here, rows_y_m=(), start_e_n_heading=(0.0, 0.0, 0.0)
    )
    with pytest.raises(BadInputError, match="needs one sensor of kind 'ahrs' on 'plate'"):
        build_estimator(ours(), setup)
    info = SensorInfo(name="ahrs", kind="ahrs", columns=("roll_rad",), mount=here, rate_hz=50.0)
    lacking = EstimatorSetup(
        name="ours", runs=2, sensors={"ahrs": info}, reference=here, rows_y_m=(), start_e_n_heading=(0.0, 0.0, 0.0)
    )
    with pytest.raises(BadInputError, match="needs one sensor of kind 'gnss' on 'plate'"):
        build_estimator(ours(), lacking)
    chassis = replace(info, name="chassis", mount=Mount(body="rail", xyz_m=(0.0, 0.0, 0.0)))
    receiver = replace(info, name="gnss", kind="gnss")
    both = replace(lacking, sensors={"ahrs": info, "beside": replace(info, name="beside"), "gnss": receiver})
    with pytest.raises(BadInputError, match="on 'plate', but there are 2"):
        build_estimator(ours(), both)
    with pytest.raises(BadInputError, match="on 'plate', but there are 0"):
        build_estimator(ours(), replace(lacking, sensors={"chassis": chassis, "gnss": receiver}))
    with pytest.raises(BadInputError, match="steps one run, not 2"):
        build_estimator(ours(engine="filterpy"), setup)
    assert DESIGN_M == 1.0


def test_few_satellites_widen_what_a_vertical_speed_is_worth() -> None:
    """Six of 24 make its errors 2.65 times as large: innovations of 1 where they would be 7 unheeded."""
    masked = {"kind": "satellites_masked", "satellites": 6, "from_s": 20.0, "to_s": 40.0}
    found = run({"ours": ours()}, duration_s=40.0, members=20, faults=[masked], gnss_changes={"state": "fix"})["ours"]
    nis = found.extra["nis_vertical_speed"][found.t_s > 21.0]
    # 20 members, 190 samples: 2.3 %; the filter allows for what it does not see here, by some per cent.
    assert np.nanmean(nis) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (20 * 190)) + 0.05)
