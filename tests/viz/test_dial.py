"""The compass dial: needles, figures and bars against the headings they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from tests.viz.conftest import Written
from tests.viz.reading import entities_of, scalars, series, texts, vectors
from tests.viz.synthetic_run import make_scene, table
from twin.geometry import wrap_angle
from twin.recording import Recording, Stream, estimate_stream, measurement_stream
from twin.signals import NS_PER_S, FloatArray
from viz import entities
from viz.check import empty_views, stored_views
from viz.layers.dial import DIAL_HZ, full_bar_deg
from viz.rrd import write_rrd

T_NS = np.arange(0, 10 * NS_PER_S + 1, NS_PER_S // 50)
T_S = T_NS / NS_PER_S
# Northwest at the start, turning to the left through the cut at 180 degrees.
HEADING = np.radians(135.0 + 12.0 * T_S)
OFF = {"ahead": np.radians(4.0) * np.ones(len(T_NS)), "behind": -np.radians(2.0 * T_S), "gone": np.full(len(T_NS), 0.0)}
OFF["gone"][T_S > 5.0] = np.nan


def recording_of(headings: Mapping[str, FloatArray], *, truth: bool = True) -> Recording:
    streams: dict[str, Stream] = {}
    if truth:
        streams["truth"] = table(T_NS, {"heading_rad": wrap_angle(HEADING), "yaw_rate_rad_s": np.full(len(T_NS), 0.2)})
    field = {f"mag_{axis}_ut": np.full(len(T_NS), 20.0) for axis in "xyz"}
    streams[measurement_stream("compass")] = table(T_NS, field, measured=True)
    streams |= {estimate_stream(name): table(T_NS, {"heading_rad": wrap_angle(at)}) for name, at in headings.items()}
    return Recording(
        scenario_toml='title = "Headings"\n', scenario_name="headings", seed=1, runs=(0,), streams=streams, events=[],
        ended_t_s=10.0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dial")
    recording = recording_of({name: HEADING + off for name, off in OFF.items()})
    write_rrd(recording, make_scene(folder), {}, folder / "run.rrd")
    return folder / "run.rrd"


def angle_left_of_up(vector: FloatArray) -> FloatArray:
    """Of a vector to the right and downwards (T, 2), degrees."""
    return np.degrees(np.arctan2(-vector[:, 0], -vector[:, 1]))


def test_needles_point_where_the_headings_do_with_the_start_upwards(drawn: Path) -> None:
    for entity, off in ((entities.DIAL_TRUTH, 0.0 * HEADING), *((entities.dial_needle(n), OFF[n]) for n in OFF)):
        t_ns, vector = vectors(drawn, entity, "Arrows2D:vectors")
        expected = np.degrees(HEADING + off - HEADING[0])[np.searchsorted(T_NS, t_ns)]
        assert not np.isnan(expected).any()
        np.testing.assert_allclose(angle_left_of_up(vector), expected, atol=1e-3)
        assert np.ptp(np.linalg.norm(vector, axis=1)) < 1e-6
    t_ns, _ = vectors(drawn, entities.DIAL_TRUTH, "Arrows2D:vectors")
    assert (t_ns[0], t_ns[-1]) == (T_NS[0], T_NS[-1])
    assert np.diff(t_ns).max() <= NS_PER_S / DIAL_HZ


def test_every_needle_has_a_length_of_its_own(drawn: Path) -> None:
    lengths = [
        float(np.linalg.norm(vectors(drawn, entity, "Arrows2D:vectors")[1][0]))
        for entity in (entities.DIAL_TRUTH, *map(entities.dial_needle, OFF))
    ]
    # a fifth of the ring apart with three of them, so that all are seen when all agree
    assert min(abs(a - b) for i, a in enumerate(lengths) for b in lengths[i + 1 :]) > 0.04
    assert max(lengths) == lengths[0] <= 1.0


def test_the_list_tells_the_error_of_the_moment_in_degrees(drawn: Path) -> None:
    t_ns, shown = texts(drawn, entities.dial_name("ahead"), "Points2D:labels")
    assert set(shown) == {"ahead  +4.0°"}
    t_ns, shown = texts(drawn, entities.dial_name("behind"), "Points2D:labels")
    at = t_ns.index(7 * NS_PER_S)
    assert shown[at] == "behind  -14.0°"
    assert shown[0] == "behind  +0.0°"
    t_ns, shown = texts(drawn, entities.dial_name("gone"), "Points2D:labels")
    assert shown[t_ns.index(8 * NS_PER_S)] == "gone"


def test_bars_are_to_scale_and_to_the_side_to_which_the_needle_is_off(drawn: Path) -> None:
    # 98 % of the times the largest error is below 19.6 degrees: 20 is a full bar.
    assert full_bar_deg([np.degrees(off) for off in OFF.values()]) == 20.0
    ends = {}
    for name in ("ahead", "behind"):
        t_ns, strips = series(drawn, entities.dial_bar(name), "LineStrips2D:strips")
        ends[name] = np.array(strips.to_pylist())[:, 0]  # (T, 2 ends, 2)
        assert len(ends[name]) == len(t_ns)
    zero = ends["ahead"][0, 0, 0]
    assert zero == ends["behind"][0, 0, 0]
    length = {name: end[:, 1, 0] - zero for name, end in ends.items()}
    assert np.all(length["ahead"] < 0.0)
    np.testing.assert_allclose(length["behind"] / length["ahead"][0], -0.5 * T_S[:: round(50 / DIAL_HZ)], atol=1e-5)


def test_full_bars_hold_the_errors_of_all_but_passing_moments() -> None:
    assert full_bar_deg([np.array([0.5, -1.9]), np.array([np.nan])]) == 2.0
    assert full_bar_deg([np.append(np.full(99, 4.0), 170.0)]) == 5.0
    assert full_bar_deg([np.full(10, -100.0)]) == 180.0
    assert full_bar_deg([]) == 2.0


def test_the_compass_is_turned_with_the_start(drawn: Path) -> None:
    # Static: it has no time to be read by.
    from rerun.chunk import RrdReader  # noqa: PLC0415

    entity = f"/{entities.DIAL_FACE}/compass"
    batch = next(c for c in RrdReader(drawn).stream() if c.entity_path == entity).to_record_batch()
    places = np.array(batch["Points2D:positions"].to_pylist()[0])
    places[:, 1] -= places[:, 1].mean()  # labels hang below their points
    # The start heads northwest: north is 45 degrees to the right of up, west 45 degrees to the left.
    assert batch["Points2D:labels"].to_pylist()[0] == ["N", "E", "S", "W"]
    np.testing.assert_allclose(angle_left_of_up(places), [-45.0, -135.0, 135.0, 45.0], atol=1e-3)


def test_dial_and_plots_have_views_that_are_not_empty(drawn: Path) -> None:
    views = {view.origin: view.kind for view in stored_views(drawn)}
    assert views[f"/{entities.DIAL}"] == "2D"
    assert empty_views(drawn) == []


def test_without_truth_needles_start_upwards_and_no_error_is_told(tmp_path: Path) -> None:
    write_rrd(recording_of({"ahead": HEADING}, truth=False), make_scene(tmp_path), {}, tmp_path / "run.rrd")
    written = entities_of(tmp_path / "run.rrd")
    assert entities.dial_needle("ahead") in written
    assert entities.DIAL_TRUTH not in written
    assert entities.dial_bar("ahead") not in written
    _, vector = vectors(tmp_path / "run.rrd", entities.dial_needle("ahead"), "Arrows2D:vectors")
    assert angle_left_of_up(vector)[0] == pytest.approx(0.0, abs=1e-4)


def test_a_machine_that_goes_by_positions_has_no_dial(written: Written) -> None:
    assert not any(entity.startswith(entities.DIAL) for entity in entities_of(written.path))


def test_a_counted_yaw_rate_is_left_out_of_its_plot(tmp_path: Path) -> None:
    recording = recording_of({})
    rates = {"smooth": np.full(len(T_NS), 0.25), "counted": np.where(np.arange(len(T_NS)) % 20 == 0, 4.0, 0.0)}
    for name, rate in rates.items():
        recording.streams[estimate_stream(name)] = table(T_NS, {"heading_rad": HEADING, "yaw_rate_rad_s": rate})
    write_rrd(recording, make_scene(tmp_path), {}, tmp_path / "run.rrd")
    _, smooth = scalars(tmp_path / "run.rrd", entities.plot("yaw_rate", "smooth"))
    np.testing.assert_allclose(smooth, np.degrees(0.25))
    assert entities.plot("yaw_rate", "counted") not in entities_of(tmp_path / "run.rrd")
    titles = [view.name for view in stored_views(tmp_path / "run.rrd")]
    assert "Yaw rate, counted ones left out [deg/s]" in titles
