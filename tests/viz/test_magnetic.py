"""How far magnets and iron are felt, and when: closed forms of the dipole."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.viz.reading import entities_of, series
from tests.viz.synthetic_run import make_recording, make_scene
from twin.signals import NS_PER_S
from viz import entities
from viz.layers.surroundings import presence
from viz.magnetic import MagneticPieces, reach_m
from viz.rrd import write_rrd

# Times 0, 1, ... 8 s: away, comes within 2 s, is there, goes within 2 s.
SHARES = np.array([0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.5, 0.0, 0.0])
COMING = MagneticPieces(
    magnets=np.array([[12.0, 1.5, 0.3, 0.05]]),
    iron=np.array([[20.0, -1.0, 0.0, 0.1]]),
    moments_a_m2=np.array([[10.0, 0.0, 0.0], [0.0, 0.2, -0.3]]),
    share_t_ns=np.arange(9) * NS_PER_S,
    shares=SHARES[:, np.newaxis],
    earth_ut=46.0,
)


def test_a_flat_dipole_reaches_further_along_its_axis_by_the_cube_root_of_two() -> None:
    azimuths = np.radians([0.0, 90.0, 180.0, 270.0])
    reach = reach_m(np.array([70.0, 0.0, 0.0]), radius_m=0.1, height_m=0.0, least_ut=4.6, azimuths_rad=azimuths)
    along, across = (0.2 * 70.0 / 4.6) ** (1 / 3), (0.1 * 70.0 / 4.6) ** (1 / 3)
    # to one of the 400 radii that are tried
    np.testing.assert_allclose(reach, [along, across, along, across], atol=along / 399)


def test_an_upright_dipole_reaches_as_far_all_round_and_a_high_or_weak_one_nowhere() -> None:
    azimuths = np.linspace(0.0, 6.0, 7)
    upright = np.array([0.0, 0.0, 5.0])
    reach = reach_m(upright, radius_m=0.01, height_m=0.0, least_ut=23.0, azimuths_rad=azimuths)
    farthest = (0.2 * 5.0 / 23.0) ** (1 / 3)
    np.testing.assert_allclose(reach, (0.1 * 5.0 / 23.0) ** (1 / 3), atol=farthest / 399)
    assert not reach_m(upright, radius_m=0.01, height_m=1.01 * farthest, least_ut=23.0, azimuths_rad=azimuths).any()
    # Inside a body the field is that of its surface: 0.2 m / a^3 = 1 uT at most here.
    assert not reach_m(upright, radius_m=1.0, height_m=0.0, least_ut=1.01, azimuths_rad=azimuths).any()


def test_what_all_pieces_add_follows_the_magnet_s_time() -> None:
    # One metre north of the magnet (10 A m^2 pointing east): 0.1 * 10 / 1^3 = 1 uT against the moment.
    alone = dataclasses.replace(COMING, iron=np.zeros((0, 4)), moments_a_m2=COMING.moments_a_m2[:1])
    t_ns = np.array([0, 2 * NS_PER_S, 2 * NS_PER_S + 999, 4 * NS_PER_S, 100 * NS_PER_S])
    places = np.tile(alone.magnets[0, :3] + np.array([0.0, 1.0, 0.0]), (5, 1))
    np.testing.assert_allclose(alone.disturbance_ut(places, t_ns), [0.0, 0.5, 0.5, 1.0, 0.0], atol=1e-12)


def test_pieces_and_their_moments_have_to_match() -> None:
    with pytest.raises(ValueError, match="moments_a_m2: expected 2, got 1"):
        dataclasses.replace(COMING, moments_a_m2=COMING.moments_a_m2[:1])
    with pytest.raises(ValueError, match="shares"):
        dataclasses.replace(COMING, shares=SHARES[:5, np.newaxis])


def test_a_magnet_that_comes_and_goes_is_drawn_while_it_is_there_along_its_moment(tmp_path: Path) -> None:
    recording = make_recording(9.0)
    scene = dataclasses.replace(make_scene(tmp_path), magnetic=COMING)
    write_rrd(recording, scene, {}, tmp_path / "run.rrd")
    t_ns, centers = series(tmp_path / "run.rrd", entities.magnet(0), "Boxes3D:centers")
    assert (t_ns / NS_PER_S).tolist() == [0, 2, 3, 6, 7]
    assert presence(COMING, 0)[1].tolist() == [0.0, 0.5, 1.0, 0.5, 0.0]
    assert [len(row or []) for row in centers.to_pylist()] == [0, 2, 2, 2, 0]
    # The red pole, first, lies to the east of the blue one: from middle to middle a radius (5 cm, but at least 2 % of
    # the machine).
    north, south = np.array(centers.to_pylist()[2])
    least = 0.02 * scene.machine_size_m
    np.testing.assert_allclose(north - south, [max(0.05, least), 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(0.5 * (north + south), COMING.magnets[0, :3], atol=1e-6)
    # Both discs: 10 A m^2 is felt (4.6 uT) up to 0.76 m, and turns a compass (23 uT) up to 0.44 m.
    for percent, axial in ((10, (2.0 / 4.6) ** (1 / 3)), (50, (2.0 / 23.0) ** (1 / 3))):
        entity = f"{entities.magnetic_reach(0)}/{percent}_percent"
        assert entity in entities_of(tmp_path / "run.rrd")
        times, rows = series(tmp_path / "run.rrd", entity, "Mesh3D:vertex_positions")
        assert times.tolist() == t_ns.tolist()
        height = 0.3 - float(scene.height_at(np.array(12.0), np.array(1.5)))
        east = np.array(rows.to_pylist()[2])[:, 0].max() - 12.0
        # Off its plane the field is a little weaker than on the axis and no stronger than there.
        assert east < axial
        assert east > np.sqrt(axial**2 / 2 ** (2 / 3) - height**2)
        assert np.ptp(np.array(rows.to_pylist()[0])[:, 0]) == 0.0
