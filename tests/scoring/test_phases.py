"""Phases of made-up drives: where the path begins and ceases to bend, and what is left without that."""

from typing import Any

import numpy as np
import pytest

from tests.scoring.lines import SPEED_M_S, driven, estimate_of, figures, guided, scored
from twin import paths
from twin.errors import BadInputError
from twin.recording import Stream
from twin.scenario import Scenario, load
from twin.scoring.metrics import metric_names
from twin.scoring.phases import phase_names, phases
from twin.signals import BoolArray

BEND = [{"straight_m": 40.0}, {"turn_deg": 90.0, "radius_m": 20.0}, {"straight_m": 40.0}]
"""31.4 m of bend, at 2 m/s from 20 s to 35.7 s."""
STEADY = ("_steady_turns", "_steady_straights")


def _asked(path: list[dict[str, Any]] | None = None, transition_s: float = 3.0) -> Scenario:
    return guided(path or BEND, scoring={"transition_s": transition_s})


def _masks(scenario: Scenario, truth: Stream) -> dict[str, BoolArray]:
    found = phases(scenario, truth, np.arange(len(truth)))
    assert sorted(found) == sorted(phase_names(scenario, truth.columns))
    return found


def test_nobody_has_transitions_who_does_not_ask() -> None:
    scenario = guided(BEND)
    assert set(_masks(scenario, driven(scenario))) == {"", "_turns", "_straights"}


def test_transitions_are_so_many_seconds_about_each_end_of_a_bend() -> None:
    scenario = _asked()
    truth = driven(scenario)
    passing = _masks(scenario, truth)["_transitions"]
    end = 20.0 + 20.0 * np.pi / 2.0 / SPEED_M_S
    expected = (np.abs(truth.t_s - 20.0) < 3.0) | (np.abs(truth.t_s - end) < 3.0)
    # a row of rounding at each of the four ends
    assert np.count_nonzero(passing != expected) <= 4


def test_at_half_the_speed_they_are_half_as_far() -> None:
    scenario = _asked()
    slow, fast = driven(scenario, speed_m_s=1.0), driven(scenario, speed_m_s=2.0)
    for truth in (slow, fast):
        # twelve seconds about two places, whatever the speed
        assert np.count_nonzero(_masks(scenario, truth)["_transitions"]) / 50.0 == pytest.approx(12.0, abs=0.1)


def test_steady_is_what_is_left_of_turns_and_straights() -> None:
    scenario = _asked()
    found = _masks(scenario, driven(scenario))
    parts = np.stack([found["_transitions"], *(found[name] for name in STEADY)])
    assert (parts.sum(axis=0) == 1).all()
    for steady, whole in zip(STEADY, ("_turns", "_straights"), strict=True):
        assert found[steady].any()
        assert not (found[steady] & ~found[whole]).any()


def test_from_one_bend_into_the_opposite_one_is_a_transition_too() -> None:
    sway = [{"turn_deg": 90.0, "radius_m": 20.0}, {"turn_deg": -90.0, "radius_m": 20.0}]
    scenario = _asked(sway)
    truth = driven(scenario)
    middle = np.argmin(np.abs(truth.t_s - 10.0 * np.pi / SPEED_M_S))
    assert _masks(scenario, truth)["_transitions"][middle]


def test_parts_of_one_bend_have_none_between_them() -> None:
    """Two segments that bend alike are one curve."""
    scenario = _asked([*BEND[:1], *([{"turn_deg": 45.0, "radius_m": 40.0}] * 2), *BEND[2:]])
    truth = driven(scenario)
    passing = _masks(scenario, truth)["_transitions"]
    assert np.count_nonzero(np.diff(passing.astype(int)) == 1) == 2


def test_a_machine_that_stands_at_a_corner_passes_through_none() -> None:
    scenario = _asked([BEND[0], {"stop_s": 40.0}, *BEND[1:]])
    truth = driven(scenario)
    assert not _masks(scenario, truth)["_transitions"][truth.column("segment")[:, 0] == 1.0].any()


def test_headland_turns_of_several_arcs_have_them_at_every_change() -> None:
    field = [{"passes": 2, "length_m": 40.0, "width_m": 60.0, "turn_radius_m": 20.0}]
    scenario = _asked(field)
    truth = driven(scenario)
    passing = _masks(scenario, truth)["_transitions"]
    # two quarter circles with 20 m between them: four places, each with six seconds
    assert np.count_nonzero(passing) / 50.0 == pytest.approx(24.0, abs=0.2)


def test_figures_of_these_phases_are_of_their_times() -> None:
    scenario = _asked()
    truth = driven(scenario)
    passing = _masks(scenario, truth)["_transitions"]
    estimate = estimate_of(truth, np.where(passing, 1.0, 0.0), np.where(passing, 1.0, 0.0))
    found = figures(scenario, truth, estimate)
    assert found["cross_track.max_abs_error_steady_turns_m"] == pytest.approx(0.0, abs=1e-9)
    assert found["cross_track.max_abs_error_steady_straights_m"] == pytest.approx(0.0, abs=1e-9)
    # on the straights before and after the bend, north and then west, it is one of both that lies across
    assert found["cross_track.max_abs_error_transitions_m"] == pytest.approx(1.0, rel=0.01)
    told = metric_names(scenario, truth.columns, {"one": estimate.columns})
    assert {f"one.{name}" for name in found} <= set(told)
    pieces = scored(scenario, truth, estimate, piece_s=7.3).metrics()
    for name, value in found.items():
        assert pieces[f"one.{name}"][0] == pytest.approx(value, nan_ok=True), name


def test_transitions_need_a_planned_path() -> None:
    bench = paths.SCENARIOS / "levelling" / "scraper_rail_rtk.toml"
    with pytest.raises(BadInputError, match=r"scoring\.transition_s: only a driver of kind 'path' has segments"):
        load(bench, settings=[("scoring.transition_s", 3.0)])
