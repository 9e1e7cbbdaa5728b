"""The recording of a replayed log: what it draws, where, and how large it may become."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.logs import MadeUpLog, fix
from tests.viz.reading import entities_of
from twin.logreplay import LogReplay, choose, replay_log, streams
from twin.logreplay.result import result_of
from twin.recording import Recording, Stream
from viz import entities
from viz.check import empty_views, stored_views
from viz.log_rrd import write_log_rrd
from viz.map_labels import multiples, step_of
from viz.scene import Scene
from viz.sheet import Run
from viz.track_window import Window, windows


def drive(*, jump_m: float = 0.0, count: int = 400) -> list:
    """A circle of 100 m, half of it with fixes of RTK, then floating with a jump to the side."""
    sent = []
    for k in range(count):
        angle = 2.0 * math.pi * k / count
        floats = k >= count // 2
        reach = 100.0 + (jump_m if floats else 0.0)
        place = reach * math.cos(angle), reach * math.sin(angle)
        sent.append(fix(k, *place, sigma_m=0.02, quality=5.0 if floats else 4.0))
    return sent


def replayed(*, reference: bool = True, jump_m: float = 0.5) -> LogReplay:
    other = MadeUpLog(drive(), name="reference") if reference else None
    return replay_log(MadeUpLog(drive(jump_m=jump_m)), choose(["guidance_gps", "guidance_pv"]), reference=other)


@pytest.fixture(scope="module")
def found() -> LogReplay:
    return replayed()


@pytest.fixture(scope="module")
def written(found: LogReplay, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "run.rrd"
    write_log_rrd(found.sketch, result_of(found), path)
    return path


def test_map_plots_lane_and_page_are_drawn(written: Path) -> None:
    maps = [entities.track_map(which) for which in ("whole", "close")]
    expected = {
        *(f"{root}/{part}" for root in maps for part in ("grid", "frame", "labels", "reference", "measurements/gnss")),
        *(f"{maps[0]}/estimates/{name}" for name in ("guidance_gps", "guidance_pv")),
        f"{maps[0]}/now/guidance_gps",
        *(entities.plot("reference_error", name) for name in ("gnss", "guidance_gps", "guidance_pv")),
        *(entities.plot("surprise", name) for name in ("guidance_pv", "limit")),
        *(entities.plot("claimed_sigma", name) for name in ("gnss", "guidance_gps")),
        entities.plot("speed", "guidance_pv"),
        entities.plot("heading", "guidance_pv"),
        entities.lane("quality"),
        entities.globe_track("gnss"),
        entities.PAGE,
    }
    assert expected <= entities_of(written)
    assert empty_views(written) == []


def test_it_can_be_read_without_the_network(written: Path) -> None:
    assert all("map" not in view.kind.lower() for view in stored_views(written))


def test_the_map_has_the_track_and_the_close_up_what_is_off(found: LogReplay) -> None:
    run = Run(recording=found.sketch, scene=_no_scene(), result={})
    shown = windows(run)
    assert shown is not None
    whole, close = shown
    west, south, east, north = whole.edges
    assert west < -100.5 < 100.0 < east
    assert south < -100.5 < 100.0 < north
    assert close is not None
    window, what = close
    # Half a metre off, beyond the second quadrant; where the largest of equals is, rounding decides.
    assert what == "gnss 0.5 m off"
    assert window.north_m <= 1.0
    assert math.hypot(window.east_m, window.north_m) == pytest.approx(100.5, abs=0.01)


def _no_scene():
    return Scene(urdf=None, heights=np.zeros((2, 2)), origin_m=(0.0, 0.0), cell_m=1.0, planned_path=np.zeros((0, 2)))


def test_a_line_is_cut_at_the_edges_of_its_window() -> None:
    window = Window(east_m=0.0, north_m=0.0, half_e_m=2.0, half_n_m=1.0)
    line = np.array([[-5.0, 0.5], [5.0, 0.5], [5.0, 3.0], [1.0, 0.0], [1.0, 5.0], [math.nan, 0.0], [0.0, 0.0]])
    # Through; past; in from above right (its end inside); out at the top; and what is not known is not drawn.
    pieces = window.pieces(line[:5])
    np.testing.assert_allclose(
        pieces,
        [
            [[-2.0, 0.5], [2.0, 0.5]],
            [[2.0, 0.75], [1.0, 0.0]],
            [[1.0, 0.0], [1.0, 1.0]],
        ],
    )
    assert len(window.pieces(line[4:])) == 0
    assert len(window.pieces(np.array([[3.0, -1.0], [3.0, 1.0]]))) == 0


@pytest.mark.parametrize(("span", "step"), [(6.9, 1.0), (7.1, 2.0), (30.0, 5.0), (70.0, 10.0), (4200.0, 1000.0)])
def test_grid_lines_are_round_and_few(span: float, step: float) -> None:
    assert step_of(span, 7) == pytest.approx(step)


@pytest.mark.parametrize("span", [0.8, 3.0, 12.0, 1300.0, 5000.0])
def test_ticks_of_any_map_are_few(span: float) -> None:
    ticks = multiples(step_of(span, 6), 0.0, span)
    assert 3 <= len(ticks) <= 7


def test_a_log_that_says_little_is_drawn_too(tmp_path: Path) -> None:
    # No movement, no reference, no estimator: a point on a map of 2 m, a lane, a page.
    found = replay_log(MadeUpLog([fix(t, 0.0, 0.0) for t in range(3)]), [])
    write_log_rrd(found.sketch, result_of(found), tmp_path / "run.rrd")
    drawn = entities_of(tmp_path / "run.rrd")
    assert {f"{entities.track_map('whole')}/measurements/gnss", entities.lane("quality"), entities.PAGE} <= drawn
    assert not any(entity.startswith(entities.track_map("close")) for entity in drawn)
    assert empty_views(tmp_path / "run.rrd") == []


def test_size_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams.Thinned.__init__, "__defaults__", (512,))

    def size(count: int) -> int:
        found = replay_log(MadeUpLog(drive(count=count)), choose(["guidance_gps"]))
        path = tmp_path / f"{count}.rrd"
        write_log_rrd(found.sketch, result_of(found), path)
        return path.stat().st_size

    # Between half of what may be kept and all of it is: twice as much at most.
    assert size(8_000) < 2.0 * size(800)


def test_nothing_at_all_draws_a_page(tmp_path: Path) -> None:
    empty = Recording(scenario_toml="", scenario_name="none", seed=0, runs=(0,), streams={})
    assert windows(Run(recording=empty, scene=_no_scene(), result={})) is None
    lost = Stream(columns=("position_e_m", "position_n_m"), t_ns=np.array([0]), values=np.full((1, 1, 2), math.nan))
    nowhere = Recording(scenario_toml="", scenario_name="none", seed=0, runs=(0,), streams={"measurements/gnss": lost})
    assert windows(Run(recording=nowhere, scene=_no_scene(), result={})) is None
