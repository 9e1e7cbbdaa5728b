"""The magnetometer as a heading reference of :mod:`twin.estimators.heading_filter`: judged, levelled, and never exact.

The field is levelled by the whole attitude and judged (:mod:`twin.estimators.magnetic_disturbance`). What makes a clean
field's direction deviate from magnetic north is a constant and a part that comes and goes (states D0 and D). The latter
holds what the place does and what the body does: iron that it carries, and the tilt that the accelerometer's own offset
hides from the levelling. A hidden tilt t turns the levelled field by up to t tan(dip), this way or that as the body
turns: with a cheap accelerometer, off by 0.05 g, and a dip of 56 deg that is 4 deg, more than all else.
"""

from __future__ import annotations

import numpy as np

from twin.estimators.engines import Engine, innovation
from twin.estimators.heading_model import D, FieldSeen, T, rotate
from twin.estimators.magnetic_disturbance import DisturbanceConfig, DisturbanceDetector
from twin.geometry import wrap_angle
from twin.signals import BoolArray, FloatArray

_TILT_S = 1.0
"""How long an error of the tilt lasts; a choice, between the gyroscope's short noise and a slow offset."""


class FieldHeading:
    """Judges the field and tells the engine; arrays are (R,)."""

    def __init__(
        self,
        config: DisturbanceConfig,
        *,
        north_rad: float,
        noise_ut: float,
        deviation_rad: float,
        hidden_tilt_rad: float,
        runs: int,
    ) -> None:
        self._north_rad, self._noise_ut = north_rad, noise_ut
        self._deviation_rad, self._hidden_tilt_rad = deviation_rad, hidden_tilt_rad
        self._seen = FieldSeen()
        self._detector = DisturbanceDetector(config, runs=runs)
        self._by_tilt: FloatArray = np.zeros(runs)

    @property
    def state(self) -> FloatArray:
        """Of the magnetometer, as :mod:`twin.estimators.magnetic_disturbance` counts them."""
        return self._detector.state.astype(np.float64)

    @property
    def deviation_variance(self) -> FloatArray:
        """Of D where it has wandered long, rad^2."""
        return self._deviation_rad**2 + self._by_tilt

    def hear(
        self,
        engine: Engine,
        field_ut: FloatArray,
        attitude: FloatArray,
        *,
        known: BoolArray,
        turning_rad_s: FloatArray,
        dt_s: float,
    ) -> None:
        """Judge a field (R, 3), seen in the body of this attitude (R, 3, 3), where ``known``; take its heading where it
        is the earth's."""
        field = rotate(attitude, field_ut)
        across = np.maximum(np.hypot(field[:, 0], field[:, 1]), 1e-9)
        dip = np.arctan2(-field[:, 2], across)
        angle = np.arctan2(field[:, 1], field[:, 0])
        expected = self._seen.h(engine.x)
        seen = expected + wrap_angle((angle - self._north_rad)[:, np.newaxis] - expected)
        variance = (self._noise_ut / across) ** 2
        by_tilt = np.tan(dip) ** 2 * _about_field(engine.P, angle)
        found = innovation(engine, self._seen, seen, np.zeros((len(angle), 1)))
        use, adopted = self._detector.step(
            np.sqrt(np.einsum("ri,ri->r", field, field)),
            dip,
            innovation=found.y[:, 0],
            expected=found.S[:, 0, 0] + by_tilt,
            sample_variance=variance,
            turning=turning_rad_s,
            fresh=known,
            dt_s=dt_s,
        )
        self._follow_dip(engine)
        if adopted.any():  # another place has another deviation
            _widen(engine, np.where(adopted, found.y[:, 0] ** 2, 0.0))
            self._detector.forget_heading(adopted)
        if use.any():
            lasting = max(1.0, 2.0 * _TILT_S / dt_s)
            engine.update(self._seen, seen, use, (variance + by_tilt * lasting)[:, np.newaxis])

    def _follow_dip(self, engine: Engine) -> None:
        """What a hidden tilt does can be told once the place's dip is known."""
        if self._hidden_tilt_rad == 0.0:
            return
        by_tilt = np.where(np.isnan(self._detector.dip), 0.0, (self._hidden_tilt_rad * np.tan(self._detector.dip)) ** 2)
        more = np.maximum(by_tilt - self._by_tilt, 0.0)
        self._by_tilt = by_tilt
        if more.any():
            _widen(engine, more)


def _about_field(P: FloatArray, angle: FloatArray) -> FloatArray:
    """Variance (R,) of the tilt about the horizontal field's axis: tan(dip) of it turns the levelled field."""
    sine, cosine = np.sin(angle), np.cos(angle)
    tilt: FloatArray = cosine**2 * P[:, T, T] + sine**2 * P[:, T + 1, T + 1] + 2.0 * sine * cosine * P[:, T, T + 1]
    return tilt


def _widen(engine: Engine, variance: FloatArray) -> None:
    P = engine.P.copy()
    P[:, D, D] += variance
    engine.restore(engine.x, P)
