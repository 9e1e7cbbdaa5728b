"""The bound of the height: figures that were worked out apart, limits with known solutions, and what scenarios ask."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.sensors.motions import CONFIGS
from twin.scoring.height_bound import HeightBound, HeightErrors, height_bound
from twin.scoring.height_supply import Fixes, Lesser, Seen, supply_of
from twin.sensors.gnss_config import GnssConfig
from twin.sensors.presets import load_preset
from twin.signals import FloatArray

G = 9.80665
FIX = Fixes(correlated_m=0.0086, correlation_s=100.0, white_m=0.0017)


def lost_at_once(t: float) -> Seen:
    return Seen(fix_age_s=0.0 if t < 0.0 else None)


def bound(**changes: Any) -> HeightBound:
    """An MTi-300 (60 ug/rtHz as random walk, 15 ug for 300 s) with a smoothed F9P fix, lost for 60 s."""
    values = {"accel_noise_m_s2_rthz": 60e-6 * G, "bias_m_s2": 15e-6 * G, "bias_correlation_s": 300.0, "fix": FIX}
    return height_bound(HeightErrors(**(values | changes)), loss_s=60.1, seen=lost_at_once)


def tracking(noise: float, bias_m_s2: float) -> FloatArray:
    """Covariance of h, v, b and a unit c as the first fix is missing, from the algebraic Riccati equation."""
    T = 0.1
    keep_b, keep_c = math.exp(-T / 300.0), math.exp(-T / 100.0)
    F = np.array([[1.0, T, -0.5 * T * T, 0.0], [0.0, 1.0, -T, 0.0], [0.0, 0.0, keep_b, 0.0], [0.0, 0.0, 0.0, keep_c]])
    Q = np.diag([0.0, 0.0, bias_m_s2**2 * (1.0 - keep_b**2), 1.0 - keep_c**2])
    Q[:2, :2] = noise**2 * np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
    h = np.array([[1.0, 0.0, 0.0, FIX.correlated_m]])
    scale = np.array([1e-3, 1e-3, max(bias_m_s2, 1e-9), 1.0])
    scaled = F * scale / scale[:, np.newaxis], h * scale, Q / np.outer(scale, scale)
    found = solve_discrete_are(scaled[0].T, scaled[1].T, scaled[2], np.array([[FIX.white_m**2]]))
    return np.asarray(found * np.outer(scale, scale))


@pytest.mark.parametrize("sided", [1.0, 2.0], ids=["two-sided", "one-sided"])
def test_the_steady_state_solves_the_riccati_equation_in_both_readings_of_the_density(sided: float) -> None:
    noise = 60e-6 * G / math.sqrt(sided)
    found, expected = bound(accel_noise_m_s2_rthz=noise), np.sqrt(np.diagonal(tracking(noise, 15e-6 * G)))
    # The recursion stops when the bias's variance changes by less than a thousandth.
    assert found.sigma_m[0] == pytest.approx(expected[0], rel=1e-3)
    assert found.velocity_sigma_m_s[0] == pytest.approx(expected[1], rel=1e-3)
    assert found.bias_sigma_m_s2[0] == pytest.approx(expected[2], rel=1e-3)


@pytest.mark.parametrize("sided", [1.0, 2.0], ids=["two-sided", "one-sided"])
def test_without_a_bias_the_height_is_lost_by_velocity_and_white_noise(sided: float) -> None:
    """sigma^2 = P_hh + 2 P_hv t + P_vv t^2 + N^2 t^3 / 3, t from the first fix that is missing."""
    noise = 60e-6 * G / math.sqrt(sided)
    found, P = bound(accel_noise_m_s2_rthz=noise, bias_m_s2=1e-12), tracking(noise, 0.0)
    t_s = found.t_s
    expected = P[0, 0] + 2.0 * P[0, 1] * t_s + P[1, 1] * t_s**2 + noise**2 * t_s**3 / 3.0
    np.testing.assert_allclose(found.sigma_m, np.sqrt(expected), rtol=1e-3)


def test_figures_worked_out_apart() -> None:
    """The density as a two-sided one: height 8.6 mm, velocity 0.95 mm/s and bias 8 ug at the loss; 30 mm kept for 8.2 s
    by 95 %; 233 mm at 60 s."""
    found = bound()
    assert 1e3 * found.sigma_tracking_m == pytest.approx(8.6, abs=0.05)
    assert 1e3 * found.velocity_sigma_m_s[0] == pytest.approx(0.95, abs=0.005)
    assert 1e6 * found.bias_sigma_m_s2[0] / G == pytest.approx(8.0, abs=0.1)
    assert found.time_within_s(0.03) == pytest.approx(8.2, abs=0.05)
    assert 1e3 * found.sigma_at_end_m == pytest.approx(233.0, abs=0.5)


def test_a_vertical_speed_helps_late_more_than_early() -> None:
    """20 mm/s white at 10 Hz and 2 mm/s for 60 s: 86 mm in place of 233 at 60 s, but 30 mm for little longer."""
    found = bound(speed_white_m_s=0.02, speed_correlated_m_s=0.002)
    assert 1e3 * found.sigma_at_end_m == pytest.approx(86.0, abs=0.5)
    assert found.time_within_s(0.03) == pytest.approx(9.4, abs=0.1)


def test_white_noise_alone_from_a_known_state() -> None:
    """N sqrt(t^3 / 3): 30 mm for 12.7 s by 95 %, for 26 s by half of all."""
    perfect = Fixes(correlated_m=1e-9, correlation_s=100.0, white_m=1e-7)
    found = bound(bias_m_s2=1e-12, fix=perfect)
    t_s = found.t_s + 0.1  # the last fix came a period before the first that was missing
    expected = 60e-6 * G * np.sqrt(t_s**3 / 3.0)
    # a velocity is still to be known from the fixes: of the noise's own size within one period
    np.testing.assert_allclose(found.sigma_m[50:], expected[50:], rtol=0.02)
    assert found.time_within_s(0.03) + 0.1 == pytest.approx(12.7, abs=0.1)
    assert found.time_within_s(0.03, 0.5) + 0.1 == pytest.approx(25.8, abs=0.1)


def test_no_loss_no_time() -> None:
    found = height_bound(
        HeightErrors(accel_noise_m_s2_rthz=6e-4, bias_m_s2=1e-4, bias_correlation_s=100.0, fix=FIX),
        loss_s=20.0,
        seen=lambda _: Seen(fix_age_s=1.0),
    )
    assert found.time_within_s(0.03) == math.inf
    np.testing.assert_allclose(found.sigma_m, found.sigma_tracking_m, rtol=0.01)


def test_dilution_is_a_factor_on_all_errors_of_the_receiver() -> None:
    speed = {"speed_white_m_s": 0.02, "speed_correlated_m_s": 0.002}
    twice = Fixes(correlated_m=2.0 * FIX.correlated_m, correlation_s=100.0, white_m=2.0 * FIX.white_m)
    errors = {"accel_noise_m_s2_rthz": 6e-4, "bias_m_s2": 1e-4, "bias_correlation_s": 100.0}
    diluted = height_bound(
        HeightErrors(**errors, **speed, fix=FIX),
        loss_s=20.0,
        seen=lambda t: Seen(fix_age_s=0.0 if t < 0.0 else None, dilution=2.0),
    )
    worse = height_bound(
        HeightErrors(**errors, **{name: 2.0 * value for name, value in speed.items()}, fix=twice),
        loss_s=20.0,
        seen=lost_at_once,
    )
    # Both stop as soon as they hardly change.
    np.testing.assert_allclose(diluted.sigma_m, worse.sigma_m, rtol=1e-3)
    np.testing.assert_allclose(diluted.velocity_sigma_m_s, worse.velocity_sigma_m_s, rtol=1e-3)


def test_a_lesser_states_error_goes_on_while_the_receiver_is_in_another() -> None:
    """A float against a known height, 5 s of a useless differential solution, the same float: it has hardly changed."""
    size, tau_s = 0.37, 170.0
    floating = Lesser(name="float", correlated_m=size, correlation_s=tau_s, white_m=1e-6)
    useless = Lesser(name="differential", correlated_m=1e4, correlation_s=100.0, white_m=1e4)

    def seen(t: float) -> Seen:
        if t < 0.0:
            return Seen(fix_age_s=0.0)
        return Seen(lesser=floating if t < 0.05 or t > 4.95 else useless)

    perfect = Fixes(correlated_m=1e-9, correlation_s=100.0, white_m=1e-6)
    # So much noise that 5 s later inertia knows the height to metres only.
    errors = HeightErrors(accel_noise_m_s2_rthz=1.0, bias_m_s2=1e-9, bias_correlation_s=100.0, fix=perfect)
    found = height_bound(errors, loss_s=5.1, seen=seen)
    # The first float sample shares its misfit between float and a height that 0.1 s of noise have spoilt.
    # Heights without error leave a velocity variance of T / sqrt(12), the fixed point of the update.
    spoilt = 0.1**3 * (1.0 / 3.0 + 1.0 / math.sqrt(12.0))
    left = size**2 * spoilt / (size**2 + spoilt)
    kept = math.exp(-2.0 * 5.0 / tau_s)
    assert found.sigma_m[0] == pytest.approx(math.sqrt(left), rel=0.01)
    assert found.sigma_m[50] == pytest.approx(math.sqrt(left * kept + size**2 * (1.0 - kept)), rel=0.01)


# --- what a receiver offers ------------------------------------------------------------------------------------------


def receiver(preset: str, *faults: dict[str, Any]) -> GnssConfig:
    config = CONFIGS.validate_python({"mount": "here", **load_preset(preset), "faults": list(faults)})
    assert isinstance(config, GnssConfig)
    return config


def offers(config: GnssConfig, *times_s: float) -> list[Seen]:
    supply = supply_of(config, begin_s=50.0)
    assert supply is not None
    return [supply.at(t) for t in times_s]


def test_corrections_lost_age_and_then_the_receiver_falls() -> None:
    lost = {"kind": "corrections_lost", "from_s": 50.0, "to_s": 150.0}
    before, first, late, fallen = offers(receiver("rtk_chcnav_i70", lost), -0.5, 0.0, 8.9, 9.5)
    assert before.fix_age_s == pytest.approx(1.5)
    # the set that arrives at the very moment is lost: the newest is that of 48 s
    assert first.fix_age_s == pytest.approx(1.0) or first.fix_age_s == pytest.approx(2.0)
    assert late.fix_age_s is not None
    assert fallen.lesser is not None
    assert fallen.lesser.name == "differential"
    assert fallen.speed


def test_a_float_grows_as_the_sensor_lets_it() -> None:
    masked = {"kind": "satellites_masked", "satellites": 6, "from_s": 50.0, "to_s": 400.0}
    entered, grown = offers(receiver("rtk_f9p", masked), 0.0, 300.0)
    assert entered.lesser is not None
    assert grown.lesser is not None
    assert entered.lesser.name == grown.lesser.name == "float"
    assert entered.lesser.correlated_m == pytest.approx(0.37 * 0.37)
    assert grown.lesser.correlated_m == pytest.approx(0.37 * (1.0 - 0.63 * math.exp(-3.0)))


def test_a_state_is_entered_with_a_part_of_its_error_from_above_and_with_all_of_it_from_below() -> None:
    masks = [
        {"kind": "satellites_masked", "satellites": 6, "from_s": 50.0, "to_s": 80.0},
        {"kind": "satellites_masked", "satellites": 4, "from_s": 60.0, "to_s": 65.0},
        {"kind": "satellites_masked", "satellites": 6, "from_s": 90.0, "to_s": 100.0},
    ]
    fallen, single, climbed, fixed, again = offers(receiver("rtk_f9p", *masks), 0.0, 12.0, 20.0, 35.0, 40.0)
    assert single.lesser is not None
    assert single.lesser.name == "single"
    assert fixed.fix_age_s is not None
    sizes = [seen.lesser.correlated_m for seen in (fallen, climbed, again) if seen.lesser is not None]
    assert sizes == pytest.approx([0.37 * 0.37, 0.37, 0.37 * 0.37])
    # Of 20 satellites; the fix has 24 of 24.
    assert [fallen.dilution, single.dilution] == pytest.approx([math.sqrt(17.0 / 3.0), math.sqrt(17.0)])
    assert fixed.dilution == 1.0


def test_a_receiver_that_is_pinned_to_its_fix_keeps_it() -> None:
    masked = {"kind": "satellites_masked", "satellites": 5, "from_s": 50.0, "to_s": 60.0}
    config = CONFIGS.validate_python({"mount": "here", **load_preset("rtk_f9p"), "state": "fix", "faults": [masked]})
    assert isinstance(config, GnssConfig)
    (seen,) = offers(config, 5.0)
    assert seen.fix_age_s is not None
    assert seen.dilution == pytest.approx(math.sqrt(21.0 / 2.0))


def test_outages_and_stuck_or_wrong_heights_offer_no_position() -> None:
    window = {"from_s": 50.0, "to_s": 60.0}
    (silent,) = offers(receiver("rtk_chcnav_i70", {"kind": "outage", **window}), 5.0)
    assert silent == Seen(speed=False)
    stuck = {"kind": "stuck", "columns": ["position_u_m"], **window}
    wrong = {"kind": "wrong_fix", "offset_m": [0.0, 0.0, 0.2], **window}
    late = {"kind": "latency_step", "latency_s": 0.5, **window}
    for fault in (stuck, wrong):
        within, after = offers(receiver("rtk_chcnav_i70", fault), 5.0, 10.0)
        assert within == Seen(speed=True)
        assert after.fix_age_s is not None
    (harmless,) = offers(receiver("rtk_chcnav_i70", late), 5.0)
    assert harmless.fix_age_s is not None


def test_a_receiver_that_cannot_fix_has_no_bound() -> None:
    assert supply_of(receiver("single_point"), begin_s=0.0) is None
