"""Sensors: truth in, measurements with noise, rate, delay and faults out.

``SensorConfigUnion`` is every kind's configuration, told apart by ``kind``; :func:`build_sensor` makes the sensor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, assert_never

from pydantic import Field

from twin.sensors.accosat import AccoSat, AccoSatConfig
from twin.sensors.ahrs import Ahrs, AhrsConfig
from twin.sensors.angle_transducer import AngleTransducer, AngleTransducerConfig
from twin.sensors.base import Sample, Sensor, SensorConfig
from twin.sensors.camera import Camera, CameraConfig
from twin.sensors.displacement_transducer import DisplacementTransducer, DisplacementTransducerConfig
from twin.sensors.gnss import Gnss
from twin.sensors.gnss_config import GnssConfig
from twin.sensors.imu import Imu, ImuConfig
from twin.sensors.laser_receiver import LaserReceiver, LaserReceiverConfig
from twin.sensors.lidar import Lidar, LidarConfig
from twin.sensors.magnetometer import Magnetometer, MagnetometerConfig
from twin.sensors.radar import Radar, RadarConfig
from twin.sensors.triggers import schedule_of
from twin.sensors.wheel_encoders import WheelEncoders, WheelEncodersConfig
from twin.sensors.yaw_gyro import YawGyro, YawGyroConfig
from twin.signals import Mount

__all__ = [
    "Sample",
    "Sensor",
    "SensorConfig",
    "SensorConfigUnion",
    "build_sensor",
]

AnySensorConfig = (
    ImuConfig
    | RadarConfig
    | AccoSatConfig
    | GnssConfig
    | WheelEncodersConfig
    | MagnetometerConfig
    | LidarConfig
    | CameraConfig
    | AhrsConfig
    | LaserReceiverConfig
    | DisplacementTransducerConfig
    | YawGyroConfig
    | AngleTransducerConfig
)
SensorConfigUnion = Annotated[AnySensorConfig, Field(discriminator="kind")]


def build_sensor(
    config: AnySensorConfig,
    *,
    name: str,
    mount: Mount,
    dt_ns: int,
    seed: int,
    runs: Sequence[int],
    among: Mapping[str, SensorConfig] | None = None,
) -> Sensor:
    """Make the sensor of this configuration, for the given runs of one world.

    ``among`` has all sensors of the machine, this one included; without it there are no others that could trigger it.

    Raises:
        BadInputError: the rate does not divide the physics rate, a fault names an unknown column, or what triggers the
            sensor does not exist, has another rate or is triggered by it.
    """
    sensor = _build(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
    if config.triggered_by is not None:
        sensor.follow(schedule_of(name, {name: config} if among is None else among, dt_ns=dt_ns, seed=seed))
    return sensor


def _build(  # noqa: C901, PLR0911, PLR0912  (one for each kind)
    config: AnySensorConfig, *, name: str, mount: Mount, dt_ns: int, seed: int, runs: Sequence[int]
) -> Sensor:
    match config:
        case ImuConfig():
            return Imu(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case RadarConfig():
            return Radar(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case AccoSatConfig():
            return AccoSat(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case GnssConfig():
            return Gnss(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case WheelEncodersConfig():
            return WheelEncoders(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case MagnetometerConfig():
            return Magnetometer(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case LidarConfig():
            return Lidar(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case CameraConfig():
            return Camera(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case AhrsConfig():
            return Ahrs(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case LaserReceiverConfig():
            return LaserReceiver(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case DisplacementTransducerConfig():
            return DisplacementTransducer(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case YawGyroConfig():
            return YawGyro(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case AngleTransducerConfig():
            return AngleTransducer(config, name=name, mount=mount, dt_ns=dt_ns, seed=seed, runs=runs)
        case _:
            assert_never(config)
