"""The detector finds stop signs in rendered pictures as a real camera would take them, and nothing else.

Pictures are rendered and then exposed with the noise of the preset, so that what is tested is what a run sees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.sensors.motions import CONFIGS, preset, sign_ahead
from twin.geometry import rotation_from_rpy
from twin.sensors.camera import CameraConfig, Exposure
from twin.sensors.stop_sign import Detection, find_stop_sign
from twin.signals import FloatArray, ImageNeed, Mount
from twin.stop_sign import RED_SHARE
from twin.world.orchard import OrchardConfig, planted
from twin.world.pictures import Scenery
from twin.world.signs import SignConfig, put_up
from twin.world.terrain import RoughTerrain, Terrain, build_terrain

SIZE_M = 0.15
LENS_M = 0.109
"""Height of the small robot's camera: 0.033 m axle and 1.8 decks of 0.042 m."""
LIGHTS = [300.0, 3_000.0, 20_000.0, 100_000.0]
LANE = {
    "length_m": 20.0, "width_m": 1.5, "spacing_m": 1.5, "crooked_m": 0.15,
    "radius_m": 0.05, "radius_spread_m": 0.015, "missing_probability": 0.1,
}  # fmt: skip
GROUND = build_terrain(
    RoughTerrain(kind="rough", iso8608_class="B", cell_m=0.05), seed=1, extent=(-4.0, -5.0, 25.0, 5.0)
)


def _config() -> CameraConfig:
    config = CONFIGS.validate_python(preset("camera_pi_v2"))
    assert isinstance(config, CameraConfig)
    return config


CONFIG = _config()
NEED = CONFIG.need(Mount(body="chassis", xyz_m=(0.0, 0.0, 0.0)))
assert isinstance(NEED, ImageNeed)
PICTURE_PX = NEED.width_px, NEED.height_px
EXPOSURE = Exposure(CONFIG)


class Camera:
    """Pictures of a scenery, with the noise of the preset."""

    def __init__(self, scenery: Scenery, terrain: Terrain = GROUND) -> None:
        self.scenery, self.terrain = scenery, terrain
        self._generator = np.random.default_rng(1)

    def __call__(self, east: float, north: float, rotation: FloatArray, lux: float, up: float = LENS_M) -> Any:
        """The picture, and where the sign truly is in the camera's axes."""
        assert isinstance(NEED, ImageNeed)
        position = np.array([east, north, self.terrain.height(east, north) + up])
        return self.expose(self.scenery.picture(NEED, position, rotation), lux), self.scenery.nearest_sign(
            position, rotation
        )

    def expose(self, ideal: NDArray[np.uint8], lux: float) -> NDArray[np.uint8]:
        electrons = EXPOSURE.electrons(ideal, lux)
        noise = self._generator.standard_normal(electrons.shape, dtype=np.float32)
        return EXPOSURE.develop(electrons, noise, lux)


@pytest.fixture
def look() -> Iterator[Callable[..., Camera]]:
    made: list[Scenery] = []

    def make(signs: Any = (), trees: Any = (), lanes: Any = (LANE,), seed: int = 1, **colours: Any) -> Camera:
        trunks = planted(OrchardConfig.model_validate({"lanes": lanes, "trees": trees}).trunks(seed), GROUND)
        up = put_up([SignConfig(**keys) for keys in signs], GROUND)
        made.append(Scenery(GROUND, trunks, up, **colours))
        return Camera(made[-1])

    yield make
    for scenery in made:
        scenery.close()


SIGN = {"east_m": 20.0, "north_m": 0.0, "heading_deg": 180.0}


def _place(found: Detection) -> tuple[float, float]:
    return found.place(size_m=SIZE_M, focal_px=CONFIG.focal_px, picture_px=PICTURE_PX)


@pytest.mark.parametrize("lux", LIGHTS)
@pytest.mark.parametrize("angle_deg", [0.0, 20.0, -20.0, 40.0, -40.0])
def test_a_sign_is_found_with_its_distance_and_bearing(look: Any, angle_deg: float, lux: float) -> None:
    camera = look([SIGN])
    angle = math.radians(angle_deg)
    for away in (0.7, 1.0, 1.5, 2.0, 2.4):
        for turn in (-0.25, 0.0, 0.2):
            east, north = 20.0 - away * math.cos(angle), -away * math.sin(angle)
            rotation = rotation_from_rpy(0.03 * turn, 0.02, angle + turn)
            picture, (x, y, z) = camera(east, north, rotation, lux)
            found = find_stop_sign(picture)
            assert found is not None, f"{away} m, turned by {turn}"
            distance, bearing = _place(found)
            # Half a pixel of the 38 / d that the red is high at a distance d, and 3 % for leaning, noise and light.
            assert distance == pytest.approx(math.sqrt(x * x + y * y + z * z), rel=0.03 + 0.5 * away / 38.0)
            assert bearing == pytest.approx(math.atan2(y, x), abs=math.radians(1.0))


def test_a_sign_is_found_until_it_is_too_small_and_lost_in_the_dark(look: Any) -> None:
    camera = look([SIGN])
    straight = np.eye(3)
    # At 5 m its red is 7.5 pixels high: letters of two and a half pixels are not judged.
    assert find_stop_sign(camera(15.0, 0.0, straight, 20_000.0)[0]) is None
    assert find_stop_sign(camera(19.0, 0.0, straight, 20.0)[0]) is not None
    # At 1 lux white gives 5.7 electrons, less than the read noise.
    assert find_stop_sign(camera(19.0, 0.0, straight, 1.0)[0]) is None


def test_a_sign_from_behind_or_behind_a_trunk_is_not_found(look: Any) -> None:
    tree = {"east_m": 19.3, "north_m": 0.0, "radius_m": 0.1}
    straight = np.eye(3)
    assert find_stop_sign(look([SIGN], lanes=())(18.5, 0.0, straight, 5_000.0)[0]) is not None
    assert find_stop_sign(look([SIGN | {"heading_deg": 0.0}], lanes=())(18.5, 0.0, straight, 5_000.0)[0]) is None
    assert find_stop_sign(look([SIGN], [tree], lanes=())(18.5, 0.0, straight, 5_000.0)[0]) is None
    # Half hidden it is no octagon.
    tree["north_m"] = 0.1
    assert find_stop_sign(look([SIGN], [tree], lanes=())(18.5, 0.0, straight, 5_000.0)[0]) is None


@pytest.mark.parametrize(
    "colours",
    [
        {},
        {"soil": (170.0, 70.0, 50.0)},
        {"soil": (178.0, 24.0, 34.0), "grass": (200.0, 60.0, 60.0)},
        {"soil": (178.0, 24.0, 34.0), "grass": (244.0, 244.0, 240.0)},
    ],
    ids=["soil", "red soil", "all the sign's red", "the sign's red and white"],
)
def test_nothing_is_found_where_there_is_no_sign(look: Any, colours: Any) -> None:
    generator = np.random.default_rng(7)
    for seed in (1, 2):
        camera = look(seed=seed, **colours)
        for east in np.linspace(-1.0, 21.0, 45):
            roll, pitch = generator.normal(0.0, 0.05, 2)
            yaw = generator.choice([0.0, generator.uniform(-math.pi, math.pi)])
            lux = float(generator.choice([5.0, *LIGHTS]))
            picture, _ = camera(
                float(east),
                generator.uniform(-0.4, 0.4),
                rotation_from_rpy(roll, pitch, yaw),
                lux,
                up=generator.uniform(0.08, 0.6),
            )
            assert find_stop_sign(picture) is None, f"seed {seed}, east {east:.2f}, yaw {yaw:.2f}, {lux} lux"


def _shape(corners: Any, *, bar: bool = False) -> NDArray[np.uint8]:
    """A red shape before grass; with a white bar instead of letters."""
    image = np.full((240, 320, 3), (98, 122, 58), dtype=np.uint8)
    cv2.fillPoly(image, [np.round(np.add(corners, [160.0, 120.0])).astype(np.int32)], (178, 24, 34))
    if bar:
        cv2.rectangle(image, (132, 112), (188, 128), (244, 244, 240), -1)
    return image


def test_other_red_things_are_no_stop_signs() -> None:
    assert isinstance(NEED, ImageNeed)
    real = sign_ahead(NEED, 64)
    assert find_stop_sign(real) is not None
    turns = np.arange(0.0, 2.0 * math.pi, math.pi / 4.0)
    ring = np.column_stack([np.cos(turns + math.pi / 8.0), np.sin(turns + math.pi / 8.0)])
    square = [(-30, -30), (30, -30), (30, 30), (-30, 30)]
    triangle = [(-30, 30), (0, -30), (30, 30)]
    round_one = np.column_stack([np.cos(np.linspace(0, 6.28, 60)), np.sin(np.linspace(0, 6.28, 60))])
    # An octagon without letters; a square and a triangle with a bar; a round sign whose bar is all white.
    for image in (_shape(32.0 * ring), _shape(square, bar=True), _shape(triangle, bar=True)):
        assert find_stop_sign(image) is None
    no_entry = _shape(32.0 * round_one, bar=True)
    assert find_stop_sign(no_entry) is None
    # The same sign in blue.
    assert find_stop_sign(np.ascontiguousarray(real[..., ::-1])) is None
    # Cut by the edge of the picture.
    assert find_stop_sign(np.ascontiguousarray(real[:, 140:])) is None


@pytest.mark.parametrize("size_px", [24, 40, 64, 120])
def test_the_height_of_a_drawn_sign_is_read_to_a_part_of_a_pixel(size_px: int) -> None:
    assert isinstance(NEED, ImageNeed)
    found = find_stop_sign(sign_ahead(NEED, size_px))
    assert found is not None
    # The drawing takes all pixels that an edge touches, and four of them make one of the picture.
    assert found.red_height_px == pytest.approx(RED_SHARE * size_px, abs=0.5)
    distance, bearing = _place(found)
    assert distance == pytest.approx(CONFIG.focal_px * SIZE_M / size_px, rel=0.5 / size_px)
    assert abs(bearing) < 0.5 / CONFIG.focal_px + 1e-9


def test_the_larger_of_two_signs_counts() -> None:
    assert isinstance(NEED, ImageNeed)
    both = np.concatenate([sign_ahead(NEED, 30)[:, :160], sign_ahead(NEED, 60)], axis=1)
    both[:, 145:160] = both[0, 0]
    both[:, 60:100] = sign_ahead(NEED, 30)[:, 140:180]
    found = find_stop_sign(both)
    assert found is not None
    assert found.height_px > 50
