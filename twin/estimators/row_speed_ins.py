"""Row speeds by strapdown inertial navigation of the implement (kind ``row_speed_ins``).

What the coordinated-turn filter of paper 000 cannot do, and its section 5.2 asks for. One error-consistent Kalman filter
of the implement as a rigid body in space (:mod:`twin.estimators.ins_model`): roll and pitch are states, so gravity in
the longitudinal axis is not taken for acceleration; the inertial biases are states, so no calibration run is needed;
the radar's lag, and the pitching and heaving in it, are modelled; GNSS counts by its fix state and the age of its
corrections, at the time it is about (:mod:`twin.estimators.ins_aiding`). Any number of inertial units, any subset of
radars, AccoSats and GNSS receivers. Several inertial units become one, weighted by how they behave
(:mod:`twin.estimators.inertial_array`); outliers are gated by their innovation; standstill is told from several cues
(:mod:`twin.estimators.standing_cues`). The machine's own knowledge: wheels roll where they point
(:class:`~twin.estimators.ins_observations.NoSlip`), at the axle, whose place before the row line is configured.

The order of a step: fuse the units of the tick, predict, then no-slip, standstill, aids in the order of arrival; samples
that come late are put where they belong (:mod:`twin.estimators.ins_filter`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from twin.config import Config, Names, NonNegative, Positive
from twin.errors import BadInputError
from twin.estimators.engines import EngineName, make_engine
from twin.estimators.inertial_array import Fused, InertialArray
from twin.estimators.ins_aiding import Aid, PulseAid, ReceiverAid, ReceiverTrust, pulse_model, pulse_observation
from twin.estimators.ins_filter import Epoch, GateConfig, StrapdownFilter
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
    horizontal,
    size_of,
)
from twin.estimators.ins_observations import NoSlip, Standing
from twin.estimators.planter_output import STATE_COLUMNS, PlanterOutput
from twin.estimators.roles import ACCOSAT, GNSS, IMU, RADAR, InertialUnit, common_rate, mount_arm, pick_sensors
from twin.estimators.standing_cues import StandingCues
from twin.estimators.ticks import Tick, TickClock
from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import NS_PER_S, BoolArray, Estimate, EstimatorSetup, FloatArray, Measurement, SensorInfo

KIND = "row_speed_ins"
_LAG_SWITCH_M_S = 0.05
_HISTORY_S = 0.6
_PULSE_PATIENCE_S = 0.1
_FIX_PATIENCE_S = 0.5
_OWN_SLOW_M_S = 0.3
_STANDING_M_S = 0.01
"""How well a standing machine stands: standstill is told again at every step."""


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
    sideslip_correlation_s: Positive = 2.0
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
    pulse_scale_ratio: NonNegative = 0.01
    """Scale error of a pulse sensor at the start."""
    accosat_correlation_s: Positive = 2.0
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


class RowSpeedIns:
    """Estimator of :class:`RowSpeedInsConfig`; columns as in :mod:`twin.estimators.planter_output`.

    Raises:
        BadInputError: no inertial unit, a sensor of a kind or on a body the filter cannot use, inertial units with
            different rates, or the filterpy engine with more than one run.
    """

    def __init__(self, config: RowSpeedInsConfig, setup: EstimatorSetup) -> None:
        sensors = pick_sensors(setup, (IMU, RADAR, ACCOSAT, GNSS), estimator=KIND)
        if config.engine == "filterpy" and setup.runs > 1:
            raise BadInputError(
                f"[estimators.{setup.name}] engine = 'filterpy': steps one run, not {setup.runs};"
                " allowed: auto, ensemble"
            )
        units = sensors[IMU]
        rate_hz = common_rate(units, setup, estimator=KIND)
        self._config, self._setup = config, setup
        self._clock = TickClock(rate_hz=rate_hz, max_age_s=config.max_age_s, inertial=[info.name for info in units])
        self._step_ns = self._clock.step_ns
        self._step_s = self._step_ns / NS_PER_S
        self._units = {info.name: (place, InertialUnit.of(info, setup)) for place, info in enumerate(units)}
        self._array = _array(config, units, setup, self._step_s)
        self._cues = StandingCues(step_s=self._step_s, runs=setup.runs)
        self.model, self._aids = _model_and_aids(config, sensors, setup)
        self.filter = self._make_filter(units)
        self._gyro_variance: FloatArray = np.full(setup.runs, 1e-6)
        self._u: FloatArray = np.zeros((setup.runs, 6))
        self._standing: BoolArray = np.zeros(setup.runs, dtype=np.bool_)
        self._now: int | None = None
        self._output = PlanterOutput(
            rows_y_m=setup.rows_y_m,
            origins_left_m=[0.0],
            innovations=self._innovations(),
        )
        self.columns = self._output.columns
        self.state_columns: tuple[str, ...] = STATE_COLUMNS

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        tick = self._clock.add(measurement)
        if tick is not None:
            self._step(tick)

    def _step(self, tick: Tick) -> None:
        """Advance to a tick, then put every aid of the group where it belongs."""
        aids = [(self._aids[m.sensor], m) for m, _ in tick.samples if m.sensor in self._aids]
        self._hear_speeds(tick.index, aids)
        if tick.steps:
            fused = self._fuse(tick)
            self._u, self._gyro_variance = fused.u, fused.gyro_variance
            if self._config.standstill:
                self._cues.inertial(fused)
                own_slow = np.abs(self.filter.engine.x[:, VX]) <= _OWN_SLOW_M_S
                self._standing = self._cues.standing(tick.index, fused, own_slow)
            self.filter.step(
                Epoch(index=tick.index, dt_s=tick.steps * self._step_s, inertial=fused, standing=self._standing)
            )
        self._now = tick.index
        speed = np.abs(self.filter.engine.x[:, VX])
        for aid, measurement in aids:
            if isinstance(aid, PulseAid):
                self.filter.add(self._index(measurement.t_ns), aid.read(measurement))
            else:
                self.filter.add(self._index(aid.time_ns(measurement)[0]), aid.read(measurement, speed))

    def _index(self, t_ns: int) -> int:
        return (t_ns + self._step_ns // 2) // self._step_ns

    def _hear_speeds(self, index: int, aids: list[tuple[Aid, Measurement]]) -> None:
        for aid, measurement in aids:
            slow, known = aid.slow(measurement)
            patience = (_PULSE_PATIENCE_S if isinstance(aid, PulseAid) else _FIX_PATIENCE_S) / self._step_s
            self._cues.speed(measurement.sensor, index, patience, slow=slow, known=known)

    def _fuse(self, tick: Tick) -> Fused:
        """One inertial sample of what the units said at this very tick."""
        runs, count = self._setup.runs, len(self._units)
        readings, present = np.zeros((count, runs, 6)), np.zeros((count, runs), dtype=np.bool_)
        for measurement, fresh in tick.samples:
            entry = self._units.get(measurement.sensor)
            if entry is not None and fresh:
                place, unit = entry
                values = unit.read(measurement)
                readings[place], present[place] = values, measurement.valid & np.isfinite(values).all(axis=1)
        return self._array.fuse(readings, present)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return the estimate at ``t_ns``, after all that arrived until then.

        Between ticks, and where no inertial sample came, the motion goes on as at the last one.
        """
        tick = self._clock.close()
        if tick is not None:
            self._step(tick)
        x, P = self.filter.engine.x, self.filter.engine.P
        if self._now is not None and t_ns > self._now * self._step_ns:
            dt_s = (t_ns - self._now * self._step_ns) / NS_PER_S
            x, F = self.model.linearise(x, self._u, dt_s)
            P = F @ P @ F.transpose(0, 2, 1) + self.model.Q(dt_s)
        return self.report(t_ns, x, P)

    def report(self, t_ns: int, x: FloatArray, P: FloatArray) -> Estimate:
        """Estimate from a state (R, n) and covariance (R, n, n)."""
        planar, J = self._planar(x)
        covariance = J @ P @ J.transpose(0, 2, 1)
        covariance[:, 4, 4] += self._gyro_variance + self._config.noise.yaw_rate_extra_rad_s**2
        nis = np.full((len(self._innovations()), len(x)), np.nan)
        for place, name in enumerate(self._innovations()):
            found = self.filter.nis.pop(name, None)
            if found is not None:
                nis[place] = found
        return self._output.estimate(t_ns, [(planar, covariance)], standing=[self._standing], nis=[nis])

    def _planar(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """East, north, forward speed, heading, yaw rate (R, 5), and their derivatives by the state (R, 5, n)."""
        J = np.zeros((len(x), 5, self.model.size))
        J[:, 0, E] = J[:, 1, N] = J[:, 3, YAW] = 1.0
        level = x[:, ROLL : YAW + 1].copy()
        level[:, 2] = 0.0
        along, by_velocity, by_attitude = horizontal(x[:, VX : VZ + 1], level)
        J[:, 2, VX : VZ + 1] = by_velocity[:, 0]
        J[:, 2, ROLL:YAW] = by_attitude[:, 0, :2]
        w = self.model.rate(x, self._u)
        sine, cosine = np.sin(x[:, ROLL]), np.cos(x[:, ROLL])
        secant = 1.0 / np.cos(x[:, PITCH])
        yaw_rate = (w[:, 1] * sine + w[:, 2] * cosine) * secant
        wz = self._u[:, 5] - x[:, BG + 2]
        J[:, 4, BG + 1] = -sine * secant
        J[:, 4, BG + 2] = -cosine * secant
        J[:, 4, K + 1] = -sine * secant * wz
        J[:, 4, K + 2] = -cosine * secant * wz
        return np.stack([x[:, E], x[:, N], along[:, 0], x[:, YAW], yaw_rate], axis=-1), J

    def _innovations(self) -> tuple[str, ...]:
        return tuple(name for aid in self._aids.values() for name in aid.sources)

    # --- building ----------------------------------------------------------------------------------------------------

    def _make_filter(self, units: list[SensorInfo]) -> StrapdownFilter:
        config, setup, size = self._config, self._setup, self.model.size
        name: EngineName = "filterpy" if setup.runs == 1 else "ensemble"
        if config.engine != "auto":
            name = config.engine
        wheels = config.wheels
        return StrapdownFilter(
            engine=make_engine(name, *_start(config, units, self.model, setup)),
            model=self.model,
            no_slip=NoSlip(
                (wheels.lateral_m_s**2, wheels.vertical_m_s**2),
                axle_m=(wheels.axle_forward_m, 0.0, wheels.axle_up_m),
                size=size,
            ),
            standing=Standing(speed_variance=_STANDING_M_S**2, size=size),
            gate=GateConfig(
                enabled=config.gating.enabled, sigmas=config.gating.sigmas, reacquire_s=config.gating.reacquire_s
            ),
            lag_switch_m_s=_LAG_SWITCH_M_S,
            step_s=self._step_s,
            history=round(_HISTORY_S / self._step_s),
            speed_sources=[name for aid in self._aids.values() for name in aid.speed_sources],
        )


def _array(
    config: RowSpeedInsConfig, units: list[SensorInfo], setup: EstimatorSetup, step_s: float
) -> InertialArray:
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


def _model_and_aids(
    config: RowSpeedInsConfig, sensors: dict[str, list[SensorInfo]], setup: EstimatorSetup
) -> tuple[Strapdown, dict[str, Aid]]:
    pulses, receivers = [*sensors[RADAR], *sensors[ACCOSAT]], sensors[GNSS]
    size = size_of(len(pulses), len(receivers))
    models: list[PulseSensorModel] = []
    aids: dict[str, Aid] = {}
    at = CORE_STATES
    for info in pulses:
        model = replace(pulse_model(info, setup), at=at)
        at += 2
        seen = pulse_observation(info, model, size=size, correlation_s=config.noise.accosat_correlation_s)
        models.append(model)
        aids[info.name] = PulseAid(info, model, seen, setup, zero_is_speed=not config.gating.enabled)
    antennas: list[ReceiverModel] = []
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
        aids[info.name] = ReceiverAid(info, antenna, config.gnss, setup, size=size, robust=config.gating.enabled)
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
        response=noise.response_1_rts,
        sideslip_m_s=wheels.sideslip_m_s,
        sideslip_correlation_s=wheels.sideslip_correlation_s,
        scale=noise.scale_1_rts,
    )


def _start(
    config: RowSpeedInsConfig, units: list[SensorInfo], model: Strapdown, setup: EstimatorSetup
) -> tuple[FloatArray, FloatArray]:
    """State (R, n) and covariance (R, n, n) at the start."""
    east, north, heading = setup.start_e_n_heading
    x, sigma = np.zeros(model.size), np.zeros(model.size)
    x[E], x[N], x[YAW] = east, north, heading
    start, noise, count = config.start, config.noise, float(np.sqrt(len(units)))
    sigma[E] = sigma[N] = start.position_m
    sigma[VX : VZ + 1] = start.speed_m_s
    sigma[ROLL] = sigma[PITCH] = start.tilt_rad
    sigma[YAW] = start.heading_rad
    gravity = noise.accel_cross_axis_ratio * STANDARD_GRAVITY_M_S2 / count
    sigma[BA : BA + 3] = float(np.hypot(_mean_of_units(units, "accel_bias_m_s2"), gravity))
    sigma[BG : BG + 3] = max(_mean_of_units(units, "gyro_bias_rad_s"), 1e-4)
    tilt = _mean_of_units(units, "mounting_tilt_rad")
    sigma[K : K + 2] = float(np.hypot(noise.gyro_cross_axis_ratio / count, tilt))
    sigma[K + 2] = max(_mean_of_units(units, "gyro_scale_error_ratio"), 1e-4)
    sigma[SLIP] = config.wheels.sideslip_m_s
    for sensor in model.pulse_sensors:
        sigma[sensor.at] = start.speed_m_s
        sigma[sensor.at + 1] = noise.pulse_scale_ratio
    for receiver in model.receivers:
        sigma[receiver.at : receiver.at + 2] = start.speed_m_s
        sigma[receiver.at + 2 : receiver.at + 4] = config.gnss.single_m
    P = np.diag(np.square(sigma))
    return np.repeat(x[np.newaxis], setup.runs, axis=0), np.repeat(P[np.newaxis], setup.runs, axis=0)
