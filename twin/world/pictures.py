"""Pictures of the field, rendered by pybullet's software renderer (TinyRenderer).

A second client holds only what there is to see: ground, trees, signs. What lies behind everything is sky above the
horizon and hazy land below. The light is always the same: how a camera copes with the brightness is its own affair
(:mod:`twin.sensors.camera`). The machine itself is not in the picture, and nothing throws a shadow.

The renderer takes single texels and samples the middles of pixels, so edges have steps; twice as fine and averaged,
they would cost four times as much and a sign's distance would be no better.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pybullet
from numpy.typing import NDArray

from twin.signals import FloatArray, ImageNeed
from twin.stop_sign import draw_plate
from twin.world import scenery
from twin.world.scenery import Mesh, Rgb, Texture
from twin.world.signs import PLATE_E, PLATE_HEADING, PLATE_U
from twin.world.terrain import Terrain

NEAR_M, FAR_M = 0.02, 300.0

_AMBIENT, _DIFFUSE = 0.62, 0.48
_SUN = (-0.45, -0.35, 0.82)
_ZENITH: Rgb = (122.0, 164.0, 214.0)
_HORIZON: Rgb = (206.0, 218.0, 226.0)
_LAND: Rgb = (128.0, 132.0, 104.0)
_SKY_RISES_RAD = math.radians(35.0)
_MOST_VERTICES = 20_000
"""Of one body, give or take a mesh: pybullet takes some more."""
_PLATE_TEXELS = 128
"""About a millimetre each."""
_BACKGROUND_DEPTH = 1.0 - 1e-6
"""The renderer's depth where nothing is, less its rounding; things have it beyond 295 m."""


class Scenery:
    """The field as a camera sees it, built once.

    Args:
        terrain: the ground.
        trunks: trees on it (N, TRUNK_COLUMNS), see :mod:`twin.world.orchard`.
        signs: stop signs on it (K, SIGN_COLUMNS), see :mod:`twin.world.signs`.
        soil: colour of bare soil.
        grass: colour of what grows on it.
    """

    def __init__(
        self,
        terrain: Terrain,
        trunks: FloatArray,
        signs: FloatArray,
        *,
        soil: Rgb = scenery.SOIL,
        grass: Rgb = scenery.GRASS,
    ) -> None:
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self._signs = signs
        try:
            self._add([scenery.ground_mesh(terrain)], scenery.ground_texture(soil, grass))
            self._add([scenery.trunk_mesh(trunk) for trunk in trunks], scenery.bark_texture())
            self._add([scenery.crown_mesh(trunk, k) for k, trunk in enumerate(trunks)], scenery.leaf_texture())
            self._add([scenery.plate_mesh(sign) for sign in signs], draw_plate(_PLATE_TEXELS))
            self._add([scenery.backing_mesh(sign) for sign in signs], scenery.metal_texture())
        except BaseException:
            self.close()
            raise

    def _add(self, meshes: Sequence[Mesh], texture: Texture) -> None:
        """Put meshes with one texture into the scene, as few bodies."""
        piles = np.cumsum([len(mesh.vertices) for mesh in meshes]) // _MOST_VERTICES
        for _, pile in groupby(zip(piles.tolist(), meshes, strict=True), key=itemgetter(0)):
            self._add_body(scenery.together([mesh for _, mesh in pile]), texture)

    def _add_body(self, mesh: Mesh, texture: Texture) -> None:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=mesh.vertices.tolist(),
            normals=mesh.normals.tolist(),
            uvs=mesh.places.tolist(),
            indices=mesh.triangles.ravel().tolist(),
            rgbaColor=(1.0, 1.0, 1.0, 1.0),
            physicsClientId=self._client,
        )
        body = pybullet.createMultiBody(baseVisualShapeIndex=shape, physicsClientId=self._client)
        # pybullet takes textures from files only, and has read this one when it returns.
        with tempfile.TemporaryDirectory(prefix="agtwin-") as folder:
            path = Path(folder) / "texture.png"
            cv2.imwrite(str(path), cv2.cvtColor(texture, cv2.COLOR_RGB2BGR))
            number = pybullet.loadTexture(str(path), physicsClientId=self._client)
        pybullet.changeVisualShape(body, -1, textureUniqueId=number, physicsClientId=self._client)

    def picture(self, need: ImageNeed, position: FloatArray, rotation: FloatArray) -> NDArray[np.uint8]:
        """Ideal picture (height, width, 3) RGB of a camera at ``position`` that looks along the mount's x axis.

        ``rotation`` (3, 3) turns mount axes into the world's.
        """
        width, height = need.width_px, need.height_px
        view = pybullet.computeViewMatrix(
            position.tolist(), (position + rotation[:, 0]).tolist(), rotation[:, 2].tolist()
        )
        answer: Any = pybullet.getCameraImage(
            width,
            height,
            view,
            _projection(need),
            lightDirection=_SUN,
            lightColor=(1.0, 1.0, 1.0),
            lightAmbientCoeff=_AMBIENT,
            lightDiffuseCoeff=_DIFFUSE,
            lightSpecularCoeff=0.0,
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self._client,
        )
        # Arrays or flat tuples, by how pybullet was built.
        image = np.asarray(answer[2], dtype=np.uint8).reshape(height, width, 4)[..., :3]
        depth = np.asarray(answer[3], dtype=np.float32).reshape(height, width)
        return np.where((depth < _BACKGROUND_DEPTH)[..., np.newaxis], image, _background(need, rotation))

    def nearest_sign(self, position: FloatArray, rotation: FloatArray) -> FloatArray:
        """Middle of the nearest plate whose front faces a mount, in the mount's axes (3,), m; NaN without one."""
        away = self._signs[:, PLATE_E : PLATE_U + 1] - position
        heading = self._signs[:, PLATE_HEADING]
        faces = away[:, 0] * np.cos(heading) + away[:, 1] * np.sin(heading) < 0.0
        if not faces.any():
            return np.full(3, np.nan)
        away = away[faces]
        nearest: FloatArray = away[np.argmin(np.linalg.norm(away, axis=1))] @ rotation
        return nearest

    def close(self) -> None:
        """Disconnect; may be called more than once."""
        if self._client >= 0:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = -1


def _projection(need: ImageNeed) -> Any:
    aspect = need.width_px / need.height_px
    upright = 2.0 * math.atan(math.tan(0.5 * need.horizontal_fov_rad) / aspect)
    return pybullet.computeProjectionMatrixFOV(math.degrees(upright), aspect, NEAR_M, FAR_M)


def _background(need: ImageNeed, rotation: FloatArray) -> NDArray[np.uint8]:
    """Sky and far land where nothing else is, (height, width, 3)."""
    width, height = need.width_px, need.height_px
    focal = 0.5 * width / math.tan(0.5 * need.horizontal_fov_rad)
    left = (0.5 * (width - 1) - np.arange(width, dtype=np.float32)) / np.float32(focal)
    up = (0.5 * (height - 1) - np.arange(height, dtype=np.float32))[:, np.newaxis] / np.float32(focal)
    forward_z, left_z, up_z = (np.float32(value) for value in rotation[2])
    rise = (forward_z + left_z * left + up_z * up) / np.sqrt(1.0 + left * left + up * up)
    shades = _shades()
    scaled = np.clip(rise * np.float32(1.0 / math.sin(_SKY_RISES_RAD)), -1.0, 1.0)
    return shades[np.round((scaled + 1.0) * (0.5 * (len(shades) - 1))).astype(np.intp)]


def _shades() -> NDArray[np.uint8]:
    """Colours from straight below (the first half is land) to the upper sky."""
    share = np.linspace(0.0, 1.0, 128)[:, np.newaxis]
    sky = np.array(_HORIZON) + share**0.7 * (np.array(_ZENITH) - _HORIZON)
    return np.round(np.concatenate([np.tile(_LAND, (128, 1)), sky])).astype(np.uint8)
