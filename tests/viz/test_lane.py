"""The recording of a robot that keeps to a lane: its offset, its states, and beams lost in bright light."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.viz.reading import entities_of, scalars, series, texts
from tests.viz.synthetic_run import table
from tests.viz.test_viewer import coloured, holds, opened, pixels
from twin.estimators.magnetic_disturbance import CLEAN, DISTURBED, LEARNING, RECOVERING
from twin.execution import execute
from twin.recording import Recording, estimate_stream
from twin.scenario import load
from twin.signals import CLEARANCE, LANE_OFFSET, sigma_column
from viz import entities
from viz.check import empty_views, stored_views
from viz.compose import scene_of
from viz.layers.scans import Turns
from viz.rrd import write_rrd

SCENARIO = """
title = "A robot in a lane"
duration_s = 7.0
[terrain]
kind = "flat"
[soil]
preset = "firm"
[machine]
kind = "orchard_robot"
[driver]
kind = "heading_hold"
lane_m = 1.2
stand_s = 2.0
[light]
changes = [ { from_s = 4.0, to_s = 60.0, lux = 40000.0 } ]
[[orchard.lanes]]
length_m = 2.4
width_m = 0.8
spacing_m = 0.8
[magnetics]
magnets = [ { east_m = 0.9, north_m = 0.1, height_m = 0.1, moment_a_m2 = [0.0, 8.0, 0.0] } ]
[sensors.imu]
preset = "imu_mpu6050"
mount = "imu"
[sensors.compass]
preset = "mag_qmc5883l"
mount = "magnetometer"
[sensors.encoders]
preset = "wheel_encoders_lm393"
mount = "encoders"
[sensors.lidar]
preset = "lidar_lds01"
mount = "lidar"
near_noise_m = 0.0
near_bias_m = 0.0
far_noise_ratio = 0.0
far_bias_ratio = 0.0
wrong_share = 0.2
[estimators.heading_filter]
kind = "heading_filter"
sensors = ["imu", "compass", "encoders"]
"""
BRIGHT_NS = 4_000_000_000
SIGMA_M = 0.02


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Path]:
    """The run, with an estimator of the offset added to it, and the file that it was written to."""
    folder: Path = tmp_path_factory.mktemp("lane")
    (folder / "lane.toml").write_text(SCENARIO, encoding="utf-8")
    recording = execute(load(folder / "lane.toml"))
    truth = recording.truth
    said = {
        LANE_OFFSET: truth.column(LANE_OFFSET)[:, 0] + 0.01,
        sigma_column(LANE_OFFSET): np.full(len(truth), SIGMA_M),
    }
    recording.streams[estimate_stream("row_fit")] = table(truth.t_ns, said)
    write_rrd(recording, scene_of(recording), {}, folder / "run.rrd")
    return recording, folder / "run.rrd"


def test_the_offset_is_plotted_as_it_is_with_the_claimed_band_about_the_estimate(
    drawn: tuple[Recording, Path],
) -> None:
    recording, path = drawn
    truth = recording.truth
    for series_name, expected in (
        ("truth", truth.column(LANE_OFFSET)[:, 0]),
        ("clearance_to_trees", truth.column(CLEARANCE)[:, 0]),
        ("row_fit", truth.column(LANE_OFFSET)[:, 0] + 0.01),
    ):
        t_ns, values = scalars(path, entities.plot("lane_offset", series_name))
        np.testing.assert_array_equal(values, expected[np.searchsorted(truth.t_ns, t_ns)])
    band = entities.band(entities.plot("lane_offset", "row_fit"))
    t_ns, middle = scalars(path, band, "Measurements:values")
    np.testing.assert_allclose(middle, (truth.column(LANE_OFFSET)[:, 0] + 0.01)[np.searchsorted(truth.t_ns, t_ns)])
    _, variance = scalars(path, band, "Measurements:variances")
    np.testing.assert_allclose(variance, SIGMA_M**2)


def test_the_driver_s_lane_tells_its_states(drawn: tuple[Recording, Path]) -> None:
    _, path = drawn
    _, states = texts(path, entities.lane("driver"), "StateChange:state")
    assert states[0] == "standing"
    assert states[-1] == "stopped at the end of the lane"
    assert "driving" in states
    assert entities.lane("segment") not in entities_of(path)


def test_what_the_filter_recognises_and_what_is_true_are_lanes_with_words(drawn: tuple[Recording, Path]) -> None:
    recording, path = drawn
    stream = recording.estimates("heading_filter")
    states = stream.column("magnetic_state")[:, 0]
    words = {LEARNING: "learning", CLEAN: "trusted", DISTURBED: "disturbed", RECOVERING: "recovering"}
    at = np.flatnonzero(np.diff(states, prepend=np.nan))
    t_ns, shown = texts(path, entities.lane("heading_filter_magnetometer"), "StateChange:state")
    assert t_ns == stream.t_ns[at].tolist()
    assert shown == [words[int(state)] for state in states[at]]
    assert "disturbed" in shown
    _, rolling = texts(path, entities.lane("heading_filter_wheels"), "StateChange:state")
    assert set(rolling) <= {"rolling", "slipping"}
    # In truth: the root link passes 0.1 m beside and 0.067 m below the dipole of 8 A m^2 across the lane. There
    # 0.1 * 8 / r^3 sqrt(1 + 3 (0.1 / r)^2) = 4.6 uT at r = 0.567 m, that is 0.554 m before it; a row is 1 cm of way.
    t_ns, shown = texts(path, entities.lane("magnetic_field"), "StateChange:state")
    assert shown[:2] == ["the earth's", "magnets: 10 % or more"]
    east = recording.truth.column("base_e_m")[np.searchsorted(recording.truth.t_ns, t_ns[1]), 0]
    assert 0.9 - 0.554 - 0.003 < east < 0.9 - 0.554 + 0.013


def test_beams_lost_in_the_light_are_drawn_on_the_bark_and_wrong_ones_apart(drawn: tuple[Recording, Path]) -> None:
    recording, path = drawn
    lidar = recording.measurements("lidar")
    bright = lidar.t_ns >= BRIGHT_NS
    found = {}
    for what, entity in (
        ("hit", entities.scan("lidar")),
        ("lost", entities.lost_beams("lidar")),
        ("wrong", entities.wrong_beams("lidar")),
    ):
        t_ns, rows = series(path, entity, "Points3D:positions")
        assert t_ns.tolist() == lidar.t_ns.tolist()
        found[what] = [np.array(row or []).reshape(-1, 3) for row in rows.to_pylist()]
    count = {what: np.array([len(points) for points in turns]) for what, turns in found.items()}
    seen = np.isfinite(lidar.values[:, 0]).sum(axis=1)
    np.testing.assert_array_equal(count["hit"] + count["wrong"], seen)
    # Within the limit of 10 klux nothing is lost or wrong. Four times beyond it a beam drowns with probability 3/4, and
    # a fifth of those are wrong: of all that would have met a trunk, 0.25 hit and 0.6 are lost.
    assert count["lost"][~bright].sum() == count["wrong"][~bright].sum() == 0
    hit, lost = count["hit"][bright].sum(), count["lost"][bright].sum()
    assert lost / (hit + lost) == pytest.approx(0.6 / 0.85, abs=4.0 * np.sqrt(0.7 * 0.3 / (hit + lost)) + 0.03)
    # 360 beams, three quarters of them drown, a fifth of those is wrong.
    share = count["wrong"][bright].sum() / (360 * bright.sum())
    assert share == pytest.approx(0.15, abs=4.0 * np.sqrt(0.15 * 0.85 / (360 * bright.sum())) + 0.01)
    trunks = scene_of(recording).trunks
    points = np.concatenate(found["lost"])
    gap = np.linalg.norm(points[:, np.newaxis, :2] - trunks[:, :2], axis=2) - trunks[:, 2]
    # They are put there by geometry: exact but for float32.
    assert np.abs(gap).min(axis=1).max() < 1e-5
    _, shown = scalars(path, entities.plot("returns", "lidar_lost"))
    np.testing.assert_allclose(shown, 100.0 * count["lost"] / 360.0)


def test_a_beam_to_the_bark_is_the_closed_form() -> None:
    east, north = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    steep = np.array([0.6, 0.0, 0.8])
    turns = Turns(np.zeros(1, dtype=np.int64), np.zeros((1, 4, 3)), np.array([[east, north, steep, -east]]))
    trunks = np.array([[3.0, 0.1, 0.2, -0.2, 1.0], [1.8, 0.0, 0.3, -0.2, 1.0], [0.0, 2.0, 0.5, -0.2, 1.0]])
    wanted = np.array([[True, True, True, True]])
    # The nearer of two; straight on; passes above the top (it would meet at 2.5 m, 2 m up); behind the beam is nothing.
    np.testing.assert_allclose(turns.to_bark(trunks, wanted), [[1.5, 1.5, np.nan, np.nan]])
    np.testing.assert_allclose(turns.to_bark(trunks[:1], wanted)[0, 0], 3.0 - np.sqrt(0.2**2 - 0.1**2))
    assert np.isnan(turns.to_bark(trunks, ~wanted)).all()
    grazing = dataclasses.replace(turns, origins=np.array([[[0.0, 0.29, 0.0]] * 4]))
    assert np.isnan(grazing.to_bark(trunks[1:2], wanted)[0, 0])


def test_every_view_of_a_lane_has_content_and_titles_carry_units(drawn: tuple[Recording, Path]) -> None:
    _, path = drawn
    assert empty_views(path) == []
    plots = [view.name for view in stored_views(path) if view.kind == "TimeSeries"]
    assert "Offset from lane's axis; clearance grey [m]" in plots
    assert all(name.endswith("]") for name in plots)
    assert not any("Yaw rate" in name for name in plots)


def test_the_viewer_shows_dial_lost_beams_and_lane_without_a_complaint(drawn: tuple[Recording, Path]) -> None:
    _, path = drawn
    for viewer in opened(path):
        viewer.seek(5.0)
        viewer.screenshot()
        pictured = {
            name: pixels(viewer.screenshot(view, equal_in_a_row=2))
            for name, view in viewer.views.items()
            if viewer.is_visible(view)
        }
        for name, image in pictured.items():
            assert coloured(image) > 100, name
        dial = next(image for name, image in pictured.items() if name.startswith("Heading, up"))
        colour = entities.estimator_colours(["heading_filter", "row_fit"])["heading_filter"]
        # needle, name and bar
        assert holds(dial, colour) > 100
        # The needle is 10 pixels wide and some 65 long to its head, 4 of its width lie under the filter's, 2 blur.
        assert holds(dial, entities.TRUTH_COLOUR, within=16) > 200
        field = next(image for name, image in pictured.items() if name.startswith("Field"))
        assert holds(field, entities.SCAN_LOST_COLOUR) > 20
        assert viewer.complaints == []
