"""A small robot's sensors for tests, without a world: setups, and measurements of given motion in a given field."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.signals import NS_PER_S, EstimatorSetup, FloatArray, Measurement, Mount, SensorInfo

G = 9.80665
IMU_COLUMNS = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2", "gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
FIELD_COLUMNS = ("mag_x_ut", "mag_y_ut", "mag_z_ut")
SLOT_COLUMNS = ("left_slots", "right_slots")
COLUMNS = {"imu": IMU_COLUMNS, "magnetometer": FIELD_COLUMNS, "wheel_encoders": SLOT_COLUMNS}
STRENGTH_UT, DIP_RAD = 48.0, np.deg2rad(65.0)
SLOT_M = 2.0 * np.pi * 0.033 / 20.0
TRACK_M = 0.105


def make_setup(
    *kinds: str, runs: int = 1, rate_hz: float = 50.0, heading: float = 0.0, datasheet: dict[str, float] | None = None
) -> EstimatorSetup:
    infos = {
        kind: SensorInfo(
            name=kind,
            kind=kind,
            columns=COLUMNS[kind],
            mount=Mount(body="base", xyz_m=(0.0, 0.0, 0.05)),
            rate_hz=rate_hz,
            datasheet={"slots_per_turn": 20.0} if kind == "wheel_encoders" else (datasheet or {}),
        )
        for kind in kinds
    }
    return EstimatorSetup(
        name="heading",
        runs=runs,
        sensors=infos,
        reference=Mount(body="base", xyz_m=(0.0, 0.0, 0.0)),
        rows_y_m=(),
        start_e_n_heading=(0.0, 0.0, heading),
    )


def measure(kind: str, t_ns: int, values: FloatArray, valid: FloatArray | None = None) -> Measurement:
    values = np.atleast_2d(np.asarray(values, dtype=float))
    return Measurement(
        sensor=kind,
        t_ns=t_ns,
        t_available_ns=t_ns,
        columns=COLUMNS[kind],
        values=values,
        valid=np.ones(len(values), dtype=bool) if valid is None else np.asarray(valid),
    )


def field_at(heading: FloatArray, *, deviation: FloatArray | float = 0.0, strength: FloatArray | float = STRENGTH_UT):
    """Field (..., 3) that a level body sees; ``deviation`` turns it counter-clockwise from north."""
    angle = np.pi / 2 + deviation - np.asarray(heading)
    across, down = strength * np.cos(DIP_RAD), strength * np.sin(DIP_RAD)
    return np.stack(np.broadcast_arrays(across * np.cos(angle), across * np.sin(angle), -down), axis=-1)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Level motion (T,) at a rate, and what the sensors get wrong of it; (R,) or a number per error."""

    yaw_rate: FloatArray
    speed: FloatArray | None = None
    rate_hz: float = 50.0
    heading: float = 0.0
    runs: int = 1
    seed: int = 0
    gyro_bias: FloatArray | float = 0.0
    gyro_noise: float = 0.0
    accel_noise: float = 0.0
    field_noise: float = 0.0
    deviation: FloatArray | float = 0.0
    """(T,) or (T, R): turns the horizontal field."""
    strength: FloatArray | float = STRENGTH_UT
    slip: FloatArray | None = None
    """(T, 2) way that the wheels turn beyond what they roll, m, each step."""
    kinds: tuple[str, ...] = ("imu", "magnetometer", "wheel_encoders")

    @property
    def dt_ns(self) -> int:
        return round(NS_PER_S / self.rate_hz)

    @property
    def headings(self) -> FloatArray:
        """True heading (T,) after each step, not wrapped."""
        return self.heading + np.cumsum(self.yaw_rate) * self.dt_ns / NS_PER_S

    def setup(self, **changes: object) -> EstimatorSetup:
        keys = {"runs": self.runs, "rate_hz": self.rate_hz, "heading": self.heading}
        return make_setup(*self.kinds, **(keys | changes))  # type: ignore[arg-type]

    def ticks(self) -> Iterator[tuple[int, list[Measurement]]]:
        """Time and measurements of each step."""
        rng = np.random.default_rng(self.seed)
        steps, runs, dt = len(self.yaw_rate), self.runs, self.dt_ns / NS_PER_S
        heading = self.headings
        speed = np.zeros(steps) if self.speed is None else self.speed
        deviation, strength = (_per_step(each, steps, runs) for each in (self.deviation, self.strength))
        ways = np.stack([speed - 0.5 * TRACK_M * self.yaw_rate, speed + 0.5 * TRACK_M * self.yaw_rate], axis=-1) * dt
        if self.slip is not None:
            ways = ways + self.slip
        slots = np.floor(np.cumsum(ways, axis=0) / SLOT_M + 0.5)
        for k in range(steps):
            t_ns = (k + 1) * self.dt_ns
            imu = np.zeros((runs, 6))
            surge = (speed[k] - (speed[k - 1] if k else 0.0)) / dt
            imu[:, :3] = [surge, speed[k] * self.yaw_rate[k], G]
            imu[:, 3:] = np.reshape(self.gyro_bias, (-1, 1))
            imu[:, 5] += self.yaw_rate[k]
            noise = rng.normal(size=(runs, 9))
            imu[:, :3] += self.accel_noise * noise[:, :3]
            imu[:, 3:] += self.gyro_noise * noise[:, 3:6]
            seen = field_at(heading[k], deviation=deviation[k], strength=strength[k])
            values = {
                "imu": imu,
                "magnetometer": seen + self.field_noise * noise[:, 6:],
                "wheel_encoders": np.tile(slots[k], (runs, 1)),
            }
            yield t_ns, [measure(kind, t_ns, values[kind]) for kind in self.kinds]


def _per_step(values: FloatArray | float, steps: int, runs: int) -> FloatArray:
    array = np.asarray(values, dtype=float)
    return np.broadcast_to(array[:, np.newaxis] if array.ndim == 1 else array, (steps, runs))


def run(estimator, drive: Drive, *columns: str) -> FloatArray:
    """Columns (T, R, n) (or (T, R) of one) that the estimator gives after each step; sigmas as ``column.sigma``."""
    rows = []
    for t_ns, measurements in drive.ticks():
        for measurement in measurements:
            estimator.process(measurement)
        estimate = estimator.estimate(t_ns)
        row = []
        for column in columns:
            name, _, sigma = column.partition(".")
            row.append((estimate.sigmas if sigma else estimate.values)[:, estimator.columns.index(name)])
        rows.append(np.stack(row, axis=-1))
    found = np.array(rows)
    return found[..., 0] if len(columns) == 1 else found
