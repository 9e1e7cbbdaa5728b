"""The recording of a machine that is guided along lines: what it covered, and how far across the track it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.scoring.lines import SPEED_M_S, UP_AND_DOWN, driven, estimate_of
from tests.small_scenario import small_scenario_toml
from tests.viz.reading import entities_of, scalars
from twin.recording import Recording
from twin.scenario import loads
from viz import entities
from viz.compose import scene_of
from viz.rrd import write_rrd
from viz.scene import Scene

CELLS = (18, 100)
"""Of 0.5 m, northwards and eastwards."""
COVERAGE = {"swath_m": 3.0, "area_m": [5.0, -1.5, 55.0, 7.5], "cell_m": 0.5}
SIGMA_M = 0.05


def _recording(**changes: object) -> Recording:
    driver = {"speed_m_s": SPEED_M_S, "path": UP_AND_DOWN}
    toml = small_scenario_toml(driver=driver, estimators={}, duration_s=200.0, **changes)
    recording = Recording(scenario_toml=toml, scenario_name="lines", seed=1, runs=(0,))
    # the second pass runs a metre to the left, over the first
    truth = driven(loads(toml, where="lines"), left_m={2: 1.0})
    estimate = estimate_of(truth, 0.0, 0.2, **{f"position_{axis}_m.sigma": SIGMA_M for axis in "en"})
    recording.streams |= {"truth": truth, "estimates/ours": estimate}
    return recording


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Scene, Path]:
    recording = _recording(coverage=COVERAGE)
    path = tmp_path_factory.mktemp("lines") / "run.rrd"
    scene = scene_of(recording)
    write_rrd(recording, scene, {}, path)
    return recording, scene, path


def test_the_map_shows_what_was_covered_once_twice_and_not_at_all(drawn: tuple[Recording, Scene, Path]) -> None:
    _, scene, path = drawn
    assert scene.coverage is not None
    # two rows of cells between the first pass and the second are covered twice, two beyond the second are left out
    expected = np.repeat([1, 1, 1, 1, 2, 2, 1, 1, 1, 1, 0, 0, 1, 1, 1, 1, 1, 1], CELLS[1]).reshape(CELLS)
    np.testing.assert_array_equal(scene.coverage.counts, expected)
    picture = _picture(path, f"{entities.COVERAGE_MAP}/counts")
    for count, (_, colour) in enumerate(entities.COVERAGE_LEGEND):
        # north is up
        assert (picture[: CELLS[0], : CELLS[1]][expected[::-1] == count] == colour).all()
        # and a patch of each colour stands beside the map
        assert (picture[:, CELLS[1] :] == colour).all(axis=-1).any()


def test_the_legend_tells_shares_and_areas(drawn: tuple[Recording, Scene, Path]) -> None:
    labels = _static(drawn[2], f"{entities.COVERAGE_MAP}/legend", "Points2D:labels")
    assert labels == [
        "skipped", "11.11 %", "50.0 m²", "covered once", "77.78 %", "350.0 m²", "overlapped", "11.11 %", "50.0 m²",
    ]  # fmt: skip


def test_the_plot_shows_machine_and_estimate_across_the_straights(drawn: tuple[Recording, Scene, Path]) -> None:
    recording, _, path = drawn
    truth = recording.truth
    t_ns, machine = scalars(path, entities.plot("cross_track", entities.TRUTH_SERIES))
    segment = truth.column("segment")[np.searchsorted(truth.t_ns, t_ns), 0]
    known = np.isfinite(machine)
    np.testing.assert_allclose(machine[known], np.where(segment[known] == 2, 1.0, 0.0), atol=1e-9)
    assert set(segment[known]) == {0.0, 2.0, 4.0}
    # the line breaks at either turn
    assert (~known).sum() == 2
    t_ns, error = scalars(path, entities.plot("cross_track", "ours"))
    segment, known = truth.column("segment")[np.searchsorted(truth.t_ns, t_ns), 0], np.isfinite(error)
    away = np.abs(error[known] - np.where(segment[known] == 2, -0.2, 0.2))
    # but where the track turns off, a point beside it is nearer than 0.2 m to the turn
    assert np.count_nonzero(away > 1e-3) < 0.01 * len(away)
    _, variance = scalars(path, entities.band(entities.plot("cross_track", "ours")), "Measurements:variances")
    np.testing.assert_allclose(variance, SIGMA_M**2)


def test_other_runs_have_neither(tmp_path: Path) -> None:
    recording = _recording()
    write_rrd(recording, scene_of(recording), {}, tmp_path / "run.rrd")
    names = entities_of(tmp_path / "run.rrd")
    assert not any(name.startswith((entities.COVERAGE_MAP, entities.plot("cross_track"))) for name in names)


def test_a_map_of_very_many_cells_is_thinned(drawn: tuple[Recording, Scene, Path], tmp_path: Path) -> None:
    recording, scene, _ = drawn
    assert scene.coverage is not None
    fine = replace(scene.coverage, counts=np.repeat(np.repeat(scene.coverage.counts, 50, axis=0), 50, axis=1))
    write_rrd(recording, replace(scene, coverage=fine), {}, tmp_path / "run.rrd")
    picture = _picture(tmp_path / "run.rrd", f"{entities.COVERAGE_MAP}/counts")
    assert picture.shape[0] * picture.shape[1] < 1_500_000
    once = dict(entities.COVERAGE_LEGEND)["covered once"]
    assert (picture[0, 0] == once).all()


def _static(path: Path, entity: str, component: str) -> list[object]:
    found = [
        chunk.to_record_batch()[component].to_pylist()[0]
        for chunk in RrdReader(path).stream().filter(content=f"/{entity}", components=component)
    ]
    return found[0]


def _picture(path: Path, entity: str) -> np.ndarray:
    buffer = np.array(_static(path, entity, "Image:buffer")[0], dtype=np.uint8)
    form = _static(path, entity, "Image:format")[0]
    return buffer.reshape(form["height"], form["width"], 3)  # type: ignore[index]
