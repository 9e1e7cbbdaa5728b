"""What the renderer shows stands where the world has it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pybullet
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from tests.world.conftest import MACHINES
from twin.errors import BadInputError
from twin.geometry import rotation_from_rpy
from twin.signals import FloatArray, ImageNeed, Mount, Picture
from twin.stop_sign import RED_SHARE
from twin.world.light import LightConfig
from twin.world.orchard import OrchardConfig, planted
from twin.world.pictures import Scenery
from twin.world.scenery import crown_mesh, ground_mesh, plate_mesh, trunk_mesh
from twin.world.signs import PLATE_U, POST_BOTTOM, SignConfig, put_up
from twin.world.simulation import build_world
from twin.world.soil import SoilConfig
from twin.world.terrain import FlatTerrain, RoughTerrain, SlopeTerrain, Terrain, build_terrain

FLAT = build_terrain(FlatTerrain(kind="flat", cell_m=0.5), seed=1, extent=(-10.0, -10.0, 10.0, 10.0))
NEED = ImageNeed(
    mount=Mount(body="chassis", xyz_m=(0.0, 0.0, 0.0)),
    width_px=320,
    height_px=240,
    horizontal_fov_rad=math.radians(62.2),
)
FOCAL_PX = 160.0 / math.tan(math.radians(31.1))
EAST = np.eye(3)
NORTH = rotation_from_rpy(0.0, 0.0, math.pi / 2.0)


def sign(**keys: Any) -> SignConfig:
    return SignConfig.model_validate({"east_m": 1.0, "north_m": 0.0, "heading_deg": 180.0, **keys})


class Views:
    """Makes sceneries, and closes them."""

    def __init__(self) -> None:
        self.made: list[Scenery] = []

    def __call__(self, *signs: SignConfig, terrain: Terrain = FLAT, trees: Any = (), **colours: Any) -> Scenery:
        trunks = planted(OrchardConfig.model_validate({"trees": trees}).trunks(1), terrain)
        self.made.append(Scenery(terrain, trunks, put_up(signs, terrain), **colours))
        return self.made[-1]


@pytest.fixture
def view() -> Iterator[Views]:
    views = Views()
    yield views
    for scenery in views.made:
        scenery.close()


def red(rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    r, g, b = rgb.astype(int).transpose(2, 0, 1)
    return (r > 90) & (g < 0.4 * r) & (b < 0.4 * r)


def at(height_m: float = 0.25, east_m: float = 0.0, north_m: float = 0.0) -> FloatArray:
    return np.array([east_m, north_m, height_m])


# --- signs -----------------------------------------------------------------------------------------------------------


def test_a_sign_stands_on_the_ground() -> None:
    slope = build_terrain(
        SlopeTerrain(kind="slope", slope_percent=10.0, cell_m=0.5), seed=1, extent=(-10.0, -10.0, 10.0, 10.0)
    )
    row = put_up([sign(east_m=4.0, height_m=0.3)], slope)[0]
    assert row[PLATE_U] == pytest.approx(0.4 + 0.3)
    assert row[POST_BOTTOM] == pytest.approx(0.4 - 0.2)


def test_wrong_signs_are_refused() -> None:
    with pytest.raises(ValidationError, match=r"height_m = 0\.05: half of the plate .* give 0\.075 or more"):
        sign(height_m=0.05)
    for wrong in ({"size_m": 0.0}, {"size_m": 3.0}, {"heading_deg": 400.0}, {"east_m": math.nan}, {"hight_m": 1.0}):
        with pytest.raises(ValidationError):
            sign(**wrong)
    with pytest.raises(BadInputError, match=r"signs\.1: \(50\.0, 0\.0\) m is off the terrain"):
        put_up([sign(), sign(east_m=50.0)], FLAT)


@pytest.mark.parametrize(("away", "aside"), [(1.0, 0.0), (1.0, 0.2), (0.7, -0.1), (2.0, 0.5)])
def test_the_plate_is_where_and_as_large_as_a_pinhole_camera_sees_it(view: Views, away: float, aside: float) -> None:
    # The camera is level with the middle of the plate; a sign to the right (south) is right in the picture.
    scenery = view(sign(east_m=away, north_m=-aside))
    rows, columns = np.nonzero(red(scenery.picture(NEED, at(), EAST)))
    size = FOCAL_PX * RED_SHARE * 0.15 / away
    # Middles of pixels; edges fall on whole ones.
    assert np.ptp(rows) + 1 == pytest.approx(size, abs=1.01)
    assert np.ptp(columns) + 1 == pytest.approx(size, abs=1.01)
    assert (rows.min() + rows.max()) / 2.0 == pytest.approx(119.5, abs=1.0)
    assert (columns.min() + columns.max()) / 2.0 == pytest.approx(159.5 + FOCAL_PX * aside / away, abs=1.0)


def test_the_word_reads_from_left_to_right(view: Views) -> None:
    image = view(sign(east_m=0.5)).picture(NEED, at(), EAST)
    painted = red(image)
    rows, columns = np.nonzero(painted)
    left, right = columns.min(), columns.max()
    middle = ~painted[round(rows.mean()) - 12 : round(rows.mean()) + 13, left : right + 1]
    word = np.flatnonzero(middle.any(axis=0) & (np.arange(middle.shape[1]) > 5))
    word = word[word < middle.shape[1] - 5]
    # P, on the right, has no ink in its lower right quarter, and S on the left does.
    low = middle[-8:]
    assert low[:, word[0] : word[0] + 8].any()
    assert not low[:, word[-1] - 5 : word[-1] + 1].any()


def test_a_sign_seen_obliquely_is_narrower_and_not_lower(view: Views) -> None:
    rows, columns = np.nonzero(red(view(sign(heading_deg=180.0 + 60.0)).picture(NEED, at(), EAST)))
    size = FOCAL_PX * RED_SHARE * 0.15
    assert np.ptp(rows) + 1 == pytest.approx(size, rel=0.07)
    assert np.ptp(columns) + 1 == pytest.approx(0.5 * size, abs=1.5)


def test_neither_from_behind_nor_behind_a_trunk_is_there_red(view: Views) -> None:
    tree = {"east_m": 0.6, "north_m": 0.0, "radius_m": 0.1}
    assert red(view(sign()).picture(NEED, at(), EAST)).sum() > 500
    assert not red(view(sign(heading_deg=0.0)).picture(NEED, at(), EAST)).any()
    assert not red(view(sign(), trees=[tree]).picture(NEED, at(), EAST)).any()
    # A tree behind the sign hides nothing.
    behind = view(sign(), trees=[{**tree, "east_m": 2.0}])
    assert red(behind.picture(NEED, at(), EAST)).sum() > 500


def test_the_nearest_sign_that_faces_the_camera_is_told_in_its_axes(view: Views) -> None:
    scenery = view(sign(east_m=3.0), sign(east_m=1.0, heading_deg=0.0), sign(east_m=5.0))
    np.testing.assert_allclose(scenery.nearest_sign(at(0.1), EAST), [3.0, 0.0, 0.15], atol=1e-12)
    np.testing.assert_allclose(scenery.nearest_sign(at(0.1), NORTH), [0.0, -3.0, 0.15], atol=1e-12)
    assert np.isnan(view().nearest_sign(at(), EAST)).all()
    assert scenery.nearest_sign(at(0.25, east_m=6.0), EAST)[0] == pytest.approx(-5.0)


# --- ground, trees, sky ----------------------------------------------------------------------------------------------


def test_sky_above_and_ground_below_the_horizon(view: Views) -> None:
    image = view().picture(NEED, at(0.3), EAST).astype(int)
    above, below = image[:118], image[124:]
    assert np.all(above[..., 2] > above[..., 0])
    assert np.all(below[..., 2] < below[..., 1])
    # Pitched up by 10 degrees the horizon sinks by f tan 10 = 46.8 pixels.
    tilted = view().picture(NEED, at(0.3), rotation_from_rpy(0.0, math.radians(-10.0), 0.0)).astype(int)
    blue = tilted[..., 2] > tilted[..., 0]
    assert np.flatnonzero(blue.all(axis=1)).max() == pytest.approx(120 + 46.8 - 1, abs=2.0)


def test_trunks_are_brown_pillars_where_they_stand_and_crowns_above_them(view: Views) -> None:
    tree = {"east_m": 3.0, "north_m": 0.6, "radius_m": 0.05, "height_m": 0.8}
    image = view(trees=[tree]).picture(NEED, at(0.3), EAST).astype(int)
    r, g, b = image.transpose(2, 0, 1)
    row = 105
    bark = np.flatnonzero((r[row] > g[row]) & (g[row] > b[row]))
    # Left by 0.6 m at 3 m, 0.1 m wide.
    assert bark.mean() == pytest.approx(159.5 - FOCAL_PX * 0.6 / 3.0, abs=1.0)
    assert len(bark) == pytest.approx(FOCAL_PX * 0.1 / 3.0, abs=1.5)
    # The crown's middle lies 0.2 m above the trunk's end.
    leaf = image[round(119.5 - FOCAL_PX * (1.0 - 0.3) / 3.0), round(bark.mean())]
    assert leaf[1] > leaf[0]
    assert leaf[1] > leaf[2]


def test_of_many_trees_none_is_left_out(view: Views) -> None:
    # 600 trees are three bodies of leaves; the first, the 300th and the last stand in front, all others behind.
    behind = [{"east_m": -1.0 - 0.01 * k, "north_m": 5.0, "radius_m": 0.05} for k in range(600)]
    sides = {0: 1.0, 299: 0.0, 599: -1.0}
    for number, side in sides.items():
        behind[number] = {"east_m": 3.0, "north_m": side, "radius_m": 0.05}
    row = view(trees=behind).picture(NEED, at(0.3), EAST).astype(int)[105]
    bark = np.flatnonzero((row[:, 0] > row[:, 1]) & (row[:, 1] > row[:, 2]))
    for side in sides.values():
        assert np.abs(bark - (159.5 - FOCAL_PX * side / 3.0)).min() < 1.0
    assert len(bark) == pytest.approx(3.0 * FOCAL_PX * 0.1 / 3.0, abs=4.5)


def test_meshes_face_outwards() -> None:
    trunk = planted(OrchardConfig.model_validate({"trees": [{"east_m": 1.0, "north_m": 2.0}]}).trunks(1), FLAT)[0]
    for mesh in (ground_mesh(FLAT), trunk_mesh(trunk), crown_mesh(trunk, 3), plate_mesh(put_up([sign()], FLAT)[0])):
        a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
        turned = np.cross(b - a, c - a)
        real = np.linalg.norm(turned, axis=1) > 1e-9
        normals = mesh.normals[mesh.triangles].mean(axis=1)
        assert np.all((turned * normals).sum(axis=1)[real] > 0.0)
        assert mesh.places.min() >= 0.0


def test_the_ground_mesh_lies_on_the_ground_and_reaches_its_edges() -> None:
    rough = build_terrain(
        RoughTerrain(kind="rough", iso8608_class="C", cell_m=0.05), seed=3, extent=(-3.0, -4.0, 30.0, 20.0)
    )
    mesh = ground_mesh(rough)
    assert len(mesh.vertices) < 8_000
    for east, north, up in mesh.vertices[::97]:
        assert up == pytest.approx(rough.height(east, north), abs=1e-9)
    west, south, east, north = rough.extent
    np.testing.assert_allclose(mesh.vertices[:, :2].min(axis=0), [west, south])
    np.testing.assert_allclose(mesh.vertices[:, :2].max(axis=0), [east, north])


def test_pictures_are_the_same_to_the_last_bit_in_any_order(view: Views) -> None:
    trees = [{"east_m": 2.0 + k, "north_m": (-1.0) ** k} for k in range(5)]
    one, other = view(sign(), trees=trees), view(sign(), trees=trees)
    poses = [(at(0.1, 0.1 * k), rotation_from_rpy(0.01 * k, 0.02, 0.1 * k)) for k in range(4)]
    forth = [one.picture(NEED, *pose) for pose in poses]
    back = [other.picture(NEED, *pose) for pose in reversed(poses)]
    for first, second in zip(forth, reversed(back), strict=True):
        np.testing.assert_array_equal(first, second)
    assert not np.array_equal(forth[0], forth[1])


# --- in the world ----------------------------------------------------------------------------------------------------


def test_the_world_takes_pictures_from_the_mount_and_knows_how_bright_it_is() -> None:
    machine = MACHINES["orchard_robot"](kind="orchard_robot", start={"heading_deg": 90.0})
    mount = machine.resolved_mounts["camera"]
    with build_world(
        FlatTerrain(kind="flat", cell_m=0.5), SoilConfig(preset="firm"), machine, seed=1,
        signs=[sign(east_m=0.0, north_m=12.0, heading_deg=270.0)], light=LightConfig(lux=777.0),
    ) as world:  # fmt: skip
        # The ground reaches the sign, which stands beyond what the machine needs.
        assert world.terrain.contains(0.0, 12.0)
        need = ImageNeed(mount=mount, width_px=64, height_px=48, horizontal_fov_rad=1.0)
        world.watch("camera", need)
        picture = world.capture("camera")
    assert isinstance(picture, Picture)
    assert picture.rgb.shape == (48, 64, 3)
    assert picture.rgb.dtype == np.uint8
    assert picture.illuminance_lux == 777.0
    forward = mount.xyz_m[0]
    np.testing.assert_allclose(picture.sign_xyz_m, [12.0 - forward, 0.0, 0.25 - picture.position_enu_m[2]], atol=0.05)
    assert picture.position_enu_m[2] == pytest.approx(0.033 + mount.xyz_m[2], abs=2e-3)


def test_the_scenery_is_built_for_the_first_picture_only_and_put_away(monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[int] = []
    connect = pybullet.connect
    monkeypatch.setattr(pybullet, "connect", lambda *a, **k: built.append(client := connect(*a, **k)) or client)
    machine = MACHINES["orchard_robot"](kind="orchard_robot")
    world = build_world(
        FlatTerrain(kind="flat", cell_m=0.5), SoilConfig(preset="firm"), machine, seed=1, signs=[sign()]
    )
    before = len(built)
    world.watch("camera", NEED)
    world.advance(100)
    assert len(built) == before
    for _ in range(3):
        world.capture("camera")
    assert len(built) == before + 1
    world.close()
    assert not any(pybullet.isConnected(client) for client in built)
