"""The fix-state machine: falls at the very nanosecond, climbs after drawn times, each state errs as its preset says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import STANDING, Log, constant, drive, preset, sensor
from twin.signals import POSITION

LOST = {"kind": "corrections_lost", "from_s": 20.0}


def log_of(
    name: str, *faults: dict[str, Any], until_s: float, runs: int = 2, states: Any = None, **changes: Any
) -> Log:
    values = preset(name)
    for state, more in (states or {}).items():
        values["states"][state] |= more
    return drive(sensor(values | changes | {"faults": list(faults)}, runs=range(runs)), STANDING, until_s)


def changes_of_quality(log: Log, run: int = 0) -> list[tuple[float, float]]:
    quality = log.values("quality")[:, run]
    changed = np.flatnonzero(np.diff(quality) != 0.0) + 1
    return [(round(log.t_s[k], 9), quality[k]) for k in changed]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # Lost from 20.0 s on. Corrections of 18 s took 1 s to arrive, those of 19 s arrive right when the link goes.
        ("rtk_chcnav_i70", [(28.0, 2.0)]),
        # Half a second of delay: those of 19 s are the last.
        ("rtk_navcom_sf3050", [(34.0, 2.0)]),
        ("rtk_survey", [(79.0, 2.0)]),
        ("rtk_f9p", [(79.0, 5.0), (139.0, 2.0), (319.0, 1.0)]),
    ],
)
def test_receiver_falls_when_its_corrections_reach_the_time_out_and_not_a_sample_earlier(
    name: str, expected: list[tuple[float, float]]
) -> None:
    log = log_of(name, LOST, until_s=330.0)
    assert changes_of_quality(log) == expected
    assert changes_of_quality(log, run=1) == expected
    assert log.values("quality")[0, 0] == 4.0


def test_a_ladder_of_ones_own() -> None:
    states = {"fix": {"until_age_s": 3.0}, "float": {"until_age_s": 4.5}, "differential": {"until_age_s": 6.25}}
    log = log_of("rtk_f9p", LOST, until_s=30.0, states=states, rate_hz=20.0)
    assert changes_of_quality(log) == [(22.0, 5.0), (23.5, 2.0), (25.25, 1.0)]


def test_time_to_a_fix_is_log_normal_and_float_comes_before() -> None:
    runs = 600
    log = log_of("rtk_chcnav_i70", LOST | {"to_s": 60.0}, until_s=90.0, runs=runs)
    after = log.t_s >= 60.0
    quality = log.values("quality")[after]
    # Those of 59 s arrive at 60.0 s, just as the link is back; until then quality 2.
    assert np.all(quality[0] == 2.0)
    waited = log.t_s[after][np.argmax(quality == 4.0, axis=0)] - 60.0
    # Median 5 s, ln spread 0.4; times are rounded up to samples, by 0.05 s on average.
    # Median of 600: standard error 1.25 * 0.4 / sqrt(600) = 2.0 %; spread: 1/sqrt(1200) = 2.9 %.
    assert np.median(waited) == pytest.approx(5.05, rel=4 * 0.020)
    assert np.std(np.log(waited)) == pytest.approx(0.4, rel=4 * 0.029)
    # Below 10 s: Phi(ln 2 / 0.4) = 95.8 %, standard error 0.8 %.
    assert np.mean(waited < 10.0) == pytest.approx(0.958, abs=4 * 0.008)
    # Float is acquired in 1 s: later than the fix only with ln 5 / sqrt(0.4^2 + 0.3^2) = 3.2 sigma.
    assert np.mean((quality == 5.0).any(axis=0)) > 0.99
    # Once fixed, it stays.
    assert np.all(quality[-1] == 4.0)


def test_time_to_a_fix_is_drawn_anew_every_time() -> None:
    again = LOST | {"from_s": 60.0, "to_s": 80.0}
    log = log_of("rtk_chcnav_i70", LOST | {"to_s": 40.0}, again, until_s=100.0, runs=600)
    quality = log.values("quality")

    def waited(since: float) -> np.ndarray:
        after = log.t_s >= since
        return log.t_s[after][np.argmax(quality[after] == 4.0, axis=0)] - since

    # Independent: standard error 1/sqrt(600) = 4.1 %.
    assert abs(np.corrcoef(np.log(waited(40.0)), np.log(waited(80.0)))[0, 1]) < 4 * 0.041


def test_satellites_decide_which_state_is_possible() -> None:
    def masked(satellites: int) -> Log:
        fault = {"kind": "satellites_masked", "satellites": satellites, "from_s": 2.0, "to_s": 4.0}
        return log_of("rtk_f9p", fault, until_s=40.0, rate_hz=1.0)

    for satellites, quality in ((7, 4.0), (6, 5.0), (5, 5.0), (4, 1.0), (3, 0.0)):
        log = masked(satellites)
        assert log.values("quality")[:4, 0].tolist() == [4.0, quality, quality, log.values("quality")[3, 0]]
        assert log.values("satellites")[1:3, 0].tolist() == [satellites] * 2
        assert log.values("quality")[-1, 0] == 4.0
        assert log.values("satellites")[-1, 0] == 24.0
    # Fixed on 7 of 24: sqrt(21/4) times everything.
    log = masked(7)
    assert log.values("hdop")[1, 0] == pytest.approx(0.7 * math.sqrt(21 / 4))
    assert log.values("sigma_u_m")[1, 0] == pytest.approx(math.hypot(0.0053 * math.sqrt(21 / 4), 0.0014 * 1.0))


def test_without_a_position_a_sample_arrives_and_says_so() -> None:
    fault = {"kind": "satellites_masked", "satellites": 2, "from_s": 2.0, "to_s": 4.0}
    log = log_of("rtk_f9p_dual", fault, until_s=3.0, rate_hz=1.0)
    lost = log.measurements[1]
    assert lost.valid.all()
    assert lost.column("quality")[0] == 0.0
    assert lost.column("satellites")[0] == 2.0
    rest = [name for name in lost.columns if name not in {"quality", "satellites"}]
    assert all(np.isnan(lost.column(name)).all() for name in rest)


def test_lost_messages_make_older_corrections_in_each_run_by_itself() -> None:
    log = log_of("rtk_f9p", until_s=400.0, runs=200, corrections_loss_probability=0.3, rate_hz=1.0)
    age = log.values("age_s")
    # Sampled every second, 1 s old plus one more for each message lost in a row: geometric, mean 0.3/0.7.
    # 80000 samples, correlated over about two: standard error sqrt(0.3 / 0.49 / 40000) = 0.4 %.
    assert np.mean(age - 1.0) == pytest.approx(0.3 / 0.7, abs=4 * 0.004)
    assert np.mean(age == 1.0) == pytest.approx(0.7, abs=0.01)
    assert np.any(age[:, 0] != age[:, 1])


ONLY: dict[str, Any] = {
    "fix": {},
    "float": {"fix": {"until_age_s": 0.1}},
    "differential": {state: {"until_age_s": 0.1} for state in ("fix", "float")},
    "single": {state: {"until_age_s": 0.1} for state in ("fix", "float", "differential")},
}
"""What keeps a receiver out of the states above: they would take fresher corrections than there are."""


@pytest.mark.parametrize("state", list(ONLY))
@pytest.mark.parametrize("name", ["rtk_f9p", "rtk_survey"])
def test_each_state_errs_and_reports_as_its_preset_says(name: str, state: str) -> None:
    # Float grows to its full size with 100 s: after 400 s 1 - 0.63 e^-4 = 99 % are there.
    described = preset(name)["states"][state]
    log = log_of(name, until_s=402.0 + max(described["correlation_s"]), runs=2000, states=ONLY[state], rate_hz=0.5)
    assert np.all(log.values("quality") == described["quality"])
    start = 200  # 402 s
    for axis, column in enumerate(POSITION):
        error = log.hidden(f"{column}.error")
        age = described.get("age_drift_m_s", [0.0] * 3)[axis] * 1.0  # corrections are 1 s old at these samples
        slow = math.hypot(described["correlated_sigma_m"][axis], age)
        sigma = math.hypot(slow, described["white_sigma_m"][axis])
        # 2000 runs: standard error 1.6 %.
        assert np.std(error[start]) == pytest.approx(sigma, rel=0.065)
        # Correlation time from what is left after one, r = e^-1 of the slow part: standard error 0.86/sqrt(2000) =
        # 1.9 % of one, 5.2 % of the time. 20 % allowed are 3.8 of it.
        lag = round(described["correlation_s"][axis] * 0.5)
        lag_s = lag / 0.5
        left = np.mean(error[start] * error[start + lag]) / slow**2
        expected = described["correlation_s"][axis]
        if age < 0.2 * slow:
            assert -lag_s / math.log(left) == pytest.approx(expected, rel=0.20)
        claimed = log.values(f"sigma_{column[9]}_m")[start]
        drifted = described.get("reported_age_drift_m_s", [0.0] * 3)[axis]
        np.testing.assert_allclose(claimed, math.hypot(described["reported_sigma_m"][axis], drifted), rtol=1e-12)


def test_float_lies_and_fix_does_not() -> None:
    # Normalised error squared: honest is 1. Float: (0.12^2 + 0.03^2) / 0.006^2 = 425 east; measured 209 to 1334.
    log = log_of("rtk_f9p", until_s=402.0, runs=2000, states=ONLY["float"], rate_hz=0.5)
    ratio = np.mean((log.hidden("position_e_m.error")[-1] / log.values("sigma_e_m")[-1]) ** 2)
    assert 209 < ratio < 1334
    log = log_of("rtk_f9p", until_s=10.0, runs=2000, rate_hz=0.5)
    ratio = np.mean((log.hidden("position_e_m.error")[-1] / log.values("sigma_e_m")[-1]) ** 2)
    assert 0.8 < ratio < 1.2


def test_age_is_told_as_long_as_corrections_are_in_use() -> None:
    log = log_of("rtk_f9p", LOST, until_s=330.0, rate_hz=1.0)
    age, single = log.values("age_s")[:, 0], log.values("quality")[:, 0] == 1.0
    assert np.isnan(age[single]).all()
    lost = (log.t_s >= 20.0) & ~single
    np.testing.assert_allclose(age[lost], log.t_s[lost] - 19.0, atol=1e-9)


def test_vertical_speed_has_its_noise_and_lag() -> None:
    values = preset("rtk_survey")
    log = drive(sensor(values, runs=range(500)), constant(1.0), 2.0)
    error = log.hidden("vertical_speed_m_s.error")
    # 500 runs * 20 samples; white 20 mm/s and 2 mm/s correlated: 20.1 mm/s to 0.7 %.
    assert np.std(error) == pytest.approx(math.hypot(0.02, 0.002), rel=4 * 0.007)
    # What is common to all samples of a run is the correlated part: variance of means 2^2 + 20^2/20 (mm/s)^2.
    assert np.var(error.mean(axis=0)) == pytest.approx(0.002**2 + 0.02**2 / 20, rel=4 * math.sqrt(2 / 500))
    assert "vertical_speed_m_s" not in sensor(preset("rtk_f9p")).columns


def test_heading_of_two_antennas() -> None:
    log = drive(sensor(preset("rtk_f9p_dual"), runs=range(500)), constant(1.0, heading_rad=3.14), 2.0)
    error = log.hidden("heading_rad.error")
    # 0.4 degrees, over half of it correlated over the 2 s: 500 independent runs at worst, 3.2 %. It wraps at pi.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(math.hypot(0.0035, 0.006), rel=4 * 0.032)
    assert np.ptp(log.values("heading_rad")) > 6.0
    assert np.all(log.values("sigma_heading_rad") == 0.00698)
    none = log_of("rtk_f9p_dual", until_s=1.0, state="differential")
    assert np.isnan(none.values("heading_rad")).all()
    assert np.isnan(none.values("sigma_heading_rad")).all()
