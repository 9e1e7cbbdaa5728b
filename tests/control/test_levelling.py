"""The controller of a blade: what it asks of the lift."""

from __future__ import annotations

import math

import pytest

from twin.control import LevellingControlConfig, build_implement
from twin.signals import HEIGHT, VELOCITY, Command, Knowledge, Said, sigma_column

UP = VELOCITY[2]


def _asked(config: LevellingControlConfig, *sequence: dict[str, float] | None, raised: bool = False) -> float:
    """Lift speed asked for after an estimator has said these things one after the other."""
    control = build_implement(config)
    asked = math.nan
    for t_ns, values in enumerate(sequence):
        said = {} if values is None else {"est": Said(t_ns=t_ns, values=values)}
        command = Command(speed_m_s=1.0, raised=raised)
        asked = control.amend(command, Knowledge(t_ns=t_ns, said=said)).lift_m_s
    return asked


def _config(**keys: float) -> LevellingControlConfig:
    return LevellingControlConfig(kind="levelling", follows="est", **keys)


def test_it_pushes_towards_the_plane_in_proportion_and_looks_ahead() -> None:
    config = _config(gain_1_s=2.0, look_ahead_s=0.25)
    assert _asked(config, {HEIGHT: 0.1}) == pytest.approx(-0.2)
    assert _asked(config, {HEIGHT: -0.1, UP: 0.2}) == pytest.approx(2.0 * 0.05)
    assert _asked(_config(target_m=0.05), {HEIGHT: 0.05}) == 0.0


def test_the_dead_band_keeps_the_valve_shut() -> None:
    assert _asked(_config(dead_band_m=0.01), {HEIGHT: 0.009}) == 0.0
    assert _asked(_config(dead_band_m=0.01), {HEIGHT: 0.011}) < 0.0


@pytest.mark.parametrize("said", [None, {HEIGHT: math.nan}])
def test_without_a_height_the_blade_goes_up(said: dict[str, float] | None) -> None:
    assert _asked(_config(), said) > 0.5


def test_the_driver_can_have_it_raised() -> None:
    assert _asked(_config(), {HEIGHT: 0.5}, raised=True) > 0.5


def test_it_is_raised_while_sigma_is_too_large_and_lowered_with_some_hysteresis() -> None:
    config = _config(raise_when_sigma_m=0.010)

    def height(sigma_m: float) -> dict[str, float]:
        return {HEIGHT: 0.1, sigma_column(HEIGHT): sigma_m}

    assert _asked(config, height(0.0099)) < 0.0
    assert _asked(config, height(0.0101)) > 0.0
    assert _asked(config, height(0.0101), height(0.009)) > 0.0
    assert _asked(config, height(0.0101), height(0.0079)) < 0.0
    assert _asked(_config(), height(1.0)) < 0.0


def test_it_tells_whom_it_listens_to() -> None:
    assert _config().listens.closes_loop
    assert not _config().listens.truth
    assert not LevellingControlConfig(kind="levelling").listens.closes_loop
    assert _config().needed_columns == {"est": (HEIGHT,)}
