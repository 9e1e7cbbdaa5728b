"""The controller of a blade: what it asks of the lift."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from twin.control import LevellingControlConfig, build_implement
from twin.control.levelling import LevellingControl
from twin.paths import MACHINES
from twin.signals import HEIGHT, VELOCITY, Command, Knowledge, Said, sigma_column
from twin.world.lift import Lift
from twin.world.machine import Actuation
from twin.world.scraper import LIFT
from twin.world.urdf import read_urdf

UP, SIGMA = VELOCITY[2], sigma_column(HEIGHT)
STEP_S, DT_S = 0.02, 0.002


def _config(**keys: Any) -> LevellingControlConfig:
    return LevellingControlConfig(kind="levelling", **{"follows": "est", **keys})


def _ask(
    control: LevellingControl, values: dict[str, float] | None, *, raised: bool = False, load: float = 0.0
) -> float:
    """Lift speed asked for once an estimator has said this."""
    said = {} if values is None else {"est": Said(t_ns=0, values=values)}
    command = Command(speed_m_s=1.0, raised=raised)
    return control.amend(command, Knowledge(t_ns=0, said=said, load_share=load)).lift_m_s


def _asked(config: LevellingControlConfig, *sequence: dict[str, float] | None, **options: Any) -> float:
    """Lift speed asked for after an estimator has said these things one after the other."""
    control = build_implement(config)
    assert isinstance(control, LevellingControl)
    return [_ask(control, values, **options) for values in sequence][-1]


def test_it_pushes_towards_the_target_in_proportion() -> None:
    assert _asked(_config(gain_1_s=2.0), {HEIGHT: 0.1}) == pytest.approx(-0.2)
    assert _asked(_config(gain_1_s=2.0), {HEIGHT: -0.05}) == pytest.approx(0.1)
    assert _asked(_config(gain_1_s=2.0, target_m=0.05), {HEIGHT: 0.1}) == pytest.approx(-0.1)
    assert _asked(_config(target_m=0.05), {HEIGHT: 0.05}) == 0.0


def test_what_the_ground_does_meanwhile_is_reckoned_with() -> None:
    """The lift still stands, so all of the vertical speed is the ground's, for dead time and lag."""
    config = _config(gain_1_s=2.0, dead_time_s=0.16, lag_s=0.04)
    assert _asked(config, {HEIGHT: 0.0, UP: 0.1}) == pytest.approx(-2.0 * 0.2 * 0.1)
    assert _asked(config, {HEIGHT: 0.1, UP: math.nan}) == pytest.approx(-2.0 * 0.1)


def test_what_the_lift_will_do_by_itself_is_not_asked_for_again() -> None:
    """After a step of the command, what is under way is what the world's lift still does when it ends."""
    control = build_implement(_config(gain_1_s=1.0, dead_band_m=0.0))
    assert isinstance(control, LevellingControl)
    lift, q = Lift(LIFT, read_urdf(MACHINES / "scraper.urdf")), [0.0] * 32
    out = Actuation(torque_n_m=np.zeros(32), brake_n_m=np.zeros(32), servo_rad_s=[0.0] * 32)

    def move(asked_m_s: float) -> None:
        for _ in range(round(STEP_S / DT_S)):
            lift.step(asked_m_s, q, DT_S, out)
            q[lift.joint] += out.servo_rad_s[lift.joint] * DT_S

    model, asked_m_s, places, under_way = control._lift, 0.1, [], []
    for _ in range(20):
        model.step(asked_m_s)
        move(asked_m_s)
        places.append(q[lift.joint])
        under_way.append(model.under_way_m)
    for _ in range(50):
        move(0.0)
    # All that was asked for is 0.1 m/s x 0.4 s.
    assert q[lift.joint] == pytest.approx(0.04, rel=0.02)
    assert np.array(places) + under_way == pytest.approx(asked_m_s * STEP_S * np.arange(1, 21), abs=0.02 * 0.04)
    # With the blade that far below the plane the error and what comes cancel.
    assert _ask(control, {HEIGHT: -under_way[-1]}) == pytest.approx(0.0, abs=1e-12)


def test_a_step_of_the_height_is_taken_without_overshoot() -> None:
    """With its lift as the controller knows it, the loop is of first order: e(t) = e0 exp(-k (t - T))."""
    config = _config(gain_1_s=2.0, dead_band_m=0.0, dead_time_s=0.12, lag_s=0.0)
    control = build_implement(config)
    assert isinstance(control, LevellingControl)
    height, waiting, heights = 0.05, [0.0] * 6, []
    for _ in range(100):
        rate = waiting[0]
        waiting = [*waiting[1:], _ask(control, {HEIGHT: height, UP: rate})]
        height += STEP_S * rate
        heights.append(height)
    assert min(heights) > -1e-3
    assert heights[round(1.12 / STEP_S)] == pytest.approx(0.05 * math.exp(-2.0), rel=0.1)


def test_the_dead_band_keeps_the_valve_shut() -> None:
    assert _asked(_config(dead_band_m=0.01), {HEIGHT: 0.009}) == 0.0
    assert _asked(_config(dead_band_m=0.01), {HEIGHT: 0.011}) < 0.0


@pytest.mark.parametrize(("load", "eased_m"), [(0.0, 0.0), (0.7, 0.0), (0.85, 0.03), (1.0, 0.06), (1.5, 0.06)])
def test_a_full_blade_is_let_up(load: float, eased_m: float) -> None:
    config = _config(gain_1_s=2.0, ease_from_share=0.7, ease_m=0.06)
    assert _asked(config, {HEIGHT: 0.1}, load=load) == pytest.approx(-2.0 * (0.1 - eased_m))


@pytest.mark.parametrize("said", [None, {HEIGHT: math.nan}])
def test_without_a_height_the_blade_goes_up(said: dict[str, float] | None) -> None:
    assert _asked(_config(), said) > LIFT.fastest_up_m_s


def test_the_driver_can_have_it_raised() -> None:
    assert _asked(_config(), {HEIGHT: 0.5}, raised=True) > LIFT.fastest_up_m_s


def test_it_is_raised_while_sigma_is_too_large_and_lowered_with_some_hysteresis() -> None:
    config = _config(raise_when_sigma_m=0.010)

    def height(sigma_m: float) -> dict[str, float]:
        return {HEIGHT: 0.1, SIGMA: sigma_m}

    assert _asked(config, height(0.0099)) < 0.0
    assert _asked(config, height(0.0101)) > 0.0
    assert _asked(config, height(math.nan)) > 0.0
    assert _asked(config, height(0.0101), height(0.009)) > 0.0
    # What went up has not come down yet: the second is seen from far enough below.
    assert _asked(config, height(0.0101), {HEIGHT: 0.5, SIGMA: 0.0079}) < 0.0
    assert _asked(_config(), height(1.0)) < 0.0


def test_who_follows_the_truth_never_loses_it() -> None:
    config = _config(follows="truth", raise_when_sigma_m=0.010, gain_1_s=2.0)
    knowledge = Knowledge(t_ns=0, implement=Said(t_ns=0, values={HEIGHT: 0.1}))
    assert build_implement(config).amend(Command(), knowledge).lift_m_s == pytest.approx(-0.2)
    assert config.needed_columns == {}


def test_it_tells_whom_it_listens_to_and_what_it_needs() -> None:
    assert _config().listens.closes_loop
    assert not _config().listens.truth
    assert not _config(follows="truth").listens.closes_loop
    assert _config().needed_columns == {"est": (HEIGHT,)}
    assert _config(raise_when_sigma_m=0.03).needed_columns == {"est": (HEIGHT, SIGMA)}
