"""Camera that looks for a stop sign (kind ``camera``): a real picture of an ideal one, and what a detector finds in it.

The world shows an evenly exposed picture. Its display values d of 0 to 255 become linear light r = (d / 255)^2.2, a
lens blurs it, and the camera exposes by itself. In a light of L lux white gives

    n = N min(1, L / L_N)                 electrons in a pixel, N its full well, L_N where the longest exposure fills it
    g = min(g_max, max(1, L_N / L))       gain, so that a picture is dim below L_N / g_max only
    e = n (r + s max(0, 1 - L_G / L))     electrons; beyond L_G stray light of the sun veils the picture, s at most

and a pixel's value is g (e + sqrt(e + q^2) z) / N with white normal noise z: the shot noise of e electrons (as a
normal number) and the read noise q. What is beyond the full well is white; the rest gets its display value back. Where
the sun stands relative to the camera does not count.

:mod:`twin.sensors.stop_sign` looks for the sign in what comes out, in each run by itself; where none is found the
columns but ``sign_seen`` are NaN. The first run's pictures go into the record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from twin import jpeg
from twin.config import NonNegative, Positive
from twin.randomness import value_generator
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.stop_sign import find_stop_sign
from twin.signals import SIGN_BEARING, SIGN_RANGE, SIGN_SEEN, Capture, FloatArray, ImageNeed, Mount, Need, Picture

BOX = ("box_left_px", "box_top_px", "box_width_px", "box_height_px")

_GAMMA = 2.2
_STEPS = 4095
"""Of the converter, 12 bits."""


class CameraConfig(SensorConfig):
    """A camera and the sign it looks for."""

    kind: Literal["camera"]
    width_px: Annotated[int, Field(ge=32, le=1920)] = 320
    height_px: Annotated[int, Field(ge=24, le=1080)] = 240
    horizontal_fov_deg: Annotated[float, Field(ge=10.0, le=120.0)]
    """From the left edge of the picture to the right."""
    full_well_e: Positive
    """Electrons that a pixel holds."""
    read_noise_e: NonNegative = 0.0
    """Standard deviation of a pixel's noise in the dark."""
    full_well_lux: Positive
    """Brightness from which on white can fill the well; exposures are shorter in brighter light."""
    largest_gain: Annotated[float, Field(ge=1.0)] = 1.0
    """In less light."""
    glare_lux: Positive | None = None
    """Beyond it stray light veils the picture; never if not given."""
    glare_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Most stray light, as a share of what white gives."""
    blur_px: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0
    """Standard deviation of the lens' blur."""
    sign_size_m: Annotated[float, Field(gt=0.0, le=2.0)]
    """Size across flats of the sign that is looked for, from which its distance follows."""

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return 0.5 * self.width_px / math.tan(math.radians(0.5 * self.horizontal_fov_deg))

    @property
    def recorded_columns(self) -> int:
        """About how many numbers a sample leaves in memory: a stress test keeps whole pictures for its members."""
        return 40 + self.width_px * self.height_px * 3 // 8

    def need(self, mount: Mount) -> Need:
        """A picture from the mount."""
        fov = math.radians(self.horizontal_fov_deg)
        return ImageNeed(mount=mount, width_px=self.width_px, height_px=self.height_px, horizontal_fov_rad=fov)


class Exposure:
    """Turns ideal pictures into real ones."""

    def __init__(self, config: CameraConfig) -> None:
        self._config = config
        self._linear = ((np.arange(256) / 255.0) ** _GAMMA).astype(np.float32)
        shown = 255.0 * (np.arange(_STEPS + 1) / _STEPS) ** (1.0 / _GAMMA)
        self._shown = np.round(shown).astype(np.uint8)

    def electrons(self, rgb: NDArray[np.uint8], lux: float) -> NDArray[np.float32]:
        """Mean electrons of every pixel and colour (h, w, 3)."""
        config = self._config
        light = self._linear[rgb]
        if config.blur_px > 0.0:
            light = cv2.GaussianBlur(light, (0, 0), config.blur_px).astype(np.float32)
        limit = config.glare_lux
        veil = 0.0 if limit is None or lux <= limit else config.glare_share * (1.0 - limit / lux)
        white = config.full_well_e * min(1.0, lux / config.full_well_lux)
        mean: NDArray[np.float32] = np.float32(white) * (light + np.float32(veil))
        return mean

    def develop(self, electrons: NDArray[np.float32], noise: NDArray[np.float32], lux: float) -> NDArray[np.uint8]:
        """Picture (h, w, 3) RGB from mean electrons and standard normal numbers (h, w, 3)."""
        config = self._config
        gain = min(config.largest_gain, max(1.0, config.full_well_lux / max(lux, 1e-9)))
        value = electrons + np.sqrt(electrons + np.float32(config.read_noise_e**2)) * noise
        value *= np.float32(gain * _STEPS / config.full_well_e)
        shown: NDArray[np.uint8] = self._shown[np.clip(np.rint(value), 0.0, _STEPS).astype(np.intp)]
        return shown


class Camera(Sensor):
    """Stop signs in pictures."""

    columns: tuple[str, ...] = (SIGN_SEEN, SIGN_RANGE, SIGN_BEARING, *BOX)
    error_columns: tuple[str, ...] = ()
    extra_hidden_columns: ClassVar = ("true_sign_range_m", "true_sign_bearing_rad")
    """Of the nearest sign whose front faces the camera, in the picture or not."""

    def __init__(
        self, config: CameraConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._config = config
        self._exposure = Exposure(config)
        # Not a NormalStream: a block of pictures for every run would fill the memory.
        self._generators = [value_generator(seed, run, f"sensors.{name}.pixels") for run in runs]

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, Picture)
        lux = capture.illuminance_lux
        electrons = self._exposure.electrons(capture.rgb, lux)
        values = np.empty((self._runs, len(self.columns)))
        pictures: tuple[jpeg.EncodedPicture, ...] = ()
        for run, generator in enumerate(self._generators):
            noise = generator.standard_normal(electrons.shape, dtype=np.float32)
            taken = self._exposure.develop(electrons, noise, lux)
            values[run] = self._look(taken)
            if run == 0:
                pictures = (jpeg.EncodedPicture(t_ns=self._schedule.stamp_ns, jpeg=jpeg.encode(taken)),)
        x, y, z = capture.sign_xyz_m
        place = math.sqrt(x * x + y * y + z * z), math.atan2(y, x)
        hidden = np.tile(np.array(place), (self._runs, 1))
        return Reading(values=values, truth=np.full(len(self.columns), np.nan), hidden=hidden, pictures=pictures)

    def _look(self, rgb: NDArray[np.uint8]) -> FloatArray:
        """Measured columns (n,) of a picture."""
        config = self._config
        found = find_stop_sign(rgb)
        if found is None:
            return np.array([0.0, *[math.nan] * (len(self.columns) - 1)])
        size = config.width_px, config.height_px
        place = found.place(size_m=config.sign_size_m, focal_px=config.focal_px, picture_px=size)
        return np.array([1.0, *place, found.left_px, found.top_px, found.width_px, found.height_px])

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, CameraConfig)
        return {
            "width_px": float(config.width_px),
            "height_px": float(config.height_px),
            "focal_px": config.focal_px,
            "sign_size_m": config.sign_size_m,
        }

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        assert isinstance(config, CameraConfig)
        return np.zeros(len(self.columns))
