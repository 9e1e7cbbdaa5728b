"""Any set of aiding sensors, and how much each is believed."""

from __future__ import annotations

from itertools import chain, combinations

import numpy as np
import pytest

from tests.estimators.planter import (
    IMUS,
    ROWS_Y,
    STEP_NS,
    accosat,
    accosat_info,
    imu,
    make_setup,
    motion,
    profile,
    receiver,
    report,
    sensors,
    stream,
)
from tests.estimators.test_row_speed_ekf import make, play
from twin.errors import BadInputError
from twin.estimators.aiding import AidingNoise, GnssWeighting, aids_of

AIDS = ("radar", "accosat", "gps", "rtk")
SUBSETS = list(chain.from_iterable(combinations(AIDS, size) for size in range(len(AIDS) + 1)))
ALL = {
    **sensors(),
    "accosat": accosat_info(),
    "gps": receiver("gps", position_noise_m=1.5),
    "rtk": receiver("rtk", position_noise_m=0.01),
}
TRACK = profile((1.0, 0.0, 0.0), (2.0, 2.0, 0.0), (3.0, 2.0, 0.25))


def as_modelled() -> np.ndarray:
    """The track as the model of the filter has it: each step with the speed and yaw rate at its beginning."""
    return motion(*(np.concatenate([[0.0], values[:-1]]) for values in TRACK))


def perfect(aids: tuple[str, ...]) -> list[list]:
    """What four units and these aids give without errors, on a start and a bend."""
    pose = as_modelled()
    ticks = stream(*TRACK)
    for k, tick in enumerate(ticks):
        t_ns, speed = (k + 1) * STEP_NS, TRACK[0][k]
        if "radar" not in aids:
            tick.pop()
        if "accosat" in aids and k % 2:
            tick.append(accosat(t_ns, speed))
        tick.extend(report(name, t_ns, *pose[k, :2], speed) for name in ("gps", "rtk") if name in aids and k % 5 == 4)
    return ticks


@pytest.mark.parametrize("architecture", ["central", "distributed"])
@pytest.mark.parametrize("aids", SUBSETS, ids="+".join)
def test_every_set_of_aids_follows_perfect_measurements(aids: tuple[str, ...], architecture: str) -> None:
    """All of tables 4.2 and 4.3 and every other set. The yaw rate's Q is raised until the gyros are believed at once:
    as published its lag would make fixes and gyros contradict one another. Of a step R / Q = 1e-4 is left, which turns
    the heading by 1e-4 * 0.25 * 0.02 rad, and nothing else is wrong: every speed and place is right to 1e-4."""
    setup = make_setup({name: ALL[name] for name in (*IMUS, *aids)})
    trusting_gyros = {"process": (1e-5, 1e-5, 1e-4, 1e-8, 1e-2)}
    estimator = make(setup, architecture=architecture, calibration_s=1.0, noise=trusting_gyros)
    last = play(estimator, perfect(aids))[-1]
    values = dict(zip(estimator.columns, last.values[0], strict=True))
    for row, y in enumerate(ROWS_Y, start=1):
        assert values[f"row_speed_{row}_m_s"] == pytest.approx(2.0 - 0.25 * y, abs=1e-4)
    np.testing.assert_allclose(last.values[0, :2], as_modelled()[-1, :2], atol=1e-4)
    told = {name for name in estimator.columns if name.startswith("nis_")}
    expected = {"radar": {"nis_radar"}, "accosat": {"nis_accosat"}}
    for name in ("gps", "rtk"):
        expected[name] = {f"nis_{name}_position", f"nis_{name}_speed"}
    assert told == {"nis_gyro"}.union(*(expected[name] for name in aids))


@pytest.mark.parametrize(
    ("info", "variance"),
    [
        (ALL["radar"], 0.1),
        (ALL["accosat"], 0.1),
        (ALL["rtk"], 0.1),
        (ALL["gps"], 1.0),
        (receiver("unknown", position_noise_m=None), 1.0),
        (receiver("mine"), 0.7),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_published_variances_are_those_of_table_4_1(info, variance: float) -> None:
    noise = AidingNoise(variance={"mine": 0.7})
    for aid in aids_of(info, noise, GnssWeighting(), make_setup({info.name: info}), 0.0):
        np.testing.assert_array_equal(aid.observation.R, variance)
        assert aid.reported is None


def moved_by_first_fix(*, sigma_m, quality, **weighting) -> np.ndarray:
    """How far one fix 1 m north of the start moves the position, start known to 1 m, per run."""
    runs = len(np.atleast_1d(sigma_m))
    setup = make_setup({"imu_1": ALL["imu_1"], "rtk": ALL["rtk"]}, runs=runs)
    estimator = make(setup, calibration_s=0.0, start={"position_m": 1.0, "heading_rad": 0.0}, gnss=weighting)
    estimator.process(imu("imu_1", STEP_NS, np.zeros(runs), np.zeros(runs)))
    estimator.process(report("rtk", STEP_NS, np.zeros(runs), 1.0, np.nan, sigma_m=sigma_m, quality=quality))
    alone = estimator.estimate(STEP_NS).values[:, 1]
    assert np.isfinite(alone).all()
    return alone


def gain(variance: float) -> float:
    """K of a first fix: P is 1 m^2 and one step's Q of 1e-5."""
    return (1.0 + 1e-5) / (1.0 + 1e-5 + variance)


def test_reported_sigmas_weigh_the_position() -> None:
    sigma = np.array([0.5, 1.0, 0.005, 0.0, np.nan, -1.0])
    moved = moved_by_first_fix(sigma_m=sigma, quality=4, noise="reported", sigma_floor_m=0.1)
    # The floor for the third; unknown for the last three: the published 0.1 m^2.
    expected = [gain(0.25), gain(1.0), gain(0.01), gain(0.1), gain(0.1), gain(0.1)]
    np.testing.assert_allclose(moved, expected, rtol=1e-9)


def test_published_weight_ignores_what_is_reported() -> None:
    moved = moved_by_first_fix(sigma_m=np.array([0.5, 0.0]), quality=np.array([4, 1]))
    np.testing.assert_allclose(moved, gain(0.1), rtol=1e-9)


@pytest.mark.parametrize(
    ("minimum", "used"),
    [
        ("single", [0, 1, 1, 1, 1, 1, 0, 0]),
        ("differential", [0, 0, 1, 1, 1, 1, 0, 0]),
        ("float", [0, 0, 0, 0, 1, 1, 0, 0]),
        ("fix", [0, 0, 0, 0, 1, 0, 0, 0]),
    ],
)
def test_samples_below_the_minimum_quality_are_not_used(minimum: str, used: list[int]) -> None:
    quality = np.array([0, 1, 2, 3, 4, 5, 6, np.nan])
    moved = moved_by_first_fix(sigma_m=np.full(8, 1.0), quality=quality, noise="reported", minimum_quality=minimum)
    np.testing.assert_allclose(moved, gain(1.0) * np.array(used), rtol=1e-9)


def test_a_bad_quality_silences_the_speed_too() -> None:
    setup = make_setup({"imu_1": ALL["imu_1"], "rtk": ALL["rtk"]}, runs=2)
    still = {"enabled": False}
    estimator = make(setup, calibration_s=0.0, standstill=still, gnss={"noise": "reported", "minimum_quality": "fix"})
    estimator.process(imu("imu_1", STEP_NS, np.zeros(2), np.zeros(2)))
    estimator.process(report("rtk", STEP_NS, np.zeros(2), 0.0, 0.9, quality=np.array([5, 4])))
    values = dict(zip(estimator.columns, estimator.estimate(STEP_NS).values.T, strict=True))
    P = 0.01**2 + 1e-4
    # The position of the same sample knows 2e-6 of the speed too.
    np.testing.assert_allclose(values["speed_m_s"], [0.0, 0.9 * P / (P + 0.1)], rtol=1e-5)
    np.testing.assert_allclose(values["nis_rtk_speed"], [np.nan, 0.81 / (P + 0.1)], rtol=1e-5)


def test_innovations_are_told_once() -> None:
    """Normalised by hand: start speed known to 0.01 m/s, Q 1e-4, R 0.1; the gyro 0 with (1e-3)^2 + 1e-8 and R 1e-6."""
    estimator = make(make_setup({"imu_1": ALL["imu_1"], "radar": ALL["radar"]}), calibration_s=0.0)
    estimator.process(imu("imu_1", STEP_NS, 0.0, 2e-3))
    first = dict(zip(estimator.columns, estimator.estimate(STEP_NS).values[0], strict=True))
    assert first["nis_gyro"] == pytest.approx(4e-6 / (1e-6 + 1e-8 + 1e-6), rel=1e-9)
    assert np.isnan(first["nis_radar"])
    second = dict(zip(estimator.columns, estimator.estimate(STEP_NS).values[0], strict=True))
    assert np.isnan(second["nis_gyro"])


def test_a_receiver_that_reports_nothing_cannot_be_believed() -> None:
    silent = receiver("rtk", columns=("position_e_m", "position_n_m", "speed_m_s"))
    with pytest.raises(BadInputError, match="'rtk' gives no quality"):
        make(make_setup({"imu_1": ALL["imu_1"], "rtk": silent}), gnss={"noise": "reported"})
