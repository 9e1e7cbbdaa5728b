"""The GNSS receiver: errors per axis and state, velocity, course, reports."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, STANDING, circle, constant, drive, preset, ramp, sensor
from twin.sensors.presets import load_preset, preset_files
from twin.signals import POSITION

PERFECT: dict[str, Any] = {
    "kind": "gnss",
    "rate_hz": 10.0,
    "state": "ideal",
    "states": {
        "ideal": {
            "quality": 4,
            "correlated_sigma_m": [0.0, 0.0, 0.0],
            "correlation_s": [1.0, 1.0, 1.0],
            "white_sigma_m": [0.0, 0.0, 0.0],
            "reported_sigma_m": [0.01, 0.02, 0.03],
            "velocity_noise_m_s": 0.0,
            "satellites": 12,
            "hdop": 0.9,
            "vdop": 1.5,
        }
    },
}


def test_perfect_receiver_gives_position_speed_and_course_of_its_mount() -> None:
    log = drive(sensor(PERFECT), circle(2.0, 10.0), 20.0)
    angle = 0.2 * log.t_s
    np.testing.assert_allclose(log.values("position_e_m")[:, 0], 10.0 * np.sin(angle), atol=1e-9)
    np.testing.assert_allclose(log.values("position_n_m")[:, 0], 10.0 - 10.0 * np.cos(angle), atol=1e-9)
    np.testing.assert_allclose(log.values("speed_m_s"), 2.0, rtol=1e-12)
    course = log.values("course_rad")[:, 0]
    np.testing.assert_allclose(np.cos(course - angle), 1.0, atol=1e-12)
    # The course wraps (20 s are 4 rad), its true error does not jump there.
    assert np.all(np.abs(course) <= np.pi)
    assert np.abs(log.hidden("course_rad.error")).max() < 1e-9


@pytest.mark.parametrize("state", ["fix", "float", "differential", "single"])
def test_position_error_has_sigma_and_correlation_time_of_its_state_on_each_axis(state: str) -> None:
    values = preset("rtk_f9p")
    described = values["states"][state]
    device = sensor(values | {"state": state, "rate_hz": 1.0}, runs=range(1500))
    log = drive(device, STANDING, max(described["correlation_s"]) + 1.0)
    for axis, column in enumerate(POSITION):
        sigma = math.hypot(described["correlated_sigma_m"][axis], described["white_sigma_m"][axis])
        error = log.hidden(f"{column}.error")
        # 1500 runs: sigma to 1/sqrt(3000) = 1.8 %, four of them; the same at the begin and at the end.
        assert np.std(error[0]) == pytest.approx(sigma, rel=0.073)
        assert np.std(error[-1]) == pytest.approx(sigma, rel=0.073)
        np.testing.assert_allclose(log.values(column), error, atol=1e-12)
        # A correlation time later 1/e of the correlated part is left: standard error (1 - r^2)/sqrt(1500) <= 0.026.
        later = round(described["correlation_s"][axis])
        left = described["correlated_sigma_m"][axis] ** 2 / sigma**2 / math.e
        assert np.corrcoef(error[0], error[later])[0, 1] == pytest.approx(left, abs=4 * 0.026)
        # From one sample to the next the white part alone is new: differences have 2 (white^2 + gm^2 (1 - e^{-T/tau})).
        fresh = 1.0 - math.exp(-1.0 / described["correlation_s"][axis])
        step = 2.0 * (described["white_sigma_m"][axis] ** 2 + described["correlated_sigma_m"][axis] ** 2 * fresh)
        assert np.var(error[1] - error[0]) == pytest.approx(step, rel=4 * math.sqrt(2.0 / 1500))


def test_axes_and_runs_err_independently() -> None:
    log = drive(sensor(preset("rtk_f9p"), runs=range(1500)), STANDING, 0.2)
    errors = np.stack([log.hidden(f"{column}.error")[0] for column in POSITION])
    # Standard error of no correlation: 1/sqrt(1500) = 0.026.
    assert np.abs(np.corrcoef(errors) - np.eye(3)).max() < 4 * 0.026


def test_reports_are_those_of_the_state_whatever_the_true_error() -> None:
    log = drive(sensor(preset("rtk_f9p") | {"state": "float"}), STANDING, 1.0)
    sample = log.measurements[0]
    reported = [sample.column(name)[0] for name in ("sigma_e_m", "sigma_n_m", "sigma_u_m", "quality", "satellites")]
    assert reported == [0.006, 0.006, 0.011, 5.0, 20.0]
    assert [sample.column(name)[0] for name in ("hdop", "vdop")] == [0.8, 1.4]


def test_age_of_corrections_is_a_saw_tooth_and_nothing_without_corrections() -> None:
    log = drive(sensor(PERFECT | {"corrections_interval_s": 1.0, "corrections_delay_s": 0.5}), STANDING, 2.0)
    # A set is made at every full second and is there half a second later: 1.4 s old at most, 0.5 s at least.
    expected = 0.5 + (np.arange(1, 21) + 5) % 10 / 10
    np.testing.assert_allclose(log.values("age_s")[:, 0], expected, atol=1e-12)
    assert np.isnan(drive(sensor(preset("single_point")), STANDING, 1.0).values("age_s")).all()


def test_course_is_nonsense_at_standstill_and_good_at_speed() -> None:
    still = drive(sensor(preset("rtk_f9p"), runs=range(300)), STANDING, 1.0)
    course = still.values("course_rad").ravel()
    # 3000 uniform directions: the mean direction's length is Rayleigh with mean square 1/3000; 4/sqrt(3000) is e^{-16}.
    assert np.abs(np.exp(1j * course).mean()) < 4 / math.sqrt(3000)
    assert np.isnan(still.hidden("course_rad.error")).all()
    # Speed is the modulus of two normal numbers: rms sqrt(2) * 3.5 mm/s = 4.9 mm/s, measured 4 to 6 mm/s.
    assert math.sqrt(np.mean(still.values("speed_m_s") ** 2)) == pytest.approx(0.00495, rel=0.06)
    moving = drive(sensor(preset("rtk_f9p"), runs=range(300)), constant(2.0, heading_rad=1.0), 1.0)
    # sqrt(3.5^2 + (0.005 * 2000)^2) = 10.6 mm/s across, over 2 m/s: 5.3 mrad. 3000 values: 1.3 %.
    assert np.std(moving.hidden("course_rad.error")) == pytest.approx(0.0053, rel=0.06)
    assert np.mean(moving.values("course_rad")) == pytest.approx(1.0, abs=4 * 0.0053 / math.sqrt(3000))


def test_low_cost_course_spreads_as_measured_on_a_tractor() -> None:
    # Half of the courses at 2 m/s within +-1.1 degrees.
    log = drive(sensor(preset("single_point"), runs=range(500)), constant(2.0), 2.0)
    inside = np.mean(np.abs(log.hidden("course_rad.error")) < math.radians(1.1))
    # 5000 values: standard error 0.7 %; the standstill noise of 3.5 mm/s widens by 0.2 %.
    assert inside == pytest.approx(0.5, abs=0.03)


GNSS_PRESETS = [name for name in sorted(preset_files()) if load_preset(name)["kind"] == "gnss"]


@pytest.mark.parametrize("name", GNSS_PRESETS)
def test_speed_lags_by_the_receivers_filter_at_the_presets_own_rate(name: str) -> None:
    # Behind a first-order lag, y' = (u - y) / tau, a ramp u = a t has y = a (t - tau) once e^{-t/tau} is over: at every
    # instant, whatever the rate at which it is looked at. An input held at its mean over the interval T instead gives
    # y = a (t - (T/2) coth(T / (2 tau))), 8 % later for T = tau = 0.1 s. Noise is taken out.
    values = preset(name)
    quiet = {state: described | {"velocity_noise_m_s": 0.0, "velocity_noise_ratio": 0.0} for state, described in
             values["states"].items()}  # fmt: skip
    device = sensor(values | {"states": quiet})
    log = drive(device, ramp(1.0, 0.5, from_s=2.0, to_s=12.0), 12.0)
    late = log.t_s > 6.0
    truth = 1.0 + 0.5 * (log.t_s[late] - 2.0)
    shift = (truth - log.values("speed_m_s")[late, 0]) / 0.5
    assert values["velocity_lag_s"] > 0.0
    np.testing.assert_allclose(shift, values["velocity_lag_s"], rtol=0.1)


def test_position_is_given_in_steps_of_its_resolution() -> None:
    log = drive(sensor(preset("single_point")), constant(0.3), 20.0)
    steps = log.values("position_e_m") / 0.0185
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def test_a_state_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValidationError, match="state = 'fixed' is none of the states ideal"):
        CONFIGS.validate_python(PERFECT | {"mount": "m", "state": "fixed"})
