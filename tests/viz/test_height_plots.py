"""Plots of a stress test of heights, and the scenes of bench and scraper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from tests.viz.test_pieces import plane_scene
from twin.recording import Recording
from twin.scenario import LoadedScenario, find, load
from twin.scoring.envelopes import Envelope
from twin.scoring.height_bound import scenario_bound
from twin.signals import NS_PER_S
from twin.stress import Point, StressResult, make_plan
from viz.compose import scene_of
from viz.height_plots import PhysicalLimit, draw_heights, physical_limit
from viz.layers.machine import _seen_from_behind
from viz.plots import draw_stress
from viz.scene import Scene
from viz.sheet import Run
from viz.terrain import grid_spacing_m

LOST_S, BACK_S, DURATION_S = 20.0, 50.0, 60.0
BENCH = f"""
title = "A bench"
duration_s = {DURATION_S}
[terrain]
kind = "flat"
cell_m = 1.0
[soil]
preset = "firm"
[machine]
kind = "rail_bench"
[levelling]
design_height_m = 1.0
[driver]
kind = "reciprocation"
[sensors.gnss]
preset = "rtk_chcnav_i70"
mount = "antenna"
faults = [ {{ kind = "corrections_lost", from_s = {LOST_S}, to_s = {BACK_S} }} ]
[estimators.first]
kind = "height_hold"
sensors = ["gnss"]
[estimators.second]
kind = "height_hold"
sensors = ["gnss"]
[published]
"first.height.time_to_30mm_s" = 12.0
"""
COLOURS = {"first": (0.9, 0.5, 0.1), "second": (0.1, 0.5, 0.9)}
TIMES_S = np.array([[4.0, 9.0, np.inf, 15.0, np.nan]])


@pytest.fixture
def loaded(tmp_path: Path) -> LoadedScenario:
    (tmp_path / "bench.toml").write_text(BENCH)
    return load(tmp_path / "bench.toml")


def stress_result(loaded: LoadedScenario) -> StressResult:
    """200 members whose errors are drawn evenly up to 10 mm before the loss and then up to 4 mm/s more."""
    t_ns = np.arange(0, round(DURATION_S) + 1, dtype=np.int64) * NS_PER_S
    since = np.maximum(t_ns / NS_PER_S - LOST_S, 0.0)
    share = (np.arange(200) + 0.5) / 200
    envelope = Envelope.at(t_ns)
    envelope.add(t_ns, (10.0 + 4.0 * since)[:, np.newaxis] * share)
    calm = Envelope.at(t_ns)
    calm.add(t_ns, np.full((len(t_ns), 200), 5.0))
    point = Point(
        settings={},
        table={"first.height.time_to_30mm_s": TIMES_S, "second.height.time_to_30mm_s": np.full((1, 5), np.inf)},
        motion={},
        pooled={},
        envelopes={"first.height_mm": envelope, "second.height_mm": calm, "first.position_m": calm},
        consistency={},
        outcomes=[],
        worst=[],
    )
    plan = make_plan(loaded.path, runs=5, worlds=1, settings=[], vary=[], seed=None)
    return StressResult(loaded=loaded, plan=plan, points=[point], ended=[])


def line_of(axis: Any, colour: Any) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of the first line of a colour."""
    line = next(line for line in axis.lines if to_rgba(line.get_color()) == to_rgba(colour))
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def test_the_envelope_holds_95_percent_since_the_loss(loaded: LoadedScenario) -> None:
    result = stress_result(loaded)
    limit = PhysicalLimit(since_loss_s=np.array([0.0, 40.0]), error_mm=np.array([3.0, 90.0]))
    figure = draw_heights(result, result.points[0], COLOURS, "title", limit=limit)
    assert figure is not None
    axis = figure.axes[0]
    since, error = line_of(axis, COLOURS["first"])
    np.testing.assert_allclose(since, np.arange(DURATION_S + 1) - LOST_S)
    # an evenly drawn error keeps within 0.95 of its largest; envelopes are counted in bins of 4.7 %
    np.testing.assert_allclose(error, 0.95 * (10.0 + 4.0 * np.maximum(since, 0.0)), rtol=0.05)
    assert line_of(axis, "tab:red")[1].tolist() == [30.0, 30.0]
    assert line_of(axis, "k")[1].tolist() == [3.0, 90.0]
    assert "mm" in axis.get_ylabel()
    assert "[s]" in axis.get_xlabel()


def test_the_cumulative_curve_counts_the_runs_that_never_fail(loaded: LoadedScenario) -> None:
    result = stress_result(loaded)
    figure = draw_heights(result, result.points[0], COLOURS, "title")
    assert figure is not None
    axis = figure.axes[1]
    times, share = line_of(axis, COLOURS["first"])
    # of four runs with a value one never exceeds; curves end with the loss
    assert times.tolist() == [0.0, 4.0, 9.0, 15.0, BACK_S - LOST_S]
    assert share.tolist() == [0.0, 25.0, 50.0, 75.0, 75.0]
    assert line_of(axis, COLOURS["second"])[1].tolist() == [0.0, 0.0]
    marked = [line for line in axis.lines if line.get_linestyle() == ":"]
    assert [line.get_xdata()[0] for line in marked] == [12.0]


def test_the_physical_limit_is_1_96_sigma_of_the_bound(loaded: LoadedScenario) -> None:
    assert physical_limit(loaded.scenario) is None
    scenario = load(find("scraper_rail_loss")[0]).scenario
    found, bound = physical_limit(scenario), scenario_bound(scenario, scenario.estimators["ours"].sensors)
    assert found is not None
    assert bound is not None
    np.testing.assert_allclose(found.error_mm, 1959.964 * bound.sigma_m, rtol=1e-6)
    # with the corrections gone nobody knows the height better and better
    assert np.all(np.diff(found.error_mm[found.since_loss_s > 10.0]) > 0.0)


def test_a_stress_test_of_heights_gets_the_plot_and_others_do_not(loaded: LoadedScenario, tmp_path: Path) -> None:
    result = stress_result(loaded)
    assert "heights.png" in [path.name for path in draw_stress(result, tmp_path)]
    result.points[0].envelopes = {"first.position_m": result.points[0].envelopes["first.position_m"]}
    assert "heights.png" not in [path.name for path in draw_stress(result, tmp_path)]


def scene(loaded: LoadedScenario) -> Scene:
    return scene_of(Recording(scenario_toml=loaded.toml, scenario_name="x", seed=1, runs=(0,)))


def test_a_bench_is_seen_from_its_front_whole(loaded: LoadedScenario) -> None:
    found = scene(loaded)
    assert found.bench
    assert found.blade is None
    # antenna on the plate, which is the reference frame
    np.testing.assert_allclose(found.antennas["gnss"], loaded.scenario.machine.resolved_mounts["antenna"].xyz_m)
    run = Run(recording=Recording(scenario_toml="", scenario_name="x", seed=1, runs=(0,)), scene=found, result={})
    eye, target = _seen_from_behind(run, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    assert eye[0] > 1.0
    look = (target - eye) / np.linalg.norm(target - eye)
    # foot, and the antenna at the top of the travel (1.2 m + 0.76 m), within half of the view's 55 degrees
    for point in ((0.0, 0.0, 0.0), (0.0, 0.0, 1.96)):
        ray = np.array(point) - eye
        assert np.degrees(np.arccos(ray @ look / np.linalg.norm(ray))) < 27.5


def test_a_leveller_s_scene_has_its_blade_and_its_plane(tmp_path: Path) -> None:
    text = BENCH.replace('kind = "rail_bench"', 'kind = "scraper"')
    text = text.replace("1.0\n[driver]", "0.2\narea_m = [0, -2, 9, 2]\n[driver]")
    text = text.replace('kind = "reciprocation"', 'kind = "path"\nspeed_m_s = 1.0\npath = [ { straight_m = 9.0 } ]')
    (tmp_path / "field.toml").write_text(text)
    found = scene(load(tmp_path / "field.toml"))
    assert found.blade is not None
    assert found.blade.body == "scraper"
    assert found.levelling.area_m == (0.0, -2.0, 9.0, 2.0)
    assert not found.bench
    assert found.banded is None  # without a filter of ours, all that claim a sigma have a band
    assert found.highest is None  # nothing has moved


def test_a_bench_has_a_grid_of_one_metre() -> None:
    assert grid_spacing_m(plane_scene(bench=True)) == 1.0
    assert grid_spacing_m(plane_scene()) == 10.0
