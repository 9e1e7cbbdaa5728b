"""The camera's physics: light, electrons, noise; and what it gives of what the detector finds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, DT_NS, preset, sensor, sign_ahead
from twin import jpeg
from twin.sensors import Sample, Sensor
from twin.sensors.camera import CameraConfig, Exposure
from twin.signals import FloatArray, ImageNeed, Picture

CONFIG: dict[str, Any] = {
    "kind": "camera", "rate_hz": 5.0, "horizontal_fov_deg": 60.0, "full_well_e": 10_000.0, "read_noise_e": 20.0,
    "full_well_lux": 1_000.0, "largest_gain": 8.0, "glare_lux": 20_000.0, "glare_share": 0.2, "sign_size_m": 0.15,
}  # fmt: skip


def exposed(level: int, lux: float, *, pixels: int = 200, **keys: Any) -> NDArray[np.uint8]:
    """An even picture of one display value, as the camera takes it."""
    config = CONFIGS.validate_python({"mount": "here", **CONFIG, **keys})
    assert isinstance(config, CameraConfig)
    camera = Exposure(config)
    electrons = camera.electrons(np.full((pixels, pixels, 3), level, dtype=np.uint8), lux)
    noise = np.random.default_rng(2).standard_normal(electrons.shape, dtype=np.float32)
    return camera.develop(electrons, noise, lux)


def light(picture: NDArray[np.uint8]) -> FloatArray:
    linear: FloatArray = (picture / 255.0) ** 2.2
    return linear


def shoot(device: Sensor, rgb: NDArray[np.uint8], lux: float = 2_000.0) -> Sample:
    place = np.array([0.8, 0.1, 0.05])
    at = {"t_ns": device.next_tick * DT_NS, "position_enu_m": np.zeros(3)}
    return device.sample(Picture(**at, rgb=rgb, illuminance_lux=lux, sign_xyz_m=place))


def image_need(device: Sensor) -> ImageNeed:
    assert isinstance(device.need, ImageNeed)
    return device.need


@pytest.mark.parametrize(
    ("lux", "electrons", "gain"),
    # White fills the well at 1000 lux; a gain of 8 makes up for 125 lux; half as much light is half as bright.
    [(50_000.0, 10_000.0, 1.0), (1_000.0, 10_000.0, 1.0), (250.0, 2_500.0, 4.0), (62.5, 625.0, 8.0)],
)
def test_brightness_and_noise_follow_the_electrons(lux: float, electrons: float, gain: float) -> None:
    level = 186
    grey = (level / 255.0) ** 2.2
    picture = exposed(level, lux, glare_lux=None)
    seen = grey * electrons
    mean = gain * seen / 10_000.0
    # 120 000 pixels; rounding to a display value moves a mean by less than a tenth of a step of 1 %.
    assert light(picture).mean() == pytest.approx(mean, rel=0.01)
    noise = gain * math.sqrt(seen + 20.0**2) / 10_000.0
    step = 2.2 * mean / (255.0 * mean ** (1.0 / 2.2))
    assert light(picture).std() == pytest.approx(math.hypot(noise, step / math.sqrt(12.0)), rel=0.03)


def test_in_the_dark_only_read_noise_is_left() -> None:
    dark = light(exposed(255, 0.0))
    # Half of the normal numbers are below zero, which a picture cannot show.
    assert np.mean(dark == 0.0) == pytest.approx(0.5, abs=0.02)
    assert np.sqrt(np.mean(dark[dark > 0.0] ** 2)) == pytest.approx(8.0 * 20.0 / 10_000.0, rel=0.05)


def test_sun_veils_and_saturates() -> None:
    # At five times the limit 0.2 (1 - 1/5) = 0.16 of white is added to everything.
    black = light(exposed(0, 100_000.0, read_noise_e=0.0))
    assert black.mean() == pytest.approx(0.16, rel=0.01)
    assert np.all(exposed(250, 100_000.0) == 255)
    assert light(exposed(0, 20_000.0)).mean() < 0.005


def test_the_lens_blurs_light() -> None:
    config = CONFIGS.validate_python({"mount": "here", **CONFIG, "blur_px": 1.5})
    assert isinstance(config, CameraConfig)
    edge = np.zeros((41, 40, 3), dtype=np.uint8)
    edge[:, 20:] = 255
    profile = Exposure(config).electrons(edge, 1_000.0)[20, :, 0] / 10_000.0
    # The step between columns 19 and 20 becomes a normal distribution's integral of 1.5 pixels.
    expected = [0.5 * (1.0 + math.erf((column - 19.5) / (1.5 * math.sqrt(2.0)))) for column in range(40)]
    np.testing.assert_allclose(profile, expected, atol=0.01)


def test_the_focal_length_is_half_the_width_over_the_tangent() -> None:
    device = sensor(preset("camera_pi_v2"))
    need = image_need(device)
    assert (need.width_px, need.height_px) == (320, 240)
    assert math.degrees(need.horizontal_fov_rad) == pytest.approx(62.2)
    assert device.info.datasheet["focal_px"] == pytest.approx(265.2, abs=0.1)
    assert device.info.datasheet["sign_size_m"] == 0.15


def test_a_sign_gives_a_distance_and_a_bearing_and_arrives_late() -> None:
    device = sensor(preset("camera_pi_v2"))
    sample = shoot(device, sign_ahead(image_need(device), 48))
    measurement = sample.measurements[0]
    assert measurement.t_available_ns - measurement.t_ns == 100_000_000
    seen, away, bearing, left, top, width, height = measurement.values[0]
    assert seen == 1.0
    # f 0.15 m / 48 px.
    assert away == pytest.approx(265.2 * 0.15 / 48.0, rel=0.02)
    assert abs(bearing) < 2e-3
    assert (left + 0.5 * width, top + 0.5 * height) == pytest.approx((160.0, 120.0), abs=0.6)
    assert (width, height) == pytest.approx((0.94 * 48.0, 0.94 * 48.0), abs=1.5)
    true = dict(zip(device.hidden_columns, sample.hidden[0], strict=True))
    assert true["true_sign_range_m"] == pytest.approx(math.sqrt(0.8**2 + 0.1**2 + 0.05**2))
    assert true["true_sign_bearing_rad"] == pytest.approx(math.atan2(0.1, 0.8))


def test_without_a_sign_nothing_but_that_is_given() -> None:
    device = sensor(preset("camera_pi_v2"), runs=range(2))
    grass = np.full((240, 320, 3), (98, 122, 58), dtype=np.uint8)
    values = shoot(device, grass).measurements[0].values
    assert np.all(values[:, 0] == 0.0)
    assert np.isnan(values[:, 1:]).all()


def test_the_record_has_the_first_runs_picture_also_where_the_sample_is_lost() -> None:
    lost = {"dropout_probability": 1.0, "width_px": 64, "height_px": 48}
    device = sensor(preset("camera_pi_v2") | lost, runs=range(3))
    sample = shoot(device, np.full((48, 64, 3), 128, dtype=np.uint8))
    assert not sample.measurements
    (picture,) = sample.pictures
    assert picture.t_ns == 200_000_000
    shown = jpeg.decode(picture.jpeg)
    assert shown.shape == (48, 64, 3)
    assert abs(float(shown.mean()) - 128.0) < 2.0


def test_members_have_their_own_noise_and_are_the_ordinary_runs() -> None:
    config = preset("camera_pi_v2")
    together = sensor(config, runs=range(4))
    rgb = sign_ahead(image_need(together), 30)
    many = [shoot(together, rgb, 15.0).measurements[0].values for _ in range(3)]
    assert len(np.unique(many[0][:, 1])) == 4
    for run in (0, 3):
        alone = sensor(config, runs=[run])
        for each in many:
            assert shoot(alone, rgb, 15.0).measurements[0].values[0].tobytes() == each[run].tobytes()


@pytest.mark.parametrize(
    "wrong",
    [
        {"width_px": 8},
        {"height_px": 5000},
        {"horizontal_fov_deg": 0.0},
        {"full_well_e": 0.0},
        {"largest_gain": 0.5},
        {"glare_share": 2.0},
        {"sign_size_m": -1.0},
        {"blur": 1.0},
    ],
)
def test_wrong_values_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        CONFIGS.validate_python({"mount": "here", **CONFIG, **wrong})
