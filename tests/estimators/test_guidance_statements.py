"""Four statements about straights and curves, over twenty worlds that nothing was tuned on.

The worlds are what the mixture expects: the hand that holds a line, the memory of the receiver's common error and the
lag of its velocity are the figures of the mixture's options as they stand. So there are worlds of others, too, in which
one of them is half or twice as large. "Everywhere" is said of the mixture that hears the receiver's velocity (Doppler):
paper 004's models have positions alone, and with positions alone the mixture keeps up with the better of them on
straights and in curves, not where these begin.

Errors are across the way, from the track that the receiver's common error shifts. The filters of paper 004 are the
corrected ones with the paper's numbers. What to expect, from the steady gains and v^2 / r of 1 to 2.5 m/s^2:

* constant velocity lags by 0.22 s^2 a at 5 Hz and 0.77 s^2 a at 1 Hz, 0.2 to 0.5 and 0.8 to 1.9 m, while white errors
  of 0.3 m are shown as 0.19 and 0.27 m by constant acceleration;
* on straights white errors pass with 0.579 against 0.633 at 5 Hz and 0.782 against 0.884 at 1 Hz.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tests.estimators.guidance_bench import CURVE, ENTRY, EXIT, STRAIGHT, Bench, make_setup
from twin.estimators import build_estimator
from twin.estimators.guidance_imm import GuidanceImmConfig
from twin.estimators.guidance_kinematic import GuidanceKinematicConfig
from twin.signals import FloatArray

WORLDS, OTHER_WORLDS = range(1, 21), range(21, 27)
SIGN_TEST = 15
"""So many of twenty fair coins or more show heads in 2 % of cases."""
RATES = [1.0, pytest.param(5.0, marks=pytest.mark.slow)]
FILTERS = {
    "cv": {"model": "constant_velocity"},
    "ca": {"model": "constant_acceleration"},
    "double": {"model": "double"},
    "imm": {},
    "imm_positions": {"velocity": "none"},
}


@cache
def bench(rate_hz: float, **changes: float) -> Bench:
    return Bench(seeds=OTHER_WORLDS if changes else WORLDS, rate_hz=rate_hz, **changes)  # type: ignore[arg-type]


@cache
def errors(name: str, rate_hz: float, **changes: float) -> FloatArray:
    """(K, R) across the way."""
    worlds = bench(rate_hz, **changes)
    setup = make_setup(runs=len(worlds.drives), rate_hz=rate_hz)
    kind, which = "guidance_kinematic", GuidanceKinematicConfig
    if name.startswith("imm"):
        kind, which = "guidance_imm", GuidanceImmConfig  # type: ignore[assignment]
    config = which.model_validate({"kind": kind, "sensors": ("gps",)} | FILTERS[name])
    return worlds.across(worlds.errors(build_estimator(config, setup)))


def rms(name: str, rate_hz: float, phase: str, **changes: float) -> FloatArray:
    """(R,) by world."""
    return bench(rate_hz, **changes).rms(errors(name, rate_hz, **changes), phase)


def together(by_world: FloatArray) -> float:
    return float(np.sqrt((by_world**2).mean()))


@pytest.mark.parametrize("rate_hz", RATES)
def test_constant_acceleration_is_better_in_curves_in_every_world(rate_hz: float) -> None:
    assert (rms("ca", rate_hz, CURVE) < rms("cv", rate_hz, CURVE)).all()


@pytest.mark.parametrize("rate_hz", RATES)
def test_constant_velocity_is_better_on_straights_by_the_ratio_of_the_gains(rate_hz: float) -> None:
    cv, ca = rms("cv", rate_hz, STRAIGHT), rms("ca", rate_hz, STRAIGHT)
    assert (cv < ca).sum() >= SIGN_TEST
    expected = {1.0: 0.782 / 0.884, 5.0: 0.579 / 0.633}[rate_hz]
    assert together(cv) / together(ca) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize("phase", [STRAIGHT, CURVE, ENTRY, EXIT])
def test_mixture_is_within_a_twentieth_of_the_better_model_everywhere(phase: str, rate_hz: float) -> None:
    better = min(together(rms("cv", rate_hz, phase)), together(rms("ca", rate_hz, phase)))
    assert together(rms("imm", rate_hz, phase)) <= 1.05 * better


@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize("phase", [ENTRY, EXIT])
def test_mixture_is_better_than_switching_at_entry_and_exit(phase: str, rate_hz: float) -> None:
    imm, double = rms("imm", rate_hz, phase), rms("double", rate_hz, phase)
    assert together(imm) < together(double)
    assert (imm < double).sum() >= SIGN_TEST


@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize("phase", [STRAIGHT, CURVE])
def test_mixture_of_positions_alone_is_within_a_twentieth_of_the_better_model(phase: str, rate_hz: float) -> None:
    # not so at the entry: what a bend is takes a second to see in positions that err by 0.3 m
    better = min(together(rms("cv", rate_hz, phase)), together(rms("ca", rate_hz, phase)))
    assert together(rms("imm_positions", rate_hz, phase)) <= 1.05 * better


@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize("phase", [STRAIGHT, CURVE, ENTRY, EXIT])
@pytest.mark.parametrize(
    "changes",
    [
        {"wander_m_s2": 0.05},
        {"wander_m_s2": 0.2},
        {"wander_s": 0.5},
        {"wander_s": 2.0},
        {"common_s": 75.0},
        {"common_s": 300.0},
        {"velocity_lag_s": 0.1},
        {"velocity_lag_s": 0.4},
    ],
    ids=lambda changes: "-".join(f"{key}={value}" for key, value in changes.items()),
)
def test_mixture_need_not_know_hand_memory_and_lag(changes: dict[str, float], phase: str, rate_hz: float) -> None:
    # a factor of two off: the lag is the one that could matter, 0.2 s of 2.5 m/s^2 are half a metre per second
    better = min(together(rms(name, rate_hz, phase, **changes)) for name in ("cv", "ca"))
    assert together(rms("imm", rate_hz, phase, **changes)) <= 1.05 * better
