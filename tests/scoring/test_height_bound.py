"""The bound of the height: figures that were worked out apart, limits with known solutions, and what scenarios ask."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.sensors.motions import CONFIGS
from twin.scoring.height_bound import HeightBound, HeightErrors, height_bound
from twin.scoring.height_supply import Fixes, Seen, supply_of
from twin.sensors.gnss_config import GnssConfig
from twin.sensors.presets import load_preset

G = 9.80665
FIX = Fixes(correlated_m=0.0086, correlation_s=100.0, white_m=0.0017)


def lost_at_once(t: float) -> Seen:
    return Seen(fix_age_s=0.0 if t < 0.0 else None)


def bound(**changes: Any) -> HeightBound:
    """An MTi-300 (60 ug/rtHz as random walk, 15 ug for 300 s) with a smoothed F9P fix, lost for 60 s."""
    values = {"accel_noise_m_s2_rthz": 60e-6 * G, "bias_m_s2": 15e-6 * G, "bias_correlation_s": 300.0, "fix": FIX}
    return height_bound(HeightErrors(**(values | changes)), loss_s=60.1, seen=lost_at_once)


def test_figures_worked_out_apart() -> None:
    """Height 8.6 mm, velocity 0.95 mm/s and bias 8 ug at the loss; 30 mm kept for 8.2 s by 95 %; 233 mm at 60 s."""
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
