"""Paper 002's figures on a plate moved by hand: with corrections they come out, its 28 s without them do not.

Times count, as the paper's do, from when the corrections are 4 s old, "the judgment basis to lose differential
correction data". 400 runs, each with its own motion and its own errors; the last half of them with an accelerometer
offset of 15 ug (1 sigma) that nobody knows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.estimators.bench import STEP_S, Bench, errors_of, make_setup, motions
from twin.estimators.height_hold import HeightHold, HeightHoldConfig
from twin.estimators.height_vpkf import HeightVpkf, HeightVpkfConfig
from twin.signals import FloatArray

RUNS = 400
LIMIT_M = 0.03
LAST_S, OLD_S = 16.5, 16.5 + 3.0
"""When the last corrections come, 1 s old, and when they are 4 s old; 6 s later the receiver goes to differential."""
PUBLISHED_MM, PUBLISHED_GNSS_MM = 9.82, 18.85


def vpkf(*, runs: int = RUNS, **options: Any) -> HeightVpkf:
    given = {"kind": "height_vpkf", "sensors": ("gnss", "ahrs"), "preparation": {"outliers": "none", "offset": "none"}}
    return HeightVpkf(HeightVpkfConfig.model_validate(given | options), make_setup("gnss", "ahrs", runs=runs))


def hold(*, runs: int = RUNS, **options: Any) -> HeightHold:
    config = HeightHoldConfig.model_validate({"kind": "height_hold", "sensors": ("gnss",), **options})
    return HeightHold(config, make_setup("gnss", runs=runs))


def rmse_mm(errors: FloatArray) -> float:
    """Over the runs, after 5 s of getting settled."""
    return float(1e3 * np.sqrt((errors[round(5.0 / STEP_S) :] ** 2).mean()))


def held_s(errors: FloatArray) -> FloatArray:
    """Time (R,) within the limit since the corrections are old; infinite if it lasts to the end."""
    beyond = np.abs(errors[round(OLD_S / STEP_S) :]) > LIMIT_M
    return np.where(beyond.any(axis=0), STEP_S * beyond.argmax(axis=0), np.inf)


@pytest.mark.parametrize(
    "receiver",
    [
        pytest.param({"fix_m": 0.0086, "fix_white_m": 0.0017, "latency_ns": 0}, id="f9p_at_once"),
        pytest.param({"fix_m": 0.014, "fix_white_m": 0.0054, "latency_ns": 85_000_000}, id="i70_as_late_as_it_is"),
    ],
)
def test_with_corrections_the_papers_figures_come_out(receiver: dict[str, Any]) -> None:
    """On the rail, heights counted from the first as there: within a factor 1.5 of its RMSE, and better than GNSS."""
    height, speed = motions(60.0, stand_s=2.0, runs=100, seed=1)
    errors = errors_of(
        Bench(height=height, speed=speed, seed=2, **receiver),
        {"gnss": hold(runs=100, zero="start"), "vpkf": vpkf(runs=100, zero="start")},
    )
    of_gnss, of_filter = rmse_mm(errors["gnss"]), rmse_mm(errors["vpkf"])
    assert PUBLISHED_MM / 1.5 < of_filter < PUBLISHED_MM * 1.5
    assert of_filter < 0.85 * of_gnss


def test_eqs_1_to_3_in_the_run_would_have_spoilt_the_papers_figures() -> None:
    """Why the Hampel filter is taken to belong to the standing record."""
    height, speed = motions(30.0, stand_s=2.0, runs=100, seed=1)
    always = vpkf(runs=100, zero="start", preparation={"outliers": "always", "offset": "none"})
    robust = vpkf(runs=100, zero="start", preparation={"outliers": "robust", "offset": "none"})
    without = vpkf(runs=100, zero="start")
    bench = Bench(height=height, speed=speed, seed=2)
    errors = errors_of(bench, {"always": always, "robust": robust, "without": without})
    assert rmse_mm(errors["always"]) > 1.5 * PUBLISHED_GNSS_MM > rmse_mm(errors["robust"])
    assert rmse_mm(errors["robust"]) < 1.1 * rmse_mm(errors["without"])


@pytest.fixture(scope="module")
def lost() -> dict[str, FloatArray]:
    """Errors (T, R) by variant, corrections lost: a receiver and a motion without any other trouble."""
    height, speed = motions(OLD_S + 40.0, stand_s=2.0, runs=RUNS, seed=3)
    bias = np.where(np.arange(RUNS) < RUNS // 2, 0.0, 15e-6 * 9.80665 * np.random.default_rng(4).standard_normal(RUNS))
    bench = Bench(
        height=height,
        speed=speed,
        seed=5,
        lost_s=LAST_S,
        fix_m=0.0086,
        fix_white_m=0.0017,
        latency_ns=0,
        age_drift_m_s=0.0,
        differential_m=0.4,
        bias_m_s2=bias,
    )
    variants = {
        "published": vpkf(),
        "other reading": vpkf(switch="quality"),
        "fixed": vpkf(switch="never"),
        "coasting": vpkf(coast="quality"),
    }
    return errors_of(bench, variants)


@pytest.mark.parametrize("variant", ["published", "other reading", "fixed"])
def test_without_corrections_it_never_holds_for_28_s(lost: dict[str, FloatArray], variant: str) -> None:
    """The height of the differential fix, off by 0.4 m, goes in with the gain that is left of Q1.

    In the first second of it 50 x 0.0143 x 0.4 m = 0.28 m with Q1's gain; even a tenth of that is 30 mm. An offset of
    30 mm or less, one run in 17, is no better off before long, as it wanders by 0.25 m in the 22 s that are left.
    """
    held = held_s(lost[variant])
    assert (held > 28.0).mean() <= 0.01
    assert np.quantile(held, 0.9, method="nearest") < 6.0 + 3.0  # the drop is 6 s after the start of the count


def test_coasting_holds_for_about_28_s_but_in_the_median(lost: dict[str, FloatArray]) -> None:
    """22 to 29 s in the median over offsets from 0 to 15 ug, one run in ten far less than the paper's 28 s.

    A scale for it: white noise D makes D sqrt(t^3 / 6) of height, 25 mm in the 22 s from the drop to the 28th second,
    15 ug make 36 mm, the 1 mm/s of speed that a fix leaves uncertain 22 mm, beside the 9 mm of the fix itself.
    """
    held = held_s(lost["coasting"])
    assert 22.0 <= np.median(held) <= 29.0
    assert np.quantile(held, 0.1, method="nearest") < 18.0
    assert np.quantile(held, 0.9, method="nearest") > 36.0
    assert np.median(held[RUNS // 2 :]) < np.median(held[: RUNS // 2])


def test_its_own_sigma_says_nothing_of_it() -> None:
    """In loss it believes in less than with corrections, and is more than twenty times as far off."""
    height, speed = motions(30.0, stand_s=2.0, runs=50, seed=3)
    estimator, sigmas, errors = vpkf(runs=50), [], []
    for k, (t_ns, arrived) in enumerate(Bench(height=height, speed=speed, seed=5, lost_s=5.0).measurements(), start=1):
        for sample in arrived:
            estimator.process(sample)
        estimate = estimator.estimate(t_ns)
        sigmas.append(estimate.sigmas[:, 0])
        errors.append(estimate.values[:, 0] - height[k])
    assert np.max(sigmas[-1]) < np.min(sigmas[round(4.0 / STEP_S)])
    assert np.sqrt(np.mean(errors[-1] ** 2)) > 20.0 * np.max(sigmas[-1])
