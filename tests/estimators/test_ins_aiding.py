"""What the strapdown filter makes of samples: how far receivers are believed, whose clocks, and AccoSats."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.planter import accosat, accosat_info, make_setup, radar, receiver, report, sensors
from twin.estimators.ins_aiding import PulseAid, ReceiverAid, ReceiverTrust, pulse_model, pulse_observation
from twin.estimators.ins_filter import AidReading
from twin.estimators.ins_model import CORE_STATES, ReceiverModel
from twin.signals import Measurement

SIZE = CORE_STATES + 4
SHEET = {
    "position_noise_m": 0.02,
    "latency_s": 0.08,
    "speed_noise_m_s": 0.004,
    "speed_noise_ratio": 0.005,
}
T_NS = 10_000_000_000


def aid(
    *, robust: bool = True, tilt_rad: float = 0.0, trust: ReceiverTrust | None = None, **sheet: float
) -> ReceiverAid:
    info = replace(receiver("gnss"), datasheet={**SHEET, **sheet})
    model = ReceiverModel(name="gnss", arm_m=(0.0, 0.0, 2.0), velocity_lag_s=0.1, correlation_s=200.0, at=CORE_STATES)
    return ReceiverAid(
        info, model, trust or ReceiverTrust(), make_setup({"gnss": info}, runs=1), size=SIZE, robust=robust,
        mounting_tilt_rad=tilt_rad,
    )  # fmt: skip


def with_age(m: Measurement, age_s: float) -> Measurement:
    values = m.values.copy()
    values[:, -1] = age_s
    return replace(m, values=values)


def sample(*, late_s: float = 0.08, **more) -> Measurement:
    return report("gnss", T_NS, 1.0, 2.0, 2.5, t_available_ns=T_NS + round(late_s * 1e9), **more)


def read(one: ReceiverAid, m: Measurement, speed: float = 2.5) -> tuple[AidReading, AidReading]:
    velocity, position = one.read(m, np.full(len(m.values), speed))
    assert position.receiver is not None
    return velocity, position


def sigma(m: Measurement, **more) -> float:
    found = read(aid(**more), m)[1].receiver
    assert found is not None
    return float(found.sigma_m[0])


def white(m: Measurement) -> float:
    return float(np.sqrt(read(aid(), m)[1].variances[0, 0]))


@pytest.mark.parametrize(("quality", "floor"), [(4, 0.003), (5, 0.25), (2, 0.5), (3, 0.5), (1, 1.0), (6, 1.0)])
def test_no_receiver_is_believed_better_than_the_floor_of_its_state(quality: int, floor: float) -> None:
    """A floating solution reports millimetres and errs by decimetres; a larger word is taken as it is."""
    assert sigma(with_age(sample(quality=quality, sigma_m=0.001), 0.5)) == pytest.approx(floor)
    assert sigma(with_age(sample(quality=quality, sigma_m=3.0), 0.5)) == pytest.approx(3.0)
    trust = ReceiverTrust(fix_m=0.02, float_m=0.02, differential_m=0.02, single_m=0.02)
    assert sigma(with_age(sample(quality=quality, sigma_m=0.001), 0.5), trust=trust) == pytest.approx(0.02)


@pytest.mark.parametrize("unknown", [0.0, math.nan])
def test_a_sigma_of_zero_or_none_means_unknown(unknown: float) -> None:
    """Then the data sheet's 20 mm, of which 0.26 is new in every sample."""
    assert sigma(with_age(sample(sigma_m=unknown), 0.5)) == pytest.approx(0.02)
    assert white(sample(sigma_m=unknown)) == pytest.approx(0.26 * 0.02)


def test_what_is_new_in_every_sample_is_a_share_of_what_it_says_and_never_nothing() -> None:
    assert white(sample(sigma_m=0.0031)) == pytest.approx(0.26 * 0.0031)
    assert white(sample(sigma_m=1e-5)) == pytest.approx(0.0005)


def test_a_fix_errs_more_with_the_age_of_its_corrections() -> None:
    """0.74 mm/s an axis after the first two seconds: 30 s old is 20.7 mm beside 3; a float stays as it is."""
    assert sigma(with_age(sample(sigma_m=0.003), 2.0)) == pytest.approx(0.003)
    assert sigma(with_age(sample(sigma_m=0.003), 30.0)) == pytest.approx(math.hypot(0.003, 0.00074 * 28.0))
    assert sigma(with_age(sample(sigma_m=0.003), math.nan)) == pytest.approx(0.003)
    assert sigma(with_age(sample(sigma_m=0.003, quality=5), 30.0)) == pytest.approx(0.25)


def test_the_tilt_of_the_units_turns_the_lever_arm() -> None:
    """0.5 degrees on a mast of 2 m: 17 mm."""
    tilt = math.radians(0.5)
    assert sigma(with_age(sample(sigma_m=0.003), 1.0), tilt_rad=tilt) == pytest.approx(math.hypot(0.003, 2.0 * tilt))


def test_no_fix_is_no_position_but_maybe_a_velocity() -> None:
    velocity, position = read(aid(), sample(quality=0))
    assert not position.mask[0]
    assert velocity.mask[0]
    for nothing in (math.nan, math.inf):
        blind = report("gnss", T_NS, nothing, nothing, nothing)
        values = blind.values.copy()
        values[:, 4] = nothing
        assert not any(each.mask[0] for each in read(aid(), replace(blind, values=values)))


def test_velocity_is_east_and_north_with_the_noise_of_the_data_sheet_at_the_filter_s_speed() -> None:
    m = sample()
    values = m.values.copy()
    values[:, 3:5] = 2.0, math.radians(120.0)
    velocity = read(aid(), replace(m, values=values), speed=3.0)[0]
    np.testing.assert_allclose(velocity.z, [[-1.0, math.sqrt(3.0)]])
    np.testing.assert_allclose(velocity.variances, 0.004**2 + (0.005 * 3.0) ** 2)


@pytest.mark.parametrize(
    ("late_s", "about_s", "distrust_s"),
    [
        (0.08, 0.0, 0.0),  # as its data sheet says
        (0.20, 0.0, 0.0),  # a little late
        (-0.22, -0.22 - 0.08, 0.0),  # arrives before it was taken: the clock is 0.3 s ahead
        (0.38, 0.0, 0.30),  # the clock is behind, or the sample is late
    ],
)
def test_whose_clock_is_believed(late_s: float, about_s: float, distrust_s: float) -> None:
    """``about_s``: time the sample is taken to be about, after its stamp; ``distrust_s``: what it may be off by."""
    m = with_age(sample(late_s=late_s, sigma_m=0.003), 1.0)
    about_ns, late = aid().time_ns(m)
    assert (about_ns - T_NS) / 1e9 == pytest.approx(about_s)
    assert late == pytest.approx(distrust_s)
    velocity, position = read(aid(), m)
    # At 2.5 m/s it may be elsewhere by that way, and another velocity by 0.5 m/s^2.
    assert position.receiver is not None
    assert position.receiver.sigma_m[0] == pytest.approx(math.hypot(0.003, 2.5 * distrust_s))
    still = 0.004**2 + (0.005 * 2.5) ** 2
    assert velocity.variances[0, 0] == pytest.approx(still + (0.5 * distrust_s) ** 2)
    # Not robust: stamps are believed, up to the time of arrival.
    assert aid(robust=False).time_ns(m) == (min(m.t_ns, m.t_available_ns), 0.0)


def test_members_are_read_apart() -> None:
    m = report("gnss", T_NS, [1.0, 2.0, 3.0], 0.0, 2.5, quality=[4, 5, 0], sigma_m=[0.01, 0.01, 0.01])
    one = aid()
    _, position = read(one, m)
    assert position.receiver is not None
    np.testing.assert_array_equal(position.mask, [True, True, False])
    np.testing.assert_allclose(position.receiver.sigma_m[:2], [0.01, 0.25])
    np.testing.assert_array_equal(position.receiver.state, [4, 5, 0])
    slow, known = one.slow(report("gnss", T_NS, 0.0, 0.0, [0.01, 1.0, math.nan]))
    np.testing.assert_array_equal(slow, [True, False, False])
    np.testing.assert_array_equal(known, [True, True, False])


# --- pulses ---------------------------------------------------------------------------------------------------------


def pulse_aid(*, zero_is_speed: bool = False) -> PulseAid:
    info = sensors()["radar"]
    setup = make_setup({"radar": info})
    model = replace(pulse_model(info, setup, accosat_correlation_s=3.0), at=CORE_STATES)
    seen = pulse_observation(model, size=SIZE)
    return PulseAid(info, model, seen, setup, zero_is_speed=zero_is_speed)


def test_no_pulses_are_a_cue_of_standing_and_no_speed() -> None:
    m = radar(T_NS, [2.0, 0.0, math.nan])
    (told,) = pulse_aid().read(m)
    np.testing.assert_array_equal(told.mask, [True, False, False])
    slow, known = pulse_aid().slow(m)
    np.testing.assert_array_equal(slow, [False, True, False])
    np.testing.assert_array_equal(known, [True, True, False])
    (told,) = pulse_aid(zero_is_speed=True).read(m)
    np.testing.assert_array_equal(told.mask, [True, True, False])


@pytest.mark.parametrize(("up_s", "down_s"), [(0.2, 0.7), (0.7, 0.2), (0.0, 0.7), (0.7, 0.0)])
def test_a_radar_s_data_sheet_tells_the_noise_behind_its_faster_lag(up_s: float, down_s: float) -> None:
    """What the data sheet of :mod:`twin.sensors.radar` says, turned back into the noise of the input."""
    faster = min(up_s, down_s)
    gain = 1.0 - math.exp(-0.02 / faster) if faster else 1.0
    output = 0.05 * math.sqrt(gain / (2.0 - gain))
    sheet = {"speed_noise_m_s": output, "lag_speeding_up_s": up_s, "lag_braking_s": down_s}
    info = replace(sensors()["radar"], datasheet={**sheet, "mounting_angle_rad": math.radians(35.0)})
    model = pulse_model(info, make_setup({"radar": info}), accosat_correlation_s=3.0)
    assert model.speed_noise_m_s == pytest.approx(0.05)
    assert model.lags_s == (up_s, down_s)
    assert model.beam_slope == pytest.approx(math.tan(math.radians(35.0)))
    assert model.arm_m == (0.2, 0.0, 0.6)


def test_an_accosat_is_a_speed_without_lag_and_with_twice_its_data_sheet_s_error_slowly_changing() -> None:
    info = replace(accosat_info(), datasheet={"speed_noise_m_s": 0.03})
    setup = make_setup({"accosat": info})
    model = pulse_model(info, setup, accosat_correlation_s=3.0)
    assert (model.lags_s, model.beam_slope) == ((0.0, 0.0), 0.0)
    assert model.slow_error == pytest.approx((0.06, 3.0))
    one = PulseAid(info, model, pulse_observation(model, size=SIZE), setup, zero_is_speed=False)
    (told,) = one.read(accosat(T_NS, 1.5))
    assert told.z[0, 0] == 1.5
    assert told.speed_source
