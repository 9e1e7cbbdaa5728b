"""From data sheets and configuration to the parts of the strapdown filter (kind ``row_speed_ins``)."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from twin.config import Config, Names, NonNegative, Positive
from twin.estimators.inertial_array import InertialArray
from twin.estimators.ins_aiding import Aid, PulseAid, ReceiverAid, ReceiverTrust, pulse_model, pulse_observation
from twin.estimators.ins_model import (
    BA,
    BG,
    CORE_STATES,
    PITCH,
    ROLL,
    SLIP,
    VX,
    VZ,
    YAW,
    E,
    K,
    N,
    ProcessNoise,
    PulseSensorModel,
    ReceiverModel,
    Strapdown,
    size_of,
)
from twin.estimators.roles import ACCOSAT, GNSS, IMU, RADAR, mount_arm
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import EstimatorSetup, FloatArray, SensorInfo


class InsStartConfig(Config):
    """How well the state is known at the start (1 sigma); biases and scale errors are as the data sheets say."""

    position_m: NonNegative = 0.1
    heading_rad: NonNegative = 0.02
    tilt_rad: Positive = 0.1
    speed_m_s: Positive = 0.1


class WheelsConfig(Config):
    """What the machine's wheels say."""

    axle_forward_m: float = 0.0
    """Where the axle that does not slip sideways lies, before the reference point (negative: behind)."""
    axle_up_m: float = 0.0
    """Its contact with the ground, above the reference point (negative: below)."""
    sideslip_m_s: Positive = 0.02
    """Lateral speed of the axle, slowly changing: tyres run at slip angles of half a degree in turns."""
    sideslip_correlation_s: Positive = 5.0
    lateral_m_s: Positive = 0.05
    """The same, new in every sample."""
    vertical_m_s: Positive = 0.1
    """Vertical speed of the axle, new in every sample: rough ground."""


class GatingConfig(Config):
    """How outliers and faults are told."""

    enabled: bool = True
    """Without it every sample is used as it comes, a sensor without pulses says zero, and stamps are believed."""
    sigmas: Positive = 5.0
    """An innovation beyond so many standard deviations is refused."""
    reacquire_s: Positive = 5.0
    """After so long a refusal a sensor is believed to be right after all, if nothing speaks against it."""
    watch_units: bool = True
    """Whether inertial units are judged against one another."""


class InsNoiseConfig(Config):
    """What data sheets do not say; densities per root Hz."""

    accel_extra_m_s2_rthz: NonNegative = 0.005
    """Acceleration the model does not know: scale errors under vibration, first-order integration."""
    rate_extra_rad_s_rthz: NonNegative = 2e-5
    gyro_cross_axis_ratio: NonNegative = 0.01
    """Share of the yaw rate in the other gyroscopes of a unit."""
    accel_cross_axis_ratio: NonNegative = 0.01
    """Share of gravity in the other accelerometers of a unit."""
    response_1_rts: NonNegative = 1e-6
    scale_1_rts: NonNegative = 1e-4
    """Wandering of a pulse sensor's scale: pitch of the frame, crop, mud."""
    pulse_scale_ratio: NonNegative = 0.005
    """Scale error of a radar at the start: calibrated over some hundred metres, half a per cent."""
    accosat_correlation_s: Positive = 3.0
    """1/e time of an AccoSat's error: somewhat more than its own fusion's time constant."""
    yaw_rate_extra_rad_s: NonNegative = 5e-4
    """What the yaw rate changes within half a sample: the output is about the instant, gyroscopes about the mean."""


class RowSpeedInsConfig(Config):
    """Options of :class:`RowSpeedIns`."""

    kind: Literal["row_speed_ins"]
    sensors: Names
    """Names of the inertial units (at least one) and of the radars, AccoSats and GNSS receivers it listens to."""
    rate_hz: Positive = 50.0
    """Output rate."""
    engine: Literal["auto", "filterpy", "ensemble"] = "auto"
    """Kalman engine; auto: filterpy for a single run."""
    max_age_s: Positive = 1.0
    """Samples older than this on arrival are dropped."""
    wheels: WheelsConfig = WheelsConfig()
    gnss: ReceiverTrust = ReceiverTrust()
    gating: GatingConfig = GatingConfig()
    noise: InsNoiseConfig = InsNoiseConfig()
    start: InsStartConfig = InsStartConfig()
    standstill: bool = True
    """Whether standstill is recognised."""
    scale_states: bool = True
    """Whether scale errors of gyroscopes and pulse sensors are estimated, or taken to be none."""
    hindsight: bool = False
    """Say what a smoother would have known (after the run) instead of what the filter knew. A reference, not a
    filter."""


def inertial_array(
    config: RowSpeedInsConfig, units: list[SensorInfo], setup: EstimatorSetup, step_s: float
) -> InertialArray:
    """The units as one, by their data sheets."""
    cross = config.noise.gyro_cross_axis_ratio
    return InertialArray(
        arms_m=np.array([mount_arm(info, setup) for info in units]),
        accel_noise=[info.datasheet.get("accel_noise_m_s2", 0.2) for info in units],
        gyro_noise=[info.datasheet.get("gyro_noise_rad_s", 1e-3) for info in units],
        gyro_response=[float(np.hypot(info.datasheet.get("gyro_scale_error_ratio", 0.0), cross)) for info in units],
        step_s=step_s,
        runs=setup.runs,
        watch=config.gating.watch_units,
    )


def model_and_aids(
    config: RowSpeedInsConfig, sensors: dict[str, list[SensorInfo]], setup: EstimatorSetup
) -> tuple[Strapdown, dict[str, Aid]]:
    """The motion model with its sensors' states, and the aids by sensor name.

    Raises:
        BadInputError: a sensor sits on another body or lacks a column.
    """
    pulses, receivers = [*sensors[RADAR], *sensors[ACCOSAT]], sensors[GNSS]
    size = size_of(len(pulses), len(receivers))
    models: list[PulseSensorModel] = []
    aids: dict[str, Aid] = {}
    at = CORE_STATES
    for info in pulses:
        model = replace(pulse_model(info, setup, accosat_correlation_s=config.noise.accosat_correlation_s), at=at)
        at += 2
        seen = pulse_observation(model, size=size)
        models.append(model)
        aids[info.name] = PulseAid(info, model, seen, setup, zero_is_speed=not config.gating.enabled)
    antennas: list[ReceiverModel] = []
    tilt = _mean_of_units(sensors[IMU], "mounting_tilt_rad")
    for info in receivers:
        antenna = ReceiverModel(
            name=info.name,
            arm_m=mount_arm(info, setup),
            velocity_lag_s=info.datasheet.get("velocity_lag_s", 0.0),
            correlation_s=config.gnss.correlation_s,
            at=at,
        )
        at += 4
        antennas.append(antenna)
        aids[info.name] = ReceiverAid(
            info, antenna, config.gnss, setup, size=size, robust=config.gating.enabled, mounting_tilt_rad=tilt
        )
    noise = _process_noise(config, sensors[IMU])
    return Strapdown(pulse_sensors=models, receivers=antennas, noise=noise, runs=setup.runs), aids


def _mean_of_units(units: list[SensorInfo], key: str) -> float:
    """Standard deviation of the mean over the units of independent errors of this data-sheet size."""
    sizes = np.array([info.datasheet.get(key, 0.0) for info in units])
    return float(np.sqrt(np.square(sizes).sum()) / len(units))


def _wander(units: list[SensorInfo], triad: str, unit: str) -> float:
    """Density of the random walk of the mean bias: that of the bias's random walk, and of its Gauss-Markov part."""
    total = 0.0
    for info in units:
        sigma = info.datasheet.get(f"{triad}_bias_instability_{unit}", 0.0)
        tau_s = info.datasheet.get(f"{triad}_bias_correlation_s", 100.0)
        total += 2.0 * sigma**2 / tau_s + info.datasheet.get(f"{triad}_bias_random_walk_{unit}_rts", 0.0) ** 2
    return float(np.sqrt(total)) / len(units)


def _process_noise(config: RowSpeedInsConfig, units: list[SensorInfo]) -> ProcessNoise:
    noise, wheels = config.noise, config.wheels
    return ProcessNoise(
        accel_bias=_wander(units, "accel", "m_s2"),
        gyro_bias=_wander(units, "gyro", "rad_s"),
        accel_extra=noise.accel_extra_m_s2_rthz,
        rate_extra=noise.rate_extra_rad_s_rthz,
        response=noise.response_1_rts if config.scale_states else 0.0,
        sideslip_m_s=wheels.sideslip_m_s,
        sideslip_correlation_s=wheels.sideslip_correlation_s,
        scale=noise.scale_1_rts if config.scale_states else 0.0,
    )


def start(
    config: RowSpeedInsConfig, units: list[SensorInfo], model: Strapdown, setup: EstimatorSetup
) -> tuple[FloatArray, FloatArray]:
    """State (R, n) and covariance (R, n, n) at the start."""
    east, north, heading = setup.start_e_n_heading
    x, sigma = np.zeros(model.size), np.zeros(model.size)
    x[E], x[N], x[YAW] = east, north, heading
    begin, noise, count = config.start, config.noise, float(np.sqrt(len(units)))
    sigma[E] = sigma[N] = begin.position_m
    sigma[VX : VZ + 1] = begin.speed_m_s
    sigma[ROLL] = sigma[PITCH] = begin.tilt_rad
    sigma[YAW] = begin.heading_rad
    gravity = noise.accel_cross_axis_ratio * STANDARD_GRAVITY_M_S2 / count
    sigma[BA : BA + 3] = float(np.hypot(_mean_of_units(units, "accel_bias_m_s2"), gravity))
    sigma[BG : BG + 3] = max(_mean_of_units(units, "gyro_bias_rad_s"), 1e-4)
    tilt = _mean_of_units(units, "mounting_tilt_rad")
    sigma[K : K + 2] = float(np.hypot(noise.gyro_cross_axis_ratio / count, tilt))
    sigma[K + 2] = max(_mean_of_units(units, "gyro_scale_error_ratio"), 1e-4)
    sigma[SLIP] = config.wheels.sideslip_m_s
    for sensor in model.pulse_sensors:
        sigma[sensor.at] = begin.speed_m_s
        sigma[sensor.at + 1] = noise.pulse_scale_ratio if sensor.slow_error is None else sensor.slow_error[0]
    for receiver in model.receivers:
        sigma[receiver.at : receiver.at + 2] = begin.speed_m_s
        sigma[receiver.at + 2 : receiver.at + 4] = config.gnss.single_m
    if not config.scale_states:
        sigma[K : K + 3] = 0.0
        sigma[[sensor.at + 1 for sensor in model.pulse_sensors if sensor.slow_error is None]] = 0.0
    P = np.diag(np.square(sigma))
    return np.repeat(x[np.newaxis], setup.runs, axis=0), np.repeat(P[np.newaxis], setup.runs, axis=0)
