"""A planter's sensors for tests, without a world: setups, measurements and synthetic motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.signals import EstimatorSetup, FloatArray, Measurement, Mount, SensorInfo

G = 9.80665
STEP_NS = 20_000_000
STEP_S = 0.02
ROWS_Y = tuple(0.75 * (3.5 - row) for row in range(8))
IMU_ROWS = (1, 4, 5, 8)
IMUS = tuple(f"imu_{row}" for row in IMU_ROWS)
IMU_COLUMNS = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2", "gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
GNSS_COLUMNS = ("position_e_m", "position_n_m", "position_u_m", "speed_m_s", "course_rad")
REPORTS = ("sigma_e_m", "sigma_n_m", "sigma_u_m", "quality", "satellites", "hdop", "vdop", "age_s")


def imu_info(name: str, xyz_m: tuple[float, float, float], **changes: object) -> SensorInfo:
    keys = {"name": name, "kind": "imu", "columns": IMU_COLUMNS, "mount": Mount(body="planter", xyz_m=xyz_m)}
    return SensorInfo(**{"rate_hz": 50.0, **keys, **changes})  # type: ignore[arg-type]


def sensors(*, radar: bool = True, gnss: bool = False, radar_y: float = 0.0, gnss_xy: Sequence[float] = (0.4, 0.3)):
    infos = [imu_info(name, (0.0, ROWS_Y[row - 1], 0.5)) for name, row in zip(IMUS, IMU_ROWS, strict=True)]
    if radar:
        mount = Mount(body="planter", xyz_m=(0.2, radar_y, 0.6))
        infos.append(SensorInfo(name="radar", kind="radar", columns=("speed_m_s",), mount=mount, rate_hz=50.0))
    if gnss:
        mount = Mount(body="planter", xyz_m=(gnss_xy[0], gnss_xy[1], 2.0))
        infos.append(SensorInfo(name="gnss", kind="gnss", columns=GNSS_COLUMNS, mount=mount, rate_hz=10.0))
    return {info.name: info for info in infos}


def receiver(name: str, *, position_noise_m: float | None = 0.01, **changes: object) -> SensorInfo:
    """A GNSS receiver of 10 Hz above the reference that reports sigmas and quality."""
    sheet = {} if position_noise_m is None else {"position_noise_m": position_noise_m}
    keys = {"kind": "gnss", "columns": GNSS_COLUMNS + REPORTS, "mount": Mount(body="planter", xyz_m=(0.0, 0.0, 2.0))}
    return SensorInfo(**{"name": name, "rate_hz": 10.0, "datasheet": sheet, **keys, **changes})  # type: ignore[arg-type]


def accosat_info() -> SensorInfo:
    mount = Mount(body="planter", xyz_m=(0.2, 0.0, 0.6))
    return SensorInfo(name="accosat", kind="accosat", columns=("speed_m_s", "pulses"), mount=mount, rate_hz=25.0)


def make_setup(
    infos: dict[str, SensorInfo] | None = None,
    *,
    runs: int = 1,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> EstimatorSetup:
    return EstimatorSetup(
        name="central",
        runs=runs,
        sensors=sensors() if infos is None else infos,
        reference=Mount(body="planter", xyz_m=(0.0, 0.0, 0.0)),
        rows_y_m=ROWS_Y,
        start_e_n_heading=start,
    )


def measurement(
    sensor: str, t_ns: int, values: FloatArray, *, columns: tuple[str, ...], valid=None, t_available_ns=None
) -> Measurement:
    values = np.atleast_2d(np.asarray(values, dtype=float))
    return Measurement(
        sensor=sensor,
        t_ns=t_ns,
        t_available_ns=t_ns if t_available_ns is None else t_available_ns,
        columns=columns,
        values=values,
        valid=np.ones(len(values), dtype=bool) if valid is None else np.asarray(valid),
    )


def imu(sensor: str, t_ns: int, accel_x, yaw_rate, *, accel_z=G, accel_y=0.0, **more) -> Measurement:
    parts = np.broadcast_arrays(*np.atleast_1d(accel_x, accel_y, accel_z, 0.0, 0.0, yaw_rate))
    return measurement(sensor, t_ns, np.stack(parts, axis=-1), columns=IMU_COLUMNS, **more)


def radar(t_ns: int, speed, **more) -> Measurement:
    return measurement("radar", t_ns, np.atleast_1d(speed)[:, np.newaxis], columns=("speed_m_s",), **more)


def gnss(t_ns: int, east, north, speed, **more) -> Measurement:
    parts = np.broadcast_arrays(*np.atleast_1d(east, north, 0.0, speed, 0.0))
    return measurement("gnss", t_ns, np.stack(parts, axis=-1), columns=GNSS_COLUMNS, **more)


def accosat(t_ns: int, speed: float, **more) -> Measurement:
    return measurement("accosat", t_ns, np.array([[speed, 0.0]]), columns=("speed_m_s", "pulses"), **more)


def report(
    sensor: str, t_ns: int, east, north, speed, *, sigma_m: object = 0.01, quality: object = 4, **more
) -> Measurement:
    """What a receiver sends, quality and sigmas included; anything may be an array over the runs."""
    parts = np.broadcast_arrays(
        *np.atleast_1d(east, north, 0.0, speed, 0.0, sigma_m, sigma_m, 0.02, quality, 20.0, 0.7, 1.2, 1.0)
    )
    values = np.stack([part.astype(float) for part in parts], axis=-1)
    return measurement(sensor, t_ns, values, columns=GNSS_COLUMNS + REPORTS, **more)


def motion(speed: FloatArray, yaw_rate: FloatArray, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FloatArray:
    """Pose [east, north, heading] (T, 3) at the ticks of given speed and yaw rate (T,), exact within each tick."""
    heading = start[2] + np.cumsum(yaw_rate) * STEP_S
    middle = heading - 0.5 * yaw_rate * STEP_S
    chord = speed * STEP_S * np.sinc(yaw_rate * STEP_S / 2.0 / np.pi)
    east, north = start[0] + np.cumsum(chord * np.cos(middle)), start[1] + np.cumsum(chord * np.sin(middle))
    return np.stack([east, north, heading], axis=-1)


def stream(
    speed: FloatArray,
    yaw_rate: FloatArray,
    *,
    runs: int = 1,
    accel_sigma: float = 0.0,
    gyro_sigma: float = 0.0,
    radar_sigma: float = 0.0,
    shaking: FloatArray | None = None,
    tilt_m_s2: FloatArray | None = None,
    seed: int = 0,
) -> list[list[Measurement]]:
    """What four units and a radar in the middle give, tick by tick, over given speed and yaw rate (T,).

    ``shaking`` (T,) is the rms of a vertical acceleration common to all units, ``tilt_m_s2`` (T,) what gravity adds to
    their longitudinal axis.
    """
    rng = np.random.default_rng(seed)
    shaking = np.zeros(len(speed)) if shaking is None else shaking
    tilt_m_s2 = np.zeros(len(speed)) if tilt_m_s2 is None else tilt_m_s2
    before_speed, before_rate, ticks = 0.0, 0.0, []
    for k in range(len(speed)):
        t_ns = (k + 1) * STEP_NS
        surge, swing = (speed[k] - before_speed) / STEP_S, (yaw_rate[k] - before_rate) / STEP_S
        before_speed, before_rate = speed[k], yaw_rate[k]
        heave = shaking[k] * rng.normal(size=runs)
        tick = []
        for name, row in zip(IMUS, IMU_ROWS, strict=True):
            noise = rng.normal(size=(4, runs))
            accel = accel_sigma * noise[:3]
            tick.append(
                imu(
                    name,
                    t_ns,
                    surge - swing * ROWS_Y[row - 1] + tilt_m_s2[k] + accel[0],
                    yaw_rate[k] + gyro_sigma * noise[3],
                    accel_y=accel[1],
                    accel_z=G + heave + accel[2],
                )
            )
        tick.append(radar(t_ns, speed[k] + radar_sigma * rng.normal(size=runs) * (speed[k] > 0.13)))
        ticks.append(tick)
    return ticks


def profile(*segments: tuple[float, float, float]) -> tuple[FloatArray, FloatArray]:
    """Speed and yaw rate (T,) of segments (seconds, speed at the end, yaw rate), speed linear within each."""
    speeds, rates, last = [], [], 0.0
    for seconds, speed, rate in segments:
        count = round(seconds / STEP_S)
        speeds.append(last + (speed - last) * np.arange(1, count + 1) / count)
        rates.append(np.full(count, rate))
        last = speed
    return np.concatenate(speeds), np.concatenate(rates)
