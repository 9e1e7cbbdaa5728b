"""Three-axis magnetometer (kind ``magnetometer``).

Its error model is that of :mod:`twin.sensors.noise` with the parts that magnetometers have,

    m_out = Q( T S B + h + c I + n )

with B the field of the world (uT) in the nominal mount's axes; S = 1 + (symmetric) the soft iron that moves with the
machine; T scale, cross-axis sensitivity and mounting tilt; h the hard iron, constant in the machine's axes, drawn once;
c I the field of the motors' supply leads, proportional to the current I that the motors draw together; n white noise; Q
range and resolution. The paper that the machine comes from (001, section 3) has all of these but the motors.

The truth of a column is the undistorted field in the nominal mount's axes: what a perfect, calibrated unit would say.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.config import NonNegative, Positive, Vector3
from twin.sensors.base import Reading, Sensor, SensorConfig
from twin.sensors.noise import Quantiser, Streams, WhiteNoise, sensitivity_matrices
from twin.signals import Capture, FloatArray, MagneticField, MagneticNeed, Mount, Need

COLUMNS = ("mag_x_ut", "mag_y_ut", "mag_z_ut")

_UT_PER_GAUSS = 100.0
_OFF_DIAGONAL = ((0, 1), (0, 2), (1, 2))


class MagnetometerConfig(SensorConfig):
    """Every error but the noise is one standard deviation, drawn once; whatever is left out is absent."""

    kind: Literal["magnetometer"]
    noise_ut: Vector3 = (0.0, 0.0, 0.0)
    """Noise of one sample, 1 sigma of each axis."""
    hard_iron_ut: NonNegative = 0.0
    """Offset of each axis: magnets and magnetised steel on the machine, and the unit's own."""
    soft_iron_ratio: NonNegative = 0.0
    """Each element of the symmetric distortion by soft iron on the machine."""
    scale_error_ratio: NonNegative = 0.0
    misalignment_rad: NonNegative = 0.0
    """Each axis's part of each other axis."""
    mounting_tilt_rad: NonNegative = 0.0
    """Roll, pitch and yaw of the unit as mounted against its nominal mount, each."""
    motor_field_ut_a: Vector3 = (0.0, 0.0, 0.0)
    """Field of the motors' leads at the unit per ampere: a straight wire at 4 cm makes 5 uT/A."""
    range_ut: Positive | None = None
    """Largest value of each axis."""
    counts_per_gauss: Positive | None = None
    """Resolution, as data sheets give it: LSB per gauss; without it the output has all digits."""

    def need(self, mount: Mount) -> Need:
        """The field at the mount."""
        return MagneticNeed(mount=mount)

    @property
    def resolution_ut(self) -> float:
        """One count; zero without a resolution."""
        return 0.0 if self.counts_per_gauss is None else _UT_PER_GAUSS / self.counts_per_gauss


class Magnetometer(Sensor):
    """Flux density in mount axes. Hidden columns: each axis's offset now, of hard iron and motors together."""

    columns = COLUMNS
    error_columns = COLUMNS
    extra_hidden_columns = tuple(f"{column}.bias" for column in COLUMNS)

    def __init__(
        self, config: MagnetometerConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
    ) -> None:
        super().__init__(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        self._sensitivity = _sensitivity(config, self._streams)
        self._hard_iron = config.hard_iron_ut * self._streams.once("hard_iron", 3)
        self._motor_field = np.array(config.motor_field_ut_a)
        self._noise = (
            WhiteNoise(sigma=config.noise_ut, stream=self._streams.normal("noise", 3)) if any(config.noise_ut) else None
        )
        largest = np.inf if config.range_ut is None else config.range_ut
        self._converter = Quantiser(lsb=[config.resolution_ut] * 3, low=-largest, high=largest)

    def _measure(self, capture: Capture) -> Reading:
        assert isinstance(capture, MagneticField)
        offset = self._hard_iron + capture.motor_current_a * self._motor_field
        # One member after the other: its numbers must not depend on how many there are.
        values = np.stack([matrix @ capture.field_ut for matrix in self._sensitivity]) + offset
        if self._noise is not None:
            values += self._noise.step()
        return Reading(values=self._converter.apply(values), truth=capture.field_ut, hidden=offset)

    def _datasheet(self, config: SensorConfig) -> dict[str, float]:
        assert isinstance(config, MagnetometerConfig)
        sheet = {f"mag_noise_{axis}_ut": sigma for axis, sigma in zip("xyz", config.noise_ut, strict=True)}
        sheet |= {
            "mag_noise_ut": float(np.sqrt(np.mean(np.square(config.noise_ut)))),
            "hard_iron_ut": config.hard_iron_ut,
            "soft_iron_ratio": config.soft_iron_ratio,
            "scale_error_ratio": config.scale_error_ratio,
            "mounting_tilt_rad": config.mounting_tilt_rad,
            "resolution_ut": config.resolution_ut,
        }
        return sheet if config.range_ut is None else {**sheet, "range_ut": config.range_ut}

    def _error_sigma(self, config: SensorConfig) -> FloatArray:
        assert isinstance(config, MagnetometerConfig)
        return np.array(config.noise_ut)


def _sensitivity(config: MagnetometerConfig, streams: Streams) -> FloatArray:
    """T S of each run, (R, 3, 3)."""
    device = sensitivity_matrices(
        scale=config.scale_error_ratio * streams.once("scale", 3),
        misalignment=config.misalignment_rad * streams.once("misalignment", 6),
        tilt_rpy_rad=config.mounting_tilt_rad * streams.once("mounting_tilt", 3),
    )
    drawn = config.soft_iron_ratio * streams.once("soft_iron", 6)
    soft = np.zeros_like(device)
    soft[:, range(3), range(3)] = 1.0 + drawn[:, :3]
    for index, (row, column) in enumerate(_OFF_DIAGONAL):
        soft[:, row, column] = soft[:, column, row] = drawn[:, 3 + index]
    product: FloatArray = np.stack([a @ b for a, b in zip(device, soft, strict=True)])
    return product
